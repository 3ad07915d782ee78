"""Pulley speeds that the friction rig must cover for a belt, from its sliding speeds in service."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from beltid.errors import InputError
from beltid.identify.slip.points import OK, SIGNIFICANT, SlipResult

SMALLEST_SHARE = 0.01
"""Sliding speeds below this share of the largest need no runs of their own: the nearest measured
coefficient is taken there."""
SPEED_TOLERANCE = 0.02
"""A pulley speed misses an end of the range if it is off by more than this share."""


@dataclass(frozen=True, slots=True)
class RequiredSpeeds:
    """Range of pulley speeds to measure at, and whether the rig's settings cover it.

    Attributes
    ----------
    min_slip_speed_m_s, max_slip_speed_m_s : float
        Smallest sliding speed told from zero and largest sliding speed in service [m/s].
    min_speed_rad_s, max_speed_rad_s : float
        The pulley speeds of the rig that belong to them [rad/s].
    proposed_rad_s : tuple of float
        Speeds in geometric steps over the range [rad/s].
    configured : tuple of (float, str)
        Configured speeds [rad/s] and where they lie: "below", "within" or "above" the range.
    covered : bool or None
        Whether the configured speeds reach both ends; None without configured speeds.
    covers_largest : bool or None
        Whether they reach the upper end, where the nearest measured value would be wrong most.
    statement : str
        The outcome in plain words.
    """

    min_slip_speed_m_s: float
    max_slip_speed_m_s: float
    min_speed_rad_s: float
    max_speed_rad_s: float
    proposed_rad_s: tuple[float, ...]
    configured: tuple[tuple[float, str], ...]
    covered: bool | None
    covers_largest: bool | None
    statement: str


def required_pulley_speeds(
    slip: SlipResult, R: float, n: int = 5, configured: Sequence[float] | None = None
) -> RequiredSpeeds:
    """Pulley speeds ``omega = v / R`` of the friction rig that show the sliding speeds in service.

    Parameters
    ----------
    slip : SlipResult
        Sliding speeds in service.
    R : float
        Radius of the belt's centreline on the rig's pulley [m].
    n : int
        Number of speeds to propose, >= 2.
    configured : sequence of float, optional
        Pulley speeds that the rig is set to [rad/s].

    Raises
    ------
    InputError
        If R or n is not admissible, or no sliding speed can be told from zero.
    """
    problems = [] if R > 0.0 else [f"pulley_radius_m = {R!r}, must be > 0 m"]
    if n < 2:
        problems.append(f"number of pulley speeds = {n!r}, must be >= 2")
    speeds = [
        abs(p.slip_speed_m_s)
        for p in slip.points
        if p.status == OK and abs(p.slip_speed_m_s) > SIGNIFICANT * p.slip_speed_se_m_s
    ]
    if not speeds:
        problems.append("no run has a speed loss that can be told from zero")
    if problems:
        raise InputError(problems)
    v_max = max(speeds)
    v_min = max(min(speeds), SMALLEST_SHARE * v_max)
    low, high = v_min / R, v_max / R
    statement = f"sliding in service needs pulley speeds from {low:.3g} to {high:.3g} rad/s"
    rig = [float(w) for w in configured or ()]
    reached, missing = False, []
    if rig:
        reached = max(rig) >= (1.0 - SPEED_TOLERANCE) * high
        if min(rig) > (1.0 + SPEED_TOLERANCE) * low:
            missing.append(f"{low:.3g} to {min(*rig, high):.3g} rad/s")
        if not reached:
            missing.append(f"{max(*rig, low):.3g} to {high:.3g} rad/s")
        gaps = f"{' and '.join(missing)} not covered" if missing else "covered"
        statement += f"; the rig runs at {', '.join(f'{w:g}' for w in rig)} rad/s: {gaps}"
    return RequiredSpeeds(
        min_slip_speed_m_s=v_min,
        max_slip_speed_m_s=v_max,
        min_speed_rad_s=low,
        max_speed_rad_s=high,
        proposed_rad_s=tuple(np.geomspace(low, high, n).tolist()) if low < high else (high,),
        configured=tuple((w, _place(w, low, high)) for w in rig),
        covered=not missing if rig else None,
        covers_largest=reached if rig else None,
        statement=statement,
    )


def _place(omega: float, low: float, high: float) -> str:
    if omega < (1.0 - SPEED_TOLERANCE) * low:
        return "below"
    return "above" if omega > (1.0 + SPEED_TOLERANCE) * high else "within"

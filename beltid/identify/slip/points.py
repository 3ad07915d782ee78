"""Operating points of a belt drive: creep, gross slip, and the pulley speeds of a rig for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from beltid.errors import InputError
from beltid.identify.estimators.statistics import as_set

SIGNIFICANT = 4.0  # standard errors beyond which a loss or a ratio is no accident
CREEP_SHARE = 0.5  # runs up to this share of a series' largest torque give its creep
FEWEST_RUNS = 3  # that tell a creep
GROSS_OVER_CREEP = 2.0  # gross slip: the loss exceeds the creep at this torque by this factor,
GROSS_SLIP_RATIO = 0.05  # or this share of the driver's speed
SAME_SETTING = 0.02  # speeds and tensions that agree to this share belong to one series
SMALLEST_SHARE = 0.01
"""Sliding speeds below this share of the largest need no runs of their own: the nearest measured
coefficient is taken there."""
SPEED_TOLERANCE = 0.02
"""A pulley speed misses an end of the range if it is off by more than this share."""
OK = "ok"
GROSS_SLIP = "gross slip"


@dataclass(frozen=True, slots=True)
class SlipPoint:
    """One operating point of the drive: a row of the slip table; nan where unknown."""

    run: str
    driver_speed_rad_s: float  # mean, negative if it turned backwards
    initial_tension_N: float  # of the belt at rest
    torque_N_m: float  # mean, in the sign of the recording
    speed_loss_rad_s: float
    """Driver speed less driven speed times the ratio of the pulleys: positive if the driven pulley
    falls behind in either sense of turning."""
    speed_loss_se_rad_s: float  # with correlation of the samples and uncertainty of the ratio
    slip_speed_m_s: float  # Eq. (7), and its standard error
    slip_speed_se_m_s: float
    n_samples: int  # in which both speeds are known
    status: str  # "ok", "gross slip", or why the point is of no use


@dataclass(frozen=True, slots=True)
class SlipResult:
    """All operating points of a speed-loss recording."""

    points: tuple[SlipPoint, ...]  # in the order of the recording
    ratio: float  # driver over driven speed without torque, 1 if that is not known
    ratio_se: float  # standard uncertainty; 0 if no run is without torque
    max_slip_speed_m_s: float  # largest sliding speed in service, short of gross slip
    max_slip_run: str  # the run that shows it
    notes: tuple[str, ...]  # what the user should know


def mark_gross_slip(points: Sequence[SlipPoint]) -> list[SlipPoint]:
    """Give points with gross slip that status.

    The creep [rad/s per N m] of a series, the points of one driver speed and initial tension, is
    the median loss per torque of its less loaded runs, at least three of them; a series of fewer
    loaded runs has no creep to compare with.
    """
    speed, tension, torque, loss = np.array(
        [
            (p.driver_speed_rad_s, p.initial_tension_N, p.torque_N_m, p.speed_loss_rad_s)
            for p in points
        ]
    ).T
    settings = np.stack([as_set(np.abs(speed), SAME_SETTING), as_set(tension, SAME_SETTING)])
    settings = np.nan_to_num(settings, nan=-1.0)  # unknown ones are one setting
    torque, loss = np.abs(torque), np.abs(loss)
    # a run without torque says nothing of creep
    good = np.array([p.status == OK for p in points]) & np.isfinite(torque) & np.isfinite(loss)
    marked = []
    for k, p in enumerate(points):
        series = good & np.all(settings == settings[:, [k]], axis=0)
        largest = float(np.max(torque[series], initial=0.0))
        loaded = np.flatnonzero(series & (torque > 0.05 * largest))
        loaded = loaded[np.argsort(torque[loaded], kind="stable")]
        low = loaded[: max(np.count_nonzero(torque[loaded] <= CREEP_SHARE * largest), FEWEST_RUNS)]
        creep = float(np.median(loss[low] / torque[low])) if low.size >= FEWEST_RUNS else 0.0
        limit = GROSS_OVER_CREEP * creep * torque[k] + SIGNIFICANT * p.speed_loss_se_rad_s
        too_fast = loss[k] > GROSS_SLIP_RATIO * abs(p.driver_speed_rad_s)
        gross = p.status == OK and (too_fast or (creep > 0.0 and loss[k] > limit))
        marked.append(replace(p, status=GROSS_SLIP) if gross else p)
    return marked


@dataclass(frozen=True, slots=True)
class RequiredSpeeds:
    """Range of pulley speeds to measure at, and whether the rig's settings cover it."""

    proposed_rad_s: tuple[float, ...]
    """In geometric steps from the speed of the smallest sliding told from zero to the largest."""
    covered: bool | None  # whether the rig's speeds reach both ends; None if it has none
    statement: str  # the outcome in plain words


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
    rig = list(configured or ())
    missing = []
    if rig:
        if min(rig) > (1.0 + SPEED_TOLERANCE) * low:
            missing.append(f"{low:.3g} to {min(*rig, high):.3g} rad/s")
        if max(rig) < (1.0 - SPEED_TOLERANCE) * high:
            missing.append(f"{max(*rig, low):.3g} to {high:.3g} rad/s")
        gaps = f"{' and '.join(missing)} not covered" if missing else "covered"
        statement += f"; the rig runs at {', '.join(f'{w:g}' for w in rig)} rad/s: {gaps}"
    return RequiredSpeeds(
        proposed_rad_s=tuple(np.geomspace(low, high, n).tolist()) if low < high else (high,),
        covered=not missing if rig else None,
        statement=statement,
    )

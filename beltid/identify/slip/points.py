"""Operating points of a belt drive: gross slip, and the pulley speeds to test on a rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError
from beltid.identify.estimators.statistics import snap_to_settings

Array = NDArray[np.float64]

SIGNIFICANT = 4.0  # standard errors beyond which a loss or a ratio is significant
CREEP_SHARE = 0.5  # runs up to this share of a series' largest torque define its creep
FEWEST_RUNS = 3  # minimum number of runs to determine the creep
GROSS_OVER_CREEP = 2.0  # a loss beyond this multiple of the creep is gross slip
GROSS_SLIP_RATIO = 0.05  # and so is one beyond this share of the driver's speed
SAME_SETTING = 0.02  # relative gap in speed or tension that separates two series
SMALLEST_SHARE = 0.01
"""Sliding speeds below this share of the largest need no separate runs: the law uses the nearest
measured coefficient there."""
PROPOSED = 5  # number of pulley speeds to propose
SPEED_TOLERANCE = 0.02  # a pulley speed this near still reaches the end of the range
OK = "ok"
GROSS_SLIP = "gross slip"


@dataclass(frozen=True, slots=True)
class SlipPoint:
    """Operating point of the drive: one row of the slip table; nan where unknown."""

    run: str
    driver_speed_rad_s: float
    initial_tension_N: float  # belt at rest
    torque_N_m: float  # mean, with the sign of the recording
    speed_loss_rad_s: float
    """Driver speed minus driven speed times the pulley ratio: positive if the driven pulley falls
    behind."""
    speed_loss_se_rad_s: float  # with the correlation of the samples and the ratio's uncertainty
    slip_speed_m_s: float  # Eq. (7), and its standard error
    slip_speed_se_m_s: float
    n_samples: int  # samples with both speeds known
    status: str  # "ok", "gross slip", or why the point cannot be used


@dataclass(frozen=True, slots=True)
class SlipResult:
    """All operating points of a speed-loss recording."""

    points: tuple[SlipPoint, ...]  # in the order of the recording
    ratio: float  # driver speed over driven speed without torque; 1 if unknown
    ratio_se: float  # standard uncertainty; 0 without a torque-free run
    max_slip_speed_m_s: float  # largest sliding speed in service without gross slip
    max_slip_run: str  # run with this sliding speed
    notes: tuple[str, ...]  # for the user


def gross_slip(
    speed: Array, tension: Array, torque: Array, loss: Array, se: Array, usable: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Mark the usable runs with gross slip; arrays with one entry per run, nan where unknown.

    A series holds the runs of one driver speed and initial tension. Its creep [rad/s per N m] is
    the median loss per torque of its less loaded runs, at least three.
    """
    settings = np.stack([snap_to_settings(x, SAME_SETTING) for x in (speed, tension)])
    # all unknown values form one setting
    _, series = np.unique(np.nan_to_num(settings, nan=-1.0), axis=1, return_inverse=True)
    gross = loss > GROSS_SLIP_RATIO * speed
    for k in range(int(series.max()) + 1):
        rows = series == k
        good = rows & usable & np.isfinite(torque)
        largest = float(np.max(torque[good], initial=0.0))
        loaded = np.flatnonzero(good & (torque > 0.05 * largest))
        loaded = loaded[np.argsort(torque[loaded], kind="stable")]
        low = loaded[: max(np.count_nonzero(torque[loaded] <= CREEP_SHARE * largest), FEWEST_RUNS)]
        creep = float(np.median(loss[low] / torque[low])) if low.size >= FEWEST_RUNS else 0.0
        if creep > 0.0:
            gross |= rows & (loss > GROSS_OVER_CREEP * creep * torque + SIGNIFICANT * se)
    return usable & gross


@dataclass(frozen=True, slots=True)
class RequiredSpeeds:
    """Range of pulley speeds to test, and whether the rig's settings cover it."""

    proposed_rad_s: tuple[float, ...]  # geometric steps over the significant sliding speeds
    covered: bool | None  # whether the rig's speeds reach both ends; None without speeds
    statement: str  # result in plain words


def required_pulley_speeds(
    slip: SlipResult, R: float, configured: Sequence[float] | None = None
) -> RequiredSpeeds:
    """Find the pulley speeds ``omega = v / R`` of the friction rig that cover sliding in service.

    Parameters
    ----------
    slip : SlipResult
        Sliding speeds in service.
    R : float
        Radius of the belt's centreline on the rig's pulley [m], > 0.
    configured : sequence of float, optional
        Pulley speeds set on the rig [rad/s].

    Raises
    ------
    InputError
        If no sliding speed differs significantly from zero.
    """
    speeds = [
        abs(p.slip_speed_m_s)
        for p in slip.points
        if p.status == OK and abs(p.slip_speed_m_s) > SIGNIFICANT * p.slip_speed_se_m_s
    ]
    if not speeds:
        raise InputError("no run has a speed loss that differs significantly from zero")
    high = max(speeds) / R
    low = max(min(speeds) / R, SMALLEST_SHARE * high)
    statement = f"sliding in service needs pulley speeds from {low:.3g} to {high:.3g} rad/s"
    rig, missing = list(configured or ()), []
    if rig:
        if min(rig) > (1.0 + SPEED_TOLERANCE) * low:
            missing.append(f"{low:.3g} to {min(*rig, high):.3g} rad/s")
        if max(rig) < (1.0 - SPEED_TOLERANCE) * high:
            missing.append(f"{max(*rig, low):.3g} to {high:.3g} rad/s")
        gaps = f"{' and '.join(missing)} not covered" if missing else "covered"
        statement += f"; the rig runs at {', '.join(f'{w:g}' for w in rig)} rad/s: {gaps}"
    return RequiredSpeeds(
        proposed_rad_s=tuple(np.geomspace(low, high, PROPOSED).tolist()) if low < high else (high,),
        covered=not missing if rig else None,
        statement=statement,
    )

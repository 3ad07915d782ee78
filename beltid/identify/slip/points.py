"""Operating points of a belt drive: creep and gross slip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

SIGNIFICANT = 4.0
"""Standard errors beyond which a loss or a ratio is no accident."""
CREEP_SHARE = 0.5
"""Runs up to this share of a series' largest torque give its creep."""
GROSS_OVER_CREEP = 2.0
"""Gross slip: the loss exceeds the creep at this torque by this factor,"""
GROSS_SLIP_RATIO = 0.05
"""or this share of the driver's speed."""
SAME_SETTING = 0.02
"""Speeds and tensions that agree to this share belong to one series."""
OK = "ok"
GROSS_SLIP = "gross slip"


@dataclass(frozen=True, slots=True)
class SlipPoint:
    """One operating point of the drive: a row of the slip table.

    Attributes
    ----------
    run : str
        Label of the run.
    driver_speed_rad_s : float
        Mean speed of the driver [rad/s], negative if it turned backwards.
    initial_tension_N : float
        Tension of the belt at rest [N], nan if unknown.
    torque_N_m : float
        Mean torque [N m] in the sign of the recording, nan if unknown.
    speed_loss_rad_s : float
        Driver speed less driven speed times the ratio of the pulleys [rad/s]; the noise of a
        point without torque may make it slightly negative. Of the mirrored drive if the driver
        turned backwards, so that a driven pulley that falls behind has a positive loss.
    speed_loss_se_rad_s : float
        Its standard error, correlation of the samples and doubt about the ratio of the pulleys
        allowed for [rad/s].
    slip_speed_m_s, slip_speed_se_m_s : float
        Eq. (7) and its standard error [m/s].
    n_samples : int
        Samples used, those with missing values and spikes left out.
    status : str
        "ok", "gross slip", or why the point is of no use.
    """

    run: str
    driver_speed_rad_s: float
    initial_tension_N: float
    torque_N_m: float
    speed_loss_rad_s: float
    speed_loss_se_rad_s: float
    slip_speed_m_s: float
    slip_speed_se_m_s: float
    n_samples: int
    status: str


@dataclass(frozen=True, slots=True)
class SlipResult:
    """All operating points of a speed-loss recording.

    Attributes
    ----------
    points : tuple of SlipPoint
        In the order of the recording.
    ratio, ratio_se : float
        Driver over driven speed without torque [-]; 1 and 0 if taken as equal.
    max_slip_speed_m_s : float
        Largest sliding speed in service, short of gross slip [m/s].
    max_slip_run : str
        The run that shows it.
    notes : tuple of str
        What the user should know.
    """

    points: tuple[SlipPoint, ...]
    ratio: float
    ratio_se: float
    max_slip_speed_m_s: float
    max_slip_run: str
    notes: tuple[str, ...]


def mark_gross_slip(points: Sequence[SlipPoint]) -> list[SlipPoint]:
    """Give points with gross slip that status.

    Parameters
    ----------
    points : sequence of SlipPoint
        All points; the creep is taken from those of the same driver speed and initial tension.
    """
    usable = [p for p in points if p.status == OK]
    marked = []
    for p in points:
        loss = abs(p.speed_loss_rad_s)
        creep = creep_per_torque([q for q in usable if _same_series(p, q)])
        limit = GROSS_OVER_CREEP * creep * abs(p.torque_N_m) + SIGNIFICANT * p.speed_loss_se_rad_s
        gross = loss > GROSS_SLIP_RATIO * abs(p.driver_speed_rad_s) or (
            creep > 0.0 and loss > limit
        )
        marked.append(replace(p, status=GROSS_SLIP) if p.status == OK and gross else p)
    return marked


def creep_per_torque(series: Sequence[SlipPoint]) -> float:
    """Loss per torque of the less loaded runs of a series [rad/s per N m].

    The median over the runs up to :data:`CREEP_SHARE` of the largest torque; 0 with fewer than
    three of them, which is no creep to compare with.
    """
    torque = np.abs([q.torque_N_m for q in series])
    loss = np.abs([q.speed_loss_rad_s for q in series])
    known = np.isfinite(torque) & np.isfinite(loss)  # a run without torque says nothing of creep
    torque, loss = torque[known], loss[known]
    largest = float(np.max(torque, initial=0.0))
    low = (torque <= CREEP_SHARE * largest) & (torque > 0.05 * largest)
    if np.count_nonzero(low) < 3:
        return 0.0
    return float(np.median(loss[low] / torque[low]))


def _same_series(p: SlipPoint, q: SlipPoint) -> bool:
    pairs = (
        (p.driver_speed_rad_s, q.driver_speed_rad_s),
        (p.initial_tension_N, q.initial_tension_N),
    )
    return all(not abs(a - b) > SAME_SETTING * abs(a) for a, b in pairs)

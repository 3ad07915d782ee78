"""Sliding speeds in service from the angular-speed loss of a two-pulley drive, Eq. (7).

Two pulleys, one belt, a torque: the driven pulley falls behind the driver. Up to the torque that
the belt can carry this is creep, proportional to the torque; then it slips grossly and the loss
explodes. The largest loss short of that gives the largest sliding speed ``v = omega_loss R`` that
the friction rig has to cover.

The pulleys need not be equal to the last digit. Their ratio is taken from the runs without torque,
where there is no loss; if it does not differ from 1 beyond its error, or no such run exists, 1 is
used. The loss is that of the driver: ``driver_speed - ratio * driven_speed``. A drive that turns
backwards is evaluated as the mirrored one; its speed and torque keep the signs of the recording.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError
from beltid.identify.estimators.statistics import MeanWithError, robust_mean_with_se
from beltid.identify.slip.direction import forward_runs, turns_opposite
from beltid.identify.slip.noise import pooled_means, speed_series
from beltid.identify.slip.points import OK, SIGNIFICANT, SlipPoint, SlipResult, mark_gross_slip
from beltid.identify.slip.rig_speeds import RequiredSpeeds, required_pulley_speeds
from beltid.laws.capstan import sliding_speed

__all__ = ["RequiredSpeeds", "SlipPoint", "SlipResult", "fit_slip", "required_pulley_speeds"]

Array = NDArray[np.float64]

DRIVER, DRIVEN = "driver_speed_rad_s", "driven_speed_rad_s"
COLUMNS = ("initial_tension_N", "torque_N_m", DRIVER, DRIVEN)
MIN_SAMPLES = 3
"""Fewest usable samples of a run."""
NO_LOAD_SHARE = 0.01
"""A torque below this share of the largest is none."""


def fit_slip(speedloss: Mapping[str, NDArray], pulley_radius_m: float) -> SlipResult:
    """Sliding speed of every operating point of a speed-loss recording, Eq. (7).

    Parameters
    ----------
    speedloss : mapping of str to ndarray
        Columns ``run``, ``initial_tension_N``, ``torque_N_m``, ``driver_speed_rad_s`` and
        ``driven_speed_rad_s``, shape (n,) each; nan where missing.
    pulley_radius_m : float
        Radius of the belt's centreline on the driver pulley [m].

    Returns
    -------
    SlipResult
        One point per run, none dropped.

    Raises
    ------
    InputError
        If columns are missing, the radius is not positive, or no point can be used.
    """
    recorded = _runs(speedloss, pulley_radius_m)
    runs, turned = forward_runs(recorded)
    series = speed_series({r: robust_mean_with_se(c[DRIVER]).mean for r, c in runs.items()})
    ratio, ratio_se, notes = _pulley_ratio(runs, series)
    notes = [*turned, *notes]
    losses = pooled_means({r: c[DRIVER] - ratio * c[DRIVEN] for r, c in runs.items()}, series)
    points = [
        _point(label, run, losses[label], ratio_se, pulley_radius_m) for label, run in runs.items()
    ]
    points = [_as_recorded(p, recorded[p.run]) for p in mark_gross_slip(points)]
    service = [p for p in points if p.status == OK]
    if not service:
        raise InputError([f"run {p.run}: {p.status}" for p in points])
    largest = max(service, key=lambda p: abs(p.slip_speed_m_s))
    for status in dict.fromkeys(p.status for p in points if p.status != OK):
        runs_so = ", ".join(p.run for p in points if p.status == status)
        notes.append(f"{status}: {runs_so}; not counted for the largest sliding speed")
    return SlipResult(
        tuple(points), ratio, ratio_se, abs(largest.slip_speed_m_s), largest.run, tuple(notes)
    )


def _runs(speedloss: Mapping[str, NDArray], radius: float) -> dict[str, dict[str, Array]]:
    """Columns of each run, in the order of the recording."""
    problems = [
        f"speed-loss recording: column {name} is missing"
        for name in ("run", *COLUMNS)
        if name not in speedloss
    ]
    if not (radius > 0.0 and math.isfinite(radius)):
        problems.append(f"pulley_radius_m = {radius!r}, must be > 0 m")
    if problems:
        raise InputError(problems)
    labels = np.asarray(speedloss["run"]).astype(str)
    if labels.size == 0:
        raise InputError("speed-loss recording: 0 samples, must be at least 1")
    columns = {name: np.asarray(speedloss[name], dtype=float) for name in COLUMNS}
    wrong = [f"{name} {v.shape}" for name, v in columns.items() if v.shape != labels.shape]
    if wrong:
        raise InputError(
            f"speed-loss recording: columns {', '.join(wrong)}, must be {labels.shape} as run is"
        )
    return {
        label: {name: values[labels == label] for name, values in columns.items()}
        for label in dict.fromkeys(labels.tolist())
    }


def _pulley_ratio(
    runs: Mapping[str, Mapping[str, Array]], series: Sequence[Sequence[str]]
) -> tuple[float, float, list[str]]:
    """Ratio of driver to driven speed without torque, its standard error, and notes."""
    torque = {label: robust_mean_with_se(run["torque_N_m"]) for label, run in runs.items()}
    largest = max((abs(t.mean) for t in torque.values() if math.isfinite(t.mean)), default=0.0)
    quotients = {
        label: run[DRIVER] / np.where(np.abs(run[DRIVEN]) > 0.0, run[DRIVEN], np.nan)
        for label, run in runs.items()
    }
    found = pooled_means(quotients, series)
    ratios = []
    for label, t in torque.items():
        idle = abs(t.mean) <= max(NO_LOAD_SHARE * largest, 2.0 * t.se if t.se > 0 else 0.0)
        if idle and found[label].n_eff > 0.0 and found[label].se > 0.0:
            ratios.append(found[label])
    if not ratios:
        return 1.0, 0.0, ["no run without torque: the pulleys are taken as equal"]
    weights = np.array([r.se**-2 for r in ratios])
    ratio = float(weights @ np.array([r.mean for r in ratios]) / weights.sum())
    se = float(weights.sum() ** -0.5)
    if abs(ratio - 1.0) <= SIGNIFICANT * se:
        return 1.0, 0.0, []
    return ratio, se, [f"ratio of the pulleys {ratio:.6g} ± {se:.1g}, from the runs without torque"]


def _point(
    label: str, run: Mapping[str, Array], loss: MeanWithError, ratio_se: float, radius: float
) -> SlipPoint:
    driver, driven = run[DRIVER], run[DRIVEN]
    n = int(np.count_nonzero(np.isfinite(driver) & np.isfinite(driven)))
    speed = robust_mean_with_se(driver).mean
    torque = robust_mean_with_se(run["torque_N_m"]).mean
    driven_speed = robust_mean_with_se(driven).mean
    se = math.hypot(loss.se, ratio_se * driven_speed)
    status = OK
    if n < MIN_SAMPLES:
        status = f"fewer than {MIN_SAMPLES} usable samples"
    elif speed == 0.0:
        status = "the driver does not turn"
    elif turns_opposite(speed, driven_speed):
        status = "the pulleys turn in opposite directions"
    elif loss.mean * math.copysign(1.0, speed * _sign(torque)) < -SIGNIFICANT * loss.se:
        status = "the driven pulley gains on the driver"
    return SlipPoint(
        run=label,
        driver_speed_rad_s=speed,
        initial_tension_N=robust_mean_with_se(run["initial_tension_N"]).mean,
        torque_N_m=torque,
        speed_loss_rad_s=loss.mean,
        speed_loss_se_rad_s=se,
        slip_speed_m_s=float(sliding_speed(loss.mean, radius)),
        slip_speed_se_m_s=float(sliding_speed(se, radius)),
        n_samples=n,
        status=status,
    )


def _as_recorded(point: SlipPoint, run: Mapping[str, Array]) -> SlipPoint:
    """Point with the driver's speed and the torque in the signs of the recording."""
    return replace(
        point,
        driver_speed_rad_s=robust_mean_with_se(run[DRIVER]).mean,
        torque_N_m=robust_mean_with_se(run["torque_N_m"]).mean,
    )


def _sign(torque: float) -> float:
    """-1 for a torque that turns the roles of the pulleys round (a generator driving), else 1."""
    return -1.0 if torque < 0.0 else 1.0

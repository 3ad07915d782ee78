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
from beltid.identify.slip.points import OK, SIGNIFICANT, SlipPoint, SlipResult, mark_gross_slip
from beltid.identify.slip.pooled_means import pooled_means, speed_series
from beltid.identify.slip.rig_speeds import RequiredSpeeds, required_pulley_speeds
from beltid.laws.capstan import sliding_speed

__all__ = ["RequiredSpeeds", "SlipPoint", "SlipResult", "fit_slip", "required_pulley_speeds"]

Array = NDArray[np.float64]

DRIVER, DRIVEN = "driver_speed_rad_s", "driven_speed_rad_s"
COLUMNS = ("initial_tension_N", "torque_N_m", DRIVER, DRIVEN)
SPEEDS = (DRIVER, DRIVEN)
MIN_SAMPLES = 3
"""Fewest usable samples of a run."""
NO_LOAD_SHARE = 0.01
"""A torque below this share of the largest is none."""
STANDS = 0.05
"""A driven pulley slower than this share of the driver says nothing about its direction."""


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
    runs, turned = _forward_runs(recorded)
    series = speed_series({r: robust_mean_with_se(c[DRIVER]).mean for r, c in runs.items()})
    ratio, ratio_se, notes = _pulley_ratio(runs, series)
    notes = [*turned, *notes]
    losses = pooled_means({r: c[DRIVER] - ratio * c[DRIVEN] for r, c in runs.items()}, series)
    points = [
        _point(label, run, losses[label], ratio_se, pulley_radius_m) for label, run in runs.items()
    ]
    points = [
        replace(  # signs of the recording
            p,
            driver_speed_rad_s=robust_mean_with_se(recorded[p.run][DRIVER]).mean,
            torque_N_m=robust_mean_with_se(recorded[p.run]["torque_N_m"]).mean,
        )
        for p in mark_gross_slip(points)
    ]
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


def _forward_runs(
    runs: Mapping[str, Mapping[str, Array]],
) -> tuple[dict[str, dict[str, Array]], list[str]]:
    """Runs of a drive that turns backwards as those of the mirrored drive, and what was turned.

    The torque of these runs is turned with the speeds if it is negative on the whole: then it is
    counted in the direction of the pulleys' axis. A torque that stays positive is counted in the
    direction of the turning.
    """
    backward = [label for label, run in runs.items() if _turns_backwards(run)]
    forward = {label: dict(run) for label, run in runs.items()}
    if not backward:
        return forward, []
    torque = np.concatenate([runs[label]["torque_N_m"] for label in backward])
    with_torque = bool(np.nansum(torque) < 0.0)
    for label in backward:
        for name in (*SPEEDS, "torque_N_m") if with_torque else SPEEDS:
            forward[label][name] = -runs[label][name]
    what = "speeds and of the torque" if with_torque else "speeds"
    which = "all runs" if len(backward) == len(runs) else ", ".join(backward)
    return forward, [f"the drive turns backwards in {which}: sign of the {what} turned"]


def _turns_backwards(run: Mapping[str, Array]) -> bool:
    driver, driven = (run[name][np.isfinite(run[name])] for name in SPEEDS)
    if not (driver.size and driven.size) or not np.median(driver) < 0.0:
        return False
    return not _turns_opposite(float(np.median(driver)), float(np.median(driven)))


def _turns_opposite(driver_rad_s: float, driven_rad_s: float) -> bool:
    """Whether the driven pulley turns against the driver, as no open belt lets it."""
    return driver_rad_s * driven_rad_s < 0.0 and abs(driven_rad_s) > STANDS * abs(driver_rad_s)


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
    elif _turns_opposite(speed, driven_speed):
        status = "the pulleys turn in opposite directions"
    # a negative torque turns the roles of the pulleys round: a generator drives
    elif loss.mean * math.copysign(1.0, -speed if torque < 0.0 else speed) < -SIGNIFICANT * loss.se:
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

"""Sliding speeds in service from the angular-speed loss of a two-pulley drive, Eq. (7).

Two pulleys, one belt, a torque: the driven pulley falls behind the driver. Up to the torque that
the belt can carry this is creep, proportional to the torque; then it slips grossly and the loss
explodes. The largest loss short of that gives the largest sliding speed ``v = omega_loss R`` that
the friction rig has to cover. The loss is that of the driver: ``driver_speed - ratio *
driven_speed``, with the ratio of the pulleys from the runs without torque, where there is no loss;
if no such run exists, the pulleys are taken as equal. The time in which the drive comes up to its
speed or stops is left out. A drive that turns backwards is evaluated as
the mirrored one; its speed and torque keep the signs of the recording.

Runs are short, and all of a series have the same sensors: their noise is pooled. A run that
scatters far beyond its series (it shakes) keeps its own variance and correlation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, chdtri, ndtr, stdtrit

from beltid.errors import InputError
from beltid.identify.estimators.signal import (
    converter_rounding,
    converter_steps,
    difference_sigma,
    noise_before_rounding,
)
from beltid.identify.estimators.statistics import (
    MeanWithError,
    integrated_autocorrelation_time,
    mad_sigma,
    outlier_mask,
    robust_mean_with_se,
    settings_of,
)
from beltid.identify.slip.points import (
    OK,
    SIGNIFICANT,
    SlipPoint,
    SlipResult,
    mark_gross_slip,
)
from beltid.laws.capstan import sliding_speed

Array = NDArray[np.float64]
Runs = Mapping[str, Mapping[str, Array]]

DRIVER, DRIVEN = "driver_speed_rad_s", "driven_speed_rad_s"
SPEEDS = (DRIVER, DRIVEN)
COLUMNS = ("initial_tension_N", "torque_N_m", *SPEEDS)
GAINS = "the driven pulley gains on the driver"
MIN_SAMPLES = 3  # fewest usable samples of a run
NO_LOAD_SHARE = 0.01  # a torque below this share of the largest is none
SHAKES = 1.0e-4  # probability of a scatter that is no longer that of the series
FEWEST_RUNS = 3  # a series of fewer runs is pooled with all others
SERIES_WIDTH = 0.02  # runs whose speeds agree to this share are one series
AT_SPEED = 0.98  # share of its speed from which on a driver has come up to it
UNSTEADY = 0.2  # a torque that changes within a run by this share of its largest is said
STANDS = 0.05
"""A driven pulley slower than this share of the driver says nothing about its direction."""


def fit_slip(speedloss: Mapping[str, NDArray], pulley_radius_m: float) -> SlipResult:
    """Sliding speed of every operating point of a speed-loss recording, Eq. (7); no run dropped.

    Parameters
    ----------
    speedloss : mapping of str to ndarray
        Columns ``run``, ``initial_tension_N``, ``torque_N_m``, ``driver_speed_rad_s`` and
        ``driven_speed_rad_s``, shape (n,) each; nan where missing.
    pulley_radius_m : float
        Radius of the belt's centreline on the driver pulley [m].

    Raises
    ------
    InputError
        If columns are missing, the radius is not positive, or no point can be used.
    """
    recorded = _runs(speedloss, pulley_radius_m)
    recorded, notes = _at_speed(recorded)
    runs, turned = _forward_runs(recorded)
    notes += [*turned, *_unsteady(runs)]
    series = speed_series({r: robust_mean_with_se(c[DRIVER]).mean for r, c in runs.items()})
    ratio, ratio_se, ratio_notes = _pulley_ratio(runs, series)
    notes += ratio_notes
    losses = pooled_means({r: c[DRIVER] - ratio * c[DRIVEN] for r, c in runs.items()}, series)
    if _counts_load_as_negative(runs, losses):
        for run in runs.values():
            run["torque_N_m"] = -run["torque_N_m"]
        notes.append("the torque of a driving pulley is recorded as negative: its sign turned")
    rounding = _rounding(runs, ratio)
    points = [_point(r, runs[r], losses[r], rounding[r], ratio_se, pulley_radius_m) for r in runs]
    points = [
        replace(  # signs of the recording
            p,
            driver_speed_rad_s=robust_mean_with_se(recorded[p.run][DRIVER]).mean,
            torque_N_m=robust_mean_with_se(recorded[p.run]["torque_N_m"]).mean,
        )
        for p in mark_gross_slip(points)
    ]
    service = [p for p in points if p.status == OK]
    clear = [p for p in service if abs(p.speed_loss_rad_s) > SIGNIFICANT * p.speed_loss_se_rad_s]
    if not service or (not clear and any(p.status == GAINS for p in points)):
        aside = [f"run {p.run}: {p.status}" for p in points if p.status != OK]
        raise InputError([*aside, *ratio_notes])
    largest = max(service, key=lambda p: abs(p.slip_speed_m_s))
    for status in dict.fromkeys(p.status for p in points if p.status != OK):
        runs_so = ", ".join(p.run for p in points if p.status == status)
        notes.append(f"{status}: {runs_so}; not counted for the largest sliding speed")
    return SlipResult(
        tuple(points), ratio, ratio_se, abs(largest.slip_speed_m_s), largest.run, tuple(notes)
    )


def _runs(speedloss: Mapping[str, NDArray], radius: float) -> dict[str, dict[str, Array]]:
    """Columns of each run, in the order of the recording."""
    head = "speed-loss recording:"
    needed = ("run", *COLUMNS)
    problems = [f"{head} column {name} is missing" for name in needed if name not in speedloss]
    if not (radius > 0.0 and math.isfinite(radius)):
        problems.append(f"pulley_radius_m = {radius!r}, must be > 0 m")
    if problems:
        raise InputError(problems)
    labels = np.asarray(speedloss["run"]).astype(str)
    if labels.size == 0:
        raise InputError(f"{head} 0 samples, must be at least 1")
    columns = {name: np.asarray(speedloss[name], dtype=float) for name in COLUMNS}
    wrong = [f"{name} {v.shape}" for name, v in columns.items() if v.shape != labels.shape]
    if wrong:
        raise InputError(f"{head} columns {', '.join(wrong)}, must be {labels.shape} as run is")
    return {
        label: {name: values[labels == label] for name, values in columns.items()}
        for label in dict.fromkeys(labels.tolist())
    }


def _at_speed(runs: Runs) -> tuple[dict[str, dict[str, Array]], list[str]]:
    """Runs without the samples before the driver has come up to its speed, and after it stops."""
    kept, shortened = {}, []
    for label, run in runs.items():
        speed = np.abs(run[DRIVER])
        known = np.isfinite(speed)
        part = slice(None)
        if known.any():
            # blind to spikes; a fourth of the samples at speed are enough
            turning = speed[speed >= 0.5 * np.nanquantile(speed, 0.75, method="lower")]
            at_speed = np.flatnonzero(speed >= AT_SPEED * np.median(turning))
            part = slice(at_speed[0], at_speed[-1] + 1)
        kept[label] = {name: values[part] for name, values in run.items()}
        if np.count_nonzero(known[part]) < np.count_nonzero(known):
            shortened.append(label)
    if not shortened:
        return kept, []
    return kept, [f"samples before the driver is up to its speed left out: {', '.join(shortened)}"]


def _unsteady(runs: Runs) -> list[str]:
    """A note on runs whose torque is swept: their mean is no operating point."""
    torques = {r: run["torque_N_m"][np.isfinite(run["torque_N_m"])] for r, run in runs.items()}
    largest = max((float(np.median(np.abs(t))) for t in torques.values() if t.size), default=0.0)
    found = []
    for label, torque in torques.items():
        if torque.size < 8 * MIN_SAMPLES:
            continue
        means = [float(np.mean(part)) for part in np.array_split(torque, 8)]
        noise = difference_sigma(torque) / math.sqrt(torque.size / 8)
        if np.ptp(means) > max(UNSTEADY * largest, 8.0 * noise):
            found.append(f"{label} ({min(means):.3g} to {max(means):.3g} N m)")
    if not found:
        return []
    return [f"the torque changes within {', '.join(found)}: their means count; part them by torque"]


def _rounding(runs: Runs, ratio: float) -> dict[str, float]:
    """Error of the loss of every run by the rounding of coarse speeds [rad/s]."""
    known = {
        label: [run[name][np.isfinite(run[name])] for name in SPEEDS] for label, run in runs.items()
    }
    steps = converter_steps(*(np.concatenate(parts) for parts in zip(*known.values(), strict=True)))
    found = {}
    for label, speeds in known.items():
        noise = noise_before_rounding([float(np.std(x)) if x.size else 0.0 for x in speeds], steps)
        driver, driven = converter_rounding(noise, steps)
        found[label] = math.hypot(driver, ratio * driven)
    return found


def _forward_runs(runs: Runs) -> tuple[dict[str, dict[str, Array]], list[str]]:
    """Runs of a drive that turns backwards as those of the mirrored drive, and what was turned.

    A torque that is negative on the whole is counted along the axis of the pulleys and turned, too;
    one that stays positive is counted in the direction of the turning.
    """
    backward = []
    for label, run in runs.items():
        speeds = [
            float(np.median(x)) for x in (run[n][np.isfinite(run[n])] for n in SPEEDS) if x.size
        ]
        if len(speeds) == 2 and speeds[0] < 0.0 and not _turns_opposite(*speeds):
            backward.append(label)
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


def _counts_load_as_negative(runs: Runs, losses: Mapping[str, MeanWithError]) -> bool:
    """Whether the driven pulley clearly falls behind, and does so under negative torque only."""
    clear = [label for label, loss in losses.items() if abs(loss.mean) > SIGNIFICANT * loss.se]
    return bool(clear) and all(
        losses[label].mean > 0.0 and np.nansum(runs[label]["torque_N_m"]) < 0.0 for label in clear
    )


def _turns_opposite(driver_rad_s: float, driven_rad_s: float) -> bool:
    """Whether the driven pulley turns against the driver, as no open belt lets it."""
    return driver_rad_s * driven_rad_s < 0.0 and abs(driven_rad_s) > STANDS * abs(driver_rad_s)


def _pulley_ratio(runs: Runs, series: Sequence[Sequence[str]]) -> tuple[float, float, list[str]]:
    """Ratio of driver to driven speed without torque, its standard error, and notes."""
    torque = {label: robust_mean_with_se(run["torque_N_m"]) for label, run in runs.items()}
    largest = max((abs(t.mean) for t in torque.values() if math.isfinite(t.mean)), default=0.0)
    quotients = {
        label: run[DRIVER] / np.where(np.abs(run[DRIVEN]) > 0.0, run[DRIVEN], np.nan)
        for label, run in runs.items()
    }
    found = pooled_means(quotients, series)
    ratios = [
        found[label]
        for label, t in torque.items()
        if abs(t.mean)
        <= max(NO_LOAD_SHARE * largest, min(2.0 * t.se, UNSTEADY * largest) if t.se > 0 else 0.0)
        and found[label].n_eff > 0.0
        and found[label].se > 0.0
    ]
    if not ratios:
        speeds = (abs(robust_mean_with_se(run[DRIVER]).mean) for run in runs.values())
        fastest = max((speed for speed in speeds if math.isfinite(speed)), default=0.0)
        unequal = (
            f"radii that differ by 0.1 % would be {1e-3 * fastest:.2g} rad/s of the loss at "
            f"{fastest:.3g} rad/s"
        )
        return 1.0, 0.0, [f"no run without torque: the pulleys are taken as equal; {unequal}"]
    weights = np.array([r.se**-2 for r in ratios])
    ratio = float(weights @ np.array([r.mean for r in ratios]) / weights.sum())
    se = float(weights.sum() ** -0.5)
    notes = [f"ratio of the pulleys {ratio:.6g} ± {se:.1g}, from the runs without torque"]
    return ratio, se, notes if abs(ratio - 1.0) > SIGNIFICANT * se else []


def _point(
    label: str,
    run: Mapping[str, Array],
    loss: MeanWithError,
    rounding: float,
    ratio_se: float,
    radius: float,
) -> SlipPoint:
    tension, torque, speed, driven_speed = (robust_mean_with_se(run[n]).mean for n in COLUMNS)
    n = int(np.count_nonzero(np.isfinite(run[DRIVER]) & np.isfinite(run[DRIVEN])))
    se = math.hypot(loss.se, rounding, ratio_se * driven_speed)
    status = OK
    if n < MIN_SAMPLES:
        status = f"fewer than {MIN_SAMPLES} usable samples"
    elif speed == 0.0:
        status = "the driver does not turn"
    elif _turns_opposite(speed, driven_speed):
        status = "the pulleys turn in opposite directions"
    # a negative torque turns the roles of the pulleys round: a generator drives
    elif loss.mean * math.copysign(1.0, -speed if torque < 0.0 else speed) < -SIGNIFICANT * loss.se:
        status = GAINS
    v, v_se = (float(sliding_speed(w, radius)) for w in (loss.mean, se))
    return SlipPoint(label, speed, tension, torque, loss.mean, se, v, v_se, n, status)


def speed_series(speed_rad_s: Mapping[str, float]) -> tuple[tuple[str, ...], ...]:
    """Runs at the same speed [rad/s]; all runs as one series where some speed has too few."""
    runs = np.array(list(speed_rad_s), dtype=object)
    speeds = np.abs(np.array(list(speed_rad_s.values()), dtype=float))
    labels = settings_of(speeds, SERIES_WIDTH)
    if not np.isfinite(speeds).all() or np.bincount(labels, minlength=1).min() < FEWEST_RUNS:
        return (tuple(runs),)
    return tuple(tuple(runs[labels == k]) for k in np.unique(labels))


def pooled_means(
    samples: Mapping[str, Array], series: Sequence[Sequence[str]]
) -> dict[str, MeanWithError]:
    """Mean of every run without its spikes, its standard error from the pooled noise.

    Parameters
    ----------
    samples : mapping of str to ndarray
        Evenly spaced samples of a steady signal for each run, nan where missing, shape (n,).
    series : sequence of sequence of str
        Runs whose noise is alike.

    Returns
    -------
    dict of str to MeanWithError
        The standard error is ``t sqrt(s² tau / n)`` with the pooled variance s² and correlation
        time tau [samples]; t widens it to a probability of 68 % for the degrees of freedom of s²
        (Student). nan where nothing determines the noise.
    """
    found: dict[str, MeanWithError] = {}
    for labels in series:
        means = _means_of_series([np.asarray(samples[label], dtype=float) for label in labels])
        found |= zip(labels, means, strict=True)
    return found


def _means_of_series(recorded: Sequence[Array]) -> list[MeanWithError]:
    runs = _without_spikes(recorded)
    n = np.array([np.count_nonzero(np.isfinite(r)) for r in runs], dtype=float)
    mean = [float(np.nanmean(r)) if k else np.nan for r, k in zip(runs, n, strict=True)]
    squares = np.array([np.nansum((r - m) ** 2) for r, m in zip(runs, mean, strict=True)])
    # a run that shakes must not settle the correlation of all: each has the same weight at first
    alike = [r / max(float(np.sqrt(s)), 1e-300) for r, s in zip(runs, squares, strict=True)]
    tau = np.minimum(integrated_autocorrelation_time(*alike), np.maximum(n, 1.0))
    known = (n / tau > 1.0) & (squares > 0.0)
    shakes = np.zeros(n.size, dtype=bool)
    if np.count_nonzero(known) >= FEWEST_RUNS:
        # chi² over the median of the runs, which is blind to those that shake
        freedom = n[known] / tau[known] - 1.0
        typical = np.median(squares[known] / chdtri(freedom, 0.5))
        shakes[known] = chdtrc(freedom, squares[known] / typical) < SHAKES
    for same in (np.flatnonzero(~shakes), *np.flatnonzero(shakes)[:, None]):
        of_noise = integrated_autocorrelation_time(*(runs[k] for k in same))
        tau[same] = np.minimum(of_noise, np.maximum(n[same], 1.0))
    freedom = np.maximum(n / tau - 1.0, 0.0)  # independent samples less the mean of the run
    variance = np.divide(squares, tau * freedom, out=np.zeros(n.size), where=freedom > 0.0)
    pool = float(freedom[~shakes].sum())
    if pool > 0.0:
        variance[~shakes] = freedom[~shakes] @ variance[~shakes] / pool
        freedom[~shakes] = pool
    known = (freedom > 0.0) & (n > 0.0)
    se = np.full(n.size, np.nan)
    student = stdtrit(np.maximum(freedom[known], 1.0), float(ndtr(1.0)))
    se[known] = student * np.sqrt(variance[known] * tau[known] / n[known])
    return [MeanWithError(*map(float, row)) for row in zip(mean, se, n / tau, strict=True)]


def _without_spikes(runs: Sequence[Array]) -> list[Array]:
    """Runs with nan in place of spikes, which exceed the noise of their run and of all runs."""
    steps = np.concatenate([np.diff(r[np.isfinite(r)]) for r in runs])
    common = mad_sigma(np.concatenate([steps, -steps])) / np.sqrt(2.0) if steps.size else 0.0
    return [np.where(outlier_mask(r, common), np.nan, r) for r in runs]

"""Sliding speeds in service from the angular-speed loss of a two-pulley drive, Eq. (7).

In a loaded two-pulley drive the driven pulley falls behind the driver. Up to the torque that the
belt can carry, this is creep, proportional to the torque; beyond it the belt slips grossly and the
loss rises steeply. The largest loss without gross slip gives the largest sliding speed
``v = omega_loss R`` that the friction rig has to cover. The loss refers to the driver:
``driver_speed - ratio * driven_speed``. The pulley ratio comes from the runs without torque, where
there is no loss; without such runs the pulleys are assumed equal. Start-up and run-down of the
drive are ignored. A drive that turns backwards is evaluated like its mirror image; its speed and
torque keep the signs of the recording.

Runs are short, and all runs of a series use the same sensors: their noise is pooled. A run that
scatters far more than its series (it shakes) keeps its own variance and correlation.
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
    COARSEST,
    adc_resolution,
    converter_rounding,
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
MIN_SAMPLES = 3  # minimum number of usable samples of a run
NO_LOAD_SHARE = 0.01  # a torque below this share of the largest counts as zero
SHAKES = 1.0e-4  # probability below which a run's scatter differs from its series
FEWEST_RUNS = 3  # if a series has fewer runs, all runs are pooled
SERIES_WIDTH = 0.02  # relative gap in speed that separates two series
AT_SPEED = 0.98  # share of its speed above which a driver has reached it
UNSTEADY = 0.2  # change of torque within a run, over the largest torque, worth a note
STANDS = 0.05
"""Speed of the driven pulley over the driver's below which its direction is unknown."""


def fit_slip(speedloss: Mapping[str, NDArray], pulley_radius_m: float) -> SlipResult:
    """Calculate the sliding speed of each run of a speed-loss recording, Eq. (7); drop no run.

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
    runs, backward_notes = _forward_runs(recorded)
    notes += [*backward_notes, *_unsteady(runs)]
    series = speed_series({r: robust_mean_with_se(c[DRIVER]).mean for r, c in runs.items()})
    rounding = _rounding(runs)
    ratio, ratio_se, ratio_notes = _pulley_ratio(runs, series, rounding)
    notes += ratio_notes
    losses = pooled_means({r: c[DRIVER] - ratio * c[DRIVEN] for r, c in runs.items()}, series)
    if _counts_load_as_negative(runs, losses):
        for run in runs.values():
            run["torque_N_m"] = -run["torque_N_m"]
        notes.append("the torque of a driving pulley is recorded as negative: sign reversed")
    points = []
    for label, run in runs.items():
        of_driver, of_driven = rounding[label]
        rounding_of_loss = math.hypot(of_driver, ratio * of_driven)
        points.append(
            _point(label, run, losses[label], rounding_of_loss, ratio_se, pulley_radius_m)
        )
    points = [
        replace(  # restore the signs of the recording
            p,
            driver_speed_rad_s=robust_mean_with_se(recorded[p.run][DRIVER]).mean,
            torque_N_m=robust_mean_with_se(recorded[p.run]["torque_N_m"]).mean,
        )
        for p in mark_gross_slip(points)
    ]
    service = [p for p in points if p.status == OK]
    clear = [p for p in service if abs(p.speed_loss_rad_s) > SIGNIFICANT * p.speed_loss_se_rad_s]
    if clear and all(p.speed_loss_rad_s < 0.0 for p in clear):
        notes.append(
            "the driven pulley gains on the driver in every run with a clear loss: either it "
            "drives, as a negative torque says, or the columns of driver and driven speed are "
            "swapped"
        )
    if not service or (not clear and any(p.status == GAINS for p in points)):
        reasons = [f"run {p.run}: {p.status}" for p in points if p.status != OK]
        raise InputError([*reasons, *ratio_notes])
    largest = max(service, key=lambda p: abs(p.slip_speed_m_s))
    for status in dict.fromkeys(p.status for p in points if p.status != OK):
        labels = ", ".join(p.run for p in points if p.status == status)
        notes.append(f"{status}: {labels}; ignored for the largest sliding speed")
    return SlipResult(
        tuple(points), ratio, ratio_se, abs(largest.slip_speed_m_s), largest.run, tuple(notes)
    )


def _runs(speedloss: Mapping[str, NDArray], radius: float) -> dict[str, dict[str, Array]]:
    """Check the columns and split them by run, in the order of the recording."""
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
    """Cut off the samples before the driver reaches its speed and after it stops."""
    kept, shortened = {}, []
    for label, run in runs.items():
        speed = np.abs(run[DRIVER])
        finite = np.isfinite(speed)
        part = slice(None)
        if finite.any():
            # robust to spikes; a quarter of the samples at speed is enough
            turning = speed[speed >= 0.5 * np.nanquantile(speed, 0.75, method="lower")]
            at_speed = np.flatnonzero(speed >= AT_SPEED * np.median(turning))
            part = slice(at_speed[0], at_speed[-1] + 1)
        kept[label] = {name: values[part] for name, values in run.items()}
        if np.count_nonzero(finite[part]) < np.count_nonzero(finite):
            shortened.append(label)
    if not shortened:
        return kept, []
    return kept, [f"samples before the driver is up to its speed left out: {', '.join(shortened)}"]


def _unsteady(runs: Runs) -> list[str]:
    """Note runs whose torque changes: their mean is not an operating point."""
    torques = {r: run["torque_N_m"][np.isfinite(run["torque_N_m"])] for r, run in runs.items()}
    largest = max((float(np.median(np.abs(t))) for t in torques.values() if t.size), default=0.0)
    changing = []
    for label, torque in torques.items():
        if torque.size < 8 * MIN_SAMPLES:
            continue
        means = [float(np.mean(part)) for part in np.array_split(torque, 8)]
        noise = difference_sigma(torque) / math.sqrt(torque.size / 8)
        if np.ptp(means) > max(UNSTEADY * largest, 8.0 * noise):
            changing.append(f"{label} ({min(means):.3g} to {max(means):.3g} N m)")
    if not changing:
        return []
    return [
        f"the torque changes within {', '.join(changing)}: only their means are used; split these "
        "runs by torque"
    ]


def _rounding(runs: Runs) -> dict[str, tuple[float, float]]:
    """Estimate the errors of each run's mean speeds due to coarse readings [rad/s]."""
    finite = {
        label: [run[name][np.isfinite(run[name])] for name in SPEEDS] for label, run in runs.items()
    }
    driver, driven = (np.concatenate(parts) for parts in zip(*finite.values(), strict=True))
    steps = np.maximum(adc_resolution(driver, driven), _common_step(np.append(driver, driven)))
    errors = {}
    for label, speeds in finite.items():
        noise = noise_before_rounding([float(np.std(x)) if x.size else 0.0 for x in speeds], steps)
        of_driver, of_driven = converter_rounding(noise, steps).tolist()
        errors[label] = (of_driver, of_driven)
    return errors


def _common_step(readings: Array) -> float:
    """Return the largest step that divides all readings, by Euclid's algorithm.

    It tells the resolution of readings that do not change within a run. Zero with fewer than three
    different readings, which do not tell it, and where it is too large for a resolution.
    """
    levels = np.unique(np.abs(readings[readings != 0.0]))
    if levels.size < 3:
        return 0.0
    step, smallest = float(levels[0]), 1e-9 * float(levels[-1])
    while step > smallest:
        remainders = np.abs(levels - step * np.rint(levels / step))
        if np.max(remainders) <= smallest:
            return step if step <= COARSEST * float(levels[-1]) else 0.0
        step = float(np.min(remainders[remainders > smallest]))
    return 0.0


def _forward_runs(runs: Runs) -> tuple[dict[str, dict[str, Array]], list[str]]:
    """Mirror the runs that turn backwards, and note the signs reversed.

    A torque that is negative overall was recorded about the axis of the pulleys; its sign is
    reversed too. A torque that stays positive was recorded in the direction of rotation.
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
    mirror_torque = bool(np.nansum(torque) < 0.0)
    for label in backward:
        for name in (*SPEEDS, "torque_N_m") if mirror_torque else SPEEDS:
            forward[label][name] = -runs[label][name]
    quantities = "speeds and of the torque" if mirror_torque else "speeds"
    labels = "all runs" if len(backward) == len(runs) else ", ".join(backward)
    return forward, [f"the drive turns backwards in {labels}: sign of the {quantities} reversed"]


def _counts_load_as_negative(runs: Runs, losses: Mapping[str, MeanWithError]) -> bool:
    """Tell whether the driven pulley clearly falls behind, but under negative torque only."""
    clear = [label for label, loss in losses.items() if abs(loss.mean) > SIGNIFICANT * loss.se]
    return bool(clear) and all(
        losses[label].mean > 0.0 and np.nansum(runs[label]["torque_N_m"]) < 0.0 for label in clear
    )


def _turns_opposite(driver_rad_s: float, driven_rad_s: float) -> bool:
    """Tell whether the driven pulley turns against the driver, impossible with an open belt."""
    return driver_rad_s * driven_rad_s < 0.0 and abs(driven_rad_s) > STANDS * abs(driver_rad_s)


def _pulley_ratio(
    runs: Runs, series: Sequence[Sequence[str]], rounding: Mapping[str, tuple[float, float]]
) -> tuple[float, float, list[str]]:
    """Return the driver-to-driven speed ratio without torque, its standard error, and notes.

    Coarse readings may be wrong by the same amount in all runs: their errors do not average out.
    """
    torque = {label: robust_mean_with_se(run["torque_N_m"]) for label, run in runs.items()}
    largest = max((abs(t.mean) for t in torque.values() if math.isfinite(t.mean)), default=0.0)
    quotients = {
        label: run[DRIVER] / np.where(np.abs(run[DRIVEN]) > 0.0, run[DRIVEN], np.nan)
        for label, run in runs.items()
    }
    means = pooled_means(quotients, series)
    idle = [
        label
        for label, t in torque.items()
        if abs(t.mean)
        <= max(NO_LOAD_SHARE * largest, min(2.0 * t.se, UNSTEADY * largest) if t.se > 0 else 0.0)
        and means[label].n_eff > 0.0
        and math.isfinite(means[label].se)
    ]
    if not idle:
        speeds = (abs(robust_mean_with_se(run[DRIVER]).mean) for run in runs.values())
        fastest = max((speed for speed in speeds if math.isfinite(speed)), default=0.0)
        unequal = (
            f"radii that differ by 0.1 % would be {1e-3 * fastest:.2g} rad/s of the loss at "
            f"{fastest:.3g} rad/s"
        )
        return 1.0, 0.0, [f"no run without torque: the pulleys are taken as equal; {unequal}"]
    ratios = np.array([means[label].mean for label in idle])
    scatter = np.array([means[label].se for label in idle])
    speeds_driven = np.array([abs(robust_mean_with_se(runs[label][DRIVEN]).mean) for label in idle])
    of_driver, of_driven = np.array([rounding[label] for label in idle]).T
    coarse = np.hypot(of_driver, ratios * of_driven) / speeds_driven
    weights = 1.0 / np.maximum(scatter**2 + coarse**2, 1e-30)
    weights /= weights.sum()
    ratio = float(weights @ ratios)
    se = math.hypot(np.linalg.norm(weights * scatter), float(weights @ coarse))
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
    """Evaluate one run."""
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
    # a negative torque swaps the roles of the pulleys, as with a generator
    elif loss.mean * math.copysign(1.0, -speed if torque < 0.0 else speed) < -SIGNIFICANT * se:
        status = GAINS
    v, v_se = (float(sliding_speed(w, radius)) for w in (loss.mean, se))
    return SlipPoint(label, speed, tension, torque, loss.mean, se, v, v_se, n, status)


def speed_series(speed_rad_s: Mapping[str, float]) -> tuple[tuple[str, ...], ...]:
    """Group the runs by speed [rad/s]; one series of all runs if any speed has too few."""
    runs = np.array(list(speed_rad_s), dtype=object)
    speeds = np.abs(np.array(list(speed_rad_s.values()), dtype=float))
    labels = settings_of(speeds, SERIES_WIDTH)
    if not np.isfinite(speeds).all() or np.bincount(labels, minlength=1).min() < FEWEST_RUNS:
        return (tuple(runs),)
    return tuple(tuple(runs[labels == k]) for k in np.unique(labels))


def pooled_means(
    samples: Mapping[str, Array], series: Sequence[Sequence[str]]
) -> dict[str, MeanWithError]:
    """Average each run without its spikes; the standard error comes from the pooled noise.

    Parameters
    ----------
    samples : mapping of str to ndarray
        Evenly spaced samples of a steady signal for each run, nan where missing, shape (n,).
    series : sequence of sequence of str
        Labels of the runs with equal noise.

    Returns
    -------
    dict of str to MeanWithError
        The standard error is ``t sqrt(s² tau / n)`` with the pooled variance s² and correlation
        time tau [samples]; Student's t for the degrees of freedom of s² widens it to a probability
        of 68 %. nan if the noise cannot be determined.
    """
    pooled: dict[str, MeanWithError] = {}
    for labels in series:
        means = _means_of_series([np.asarray(samples[label], dtype=float) for label in labels])
        pooled |= zip(labels, means, strict=True)
    return pooled


def _means_of_series(recorded: Sequence[Array]) -> list[MeanWithError]:
    """Average each run of one series; see :func:`pooled_means`."""
    runs = _without_spikes(recorded)
    n = np.array([np.count_nonzero(np.isfinite(r)) for r in runs], dtype=float)
    mean = [float(np.nanmean(r)) if k else np.nan for r, k in zip(runs, n, strict=True)]
    squares = np.array([np.nansum((r - m) ** 2) for r, m in zip(runs, mean, strict=True)])
    # a run that shakes must not dominate the correlation: start with equal weights
    normalised = [r / max(float(np.sqrt(s)), 1e-300) for r, s in zip(runs, squares, strict=True)]
    tau = np.minimum(integrated_autocorrelation_time(*normalised), np.maximum(n, 1.0))
    usable = (n / tau > 1.0) & (squares > 0.0)
    shakes = np.zeros(n.size, dtype=bool)
    if np.count_nonzero(usable) >= FEWEST_RUNS:
        # chi² relative to the median of the runs, which ignores those that shake
        dof = n[usable] / tau[usable] - 1.0
        typical = np.median(squares[usable] / chdtri(dof, 0.5))
        shakes[usable] = chdtrc(dof, squares[usable] / typical) < SHAKES
    for group in (np.flatnonzero(~shakes), *np.flatnonzero(shakes)[:, None]):
        tau_group = integrated_autocorrelation_time(*(runs[k] for k in group))
        tau[group] = np.minimum(tau_group, np.maximum(n[group], 1.0))
    dof = np.maximum(n / tau - 1.0, 0.0)  # independent samples minus one for the mean
    variance = np.divide(squares, tau * dof, out=np.zeros(n.size), where=dof > 0.0)
    pooled_dof = float(dof[~shakes].sum())
    if pooled_dof > 0.0:
        variance[~shakes] = dof[~shakes] @ variance[~shakes] / pooled_dof
        dof[~shakes] = pooled_dof
    usable = (dof > 0.0) & (n > 0.0)
    se = np.full(n.size, np.nan)
    student = stdtrit(np.maximum(dof[usable], 1.0), float(ndtr(1.0)))
    se[usable] = student * np.sqrt(variance[usable] * tau[usable] / n[usable])
    return [MeanWithError(*map(float, row)) for row in zip(mean, se, n / tau, strict=True)]


def _without_spikes(runs: Sequence[Array]) -> list[Array]:
    """Replace spikes by nan; a spike exceeds the noise of its run and of all runs."""
    steps = np.concatenate([np.diff(r[np.isfinite(r)]) for r in runs])
    common = mad_sigma(np.concatenate([steps, -steps])) / np.sqrt(2.0) if steps.size else 0.0
    return [np.where(outlier_mask(r, common), np.nan, r) for r in runs]

"""Sliding speeds in service from the angular-speed loss of a two-pulley drive, Eq. (7).

The driven pulley of a loaded drive falls behind the driver: ``omega_loss = driver - ratio driven``,
by creep, proportional to the torque, until the belt slips grossly. The largest loss without gross
slip gives the largest sliding speed ``v = omega_loss R`` that the friction rig has to cover. The
ratio of the pulleys comes from the runs without torque; without such runs it is taken as one.

Runs are short, and the runs of a series use the same sensors: their noise is pooled.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, chdtri, ndtr, stdtrit

from beltid.errors import InputError
from beltid.identify.estimators.statistics import (
    integrated_autocorrelation_time,
    mad_sigma,
    outlier_mask,
    settings_of,
)
from beltid.identify.slip.points import (
    FEWEST_RUNS,
    GROSS_SLIP,
    OK,
    SAME_SETTING,
    SIGNIFICANT,
    SlipPoint,
    SlipResult,
    gross_slip,
)
from beltid.laws.capstan import sliding_speed

Array = NDArray[np.float64]
Runs = dict[str, list[Array]]  # samples of each run by column

DRIVER, DRIVEN, TORQUE = "driver_speed_rad_s", "driven_speed_rad_s", "torque_N_m"
COLUMNS = ("initial_tension_N", TORQUE, DRIVER, DRIVEN)
GAINS = (
    "the driven pulley gains on the driver: it drives, or the columns of driver and driven speed "
    "are swapped"
)
BACKWARDS = "the drive turns backwards: give its speeds a factor of -1 under units.speedloss"
MIN_SAMPLES = 3  # minimum number of usable samples of a run
NO_LOAD_SHARE = 0.01  # a torque below this share of the largest counts as zero
SHAKES = 1.0e-4  # probability below which a run's scatter differs from its series
AT_SPEED = 0.98  # share of its speed above which a driver has reached it
UNSTEADY = 0.2  # change of torque within a run, over the largest torque, worth a note
STANDS = 0.05
"""Speed of the driven pulley over the driver's below which its direction is unknown."""
COARSEST = 0.1  # largest step of a reading, over the largest value, that is a resolution


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
    labels, runs = _runs(speedloss, pulley_radius_m)
    notes = [*_cut_to_speed(labels, runs), *_unsteady(labels, runs[TORQUE])]
    tension, torque, speed, driven = (
        np.array([_mean(samples) for samples in runs[name]]) for name in COLUMNS
    )
    series = _series(speed)
    torque_se = pooled_means(runs[TORQUE], series)[1]
    idle = _without_torque(np.abs(torque), torque_se)
    rounding = _rounding(runs)
    ratio, ratio_se, ratio_notes = _pulley_ratio(runs, series, idle, speed, driven, rounding)
    losses = [a - ratio * b for a, b in zip(runs[DRIVER], runs[DRIVEN], strict=True)]
    loss, se = pooled_means(losses, series)
    se = np.sqrt(se**2 + rounding[0] ** 2 + (ratio * rounding[1]) ** 2 + (ratio_se * driven) ** 2)
    n = np.array([np.isfinite(x).sum() for x in losses])
    status = np.full(n.size, OK, dtype=object)
    for is_so, reason in (  # the last one that holds is stated
        (loss < -SIGNIFICANT * se, GAINS),
        (speed < 0.0, BACKWARDS),
        (driven * np.sign(speed) < -STANDS * np.abs(speed), "the pulleys turn in opposite ways"),
        (speed == 0.0, "the driver does not turn"),
        (n < MIN_SAMPLES, f"fewer than {MIN_SAMPLES} usable samples"),
    ):
        status[is_so] = reason
    status[gross_slip(speed, tension, np.abs(torque), loss, se, status == OK)] = GROSS_SLIP
    service = status == OK
    if not service.any() or (np.any(status == GAINS) and not np.any(loss[service] > se[service])):
        why = zip(labels[~service], status[~service], strict=True)
        raise InputError([*(f"run {label}: {text}" for label, text in why), *ratio_notes])
    for text in dict.fromkeys(status[~service]):
        named = ", ".join(labels[status == text])
        notes.append(f"{text}: {named}; ignored for the largest sliding speed")
    v, v_se = sliding_speed(loss, pulley_radius_m), sliding_speed(se, pulley_radius_m)
    columns = labels, speed, tension, torque, loss, se, v, v_se, n, status
    largest = int(np.argmax(np.where(service, v, -np.inf)))
    return SlipResult(
        points=tuple(SlipPoint(*row) for row in zip(*(c.tolist() for c in columns), strict=True)),
        ratio=ratio,
        ratio_se=ratio_se,
        max_slip_speed_m_s=abs(float(v[largest])),
        max_slip_run=labels[largest],
        notes=(*notes, *ratio_notes),
    )


def _runs(speedloss: Mapping[str, NDArray], radius: float) -> tuple[NDArray[np.object_], Runs]:
    """Check the columns and split them by run; return the labels in the order of the recording."""
    needed = ("run", *COLUMNS)
    missing = [name for name in needed if name not in speedloss]
    problems = [f"speed-loss recording: column {name} is missing" for name in missing]
    if not (radius > 0.0 and math.isfinite(radius)):
        problems.append(f"pulley_radius_m = {radius!r}, must be > 0 m")
    if not problems:
        sizes = {name: np.shape(speedloss[name]) for name in needed}
        if len(set(sizes.values())) > 1 or sizes["run"] == (0,):
            text = ", ".join(f"{name} {shape}" for name, shape in sizes.items())
            problems.append(f"speed-loss recording: {text}, must be equally many, at least 1")
    if problems:
        raise InputError(problems)
    labels = np.asarray(speedloss["run"]).astype(str)
    names = np.array(list(dict.fromkeys(labels.tolist())), dtype=object)
    rows = [labels == name for name in names]
    columns = {name: np.asarray(speedloss[name], dtype=float) for name in COLUMNS}
    return names, {name: [values[r] for r in rows] for name, values in columns.items()}


def _cut_to_speed(labels: NDArray[np.object_], runs: Runs) -> list[str]:
    """Cut off the samples before the driver reaches its speed and after it stops; note the runs."""
    shortened = []
    for k, label in enumerate(labels):
        speed = np.abs(runs[DRIVER][k])
        finite = np.isfinite(speed)
        if not finite.any():
            continue
        # robust to spikes; a quarter of the samples at speed is enough
        turning = speed[speed >= 0.5 * np.nanquantile(speed, 0.75, method="lower")]
        at_speed = np.flatnonzero(speed >= AT_SPEED * np.median(turning))
        part = slice(at_speed[0], at_speed[-1] + 1)
        for values in runs.values():
            values[k] = values[k][part]
        if finite[part].sum() < finite.sum():
            shortened.append(label)
    if not shortened:
        return []
    return [f"samples before the driver is up to its speed left out: {', '.join(shortened)}"]


def _unsteady(labels: NDArray[np.object_], torques: Sequence[Array]) -> list[str]:
    """Note runs whose torque changes: their mean is not an operating point."""
    parts = [np.array_split(torque[np.isfinite(torque)], 8) for torque in torques]
    medians = [
        [float(np.median(p)) for p in run if p.size >= MIN_SAMPLES] or [0.0] for run in parts
    ]
    largest = max(max(np.abs(run)) for run in medians)
    return [
        f"the torque changes within {label} ({min(run):.3g} to {max(run):.3g} N m): only its mean "
        "is used; split the run by torque"
        for label, run in zip(labels, medians, strict=True)
        if max(run) - min(run) > UNSTEADY * largest
    ]


def _series(speed: Array) -> NDArray[np.intp]:
    """Number the series of runs by speed [rad/s]; one of all runs if any speed has too few."""
    series = settings_of(np.abs(speed), SAME_SETTING)
    one = not np.isfinite(speed).all() or np.bincount(series).min() < FEWEST_RUNS
    return np.zeros_like(series) if one else series


def resolution(readings: Array) -> float:
    """Return the largest step that divides all readings (Euclid), zero if none shows."""
    levels = np.unique(np.abs(readings[np.isfinite(readings) & (readings != 0.0)]))
    if levels.size < 3:
        return 0.0
    step, rest = float(levels[0]), levels
    while rest.size:
        rest = np.abs(levels - step * np.rint(levels / step))
        rest = rest[rest > 1e-6 * levels[-1]]
        step = float(np.min(rest, initial=step))
    return step if step <= COARSEST * levels[-1] else 0.0


def rounding_of_mean(recorded: Array, step: float) -> Array:
    """Return the standard error of means due to readings in steps; averaging does not lower it.

    It is ``step/sqrt(12)`` without noise; noise before the rounding, here a safe lower estimate
    from the recorded scatter, smooths it as ``exp(-2 pi² noise²/step²)``.
    """
    if step == 0.0:
        return np.zeros(recorded.shape)
    noise2 = np.maximum((recorded / step) ** 2 - 1.0 / 6.0, 0.0)
    return np.asarray(step / math.sqrt(12.0) * np.exp(-2.0 * math.pi**2 * noise2))


def _rounding(runs: Runs) -> tuple[Array, Array]:
    """Return the standard errors of the mean speeds (driver, driven) due to coarse readings."""
    step = resolution(np.concatenate(runs[DRIVER] + runs[DRIVEN]))
    scatter = [
        np.array([np.nanstd(w) if np.isfinite(w).any() else 0.0 for w in runs[name]])
        for name in (DRIVER, DRIVEN)
    ]
    return rounding_of_mean(scatter[0], step), rounding_of_mean(scatter[1], step)


def _without_torque(torque: Array, se: Array) -> NDArray[np.bool_]:
    """Mark the runs without torque, (R,): below a share of the largest, or within its noise."""
    largest = np.fmax.reduce(torque, initial=0.0)
    return torque <= np.fmax(NO_LOAD_SHARE * largest, np.fmin(2.0 * se, UNSTEADY * largest))


def _pulley_ratio(
    runs: Runs,
    series: NDArray[np.intp],
    idle: NDArray[np.bool_],
    speed: Array,
    driven: Array,
    rounding: tuple[Array, Array],
) -> tuple[float, float, list[str]]:
    """Return the driver-to-driven speed ratio without torque, its standard error, and notes.

    Coarse readings may be wrong by the same amount in all runs: their errors do not average out.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        quotients = [a / b for a, b in zip(runs[DRIVER], runs[DRIVEN], strict=True)]
    ratios, scatter = pooled_means(quotients, series)
    idle = idle & np.isfinite(scatter)
    if not idle.any():
        unequal = f"{1e-3 * np.fmax.reduce(np.abs(speed)):.2g} rad/s of the loss"
        text = "no run without torque: the pulleys are taken as equal; radii that differ by 0.1 %"
        return 1.0, 0.0, [f"{text} would be {unequal}"]
    ratios, scatter = ratios[idle], scatter[idle]
    coarse = np.hypot(rounding[0][idle], ratios * rounding[1][idle]) / np.abs(driven[idle])
    weights = 1.0 / np.maximum(scatter**2 + coarse**2, 1e-30)
    weights /= weights.sum()
    ratio = float(weights @ ratios)
    se = math.hypot(float(np.linalg.norm(weights * scatter)), float(weights @ coarse))
    notes = [f"ratio of the pulleys {ratio:.6g} ± {se:.1g}, from the runs without torque"]
    return ratio, se, notes if abs(ratio - 1.0) > SIGNIFICANT * se else []


def _mean(samples: Array) -> float:
    """Average without spikes; nan without samples."""
    kept = samples[~outlier_mask(samples)]
    return float(np.mean(kept)) if kept.size else math.nan


def pooled_means(samples: Sequence[Array], series: NDArray[np.intp]) -> Array:
    """Average each run without its spikes; the standard error comes from the pooled noise.

    Parameters
    ----------
    samples : sequence of ndarray
        Evenly spaced samples of a steady signal for each of R runs, nan where missing, shape (n,).
    series : ndarray of int
        Number of the series of each run, shape (R,); the runs of a series have equal noise.

    Returns
    -------
    ndarray, shape (2, R)
        Means and standard errors ``t sqrt(s² tau / n)`` with the variance s² and the correlation
        time tau [samples] of the series, or of the run itself if it scatters far more; Student's t
        for the degrees of freedom of s² widens it to a probability of 68 %. nan if unknown.
    """
    pooled = np.full((2, series.size), np.nan)
    for number in np.unique(series):
        rows = np.flatnonzero(series == number)
        pooled[:, rows] = _means_of_series([samples[k] for k in rows.tolist()])
    return pooled


def _means_of_series(recorded: Sequence[Array]) -> Array:
    """Average each run of one series; see :func:`pooled_means`."""
    steps = np.concatenate([np.diff(r[np.isfinite(r)]) for r in recorded])
    noise = mad_sigma(np.concatenate([steps, -steps])) / math.sqrt(2.0) if steps.size else 0.0
    runs = [np.where(outlier_mask(r, noise), np.nan, r) for r in recorded]
    n = np.array([np.count_nonzero(np.isfinite(r)) for r in runs], dtype=float)
    mean = np.array([np.nanmean(r) if k else np.nan for r, k in zip(runs, n, strict=True)])
    squares = np.array([np.nansum((r - m) ** 2) for r, m in zip(runs, mean, strict=True)])
    shakes = np.zeros(n.size, dtype=bool)
    several = (n > 1.0) & (squares > 0.0)
    if np.count_nonzero(several) >= FEWEST_RUNS:
        # chi² relative to the median of the runs, which ignores those that shake; of unit size,
        # a run that shakes does not dominate the correlation
        unit = (runs[k] / math.sqrt(squares[k]) for k in np.flatnonzero(several).tolist())
        dof = np.maximum(n[several] / integrated_autocorrelation_time(*unit) - 1.0, 1e-3)
        typical = np.median(squares[several] / chdtri(dof, 0.5))
        shakes[several] = chdtrc(dof, squares[several] / typical) < SHAKES
    se = np.full(n.size, np.nan)
    for group in (np.flatnonzero(~shakes & (n > 0.0)), *np.flatnonzero(shakes)[:, None]):
        tau = integrated_autocorrelation_time(*(runs[k] for k in group))
        tau_of_run = np.minimum(tau, n[group])
        dof = np.sum(np.maximum(n[group] / tau_of_run - 1.0, 0.0))
        if dof > 0.0:
            s2 = np.sum(squares[group] / tau_of_run) / dof
            student = stdtrit(max(dof, 1.0), ndtr(1.0))
            se[group] = student * np.sqrt(s2 * tau_of_run / n[group])
    return np.array([mean, se])

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
    integrated_autocorrelation_time,
    mad_sigma,
    outlier_mask,
    robust_mean_with_se,
    settings_of,
)
from beltid.identify.slip.points import (
    GROSS_SLIP,
    OK,
    SIGNIFICANT,
    SlipPoint,
    SlipResult,
    gross_slip,
)
from beltid.laws.capstan import sliding_speed

Array = NDArray[np.float64]
Runs = dict[str, list[Array]]  # samples of each run by column

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
    labels, runs = _runs(speedloss, pulley_radius_m)
    notes = _cut_to_speed(labels, runs)
    of_runs = {name: np.array([robust_mean_with_se(x) for x in runs[name]]).T for name in COLUMNS}
    tension, torque, speed, driven = (mean for mean, _, _ in of_runs.values())
    total = np.array([np.nansum(x) for x in runs["torque_N_m"]])
    turns, load, backward_notes = _directions(labels, speed, driven, total)
    notes += [*backward_notes, *_unsteady(labels, runs["torque_N_m"])]
    series = speed_series(speed)
    rounding = _rounding(runs)
    ratio, ratio_se, ratio_notes = _pulley_ratio(runs, of_runs, series, rounding)
    notes += ratio_notes
    # from here on, runs that turn backwards are mirrored: of positive speed
    losses = [a - ratio * b for a, b in zip(*(runs[name] for name in SPEEDS), strict=True)]
    loss, loss_se, _ = pooled_means(losses, series)
    loss = turns * loss
    clear = np.abs(loss) > SIGNIFICANT * loss_se
    if clear.any() and np.all((loss > 0.0) & (load * total < 0.0) | ~clear):
        load = -load
        notes.append("the torque of a driving pulley is recorded as negative: sign reversed")
    parts = loss_se, rounding[0], ratio * rounding[1], ratio_se * driven
    se = np.sqrt(sum(part**2 for part in parts))
    n = np.array([np.isfinite(x).sum() for x in losses])
    # a negative torque swaps the roles of the pulleys, as with a generator
    drives = np.where(load * torque < 0.0, -turns * speed, turns * speed)
    gains = -loss * np.copysign(1.0, drives) > SIGNIFICANT * se
    status = _status(n, speed, driven, gains)
    status[gross_slip(speed, tension, torque, loss, se, status == OK)] = GROSS_SLIP
    service = status == OK
    clear = service & (np.abs(loss) > SIGNIFICANT * se)
    if clear.any() and np.all(loss[clear] < 0.0):
        notes.append(
            "the driven pulley gains on the driver in every run with a clear loss: either it "
            "drives, as a negative torque says, or the columns of driver and driven speed are "
            "swapped"
        )
    if not service.any() or (not clear.any() and np.any(status == GAINS)):
        why = zip(labels[~service], status[~service], strict=True)
        raise InputError([*(f"run {label}: {text}" for label, text in why), *ratio_notes])
    for text in dict.fromkeys(status[~service]):
        named = ", ".join(labels[status == text])
        notes.append(f"{text}: {named}; ignored for the largest sliding speed")
    v, v_se = sliding_speed(loss, pulley_radius_m), sliding_speed(se, pulley_radius_m)
    columns = labels, speed, tension, torque, loss, se, v, v_se, n, status
    largest = int(np.argmax(np.where(service, np.abs(v), -np.inf)))
    return SlipResult(
        points=tuple(SlipPoint(*row) for row in zip(*(c.tolist() for c in columns), strict=True)),
        ratio=ratio,
        ratio_se=ratio_se,
        max_slip_speed_m_s=abs(float(v[largest])),
        max_slip_run=labels[largest],
        notes=tuple(notes),
    )


def _status(
    n: NDArray[np.intp], speed: Array, driven: Array, gains: NDArray[np.bool_]
) -> NDArray[np.object_]:
    """Return why each run cannot be used, or OK."""
    status = np.full(n.size, OK, dtype=object)
    for is_so, reason in (  # the last one that holds is stated
        (gains, GAINS),
        (_turn_opposite(speed, driven), "the pulleys turn in opposite directions"),
        (speed == 0.0, "the driver does not turn"),
        (n < MIN_SAMPLES, f"fewer than {MIN_SAMPLES} usable samples"),
    ):
        status[is_so] = reason
    return status


def _runs(speedloss: Mapping[str, NDArray], radius: float) -> tuple[NDArray[np.object_], Runs]:
    """Check the columns and split them by run; return the labels in the order of the recording."""
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
    names = np.array(list(dict.fromkeys(labels.tolist())), dtype=object)
    rows = [labels == name for name in names]
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
    torques = [torque[np.isfinite(torque)] for torque in torques]
    largest = max((float(np.median(np.abs(t))) for t in torques if t.size), default=0.0)
    changing = []
    for label, torque in zip(labels, torques, strict=True):
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


def _rounding(runs: Runs) -> Array:
    """Estimate the errors of the mean speeds due to coarse readings [rad/s], rows of SPEEDS."""
    finite = [[x[np.isfinite(x)] for x in runs[name]] for name in SPEEDS]
    driver, driven = (np.concatenate(parts) for parts in finite)
    steps = np.maximum(adc_resolution(driver, driven), _common_step(np.append(driver, driven)))
    recorded = np.array([[np.std(x) if x.size else 0.0 for x in parts] for parts in finite])
    return converter_rounding(noise_before_rounding(recorded, steps[:, None]), steps[:, None])


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


def _directions(
    labels: NDArray[np.object_], driver: Array, driven: Array, torque: Array
) -> tuple[Array, Array, list[str]]:
    """Return the signs (1 or -1) that mirror speeds and torques of backward runs, and notes.

    A torque that is negative overall was recorded about the axis of the pulleys; its sign is
    reversed too. A torque that stays positive was recorded in the direction of rotation.
    """
    backward = (driver < 0.0) & ~_turn_opposite(driver, driven)
    turns = np.where(backward, -1.0, 1.0)
    if not backward.any():
        return turns, turns, []
    mirror_torque = torque[backward].sum() < 0.0
    quantities = "speeds and of the torque" if mirror_torque else "speeds"
    named = "all runs" if backward.all() else ", ".join(labels[backward])
    note = f"the drive turns backwards in {named}: sign of the {quantities} reversed"
    return turns, turns if mirror_torque else np.ones(turns.size), [note]


def _turn_opposite(driver: Array, driven: Array) -> NDArray[np.bool_]:
    """Tell whether driven pulleys turn against the driver, impossible with an open belt."""
    return (driver * driven < 0.0) & (np.abs(driven) > STANDS * np.abs(driver))


def _pulley_ratio(
    runs: Runs, of_runs: Mapping[str, Array], series: NDArray[np.intp], rounding: Array
) -> tuple[float, float, list[str]]:
    """Return the driver-to-driven speed ratio without torque, its standard error, and notes.

    Coarse readings may be wrong by the same amount in all runs: their errors do not average out.
    """
    torque, torque_se, _ = np.abs(of_runs["torque_N_m"])
    driver, driven = (np.abs(of_runs[name][0]) for name in SPEEDS)
    largest = np.fmax.reduce(torque, initial=0.0)
    noise = np.where(torque_se > 0.0, np.fmin(2.0 * torque_se, UNSTEADY * largest), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        quotients = [a / b for a, b in zip(*(runs[name] for name in SPEEDS), strict=True)]
    ratios, scatter, n_eff = pooled_means(quotients, series)
    idle = (torque <= np.fmax(NO_LOAD_SHARE * largest, noise)) & (n_eff > 0.0)
    idle &= np.isfinite(scatter)
    if not idle.any():
        fastest = np.fmax.reduce(driver, initial=0.0)
        unequal = (
            f"radii that differ by 0.1 % would be {1e-3 * fastest:.2g} rad/s of the loss at "
            f"{fastest:.3g} rad/s"
        )
        return 1.0, 0.0, [f"no run without torque: the pulleys are taken as equal; {unequal}"]
    ratios, scatter = ratios[idle], scatter[idle]
    coarse = np.hypot(rounding[0, idle], ratios * rounding[1, idle]) / driven[idle]
    weights = 1.0 / np.maximum(scatter**2 + coarse**2, 1e-30)
    weights /= weights.sum()
    ratio = float(weights @ ratios)
    se = math.hypot(np.linalg.norm(weights * scatter), float(weights @ coarse))
    notes = [f"ratio of the pulleys {ratio:.6g} ± {se:.1g}, from the runs without torque"]
    return ratio, se, notes if abs(ratio - 1.0) > SIGNIFICANT * se else []


def speed_series(speed_rad_s: Array) -> NDArray[np.intp]:
    """Number the series of runs by speed [rad/s]; one of all runs if any speed has too few."""
    series = settings_of(np.abs(speed_rad_s), SERIES_WIDTH)
    one = not np.isfinite(speed_rad_s).all() or np.bincount(series).min() < FEWEST_RUNS
    return np.zeros_like(series) if one else series


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
    ndarray, shape (3, R)
        Means, standard errors and numbers of independent samples. The standard error is
        ``t sqrt(s² tau / n)`` with the pooled variance s² and correlation time tau [samples];
        Student's t for the degrees of freedom of s² widens it to a probability of 68 %. nan if the
        noise cannot be determined.
    """
    pooled = np.empty((3, series.size))
    for number in np.unique(series):
        rows = np.flatnonzero(series == number)
        pooled[:, rows] = _means_of_series([samples[k] for k in rows.tolist()])
    return pooled


def _means_of_series(recorded: Sequence[Array]) -> Array:
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
    return np.array([mean, se, n / tau])


def _without_spikes(runs: Sequence[Array]) -> list[Array]:
    """Replace spikes by nan; a spike exceeds the noise of its run and of all runs."""
    steps = np.concatenate([np.diff(r[np.isfinite(r)]) for r in runs])
    common = mad_sigma(np.concatenate([steps, -steps])) / np.sqrt(2.0) if steps.size else 0.0
    return [np.where(outlier_mask(r, common), np.nan, r) for r in runs]

"""Sliding speeds in service from the angular-speed loss of a two-pulley drive, Eq. (7).

The driven pulley of a loaded drive falls behind the driver: ``omega_loss = driver - ratio driven``,
by creep, proportional to the torque, until the belt slips grossly. The largest loss without gross
slip gives the largest sliding speed ``v = omega_loss R`` that the friction rig has to cover.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.arrays import Array, Columns, Mask
from beltid.errors import InputError
from beltid.identify.estimators import (
    integrated_autocorrelation_time,
    mad_sigma,
    outlier_mask,
    resolution,
    rounding_of_mean,
    settings_of,
    snap_to_settings,
)
from beltid.laws.capstan import sliding_speed

Runs = dict[str, list[Array]]  # samples of each run by column

DRIVER, DRIVEN, TORQUE = "driver_speed_rad_s", "driven_speed_rad_s", "torque_N_m"
COLUMNS = ("initial_tension_N", TORQUE, DRIVER, DRIVEN)

SIGNIFICANT = 4.0  # standard errors beyond which a loss or a ratio is significant
CREEP_SHARE, FEWEST_RUNS = 0.5, 3
"""Runs up to this share of a series' largest torque define its creep, at least so many."""
GROSS_OVER_CREEP, GROSS_SLIP_RATIO = 2.0, 0.05  # loss over the creep or the speed: gross slip
SAME_SETTING = 0.02  # relative gap in speed or tension that separates two series
SMALLEST_SHARE = 0.01  # sliding speeds below this share of the largest need no separate runs
PROPOSED = 5  # number of pulley speeds to propose
SPEED_TOLERANCE = 0.02  # a pulley speed this near still reaches the end of the range
GAINS = (
    "the driven pulley gains on the driver: it drives, or the columns of driver and driven speed "
    "are swapped"
)
BACKWARDS = "the drive turns backwards: give its speeds a factor of -1 under units.speedloss"
MIN_SAMPLES = 3  # minimum number of usable samples of a run
NO_LOAD_SHARE, MOST_NOISE = 0.01, 0.2  # torque over the largest that is zero; within its noise
AT_SPEED = 0.98  # share of its speed above which a driver has reached it
STANDS = 0.05  # speed of the driven pulley over the driver's below which its direction is unknown
OK, GROSS_SLIP = "ok", "gross slip"


@dataclass(frozen=True, slots=True, eq=False)
class SlipResult:
    """All operating points of a speed-loss recording."""

    columns: Columns
    """Those of the slip table, a row per run in the order of the recording; nan where unknown."""
    ratio: float  # driver speed over driven speed without torque; 1 if unknown
    ratio_se: float  # standard uncertainty; 0 without a torque-free run
    max_slip_speed_m_s: float  # largest sliding speed in service without gross slip
    max_slip_run: str  # run with this sliding speed
    notes: tuple[str, ...]  # for the user


def gross_slip(
    speed: Array, tension: Array, torque: Array, loss: Array, se: Array, usable: Mask
) -> Mask:
    """Mark usable runs with gross slip; arrays with one entry per run, nan where unknown.

    The creep [rad/s per N m] of a driver speed and tension is the median loss per torque of the
    less loaded runs, at least three.
    """
    # all unknown values form one setting
    settings = np.nan_to_num([snap_to_settings(x, SAME_SETTING) for x in (speed, tension)], nan=-1)
    _, series = np.unique(settings, axis=1, return_inverse=True)
    gross = loss > GROSS_SLIP_RATIO * speed
    for rows in (series == k for k in range(int(series.max()) + 1)):
        good = rows & usable & np.isfinite(torque)
        largest = float(np.max(torque[good], initial=0.0))
        loaded = np.flatnonzero(good & (torque > 0.05 * largest))
        loaded = loaded[np.argsort(torque[loaded], kind="stable")]
        low = loaded[: max(np.count_nonzero(torque[loaded] <= CREEP_SHARE * largest), FEWEST_RUNS)]
        if low.size >= FEWEST_RUNS and (creep := np.median(loss[low] / torque[low])) > 0.0:
            gross |= rows & (loss > GROSS_OVER_CREEP * creep * torque + SIGNIFICANT * se)
    return usable & gross


def required_pulley_speeds(
    slip: SlipResult, R: float, configured: Sequence[float] | None = None
) -> tuple[tuple[float, ...], bool | None, str]:
    """Find the pulley speeds ``omega = v / R`` of the friction rig that cover sliding in service.

    R [m] is the radius of the belt's centreline on the rig's pulley, `configured` the speeds that
    are set there [rad/s]. Returns speeds to propose, geometric steps over the significant sliding
    speeds, whether the rig's reach both ends, and both in words. Raises `InputError` if no sliding
    speed differs significantly from zero.
    """
    speeds, se = np.abs(slip.columns["slip_speed_m_s"]), slip.columns["slip_speed_se_m_s"]
    speeds = speeds[(slip.columns["status"] == OK) & (speeds > SIGNIFICANT * se)]
    if not speeds.size:
        raise InputError("no run has a speed loss that differs significantly from zero")
    high = float(speeds.max()) / R
    low = max(float(speeds.min()) / R, SMALLEST_SHARE * high)
    statement = f"sliding in service needs pulley speeds from {low:.3g} to {high:.3g} rad/s"
    proposed = tuple(np.geomspace(low, high, PROPOSED).tolist() if low < high else [high])
    if not configured:
        return proposed, None, statement
    covered = (
        min(configured) <= (1.0 + SPEED_TOLERANCE) * low
        and max(configured) >= (1.0 - SPEED_TOLERANCE) * high
    )
    listed = ", ".join(f"{w:g}" for w in configured)
    statement += f"; the rig runs at {listed} rad/s: {'' if covered else 'not '}covered"
    return proposed, covered, statement


def fit_slip(speedloss: Mapping[str, NDArray], pulley_radius_m: float) -> SlipResult:
    """Calculate the sliding speed of each run of a speed-loss recording, Eq. (7); drop no run.

    The columns ``run``, ``initial_tension_N``, ``torque_N_m``, ``driver_speed_rad_s`` and
    ``driven_speed_rad_s``, (n,) with n >= 1, are nan where missing; the radius [m] is that of the
    belt's centreline on the driver pulley. Raises `InputError` if no point can be used.
    """
    named = np.asarray(speedloss["run"]).astype(str)
    labels = np.array(list(dict.fromkeys(named.tolist())), dtype=object)
    columns = {name: np.asarray(speedloss[name], dtype=float) for name in COLUMNS}
    runs = {name: [x[named == run] for run in labels] for name, x in columns.items()}
    notes = _cut_to_speed(labels, runs)
    one = np.zeros(labels.size, dtype=np.intp)
    speed, _, speed_noise = pooled_means(runs[DRIVER], one)
    # the runs of one speed have the same noise, all runs if any speed has too few
    series = settings_of(np.abs(speed), SAME_SETTING)
    if not np.isfinite(speed).all() or np.bincount(series).min() < FEWEST_RUNS:
        series = one
    (tension, *_), (torque, torque_se, _), (driven, _, driven_noise) = (
        pooled_means(runs[name], series) for name in ("initial_tension_N", TORQUE, DRIVEN)
    )
    # without torque: below a share of the largest, or within its noise
    size, most = np.abs(torque), np.fmax.reduce(np.abs(torque), initial=0.0)
    no_load = np.fmax(NO_LOAD_SHARE * most, np.fmin(2.0 * torque_se, MOST_NOISE * most))
    idle = (size <= no_load) & np.isfinite(speed) & (np.abs(driven) > 0.0)
    # least squares: speed = ratio driven
    shares = driven[idle] / np.sum(driven[idle] ** 2)
    ratio = float(shares @ speed[idle]) if idle.any() else 1.0
    losses = [a - ratio * b for a, b in zip(runs[DRIVER], runs[DRIVEN], strict=True)]
    loss, se, _ = pooled_means(losses, series)
    step = resolution(*(np.concatenate(runs[name]) for name in (DRIVER, DRIVEN)))
    of_driver, of_driven = (rounding_of_mean(x, step) for x in (speed_noise, driven_noise))
    coarse = np.hypot(of_driver, ratio * of_driven)
    # errors of rounding may be equal in all runs
    by_rounding = float(np.abs(shares) @ coarse[idle])
    ratio_se = math.hypot(float(np.linalg.norm(shares * se[idle])), by_rounding)
    se = np.sqrt(se**2 + coarse**2 + (ratio_se * driven) ** 2)
    of_ratio = list[str]()
    if not idle.any():
        of_ratio.append(
            "no run without torque: the pulleys are taken as equal; radii that differ by 0.1 % "
            f"would be {1e-3 * np.fmax.reduce(np.abs(speed)):.2g} rad/s of the loss"
        )
    elif abs(ratio - 1.0) > SIGNIFICANT * ratio_se:
        of_ratio.append(
            f"ratio of the pulleys {ratio:.6g} ± {ratio_se:.1g}, from the runs without torque"
        )
    n = np.array([np.isfinite(x).sum() for x in losses])
    reasons = {  # the first one that holds is stated
        f"fewer than {MIN_SAMPLES} usable samples": n < MIN_SAMPLES,
        "the driver does not turn": speed == 0.0,
        "the pulleys turn in opposite ways": driven * np.sign(speed) < -STANDS * np.abs(speed),
        BACKWARDS: speed < 0.0,
        GAINS: loss < -SIGNIFICANT * se,
    }
    status = np.select([*reasons.values()], [*reasons], OK).astype(object)
    status[gross_slip(speed, tension, np.abs(torque), loss, se, status == OK)] = GROSS_SLIP
    service = status == OK
    if not service.any() or (np.any(status == GAINS) and not np.any(loss[service] > se[service])):
        why = zip(labels[~service], status[~service], strict=True)
        raise InputError([*(f"run {label}: {text}" for label, text in why), *of_ratio])
    notes += [
        f"{text}: {', '.join(labels[status == text])}; ignored for the largest sliding speed"
        for text in dict.fromkeys(status[~service])
    ]
    v, v_se = sliding_speed(loss, pulley_radius_m), sliding_speed(se, pulley_radius_m)
    largest = int(np.argmax(np.where(service, v, -np.inf)))
    return SlipResult(
        columns={
            "run": labels,
            DRIVER: speed,
            "initial_tension_N": tension,
            TORQUE: torque,
            "speed_loss_rad_s": loss,
            "slip_speed_m_s": v,
            "slip_speed_se_m_s": v_se,
            "n_samples": n,
            "status": status,
        },
        ratio=ratio,
        ratio_se=ratio_se,
        max_slip_speed_m_s=abs(float(v[largest])),
        max_slip_run=labels[largest],
        notes=(*notes, *of_ratio),
    )


def _cut_to_speed(labels: NDArray[np.object_], runs: Runs) -> list[str]:
    """Cut off the samples before the driver reaches its speed and after it stops; note the runs."""
    shortened = []
    for k in (k for k, speed in enumerate(runs[DRIVER]) if np.isfinite(speed).any()):
        speed = np.abs(runs[DRIVER][k])
        # robust to spikes; a quarter of the samples at speed is enough
        turning = speed[speed >= 0.5 * np.nanquantile(speed, 0.75, method="lower")]
        at_speed = np.flatnonzero(speed >= AT_SPEED * np.median(turning))
        for values in runs.values():
            values[k] = values[k][at_speed[0] : at_speed[-1] + 1]
        if np.isfinite(runs[DRIVER][k]).sum() < np.isfinite(speed).sum():
            shortened.append(labels[k])
    named = ", ".join(shortened)
    return [f"samples before the driver is up to its speed left out: {named}"] if named else []


def pooled_means(samples: Sequence[Array], series: NDArray[np.intp]) -> Array:
    """Average each run of evenly spaced samples (n,), nan where missing, without its spikes.

    Runs of a series (R,) have equal noise: its variance s² and correlation time tau [samples] give
    the standard errors ``s sqrt(tau / n)``. Returns means, their errors and the standard deviations
    of the samples (3, R), nan if unknown.
    """
    steps = np.concatenate([np.diff(r[np.isfinite(r)]) for r in samples])
    noise = mad_sigma(steps) / math.sqrt(2.0) if steps.size else 0.0
    runs = [np.where(outlier_mask(r, noise), np.nan, r) for r in samples]
    n = np.array([np.count_nonzero(np.isfinite(r)) for r in runs], dtype=float)
    mean = np.array([np.nanmean(r) if k else np.nan for r, k in zip(runs, n, strict=True)])
    squares = np.array([np.nansum((r - m) ** 2) for r, m in zip(runs, mean, strict=True)])
    se = np.full(n.size, np.nan)
    for number in np.unique(series):
        rows = np.flatnonzero((series == number) & (n > 0.0))
        tau = np.minimum(integrated_autocorrelation_time(*(runs[k] for k in rows)), n[rows])
        freedom = np.sum(n[rows] / tau - 1.0)
        if freedom > 0.0:
            se[rows] = np.sqrt(np.sum(squares[rows] / tau) / freedom * tau / n[rows])
    return np.array([mean, se, np.sqrt(squares / np.fmax(n, 1.0))])

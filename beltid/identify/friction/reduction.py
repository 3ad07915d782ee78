"""Reduce the runs of the friction rig from tensions over time to one friction coefficient each.

Each run is prepared alone (:mod:`prepare`), then all runs are reduced together
(:mod:`bench_model`), measured and simulated ones alike. A run that cannot be reduced is marked with
the reason, never dropped. The sticking peak is not the largest, noisiest sample, but the largest
value of the model of the sliding from where the record joins it onwards.

Rows of a table, plateaus without rest and build-up, give one coefficient each by Eq. (6). The
resolution r of the force replaces the scatter: ``r / sqrt(12)`` of a uniform distribution.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beltid.arrays import Array, Columns
from beltid.errors import InputError
from beltid.identify.estimators import mad_sigma, median
from beltid.identify.friction.bench_model import Bench, cell_errors, fit_bench
from beltid.identify.friction.prepare import Rest, SlidingRecord, prepare_run
from beltid.identify.friction.run import (
    CELLS,
    MAX_MU,
    NAN,
    NUMBERS,
    TEXTS,
    TWO_CELLS,
    RigKind,
    RunRecord,
    RunReduction,
    RunRejected,
    reject,
    run_records,
)
from beltid.laws.capstan import friction_coefficient, sliding_speed

STATED = ("mu", "normal_force_N_m")
"""Columns of a table of plateaus that states coefficient and normal force directly."""
SPEEDS = ("pulley_speed_rad_s", "slip_speed_m_s")
OF_ROW = (*STATED, *SPEEDS, "temperature_degC")


def reduce_plateaus(
    columns: Mapping[str, NDArray[Any]], R: float, kind: RigKind, resolution_N: float = NAN
) -> tuple[RunReduction, ...]:
    """Reduce a table with one row per plateau: each row is a run of one sample, (n,).

    The columns, nan or None where a value is missing, hold mu and normal_force_N_m, or arc_deg and
    the channels of the kind; and pulley_speed_rad_s or slip_speed_m_s. The torque of idle rows is
    subtracted from the others. R [m] is the radius of the belt's centreline on the pulley,
    `resolution_N` that of the forces [N], nan if not stated. Raises `InputError` with the columns
    that are missing.
    """
    n = len(columns["run"])
    table: Columns = {
        name: np.asarray(columns.get(name, np.full(n, NAN)), float)
        for name in (*NUMBERS, *STATED, *SPEEDS, "mu_se")
    }
    given = {name for name, values in table.items() if np.isfinite(values).any()}
    if given.isdisjoint(SPEEDS):
        raise InputError("column pulley_speed_rad_s or slip_speed_m_s is missing")
    direct = given.issuperset(STATED)
    if not direct and "arc_deg" not in given:
        raise InputError("column arc_deg is missing")
    if not kind.running:
        omega, slip = (table[name] for name in SPEEDS)
        table["pulley_speed_rad_s"] = np.where(np.isfinite(omega), omega, slip / R)
    names = [str(name) for name in columns["run"]]
    if len(set(names)) < n:
        names = [f"{name}-{row}" for row, name in enumerate(names, 1)]
    table |= {name: columns[name] for name in ("idle", *TEXTS) if name in columns}
    table["run"] = np.arange(n).astype(str)
    if direct:  # the tensions do not count
        kind = replace(TWO_CELLS, running=kind.running, mass_per_length_kg_m=NAN)
        table |= dict.fromkeys(CELLS, np.ones(n))
    records = run_records(table, R, kind)
    rows = [int(record.result.run) for record in records]
    ses = table["mu_se"][rows]
    if not direct and np.isfinite(resolution_N):
        ses = np.where(np.isfinite(ses), ses, _se_by_resolution(table, R, kind, resolution_N))
    for record, row, se in zip(records, rows, ses.tolist(), strict=True):
        run = record.result
        mu, N, speed, v, temperature = (float(table[name][row]) for name in OF_ROW)
        run.run, run.n_samples, run.temperature_degC = names[row], 1, temperature
        run.initial_tension_N, run.mu_sticking_reason = run.nominal_tension_N, ""
        run.pulley_speed_rad_s = abs(speed)
        run.slip_speed_m_s = abs(sliding_speed(float(record.speed[0]), R) if np.isnan(v) else v)
        if direct:
            run.mu_sliding, run.normal_force_N_m = mu, N
        else:
            run.set_plateau(record.tensions[0, 0], record.tensions[0, 1], R)
        run.mu_sliding_se = se
        run.status = _problem(run, record.kind, direct) or "ok"
    return tuple(record.result for record in records)


def _se_by_resolution(
    table: Mapping[str, NDArray[Any]], R: float, kind: RigKind, resolution_N: float
) -> Array:
    """Return the standard error of mu from the resolution of the forces, (n,)."""
    half, changes = 0.5 * resolution_N / np.sqrt(12.0), []
    for name in CELLS:  # the stated resolution applies to forces only
        low, high = (
            [
                friction_coefficient(
                    r.tensions[0, 0], r.tensions[0, 1], np.radians(r.result.arc_deg)
                )
                for r in run_records({**table, name: table[name] + shift}, R, kind)
            ]
            for shift in (-half, half)
        )
        changes.append(np.subtract(high, low))
    return np.asarray(np.linalg.norm(changes, axis=0))


def _problem(run: RunReduction, kind: RigKind, direct: bool) -> str:
    """Return why a plateau cannot be used; empty if it can."""
    tensions = {"tight": run.tension_tight_N, "slack": run.tension_slack_N}
    if not direct:
        if not 0.0 < run.arc_deg <= 3600.0:
            return f"arc_deg = {run.arc_deg:g}, must be in (0, 3600]"
        if kind.measures == "torque_hub" and np.isnan([*tensions.values()]).any():
            return (
                f"torque_N_m and hub_force_N give no tensions at {run.arc_deg:g} deg: the force "
                "on the axis must be larger than |torque/R cos(arc/2)|, and at a whole turn it "
                "does not depend on the sum of the tensions"
            )
        if tensions["tight"] < tensions["slack"] and kind.reversed:
            return kind.reversed
        for name, tension in tensions.items():
            if not tension > 0.0:
                found = "0 or missing" if np.isnan(tension) else f"{tension:g}"
                return f"tension_{name}_N = {found}, must be > 0"
    if not 0.0 < run.mu_sliding <= MAX_MU:
        return f"mu_sliding = {run.mu_sliding:.4g}, must be in (0, {MAX_MU:g}]"
    for name in ("normal_force_N_m", "slip_speed_m_s"):
        if not getattr(run, name) > 0.0:
            return f"{name} = {getattr(run, name):g}, must be > 0"
    return ""


STEADY = 0.005  # remaining change of the tail, relative to mu, at which the plateau begins
MAX_ERROR = 0.05  # largest relative standard error of mu_sliding of an accepted run
MAX_DRIFT = 0.1  # largest relative drift of mu over the sliding phase
MAX_TAIL = 0.025  # largest tail left at the end of a record: beyond, it would be extrapolated
MAX_WAVE = 0.03  # largest wave once per turn in a record of less than half a turn
MAX_MISFIT = 4.0  # largest noise about the model of the bench, over that of the other runs
MAX_PEAK_ERROR = 0.02  # largest relative standard error of mu_sticking of a resolved peak
JOINED = 3.0  # largest distance of a sample on the model, in standard deviations of the noise
TAIL_NOTED = 1e-3  # tail left, and standard error, relative to mu, above which a note mentions them
STANDS_OUT = 3.0  # smallest height of a peak above the plateau, in standard errors of the peak
AGREE, LARGE = 0.7, 0.1
"""Relative scatter of the levels of tension up to which they agree; share of the lowest stated
tension, or of the factor 1, above which the readings contradict the stated tensions."""
FEWEST_FOR_MISFIT = 5  # runs of a bench with which one can be rejected as unlike the others


def reduce_records(
    records: Iterable[RunRecord], R: float, gain_rel: float = 2e-3, free_at_rest: bool = False
) -> tuple[RunReduction, ...]:
    """Reduce the runs of a bench together, to one result for every run, in their order.

    R [m] is the radius of the belt's centreline on the pulley, `gain_rel` the stated relative
    standard uncertainty of the gain of a load cell. A belt that is `free_at_rest` holds no friction
    then, so that the rest shows the gains, too. Raises `InputError` if the tensions at rest do not
    match the stated ones, see :func:`against_stated`.
    """
    prepared = [prepare_run(record, R) for record in records]
    if sliding := [(run, record) for run, record in prepared if record is not None]:
        _reduce_together(sliding, R, gain_rel, free_at_rest)
    # include rejected runs: with an untared cell, those of low tension are rejected; not those of
    # a running belt, whose tension may be stated with its momentum
    still = [run for run, _ in prepared if np.isnan(run.momentum_N)]
    tensions = np.array([(run.initial_tension_N, run.nominal_tension_N) for run in still])
    if problem := against_stated(*tensions.reshape(-1, 2).T):
        raise InputError(problem)
    return tuple(run for run, _ in prepared)


def against_stated(measured_N: Array, stated_N: Array) -> str:
    """Describe a mismatch of mean tensions at rest and stated initial tensions (n,) [N], or "".

    Each level of tension has an offset and a factor, medians over its runs; the median level counts
    if the levels agree on it, so that a few wrongly set ones do not matter. Fewer than four runs,
    or a single tension, allow no check.
    """
    usable = np.isfinite(measured_N) & (stated_N > 0.0)
    measured, stated = measured_N[usable], stated_N[usable]
    levels = np.unique(stated)
    if stated.size < 4 or np.ptp(levels) < 0.1 * levels[-1]:
        return ""
    found = np.array([measured - stated, measured / stated - 1.0])
    of_levels = np.array([[median(x[stated == level]) for level in levels] for x in found])
    offset_N, excess = np.median(of_levels, axis=1)
    apart = [mad_sigma(x) / max(abs(np.median(x)), 1e-300) for x in of_levels]
    is_large, size = abs(excess) > LARGE, f"{1.0 + excess:.4g} times"
    if apart[0] < apart[1]:
        is_large, size = abs(offset_N) > LARGE * levels[0], f"{offset_N:+.3g} N off"
    if not is_large or min(apart) > AGREE:
        return ""
    return (
        f"the tensions at rest are {size} the stated initial tensions at {levels.size} levels of "
        "tension: were the cells tared (friction.tension_tight_tare_N, tension_slack_tare_N), is "
        "their unit right (units.rig), their gain (friction.tension_tight_gain, "
        "tension_slack_gain), and is initial_tension_N?"
    )


def _reduce_together(
    sliding: Sequence[tuple[RunReduction, SlidingRecord]],
    R: float,
    gain_rel: float,
    free_at_rest: bool,
) -> None:
    """Reduce all sliding runs of a bench together."""
    runs, records = zip(*sliding, strict=True)
    bench = fit_bench(records)
    # of the tension, from the mean over the rest to its end
    relaxed = float(np.median([r.rest.end_N / r.rest.tension_N for r in records]))
    level, drift = bench.mean, bench.visible_drift
    own = bench.variance + np.square([record.rounding for record in records])
    waves = np.abs(bench.effect("turn")).max(axis=1) / level
    errors, variance, common = cell_errors(
        runs, records, level, np.sqrt(own), gain_rel, free_at_rest
    )
    shared = np.column_stack([bench.shared, common])
    y_ses = np.sqrt(own + variance + np.sum(shared**2, axis=1))
    for k, (run, record) in enumerate(sliding):
        y = float(level[k] - errors[k])
        run.initial_tension_N = record.rest.tension_N * relaxed
        run.converged, run.drift = bench.posterior.converged, float(drift[k]) / y
        run.shared_tail, run.shared_drift, run.shared_cells = (shared[k] / y).tolist()
        try:
            mu = y / float(np.radians(run.arc_deg))
            reject(not 0.0 < mu <= MAX_MU, f"mu_sliding = {mu:.4g}, must be in (0, {MAX_MU:g}]")
            _set_plateau(run, record, bench.tail(k, record.travel), y, float(y_ses[k]), R)
            reject(
                waves[k] > MAX_WAVE and record.travel[-1] < np.pi * R,
                f"drifts, or goes with the turn of the pulley: mu is {100 * waves[k]:.2g} % off "
                f"its mean in less than half a turn, allowed is {100 * MAX_WAVE:g} %; "
                "slide a whole turn",
            )
            _check_fit(run, record, bench, k)
            run.status = "ok"
            run.mu_sticking_reason = _set_peak(run, record, bench, k, y)
        except RunRejected as reason:
            run.status = str(reason)


def _set_plateau(
    run: RunReduction, record: SlidingRecord, tail: Array, y: float, y_se: float, R: float
) -> None:
    """Determine the plateau and its tensions; `y` is its ln(T_tight/T_slack)."""
    unsettled = np.flatnonzero(np.abs(tail - tail[-1]) > STEADY * abs(y))
    start = int(unsettled[-1]) + 1 if unsettled.size else 0
    count, temperature = record.count[start:], record.temperature[start:]
    if record.weight is None:
        # of the geometric mean of both tensions, without the tail
        x = record.count * (tail - np.average(tail, weights=record.count))
        prior = (0.5 * record.noise_N * record.sensitivity / 0.3) ** 2
        factor = (x @ record.log_mean - 0.5 * prior * np.tanh(0.5 * y)) / (x @ tail + prior)
        mean = np.average(record.log_mean[start:] - factor * tail[start:], weights=count)
        tight, slack = np.exp(mean + 0.5 * y), np.exp(mean - 0.5 * y)
    else:
        tight = run.initial_tension_N * np.exp(y * (record.weight == "slack"))
        slack = tight * np.exp(-y)
    run.set_plateau(tight, slack, R)
    run.mu_sliding_se = y_se / float(np.radians(run.arc_deg))
    if (known := np.isfinite(temperature)).any():
        run.temperature_degC = float(np.average(temperature[known], weights=count[known]))
    run.n_samples = int(count.sum())
    run.plateau_start_s = float(record.first_s[start])
    run.notes += tuple(_notes(run, record.rest, float(tail[-1]) / y, y_se / y))


def _notes(run: RunReduction, rest: Rest, tail: float, error: float) -> Iterator[str]:
    """Yield notes on the remaining tail, on a drift and on a rest that is too short."""
    if abs(tail) > TAIL_NOTED:
        yield (
            f"mu is still {100 * tail:+.2g} % off its plateau at the end of the record: the tail "
            "of the sticking peak is subtracted"
        )
    if abs(run.drift) > STEADY:
        yield f"mu drifts by {100 * run.drift:+.2g} % over the sliding phase"
    if error > TAIL_NOTED and abs(run.shared_drift) > 0.7 * error:
        # the error of the slope of a cell at rest falls with the length of the rest ** 1.5
        rest_s = rest.last_s - rest.first_s
        yield (
            f"an error of {100 * abs(run.shared_drift):.2g} % is due to a drift of the cells "
            f"that the rest phase cannot exclude: {3.0 * rest_s:.2g} s at rest instead of "
            f"{rest_s:.2g} s would reduce it to a fifth"
        )


def _check_fit(run: RunReduction, record: SlidingRecord, bench: Bench, k: int) -> None:
    """Reject a run that does not fit the bench, drifts or never settles."""
    y, misfit = float(bench.posterior.level[k]), float(np.sqrt(bench.scale[k]))
    # in a nearly noise-free record, a misfit of many times the noise is still harmless
    is_large = misfit > MAX_MISFIT and misfit * record.noise_N * record.sensitivity > STEADY * y
    left = abs(float(bench.tail(k, record.travel[-1:])[0])) / y
    # errors of the cells do not count here: they do not depend on settling
    error = math.hypot(math.sqrt(bench.variance[k]) / y, run.shared_tail, run.shared_drift)
    reject(
        bench.scale.size >= FEWEST_FOR_MISFIT and is_large,
        f"does not fit the bench: its record is off the common model by {misfit:.2g} "
        f"times the noise of the other runs, allowed is {MAX_MISFIT:g} times",
    )
    reject(
        abs(run.drift) > MAX_DRIFT,
        f"drifts: mu changes by {100 * run.drift:+.2g} % over the sliding phase, "
        f"allowed is {100 * MAX_DRIFT:g} %",
    )
    reject(
        left > MAX_TAIL,
        f"never settles: the tail of the sticking peak is still {100 * left:.2g} % of mu at "
        f"the end of the record, allowed is {100 * MAX_TAIL:g} %",
    )
    reject(
        error > MAX_ERROR,
        f"never settles: the standard error of its level is {100 * error:.2g} %, "
        f"allowed is {100 * MAX_ERROR:g} %",
    )


def _set_peak(run: RunReduction, record: SlidingRecord, bench: Bench, k: int, y: float) -> str:
    """Set the sticking peak from the model of the sliding, or return why there is none."""
    level = float(bench.posterior.level[k])
    first = record.first_s[0], record.travel[0], record.z[0]
    t, travel, z = np.column_stack([record.onset, first])
    # extrapolate back to the end of the build-up, not beyond
    model, _ = bench.course(k, np.maximum(travel, 0.0))
    limit = JOINED * record.noise_N * record.sensitivity + record.ripple_N / record.tensions_N[0]
    off_model = np.flatnonzero(~(np.abs(z[:-1] - model[:-1]) <= limit))
    join = int(off_model[-1]) + 1 if off_model.size else 0
    if join > 0 and z[join - 1] > model[join - 1]:
        return "the tensions decay faster than the tail of the peak"
    before = max(join - 1, 0)
    last_off, first_on = (max(float(travel[i]), 0.0) for i in (before, join))
    # noise may hide the end of the build-up in the tail, which makes the time more uncertain
    rise = max(float(model[join] - np.nanmin(z)), limit)
    width = math.hypot(first_on - last_off, float(travel[join] - travel[0]) * limit / rise)
    tail = bench.tail(k, first_on + np.array([0.0, 0.1 * width]))
    timing = 10.0 * abs(float(tail[0] - tail[1])) / math.sqrt(12.0)
    after, errors = bench.course(k, np.append(0.5 * (last_off + first_on), record.travel))
    largest = int(np.argmax(after))
    times = np.append(0.5 * (t[before] + t[join]), record.middle_s)
    run.peak_time_s, peak = float(times[largest]), float(after[largest])
    se = float(np.linalg.norm([errors[largest], timing, record.rounding]))
    if se > min((peak - level) / STANDS_OUT, MAX_PEAK_ERROR * peak):
        return "no peak stands out from the plateau"
    beta = float(np.radians(run.arc_deg))
    run.mu_sticking, run.mu_sticking_se = (peak + y - level) / beta, se / beta
    return ""

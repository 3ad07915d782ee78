"""Reduce the runs of the friction rig: tensions over time to one friction coefficient per run.

Two passes: every run is prepared by itself (:mod:`prepare`), then all are reduced together
(:mod:`campaign`), each once. The same functions serve the bench and the simulated rig; nothing in
them depends on which one wrote the recording. A run that cannot be reduced is set aside with its
reason, never dropped.

The sticking peak is no largest sample: of many noisy samples near a flat maximum that is the
noisiest. The model of the sliding is followed back to the moment at which the record leaves the
build-up and joins it; that moment is known to one sample.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import InputError
from beltid.identify.estimators.statistics import interval_sd
from beltid.identify.friction.campaign import BATCH, RunLevel, reduce_bench
from beltid.identify.friction.kinds import TWO_CELLS, RigKind
from beltid.identify.friction.prepare import PreparedRun, SlidingRecord, prepare_run
from beltid.identify.friction.rest import CellErrors, Rest, against_stated, cell_errors
from beltid.identify.friction.run import (
    NAN,
    FrictionSettings,
    RunRecord,
    RunReduction,
    run_records,
)
from beltid.identify.friction.shared import Shared, tail_basis
from beltid.laws.capstan import friction_coefficient, mean_normal_force

Array = NDArray[np.float64]


STEADY = 0.005
"""Change of the tail, relative to mu, with which the plateau has begun."""
MAX_ERROR = 0.05
"""Largest standard error of mu_sliding, relative to it, that a run may have."""
MAX_DRIFT = 0.1
"""Largest drift of mu over the sliding phase, relative to it."""
MAX_MISFIT = 4.0
"""Largest noise about the model of the bench over that of the other runs."""
MAX_PEAK_ERROR = 0.015
"""Largest standard error of mu_sticking, relative to it, with which a peak is resolved."""
JOINED = 3.0
"""Distance from the model, in standard deviations of the noise, within which a sample is on it."""
TAIL_NOTED = 1e-3
"""Tail left at the end of a record, and standard error, over mu, from which on a run tells it."""
STANDS_OUT = 3.0
"""Least height of a peak above the plateau, in standard errors of the peak."""


__all__ = [
    "FrictionSettings",
    "RunRecord",
    "RunReduction",
    "reduce_runs",
    "reduce_stream",
]

Mapper = Callable[[Callable[[Any], Any], Iterable[Any]], Iterator[Any]]
"""Applies a function to items, in their order, maybe in other processes."""

FEWEST_FOR_MISFIT = 5
"""Runs of a bench from which on one of them can be unlike the others."""


def reduce_runs(
    columns: Mapping[str, ArrayLike],
    pulley_radius_m: float,
    settings: FrictionSettings | None = None,
    kind: RigKind = TWO_CELLS,
) -> tuple[RunReduction, ...]:
    """Reduce all runs of a recording of the friction rig.

    Parameters
    ----------
    columns : mapping of str to array_like
        The columns of rig.csv: run, time_s [s], tension_tight_N, tension_slack_N [N] or what
        another kind needs in their place, pulley_speed_rad_s [rad/s], arc_deg [deg], and
        optionally temperature_degC [°C], initial_tension_N (nominal) [N] and conditions, shape
        (n,) each. Rows of a run need not be together.
    pulley_radius_m : float
        Radius of the belt's centreline on the pulley [m].
    settings : FrictionSettings, optional
        Settings of the reduction.
    kind : RigKind
        What the rig measures.

    Returns
    -------
    tuple of RunReduction
        One for every run, in the order in which they first appear; runs of the idle pulley are
        none.

    Raises
    ------
    InputError
        If a column is missing, has another length or is not numeric, if there are no samples, or
        if the radius is not positive.
    """
    _check_radius(pulley_radius_m)
    records = run_records(columns, pulley_radius_m, kind)
    return reduce_stream(records, pulley_radius_m, settings or FrictionSettings())


def reduce_stream(
    records: Iterable[RunRecord], R: float, settings: FrictionSettings, mapper: Mapper = map
) -> tuple[RunReduction, ...]:
    """Reduce the runs of a bench, whatever their number; each recording is held only once.

    Parameters
    ----------
    records : iterable of RunRecord
        The runs.
    R : float
        Radius of the belt's centreline on the pulley [m], > 0.
    settings : FrictionSettings
        Settings of the reduction.
    mapper : callable
        ``map``, or one that shares the work among processes.

    Returns
    -------
    tuple of RunReduction
        One for every run, in their order; for a run whose speed is not steady, one for each bin.

    Raises
    ------
    InputError
        If the tensions at rest do not fit the stated ones, see :func:`against_stated`.
    """
    _check_radius(R)
    runs = list(mapper(partial(prepare_run, R=R, settings=settings), records))
    sliding = [k for k, run in enumerate(runs) if run.sliding is not None]
    found = [run.found for run in runs]
    if sliding:
        together = _reduce_together([runs[k] for k in sliding], R, settings)
        for k, reduced in zip(sliding, together, strict=True):
            found[k] = reduced
    found = [run for k, one in enumerate(runs) for run in one.plateaus or (found[k],)]
    if settings.check_initial_tension:
        # runs set aside count, too: a cell that was not tared sets those of low tension aside
        problem = against_stated(
            np.array([run.initial_tension_N for run in found], dtype=float),
            np.array([run.nominal_tension_N for run in found], dtype=float),
        )
        if problem:
            raise InputError(problem)
    return tuple(found)


def _check_radius(R: float) -> None:
    if not (np.isfinite(R) and R > 0.0):
        raise InputError(f"pulley_radius_m = {R!r}, must be > 0")


def _reduce_together(
    runs: Sequence[PreparedRun], R: float, settings: FrictionSettings
) -> list[RunReduction]:
    """The runs of a bench that slide."""
    records = [run.sliding for run in runs if run.sliding is not None]
    rests = [record.rest for record in records]
    initial = np.array([rest.tension_N for rest in rests])
    bench, levels = reduce_bench(records)
    cells = cell_errors(
        difference=np.array([rest.imbalance_N for rest in rests]),
        se=np.array([rest.imbalance_se_N for rest in rests]),
        tension=initial,
        sliding=np.array([record.tensions_N for record in records]),
        mode=settings.correct_imbalance,
    )
    relaxed = 1.0 + _relaxation(rests)
    shared = np.array([[level.shared_tail, level.shared_drift] for level in levels])
    shared = np.column_stack([shared, cells.shared])
    rounding = np.array([record.rounding for record in records])
    own = np.array([level.variance for level in levels]) + cells.variance + rounding**2
    y_ses = _standard_errors(bench.shared, levels, cells, rounding)
    # what is stated is the interval; its parts keep their shares
    shared *= (y_ses / np.sqrt(own + np.sum(shared**2, axis=1)))[:, None]
    reduced = []
    for k, (run, record, level) in enumerate(zip(runs, records, levels, strict=True)):
        y, y_se = level.y - float(cells.mean[k]), float(y_ses[k])
        tail, drift, zeros = (shared[k] / y).tolist()
        found = replace(
            run.found,
            initial_tension_N=float(initial[k]) * relaxed,
            notes=(*run.found.notes, *filter(None, (cells.notes[k],))),
            drift=level.drift / y,
            shared_tail=tail,
            shared_drift=drift,
            shared_cells=zeros,
        )
        mu = y / float(np.radians(found.arc_deg))
        if not 0.0 < mu <= settings.max_mu:
            reason = f"mu_sliding = {mu:.4g}, must be in (0, {settings.max_mu:g}]"
            reduced.append(replace(found, status=reason))
            continue
        found = _with_plateau(found, record, level, y, y_se, R)
        reason = _unusable(found, record, level, len(runs))
        if not reason:
            found = _with_peak(found, record, level, y, bench.shared)
        reduced.append(replace(found, status=reason or "ok"))
    return reduced


def _standard_errors(
    shared: Shared, levels: Sequence[RunLevel], cells: CellErrors, rounding: Array
) -> Array:
    """Standard errors of the levels over all hypotheses about the bench and its cells, (R,)."""
    probability = np.multiply.outer(shared.hypotheses.probability, cells.probability).ravel()
    found = []
    for k in range(0, len(levels), BATCH):
        part = slice(k, k + BATCH)
        away = np.array([level.away for level in levels[part]])[:, :, None]
        spread = np.array([level.spread for level in levels[part]])[:, :, None]
        away = away - cells.away[part, None, :]
        variance = spread**2 + cells.spread[part, None, :] ** 2
        variance = variance + rounding[part, None, None] ** 2
        size = len(away), probability.size
        found.append(interval_sd(probability, away.reshape(size), np.sqrt(variance).reshape(size)))
    return np.concatenate(found)


def _relaxation(rests: Sequence[Rest]) -> float:
    """Change of the tension from the mean over the rest to its end, relative, common to all runs.

    A belt relaxes at rest; the change counts as far as it is more than its noise.
    """
    change = np.array([rest.end_N / rest.tension_N - 1.0 for rest in rests])
    error = np.array([rest.end_se_N / rest.tension_N for rest in rests])
    known = np.isfinite(error)
    if not known.any():
        return 0.0
    weight = 1.0 / np.maximum(error[known], 1e-7) ** 2
    mean = float(np.sum(weight * change[known]) / np.sum(weight))
    return mean * mean**2 / (mean**2 + 1.0 / float(np.sum(weight)))


def _with_plateau(
    found: RunReduction,
    record: SlidingRecord,
    level: RunLevel,
    y: float,
    y_se: float,
    R: float,
) -> RunReduction:
    """Tensions of the plateau, Eq. (6) of them and Eq. (8)."""
    beta = float(np.radians(found.arc_deg))
    tail = record.basis @ level.tail
    settled = np.abs(tail - tail[-1]) <= STEADY * abs(y)
    start = int(np.flatnonzero(~settled)[-1]) + 1 if not settled.all() else 0
    start = min(start, record.z.size - 1)
    count = record.count[start:]
    if record.weight is None:
        mean = _mean_level(record, tail, start, y)
        tight, slack = np.exp(mean + 0.5 * y), np.exp(mean - 0.5 * y)
    elif record.weight == "tight":
        tight, slack = found.initial_tension_N, found.initial_tension_N * np.exp(-y)
    else:
        tight, slack = found.initial_tension_N * np.exp(y), found.initial_tension_N
    warm = np.isfinite(record.temperature[start:])
    temperature = NAN
    if warm.any():
        temperature = float(np.average(record.temperature[start:][warm], weights=count[warm]))
    return replace(
        found,
        tension_tight_N=float(tight),
        tension_slack_N=float(slack),
        mu_sliding=float(friction_coefficient(tight, slack, beta)),
        mu_sliding_se=y_se / beta,
        normal_force_N_m=float(mean_normal_force(tight, slack, R)),
        temperature_degC=temperature,
        n_samples=int(count.sum()),
        plateau_start_s=float(record.first_s[start]),
        tail_time_s=_decay_time(record.travel, tail, record.first_s),
        notes=(*found.notes, *_notes(found, record.rest, float(tail[-1]) / y, y_se / y)),
    )


def _notes(found: RunReduction, rest: Rest, left: float, error: float) -> Iterator[str]:
    """What a user should know of a run: the rest of its tail, a drift, what its rest leaves open.

    `left` and `error` are what is left of the tail at the end and the standard error, over mu.
    """
    if abs(left) > TAIL_NOTED:
        yield (
            f"mu is still {100 * left:+.2g} % off its plateau at the end of the record: the tail "
            "of the sticking peak is taken off"
        )
    if abs(found.drift) > STEADY:
        yield f"mu drifts by {100 * found.drift:+.2g} % over the sliding phase"
    if error > TAIL_NOTED and abs(found.shared_drift) > 0.7 * error:
        # the slope of a cell at rest is known to its noise over the length of the rest ** 1.5
        rest_s = rest.last_s - rest.first_s
        yield (
            f"{100 * abs(found.shared_drift):.2g} % of error are a drift of the cells that the "
            f"rest leaves open: {3.0 * rest_s:.2g} s at rest in place of {rest_s:.2g} s would "
            "leave a fifth"
        )


def _mean_level(record: SlidingRecord, tail: Array, start: int, y: float) -> float:
    """Ln of the geometric mean of both tensions [N] on the plateau, without the tail.

    If the sum of both tensions stays, their mean follows the tail by -tanh(y/2)/2; how far it does
    is regressed on the record with that as the prior.
    """
    weight = record.count
    away = tail - np.average(tail, weights=weight)
    noise = 0.5 * record.noise_N * record.sensitivity
    prior = (noise / 0.3) ** 2
    follow = (weight * away) @ record.log_mean - prior * 0.5 * np.tanh(0.5 * y)
    follow /= (weight * away) @ away + prior
    level = record.log_mean[start:] - follow * tail[start:]
    return float(np.average(level, weights=weight[start:]))


def _decay_time(travel: Array, tail: Array, time_s: Array) -> float:
    """Time in which the tail falls to 1/e of its height after the start of the sliding [s]."""
    if not tail[0] > 0.0:
        return NAN
    fallen = np.flatnonzero(tail <= tail[0] / np.e)
    if not fallen.size:
        return NAN
    k = int(fallen[0])
    share = (tail[k - 1] - tail[0] / np.e) / (tail[k - 1] - tail[k])
    return float(time_s[k - 1] + share * (time_s[k] - time_s[k - 1]) - time_s[0])


def _unusable(
    found: RunReduction,
    record: SlidingRecord,
    level: RunLevel,
    n_runs: int,
) -> str:
    """Why a reduced run is set aside; empty if it is not."""
    off = level.misfit * record.noise_N * record.sensitivity / level.y
    # in a record without noise a misfit of many times its noise is nothing
    odd = level.misfit > MAX_MISFIT and off > STEADY
    if n_runs >= FEWEST_FOR_MISFIT and odd:
        return (
            f"does not fit the bench: its record is off the common model by {level.misfit:.2g} "
            f"times the noise of the other runs, allowed is {MAX_MISFIT:g} times"
        )
    if abs(found.drift) > MAX_DRIFT:
        return (
            f"drifts: mu changes by {100 * found.drift:+.2g} % over the sliding phase, "
            f"allowed is {100 * MAX_DRIFT:g} %"
        )
    # what the cells leave open is no matter of settling
    parts = [np.sqrt(level.variance), level.shared_tail, level.shared_drift]
    error = float(np.linalg.norm(parts)) / level.y
    if error > MAX_ERROR:
        return (
            f"never settles: its level is known to {100 * error:.2g} % only, "
            f"allowed is {100 * MAX_ERROR:g} %"
        )
    return ""


def _with_peak(
    found: RunReduction,
    record: SlidingRecord,
    level: RunLevel,
    y: float,
    shared: Shared,
) -> RunReduction:
    """The sticking peak from the model of the sliding, with the errors of the cells taken off."""
    t = np.append(record.onset.time_s, record.first_s[0])
    travel = np.append(record.onset.travel, record.travel[0])
    z = np.append(record.onset.z, record.z[0])
    # the tail is followed back to the end of the build-up, not beyond
    model = level.y + tail_basis(np.maximum(travel, 0.0)) @ level.tail
    ripple = record.ripple_N / record.tensions_N[0]
    limit = JOINED * record.noise_N * record.sensitivity + ripple
    off = np.flatnonzero(~(np.abs(z[:-1] - model[:-1]) <= limit))
    join = int(off[-1]) + 1 if off.size else 0
    if join > 0 and z[join - 1] > model[join - 1]:
        reason = "the tensions decay faster than the tail of the peak"
        return replace(found, mu_sticking_reason=reason)
    before = max(join - 1, 0)
    found = replace(found, peak_time_s=0.5 * float(t[before] + t[join]))
    last_up, first_on = (max(float(travel[k]), 0.0) for k in (before, join))
    peak, error = level.at(0.5 * (last_up + first_on), shared, record.level)
    # noise may hide the end of the build-up in the tail: the moment is uncertain by so much more
    climbed = max(peak - float(np.nanmin(z)), limit)
    margin = float(travel[join] - travel[0]) * limit / climbed
    step = first_on - last_up
    ahead = 0.1 * max(step, margin)
    behind = tail_basis(np.array([first_on, first_on + ahead])) @ level.tail
    rate = abs(behind[0] - behind[1]) / max(ahead, 1e-12)
    timing = rate * float(np.hypot(step, margin)) / np.sqrt(12.0)
    se = float(np.linalg.norm([error, timing, record.rounding]))
    if peak - level.y < STANDS_OUT * se:
        return replace(found, mu_sticking_reason="no peak stands out of the plateau")
    if se > MAX_PEAK_ERROR * peak:
        return replace(
            found,
            mu_sticking_reason=f"the samples leave the peak uncertain by {100 * se / peak:.2g} %, "
            f"allowed is {100 * MAX_PEAK_ERROR:g} %",
        )
    beta = float(np.radians(found.arc_deg))
    return replace(
        found,
        mu_sticking=(peak + y - level.y) / beta,
        mu_sticking_se=se / beta,
        mu_sticking_reason="",
    )

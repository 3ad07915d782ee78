"""Reduction of recordings: settings; the runs of a rig, in memory or streamed; their table."""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.bench.big_recording import BigRecording, open_big
from beltid.bench.recording import Recording, columns_of
from beltid.bench.runs.run_stream import RunColumns as StreamedRun
from beltid.config import Config
from beltid.errors import InputError
from beltid.identify.friction.kinds import (
    CELL_RANGES,
    SPANS,
    TOUCH_DEG,
    TWO_CELLS,
    KnownCell,
    KnownCells,
    RigKind,
    Span,
    Treatment,
    drag_of,
)
from beltid.identify.friction.plateaus import reduce_plateaus
from beltid.identify.friction.reduction import (
    RunReduction,
    reduce_stream,
)
from beltid.identify.friction.run import Conditions, RunColumns, RunRecord, run_record, run_records
from beltid.laws.capstan import STRAIGHT, Spans
from beltid.stages.outcome import table_columns_of
from beltid.stages.workers import Workers
from beltid.tables import schemas
from beltid.tables.values import is_missing
from beltid.uncertainty.reduced import friction_uncertainty
from beltid.uncertainty.sources import StandardUncertainties

NOT_REDUCED = ("mu_sliding_u", "normal_force_u_N_m")
"""Columns that depend on the calibration of the bench, so that the reduction does not fill them."""

TOUCHING: Final = (
    "the belt is wrapped by a whole turn or more: where its turns touch each other, the friction "
    "is not that of the pulley alone"
)
BATCH: Final = 8
"""Runs per worker in a batch."""
BATCH_BYTES: Final = 32 << 20
"""Size at which a batch is closed even with fewer runs [bytes]."""
BYTES_UNDER_WAY: Final = 96 << 20
"""Maximum size of the batches that wait for their workers, without the one being filled."""


def rig_kind(config: Config) -> RigKind:
    """Return the kind of a config's friction rig: what it measures, and its load cells."""
    rig = config.rig
    # a running belt between two pulleys turns alike at both ends; the line of force does not turn
    bent = rig.kind == "torque_hub"
    spans = Spans(config.belt.bending_stiffness_N_m2, rig.span_length_m, rig.supports == "clamped")
    return RigKind(
        measures=rig.measures,
        weight_on=rig.weight_on,
        torque_with=rig.torque_with,
        running=rig.kind == "running",
        belt_speed_m_s=_or_nan(rig.belt_speed_m_s),
        mass_per_length_kg_m=config.belt.mass_per_length_kg_m,
        cells=KnownCells(*(_known_cell(config, span) for span in SPANS)),
        spans=spans if bent else STRAIGHT,
    )


def _known_cell(config: Config, span: Span) -> KnownCell:
    return KnownCell(*(getattr(config.friction, f"tension_{span}_{e}") for e in CELL_RANGES))


def reduce_rig(
    rig: Recording | BigRecording, config: Config, workers: Workers | None = None
) -> tuple[RunReduction, ...]:
    """Reduce the runs of a recording of the friction rig; a big one in bounded memory.

    Parameters
    ----------
    rig : Recording or BigRecording
        The recording.
    config : Config
        Kind of the rig, radius of the pulley.
    workers : Workers, optional
        Reduce the runs of a big recording while the next ones are read.
    """
    radius, records = config.rig.pulley_radius_m, records_of(rig, config)
    # a single worker reduces run by run without holding a batch
    if isinstance(rig, BigRecording) and workers is not None and workers.jobs > 1:
        return reduce_stream(records, radius, partial(_parallel_map, workers))
    return reduce_stream(records, radius)


def recording_in_memory(frame: Any, config: Config | None, *, simulated: bool = False) -> Recording:
    """Return a frame with the columns of rig.csv as a recording.

    Parameters
    ----------
    frame : DataFrame, pyarrow Table, mapping or Recording
        The samples.
    config : Config or None
        Names and units of the columns; None if they are those of rig.csv.
    simulated : bool
        Whether it comes from the simulated rig.
    """
    columns = columns_of(frame, "rig", config)
    return Recording("rig", columns, Path("frame"), is_artifact=simulated)


def records_of(rig: Recording | BigRecording, config: Config) -> Iterator[RunRecord]:
    """Yield the records of the runs of a recording; a big one is read run by run.

    The recording of the simulated rig holds the tensions of both spans from perfect load cells, for
    every kind of bench. Only the span of a dead weight has no cell: its tension is the initial
    tension. The belt of a running rig runs here as well.
    """
    radius, kind = config.rig.pulley_radius_m, rig_kind(config)
    if isinstance(rig, Recording):
        columns = rig.columns
        if rig.is_artifact:
            kind = replace(kind, cells=KnownCells())
            if config.rig.kind == "dead_weight":
                columns = {**columns, "weight_N": columns["initial_tension_N"]}
            else:
                kind = replace(kind, measures="two_cells")
        yield from run_records(columns, radius, kind)
        return
    drag = None
    if kind.has_torque:
        idle = (run for run in open_big(rig.path, config) if _columns(run).is_idle)
        drag = drag_of([run.columns for run in idle])
    for run in map(_columns, rig):
        if not run.is_idle:
            yield run_record(run, radius, kind, drag)


def reduce_points(columns: Mapping[str, np.ndarray], config: Config) -> tuple[RunReduction, ...]:
    """Reduce a table with a row per plateau.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Its columns.
    config : Config
        Kind of the rig, radius of the pulley, resolution of the forces.
    """
    rig, resolution_N = config.rig, config.rig.force_resolution_N
    return reduce_plateaus(
        columns,
        rig.pulley_radius_m,
        rig_kind(config),
        _or_nan(resolution_N),
    )


def with_conditions(runs: Sequence[RunReduction], config: Config) -> tuple[RunReduction, ...]:
    """Fill in the conditions of the config for runs whose recording states none."""
    default = Conditions(config.conditions.surface, config.conditions.side)
    return tuple(replace(run, conditions=run.conditions.completed(default)) for run in runs)


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value


def _columns(run: StreamedRun) -> RunColumns:
    return RunColumns(run.label, run.columns, run.texts)


def _parallel_map(
    workers: Workers, function: Callable[[RunRecord], Any], records: Iterable[RunRecord]
) -> Iterator[Any]:
    """Yield the results in the order of the records; the next records are read meanwhile."""
    batches = _batches(records, BATCH * workers.jobs)
    batch = next(batches, [])
    # a few runs are faster than starting workers, long runs faster than sending them to workers
    if len(batch) < BATCH * workers.jobs:
        one_by_one = itertools.chain.from_iterable(itertools.chain([batch], batches))
        yield from map(function, one_by_one)
        return
    under_way: deque[tuple[Future[list[Any]], int]] = deque()
    with ThreadPoolExecutor(1) as sender:
        while batch:
            size = sum(map(_bytes, batch))
            under_way.append((sender.submit(_reduce_batch, workers, function, batch), size))
            while under_way and (
                under_way[0][0].done() or sum(size for _, size in under_way) > BYTES_UNDER_WAY
            ):
                yield from under_way.popleft()[0].result()
            batch = next(batches, [])
        while under_way:
            yield from under_way.popleft()[0].result()


def _batches(records: Iterable[RunRecord], most: int) -> Iterator[list[RunRecord]]:
    """Group records into batches of at most `most`, of fewer if they are long."""
    batch: list[RunRecord] = []
    size = 0
    for record in records:
        batch.append(record)
        size += _bytes(record)
        if len(batch) == most or size >= BATCH_BYTES:
            yield batch
            batch, size = [], 0
    if batch:
        yield batch


def _bytes(record: RunRecord) -> int:
    channels = (getattr(record, field.name) for field in fields(record))
    return sum(channel.nbytes for channel in channels if isinstance(channel, np.ndarray))


def _reduce_batch(
    workers: Workers, function: Callable[[RunRecord], Any], items: list[RunRecord]
) -> list[Any]:
    chunks = [items[k :: workers.jobs] for k in range(workers.jobs)]
    results: list[Any] = [None] * len(items)
    for k, part in workers.as_ended(_each, [(function, chunk) for chunk in chunks if chunk]):
        results[k :: workers.jobs] = part
    return results


def _each(function: Callable[[Any], Any], items: list[Any]) -> list[Any]:
    return [function(item) for item in items]


@dataclass(frozen=True, slots=True, eq=False)
class FrictionTable:
    """Table of friction coefficients of the reduced runs of a rig.

    Attributes
    ----------
    runs : tuple of RunReduction
        The runs.
    columns : dict of str to ndarray
        Columns of the friction table, with the combined uncertainties.
    budget : list of dict
        A row per quantity and source of its uncertainty.
    """

    runs: tuple[RunReduction, ...]
    columns: dict[str, np.ndarray]
    budget: list[dict[str, Any]]

    @classmethod
    def of(
        cls,
        runs: tuple[RunReduction, ...],
        uncertainty: StandardUncertainties,
        radius_m: float,
        name: str,
        kind: RigKind = TWO_CELLS,
    ) -> FrictionTable:
        """Build the table of reduced runs.

        Parameters
        ----------
        runs : tuple of RunReduction
            The runs.
        uncertainty : StandardUncertainties
            Standard uncertainties of the bench.
        radius_m : float
            Radius of the belt's centreline on the pulley [m].
        name : str
            Name of the recording, for messages.
        kind : RigKind
            Kind of the rig.

        Raises
        ------
        InputError
            If none of the runs can be used, with the reason for each.
        """
        if not any(run.ok for run in runs):
            lines = [f"{name}: run {run.run} cannot be used: {run.status}" for run in runs]
            raise InputError(lines)
        columns = reduction_columns(runs)
        combined, budget = friction_uncertainty(columns, uncertainty, radius_m, kind)
        return cls(runs, {**columns, **combined}, budget)


def reduction_columns(reduced: Sequence[RunReduction]) -> dict[str, np.ndarray]:
    """Return the columns of the friction table; a run set aside keeps the values found for it."""

    def values_of(name: str) -> list[Any] | None:
        if name in NOT_REDUCED:
            return None
        if name == "notes":
            return [_notes(r) for r in reduced]
        owners = [r.conditions for r in reduced] if name in schemas.CONDITIONS else reduced
        values = [getattr(owner, name) for owner in owners]
        hidden = name in schemas.WHERE_KNOWN and all(is_missing(value) for value in values)
        return None if hidden else values

    return table_columns_of("friction", values_of)


def taken_off(treatment: Treatment) -> tuple[str, ...]:
    """Describe the corrections of the readings of a run."""
    lines = [treatment.cells.note]
    if treatment.drag_N_m is not None:
        low, high = treatment.drag_N_m
        size = f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}"
        lines.append(f"bearing drag subtracted: {size} N m, measured on the idle pulley")
    return tuple(filter(None, lines))


def _notes(run: RunReduction) -> str | None:
    """Return the notes of a run for the user, as one text."""
    notes = list(taken_off(run.treatment))
    if run.treatment.other_span:
        notes.append("the tension measured with the torque is not that of the stated span")
    if run.arc_deg >= TOUCH_DEG:
        notes.append(TOUCHING)
    notes += run.notes
    if run.mu_sticking_reason:
        notes.append(f"no mu_sticking: {run.mu_sticking_reason}")
    return "; ".join(notes) or None

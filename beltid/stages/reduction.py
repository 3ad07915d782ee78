"""How recordings are reduced: settings; the runs of a rig, at once or while read; their table."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, Final

import numpy as np

from beltid.bench.big_recording import BigRecording
from beltid.bench.recording import Recording
from beltid.config import Config
from beltid.config.model import PressSection
from beltid.errors import InputError
from beltid.identify.friction.reduction import (
    FrictionSettings,
    RunReduction,
    reduce_runs,
    reduce_stream,
)
from beltid.identify.friction.rig_table import run_record
from beltid.identify.press.recording import StiffnessSettings
from beltid.stages.workers import Workers
from beltid.tables import schemas
from beltid.tables.values import outside
from beltid.uncertainty.reduced import friction_uncertainty
from beltid.uncertainty.sources import StandardUncertainties

NOT_REDUCED = ("mu_sliding_u", "normal_force_u_N_m")
"""Columns that hold what the reduction does not know: the calibration of the bench."""

CELL_SETTINGS: Final = tuple(
    f"tension_{span}_{error}"
    for span in ("tight", "slack")
    for error in ("tare_N", "gain", "tilt_deg")
)
"""Settings that tell what is known of the load cells."""
CELL_KEYS: Final = tuple(f"friction.{name}" for name in CELL_SETTINGS)
"""Their keys in a config."""
BATCH: Final = 8
"""Runs per worker that are handed over at a time."""
MOST_UNDER_WAY: Final = 8
"""Batches that wait for their workers, at most."""


def friction_settings(config: Config, *, with_cells: bool = True) -> FrictionSettings:
    """Settings of the reduction that a config states.

    Parameters
    ----------
    config : Config
        The config.
    with_cells : bool
        Whether to take what is known of the load cells; else they are perfect.
    """
    known = {field.name for field in fields(FrictionSettings)}
    if not with_cells:
        known -= set(CELL_SETTINGS)
    section = config.friction.model_dump()
    return FrictionSettings(**{name: v for name, v in section.items() if name in known})


def cell_settings(config: Config) -> dict[str, Any]:
    """What a config states of the load cells, by the names of `FrictionSettings`."""
    return {name: getattr(config.friction, name) for name in CELL_SETTINGS}


def stiffness_settings(press: PressSection) -> StiffnessSettings:
    """Settings of the evaluation of the press, in SI units, from the section of a config."""
    return StiffnessSettings(
        segment_length_m=press.segment_length_cm / 100.0,
        reference_temperature_degC=press.reference_temperature_degC,
        machine_compliance_m_N=press.machine_compliance_mm_N / 1000.0,
        force_gain=press.force_gain,
        displacement_gain=press.displacement_gain,
        cycles=press.cycles,
    )


def reduce_rig(
    rig: Recording | BigRecording, config: Config, workers: Workers | None
) -> tuple[RunReduction, ...]:
    """Reduce the runs of a recording of the friction rig; those of a big one in bounded memory.

    Parameters
    ----------
    rig : Recording or BigRecording
        The recording.
    config : Config
        Radius of the pulley, settings of the reduction.
    workers : Workers or None
        Who reduces the runs of a big recording while the next ones are read.
    """
    radius, settings = config.rig.pulley_radius_m, friction_settings(config)
    if isinstance(rig, Recording):
        return reduce_runs(rig.columns, radius, settings)
    mapper = map if workers is None else partial(_shared, workers)
    return reduce_stream(
        (run_record(run.label, run.columns) for run in rig), radius, settings, mapper
    )


def _shared(
    workers: Workers, function: Callable[[Any], Any], items: Iterable[Any]
) -> Iterator[Any]:
    """Results of calls in the order of their items; the next items are made meanwhile."""
    size = BATCH * workers.jobs
    source = iter(items)
    batch = list(itertools.islice(source, size))
    if len(batch) < size:  # workers take longer to start than that
        yield from map(function, batch)
        return
    under_way: deque[Future[list[Any]]] = deque()
    with ThreadPoolExecutor(1) as beside:
        while batch:
            under_way.append(beside.submit(_batch, workers, function, batch))
            while under_way and (under_way[0].done() or len(under_way) > MOST_UNDER_WAY):
                yield from under_way.popleft().result()
            batch = list(itertools.islice(source, size))
        while under_way:
            yield from under_way.popleft().result()


def _batch(workers: Workers, function: Callable[[Any], Any], items: list[Any]) -> list[Any]:
    chunks = [items[k :: workers.jobs] for k in range(workers.jobs)]
    results: list[Any] = [None] * len(items)
    for k, part in workers.as_ended(_each, [(function, chunk) for chunk in chunks if chunk]):
        results[k :: workers.jobs] = part
    return results


def _each(function: Callable[[Any], Any], items: list[Any]) -> list[Any]:
    return [function(item) for item in items]


@dataclass(frozen=True, slots=True, eq=False)
class FrictionTable:
    """Reduced runs of a rig as the table of friction coefficients.

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
    ) -> FrictionTable:
        """Table of reduced runs.

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

        Raises
        ------
        InputError
            If none of the runs can be used, with the reason of each.
        """
        if not any(run.ok for run in runs):
            lines = [f"{name}: run {run.run} cannot be used: {run.status}" for run in runs]
            raise InputError(lines, code="no-run")
        columns = reduction_columns(runs)
        combined, budget = friction_uncertainty(columns, uncertainty, radius_m)
        return cls(runs, {**columns, **combined}, budget)


def reduction_columns(reduced: Sequence[RunReduction]) -> dict[str, np.ndarray]:
    """Columns of the friction table.

    A run that was set aside keeps what was found; a number that the table does not admit (a
    tension below zero) is left out of it.
    """
    columns: dict[str, np.ndarray] = {}
    for column in schemas.table("friction").columns:
        if column.name in NOT_REDUCED:
            continue
        if column.name == "notes":
            values = [_notes(r) for r in reduced]
        else:
            values = [getattr(r, column.name) for r in reduced]
        if column.dtype == "string":
            array = np.empty(len(values), dtype=object)
            array[:] = values
        else:
            array = np.array(values, dtype=column.dtype)
        if column.dtype == "float64":
            array = np.where(np.isfinite(array) & ~outside(array, column), array, np.nan)
        columns[column.name] = array
    return columns


def _notes(run: RunReduction) -> str | None:
    notes = list(run.notes)
    if run.mu_sticking_reason:
        notes.append(f"no mu_sticking: {run.mu_sticking_reason}")
    return "; ".join(notes) or None

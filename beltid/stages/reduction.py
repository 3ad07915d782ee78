"""Reduction of the runs of a rig, measured or simulated, and their table, Eqs. (5) to (8)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.bench.recording import Recording, columns_of
from beltid.config import Config
from beltid.identify.friction.kinds import (
    PERFECT,
    TOUCH_DEG,
    KnownCell,
    RigKind,
)
from beltid.identify.friction.plateaus import reduce_plateaus
from beltid.identify.friction.reduction import (
    RunReduction,
    reduce_records,
)
from beltid.identify.friction.run import Conditions, RunRecord, run_records
from beltid.laws.capstan import STRAIGHT, Spans
from beltid.stages.columns import columns_from
from beltid.tables import schemas
from beltid.tables.values import is_missing

NOT_REDUCED = ("mu_sliding_u", "normal_force_u_N_m")
"""Columns that depend on the calibration of the bench, so that the reduction does not fill them."""

TOUCHING: Final = (
    "the belt is wrapped by a whole turn or more: where its turns touch each other, the friction "
    "is not that of the pulley alone"
)


def rig_kind(config: Config) -> RigKind:
    """Return the kind of a config's friction rig: what it measures, and its load cells."""
    rig, cells = config.rig, config.friction
    # a running belt between two pulleys turns alike at both ends; the line of force does not turn
    bent = rig.kind == "torque_hub"
    spans = Spans(config.belt.bending_stiffness_N_m2, rig.span_length_m, rig.supports == "clamped")
    return RigKind(
        measures=rig.measures,
        weight_on=rig.weight_on,
        weight_stated=rig.states_weight,
        running=rig.kind == "running",
        belt_speed_m_s=_or_nan(rig.belt_speed_m_s),
        mass_per_length_kg_m=config.belt.mass_per_length_kg_m,
        cells=(
            KnownCell(cells.tension_tight_tare_N, cells.tension_tight_gain),
            KnownCell(cells.tension_slack_tare_N, cells.tension_slack_gain),
        ),
        spans=spans if bent else STRAIGHT,
    )


def reduce_rig(rig: Recording, config: Config) -> tuple[RunReduction, ...]:
    """Reduce the runs of a recording of the friction rig."""
    radius, records = config.rig.pulley_radius_m, records_of(rig, config)
    if rig.is_artifact:  # from perfect cells
        return reduce_records(records, radius)
    return reduce_records(
        records, radius, config.uncertainty.cell_gain_rel, config.friction.free_at_rest
    )


def recording_in_memory(frame: Any, config: Config | None, *, simulated: bool = False) -> Recording:
    """Return a frame with the columns of rig.csv as a recording."""
    columns = columns_of(frame, "rig", config)
    return Recording("rig", columns, Path("frame"), is_artifact=simulated)


def records_of(rig: Recording, config: Config) -> tuple[RunRecord, ...]:
    """Return the records of the runs of a recording.

    The recording of the simulated rig holds the tensions of both spans from perfect load cells, for
    every kind of bench. Only the span of a dead weight has no cell: its tension is the initial
    tension. The belt of a running rig runs here as well.
    """
    radius, kind = config.rig.pulley_radius_m, rig_kind(config)
    columns = rig.columns
    if rig.is_artifact:
        kind = replace(kind, cells=PERFECT)
        if config.rig.kind == "dead_weight":
            columns = {**columns, "weight_N": columns["initial_tension_N"]}
        else:
            kind = replace(kind, measures="two_cells")
    return run_records(columns, radius, kind)


def reduce_points(columns: Mapping[str, np.ndarray], config: Config) -> tuple[RunReduction, ...]:
    """Reduce a table with a row per plateau."""
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

    return columns_from("friction", values_of)


def drag_taken_off(run: RunReduction) -> tuple[str, ...]:
    """Describe the bearing drag that was subtracted from the torque of a run."""
    if run.drag_N_m is None:
        return ()
    low, high = run.drag_N_m
    size = f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}"
    return (f"bearing drag subtracted: {size} N m, measured on the idle pulley",)


def _notes(run: RunReduction) -> str | None:
    """Return the notes of a run for the user, as one text."""
    notes = list(drag_taken_off(run))
    if run.arc_deg >= TOUCH_DEG:
        notes.append(TOUCHING)
    notes += run.notes
    if run.mu_sticking_reason:
        notes.append(f"no mu_sticking: {run.mu_sticking_reason}")
    return "; ".join(notes) or None

"""How recordings are reduced: settings, and the columns of reduced runs of either rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from beltid.identify.friction.reduction import FrictionSettings, RunReduction
from beltid.identify.press.recording import StiffnessSettings
from beltid.tables import schemas
from beltid.tables.columns import outside

if TYPE_CHECKING:
    from beltid.config import Config
    from beltid.config.model import PressSection


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


def friction_settings(values: Mapping[str, Any], *, with_cells: bool = True) -> FrictionSettings:
    """Settings of the reduction from a section ``friction`` of a config or of an artifact.

    Parameters
    ----------
    values : mapping
        The section.
    with_cells : bool
        Whether to take what is known of the load cells; else they are perfect.
    """
    known = {field.name for field in fields(FrictionSettings)}
    if not with_cells:
        known -= set(CELL_SETTINGS)
    return FrictionSettings(**{name: v for name, v in values.items() if name in known})


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

"""Tables and laws that stages take from files or, in Python, from memory."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from beltid.errors import InputError
from beltid.identify.surface import surface_from_columns
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.stages.outcome import Outcome
from beltid.store import schemas
from beltid.store.artifacts import Artifact, read_artifact
from beltid.store.frames import columns_of_frame
from beltid.store.problems import Problems


def load_surface(path: str | Path) -> FrictionSurface:
    """Load the averaged friction surface of a surface artifact.

    Parameters
    ----------
    path : path
        The artifact, as ``beltid build-surface`` writes it.

    Raises
    ------
    ArtifactError
        If the file is missing, damaged or of another kind.
    """
    return surface_of(read_artifact(path, "surface"))


def surface_of(artifact: Artifact) -> FrictionSurface:
    """Averaged friction surface of a surface artifact that was read."""
    try:
        return surface_from_columns(artifact.columns)
    except InputError as error:
        raise InputError([f"{artifact.path}: {line}" for line in error.problems]) from None


def load_stiffness(path: str | Path, temperature_degC: float | None = None) -> NormalLaw:
    """Load the normal contact law of a stiffness artifact.

    Parameters
    ----------
    path : path
        The artifact, as ``beltid fit-stiffness`` writes it.
    temperature_degC : float, optional
        The law fitted at the nearest measured temperature (within 5 °C); by default the pooled law.

    Raises
    ------
    ArtifactError
        If the file is missing, damaged or of another kind.
    InputError
        If there is no law at that temperature.
    """
    return law_of(read_artifact(path, "stiffness"), temperature_degC)


def law_of(artifact: Artifact, temperature_degC: float | None = None) -> NormalLaw:
    """Normal contact law of a stiffness artifact that was read; see `load_stiffness`."""
    at = artifact.columns["temperature_degC"]
    if temperature_degC is None:
        rows = np.flatnonzero(np.isnan(at))
    else:
        rows = np.flatnonzero(np.abs(at - temperature_degC) <= 5.0)
        rows = rows[np.argsort(np.abs(at[rows] - temperature_degC), kind="stable")]
    if rows.size == 0:
        known = ", ".join(f"{t:g}" for t in at[~np.isnan(at)]) or "none"
        wanted = "pooled law" if temperature_degC is None else f"law at {temperature_degC:g} °C"
        raise InputError(f"{artifact.path}: no {wanted}; temperatures with a law: {known}")
    row = int(rows[0])
    return NormalLaw(
        float(artifact.columns["k_linear_N_m2"][row]),
        float(artifact.columns["k_quadratic_N_m3"][row]),
    )


def table_columns(frame: Any, kind: str, needed: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Columns of a table of ours that is in memory.

    Parameters
    ----------
    frame : DataFrame, pyarrow Table, mapping, Outcome or Artifact
        The table.
    kind : str
        Its kind.
    needed : tuple of str
        Columns that it must have; further columns of the kind are taken if they are there.

    Raises
    ------
    InputError
        With every column that is missing or holds something else than it must.
    """
    if isinstance(frame, (Outcome, Artifact)):
        if frame.kind != kind:
            raise InputError(f"is a {frame.kind} table, a {kind} table is needed")
        return frame.columns
    table = schemas.table(kind)
    simple = replace(
        table,
        columns=tuple(
            replace(column, required=column.name in needed)
            for column in table.columns
            if column.dtype != "list"
        ),
    )
    problems = Problems()
    columns = columns_of_frame(frame, simple, f"{kind} table", {}, problems)
    problems.raise_if_any()
    return columns

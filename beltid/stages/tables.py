"""Tables and laws that stages take from files or, in Python, from memory."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from beltid.artifacts.artifact import Artifact, read_artifact, stated_kind
from beltid.artifacts.file_bytes import read_bytes
from beltid.artifacts.together import refuse_misfits
from beltid.bench.recording import table_columns as columns_in
from beltid.config import Config
from beltid.errors import ArgumentTypeError, ArtifactError, InputError
from beltid.export.law import ContactLaw
from beltid.export.law_file import law_from_text
from beltid.identify.surface.surface import surface_from_columns
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.stages.outcome import Outcome
from beltid.tables import schemas
from beltid.uncertainty.press_law import PressLaw


def load_law(path: str | Path) -> ContactLaw:
    """Load the contact law of a belt from its file ``<belt>.beltlaw.json``.

    Parameters
    ----------
    path : path
        The file, as ``beltid export json`` writes it.

    Returns
    -------
    ContactLaw
        ``.surface`` is the `FrictionSurface`, ``.normal_law`` the `NormalLaw`.

    Raises
    ------
    ArtifactError
        If the file is missing, damaged, changed by hand, or no contact law.
    """
    data = read_bytes(Path(path), ArtifactError)
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError:
        kind = stated_kind(Path(path))
        text = (
            f"{path}: is a {kind} artifact, part of a contact law; name the folder of a belt's "
            "results, such as runs/5pk, or a law file"
            if kind
            else f"{path}: not a contact law: no UTF-8 text"
        )
        raise ArtifactError(text) from None
    return law_from_text(text, str(path))


def load_surface(path: str | Path) -> FrictionSurface:
    """Load the averaged friction surface of a surface artifact.

    It has its uncertainty: ``.mu_u(f, v)``, the combined standard
    uncertainty, and ``.band(f, v, level)``.

    Parameters
    ----------
    path : path
        The artifact, as ``beltid build-surface`` writes it, or a law file of ``beltid export``.

    Raises
    ------
    ArtifactError
        If the file is missing, damaged or of another kind.
    """
    if _is_law_file(path):
        return load_law(path).surface
    return surface_of(read_artifact(path, "surface"))


def surface_of(artifact: Artifact) -> FrictionSurface:
    """Return the averaged friction surface of a surface artifact, with its covariance."""
    columns = artifact.columns
    try:
        surface = surface_from_columns(columns)
    except InputError as error:
        raise InputError(error.at(str(artifact.path))) from None
    rows = np.flatnonzero(np.isnan(columns["arc_deg"]))
    rows = rows[np.lexsort((columns["slip_speed_m_s"][rows], columns["normal_force_N_m"][rows]))]

    def on_grid(name: str) -> np.ndarray | None:
        if name not in columns or np.isnan(columns[name][rows]).any():
            return None
        return np.asarray(columns[name][rows].reshape(*surface.mu_nodes.shape, -1))

    uncertainty = artifact.metadata.uncertainty or {}
    return surface.with_covariance(
        on_grid("mu_factor"),
        [source["name"] for source in uncertainty.get("sources", ())],
    )


def friction_in(folder: Path) -> Artifact | None:
    """Return the friction artifact in a folder; None if there is none that can be read."""
    try:
        return read_artifact(folder / "friction.parquet", "friction")
    except ArtifactError:
        return None


def friction_of(surface: Artifact, folder: Path) -> Artifact | None:
    """Return the friction artifact that the surface was made from, if it is still in the folder.

    Raises
    ------
    ArtifactError
        If the same recording was reduced again since.
    """
    friction = friction_in(folder)
    if friction is None:
        return None
    refuse_misfits([surface], [friction])
    return friction if friction.sha256 == surface.metadata.inputs.get("friction") else None


def load_stiffness(path: str | Path, temperature_degC: float | None = None) -> NormalLaw:
    """Load the normal contact law of a stiffness artifact.

    Parameters
    ----------
    path : path
        The artifact, as ``beltid fit-stiffness`` writes it, or a law file of ``beltid export``
        (which holds the pooled law only).
    temperature_degC : float, optional
        The law fitted at the nearest measured temperature (within 5 °C); by default the pooled law.

    Raises
    ------
    ArtifactError
        If the file is missing, damaged or of another kind.
    InputError
        If there is no law at that temperature.
    """
    if _is_law_file(path):
        if temperature_degC is not None:
            raise InputError(f"{path}: a law file holds the pooled law only, no temperature")
        return load_law(path).normal_law
    return law_of(read_artifact(path, "stiffness"), temperature_degC)


def _is_law_file(path: str | Path) -> bool:
    return Path(path).suffix == ".json"


def law_of(artifact: Artifact, temperature_degC: float | None = None) -> NormalLaw:
    """Return the normal contact law of a stiffness artifact; see `load_stiffness`."""
    temperatures = artifact.columns["temperature_degC"]
    if temperature_degC is None:
        rows = np.flatnonzero(np.isnan(temperatures))
    else:
        rows = np.flatnonzero(np.abs(temperatures - temperature_degC) <= 5.0)
        rows = rows[np.argsort(np.abs(temperatures[rows] - temperature_degC), kind="stable")]
    if rows.size == 0:
        known = ", ".join(f"{t:g}" for t in temperatures[~np.isnan(temperatures)]) or "none"
        wanted = "pooled law" if temperature_degC is None else f"law at {temperature_degC:g} °C"
        raise InputError(f"{artifact.path}: no {wanted}; temperatures with a law: {known}")
    row = int(rows[0])
    return NormalLaw(
        float(artifact.columns["k_linear_N_m2"][row]),
        float(artifact.columns["k_quadratic_N_m3"][row]),
    )


def press_law(law: NormalLaw | Artifact | Outcome[Any] | Path, config: Config) -> PressLaw:
    """Return a contact law with the scatter of its fit, which only a fitted table contains.

    A path is that of a stiffness artifact.
    """
    if isinstance(law, Path):
        law = read_artifact(law, "stiffness")
    covariance, depth = np.zeros((2, 2)), 1.0e-4
    normal = law_of(law) if isinstance(law, Artifact) else checked_law(law)
    if isinstance(law, (Artifact, Outcome)):
        pooled = int(np.flatnonzero(np.isnan(law.columns["temperature_degC"]))[0])
        stored = law.columns["covariance"][pooled].reshape(2, 2)
        covariance = np.where(np.isfinite(stored), stored, 0.0)
        depth = float(law.columns["max_penetration_m"][pooled])
    return PressLaw(normal, covariance, depth, config.press.si()["segment_length_m"])


def table_columns(
    frame: Any, kind: str, needed: tuple[str, ...], argument: str = ""
) -> dict[str, np.ndarray]:
    """Return the columns of a table in memory that follows one of the schemas.

    Parameters
    ----------
    frame : DataFrame, pyarrow Table, mapping, Outcome or Artifact
        The table.
    kind : str
        Its kind.
    needed : tuple of str
        Required columns; further columns of the schema are read if present.
    argument : str
        Name of the argument, for messages of functions that take two tables.

    Raises
    ------
    InputError
        With every column that is missing or holds values of the wrong type.
    """
    if isinstance(frame, (Outcome, Artifact)):
        if frame.kind != kind:
            prefix = f"{argument} " if argument else ""
            raise InputError(f"{prefix}is a {frame.kind} table, a {kind} table is needed")
        return frame.columns
    table, name = schemas.table(kind), argument or f"{kind} table"
    columns = columns_in(frame, table, name)
    missing = ", ".join(column for column in needed if column not in columns)
    if missing:
        raise InputError(f"{name}: column {missing} is missing")
    return columns


def surface_from(surface: Any) -> FrictionSurface:
    """Return a friction surface given as such, as a result, or as a constant coefficient.

    Raises
    ------
    InputError
        If it is none of these.
    """
    if isinstance(surface, Outcome) and surface.kind == "surface":
        surface = surface.result.surface
    if isinstance(surface, FrictionSurface):
        return surface
    if not is_number(surface):
        raise ArgumentTypeError(
            f"surface = {shown(surface)}, must be a FrictionSurface such as load_surface(PATH), "
            "the result of build_surface or refine_surface, or a number (constant mu)"
        )
    if not 0.0 < surface < math.inf:
        raise InputError(f"surface = {float(surface):g}, must be > 0 and finite (constant mu)")
    return FrictionSurface.constant(float(surface))


def checked_law(law: Any) -> NormalLaw:
    """Return a normal law given as such or as a result; otherwise raise an error."""
    if isinstance(law, Outcome) and law.kind == "stiffness":
        law = law.result.pooled.law
    if isinstance(law, NormalLaw):
        return law
    raise ArgumentTypeError(
        f"law = {shown(law)}, must be a NormalLaw such as load_stiffness(PATH), or the result of "
        "fit_stiffness(FRAME)"
    )


def shown(value: Any) -> str:
    """Describe a wrong argument for a message: None, or its type."""
    if isinstance(value, Outcome):
        return f"result of kind {value.kind}"
    return "None" if value is None else type(value).__name__


def is_number(value: Any) -> bool:
    """Return whether a value is a single real number; booleans are not."""
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)

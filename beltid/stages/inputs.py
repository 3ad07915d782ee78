"""What the stages take and give: laws, surfaces and runs from files or results; their columns."""

import contextlib
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from beltid.bench.recording import table_columns
from beltid.config import Config
from beltid.errors import ArtifactError, InputError
from beltid.export.law import ContactLaw, law_from_text
from beltid.identify.estimators import settings_of
from beltid.identify.surface.surface import surface_from_columns
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.stage import Outcome
from beltid.store.artifact import Artifact, read_artifact, refuse_misfits
from beltid.store.disk import read_bytes
from beltid.tables import schemas
from beltid.tables.values import is_missing, outside
from beltid.uncertainty.measured import PressLaw
from beltid.uncertainty.sources import ASSUMED, STATED, StandardUncertainties

Columns = Mapping[str, np.ndarray]
UNIT = re.compile("_(rel|rad|deg|mm_N|m_N|N_m|N|m)$")
"""Unit of a key, which those of `StandardUncertainties` do without."""
NEAR_DEGC = 5.0  # distance of a temperature from that of a law up to which the law holds [K]
ROUNDING = 1e-9  # relative
NEGLIGIBLE = 1e-3  # relative error of a speed that changes mu by a few parts in ten thousand


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
    return law_from_text(
        read_bytes(Path(path), ArtifactError).decode("utf-8", "replace"), str(path)
    )


def load_surface(source: str | Path | Outcome[Any]) -> FrictionSurface:
    """Load the averaged friction surface, with its uncertainty ``.mu_u(f, v)``.

    Parameters
    ----------
    source : path or Outcome
        The artifact, as ``beltid build-surface`` writes it, a law file of ``beltid export``, or the
        result of `build_surface` or `refine_surface`.

    Raises
    ------
    ArtifactError
        If the file is missing, damaged or of another kind.
    """
    if not isinstance(source, (str, Path)):
        return surface_from(source)
    if Path(source).suffix == ".json":
        return load_law(source).surface
    return surface_from(read_artifact(source, "surface"))


def load_stiffness(
    source: str | Path | Outcome[Any], temperature_degC: float | None = None
) -> NormalLaw:
    """Load the normal contact law of a stiffness artifact.

    Parameters
    ----------
    source : path or Outcome
        The artifact, as ``beltid fit-stiffness`` writes it, a law file of ``beltid export`` (which
        holds the pooled law only), or the result of `fit_stiffness`.
    temperature_degC : float, optional
        The law fitted at the nearest measured temperature (within 5 °C); by default the pooled law.

    Raises
    ------
    ArtifactError
        If the file is missing, damaged or of another kind.
    InputError
        If there is no law at that temperature.
    """
    if not isinstance(source, (str, Path)):
        return law_from(source, temperature_degC)
    if Path(source).suffix == ".json":
        if temperature_degC is not None:
            raise InputError(f"{source}: a law file holds the pooled law only, no temperature")
        return load_law(source).normal_law
    return law_from(read_artifact(source, "stiffness"), temperature_degC)


def surface_from(surface: Any) -> FrictionSurface:
    """Return a friction surface given as such, as a result, or as a constant coefficient."""
    if isinstance(surface, (Outcome, Artifact)) and surface.kind == "surface":
        return _averaged_surface(surface)
    if isinstance(surface, FrictionSurface):
        return surface
    is_number = isinstance(surface, (int, float, np.number)) and not isinstance(surface, bool)
    if not is_number or not 0.0 < surface < math.inf:
        raise InputError(
            f"surface = {surface if is_number else shown(surface)}, must be a FrictionSurface such "
            "as load_surface(PATH), the result of build_surface or refine_surface, or a number > 0"
        )
    return FrictionSurface.constant(float(surface))


def _averaged_surface(item: Artifact | Outcome[Any]) -> FrictionSurface:
    """Return the surface of the rows without an arc, with its covariance."""
    columns = item.columns
    with at(item):
        surface = surface_from_columns(columns)
    rows = np.flatnonzero(np.isnan(columns["arc_deg"]))
    rows = rows[np.lexsort((columns["slip_speed_m_s"][rows], columns["normal_force_N_m"][rows]))]
    factor = columns.get("mu_factor")
    if factor is not None:
        of_nodes = factor[rows].reshape(*surface.mu_nodes.shape, -1)
        factor = None if np.isnan(of_nodes).any() else of_nodes
    sources = (item.facts.get("uncertainty") or {}).get("sources", ())
    return surface.with_covariance(factor, [source["name"] for source in sources])


def law_from(law: Any, temperature_degC: float | None = None) -> NormalLaw:
    """Return a normal contact law given as such, or as a result; see `load_stiffness`."""
    if isinstance(law, NormalLaw):
        return law
    if not isinstance(law, (Outcome, Artifact)) or law.kind != "stiffness":
        raise InputError(
            f"law = {shown(law)}, must be a NormalLaw such as load_stiffness(PATH), or the result "
            "of fit_stiffness(FRAME)"
        )
    row, of = law_row(law, temperature_degC), law.columns
    return NormalLaw(float(of["k_linear_N_m2"][row]), float(of["k_quadratic_N_m3"][row]))


def law_row(law: Artifact | Outcome[Any], temperature_degC: float | None = None) -> int:
    """Return the row of the pooled law, or of the law at the nearest measured temperature."""
    temperatures = law.columns["temperature_degC"]
    if temperature_degC is None:
        return int(np.flatnonzero(np.isnan(temperatures))[0])
    distance = np.abs(temperatures - temperature_degC)
    if not np.any(distance <= NEAR_DEGC):
        known = ", ".join(f"{t:g}" for t in temperatures[~np.isnan(temperatures)]) or "none"
        raise InputError(
            f"{getattr(law, 'path', 'stiffness')}: no law at {temperature_degC:g} °C; temperatures "
            f"with a law: {known}"
        )
    return int(np.nanargmin(distance))


def press_law(law: Any, config: Config) -> PressLaw:
    """Return a contact law with the scatter of its fit, which only a fitted table contains."""
    covariance, depth, normal = np.zeros((2, 2)), 1.0e-4, law_from(law)
    if isinstance(law, (Artifact, Outcome)):
        pooled = law_row(law)
        stored = law.columns["covariance"][pooled].reshape(2, 2)
        covariance = np.where(np.isfinite(stored), stored, 0.0)
        depth = float(law.columns["max_penetration_m"][pooled])
    return PressLaw(normal, covariance, depth, config.press.si()["segment_length_m"])


def friction_columns(table: Any, needed: tuple[str, ...], argument: str = "friction") -> Columns:
    """Return the columns of reduced runs: an artifact, a result, or a table in memory."""
    if isinstance(table, (Outcome, Artifact)):
        if table.kind != "friction":
            raise InputError(f"{argument} is a {table.kind} table, a friction table is needed")
        return table.columns
    columns = table_columns(table, schemas.table("friction"), argument)
    if missing := ", ".join(column for column in needed if column not in columns):
        raise InputError(f"{argument}: column {missing} is missing")
    return columns


def ok_rows(friction: Columns) -> np.ndarray:
    """Return which runs of a friction table are usable, shape (n,); all if it has no status."""
    status = friction.get("status")
    return np.ones(len(friction["arc_deg"]), dtype=bool) if status is None else status == "ok"


def with_tensions(friction: Columns, config: Config) -> dict[str, np.ndarray]:
    """Fill in nominal tensions: that at rest, else the mean while sliding (hub force: first)."""
    setting = np.asarray(friction["nominal_tension_N"], dtype=float)
    rest, tight, slack = (
        np.asarray(friction.get(name, np.full(setting.size, np.nan)), dtype=float)
        for name in ("initial_tension_N", "tension_tight_N", "tension_slack_N")
    )
    candidates = (rest, 0.5 * (tight + slack))
    for tension in candidates[::-1] if config.rig_params().given_force == "hub" else candidates:
        setting = np.where(np.isfinite(setting), setting, tension)
    return {**friction, "nominal_tension_N": setting}


def nominal_settings(values: np.ndarray, gap: float) -> np.ndarray:
    """Snap values to their repeated settings; return them unchanged if they repeat none."""
    settings, labels = np.empty(values.size), settings_of(values, gap)
    for label in np.unique(labels):
        settings[labels == label] = _setting(values[labels == label])
    repeated = 2 * np.unique(settings).size <= values.size
    return settings if repeated and np.all(np.abs(values - settings) <= gap * values) else values


def _setting(values: np.ndarray) -> float:
    """Return the setting behind scattered values: the median, rounded as the scatter allows."""
    middle, scatter = float(np.median(values)), float(np.std(values))
    if scatter <= ROUNDING * middle:  # stated, not measured
        return middle
    error = max(2.0 * scatter / math.sqrt(values.size), NEGLIGIBLE * middle)
    rounded = (float(f"{middle:.{digits}g}") for digits in range(1, 17))
    return next(value for value in rounded if abs(value - middle) <= error)


def friction_in(folder: Path) -> Artifact | None:
    """Return the friction artifact in a folder; None if there is none that can be read."""
    try:
        return read_artifact(folder / "friction.parquet", "friction")
    except ArtifactError:
        return None


def friction_of(surface: Artifact) -> Artifact | None:
    """Return the friction artifact beside a surface made from it; None if there is none."""
    if (friction := friction_in(surface.path.parent)) is None:
        return None
    refuse_misfits([surface], [friction])
    return friction if friction.sha256 == surface.record.inputs.get("friction") else None


def standard_uncertainties(config: Config) -> StandardUncertainties:
    """Return standard uncertainties in SI, and which were stated; zero for what a rig lacks."""
    section = config.uncertainty
    values = {UNIT.sub("", key): value for key, value in section.si().items()}
    if not config.rig.running:
        values["mass_per_length"] = 0.0
    if config.rig.kind not in ("torque", "torque_hub"):
        values |= dict.fromkeys(("torque_gain", "bearing_drag"), 0.0)
    stated = {UNIT.sub("", key) for key in section.model_fields_set}
    return {key: (u, STATED if key in stated else ASSUMED) for key, u in values.items()}


@contextlib.contextmanager
def at(item: Any) -> Iterator[None]:
    """Put the file of an input before the lines of an InputError raised inside."""
    try:
        yield
    except InputError as error:
        if type(error) is not InputError:
            raise
        raise InputError(error.at(str(getattr(item, "path", "table")))) from None


def columns_from(kind: str, rows: Sequence[Any], **more: Any) -> dict[str, np.ndarray]:
    """Return the columns of a kind from attributes and `more`; a number not allowed becomes nan."""
    columns: dict[str, np.ndarray] = {}
    for column in schemas.table(kind).columns:
        name = column.name
        if name not in more and not hasattr(rows[0], name):
            continue
        values = more[name] if name in more else [getattr(row, name) for row in rows]
        if name in schemas.WHERE_KNOWN and all(map(is_missing, values)):
            continue
        types: dict[str, Any] = {"string": object, "list": float}
        array = np.array(values, dtype=types.get(column.dtype, column.dtype))
        if column.dtype == "float64":
            array = np.where(np.isfinite(array) & ~outside(array, column), array, np.nan)
        columns[name] = array
    return columns


def joined(parts: Sequence[Columns]) -> dict[str, np.ndarray]:
    """Put tables with the same columns one below the other."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def set_aside_lines(rows: Sequence[Mapping[str, Any]], said: str = "set aside") -> list[str]:
    """Return a line for each reason for which runs or tests were set aside."""
    return [
        f"{what} {listed([row[what] for row in rows if row['why'] == why])} {said}: {why}"
        for what, why in dict.fromkeys((next(iter(row)), row["why"]) for row in rows)
    ]


def span(values: Any) -> tuple[float, float] | None:
    """Return the lowest and highest finite value, or None if there is none."""
    values = np.asarray(values, dtype=float)
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if finite.size else None


def listed(words: Sequence[str], most: int = 8) -> str:
    """Join the first `most` words, and state how many more there are."""
    text = ", ".join(words[:most])
    return f"{text} and {len(words) - most} more" if len(words) > most else text


def shown(value: Any) -> str:
    """Describe a wrong argument for a message: its type, of a result its kind."""
    return f"result of kind {value.kind}" if isinstance(value, Outcome) else type(value).__name__

"""beltid export: the contact law of a belt, as one value and as files for multibody codes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid._version import __version__
from beltid.config import Config, find_config
from beltid.errors import ArtifactError, InputError
from beltid.export.belt_width import ribbed_width
from beltid.export.choices import Choices, Export
from beltid.export.law import BeltFacts, ContactLaw, NormalPart, Provenance, Validity, friction_part
from beltid.export.law_file import SUFFIX, law_from_text, schema
from beltid.export.reduction import reference_point
from beltid.export.targets import TARGETS, Target
from beltid.export.units import SI, SYSTEMS
from beltid.report.summary import Summary
from beltid.stages.origin import MEASURED, SYNTHETIC
from beltid.stages.tables import law_of, surface_of
from beltid.stages.talk import Options
from beltid.store import atomic
from beltid.store.artifacts import Artifact, read_artifact
from beltid.store.files import read_bytes

ALL: Final = "all"
SCHEMA: Final = "schema"
STIFFNESS: Final = "stiffness.parquet"
SURFACES: Final = {"refined": "surface_refined.parquet", "published": "surface.parquet"}
ABOUT: Final = (
    "Contact law between a V-ribbed belt and a pulley, per metre of belt, in SI units. Normal line "
    "force: f_N = k_linear delta + k_quadratic delta^2 for a penetration delta > 0, else 0. "
    "Friction: mu(f_N, |v|) f_N against the sliding; bicubic between the nodes, given cell by cell "
    "in friction.patches; outside validity the nearest measured value, never an extrapolation."
)


@dataclass(frozen=True, slots=True)
class ExportOptions(Options):
    """Options of an export.

    Attributes
    ----------
    surface : {"refined", "published"} or None
        Which friction surface; None for the refined one where it is there.
    normal_force_N_m, slip_speed_m_s : float or None
        Where targets that hold one stiffness or mu at one force are exact; None for the middle of
        the measured range.
    units : {"SI", "mm"}
        Units of the files of targets that leave them open.
    """

    surface: str | None = None
    normal_force_N_m: float | None = None
    slip_speed_m_s: float | None = None
    units: str = SI.name


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
        raise ArtifactError(f"{path}: not a contact law: no UTF-8 text") from None
    return law_from_text(text, str(path))


def run(
    target: str, source: Path, config: Path | None, out: Path | None, options: ExportOptions
) -> Summary:
    """Write the law of a results folder, or of a law file, for a target (or for all).

    Parameters
    ----------
    target : str
        Name of a target, or "all".
    source : Path
        Folder with the artifacts of a belt, or a law file.
    config : Path or None
        Config that the user named.
    out : Path or None
        Folder of the files; None for ``export`` in the folder of the law.
    options : ExportOptions
        Options.

    Raises
    ------
    InputError
        If something that is needed is missing, or a file that stands there was written by others.
    """
    chosen = _targets(target)
    law = load_law(source) if source.is_file() else _law_of_folder(source, config, options)
    folder = out or (source if source.is_dir() else source.parent) / "export"
    point = reference_point(law, options.normal_force_N_m, options.slip_speed_m_s)
    made: dict[str, Export] = {}
    warnings: list[str] = []
    for one in chosen:
        units = SYSTEMS[options.units] if one.in_units else SI
        try:
            made[one.name] = one.write(law, Choices(point, units))
        except InputError as error:
            if len(chosen) == 1:
                raise
            warnings += [f"{one.name} left out: {line}" for line in error.problems]
    up_to_date = _write(folder, made.values(), source, options)
    return _summary(law, folder, made, tuple(warnings), up_to_date)


def schema_text() -> str:
    """JSON Schema of the law file, as text."""
    return json.dumps(schema(), indent=2, ensure_ascii=False) + "\n"


def target_rows() -> list[dict[str, Any]]:
    """A row per target: name, what it is, how much of the law it holds."""
    return [
        {"target": target.name, "writes": target.title, "holds": target.holds}
        for target in TARGETS.values()
    ]


def _targets(name: str) -> Sequence[Target]:
    if name == ALL:
        return tuple(TARGETS.values())
    if name not in TARGETS:
        known = ", ".join((*TARGETS, ALL, SCHEMA))
        raise InputError(f"target = {name}, must be one of {known}")
    return (TARGETS[name],)


def _law_of_folder(folder: Path, named: Path | None, options: ExportOptions) -> ContactLaw:
    """The law of the artifacts in a folder."""
    if not folder.is_dir():
        raise InputError(
            f"{folder}: there is no such folder or file; name the results of a belt, such as "
            f"runs/5pk, or a law file <belt>{SUFFIX}"
        )
    stiffness = read_artifact(folder / STIFFNESS, "stiffness")
    surface = _surface_artifact(folder, options)
    source = find_config(folder / STIFFNESS, named)
    options.talk.say(f"config: {source.origin}")
    belongs = source.config.sha256 == surface.metadata.config_sha256
    if not belongs and named is not None:
        options.talk.warn(f"{surface.path.name} was made with another config than {source.origin}")
    known = belongs or named is not None
    row = int(np.flatnonzero(np.isnan(stiffness.columns["temperature_degC"]))[0])
    normal = law_of(stiffness)
    return ContactLaw(
        about=ABOUT,
        origin=_origin(stiffness, surface),
        belt=_belt(source.config) if known else BeltFacts(name=folder.resolve().name),
        normal=NormalPart(
            k_linear_N_m2=normal.k_linear_N_m2,
            k_quadratic_N_m3=normal.k_quadratic_N_m3,
            k_linear_se_N_m2=_known(stiffness, "k_linear_se_N_m2", row),
            k_quadratic_se_N_m3=_known(stiffness, "k_quadratic_se_N_m3", row),
            covariance=_covariance(stiffness, row),
            rms_residual_N_m=_known(stiffness, "rms_residual_N_m", row),
            hysteresis_ratio=_known(stiffness, "hysteresis_ratio", row),
        ),
        friction=friction_part(
            surface_of(surface), str(surface.metadata.extra.get("method", "published"))
        ),
        validity=_validity(stiffness, surface),
        provenance=_provenance(folder, stiffness, surface),
    )


def _surface_artifact(folder: Path, options: ExportOptions) -> Artifact:
    wanted = options.surface
    if wanted is None:
        wanted = "refined" if (folder / SURFACES["refined"]).is_file() else "published"
    options.talk.say(f"surface: {wanted}")
    return read_artifact(folder / SURFACES[wanted], "surface")


def _belt(config: Config) -> BeltFacts:
    belt = config.belt
    return BeltFacts(
        name=belt.name,
        type=belt.type,
        ribs=belt.ribs,
        width_m=belt.width_m or ribbed_width(belt.type, belt.ribs),
        axial_stiffness_N=belt.axial_stiffness_N,
        bending_stiffness_N_m2=belt.bending_stiffness_N_m2,
        mass_per_length_kg_m=belt.mass_per_length_kg_m,
    )


def _known(artifact: Artifact, column: str, row: int) -> float | None:
    value = float(artifact.columns[column][row])
    return value if np.isfinite(value) else None


def _covariance(stiffness: Artifact, row: int) -> Any:
    value = stiffness.columns["covariance"][row]
    if value is None:
        return None
    numbers = np.asarray(value, dtype=float).reshape(2, 2)
    return numbers.tolist() if np.isfinite(numbers).all() else None


def _origin(*artifacts: Artifact) -> Any:
    origins = [artifact.metadata.extra.get("origin") for artifact in artifacts]
    if SYNTHETIC in origins:
        return SYNTHETIC
    return MEASURED if all(origin == MEASURED for origin in origins) else None


def _validity(stiffness: Artifact, surface: Artifact) -> Validity:
    ours, theirs = surface.metadata.validity, stiffness.metadata.validity
    return Validity(
        normal_force_N_m=ours.get("normal_force_N_m"),
        slip_speed_m_s=ours.get("slip_speed_m_s"),
        penetration_m=theirs.get("penetration_m"),
        press_force_N_m=theirs.get("force_N_m"),
    )


def _provenance(folder: Path, stiffness: Artifact, surface: Artifact) -> Provenance:
    """Hashes of the artifacts, and of the recordings as far as the chain behind them is here."""
    recordings = dict(stiffness.metadata.inputs)
    needed = surface.metadata.inputs.get("friction")
    try:
        friction = read_artifact(folder / "friction.parquet", "friction")
    except ArtifactError:
        friction = None
    if friction is not None and friction.sha256 == needed:
        recordings |= friction.metadata.inputs
    config = surface.metadata.extra.get("config")
    return Provenance(
        software=f"beltid {__version__}",
        software_sha256=surface.software_sha256,
        artifacts={"stiffness": stiffness.sha256, "surface": surface.sha256},
        recordings=recordings,
        config=config,
        config_sha256=surface.metadata.config_sha256,
        notes=(
            *stiffness.metadata.extra.get("notes", ()),
            *surface.metadata.extra.get("notes", ()),
        ),
    )


def _write(folder: Path, made: Any, source: Path, options: ExportOptions) -> bool:
    """Write the files; returns whether all of them stood there already."""
    files = {folder / name: data for export in made for name, data in export.files.items()}
    problems, changed = [], {}
    for path, data in files.items():
        if path.is_file() and path.read_bytes() == data:
            continue
        if path.exists() and source.exists() and path.samefile(source):
            problems.append(f"{path}: is the law file that is read, name another --out")
        elif path.exists() and not options.force:
            problems.append(
                f"{path}: stands there with another content, not replaced; --force replaces it"
            )
        changed[path] = data
    if problems:
        raise InputError(problems)
    for path, data in changed.items():
        atomic.write_bytes(path, data)
    return not changed


def _summary(
    law: ContactLaw,
    folder: Path,
    made: dict[str, Export],
    warnings: tuple[str, ...],
    up_to_date: bool,
) -> Summary:
    rows = [
        {
            "target": name,
            "file": file,
            "holds": TARGETS[name].holds,
            "reduced": "; ".join(f"{what}: {dev}" for what, dev in export.reductions.items()),
        }
        for name, export in made.items()
        for file in export.files
    ]
    details = {
        "reductions": [
            {
                "target": name,
                "reduction": what,
                "rms_percent": 100.0 * deviation.rms,
                "worst_percent": 100.0 * deviation.worst,
                "where": deviation.where,
            }
            for name, export in made.items()
            for what, deviation in export.reductions.items()
        ]
    }
    valid = law.validity
    return Summary(
        stage="export",
        title=f"contact law of the belt {law.belt.name}",
        out=folder,
        facts={
            "surface": law.friction.method,
            "valid_force_N_m": valid.normal_force_N_m,
            "valid_speed_m_s": valid.slip_speed_m_s,
        },
        table=rows,
        shown=("target", "file", "holds"),
        details=details if any(details.values()) else {},
        warnings=warnings,
        up_to_date=up_to_date,
        origin=law.origin,
    )

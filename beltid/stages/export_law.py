"""beltid export: write the contact law of a belt as a law file and for multibody codes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from beltid._version import __version__
from beltid.config import find_config
from beltid.errors import ArtifactError, InputError
from beltid.export.law import (
    SUFFIX,
    BeltFacts,
    ContactLaw,
    Contribution,
    NormalPart,
    Provenance,
    Validity,
    friction_part,
    validation_problems,
)
from beltid.export.reduction import reference_point
from beltid.export.targets import TARGETS, Export, export
from beltid.notes import log
from beltid.report.summary import Summary
from beltid.stages.inputs import friction_in, friction_of, load_law, pooled_row, surface_from
from beltid.store.artifact import Artifact, combined_origin, read_artifact
from beltid.store.disk import write_bytes
from beltid.store.place import anyone_s, check_place
from beltid.store.together import refuse_misfits

ALL: Final = "all"
SURFACES: Final = {"refined": "surface_refined.parquet", "published": "surface.parquet"}
ABOUT: Final = (
    "Contact law between a V-ribbed belt and a pulley, per metre of belt, in SI units. Normal line "
    "force: f_N = k_linear delta + k_quadratic delta^2 for a penetration delta > 0, else 0. "
    "Friction: mu(f_N, |v|) f_N against the sliding; bicubic between the nodes, given cell by cell "
    "in friction.patches; outside validity the nearest measured value, never an extrapolation."
)


def run(
    target: str | None,
    source: Path | None,
    config: Path | None,
    out: Path | None,
    *,
    force: bool = False,
    surface: str | None = None,
    normal_force_N_m: float | None = None,
    slip_speed_m_s: float | None = None,
) -> Summary:
    """Write the law of a results folder or of a law file for one target or for all."""
    if target is None:
        rows = [
            {"target": name, "writes": of.title, "holds": of.holds} for name, of in TARGETS.items()
        ]
        return Summary("export", "targets", table=rows, shown=("target", "writes"))
    if target not in (*TARGETS, ALL):
        raise InputError(f"target = {target}, must be one of {', '.join((*TARGETS, ALL))}")
    if source is None:
        raise InputError(
            "LAW is missing: name the results of a belt, such as runs/5pk, or a law file"
        )
    law = law_of_folder(source, config, surface) if source.is_dir() else _of_file(source, surface)
    folder = out or (source if source.is_dir() else source.parent) / "export"
    point = reference_point(law, normal_force_N_m, slip_speed_m_s)
    names = tuple(TARGETS) if target == ALL else (target,)
    exports = {name: export(law, name, point) for name in names}
    up_to_date = _write(folder, exports.values(), source, force=force)
    return _summary(law, folder, exports, up_to_date)


def _of_file(source: Path, surface: str | None) -> ContactLaw:
    """Load the law of a law file, which holds one surface only."""
    if not source.exists():
        raise InputError(
            f"{source}: there is no such folder or file; name the results of a belt, such as "
            f"runs/5pk, or a law file <belt>{SUFFIX}"
        )
    law = load_law(source)
    if surface not in (None, law.friction.method):
        raise InputError(
            f"{source}: holds the {law.friction.method} surface, not the {surface} one; name the "
            "folder of the results"
        )
    return law


def _write(folder: Path, exports: Iterable[Export], source: Path, *, force: bool) -> bool:
    """Write the files; return whether all of them already existed with this content."""
    files = {folder / name: data for export in exports for name, data in export.files.items()}
    law = {"law file that is read": source} if source.is_file() else {}
    problems, changed = list[str](), dict[Path, bytes]()
    for path, data in files.items():
        if path.is_file() and path.read_bytes() == data:
            continue
        changed[path] = data
        try:
            check_place(path, (path.suffix,), anyone_s, inputs=law, force=force)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    for path, data in changed.items():
        write_bytes(path, data)
    return not changed


def _summary(
    law: ContactLaw, folder: Path, exports: Mapping[str, Export], up_to_date: bool
) -> Summary:
    rows, overview, reductions = list[Any](), list[Any](), list[Any]()
    for name, made in exports.items():
        row = {
            "reduced": ", ".join(made.reductions) or "nothing",
            "worst_percent": 100.0 * max((d.worst for d in made.reductions.values()), default=0),
        }
        overview.append({"target": name, "files": len(made.files), **row})
        holds = TARGETS[name].holds
        rows += [{"target": name, "file": file, "holds": holds, **row} for file in made.files]
        reductions += [
            {
                "target": name,
                "reduction": reduction,
                "rms_percent": 100.0 * deviation.rms,
                "worst_percent": 100.0 * deviation.worst,
                "where": deviation.where,
            }
            for reduction, deviation in made.reductions.items()
        ]
    valid = law.validity
    return Summary(
        stage="export",
        title=f"contact law of the belt {law.belt.name}",
        out=folder,
        facts={
            "surface": law.friction.method,
            "config": law.provenance.config,
            "measured_force_N_m": valid.measured_force_N_m,
            "valid_force_N_m": valid.normal_force_N_m,
            "valid_speed_m_s": valid.slip_speed_m_s,
        },
        table=rows,
        overview=overview if len(overview) > 1 else [],
        shown=("target", "file", "reduced", "worst_percent"),
        details={"reductions": reductions} if reductions else {},
        up_to_date=up_to_date,
        origin=law.origin,
    )


def law_of_folder(folder: Path, config: Path | None, wanted: str | None) -> ContactLaw:
    """Assemble the contact law from the artifacts in a folder; the belt is that of the config."""
    stiffness = read_artifact(folder / "stiffness.parquet", "stiffness")
    if wanted is None:
        wanted = "refined" if (folder / SURFACES["refined"]).is_file() else "published"
    log.info("surface: %s", wanted)
    surface = read_artifact(folder / SURFACES[wanted], "surface")
    refuse_misfits(a for a in (stiffness, surface, friction_in(folder)) if a is not None)
    friction, row = friction_of(surface), pooled_row(stiffness)
    normal = {name: _value(stiffness, name, row) for name in NormalPart.model_fields}
    try:
        return ContactLaw(
            about=ABOUT,
            origin=combined_origin([stiffness.origin, surface.origin]),
            belt=_belt(folder, surface, config),
            conditions=surface.facts.get("conditions") or {},
            normal=NormalPart.model_validate(normal),
            friction=friction_part(
                surface_from(surface),
                surface.facts.get("method") or "published",
                _budget(surface),
                _sticking(friction),
            ),
            validity=Validity(
                measured_force_N_m=surface.facts.get("measured", {}).get("normal_force_N_m"),
                normal_force_N_m=surface.validity.get("normal_force_N_m"),
                slip_speed_m_s=surface.validity.get("slip_speed_m_s"),
                penetration_m=stiffness.validity.get("penetration_m"),
                press_force_N_m=stiffness.validity.get("force_N_m"),
            ),
            provenance=_provenance(stiffness, surface, friction),
        )
    except ValidationError as error:
        raise ArtifactError(validation_problems(error, str(folder))) from None


def _belt(folder: Path, surface: Artifact, config: Path | None) -> BeltFacts:
    """Return the belt that a surface was made for, or that of the named config."""
    if config is not None:
        stated = find_config(None, config).config.belt.model_dump()
    else:
        name = re.sub(r"[^A-Za-z0-9._-]+", "_", folder.resolve().name).lstrip("._-")
        stated = surface.record.settings.get("belt") or {"name": name[:40] or "belt"}
    return BeltFacts.model_validate(
        {k: v for k, v in stated.items() if k in BeltFacts.model_fields}
    )


def _value(stiffness: Artifact, column: str, row: int) -> Any:
    """Return a number of a stiffness table, or its covariance; None if it is not known."""
    values = stiffness.columns.get(column)
    if values is None or values[row] is None:
        return None
    numbers = np.asarray(values[row], dtype=float)
    if not np.isfinite(numbers).all():
        return None
    return numbers.reshape(2, 2).tolist() if numbers.ndim else float(numbers)


def _budget(surface: Artifact) -> tuple[Contribution, ...]:
    """Return the contributions to the uncertainty of mu, largest first, the combined one last."""
    return tuple(
        Contribution(**{name: row[name] for name in Contribution.model_fields if name in row})
        for row in surface.tables.get("budget", ())
        if row["contribution_percent"] is not None
    )


def _sticking(friction: Artifact | None) -> tuple[float, float] | None:
    """Return sticking peak over sliding coefficient: mean and standard deviation of the runs."""
    if friction is None:
        return None
    columns = friction.columns
    ratio = columns["mu_sticking"] / columns["mu_sliding"]
    ratio = ratio[(columns["status"] == "ok") & np.isfinite(ratio)]
    return (float(ratio.mean()), float(ratio.std(ddof=1))) if ratio.size > 1 else None


def _provenance(stiffness: Artifact, surface: Artifact, friction: Artifact | None) -> Provenance:
    """Return the hashes of the artifacts, and of the recordings as far as they are known."""
    recordings = dict(stiffness.record.inputs)
    if friction is not None:
        recordings |= friction.record.inputs
    return Provenance(
        software=f"beltid {__version__}",
        software_sha256=surface.record.sources,
        artifacts={"stiffness": stiffness.sha256, "surface": surface.sha256},
        recordings=recordings,
        config=surface.record.config,
        config_sha256=surface.record.config_sha256,
        notes=(*stiffness.record.notes, *surface.record.notes),
    )

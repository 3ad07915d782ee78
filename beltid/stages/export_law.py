"""beltid export: write the contact law of a belt as a law file and for multibody codes."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

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
    part_of,
    validation_problems,
)
from beltid.export.targets import TARGETS, Export, export, reference_point
from beltid.notes import log
from beltid.report.summary import Summary
from beltid.stages.inputs import Columns, friction_in, law_row, load_law, surface_from
from beltid.store.artifact import Artifact, combined_origin, plain, read_artifact, refuse_misfits
from beltid.store.disk import check_place, write_bytes

ALL = "all"
SURFACES = {"refined": "surface_refined.parquet", "published": "surface.parquet"}
ABOUT = (
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
    surface: str | None,
    exact_at: tuple[float | None, float | None],
    *,
    force: bool,
) -> Summary:
    """Write the law of a results folder or of a law file for one target or for all."""
    if target is None:
        return Summary(
            stage="export",
            title="targets",
            table=[
                {"target": n, "writes": of.title, "holds": of.holds} for n, of in TARGETS.items()
            ],
            shown=("target", "writes"),
        )
    if target not in (*TARGETS, ALL):
        raise InputError(f"target = {target}, must be one of {', '.join((*TARGETS, ALL))}")
    if source is None:
        raise InputError(
            "LAW is missing: name the results of a belt, such as runs/5pk, or a law file"
        )
    law = law_of_folder(source, config, surface) if source.is_dir() else _of_file(source, surface)
    folder = out or (source if source.is_dir() else source.parent) / "export"
    point, names = reference_point(law, *exact_at), TARGETS if target == ALL else (target,)
    exports = {name: export(law, name, point) for name in names}
    files = {folder / name: data for made in exports.values() for name, data in made.files.items()}
    changed = {p: data for p, data in files.items() if not p.is_file() or p.read_bytes() != data}
    problems = list[str]()
    inputs = {"law file that is read": source} if source.is_file() else {}
    for path in changed:
        try:
            check_place(path, (path.suffix,), inputs=inputs, force=force)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    for path, data in changed.items():
        write_bytes(path, data)
    return _summary(law, folder, exports, up_to_date=not changed)


def _of_file(source: Path, surface: str | None) -> ContactLaw:
    """Load the law of a law file, which holds one surface only."""
    if not source.exists():
        raise InputError(f"{source}: there is no such folder or file of a law (<belt>{SUFFIX})")
    law = load_law(source)
    if surface not in (None, law.friction.method):
        raise InputError(
            f"{source}: holds the {law.friction.method} surface, not the {surface} one"
        )
    return law


def _summary(
    law: ContactLaw, folder: Path, exports: Mapping[str, Export], *, up_to_date: bool
) -> Summary:
    reductions = [
        {
            "target": name,
            "reduction": reduction,
            "rms_percent": 100.0 * deviation.rms,
            "worst_percent": 100.0 * deviation.worst,
            "where": deviation.where,
        }
        for name, made in exports.items()
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
        table=[
            {
                "target": name,
                "file": file,
                "holds": TARGETS[name].holds,
                "reduced": ", ".join(made.reductions) or "nothing",
                "worst_percent": 100.0
                * max((of.worst for of in made.reductions.values()), default=0),
            }
            for name, made in exports.items()
            for file in made.files
        ],
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
    friction, row = friction_in(folder), law_row(stiffness)
    refuse_misfits(a for a in (stiffness, surface, friction) if a is not None)
    if friction is not None and friction.sha256 != surface.record.inputs.get("friction"):
        friction = None
    normal = {name: values[row] for name, values in stiffness.columns.items()}
    covariance = normal["covariance"].reshape(2, 2)
    normal["covariance"] = covariance if np.isfinite(covariance).all() else None
    made, pressed = surface.record, stiffness.record
    valid = {**pressed.validity, **made.validity}
    valid["measured_force_N_m"] = surface.facts.get("measured", {}).get("normal_force_N_m")
    valid["press_force_N_m"] = valid.get("force_N_m")
    try:
        return ContactLaw(
            about=ABOUT,
            origin=combined_origin([stiffness.origin, surface.origin]),
            belt=part_of(BeltFacts, _belt(folder, surface, config)),
            conditions=surface.facts.get("conditions") or {},
            normal=part_of(NormalPart, plain(normal)),
            friction=friction_part(
                surface_from(surface),
                surface.facts.get("method") or "published",
                budget=tuple(
                    part_of(Contribution, row)
                    for row in made.tables.get("budget", ())
                    if row["contribution_percent"] is not None
                ),
                **({} if friction is None else _sticking(friction.columns)),
            ),
            validity=part_of(Validity, valid),
            provenance=Provenance(
                software=f"beltid {__version__}",
                software_sha256=made.sources,
                artifacts={"stiffness": stiffness.sha256, "surface": surface.sha256},
                recordings=pressed.inputs | (friction.record.inputs if friction else {}),
                config=made.config,
                config_sha256=made.config_sha256,
                notes=(*pressed.notes, *made.notes),
            ),
        )
    except ValidationError as error:
        raise ArtifactError(validation_problems(error, str(folder))) from None


def _belt(folder: Path, surface: Artifact, config: Path | None) -> dict[str, Any]:
    """Return the belt that a surface was made for, or that of the named config."""
    if config is not None:
        return find_config(None, config).config.belt.model_dump()
    return surface.record.settings.get("belt") or {"name": folder.resolve().name}


def _sticking(friction: Columns) -> dict[str, float]:
    """Return sticking peak over sliding coefficient: mean and standard deviation of the runs."""
    ratio = friction["mu_sticking"] / friction["mu_sliding"]
    ratio = ratio[(friction["status"] == "ok") & np.isfinite(ratio)]
    return (
        {"sticking_ratio": ratio.mean(), "sticking_ratio_sd": ratio.std(ddof=1)}
        if ratio.size > 1
        else {}
    )

"""The contact law of a belt, put together from the artifacts of its chain."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from beltid._version import __version__
from beltid.config import Config, ConfigSource, find_config
from beltid.errors import ArtifactError, InputError
from beltid.export.law import (
    BeltFacts,
    ContactLaw,
    Contribution,
    NormalPart,
    Provenance,
    Validity,
    friction_part,
)
from beltid.export.law_file import SUFFIX, validation_problems
from beltid.notes import log
from beltid.stages.inputs import friction_in, friction_of, law_of, surface_of
from beltid.stages.page_mark import config_of_results
from beltid.store.artifact import Artifact, combined_origin, read_artifact
from beltid.store.together import refuse_misfits

STIFFNESS: Final = "stiffness.parquet"
SURFACES: Final = {"refined": "surface_refined.parquet", "published": "surface.parquet"}
ABOUT: Final = (
    "Contact law between a V-ribbed belt and a pulley, per metre of belt, in SI units. Normal line "
    "force: f_N = k_linear delta + k_quadratic delta^2 for a penetration delta > 0, else 0. "
    "Friction: mu(f_N, |v|) f_N against the sliding; bicubic between the nodes, given cell by cell "
    "in friction.patches; outside validity the nearest measured value, never an extrapolation."
)


def law_of_folder(folder: Path, named: Path | None, wanted: str | None) -> ContactLaw:
    """Assemble the contact law from the artifacts in a folder."""
    if not folder.is_dir():
        raise InputError(
            f"{folder}: there is no such folder or file; name the results of a belt, such as "
            f"runs/5pk, or a law file <belt>{SUFFIX}",
        )
    stiffness = read_artifact(folder / STIFFNESS, "stiffness")
    surface = _surface_artifact(folder, wanted)
    refuse_misfits(a for a in (stiffness, surface, friction_in(folder)) if a is not None)
    friction = friction_of(surface, folder)
    source = find_config(None, named) if named else config_of_results(folder, surface.record)
    if source is None:
        log.warning(
            "the config of these results was not found: type and ribs of the belt are unknown; "
            "name it with --config"
        )
    else:
        log.info("config: %s", source.origin)
        if source.config.sha256 != surface.record.config_sha256:
            log.warning(
                "%s was made with a different config than %s", surface.path.name, source.origin
            )
    try:
        return _assemble(folder, stiffness, surface, friction, source)
    except ValidationError as error:
        raise ArtifactError(validation_problems(error, str(folder))) from None


def _assemble(
    folder: Path,
    stiffness: Artifact,
    surface: Artifact,
    friction: Artifact | None,
    source: ConfigSource | None,
) -> ContactLaw:
    law_of(stiffness)  # raises an error without a pooled law
    row = int(np.flatnonzero(np.isnan(stiffness.columns["temperature_degC"]))[0])
    return ContactLaw(
        about=ABOUT,
        origin=combined_origin([stiffness.origin, surface.origin]),
        belt=BeltFacts(name=_belt_name(folder)) if source is None else _belt(source.config),
        conditions=surface.facts.get("conditions") or {},
        normal=NormalPart.model_validate(
            {
                **{name: _finite_or_none(stiffness, name, row) for name in NormalPart.model_fields},
                "covariance": _covariance(stiffness, row),
            }
        ),
        friction=friction_part(
            surface_of(surface),
            surface.facts.get("method") or "published",
            _budget(surface),
            _sticking(friction),
        ),
        validity=_validity(stiffness, surface),
        provenance=_provenance(stiffness, surface, friction),
    )


def _surface_artifact(folder: Path, wanted: str | None) -> Artifact:
    if wanted is None:
        wanted = "refined" if (folder / SURFACES["refined"]).is_file() else "published"
    log.info("surface: %s", wanted)
    return read_artifact(folder / SURFACES[wanted], "surface")


def _belt_name(folder: Path) -> str:
    """Turn the name of a folder into a valid name of a belt."""
    name = re.sub(r"[^A-Za-z0-9._-]+", "_", folder.resolve().name).lstrip("._-")
    return name[:40] or "belt"


def _belt(config: Config) -> BeltFacts:
    belt = config.belt
    known = BeltFacts.model_fields.keys() & type(belt).model_fields
    return BeltFacts.model_validate({name: getattr(belt, name) for name in known})


def _finite_or_none(artifact: Artifact, column: str, row: int) -> float | None:
    values = artifact.columns.get(column)
    if values is None or values.ndim > 1 or not np.isfinite(values[row]):
        return None
    return float(values[row])


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


def _covariance(stiffness: Artifact, row: int) -> Any:
    value = stiffness.columns["covariance"][row]
    if value is None:
        return None
    numbers = np.asarray(value, dtype=float).reshape(2, 2)
    return numbers.tolist() if np.isfinite(numbers).all() else None


def _validity(stiffness: Artifact, surface: Artifact) -> Validity:
    of_surface, of_press = surface.validity, stiffness.validity
    return Validity(
        measured_force_N_m=surface.facts.get("measured", {}).get("normal_force_N_m"),
        normal_force_N_m=of_surface.get("normal_force_N_m"),
        slip_speed_m_s=of_surface.get("slip_speed_m_s"),
        penetration_m=of_press.get("penetration_m"),
        press_force_N_m=of_press.get("force_N_m"),
    )


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

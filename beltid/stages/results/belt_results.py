"""Results of a belt, gathered from its folder."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.artifacts.artifact import Artifact, read_artifact
from beltid.config import Config, load_config
from beltid.errors import ArtifactError, BeltidError, InputError
from beltid.params import OperatingPoint
from beltid.report.results import ArcProfile, BeltResults, Sheet
from beltid.rigsim.model import Bench
from beltid.rigsim.rig import SimulationSettings, simulate
from beltid.stages.results.law_of_belt import config_of_results
from beltid.stages.results.recorded_curves import PRESS, RIG, typical_runs
from beltid.stages.simulation.campaign import bench_of

ARTIFACTS: Final = {
    "stiffness": "stiffness",
    "slip": "slip",
    "friction": "friction",
    "surface": "surface",
    "surface_refined": "surface",
    "simulated": "simulated",
    "compare": "compare",
    "simulated_refined": "simulated",
    "compare_refined": "compare",
    "compare_hold_out": "compare",
    "drive": "drive",
    "compare_drive": "compare_drive",
    PRESS: PRESS,
    RIG: RIG,
}
"""Artifacts that a report shows: file name -> kind."""
MADE_FROM: Final = {PRESS: ("stiffness", "press"), RIG: ("friction", "rig")}
"""Curves -> result, role: both must come from the same recording."""


def sheet_of(artifact: Artifact) -> Sheet:
    """Convert an artifact for the report.

    Raises
    ------
    ArtifactError
        If its rows do not meet the requirements of the figures and tables.
    """
    sheet = Sheet(
        artifact.path.stem,
        artifact.kind,
        artifact.columns,
        artifact.metadata,
        artifact.sha256,
        artifact.software_sha256,
        artifact.software_version,
    )
    try:
        sheet.check()
    except InputError as error:
        raise ArtifactError(error.at(str(artifact.path))) from None
    return sheet


def check_folder(folder: Path) -> None:
    """Raise an `ArtifactError` if a path is not a folder."""
    if not folder.is_dir():
        if folder.exists():
            raise ArtifactError(f"{folder}: is a file, the folder of a belt's results is needed")
        raise ArtifactError(f"{folder}: there is no such folder", code="missing-file")


def gather(folder: Path, *, with_profiles: bool = True) -> BeltResults:
    """Read the results in the folder of a belt; report missing or damaged ones as problems.

    Parameters
    ----------
    folder : Path
        The folder.
    with_profiles : bool
        Whether to simulate the contact along the arc of typical runs.

    Raises
    ------
    ArtifactError
        If there is no such folder, or it holds no results.
    """
    check_folder(folder)
    sheets: dict[str, Sheet] = {}
    problems: list[str] = []
    for name, kind in ARTIFACTS.items():
        path = folder / f"{name}.parquet"
        if not path.exists():
            continue
        try:
            sheets[name] = sheet_of(read_artifact(path, kind))
        except ArtifactError as error:
            problems += error.problems
    if not sheets:
        raise ArtifactError(
            problems
            or [f"{folder}: contains no results of a belt; `beltid run CONFIG` creates them"]
        )
    problems += _drop_mismatched_curves(sheets)
    belt = folder.resolve().name
    profiles, profile_problems = arc_profiles(sheets) if with_profiles else ((), [])
    all_problems = (*problems, *profile_problems)
    return BeltResults(belt, sheets, profiles, all_problems, belt_facts(config_of(folder)))


def config_of(folder: Path) -> Config | None:
    """Return the config that the results in a folder were made with, or None if not found."""
    for name in ("friction", "stiffness"):
        try:
            metadata = read_artifact(folder / f"{name}.parquet", name).metadata
        except ArtifactError:
            continue
        source = config_of_results(folder, metadata)
        if source is not None:
            return source.config
    return None


def belt_facts(config: Config | None) -> tuple[str, ...]:
    """Return the type and number of ribs of the belt."""
    if config is None:
        return ()
    belt = config.belt
    return tuple(fact for fact in (belt.type, f"{belt.ribs} ribs") if fact)


def _drop_mismatched_curves(sheets: dict[str, Sheet]) -> list[str]:
    """Drop curves whose recording differs from the one that the result was made from."""
    problems = []
    for name, (result, role) in MADE_FROM.items():
        if name not in sheets or result not in sheets:
            continue
        if len({sheets[key].metadata.inputs.get(role) for key in (name, result)}) > 1:
            del sheets[name]
            problems.append(
                f"{name}.parquet comes from a different recording than {result}.parquet"
            )
    return problems


def arc_profiles(sheets: Mapping[str, Sheet]) -> tuple[tuple[ArcProfile, ...], list[str]]:
    """Simulate the sliding contact of a typical run of each arc; return profiles and problems."""
    surface = sheets.get("surface_refined") or sheets.get("surface")
    simulated = sheets.get("simulated_refined") or sheets.get("simulated")
    stiffness, friction = sheets.get("stiffness"), sheets.get("friction")
    if surface is None or simulated is None or stiffness is None or friction is None:
        return (), []
    arc_runs, problems = [], []
    try:
        bench = _bench(simulated.metadata.settings, stiffness, surface)
        rows = typical_runs(friction.columns)
    except BeltidError as error:
        return (), [f"the contact along the arc: {line}" for line in error.problems]
    for row in rows:
        arc, tension, speed = (
            float(friction[name][row])
            for name in ("arc_deg", "initial_tension_N", "slip_speed_m_s")
        )
        point = OperatingPoint(beta=math.radians(arc), T_0=tension, omega=speed / bench.rig.R)
        try:
            run = simulate(bench, point, SimulationSettings(method="steady"))
        except BeltidError as error:
            problems += [f"the contact along the arc: {line}" for line in error.problems]
            continue
        profile = {name: np.asarray(values, dtype=float) for name, values in run.profile.items()}
        arc_runs.append(ArcProfile(arc, tension, speed, profile, run.normal_force_N_m))
    return tuple(arc_runs), problems


def _bench(settings: Mapping[str, Any], stiffness: Sheet, surface: Sheet) -> Bench:
    """Rebuild the simulated rig of a recording from the settings stored in it."""
    sections: dict[str, dict[str, Any]] = {"belt": {}, "rig": {}}
    for key, value in settings.items():
        section, _, name = key.partition(".")
        if section in sections:
            sections[section][name] = value
    config = load_config({**sections, "contact": settings.get("contact", {})})
    return bench_of(config, surface.surface, stiffness.law(stiffness.pooled_row))

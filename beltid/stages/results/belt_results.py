"""The results of a belt, gathered from its folder."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.artifacts.artifact import Artifact, read_artifact
from beltid.bench.recorded_date import recorded_on
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
"""Artifacts that a report shows: name of the file and kind."""
MADE_FROM: Final = {PRESS: ("stiffness", "press"), RIG: ("friction", "rig")}
"""Curves that must be of the recording that a result was made from."""


def sheet_of(artifact: Artifact) -> Sheet:
    """An artifact as the report sees it.

    Raises
    ------
    ArtifactError
        If its rows do not make what figures and tables rely on.
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
    """Refuse what is no folder (`ArtifactError`)."""
    if not folder.is_dir():
        if folder.exists():
            raise ArtifactError(f"{folder}: is a file, the folder of a belt's results is needed")
        raise ArtifactError(f"{folder}: there is no such folder", code="missing-file")


def gather(folder: Path, *, with_profiles: bool = True) -> BeltResults:
    """Read what stands in the folder of a belt; what is missing or damaged is told.

    Parameters
    ----------
    folder : Path
        The folder.
    with_profiles : bool
        Whether to simulate the contact along the arc of typical runs.

    Raises
    ------
    ArtifactError
        If there is no such folder, or nothing of ours in it.
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
            problems or [f"{folder}: no results of a belt in it; `beltid run CONFIG` makes some"]
        )
    problems += _drop_strangers(sheets)
    belt = folder.resolve().name
    profiles, more = arc_profiles(sheets) if with_profiles else ((), [])
    config = config_of(folder)
    dates = test_dates(config) if with_profiles and config is not None else {}
    every = (*problems, *more)
    return BeltResults(belt, sheets, profiles, every, belt_facts(config), dates)


def config_of(folder: Path) -> Config | None:
    """The config that the results in a folder were made with, where it is found."""
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
    """Type and ribs of the belt."""
    if config is None:
        return ()
    belt = config.belt
    return tuple(fact for fact in (belt.type, f"{belt.ribs} ribs") if fact)


def test_dates(config: Config) -> dict[str, str]:
    """When the recordings of a config were made, as they tell or as it states."""
    days = {
        kind: recorded_on(file, config, kind) or config.data.date
        for kind, file in config.data.files.items()
    }
    return {kind: day for kind, day in days.items() if day is not None}


def _drop_strangers(sheets: dict[str, Sheet]) -> list[str]:
    """Leave out curves of another recording than the one that a result was made from."""
    problems = []
    for name, (result, role) in MADE_FROM.items():
        if name not in sheets or result not in sheets:
            continue
        if len({sheets[one].metadata.inputs.get(role) for one in (name, result)}) > 1:
            del sheets[name]
            problems.append(f"{name}.parquet is of another recording than {result}.parquet")
    return problems


def arc_profiles(sheets: Mapping[str, Sheet]) -> tuple[tuple[ArcProfile, ...], list[str]]:
    """The simulated contact of a typical run of each arc, sliding, and what went wrong with it."""
    surface = sheets.get("surface_refined") or sheets.get("surface")
    simulated = sheets.get("simulated_refined") or sheets.get("simulated")
    stiffness, friction = sheets.get("stiffness"), sheets.get("friction")
    if surface is None or simulated is None or stiffness is None or friction is None:
        return (), []
    found, problems = [], []
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
        found.append(ArcProfile(arc, tension, speed, profile, run.normal_force_N_m))
    return tuple(found), problems


def _bench(settings: Mapping[str, Any], stiffness: Sheet, surface: Sheet) -> Bench:
    """The simulated rig that a recording was made with, by the settings that it carries."""
    sections: dict[str, dict[str, Any]] = {"belt": {}, "rig": {}}
    for key, value in settings.items():
        section, _, name = key.partition(".")
        if section in sections:
            sections[section][name] = value
    config = load_config({**sections, "contact": settings.get("contact", {})})
    return bench_of(config, surface.surface, stiffness.law(stiffness.pooled_row))

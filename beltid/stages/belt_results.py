"""Results of a belt, gathered from its folder."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.config import Config, load_config
from beltid.errors import ArtifactError, BeltidError
from beltid.params import OperatingPoint
from beltid.report.results import ArcProfile, BeltResults, Sheet, sheet_of
from beltid.rig.model import Bench
from beltid.rig.runs import SimulationSettings, simulate
from beltid.stages.campaign import bench_of
from beltid.stages.curves import typical_runs
from beltid.stages.page_mark import ARTIFACTS, CURVES, OnPage
from beltid.store.artifact import Artifact, read_artifact
from beltid.store.together import misfits, refuse_misfits

RECORDED: Final = ("press", "rig", "speedloss")
"""Recordings that a config can name."""


def check_folder(folder: Path) -> None:
    """Raise an `ArtifactError` if a path is not a folder."""
    if not folder.is_dir():
        if folder.exists():
            raise ArtifactError(f"{folder}: is a file, the folder of a belt's results is needed")
        raise ArtifactError(f"{folder}: there is no such folder")


def gather(belt: OnPage) -> BeltResults:
    """Read the results of a belt; report those that are not shown as problems.

    Raises
    ------
    ArtifactError
        If there is no such folder, it holds no results, or they do not fit together.
    """
    folder = belt.folder
    check_folder(folder)
    artifacts: dict[str, Artifact] = {}
    sheets: dict[str, Sheet] = {}
    problems: list[str] = []
    for name, kind in ARTIFACTS.items():
        path = folder / f"{name}.parquet"
        if not path.exists():
            continue
        try:
            artifacts[name] = read_artifact(path, kind)
            sheets[name] = sheet_of(artifacts[name])
        except ArtifactError as error:
            problems += error.problems
    shown = {name: artifact for name, artifact in artifacts.items() if name in sheets}
    problems += _left_out(shown, belt.config, belt.made)
    curves = [shown.pop(name) for name in CURVES if name in shown]
    refuse_misfits(shown.values())
    for artifact in curves:
        lines = misfits([*shown.values(), artifact])
        problems += lines
        if not lines:
            shown[artifact.kind] = artifact
    if not shown:
        raise ArtifactError(
            problems
            or [f"{folder}: contains no results of a belt; `beltid run CONFIG` creates them"]
        )
    return BeltResults(
        belt=folder.resolve().name,
        sheets={name: sheets[name] for name in ARTIFACTS if name in shown},
        problems=tuple(problems),
        failures=belt.failures,
        belt_facts=belt.facts,
    )


def _left_out(
    artifacts: dict[str, Artifact], config: Config | None, made: Collection[str] | None
) -> list[str]:
    """Drop artifacts that are not of the config's recordings, or not of the run; say which."""
    named = {} if config is None else config.data.files
    dropped: dict[str, list[str]] = {}
    for name, artifact in artifacts.items():
        unnamed = [
            kind for kind in artifact.record.ancestors if kind in RECORDED and kind not in named
        ]
        if named and unnamed:
            dropped.setdefault(f"the config names no {unnamed[0]} recording", []).append(name)
        elif made is not None and name not in (*made, *CURVES):
            dropped.setdefault("left from an earlier run", []).append(name)
    for name in itertools.chain.from_iterable(dropped.values()):
        del artifacts[name]
    return [
        f"{', '.join(f'{name}.parquet' for name in names)}: not shown, {why}"
        for why, names in dropped.items()
    ]


def completed(results: BeltResults) -> BeltResults:
    """Add the simulated contact along the arc of typical runs."""
    profiles, problems = arc_profiles(results.sheets)
    return replace(results, profiles=profiles, problems=(*results.problems, *problems))


def arc_profiles(sheets: Mapping[str, Sheet]) -> tuple[tuple[ArcProfile, ...], list[str]]:
    """Simulate the sliding contact of a typical run of each arc; return profiles and problems."""
    surface = sheets.get("surface_refined") or sheets.get("surface")
    simulated = sheets.get("simulated_refined") or sheets.get("simulated")
    stiffness, friction = sheets.get("stiffness"), sheets.get("friction")
    if surface is None or simulated is None or stiffness is None or friction is None:
        return (), []
    if "rig" not in simulated.record.settings:  # made in Python: the bench is not known
        return (), []
    arc_runs, problems = [], []
    try:
        bench = _bench(simulated.record.settings, stiffness, surface)
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
    sections = ("belt", "rig", "contact")
    config = load_config({name: settings[name] for name in sections if name in settings})
    return bench_of(config, surface.surface, stiffness.law(stiffness.pooled_row))

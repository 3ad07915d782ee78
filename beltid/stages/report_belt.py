"""beltid report: write the results of a belt as one page, and compare several belts.

The mark of a page says what it was made from. What draws and simulates is imported where a page is
written, so that a page in date costs nothing.
"""

import json
import math
import os
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from beltid import stages
from beltid._version import __version__
from beltid.config import ConfigSource, find_config, load_config
from beltid.errors import ArtifactError, BeltidError, InputError
from beltid.notes import log
from beltid.params import OperatingPoint
from beltid.report.results import BeltResults, Sheet
from beltid.report.summary import Summary
from beltid.stage import as_measured
from beltid.stages.steps import STAGES
from beltid.store.artifact import misfits, read_artifact, refuse_misfits
from beltid.store.disk import (
    FOREIGN,
    OURS,
    check_place,
    opened,
    read_bytes,
    sha256,
    source_sha256,
    write_bytes,
)

NAME = "report.html"
HEAD = 4096  # bytes at the beginning of a page that hold its generator and its mark
MARK = re.compile(
    r'<meta name="generator" content="beltid">\s*'
    r'<meta name="made-from" content="([0-9a-f]{64})">'
)
SEAL = "<!-- SHA-256 of all above: {} -->\n"  # last line of a page
ARTIFACTS = {
    **{kind: kind for kind in ("stiffness", "slip", "friction", "surface")},
    "surface_refined": "surface",
    "simulated": "simulated",
    "compare": "compare",
    "simulated_refined": "simulated",
    "compare_refined": "compare",
    **{kind: kind for kind in ("crossvalidation", "drive", "compare_drive")},
    **{kind: kind for kind in ("press_curves", "rig_curves")},
}
"""Artifacts that a report shows: file name -> kind."""
CURVES = ("press_curves", "rig_curves")  # artifacts that are not part of the chain


@dataclass(frozen=True, slots=True)
class OnPage:
    """A belt on a page, by the results in its folder."""

    folder: Path
    made: Collection[str] | None = None  # results that `run` has made or kept; others are hidden
    failures: tuple[str, ...] = ()  # stages that failed, each with its exit status and its message

    def is_left(self, name: str) -> bool:
        """Return whether an artifact is left from an earlier run."""
        return self.made is not None and name not in (*self.made, *CURVES)

    def content(self) -> list[Any]:
        """Return everything that a page is made from, as plain values."""
        shown = {}
        for name in ARTIFACTS:
            if (path := self.folder / f"{name}.parquet").exists():
                try:
                    shown[name] = sha256(read_bytes(path, ArtifactError))
                except ArtifactError as error:
                    shown[name] = str(error)
        folder, left = self.folder.resolve().name, [*filter(self.is_left, shown)]
        return [folder, shown, left, self.failures]


def run(
    folders: Sequence[Path], out: Path | None, config: Path | None = None, *, force: bool = False
) -> Summary:
    """Write the report of every belt, and for several belts a page `out` that compares them."""
    source = find_config(None, config) if config else None
    for folder in folders:
        if not folder.is_dir():
            raise ArtifactError(f"{folder}: there is no such folder of a belt's results")
    if len({os.path.realpath(folder) for folder in folders}) < len(folders):
        raise InputError("a folder is given twice, each belt must be given once")
    if source is not None:
        for folder in folders:
            if len(folders) == 1 or source.config.belt.name == folder.resolve().name:
                keep_curves(source, folder, force=force)
    belts = [OnPage(folder) for folder in folders]
    pages = {belt.folder / NAME: [belt] for belt in belts if len(belts) > 1}
    above = Path(os.path.commonpath([folder.absolute().parent for folder in folders]))
    pages[out or (above if pages else folders[0]) / NAME] = belts
    return [write_page(of, p, mark_to_write(of, p, force=force)) for p, of in pages.items()][-1]


def links_to(belts: Sequence[OnPage], out: Path) -> list[str]:
    """Return the links of a page that compares belts to their own pages."""
    return [
        quote(Path(os.path.relpath(belt.folder / NAME, out.absolute().parent)).as_posix())
        for belt in belts
    ]


def mark_to_write(belts: Sequence[OnPage], out: Path, *, force: bool) -> str:
    """Return the mark of a page of belts; empty if that at `out` is up to date and not edited."""
    check_place(
        out, (".html", ".htm"), lambda page: OURS if mark_of(page) else FOREIGN, force=force
    )
    links = links_to(belts, out) if len(belts) > 1 else []
    record = [__version__, source_sha256(of_page=True), links, [belt.content() for belt in belts]]
    mark = sha256(json.dumps(record).encode())
    if not force and out.exists() and mark_of(out) == mark:
        text = read_bytes(out, ArtifactError).decode("utf-8", "replace")
        if text == sealed(text[: -len(SEAL.format(mark))]):
            return ""
    return mark


def mark_of(page: Path) -> str | None:
    """Return the mark of a report page; None for any other file."""
    with opened(page, ArtifactError) as file:
        match = MARK.search(file.read(HEAD).decode("utf-8", "replace"))
    return match and match[1]


def sealed(text: str) -> str:
    """Return the text of a page with its last line."""
    return text + SEAL.format(sha256(text.encode()))


def keep_curves(source: ConfigSource, folder: Path, *, force: bool = False) -> None:
    """Store the curves that the figures need in the folder of a belt, if there are recordings."""
    data, friction = source.config.data, folder / "friction.parquet"
    wanted: dict[str, dict[str, Path]] = {}
    if data.press is not None and (folder / "stiffness.parquet").exists():
        wanted["press-curves"] = {"frame": data.press}
    if data.rig is not None and friction.exists():
        wanted["rig-curves"] = {"frame": data.rig, "friction": friction}
    for stage, files in ((STAGES[name], files) for name, files in wanted.items()):
        try:
            stage.run(source, files, folder / f"{stage.makes}.parquet", force=force)
        except BeltidError as error:
            for problem in error.problems:
                log.warning("no curves for the report: %s", problem)


def write_page(belts: Sequence[OnPage], out: Path, mark: str) -> Summary:
    """Write the page of a belt, or one that compares several with links; without a mark none."""
    from beltid.report.page import belt_page, belts_page, verdict_of

    facts, results = dict[str, Any](), [gather(belt) for belt in belts]
    if mark:
        if len(belts) > 1:
            page = belts_page(results, links_to(belts, out), mark)
        else:
            profiles, problems = arc_profiles(results[0].sheets)
            problems = [*results[0].problems, *problems]
            results = [replace(results[0], profiles=profiles, problems=tuple(problems))]
            page = belt_page(results[0], mark)
        write_bytes(out, sealed(page).encode())
        facts = {
            "figures": page.count("<figure "),
            "figures_missing": page.count('<p class="absent">'),
            "size_kB": out.stat().st_size / 1000.0,
        }
    origins = {result.origin for result in results}
    mixed = len(origins) > 1
    return Summary(
        stage="report",
        title="what was identified, how well it agrees, and how far to trust it",
        out=out,
        facts=facts,
        table=[_row(result) | ({"origin": result.origin} if mixed else {}) for result in results],
        warnings=tuple(f"{result.belt}: {line}" for result in results for line in result.problems),
        verdict=verdict_of(results[0])[0] if len(results) == 1 else "",
        up_to_date=not mark,
        origin=None if mixed else next(iter(origins)),
    )


def _row(results: BeltResults) -> dict[str, Any]:
    row: dict[str, Any] = {"belt": results.belt, "artifacts": len(results.sheets)}
    for name, prefix in (("compare", ""), ("compare_refined", "refined_")):
        sheet = results.get(name)
        row[f"{prefix}rms_percent"] = sheet.overall.get("rms_percent") if sheet else None
        row[f"{prefix}within_tolerance"] = bool(sheet.record.passed) if sheet else None
    return row


def gather(belt: OnPage) -> BeltResults:
    """Read the results of a belt, which must fit together; those not shown are its problems."""
    shown, left, problems = dict[str, Sheet](), dict[str, Sheet](), list[str]()
    for name, kind in ARTIFACTS.items():
        path = belt.folder / f"{name}.parquet"
        if not path.exists():
            continue
        try:
            sheet = Sheet.of(read_artifact(path, kind))
        except ArtifactError as error:
            problems += error.problems
        else:
            (left if belt.is_left(name) else shown)[name] = sheet
    if left:
        files = ", ".join(sheet.path.name for sheet in left.values())
        problems.append(f"{files}: not shown, left from an earlier run")
    refuse_misfits(artifact for name, artifact in shown.items() if name not in CURVES)
    for name in [name for name in CURVES if name in shown]:
        if lines := misfits([*(shown[n] for n in shown if n not in CURVES), shown[name]]):
            problems += lines
            del shown[name]
    if not shown:
        raise ArtifactError(
            problems
            or f"{belt.folder}: contains no results of a belt; `beltid run CONFIG` creates them"
        )
    stated = next(filter(None, (of.record.settings.get("belt") for of in shown.values())), None)
    return BeltResults(
        belt=belt.folder.resolve().name,
        sheets=shown,
        problems=tuple(problems),
        failures=belt.failures,
        belt_facts=() if stated is None else (stated["type"], f"{stated['ribs']} ribs"),
    )


def arc_profiles(sheets: Mapping[str, Sheet]) -> tuple[tuple[dict[str, Any], ...], list[str]]:
    """Simulate the sliding contact of a typical run of each arc; return profiles and problems."""
    from beltid.rig.runs import SimulationSettings, simulate

    surface = sheets.get("surface_refined") or sheets.get("surface")
    simulated = sheets.get("simulated_refined") or sheets.get("simulated")
    stiffness, friction = sheets.get("stiffness"), sheets.get("friction")
    if surface is None or simulated is None or stiffness is None or friction is None:
        return (), []
    settings, found = simulated.record.settings, list[dict[str, Any]]()
    if "rig" not in settings:  # made in Python: the bench is not known
        return (), []
    of_bench = {name: of for name, of in settings.items() if name in ("belt", "rig", "contact")}
    try:
        config, law = load_config(of_bench), stiffness.law(stiffness.pooled_row)
        bench = stages.rig.bench_of(as_measured(config, friction), surface.surface, law)
        names = ("arc_deg", "initial_tension_N", "slip_speed_m_s")
        for row in stages.friction.typical_runs(friction.columns):
            of_run = {name: float(friction[name][row]) for name in names}
            arc, tension, speed = of_run.values()
            point = OperatingPoint(math.radians(arc), tension, speed / bench.rig.R)
            run = simulate(bench, point, SimulationSettings(method="steady"))
            profile = {name: np.asarray(x, dtype=float) for name, x in run.profile.items()}
            found.append({**profile, **of_run, "mean_force_N_m": run.normal_force_N_m})
    except BeltidError as error:
        return tuple(found), [f"the contact along the arc: {line}" for line in error.problems]
    return tuple(found), []

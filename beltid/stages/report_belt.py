"""beltid report: write the results of a belt as one page, and compare several belts."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from beltid._version import __version__
from beltid.config import ConfigSource, find_config
from beltid.errors import ArtifactError, BeltidError, InputError
from beltid.notes import log
from beltid.report.html import GENERATOR, rendered
from beltid.report.page import Page, belt_page, belts_page
from beltid.report.results import BeltResults
from beltid.report.summary import Summary
from beltid.report.verdict import verdict_of
from beltid.stages.belt_results import check_folder, completed, config_of, gather
from beltid.stages.steps import press_curves, rig_curves
from beltid.store.disk import page_source_sha256, read_bytes, sha256, write_text
from beltid.store.place import FOREIGN, OURS, check_place

NAME: Final = "report.html"
STAGE: Final = "report"
SUFFIXES: Final = (".html", ".htm")
HEAD: Final = 4096
"""Bytes at the beginning of a page that hold its generator and the hash of its inputs."""
MARK: Final = re.compile(
    rf'<meta name="generator" content="{GENERATOR}">\s*'
    r'<meta name="made-from" content="([0-9a-f]{64})">'
)
SEAL: Final = "<!-- SHA-256 of all above: {} -->\n"
"""Last line of a page."""
EMPTY_SEAL: Final = SEAL.format("0" * 64)


def run(
    folders: Sequence[Path], out: Path | None, config: Path | None = None, *, force: bool = False
) -> Summary:
    """Write the report of every belt, and for several belts a page that compares them.

    Parameters
    ----------
    folders : sequence of Path
        Folders of the results, one per belt.
    out : Path or None
        Output page; for several belts the one that compares them. By default report.html in the
        folder of the belt, or in the folder above for several belts.
    config : Path, optional
        Config that names the recordings of a belt, for its figures over time.
    force : bool
        Whether to draw pages that are up to date, and to replace another HTML file.

    Raises
    ------
    ArtifactError
        If there is no such folder, it holds no results, or a page cannot be written.
    InputError
        If the output path holds a file that is not a report.
    """
    source = find_config(None, config) if config else None
    for folder in folders:
        check_folder(folder)
    distinct = {os.path.realpath(folder) for folder in folders}
    if len(distinct) < len(folders):
        raise InputError("a folder is given twice, each belt must be given once")
    if source is not None:
        for folder in folders:
            if len(folders) == 1 or source.config.belt.name == folder.resolve().name:
                keep_curves(source, folder, force=force)
    if len(folders) == 1:
        return of_belt(folders[0], out or folders[0] / NAME, force=force)
    single = [of_belt(folder, folder / NAME, force=force) for folder in folders]
    belts = {folder: gather(folder, config_of(folder)) for folder in folders}
    comparison = of_belts(belts, out or _parent_folder(folders) / NAME, force=force)
    if comparison.up_to_date and not all(summary.up_to_date for summary in single):
        log.info("%s is up to date", comparison.out)
    return comparison


def _parent_folder(folders: Sequence[Path]) -> Path:
    return Path(os.path.commonpath([folder.absolute().parent for folder in folders]))


def keep_curves(source: ConfigSource, folder: Path, *, force: bool = False) -> None:
    """Store the curves that the figures need in the folder of a belt, if there are recordings."""
    data, friction = source.config.data, folder / "friction.parquet"
    wanted: list[tuple[Any, dict[str, Path]]] = []
    if data.press is not None and (folder / "stiffness.parquet").exists():
        wanted.append((press_curves, {"frame": data.press}))
    if data.rig is not None and friction.exists():
        wanted.append((rig_curves, {"frame": data.rig, "friction": friction}))
    for stage, files in wanted:
        try:
            stage.run(source, files, folder / f"{stage.makes}.parquet", force=force)
        except BeltidError as error:
            for problem in error.problems:
                log.warning("no curves for the report: %s", problem)


def reported_in(folder: Path) -> list[Path]:
    """Return the subfolders that hold the report of a belt, from this call or an earlier one.

    The page that compares belts thus keeps those of earlier calls.
    """
    return [
        page.parent
        for page in sorted(folder.glob(f"*/{NAME}"))
        if not page.parent.is_symlink() and mark_of(page)
    ]


def of_chain(
    source: ConfigSource,
    made: Collection[str],
    folder: Path,
    failures: tuple[str, ...] = (),
    *,
    force: bool = False,
) -> Summary:
    """Write the report of a belt after its chain, of the results made; `failures` stand on top."""
    keep_curves(source, folder, force=force)
    return of_belt(folder, folder / NAME, made, failures, force=force)


def of_belt(
    folder: Path,
    out: Path,
    made: Collection[str] | None = None,
    failures: tuple[str, ...] = (),
    *,
    force: bool = False,
) -> Summary:
    """Write the report of one belt, unless it is up to date; see `gather`."""
    results = gather(folder, config_of(folder), made, failures)
    made_from = hash_of([results])
    if up_to_date(out, made_from, force=force):
        return _finish([results], out)
    results = completed(results)
    return _finish([results], out, belt_page(results, made_from))


def of_belts(belts: Mapping[Path, BeltResults], out: Path, *, force: bool = False) -> Summary:
    """Write the page that compares belts, by the folders of their pages, if not up to date."""
    links = [
        quote(Path(os.path.relpath(folder / NAME, out.absolute().parent)).as_posix())
        for folder in belts
    ]
    results = list(belts.values())
    made_from = hash_of(results, *links)
    is_current = up_to_date(out, made_from, force=force)
    return _finish(results, out, None if is_current else belts_page(results, links, made_from))


def _finish(results: Sequence[BeltResults], out: Path, page: Page | None = None) -> Summary:
    """Write a new page, and summarise it; without one, that of an earlier call is up to date."""
    facts: dict[str, Any] = {}
    if page is not None:
        text = rendered(page)
        text += SEAL.format(sha256(text.encode()))
        write_text(out, text)
        facts = {
            "figures": sum(len(section.pictures) for section in page.sections),
            "figures_missing": sum(len(section.absent) for section in page.sections),
        }
        facts["size_kB"] = len(text.encode()) / 1000.0
    origins = {result.origin for result in results}
    mixed = len(origins) > 1
    return Summary(
        stage=STAGE,
        title="what was identified, how well it agrees, and how far to trust it",
        out=out,
        facts=facts,
        table=[
            {**row, "origin": result.origin} if mixed else row
            for result in results
            for row in [_row(result)]
        ],
        warnings=tuple(
            f"{result.belt}: {problem}" for result in results for problem in result.problems
        ),
        verdict=verdict_of(results[0]).headline if len(results) == 1 else "",
        up_to_date=page is None,
        origin=None if mixed else next(iter(origins)),
    )


def _row(results: BeltResults) -> dict[str, Any]:
    row: dict[str, Any] = {"belt": results.belt, "artifacts": len(results.sheets)}
    for name in ("compare", "compare_refined"):
        sheet = results.get(name)
        prefix = "refined_" if name.endswith("refined") else ""
        row[f"{prefix}rms_percent"] = sheet.overall.get("rms_percent") if sheet else None
        row[f"{prefix}within_tolerance"] = sheet.passed if sheet else None
    return row


def hash_of(belts: Sequence[BeltResults], *words: str) -> str:
    """Return the hash of everything that a page is made from: results, and further text on it."""
    contents = [
        (
            belt.belt,
            [(name, sheet.sha256) for name, sheet in belt.sheets.items()],
            (belt.problems, belt.failures, belt.belt_facts),
        )
        for belt in belts
    ]
    record = [__version__, page_source_sha256(), list(words), contents]
    return sha256(json.dumps(record).encode())


def mark_of(page: Path) -> str | None:
    """Return the hash of the inputs of a report page; None for any other file."""
    with page.open("rb") as file:
        match = MARK.search(file.read(HEAD).decode("utf-8", "replace"))
    return match and match[1]


def is_intact(page: Path) -> bool:
    """Return whether a report page is as it was written."""
    data = read_bytes(page, ArtifactError)
    seal = SEAL.format(sha256(data[: -len(EMPTY_SEAL)]))
    return data.endswith(seal.encode())


def up_to_date(out: Path, made_from: str, *, force: bool) -> bool:
    """Return whether the page at `out` is up to date; refuse to replace any other file."""

    def whose(page: Path) -> str:
        return OURS if mark_of(page) else FOREIGN

    check_place(out, SUFFIXES, whose, force=force)
    return not force and out.exists() and mark_of(out) == made_from and is_intact(out)

"""beltid report: write the results of a belt as one page, and compare several belts."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from beltid.config import find_config
from beltid.errors import InputError
from beltid.notes import log
from beltid.report.html import rendered
from beltid.report.page import Page, belt_page, belts_page
from beltid.report.results import BeltResults
from beltid.report.summary import Summary
from beltid.report.verdict import verdict_of
from beltid.stages.belt_results import check_folder, completed, gather
from beltid.stages.page_mark import (
    NAME,
    OnPage,
    config_of,
    keep_curves,
    links_to,
    made_from,
    sealed,
    up_to_date,
)
from beltid.store.disk import write_text

STAGE: Final = "report"


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
        belt = OnPage(folders[0], config_of(folders[0]))
        return of_belt(belt, out or belt.folder / NAME, force=force)
    belts = [OnPage(folder, config_of(folder)) for folder in folders]
    single = [of_belt(belt, belt.folder / NAME, force=force) for belt in belts]
    comparison = of_belts(belts, out or _parent_folder(folders) / NAME, force=force)
    if comparison.up_to_date and not all(summary.up_to_date for summary in single):
        log.info("%s is up to date", comparison.out)
    return comparison


def _parent_folder(folders: Sequence[Path]) -> Path:
    return Path(os.path.commonpath([folder.absolute().parent for folder in folders]))


def of_belt(belt: OnPage, out: Path, *, force: bool = False) -> Summary:
    """Write the report of one belt, unless it is up to date."""
    mark, results = made_from(belt), gather(belt)
    if up_to_date(out, mark, force=force):
        return _finish([results], out)
    results = completed(results)
    return _finish([results], out, belt_page(results, mark))


def of_belts(belts: Sequence[OnPage], out: Path, *, force: bool = False) -> Summary:
    """Write the page that compares belts, with links to their pages, unless it is up to date."""
    links = links_to(belts, out)
    mark, results = made_from(*belts, words=links), [gather(belt) for belt in belts]
    if up_to_date(out, mark, force=force):
        return _finish(results, out)
    return _finish(results, out, belts_page(results, links, mark))


def _finish(results: Sequence[BeltResults], out: Path, page: Page | None = None) -> Summary:
    """Write a new page, and summarise it; without one, that of an earlier call is up to date."""
    facts: dict[str, Any] = {}
    if page is not None:
        text = sealed(rendered(page))
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

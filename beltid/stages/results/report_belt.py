"""beltid report: the results of a belt as one page, and those of several belts side by side."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from beltid._version import __version__
from beltid.artifacts.file_bytes import page_source_sha256, read_bytes, sha256, write_text
from beltid.config import ConfigSource, find_config
from beltid.errors import ArtifactError, BeltidError, InputError
from beltid.report.belt_page import belt_page
from beltid.report.belts_page import belts_page
from beltid.report.html import GENERATOR, Page, rendered
from beltid.report.results import BeltResults
from beltid.report.summary import Summary
from beltid.report.verdict import verdict_of
from beltid.stages.build_artifact import FOREIGN, Stale
from beltid.stages.reporter import Options
from beltid.stages.results.belt_results import (
    ARTIFACTS,
    belt_facts,
    check_folder,
    config_of,
    gather,
)
from beltid.stages.results.recorded_curves import PRESS, RIG, press_curves, rig_curves

NAME: Final = "report.html"
STAGE: Final = "report"
SUFFIXES: Final = (".html", ".htm")
HEAD: Final = 4096
"""Bytes at the beginning of a page within which it tells what wrote it and from what."""
MARK: Final = re.compile(
    rf'<meta name="generator" content="{GENERATOR}">\s*'
    r'<meta name="made-from" content="([0-9a-f]{64})">'
)


def run(
    folders: Sequence[Path], out: Path | None, options: Options, config: Path | None = None
) -> Summary:
    """Write the report of every belt, and with several of them a page that compares them.

    Parameters
    ----------
    folders : sequence of Path
        Folders of the results, one per belt.
    out : Path or None
        The page; with several belts the one that compares them. By default report.html in the
        folder of a belt, and in the folder above for several.
    options : Options
        Force and reporter.
    config : Path, optional
        Config that names the recordings of a belt, for its figures over time.

    Raises
    ------
    ArtifactError
        If there is no such folder, nothing of ours in it, or a page cannot be written.
    InputError
        If a file that is no report of ours stands where one is to stand.
    """
    source = find_config(None, config) if config else None
    for folder in folders:
        check_folder(folder)
    different = {os.path.realpath(folder) for folder in folders}
    if len(different) < len(folders):
        raise InputError("a folder is named twice, each belt must be named once")
    if source is not None:
        for folder in folders:
            if len(folders) == 1 or source.config.belt.name == folder.resolve().name:
                keep_curves(source, folder, options)
    if len(folders) == 1:
        return of_belt(folders[0], out or folders[0] / NAME, options)
    single = [of_belt(folder, folder / NAME, options) for folder in folders]
    both = of_belts(folders, out or _above(folders) / NAME, options)
    if both.up_to_date and not all(summary.up_to_date for summary in single):
        options.reporter.report(f"{both.out} is up to date")
    return both


def _above(folders: Sequence[Path]) -> Path:
    return Path(os.path.commonpath([folder.absolute().parent for folder in folders]))


def keep_curves(source: ConfigSource, folder: Path, options: Options) -> None:
    """Keep in the folder of a belt what its figures need of the recordings, where they are."""
    data = source.config.data
    friction = folder / "friction.parquet"
    makers = []
    if data.press is not None and (folder / "stiffness.parquet").exists():
        press = data.press
        makers.append(lambda: press_curves(source, press, folder / f"{PRESS}.parquet", options))
    if data.rig is not None and friction.exists():
        rig = data.rig
        makers.append(lambda: rig_curves(source, rig, friction, folder / f"{RIG}.parquet", options))
    for maker in makers:
        try:
            maker()
        except BeltidError as error:
            for problem in error.problems:
                options.reporter.warn(f"no curves for the report: {problem}")


def reported_in(folder: Path) -> list[Path]:
    """Folders of belts below a folder that have a report of ours, of this call or an earlier one.

    So the page that compares belts keeps those of earlier calls.
    """
    return [
        page.parent
        for page in sorted(folder.glob(f"*/{NAME}"))
        if not page.parent.is_symlink() and mark_of(page) and _files(page.parent)
    ]


def of_chain(
    source: ConfigSource, inputs: Mapping[str, Path], out: Path, options: Options
) -> Summary:
    """Write the report of a belt whose chain has ended, from what stands in the folder of `out`.

    Raises
    ------
    Stale
        If it would have to be drawn and the options say only to look.
    """
    keep_curves(source, out.parent, options)
    return of_belt(out.parent, out, options)


def of_belt(folder: Path, out: Path, options: Options) -> Summary:
    """Write the report of one belt, unless it is up to date."""
    config = config_of(folder)
    told = (*belt_facts(config), (config and config.data.date) or "")
    made_from = hash_of(_files(folder), folder.resolve().name, *told)
    standing = up_to_date(out, made_from, options)
    results = gather(folder, with_profiles=not standing)
    if standing:
        return _summary([results], out, {}, up_to_date=True)
    if options.peek:
        raise Stale
    page = belt_page(results, made_from)
    size = write(out, page)
    return _summary([results], out, {**_counts(page), "size_kB": size / 1000.0})


def of_belts(folders: Sequence[Path], out: Path, options: Options) -> Summary:
    """Write the page that compares several belts, unless it is up to date."""
    links = [
        Path(os.path.relpath(folder / NAME, out.absolute().parent)).as_posix() for folder in folders
    ]
    files = [pair for folder in folders for pair in _files(folder)]
    made_from = hash_of(files, *links)
    standing = up_to_date(out, made_from, options)
    results = [gather(folder, with_profiles=False) for folder in folders]
    if standing:
        return _summary(results, out, {}, up_to_date=True)
    page = belts_page(results, links, made_from)
    size = write(out, page)
    return _summary(results, out, {**_counts(page), "size_kB": size / 1000.0})


def _files(folder: Path) -> list[tuple[str, Path]]:
    """Artifacts that stand in the folder of a belt."""
    paths = [(name, folder / f"{name}.parquet") for name in ARTIFACTS]
    return [(f"{folder.resolve().name}/{name}", path) for name, path in paths if path.is_file()]


def _counts(page: Page) -> dict[str, Any]:
    pictures = [picture for section in page.sections for picture in section.pictures]
    drawn = sum(picture.figure is not None for picture in pictures)
    return {"figures": drawn, "figures_missing": len(pictures) - drawn}


def _summary(
    results: Sequence[BeltResults], out: Path, facts: dict[str, Any], *, up_to_date: bool = False
) -> Summary:
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
        up_to_date=up_to_date,
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


def hash_of(files: Sequence[tuple[str, Path]], *words: str) -> str:
    """Hash of everything that a page is made from.

    Parameters
    ----------
    files : sequence of (str, Path)
        Name of each file within the page, and where it stands.
    *words : str
        What else the page says.
    """
    contents = [(name, sha256(read_bytes(path, ArtifactError))) for name, path in files]
    record = [__version__, page_source_sha256(), list(words), contents]
    return sha256(json.dumps(record).encode())


def mark_of(page: Path) -> str | None:
    """Hash of what a page of ours was made from; None for any other file."""
    with page.open("rb") as file:
        found = MARK.search(file.read(HEAD).decode("utf-8", "replace"))
    return found and found[1]


def up_to_date(out: Path, made_from: str, options: Options) -> bool:
    """Whether the page that stands at `out` may stay.

    Raises
    ------
    InputError
        If what stands there is no page of ours; with force, one that is no page at all.
    """
    if str(out) == "-":
        raise InputError("--out = -, must be a file: a page of several MB is not for stdout")
    if out.is_dir():
        raise ArtifactError(f"{out}: is a folder, name a file in it")
    if not out.exists():
        return False
    found, is_page = mark_of(out), out.suffix.lower() in SUFFIXES
    if found is None and not (options.force and is_page):
        how = ", or replace it with --force" if is_page else ""
        text = f"{out}: is {FOREIGN}, not replaced; name another --out{how}"
        raise InputError(text, code="not-replaced")
    return found == made_from and not options.force


def write(out: Path, page: Page) -> int:
    """Write a page, whole or not at all; its size in bytes."""
    text = rendered(page)
    write_text(out, text)
    return len(text.encode())

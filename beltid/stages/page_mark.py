"""The mark of a report page: what it was made from. Light, so that a page in date costs nothing."""

from __future__ import annotations

import contextlib
import json
import os
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from beltid._version import __version__
from beltid.config import Config, ConfigSource, find_config, load_config
from beltid.errors import ArtifactError, BeltidError, ConfigError
from beltid.notes import log
from beltid.store.artifact import Record, read_artifact
from beltid.store.disk import page_source_sha256, read_bytes, sha256
from beltid.store.place import FOREIGN, OURS, check_place

NAME: Final = "report.html"
SUFFIXES: Final = (".html", ".htm")
HEAD: Final = 4096
"""Bytes at the beginning of a page that hold its generator and its mark."""
MARK: Final = re.compile(
    r'<meta name="generator" content="beltid">\s*'
    r'<meta name="made-from" content="([0-9a-f]{64})">'
)
SEAL: Final = "<!-- SHA-256 of all above: {} -->\n"
"""Last line of a page."""
EMPTY_SEAL: Final = SEAL.format("0" * 64)
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
    "crossvalidation": "crossvalidation",
    "drive": "drive",
    "compare_drive": "compare_drive",
    "press_curves": "press_curves",
    "rig_curves": "rig_curves",
}
"""Artifacts that a report shows: file name -> kind."""
CURVES: Final = ("press_curves", "rig_curves")
"""Artifacts that are not part of the chain."""


@dataclass(frozen=True, slots=True)
class OnPage:
    """A belt on a page, by the results in its folder.

    Attributes
    ----------
    folder : Path
        The folder.
    config : Config or None
        Its config, if known; results of recordings that it does not name are not shown.
    made : collection of str, optional
        Names of the results that `run` has made or found up to date; others are not shown.
    failures : tuple of str
        Stages that failed, each with its exit status and its message.
    """

    folder: Path
    config: Config | None
    made: Collection[str] | None = None
    failures: tuple[str, ...] = ()

    @property
    def facts(self) -> tuple[str, ...]:
        """Type and number of ribs of the belt."""
        if self.config is None:
            return ()
        return self.config.belt.type, f"{self.config.belt.ribs} ribs"

    def content(self) -> list[Any]:
        """Return everything that a page is made from, as plain values."""
        shown, left_out = {}, []
        for name in ARTIFACTS:
            path = self.folder / f"{name}.parquet"
            if path.exists():
                try:
                    shown[name] = sha256(read_bytes(path, ArtifactError))
                except ArtifactError as error:
                    shown[name] = str(error)
                if self.made is not None and name not in (*self.made, *CURVES):
                    left_out.append(name)
        named = [] if self.config is None else sorted(self.config.data.files)
        name = self.folder.resolve().name
        return [name, shown, left_out, named, self.facts, self.failures]


def made_from(*belts: OnPage, words: Collection[str] = ()) -> str:
    """Return the mark of a page of belts, with further text on it."""
    record = [__version__, page_source_sha256(), list(words), [b.content() for b in belts]]
    return sha256(json.dumps(record).encode())


def links_to(belts: Sequence[OnPage], out: Path) -> list[str]:
    """Return the links of a page that compares belts to their own pages."""
    above = out.absolute().parent
    return [quote(Path(os.path.relpath(b.folder / NAME, above)).as_posix()) for b in belts]


def mark_of(page: Path) -> str | None:
    """Return the mark of a report page; None for any other file."""
    with page.open("rb") as file:
        match = MARK.search(file.read(HEAD).decode("utf-8", "replace"))
    return match and match[1]


def sealed(text: str) -> str:
    """Return the text of a page with its last line."""
    return text + SEAL.format(sha256(text.encode()))


def is_intact(page: Path) -> bool:
    """Return whether a report page is as it was written."""
    data = read_bytes(page, ArtifactError)
    seal = SEAL.format(sha256(data[: -len(EMPTY_SEAL)]))
    return data.endswith(seal.encode())


def up_to_date(out: Path, mark: str, *, force: bool) -> bool:
    """Return whether the page at `out` is up to date; refuse to replace any other file."""

    def whose(page: Path) -> str:
        return OURS if mark_of(page) else FOREIGN

    check_place(out, SUFFIXES, whose, force=force)
    return not force and out.exists() and mark_of(out) == mark and is_intact(out)


def reported_in(folder: Path) -> list[Path]:
    """Return the subfolders that hold the report of a belt, from this call or an earlier one.

    The page that compares belts thus keeps those of earlier calls.
    """
    return [
        page.parent
        for page in sorted(folder.glob(f"*/{NAME}"))
        if not page.parent.is_symlink() and mark_of(page)
    ]


def config_of(folder: Path) -> Config | None:
    """Return the config that the results in a folder were made with, or None if not found."""
    for name in ("friction", "stiffness", "slip"):
        try:
            record = read_artifact(folder / f"{name}.parquet", name).record
        except ArtifactError:
            continue
        source = config_of_results(folder, record)
        if source is not None:
            return source.config
    return None


def config_of_results(folder: Path, made_with: Record) -> ConfigSource | None:
    """Find the config that results were made with, by its hash; None if it is not found.

    The search covers the folder of the results, the current folder, the folders above them, and
    their subfolders ``configs``.
    """
    candidates = []
    with contextlib.suppress(ConfigError):
        candidates.append(find_config(folder / "stiffness.parquet"))
    name = made_with.config or ""
    folders = dict.fromkeys([Path(), *(Path(p) for p in folder.resolve().parents)])
    for parent in folders if name else ():
        for path in (parent / name, parent / "configs" / name):
            with contextlib.suppress(ConfigError):
                if path.is_file():
                    candidates.append(ConfigSource(load_config(path), f"{path}", path))
    sha256 = made_with.config_sha256
    return next((c for c in candidates if c.config.sha256 == sha256), None)


def keep_curves(source: ConfigSource, folder: Path, *, force: bool = False) -> None:
    """Store the curves that the figures need in the folder of a belt, if there are recordings."""
    from beltid.stage import STAGES
    from beltid.stages import steps  # noqa: F401  (registers the stages)

    data, friction = source.config.data, folder / "friction.parquet"
    wanted: list[tuple[Any, dict[str, Path]]] = []
    if data.press is not None and (folder / "stiffness.parquet").exists():
        wanted.append((STAGES["press-curves"], {"frame": data.press}))
    if data.rig is not None and friction.exists():
        wanted.append((STAGES["rig-curves"], {"frame": data.rig, "friction": friction}))
    for stage, files in wanted:
        try:
            stage.run(source, files, folder / f"{stage.makes}.parquet", force=force)
        except BeltidError as error:
            for problem in error.problems:
                log.warning("no curves for the report: %s", problem)

"""The mark of a report page: what it was made from. Light, so that a page in date costs nothing."""

import contextlib
import json
import os
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from beltid._version import __version__
from beltid.config import ConfigSource, find_config
from beltid.errors import ArtifactError, BeltidError, ConfigError
from beltid.notes import log
from beltid.stages.steps import STAGES
from beltid.store.artifact import read_artifact
from beltid.store.disk import FOREIGN, OURS, check_place, opened, read_bytes, sha256, source_sha256

NAME = "report.html"
HEAD = 4096  # bytes at the beginning of a page that hold its generator and its mark
MARK = re.compile(
    r'<meta name="generator" content="beltid">\s*'
    r'<meta name="made-from" content="([0-9a-f]{64})">'
)
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
    recordings: Collection[str] = ()  # kinds that its config names; results of others are hidden
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
        return [folder, shown, left, sorted(self.recordings), self.failures]


def links_to(belts: Sequence[OnPage], out: Path) -> list[str]:
    """Return the links of a page that compares belts to their own pages."""
    return [
        quote(Path(os.path.relpath(belt.folder / NAME, out.absolute().parent)).as_posix())
        for belt in belts
    ]


def mark_to_write(belts: Sequence[OnPage], out: Path, *, force: bool) -> str:
    """Return the mark of a page of belts; empty if that at `out` is up to date."""
    check_place(
        out, (".html", ".htm"), lambda page: OURS if mark_of(page) else FOREIGN, force=force
    )
    links = links_to(belts, out) if len(belts) > 1 else []
    record = [__version__, source_sha256(of_page=True), links, [belt.content() for belt in belts]]
    mark = sha256(json.dumps(record).encode())
    return "" if not force and out.exists() and mark_of(out) == mark else mark


def mark_of(page: Path) -> str | None:
    """Return the mark of a report page; None for any other file."""
    with opened(page, ArtifactError) as file:
        match = MARK.search(file.read(HEAD).decode("utf-8", "replace"))
    return match and match[1]


def recordings_of(folder: Path) -> Collection[str]:
    """Return the recordings that the config of a folder's results names; empty if not known."""
    with contextlib.suppress(ConfigError):
        config = find_config(folder / "stiffness.parquet").config
        for name in ("friction", "stiffness", "slip"):
            with contextlib.suppress(ArtifactError):
                made_with = read_artifact(folder / f"{name}.parquet", name).record.config_sha256
                return config.data.files if made_with == config.sha256 else ()
    return ()


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

"""Pages on the disk: whose they are, whether they are up to date, and how they are replaced."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from beltid._version import __version__
from beltid.artifacts.file_bytes import page_source_sha256, read_bytes, sha256, write_text
from beltid.errors import ArtifactError, InputError
from beltid.report.html import GENERATOR, Page, rendered
from beltid.stages.build_artifact import FOREIGN
from beltid.stages.reporter import Options

SUFFIXES: Final = (".html", ".htm")
HEAD: Final = 4096
"""Bytes at the beginning of a page within which it tells what wrote it and from what."""
MARK: Final = re.compile(
    rf'<meta name="generator" content="{GENERATOR}">\s*'
    r'<meta name="made-from" content="([0-9a-f]{64})">'
)


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


def is_ours(page: Path) -> bool:
    """Whether a page of ours stands there."""
    with page.open("rb") as file:
        return MARK.search(file.read(HEAD).decode("utf-8", "replace")) is not None


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
    with out.open("rb") as file:
        head = file.read(HEAD).decode("utf-8", "replace")
    found = MARK.search(head)
    if found is None and not (options.force and out.suffix.lower() in SUFFIXES):
        how = (
            "name another --out, or replace it with --force"
            if out.suffix.lower() in SUFFIXES
            else "name another --out"
        )
        raise InputError(f"{out}: is {FOREIGN}, not replaced; {how}", code="not-replaced")
    return found is not None and found[1] == made_from and not options.force


def write(out: Path, page: Page) -> int:
    """Write a page, whole or not at all; its size in bytes."""
    text = rendered(page)
    write_text(out, text)
    return len(text.encode())

"""Hash of our own sources, so that a changed installation is known from its version's twin."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Container
from pathlib import Path
from typing import Final

ONLY_SHOW: Final = ("cli", "report", "__main__.py")
"""Parts that show results and cannot change them."""
PAGES: Final = (".j2", ".css", ".js")
"""Sources of pages, beside modules."""


@functools.cache
def source_sha256() -> str:
    """SHA-256 of the sources of this installation; see `hash_of_sources`."""
    return hash_of_sources(Path(__file__).resolve().parents[1])


@functools.cache
def page_source_sha256() -> str:
    """SHA-256 of all that can change a page: every source, that of the pages themselves, too."""
    return hash_of_sources(Path(__file__).resolve().parents[1], but=("cli",), more=PAGES)


def hash_of_sources(
    package: Path, but: Container[str] = ONLY_SHOW, more: tuple[str, ...] = ()
) -> str:
    """SHA-256 of the names and contents of all modules that can change a result.

    Line ends do not matter. Empty if there are no sources to read (a packed installation).

    Parameters
    ----------
    package : Path
        Folder of the package.
    but : container of str
        Rooms that cannot change the result.
    more : tuple of str
        Endings of further files that can.
    """
    sources = sorted(
        (path.relative_to(package).as_posix(), path)
        for path in package.rglob("*")
        if path.suffix in (".py", *more) and path.relative_to(package).parts[0] not in but
    )
    if not sources:
        return ""
    digest = hashlib.sha256()
    for name, path in sources:
        content = path.read_bytes().replace(b"\r\n", b"\n")
        digest.update(f"{name}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()

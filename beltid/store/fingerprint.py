"""Hash of our own sources, so that a changed installation is known from its version's twin."""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path
from typing import Final

ONLY_SHOW: Final = ("cli", "report", "__main__.py")
"""Parts that show results and cannot change them."""


@functools.cache
def source_sha256() -> str:
    """SHA-256 of the sources of this installation; see `hash_of_sources`."""
    return hash_of_sources(Path(__file__).resolve().parents[1])


def hash_of_sources(package: Path) -> str:
    """SHA-256 of the names and contents of all modules that can change a result.

    Line ends do not matter. Empty if there are no sources to read (a packed installation).

    Parameters
    ----------
    package : Path
        Folder of the package.
    """
    sources = sorted(
        (path.relative_to(package).as_posix(), path)
        for path in package.rglob("*.py")
        if path.relative_to(package).parts[0] not in ONLY_SHOW
    )
    if not sources:
        return ""
    digest = hashlib.sha256()
    for name, path in sources:
        content = path.read_bytes().replace(b"\r\n", b"\n")
        digest.update(f"{name}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()

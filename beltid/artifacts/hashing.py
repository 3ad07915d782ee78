"""SHA-256 of bytes, of tables, and of our own sources.

By the hash of the sources a changed installation is known from its version's twin.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Container, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

ONLY_SHOW: Final = ("cli", "report", "__main__.py")
"""Parts that show results and cannot change them."""
PAGES: Final = (".j2", ".css", ".js")
"""Sources of pages, beside modules."""


def sha256(data: bytes | memoryview) -> str:
    """SHA-256 of some bytes, as 64 hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def columns_sha256(columns: Mapping[str, np.ndarray]) -> str:
    """SHA-256 of the names, types and values of the columns of a table, in their order.

    Missing numbers hash alike whatever kind of nan stands for them; numbers hash by their bits in
    little-endian order, so the hash is the same on every machine.

    Parameters
    ----------
    columns : mapping of str to ndarray
        float64, int64 or bool arrays, 1-D or 2-D, or object arrays of str or None.
    """
    digest = hashlib.sha256()
    for name, values in columns.items():
        digest.update(f"{name}\0{values.dtype.kind}{values.shape}\0".encode())
        digest.update(_bytes(values))
    return digest.hexdigest()


def _bytes(values: np.ndarray[Any, Any]) -> bytes:
    if values.dtype.kind == "O":
        cells = [b"\0" if cell is None else b"\1" + str(cell).encode() for cell in values]
        return b"".join(len(cell).to_bytes(8, "little") + cell for cell in cells)
    if values.dtype.kind == "f":
        clean = np.where(np.isnan(values), np.nan, values)
        return clean.astype("<f8").tobytes()
    if values.dtype.kind == "b":
        return values.astype("u1").tobytes()
    return values.astype("<i8").tobytes()


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

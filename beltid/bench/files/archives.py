"""Unpack recordings: one file packed with gzip, or several in a zip file."""

from __future__ import annotations

import gzip
import io
import re
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Final

from beltid.artifacts.file_bytes import MAX_BYTES
from beltid.errors import InputError

MAX_FILES: Final = 5000
MAX_RATIO: Final = 1000
"""Largest compression ratio in a zip file: recordings never reach it, zip bombs do."""


def unpacked(data: bytes, path: Path) -> bytes:
    """Unpack the bytes of a gzip file.

    Raises
    ------
    InputError
        If the file is damaged, empty, or unpacks to more than the limit.
    """
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(data)) as file:
            plain = file.read(MAX_BYTES + 1)
    except (OSError, EOFError, zlib.error):
        raise InputError(f"{path}: the gzip file is damaged or cut off") from None
    if len(plain) > MAX_BYTES:
        raise InputError(f"{path}: unpacks to more than {MAX_BYTES >> 20} MB, split the recording")
    if not plain:
        raise InputError(f"{path}: the file is empty")
    return plain


def natural(name: str) -> tuple[tuple[int, str], ...]:
    """Return a sort key that puts run2 before run10."""
    parts = re.split(r"([0-9]{1,18})", name)  # int() sees digits only
    return tuple((int(p), "") if i % 2 else (-1, p) for i, p in enumerate(parts) if p)


def members(data: bytes, path: Path) -> Iterator[str]:
    """Yield the file names in a zip file in natural order; InputError if it is refused."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = [e for e in archive.infolist() if not e.is_dir()]
    except Exception:  # a damaged file can raise nearly anything
        raise InputError(f"{path}: the zip file is damaged or cut off") from None
    names = [
        e.filename
        for e in entries
        if not PurePosixPath(e.filename).name.startswith(".")
        and not e.filename.startswith("__MACOSX/")
    ]
    if not names:
        raise InputError(f"{path}: the zip file is empty")
    if len(names) > MAX_FILES:
        raise InputError(f"{path}: holds {len(names)} files, must be at most {MAX_FILES}")
    endings = {PurePosixPath(name).suffix.lower() for name in names}
    if len(endings) > 1:
        raise InputError(
            f"{path}: holds files of several kinds ({', '.join(sorted(endings))}); "
            "pack only the runs, all of one format"
        )
    total = sum(e.file_size for e in entries)
    if total > MAX_BYTES:
        raise InputError(f"{path}: unpacks to more than {MAX_BYTES >> 20} MB, split the recording")
    for entry in entries:
        if entry.file_size > MAX_RATIO * max(entry.compress_size, 1) and entry.file_size > 1 << 20:
            raise InputError(f"{path}: {entry.filename} is compressed more than {MAX_RATIO} to 1")
    yield from sorted(names, key=natural)


def member_bytes(data: bytes, path: Path, member: str) -> bytes:
    """Unpack one file of a zip file; InputError if it is damaged, empty or too large."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive, archive.open(member) as file:
            plain = file.read(MAX_BYTES + 1)
    except Exception as error:  # each compression method raises its own errors
        raise InputError(f"{path}: {member} in the zip file cannot be unpacked: {error}") from None
    if len(plain) > MAX_BYTES:
        raise InputError(f"{path}: unpacks to more than {MAX_BYTES >> 20} MB, split the recording")
    if not plain:
        raise InputError(f"{path}: {member} in the zip file is empty")
    return plain

"""Packed recordings: one file packed with gzip, several in a zip file."""

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
"""Most by which a file in a zip file may be packed: recordings never reach it, bombs do."""


def unpacked(data: bytes, path: Path) -> bytes:
    """Bytes of a gzip file without the packing.

    Raises
    ------
    InputError
        If the packed file is damaged or unpacks to more than the limit.
    """
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(data)) as file:
            plain = file.read(MAX_BYTES + 1)
    except (OSError, EOFError, zlib.error):
        raise InputError(f"{path}: the gzip file is damaged or cut off", code="damaged") from None
    if len(plain) > MAX_BYTES:
        raise InputError(f"{path}: unpacks to more than {MAX_BYTES >> 20} MB, split the recording")
    if not plain:
        raise InputError(f"{path}: the file is empty")
    return plain


def natural(name: str) -> tuple[tuple[int, str], ...]:
    """Key that sorts run2 before run10."""
    parts = re.split(r"([0-9]{1,18})", name)  # int() is for these only
    return tuple((int(p), "") if i % 2 else (-1, p) for i, p in enumerate(parts) if p)


def members(data: bytes, path: Path) -> Iterator[str]:
    """Names of the files in a zip file, in the order a person counts; InputError if refused."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = [e for e in archive.infolist() if not e.is_dir()]
    except Exception:  # a damaged file can raise nearly anything
        raise InputError(f"{path}: the zip file is damaged or cut off", code="damaged") from None
    names = [
        e.filename
        for e in entries
        if not PurePosixPath(e.filename).name.startswith(".")
        and not e.filename.startswith("__MACOSX/")
    ]
    if not names:
        raise InputError(f"{path}: the zip file is empty")
    if len(names) > MAX_FILES:
        raise InputError(f"{path}: holds {len(names)} files, at most {MAX_FILES} are read")
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
            raise InputError(f"{path}: {entry.filename} is packed more than {MAX_RATIO} times")
        if entry.flag_bits & 1:
            raise InputError(f"{path}: {entry.filename} is locked with a password")
    yield from sorted(names, key=natural)


def member_bytes(data: bytes, path: Path, member: str) -> bytes:
    """Bytes of one file in a zip file; InputError if it is damaged, empty or too large."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive, archive.open(member) as file:
            plain = file.read(MAX_BYTES + 1)
    except Exception:  # each way of packing has errors of its own
        raise InputError(
            f"{path}: {member} in the zip file is damaged or cut off", code="damaged"
        ) from None
    if len(plain) > MAX_BYTES:
        raise InputError(f"{path}: unpacks to more than {MAX_BYTES >> 20} MB, split the recording")
    if not plain:
        raise InputError(f"{path}: {member} in the zip file is empty")
    return plain

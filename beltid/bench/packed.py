"""Bytes of files: which format they are, unpacking within a limit, texts in any encoding."""

from __future__ import annotations

import codecs
import contextlib
import gzip
import re
import zipfile
from pathlib import Path, PurePosixPath
from typing import IO, Final, cast

from beltid.errors import InputError
from beltid.store.disk import MAX_BYTES, opened

MAX_FILES: Final = 5000
CUT_OFF: Final = "the last line does not end: if the file was cut off, its last number is wrong"
_SIGNATURES: Final = (
    (b"PAR1", "parquet"),
    (b"\x1f\x8b", "gzip"),
    (b"TDSm", "tdms"),
    (b"MDF     ", "mdf"),
    (b"UnFinMF ", "mdf"),
    (b"\x89HDF\r\n\x1a\n", "hdf5"),
    (b"MATLAB 5.0 MAT-file", "mat"),
    (b"LabVIEW Measurement", "lvm"),
    (b"\xef\xbb\xbfLabVIEW Measurement", "lvm"),
)
_UFF: Final = re.compile(rb"\s*-1[ \t]*\r?\n[ \t]{0,6}\d{1,5}[bB]?[ \t\r\n]")
"""A line with -1, then a line with the number of a dataset."""


def format_of(path: Path, name: str = "") -> str:
    """Return the format of a file, from its bytes: "text", "parquet", "gzip", "zip", "lvm", ...

    The name decides only where the bytes do not (MATLAB 4).
    """
    with opened(path) as file:
        head = file.read(1024)
    found = next((form for sign, form in _SIGNATURES if head.startswith(sign)), "")
    if found:
        return found
    if head[512:520] == b"\x89HDF\r\n\x1a\n":  # MATLAB 7.3 puts its own header first
        return "hdf5"
    if head.startswith((b"PK\x03\x04", b"PK\x05\x06")):
        data = path.read_bytes()  # also of a damaged archive
        return "excel" if b"xl/workbook" in data or b"xl/worksheets" in data else "zip"
    if head[124:128] in (b"\x00\x01IM", b"\x01\x00MI") or name.lower().endswith(".mat"):
        return "mat"
    return "uff" if _UFF.match(head) else "text"


def members(path: Path, shown: str) -> list[str]:
    """Return the names of the files in a zip file in natural order; InputError if it is refused."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = [e.filename for e in archive.infolist() if not e.is_dir()]
    except Exception:  # a damaged file can raise nearly anything
        raise InputError(f"{shown}: the zip file is damaged or cut off") from None
    names = [
        name
        for name in names
        if PurePosixPath(name).name[0] != "." and not name.startswith("__MACOSX/")
    ]
    if not 0 < len(names) <= MAX_FILES:
        raise InputError(f"{shown}: holds {len(names)} files, must be 1 to {MAX_FILES}")
    endings = {PurePosixPath(name).suffix.lower() for name in names}
    if len(endings) > 1:
        raise InputError(
            f"{shown}: holds files of several kinds ({', '.join(sorted(endings))}); "
            "pack only the runs, all of one format"
        )
    return sorted(names, key=natural)


def natural(name: str) -> tuple[tuple[int, str], ...]:
    """Return a sort key that puts run2 before run10."""
    parts = re.split(r"([0-9]{1,18})", name)  # int() sees digits only
    return tuple((int(p), "") if i % 2 else (-1, p) for i, p in enumerate(parts) if p)


def unpack(path: Path, out: Path, shown: str, member: str = "") -> None:
    """Unpack a gzip file, or a file in a zip file, in parts and up to a limit."""
    try:
        with opened(path) as file, out.open("wb") as target, contextlib.ExitStack() as stack:
            written, stream = 0, stack.enter_context(_stream(file, member))
            while (part := stream.read(1 << 22)) and written <= MAX_BYTES:
                written += len(part)
                target.write(part if written <= MAX_BYTES else b"")
    except InputError:
        raise
    except Exception:  # each compression method raises its own errors
        what = f"{member} in the zip file cannot be unpacked" if member else "the gzip file is"
        raise InputError(f"{shown}: {what} damaged or cut off") from None
    if written > MAX_BYTES:
        raise InputError(f"{shown}: unpacks to more than {MAX_BYTES >> 20} MB, split the recording")
    if not written:
        raise InputError(f"{shown}: the file is empty")


def _stream(file: IO[bytes], member: str) -> IO[bytes]:
    """Open what is packed in a zip file or by gzip."""
    return zipfile.ZipFile(file).open(member) if member else cast(IO[bytes], gzip.open(file))


def as_utf8(data: bytes, place: str, stated: str | None) -> tuple[bytes, str, list[str]]:
    """Return a text as UTF-8 with single line feeds, its encoding, and notes.

    A file that is not UTF-8 is read as latin-1 only if all western European encodings that
    measuring computers use (latin-1, cp1252) give the same text.
    """
    notes: list[str] = []
    encoding = (stated or "utf-8").lower()
    if data[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        encoding = "utf-16"
    elif data.startswith(codecs.BOM_UTF8):  # the mark overrides the config
        encoding, data = "utf-8", data[3:]
    elif not stated and len(data) > 3 and b"\0" in (data[1:2], data[:1]) and b"\0" in data[2:4]:
        encoding = "utf-16-le" if data[1] == 0 else "utf-16-be"  # of ASCII letters, without a mark
    if encoding != "utf-8" or not data.isascii():
        try:
            data = data.decode(encoding).encode()
        except UnicodeDecodeError as error:
            is_windows = any(0x80 <= byte < 0xA0 for byte in data.translate(None, bytes(128)))
            if stated or is_windows or b"\0" in data:
                line = data[: error.start].count(b"\n") + 1
                hint = "" if stated else "; if it is of Windows, set dialect: {encoding: cp1252}"
                raise InputError(
                    f"{place}:{line}: byte 0x{data[error.start]:02X} is not "
                    f"{stated or 'UTF-8'}{hint}; if it is no text, export it to CSV"
                ) from None
            data, encoding = data.decode("latin-1").encode(), "latin-1"
            notes.append("not UTF-8, read as latin-1")
    if b"\0" in data:
        line = data.count(b"\n", 0, data.index(b"\0")) + 1
        raise InputError(
            f"{place}:{line}: contains a zero byte: damaged, or no text; export it to CSV"
        )
    if data and data[-1:] not in b"\r\n":
        notes.append(CUT_OFF)
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return data, encoding, notes

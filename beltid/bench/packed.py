"""Bytes of files: which format they are, unpacking within a limit, texts in any encoding."""

from __future__ import annotations

import codecs
import gzip
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import IO, Final

from beltid.errors import InputError
from beltid.store.disk import MAX_BYTES, opened

MAX_FILES: Final = 5000
MAX_RATIO: Final = 1000
"""Largest compression ratio in a zip file: recordings never reach it, zip bombs do."""
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
        return "excel" if _is_workbook(path) else "zip"
    if head[124:128] in (b"\x00\x01IM", b"\x01\x00MI") or name.lower().endswith(".mat"):
        return "mat"
    return "uff" if _UFF.match(head) else "text"


def _is_workbook(path: Path) -> bool:
    try:
        with zipfile.ZipFile(path) as archive:
            return any(name.startswith("xl/") for name in archive.namelist())
    except Exception:  # a damaged file can raise nearly anything
        data = path.read_bytes()
        return b"xl/workbook.xml" in data or b"xl/worksheets" in data


def members(path: Path, shown: str) -> list[str]:
    """Return the names of the files in a zip file in natural order; InputError if it is refused."""
    try:
        with zipfile.ZipFile(path) as archive:
            entries = [e for e in archive.infolist() if not e.is_dir()]
    except Exception:  # a damaged file can raise nearly anything
        raise InputError(f"{shown}: the zip file is damaged or cut off") from None
    entries = [
        e
        for e in entries
        if not PurePosixPath(e.filename).name.startswith(".")
        and not e.filename.startswith("__MACOSX/")
    ]
    if not entries:
        raise InputError(f"{shown}: the zip file is empty")
    if len(entries) > MAX_FILES:
        raise InputError(f"{shown}: holds {len(entries)} files, must be at most {MAX_FILES}")
    endings = {PurePosixPath(e.filename).suffix.lower() for e in entries}
    if len(endings) > 1:
        raise InputError(
            f"{shown}: holds files of several kinds ({', '.join(sorted(endings))}); "
            "pack only the runs, all of one format"
        )
    if sum(e.file_size for e in entries) > MAX_BYTES:
        raise _too_large(shown)
    for e in entries:
        if e.file_size > MAX_RATIO * max(e.compress_size, 1) and e.file_size > 1 << 20:
            raise InputError(f"{shown}: {e.filename} is compressed more than {MAX_RATIO} to 1")
    return sorted((e.filename for e in entries), key=natural)


def natural(name: str) -> tuple[tuple[int, str], ...]:
    """Return a sort key that puts run2 before run10."""
    parts = re.split(r"([0-9]{1,18})", name)  # int() sees digits only
    return tuple((int(p), "") if i % 2 else (-1, p) for i, p in enumerate(parts) if p)


def unpack(path: Path, out: Path, shown: str, member: str = "") -> None:
    """Unpack a gzip file, or a file in a zip file, in parts and up to a limit.

    Raises
    ------
    InputError
        If it is damaged, empty, or unpacks to more than the limit.
    """
    written = 0
    try:
        with opened(path) as file, out.open("wb") as target:
            for part in _parts(file, member):
                written += len(part)
                if written > MAX_BYTES:
                    raise _too_large(shown)
                target.write(part)
    except InputError:
        raise
    except Exception:  # each compression method raises its own errors
        what = f"{member} in the zip file cannot be unpacked" if member else "the gzip file is"
        raise InputError(f"{shown}: {what} damaged or cut off") from None
    if not written:
        raise InputError(f"{shown}: the file is empty")


def _parts(file: IO[bytes], member: str) -> Iterator[bytes]:
    if member:
        with zipfile.ZipFile(file) as archive, archive.open(member) as stream:
            yield from iter(lambda: stream.read(1 << 22), b"")
    else:
        with gzip.GzipFile(fileobj=file) as unzipped:
            yield from iter(lambda: unzipped.read(1 << 22), b"")


def _too_large(shown: str) -> InputError:
    return InputError(f"{shown}: unpacks to more than {MAX_BYTES >> 20} MB, split the recording")


def as_utf8(data: bytes, place: str, stated: str | None) -> tuple[bytes, str, list[str]]:
    """Return a text as UTF-8 with single line feeds, its encoding, and notes.

    A file that is not UTF-8 is read as latin-1 only if all western European encodings that
    measuring computers use (latin-1, cp1252) give the same text.

    Raises
    ------
    InputError
        If the bytes are not text, are not in the encoding, or the encoding is ambiguous.
    """
    notes: list[str] = []
    encoding = (stated or "utf-8").lower()
    if data[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        encoding = "utf-16"
    elif data.startswith(codecs.BOM_UTF8):  # the mark overrides the config
        encoding, data = "utf-8", data[3:]
    elif b"\0" in data and not encoding.startswith(("utf-16", "utf-32")):
        for parity, order in ((1, "utf-16-le"), (0, "utf-16-be")):
            if len(data) > 1 and not any(data[parity:1000:2]):
                raise InputError(
                    f"{place}: looks like UTF-16 without a byte order mark: set "
                    f"dialect: {{encoding: {order}}}"
                )
        raise _zero_byte(place, data)
    if encoding not in ("utf-8", "utf8", "ascii") or not data.isascii():
        try:
            data = data.decode(encoding).encode()
        except UnicodeDecodeError as error:
            if stated or any(0x80 <= byte < 0xA0 for byte in data.translate(None, bytes(128))):
                line = data[: error.start].count(b"\n") + 1
                hint = "" if stated else "; if it is of Windows, set dialect: {encoding: cp1252}"
                raise InputError(
                    f"{place}:{line}: byte 0x{data[error.start]:02X} is not "
                    f"{stated or 'UTF-8'}{hint}"
                ) from None
            data, encoding = data.decode("latin-1").encode(), "latin-1"
            notes.append("not UTF-8, read as latin-1")
        if b"\0" in data:
            raise _zero_byte(place, data)
    if data and data[-1:] not in b"\r\n":
        notes.append(CUT_OFF)
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return data, encoding, notes


def _zero_byte(place: str, data: bytes) -> InputError:
    """Return the error of a zero byte; a recorder that loses power leaves them at its end."""
    lines = data.count(b"\n", 0, data.index(b"\0"))
    if not lines:
        return InputError(f"{place}: cannot be read; export it to CSV")
    return InputError(
        f"{place}:{lines + 1}: contains a zero byte: damaged, or no text; export it to CSV"
    )

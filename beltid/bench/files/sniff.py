"""Detect the format of a file from its bytes, not from its name, and decode text files."""

from __future__ import annotations

import codecs
import io
import re
import zipfile
from dataclasses import dataclass
from typing import Final

from beltid.errors import InputError

TEXT: Final = "text"
PARQUET: Final = "parquet"
GZIP: Final = "gzip"
ZIP: Final = "zip"
LVM: Final = "lvm"
UFF: Final = "uff"
ISOLATED: Final = ("tdms", "mdf", "mat", "hdf5", "xlsx")
"""Formats whose libraries can crash or hang on damaged input: read in a child process."""
_SIGNATURES: Final = (
    (b"PAR1", PARQUET),
    (b"\x1f\x8b", GZIP),
    (b"TDSm", "tdms"),
    (b"MDF     ", "mdf"),
    (b"UnFinMF ", "mdf"),
    (b"\x89HDF\r\n\x1a\n", "hdf5"),
    (b"MATLAB 5.0 MAT-file", "mat"),
    (b"LabVIEW Measurement", LVM),
    (b"\xef\xbb\xbfLabVIEW Measurement", LVM),
)
_UFF: Final = re.compile(rb"\s*-1[ \t]*\r?\n[ \t]{0,6}\d{1,5}[bB]?[ \t\r\n]")
"""A line with -1, then a line with the number of a dataset."""
_HDF5_BEHIND_HEADER: Final = slice(512, 520)
CUT_OFF: Final = "the last line does not end: if the file was cut off, its last number is wrong"


def sniff(data: bytes | memoryview, name: str = "") -> str:
    """Detect the format of a file.

    Parameters
    ----------
    data : bytes
        The first bytes of the file; all of them for a packed file.
    name : str
        Name of the file: used only if the content is not conclusive (.mat of version 4).

    Returns
    -------
    str
        "text", "parquet", "gzip", "zip", "lvm", "uff", or one of `ISOLATED`.
    """
    head = bytes(data[:1024])
    for signature, format_name in _SIGNATURES:
        if head.startswith(signature):
            return format_name
    if head[_HDF5_BEHIND_HEADER] == b"\x89HDF\r\n\x1a\n":  # MATLAB 7.3 puts its own header first
        return "hdf5"
    if head.startswith((b"PK\x03\x04", b"PK\x05\x06")):
        return "xlsx" if _is_workbook(bytes(data)) else ZIP
    if len(head) > 128 and head[124:128] in (b"\x00\x01IM", b"\x01\x00MI"):
        return "mat"  # with its own header text
    if name.lower().endswith(".mat"):
        return "mat"
    if _UFF.match(head):
        return UFF
    return TEXT


def _is_workbook(data: bytes) -> bool:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = archive.namelist()
    except Exception:  # a damaged file can raise nearly anything
        return b"xl/workbook.xml" in data or b"xl/worksheets" in data
    return "[Content_Types].xml" in names and any(name.startswith("xl/") for name in names)


@dataclass(frozen=True, slots=True)
class Decoded:
    """A text with single line feeds, the encoding that was used, and notes."""

    text: str
    encoding: str
    notes: tuple[str, ...] = ()


def decode(data: bytes, name: str, encoding: str | None = None) -> Decoded:
    """Decode the text of a file.

    A file that is not UTF-8 is read as latin-1 only if all western European encodings that
    measuring computers use (latin-1, cp1252) give the same text.

    Parameters
    ----------
    data : bytes
        The file.
    name : str
        Name of the file, for messages.
    encoding : str or None
        Encoding set by the user; None to detect it.

    Raises
    ------
    InputError
        If the bytes are not text, are not in the encoding, or the encoding is ambiguous.
    """
    if data[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        encoding = "utf-16"
    elif data[:3] == codecs.BOM_UTF8:  # the byte order mark overrides the config
        encoding = "utf-8"
    elif b"\0" in data[:65536] and not (encoding or "").lower().startswith(("utf-16", "utf-32")):
        for parity, order in ((1, "utf-16-le"), (0, "utf-16-be")):
            if not any(data[parity:1000:2]):
                raise InputError(
                    f"{name}: looks like UTF-16 without a byte order mark: set "
                    f"dialect: {{encoding: {order}}}",
                )
        raise _zero_byte(name, data.decode("latin-1"))
    used = encoding or "utf-8"
    notes: tuple[str, ...] = ()
    if used.lower().replace("_", "-") in ("utf-8", "utf8"):
        used = "utf-8-sig"
    try:
        text = data.decode(used)
    except UnicodeDecodeError as error:
        if encoding or _ambiguous(data):
            line = data[: error.start].count(b"\n") + 1
            hint = "" if encoding else "; if it is of Windows, set dialect: {encoding: cp1252}"
            raise InputError(
                f"{name}:{line}: byte 0x{data[error.start]:02X} is not {encoding or 'UTF-8'}{hint}",
            ) from None
        text, used = data.decode("latin-1"), "latin-1"
        notes = ("not UTF-8, read as latin-1",)
    if "\0" in text:
        raise _zero_byte(name, text)
    if text and text[-1] not in "\r\n":
        notes += (CUT_OFF,)
    text = text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text
    return Decoded(text, used.removesuffix("-sig"), notes)


def _zero_byte(name: str, text: str) -> InputError:
    """Return the error of a zero byte; a recorder that loses power leaves them at its end."""
    lines = text.count("\n", 0, text.index("\0"))
    if not lines:
        return InputError(f"{name}: cannot be read; export it to CSV")
    place = f"{name}:{lines + 1}"
    return InputError(f"{place}: contains a zero byte: damaged, or no text; export it to CSV")


def _ambiguous(data: bytes) -> bool:
    """Whether the encodings differ: those of DOS and Mac have letters at 0x80 to 0x9F."""
    return any(0x80 <= byte < 0xA0 for byte in data.translate(None, bytes(range(0x80))))

"""Which format some bytes are: by what they hold, whatever the file is called."""

from __future__ import annotations

import io
import zipfile
from typing import Final

TEXT: Final = "text"
PARQUET: Final = "parquet"
GZIP: Final = "gzip"
ZIP: Final = "zip"
LVM: Final = "lvm"
ISOLATED: Final = ("tdms", "mdf", "mat", "hdf5", "xlsx")
"""Formats whose libraries can crash or hang on damaged input: read in a child process."""
UNREAD: Final = {
    b"\xd0\xcf\x11\xe0": "an old Excel workbook (.xls), save it as .xlsx",
    b"%PDF": "a PDF file, export the samples as text",
    b"TDSh": "the index of a TDMS file, name the .tdms file itself",
    b"Rar!": "a RAR archive, unpack it",
    b"7z\xbc\xaf": "a 7z archive, unpack it",
    b"BZh": "packed with bzip2, unpack it or use gzip",
    b"\xfd7zX": "packed with xz, unpack it or use gzip",
}
"""First bytes of files that are not read -> what they are, and what helps."""
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
_HDF5_BEHIND_HEADER: Final = slice(512, 520)


def sniff(data: bytes | memoryview, name: str = "") -> str:
    """Format of some bytes.

    Parameters
    ----------
    data : bytes
        The file, or for packed files all of it.
    name : str
        Name of the file: it decides only where the content cannot (.mat of version 4).

    Returns
    -------
    str
        "text", "parquet", "gzip", "zip", "lvm", or one of `ISOLATED`.
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
        return "mat"  # with a header text of its own
    if name.lower().endswith(".mat"):
        return "mat"
    return TEXT


def unread(data: bytes | memoryview) -> str:
    """What a file is that no reader is there for, and what helps; "" for any other."""
    head = bytes(data[:8])
    return next((words for first, words in UNREAD.items() if head.startswith(first)), "")


def _is_workbook(data: bytes) -> bool:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = archive.namelist()
    except Exception:  # a damaged file can raise nearly anything
        return b"xl/workbook.xml" in data or b"xl/worksheets" in data
    return "[Content_Types].xml" in names and any(name.startswith("xl/") for name in names)

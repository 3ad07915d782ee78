"""Bytes of a text file -> text."""

from __future__ import annotations

import codecs
from dataclasses import dataclass
from typing import Final

from beltid.errors import InputError

CUT_OFF: Final = "the last line does not end: if the file was cut off, its last number is wrong"


@dataclass(frozen=True, slots=True)
class Decoded:
    """A text with single line feeds, the encoding that was used, and what was found out."""

    text: str
    encoding: str
    notes: tuple[str, ...] = ()


def decode(data: bytes, name: str, encoding: str | None = None) -> Decoded:
    """Text of a file.

    What is not UTF-8 is read as latin-1 only where every encoding of western Europe that a
    measuring computer uses (latin-1, cp1252) gives the same text.

    Parameters
    ----------
    data : bytes
        The file.
    name : str
        Name of the file, for messages.
    encoding : str or None
        What the user states; None: found out.

    Raises
    ------
    InputError
        If the bytes are not text, or not in the encoding, or cannot be told apart.
    """
    if data[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        encoding = "utf-16"
    elif data[:3] == codecs.BOM_UTF8:  # the mark of the file itself comes before the config
        encoding = "utf-8"
    elif b"\0" in data[:65536] and not (encoding or "").lower().startswith(("utf-16", "utf-32")):
        raise InputError(f"{name}: is not a text file, nor of another format that is known")
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
                f"{name}:{line}: byte 0x{data[error.start]:02X} is not {encoding or 'UTF-8'}{hint}"
            ) from None
        text, used = data.decode("latin-1"), "latin-1"
        notes = ("not UTF-8, read as latin-1",)
    if "\0" in text:
        raise InputError(f"{name}: is not a text file, nor of another format that is known")
    if text and text[-1] not in "\r\n":
        notes += (CUT_OFF,)
    text = text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text
    return Decoded(text, used.removesuffix("-sig"), notes)


def _ambiguous(data: bytes) -> bool:
    """Whether encodings differ here: those of DOS and Mac have letters at 0x80 to 0x9F."""
    return any(0x80 <= byte < 0xA0 for byte in data.translate(None, bytes(range(0x80))))

"""How a CSV file is written: encoding, separator, decimal sign, header, row of units."""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from beltid.errors import InputError

SEPARATORS: Final = (",", ";", "\t", "|")
MAX_COLUMNS: Final = 2000
MISSING_WORDS: Final = frozenset(
    ("", "nan", "NaN", "NAN", "NA", "N/A", "n/a", "null", "NULL", "None", "-")
)
_COMMA_NUMBER: Final = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
_NAMES: Final = {",": "','", ";": "';'", "\t": "tab", "|": "'|'"}


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """How the files of a bench differ from ours.

    Attributes
    ----------
    names : mapping
        Our column -> its name in the file.
    units : mapping
        Our column -> its unit in the file.
    separator, decimal, encoding : str or None
        None means: found out from the file.
    skip_lines : int
        Lines before the header.
    units_row : bool
        Whether a row of units follows the header.
    """

    names: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    separator: str | None = None
    decimal: str | None = None
    encoding: str | None = None
    skip_lines: int = 0
    units_row: bool = False

    @classmethod
    def of(cls, config: Any, kind: str) -> ReadOptions:
        """Options of a config (anything with `columns`, `units` and `dialect`) for a kind."""
        if config is None:
            return cls()
        dialect = config.dialect
        return cls(
            names=config.columns.of(kind),
            units=config.units.of(kind),
            separator=dialect.separator,
            decimal=dialect.decimal,
            encoding=dialect.encoding,
            skip_lines=dialect.skip_lines,
            units_row=dialect.units_row,
        )


@dataclass(frozen=True, slots=True)
class Layout:
    """What was found at the top of a CSV file.

    Attributes
    ----------
    header : tuple of str
        Names of the columns in the file.
    unit_cells : tuple of str
        Cells of the row of units, empty without one.
    separator, decimal : str
        How cells and decimals are marked.
    body : str
        The rows, with single line feeds.
    first_line : int
        Line number of the first row in the file, from 1.
    notes : tuple of str
        What was found out rather than stated.
    """

    header: tuple[str, ...]
    unit_cells: tuple[str, ...]
    separator: str
    decimal: str
    body: str
    first_line: int
    notes: tuple[str, ...]


def decode(data: bytes, name: str, encoding: str | None) -> str:
    """Text of a file, with single line feeds.

    Raises
    ------
    InputError
        If the bytes are not text, or not in the encoding.
    """
    if data[:4] == b"PK\x03\x04":
        raise InputError(f"{name}: is a workbook or a zip file, save the sheet as CSV")
    if data[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        encoding = "utf-16"
    elif b"\0" in data[:65536] and not (encoding or "").lower().startswith(("utf-16", "utf-32")):
        raise InputError(f"{name}: is not a text file, a CSV file is needed")
    used = encoding or "utf-8"
    if used.lower().replace("_", "-") in ("utf-8", "utf8"):
        used = "utf-8-sig"
    try:
        text = data.decode(used)
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        hint = "" if encoding else "; if it is of Windows, set dialect: {encoding: cp1252}"
        raise InputError(
            f"{name}:{line}: byte 0x{data[error.start]:02X} is not {encoding or 'UTF-8'}{hint}"
        ) from None
    if "\0" in text:
        raise InputError(f"{name}: is not a text file, a CSV file is needed")
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def layout(text: str, name: str, options: ReadOptions, wanted: Iterable[str]) -> Layout:
    """Find the header and how cells and decimals are marked.

    Parameters
    ----------
    text : str
        Text of the file.
    name : str
        File name for messages.
    options : ReadOptions
        What the config states.
    wanted : iterable of str
        Names in the file of the columns that are looked for.

    Raises
    ------
    InputError
        If there is no header, or nothing after it.
    """
    notes: list[str] = []
    start, line = _header_start(text, name, options.skip_lines, notes)
    end = _line_end(text, start)
    head = text[start:end]
    separator = options.separator or _separator(head, set(wanted), notes)
    header = tuple(cell.strip() for cell in _cells(head, separator, name, line))
    if len(header) > MAX_COLUMNS:
        raise InputError(f"{name}:{line}: {len(header)} columns, at most {MAX_COLUMNS} are read")
    unit_cells: tuple[str, ...] = ()
    if options.units_row:
        start, line = end + 1, line + 1
        end = _line_end(text, start)
        unit_cells = tuple(c.strip() for c in _cells(text[start:end], separator, name, line))
    body = text[end + 1 :]
    if not body.strip():
        raise InputError(f"{name}: holds no samples, only a header in line {line}")
    decimal = options.decimal or _decimal(body, separator, notes)
    return Layout(header, unit_cells, separator, decimal, body, line + 1, tuple(notes))


def _line_end(text: str, start: int) -> int:
    end = text.find("\n", start)
    return len(text) if end < 0 else end


def _header_start(text: str, name: str, skip: int, notes: list[str]) -> tuple[int, int]:
    """Offset and line number of the header: after skipped, blank and comment (#) lines."""
    start, line, comments = 0, 1, 0
    while start < len(text):
        row = text[start : _line_end(text, start)].strip()
        comment = row.startswith("#")
        if line > skip and re.fullmatch(r"sep=.?", row):  # what Excel puts before the header
            start, line = _line_end(text, start) + 1, line + 1
            continue
        if line > skip and row and not comment:
            if comments:
                notes.append(f"{comments} lines beginning with # before the header left out")
            return start, line
        comments += comment and line > skip
        start, line = _line_end(text, start) + 1, line + 1
    raise InputError(f"{name}: holds no header (it has {line - 1} lines, {skip} are skipped)")


def _cells(row: str, separator: str, name: str, line: int) -> list[str]:
    try:
        return next(csv.reader([row], delimiter=separator, skipinitialspace=True), [])
    except csv.Error as error:
        raise InputError(f"{name}:{line}: not a row of a CSV file: {error}") from None


def _separator(head: str, wanted: set[str], notes: list[str]) -> str:
    """The separator under which most wanted names are found, then the most frequent one."""

    def score(separator: str) -> tuple[int, int]:
        cells = {cell.strip().strip('"') for cell in head.split(separator)}
        return len(cells & wanted), len(cells)

    best = max(SEPARATORS, key=score)
    if best != ",":
        notes.append(f"separator {_NAMES[best]} found in the header")
    return best


def _decimal(body: str, separator: str, notes: list[str]) -> str:
    """A decimal comma where the first rows leave no other reading."""
    if separator == ",":
        return "."
    cells = [
        cell.strip().strip('"')
        for row in body[:20_000].split("\n")[:200]
        for cell in row.split(separator)
    ]
    commas = any(_COMMA_NUMBER.fullmatch(cell) for cell in cells)
    points = any(re.fullmatch(r"[-+]?\d*\.\d+([eE][-+]?\d+)?", cell) for cell in cells)
    if commas and not points:
        notes.append("decimal comma found in the numbers")
        return ","
    return "."


def header_further_down(found: Layout, wanted: Iterable[str]) -> int:
    """Line among the next 100 that names more columns than the supposed header; 0 if none."""
    names = set(wanted)
    rows = found.body[:100_000].split("\n")[:100]
    hits = [
        max(len(names & {c.strip().strip('"') for c in row.split(mark)}) for mark in SEPARATORS)
        for row in rows
    ]
    best = max(range(len(hits)), key=hits.__getitem__)
    return found.first_line + best if hits[best] > len(names & set(found.header)) else 0

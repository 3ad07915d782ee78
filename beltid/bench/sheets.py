"""Rows of cells: the head above the numbers of a table; Excel workbooks (.xlsx)."""

from __future__ import annotations

import datetime
import itertools
import re
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from beltid.bench.names import distinct_names, is_unit
from beltid.bench.numbers import MISSING, NumberSigns, is_clock, is_date, is_number
from beltid.bench.raw import Field, Raw, first_texts
from beltid.errors import InputError
from beltid.store.disk import MAX_BYTES
from beltid.tables.units import canonical_unit, is_known_unit

SEARCHED: Final = 400  # rows searched for a header below title lines
MAX_COLUMNS: Final = 2000
BLOCK: Final = 5  # number of similar rows that mark the beginning of the numbers
_UNCOMPUTED: Final = re.compile(rb"(?:</f>|<f/>|<f [^>]*/>)\s*(?:<v\s*/>|<v>\s*</v>|</c>)")
"""A formula without a value in the XML of a sheet."""


@dataclass(frozen=True, slots=True)
class Head:
    """Header lines above the numbers of a table, by their index."""

    names: tuple[str, ...]
    units: tuple[str, ...]  # empty if there is no row of units
    row: int  # of the names
    units_row: int  # -1 if there is none
    first_row: int  # below the header
    fields: tuple[Field, ...] = ()  # title lines of the form name and value


def find_head(rows: Sequence[Sequence[str]]) -> Head | None:
    """Find the header above the first block of numbers in the first rows of a file or sheet."""
    filled = [i for i, row in enumerate(rows) if any(cell.strip(" -=_*") for cell in row)]
    for at, first_row in enumerate(filled[1:], start=1):
        block = [rows[i] for i in filled[at : at + BLOCK]]
        if _is_numbers(block) and not is_units_row(block[0]):
            above = filled[:at]
            units_row = above.pop() if at > 1 and is_units_row(rows[above[-1]]) else -1
            if sum(1 for name in rows[above[-1]] if name and not is_number(name)) < 2:
                return None
            fields = fields_of([rows[i] for i in above[:-1]])
            units = tuple(rows[units_row]) if units_row >= 0 else ()
            return Head(_names_of(rows, above), units, above[-1], units_row, first_row, fields)
    return None


def head_at(rows: Sequence[Sequence[str]], row: int) -> Head:
    """Return the head whose names are in a row; a row of units may follow."""
    below = next((i for i in range(row + 1, len(rows)) if any(rows[i])), row + 1)
    fields = fields_of([r for r in rows[:row] if r and r[0].startswith("#")])
    if below < len(rows) and is_units_row(rows[below]):
        return Head(tuple(rows[row]), tuple(rows[below]), row, below, below + 1, fields)
    return Head(tuple(rows[row]), (), row, -1, below, fields)


def _names_of(rows: Sequence[Sequence[str]], above: Sequence[int]) -> tuple[str, ...]:
    """Return the column names; a blank one is taken from the row above (merged cells)."""
    names = rows[above[-1]]
    upper = rows[above[-2]] if len(above) > 1 and above[-2] == above[-1] - 1 else ()
    if sum(map(bool, upper)) > 1:  # a title is one cell
        names = [name or over for name, over in itertools.zip_longest(names, upper, fillvalue="")]
    return tuple(names)


def _is_numbers(block: Sequence[Sequence[str]]) -> bool:
    """Return whether two columns, and half of those in use, hold only numbers."""
    columns = [*itertools.zip_longest(*block, fillvalue="")]
    if len(columns) < 2:
        return False
    numeric = [
        any(map(_is_value, column)) and all(_is_value(c) or c in MISSING for c in column)
        for column in columns
    ]
    return sum(numeric) >= 2 and 2 * sum(numeric) >= sum(1 for column in columns if any(column))


def _is_value(cell: str) -> bool:
    return is_number(cell) or is_clock(cell) or is_date(cell)


def is_sample(cells: Sequence[str], below: Sequence[str]) -> bool:
    """Return whether a row is like the one below it and at least half values: no names."""
    are_values = [*map(_is_value, cells)]
    alike = are_values == [*map(_is_value, below)]
    return alike and sum(are_values) >= 2 and 2 * sum(are_values) >= len(cells)


def is_units_row(cells: Sequence[str]) -> bool:
    """Return whether a row holds units: no number, and at least half of its cells are units."""
    filled = [cell for cell in cells if cell]
    own = any(is_known_unit(c) or canonical_unit(c) in ("V", "mV") for c in filled)
    half = 2 * sum(map(is_unit, filled)) >= len(filled)
    return own and half and not any(is_number(c) and c != "1" for c in filled)


def fields_of(rows: Sequence[Sequence[str]]) -> tuple[Field, ...]:
    """Read header fields from title lines: ``name, value[, unit]`` or one cell ``name: value``."""
    fields = []
    for row in rows:
        cells = [cell.strip('" ') for cell in row]
        if len(cells) == 1:
            cells = re.split("[=:]", cells[0], maxsplit=1)
        name = cells[0].strip("#%:= ") if cells else ""
        if name and 2 <= len(cells) <= 3:
            fields.append(Field(name, *(cell.strip() for cell in cells[1:])))
    return tuple(fields)


# --- workbooks ------------------------------------------------------------------------------------


def read_excel(path: Path, place: str) -> Iterator[Raw]:
    """Read the sheets of a workbook that are shown and hold a table."""
    from openpyxl import load_workbook

    with zipfile.ZipFile(path) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > MAX_BYTES:
            raise InputError(f"{place}: unpacks to more than {MAX_BYTES >> 20} MB, split it")
        broken = archive.testzip()
        if broken is not None:
            raise InputError(f"{place}: damaged: {broken} in it does not match its checksum")
    found, left_out = list[Raw](), list[str]()
    with path.open("rb") as stream:
        book = load_workbook(stream, read_only=True, data_only=True, keep_links=False)
        for sheet in book.worksheets:
            if sheet.sheet_state != "visible":
                left_out.append(sheet.title)
                continue
            rows = [_trimmed(row, place) for row in sheet.iter_rows(values_only=True)]
            table = _table(place, sheet.title, rows)
            if table is not None:
                found.append(table)
            elif any(rows):
                left_out.append(sheet.title)
    if not found or any(table.frame.isna().to_numpy().any() for table in found):
        _refuse_formulas(path, place)
    if not found:
        raise InputError(f"{place}: no sheet holds a table: a header and rows of numbers below it")
    notes = [f"sheet {title} left out: hidden, or without a table of numbers" for title in left_out]
    yield replace(found[0], notes=tuple(notes))
    yield from found[1:]


def _refuse_formulas(path: Path, place: str) -> None:
    """Refuse formulas without computed values, whose cells would be read as empty."""
    with zipfile.ZipFile(path) as archive:
        for name in archive.namelist():
            if name.startswith("xl/worksheets/") and _UNCOMPUTED.search(archive.read(name)):
                raise InputError(
                    f"{place}: holds formulas without their values: open it in a spreadsheet "
                    "program, which computes them, and save it"
                )


def _trimmed(row: tuple[Any, ...], place: str) -> list[Any]:
    """Return a row without the empty cells at its end."""
    length = max((i + 1 for i, cell in enumerate(row) if cell not in (None, "")), default=0)
    if length > MAX_COLUMNS:
        raise InputError(f"{place}: {length} columns, must be at most {MAX_COLUMNS}")
    return [*row[:length]]


def _table(place: str, title: str, rows: list[list[Any]]) -> Raw | None:
    """Return the table of a sheet; None if it holds none."""
    head = find_head([[_shown(cell) for cell in row] for row in rows[:SEARCHED]])
    if head is None:
        return None
    body, columns, units = rows[head.first_row :], {}, {}
    written = (*head.units, *[""] * len(head.names))
    for i, (name, unit) in enumerate(zip(distinct_names(head.names), written, strict=False)):
        if name:
            columns[name] = _column([row[i] if i < len(row) else None for row in body])
            units[name] = unit
    texts = [text for cells in columns.values() for text in first_texts(pd.Series(cells))]
    return Raw(
        place,
        pd.DataFrame(columns),
        title,
        "Excel workbook",
        units,
        head.fields,
        lines=range(head.first_row + 1, head.first_row + 1 + len(body)),
        header_line=head.row + 1,
        units_line=head.units_row + 1,
        signs=NumberSigns.of(texts),
    )


def _shown(cell: Any) -> str:
    if isinstance(cell, datetime.datetime) and cell.year <= 1900:  # a time of day past midnight
        cell = cell.time()
    return repr(cell) if isinstance(cell, float) else str("" if cell is None else cell).strip()


def _column(cells: list[Any]) -> Any:
    """Return the cells of a column as numbers or texts."""
    kinds = {type(cell) for cell in cells if cell is not None and cell != ""}
    if kinds and kinds <= {int, float}:
        return np.array([np.nan if c is None or c == "" else float(c) for c in cells])
    return pd.array([_shown(cell) or None for cell in cells], dtype="str")

"""Excel workbooks (.xlsx): every sheet with a table is a table."""

from __future__ import annotations

import datetime
import re
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from beltid.bench.header import MAX_COLUMNS, SEARCHED, distinct_names, find_head, unit_in_name
from beltid.bench.numbers import NumberSigns
from beltid.bench.raw import Raw, first_texts
from beltid.errors import InputError
from beltid.store.disk import MAX_BYTES

_UNCOMPUTED: Final = re.compile(rb"(?:</f>|<f/>|<f [^>]*/>)\s*(?:<v\s*/>|<v>\s*</v>|</c>)")
"""A formula without a value in the XML of a sheet."""


def read(path: Path, place: str) -> Iterator[Raw]:
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
            columns[name], in_cells = _column([row[i] if i < len(row) else None for row in body])
            units[name] = in_cells or unit or unit_in_name(name)
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
    if cell is None:
        return ""
    if isinstance(cell, datetime.datetime) and cell.year <= 1900:  # a time of day past midnight
        cell = cell.time()
    return repr(cell) if isinstance(cell, float) else str(cell).strip()


def _column(cells: list[Any]) -> tuple[Any, str]:
    """Return the cells of a column as numbers or texts, and the unit that they imply."""
    kinds = {type(cell) for cell in cells if cell is not None and cell != ""}
    if kinds == {datetime.timedelta}:  # [h]:mm:ss
        return np.array([c.total_seconds() if c else np.nan for c in cells], dtype=float), "s"
    if kinds and kinds <= {int, float}:
        return np.array([np.nan if c is None or c == "" else float(c) for c in cells]), ""
    return pd.array([_shown(cell) or None for cell in cells], dtype="str"), ""

"""Read Excel workbooks: every sheet with a table is a group. Runs in the child process."""

from __future__ import annotations

import datetime
import re
import zipfile
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.bench.formats.bench_file import BenchFile, Channel, Group
from beltid.bench.formats.dialect import (
    SEARCHED,
    TableHead,
    distinct_names,
    find_head,
    unit_in_name,
)
from beltid.errors import InputError
from beltid.tables.values import absent

MAX_UNPACKED: Final = 2 << 30
MAX_COLUMNS: Final = 2000
_UNCOMPUTED: Final = re.compile(rb"(?:</f>|<f/>|<f [^>]*/>)\s*(?:<v\s*/>|<v>\s*</v>|</c>)")
"""A formula without a value in the XML of a sheet."""


def read(path: Path) -> BenchFile:
    """Read all sheets of a workbook that hold a table."""
    from openpyxl import load_workbook

    with zipfile.ZipFile(path) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > MAX_UNPACKED:
            raise InputError(f"unpacks to more than {MAX_UNPACKED >> 20} MB, split the recording")
        if "xl/workbook.bin" in archive.namelist():
            raise InputError("is a binary Excel workbook (.xlsb), save it as .xlsx")
        broken = archive.testzip()
        if broken is not None:
            raise InputError(f"damaged: {broken} in it does not match its checksum")
    notes: list[str] = []
    groups: list[Group] = []
    hidden: list[Group] = []
    with path.open("rb") as stream:
        book = load_workbook(stream, read_only=True, data_only=True, keep_links=False)
        for sheet in book.worksheets:
            rows = [_trimmed(row) for row in sheet.iter_rows(values_only=True)]
            group = _group(sheet.title, rows)
            if group is not None:
                (groups if sheet.sheet_state == "visible" else hidden).append(group)
            elif any(rows):
                notes.append(f"sheet {sheet.title} left out: no table of numbers found")
    if groups and hidden:
        notes.append("hidden sheets left out: " + ", ".join(group.name for group in hidden))
    groups = groups or hidden
    if any(absent(c.values).any() for group in groups for c in group.channels):
        _refuse_formulas(path)
    if not groups:
        raise InputError("no sheet holds a table: a header and rows of numbers below it")
    return BenchFile("Excel workbook", tuple(groups), (), tuple(notes))


def _refuse_formulas(path: Path) -> None:
    """Refuse formulas without computed values, whose cells would be read as empty."""
    with zipfile.ZipFile(path) as archive:
        for name in archive.namelist():
            if name.startswith("xl/worksheets/") and _UNCOMPUTED.search(archive.read(name)):
                raise InputError(
                    "holds formulas without their values: open it in a spreadsheet program, which "
                    "computes them, and save it"
                )


def _trimmed(row: tuple[Any, ...]) -> list[Any]:
    cells = list(row[: MAX_COLUMNS + 1])
    while cells and (cells[-1] is None or cells[-1] == ""):
        cells.pop()
    if len(cells) > MAX_COLUMNS:
        raise InputError(f"more than {MAX_COLUMNS} columns")
    return cells


def _group(title: str, rows: list[list[Any]]) -> Group | None:
    head = find_head([[_shown(cell) for cell in row] for row in rows[:SEARCHED]])
    if head is None:
        return None
    body = rows[head.first_row :]
    channels = tuple(
        _channel(name, unit, [row[i] if i < len(row) else None for row in body])
        for i, (name, unit) in enumerate(_columns(head))
        if name
    )
    if not channels or not body:
        return None
    return Group(title, channels, head.fields, head.first_row + 1)


def _columns(head: TableHead) -> list[tuple[str, str]]:
    """Return name and unit of every column; a unit in brackets also stays in the name."""
    units = [*head.units, *[""] * len(head.names)]
    return [
        (n, u or unit_in_name(n)) for n, u in zip(distinct_names(head.names), units, strict=False)
    ]


def _shown(cell: Any) -> str:
    if cell is None:
        return ""
    if isinstance(cell, datetime.datetime) and cell.year <= 1900:  # a time of day past midnight
        cell = cell.time()
    return repr(cell) if isinstance(cell, float) else str(cell).strip()


def _channel(name: str, unit: str, cells: list[Any]) -> Channel:
    filled = [cell for cell in cells if cell is not None and cell != ""]
    if filled and all(isinstance(cell, datetime.timedelta) for cell in filled):  # [h]:mm:ss
        seconds = [c.total_seconds() if c is not None and c != "" else np.nan for c in cells]
        return Channel(name, "s", np.array(seconds, dtype=float))
    if filled and all(isinstance(c, (int, float)) and not isinstance(c, bool) for c in filled):
        numbers = [np.nan if c is None or c == "" else float(c) for c in cells]
        return Channel(name, unit, np.array(numbers, dtype=float))
    texts = np.empty(len(cells), dtype=object)
    texts[:] = [_shown(cell) or None for cell in cells]
    return Channel(name, unit, texts)

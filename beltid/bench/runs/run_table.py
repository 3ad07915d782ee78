"""A table of runs: a CSV file with a row per file of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from beltid.artifacts.file_bytes import read_bytes
from beltid.bench.channels.channel_mapping import MappingContext, unit_conversion
from beltid.bench.channels.vocabulary import FILE_NAMES, roles_meant, simplified
from beltid.bench.files.sniff import decode
from beltid.bench.formats.csv_table import Wanted, read_rows
from beltid.bench.formats.dialect import Layout, ReadOptions, layout, unit_in_name
from beltid.errors import InputError, Problems
from beltid.tables.columns import Table
from beltid.tables.schemas import SETTINGS
from beltid.tables.units import Conversion


@dataclass(frozen=True, slots=True)
class RunTable:
    """A table of runs: a row per file.

    Attributes
    ----------
    path : Path
        The file.
    rows : dict
        Name of a file (or group) -> its line and the values it tells, by our columns.
    """

    path: Path
    rows: Mapping[str, tuple[int, Mapping[str, str | float]]]


def read_run_table(path: Path, table: Table) -> RunTable:
    """Read a table of runs.

    Raises
    ------
    InputError
        If it has no column of file names, or cells that are no values.
    """
    problems, name = Problems(), str(path)
    found = layout(decode(read_bytes(path), name).text, name, ReadOptions(), ["file"])
    place = f"{name}:{found.header_line}"
    files = [i for i, column in enumerate(found.header) if simplified(column) in FILE_NAMES]
    if len(files) != 1:
        raise InputError(
            f"{place}: one column must hold the names of the files and be called file; "
            "found are " + ", ".join(found.header[:20])
        )
    columns, conversions = _columns(found, table, place, problems)
    columns["file"] = Wanted(files[0], True, "file")
    problems.raise_if_any()
    rows = read_rows(found, columns, name)
    rows.problems.raise_if_any()
    cells = rows.columns()
    told: dict[str, tuple[int, Mapping[str, str | float]]] = {}
    for k, line in enumerate(rows.all_lines().tolist()):
        file = str(cells["file"][k] or "")
        if file in told:
            problems.add(f"{name}:{line}: {file} stands in line {told[file][0]}, too")
        values: dict[str, str | float] = {}
        for role in columns:
            cell = cells[role][k]
            if role == "file" or cell is None or cell != cell:
                continue
            by = conversions.get(role, Conversion(1.0))
            values[role] = cell if isinstance(cell, str) else (float(cell) + by.shift) * by.factor
        told[file] = (line, values)
    problems.raise_if_any()
    return RunTable(path, told)


def _columns(
    found: Layout, table: Table, place: str, problems: Problems
) -> tuple[dict[str, Wanted], dict[str, Conversion]]:
    """Where label and settings stand in the table, and the conversions to our units."""
    columns: dict[str, Wanted] = {}
    conversions: dict[str, Conversion] = {}
    known = [c.name for c in table.columns if c.name in (*SETTINGS, table.label)]
    for i, name in enumerate(found.header):
        role = next((r for r in (name, *roles_meant(name, table.kind)) if r in known), None)
        if role is None:
            continue
        ours = table.column(role)
        columns[role] = Wanted(i, ours.dtype == "string", name)
        if ours.dtype == "string":
            continue
        cell = found.unit_cells[i] if i < len(found.unit_cells) else ""
        context = MappingContext(table, ReadOptions(), place, problems)
        by = unit_conversion(ours, name, cell or unit_in_name(name), context, name != role)
        if isinstance(by, str):
            context.complain(by)
        elif by is not None:
            conversions[role] = by
    return columns, conversions

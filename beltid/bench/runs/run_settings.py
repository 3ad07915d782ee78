"""Label and settings of runs whose recordings do not hold them as columns.

They stand in the name of the file, in its header, in a table beside the files, or hold for all
runs: what the config says comes first, then what the header tells in words that are known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from beltid.artifacts.file_bytes import read_bytes
from beltid.bench.channels.channel_mapping import (
    MappingContext,
    RawTable,
    map_channels,
    missing_setting,
    stated_elsewhere,
    unit_conversion,
)
from beltid.bench.channels.text_tables import candidates_of, convert, wanted_of
from beltid.bench.channels.vocabulary import roles_meant
from beltid.bench.files.sniff import decode
from beltid.bench.formats.bench_file import Field
from beltid.bench.formats.csv_table import read_rows
from beltid.bench.formats.dialect import layout, read_field
from beltid.bench.formats.numbers import NumberSigns
from beltid.bench.formats.rows import completed, together
from beltid.bench.read_options import ReadOptions
from beltid.bench.runs.run_split import row_labels, run_labels
from beltid.config.model import DialectSection
from beltid.config.name_pattern import name_pattern, number
from beltid.errors import PlaceOf, Problems
from beltid.tables.columns import Table, text
from beltid.tables.schemas import SETTINGS
from beltid.tables.units import conversion
from beltid.tables.values import absent, is_missing, shown_value

RunTable = dict[str, tuple[int, Mapping[str, str | float]]]
"""Name of a file (or group) -> its line in a table of runs, and the values it tells of it."""


def read_run_table(path: Path, table: Table) -> RunTable:
    """Read a table of runs: a row per file.

    Raises
    ------
    InputError
        If it has no column of file names, or cells that are no values.
    """
    problems, name = Problems(), str(path)
    known = [c for c in table.columns if c.name in (*SETTINGS, table.label)]
    asked = replace(table, columns=(text("file", "name of the file, or of the group"), *known))
    found = layout(decode(read_bytes(path), name).text, name, DialectSection(), ["file"])
    context = MappingContext(asked, ReadOptions(), f"{name}:{found.header_line}", problems)
    mappings = map_channels(candidates_of(found), context)
    if "file" not in mappings:
        context.complain(
            "one column must hold the names of the files and be called file; found are "
            + ", ".join(found.header[:20])
        )
    problems.raise_if_any()
    rows = read_rows(found, wanted_of(mappings, context), name)
    rows.problems.raise_if_any()
    columns = rows.columns()
    convert(columns, mappings)
    files = columns.pop("file")
    told: RunTable = {}
    for k, line in enumerate(rows.all_lines().tolist()):
        file = str(files[k] or "")
        if file in told:
            problems.add(f"{name}:{line}: {file} stands in line {told[file][0]}, too")
        cells = {role: values[k] for role, values in columns.items()}
        told[file] = line, {role: cell for role, cell in cells.items() if not is_missing(cell)}
    problems.raise_if_any()
    return told


class RunSettings:
    """Gives raw tables of a recording their label and settings.

    Parameters
    ----------
    table : Table
        The kind of recording.
    options : ReadOptions
        What the config states.
    """

    def __init__(self, table: Table, options: ReadOptions) -> None:
        self.table = table
        self.runs = options.runs
        self.options = options
        self.stated = stated_elsewhere(options.runs, (), table)
        self.pattern = None
        self.run_table: RunTable | None = None
        self.used: set[str] = set()
        if self.runs.pattern:
            self.pattern = name_pattern(self.runs.pattern)
        if self.runs.table is not None:
            self.run_table = read_run_table(self.runs.table, table)

    def of(self, raw: RawTable, problems: Problems) -> tuple[dict[str, str | float], list[str]]:
        """Label and settings told about a raw table outside its columns, and notes about them."""
        told: dict[str, str | float] = {}
        notes: list[str] = []
        self._from_header(raw, told, notes, problems)
        for role in SETTINGS:
            value = getattr(self.runs.values, role, None)
            if value is not None:
                told[role] = value
        self._from_fields(raw, told, problems)
        self._from_name(raw, told, problems)
        self._from_table(raw, told, problems)
        return told, notes

    def _complete(self, raw: RawTable) -> bool:
        """Whether label and settings stand in the recording itself."""
        needed = [r for r in SETTINGS if r in self.table.names and self.table.column(r).required]
        return all(role in raw.mappings for role in (self.table.label, *needed))

    def finish(self, problems: Problems) -> None:
        """Note rows of the table of runs that no file belongs to."""
        if self.run_table is None:
            return
        for name, (line, _) in self.run_table.items():
            if name not in self.used:
                problems.add(f"{self.runs.table}:{line}: {name} is not among the files read")

    def _from_header(
        self, raw: RawTable, told: dict[str, Any], notes: list[str], problems: Problems
    ) -> None:
        """Header fields whose names are known words."""
        for role in SETTINGS:
            if role not in self.table.names or role in raw.mappings or self._is_text(role):
                continue
            meant = [f for f in raw.fields if role in roles_meant(f.name, self.table.kind)]
            values = {}
            for found in meant:
                value = self._field_value(role, found, raw.fields, recognised=True)
                if not isinstance(value, str):
                    values[found.name] = value
                elif self.table.column(role).required and role not in self.stated:
                    problems.add(f"{raw.place}: {value}")
                    told[role] = np.nan  # told once what is wrong
            if len(set(values.values())) > 1 and role not in self.stated:
                shown = ", ".join(f"{n} = {v:g}" for n, v in values.items())
                problems.add(
                    f"{raw.place}: header fields {shown} can be {role}, say which: runs: "
                    f'{{{self.table.kind}: {{fields: {{{role}: "{next(iter(values))}"}}}}}}'
                )
            elif values:
                told[role] = next(iter(values.values()))
                if role not in values:
                    notes.append(f"read header field {next(iter(values))} as {role}")

    def _is_text(self, role: str) -> bool:
        return self.table.column(role).dtype == "string"

    def _field_value(
        self, role: str, found: Field, fields: Sequence[Field], *, recognised: bool
    ) -> float | str:
        """Value of a header field in our unit, or what is wrong with it."""
        column = self.table.column(role)
        plain = read_field(found.name, found.text, found.unit)
        text = plain.text.strip()
        stated = (self.options.dialect.decimal, self.options.dialect.thousands)
        value = NumberSigns.of([text], *stated).number(text)
        if isinstance(value, str):  # the other fields may show what its signs mean
            texts = [read_field(f.name, f.text, f.unit).text.strip() for f in fields]
            value = NumberSigns.of(texts, *stated).number(text)
        if isinstance(value, str):
            return f'header field {found.name} = "{found.text}", {value}'
        by = unit_conversion(
            column,
            found.name,
            plain.unit,
            MappingContext(self.table, self.options),
            recognised and found.name != role,
        )
        if isinstance(by, str):
            return by
        return value if by is None else by.apply(value)

    def _from_fields(self, raw: RawTable, told: dict[str, Any], problems: Problems) -> None:
        """Header fields that the config names."""
        for role in type(self.runs.fields).model_fields:
            name = getattr(self.runs.fields, role)
            if name is None or role not in self.table.names:
                continue
            found = [f for f in raw.fields if f.name == name]
            if not found:
                known = ", ".join(f.name for f in raw.fields[:20]) or "none"
                problems.add(
                    f"{raw.place}: there is no header field {name} (which the config names for "
                    f"{role}); found: {known}"
                )
                continue
            if self._is_text(role):
                told[role] = found[0].text
                continue
            value = self._field_value(role, found[0], raw.fields, recognised=False)
            if isinstance(value, str):
                problems.add(f"{raw.place}: {value}")
            else:
                told[role] = value

    def _from_name(self, raw: RawTable, told: dict[str, Any], problems: Problems) -> None:
        if self.pattern is None:
            return
        values = next(
            (v for name in raw.names if (v := self.pattern.values(name)) is not None), None
        )
        if values is None:
            if not self._complete(raw):
                problems.add(
                    f"{raw.place}: the name is not made up as runs.{self.table.kind}.pattern = "
                    f'"{self.runs.pattern}" says'
                )
            return
        for role, word in values.items():
            if role not in (*SETTINGS, self.table.label) or role not in self.table.names:
                continue
            if self._is_text(role):
                told[role] = word
            else:
                unit = self.pattern.units.get(role, self.table.column(role).unit)
                by = conversion(unit, self.table.column(role).unit)
                try:
                    value = number(word)
                except ValueError:
                    problems.add(f'{raw.place}: {role} = "{word}" in the name, must be a number')
                    continue
                if by is None:
                    problems.add(f"{raw.place}: {role} in {unit}, which is no unit of it")
                else:
                    told[role] = by.apply(value)

    def _from_table(self, raw: RawTable, told: dict[str, Any], problems: Problems) -> None:
        if self.run_table is None:
            return
        name = next((n for n in raw.names if n in self.run_table), None)
        if name is not None:
            self.used.add(name)
            told.update(self.run_table[name][1])
        elif not self._complete(raw):
            problems.add(f"{self.runs.table}: has no row for {raw.names[0]}")


def fill(columns: dict[str, np.ndarray], told: Mapping[str, str | float], length: int) -> list[str]:
    """Put what is told about a run into its columns; returns the columns it replaced."""
    replaced = []
    for role, value in told.items():
        values = np.full(length, value, dtype=object if isinstance(value, str) else float)
        before = columns.get(role, values[:0])
        known = before[~absent(before)]
        differ = known != value if isinstance(value, str) else ~np.isclose(known, value, rtol=1e-6)
        if np.any(differ):
            shown, was = shown_value(value), shown_value(known[differ][0])
            replaced.append(f"{role} = {shown} as told replaces {was} of the recording")
        columns[role] = values
    return replaced


def joined(
    raw_tables: Sequence[RawTable], table: Table, options: ReadOptions, problems: Problems
) -> tuple[dict[str, np.ndarray], PlaceOf, list[str], set[str]]:
    """Columns of all raw tables one after the other.

    Parameters
    ----------
    raw_tables : sequence of RawTable
        What was read.
    table : Table
        What is needed.
    options : ReadOptions
        What the config states.
    problems : Problems
        Collects labels used twice and settings that nobody tells.

    Returns
    -------
    columns : dict
        Columns of the table in its order; an optional one that is absent is all nan.
    place : callable
        Index of a sample -> its place in words, and its line.
    notes : list of str
        What was found out.
    stated : set of str
        Columns whose unit is told.

    Raises
    ------
    InputError
        If label or settings of a run cannot be found.
    """
    settings, wrong = RunSettings(table, options), problems.count
    parts: list[dict[str, np.ndarray]] = []
    notes: dict[str, list[str]] = {}
    owners: dict[str, str] = {}
    for raw in raw_tables:
        told, said = settings.of(raw, problems)
        columns = dict(raw.columns)
        words = {*columns.get(table.label, ())} - {None}
        if table.label in told and len(words) > 1 and "time_s" in table.names:
            problems.add(
                f"{raw.place}: its column {table.label} holds {len(words)} labels, but "
                f"{table.label} = {told[table.label]} is told for all of it: leave out one of both"
            )
        said += fill(columns, told, len(raw))
        if table.label not in columns and "time_s" in table.names:
            labels, split = run_labels(columns, raw.label, raw.place, problems)
            columns[table.label] = labels
            said += split
        elif "time_s" not in table.names:
            columns[table.label] = row_labels(len(raw), columns.get(table.label))
        for role in SETTINGS:
            if role in table.names and table.column(role).required and role not in columns:
                problems.add(missing_setting(role, table.kind, raw.name_place))
        if "time_s" in table.names:
            _own_labels(columns[table.label], raw, owners, table, problems)
        for note in (*raw.notes, *said):
            notes.setdefault(note, []).append(raw.place)
        parts.append(completed(columns, table, len(raw)))
    settings.finish(problems)
    if problems.count > wrong:
        problems.told_once([raw.place for raw in raw_tables])
        problems.raise_if_any()
    starts = np.cumsum([0, *(len(raw) for raw in raw_tables)])[:-1]

    def place(index: int) -> tuple[str, int]:
        k = int(np.searchsorted(starts, index, side="right")) - 1
        where, line = raw_tables[k].place_of(index - int(starts[k]))
        return where, line if len(raw_tables) == 1 else index + 1

    whole = together(parts, table)
    told_units = [
        {r for r, mapping in raw.mappings.items() if mapping.unit_stated} for raw in raw_tables
    ]
    stated = set.intersection(*told_units) if told_units else set()
    return whole, place, _merged(notes, len(raw_tables)), stated


def _own_labels(
    labels: np.ndarray, raw: RawTable, owners: dict[str, str], table: Table, problems: Problems
) -> None:
    """Note labels that another raw table has, too."""
    for label in dict.fromkeys(labels.tolist()):
        if label is None:
            continue
        owner = owners.setdefault(label, raw.place)
        if owner != raw.place:
            problems.add(f"{raw.place}: {table.label} {label} is that of {owner}, too")


def _merged(notes: Mapping[str, list[str]], count: int) -> list[str]:
    """Notes of several raw tables that say the same, as one note."""
    return [
        note
        if count == 1 or len(places) == count
        else f"{places[0]}{f' and {len(places) - 1} more' if len(places) > 1 else ''}: {note}"
        for note, places in notes.items()
    ]

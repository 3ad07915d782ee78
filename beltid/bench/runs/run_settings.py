"""Label and settings of runs whose recordings do not hold them as columns.

They are in the file name, in the file header, in a separate table, or apply to all runs. What the
config states takes precedence over header fields recognised by known words.
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
"""Name of a file (or group) -> its line in a table of runs, and the values in that line."""


def read_run_table(path: Path, table: Table) -> RunTable:
    """Read a table of runs: a row per file.

    Raises
    ------
    InputError
        If it has no column of file names, or cells that are not values.
    """
    problems, name = Problems(), str(path)
    settings = [c for c in table.columns if c.name in (*SETTINGS, table.label)]
    wanted = replace(table, columns=(text("file", "name of the file, or of the group"), *settings))
    file_layout = layout(decode(read_bytes(path), name).text, name, DialectSection(), ["file"])
    context = MappingContext(wanted, ReadOptions(), f"{name}:{file_layout.header_line}", problems)
    mappings = map_channels(candidates_of(file_layout), context)
    if "file" not in mappings:
        context.complain(
            "a column named file must hold the names of the files; found: "
            + ", ".join(file_layout.header[:20])
        )
    problems.raise_if_any()
    rows = read_rows(file_layout, wanted_of(mappings, context), name)
    rows.problems.raise_if_any()
    columns = rows.columns()
    convert(columns, mappings)
    files = columns.pop("file")
    values_by_file: RunTable = {}
    for k, line in enumerate(rows.all_lines().tolist()):
        file = str(files[k] or "")
        if file in values_by_file:
            problems.add(f"{name}:{line}: {file} is already in line {values_by_file[file][0]}")
        cells = {role: values[k] for role, values in columns.items()}
        values_by_file[file] = (
            line,
            {role: cell for role, cell in cells.items() if not is_missing(cell)},
        )
    problems.raise_if_any()
    return values_by_file


class RunSettings:
    """Find label and settings of the raw tables of a recording.

    Parameters
    ----------
    table : Table
        Schema of the kind of recording.
    options : ReadOptions
        Options stated in the config.
    """

    def __init__(self, table: Table, options: ReadOptions) -> None:
        self.table = table
        self.runs = options.runs
        self.options = options
        self.stated = stated_elsewhere(options.runs, (), table)
        self.pattern = None
        self.run_table: RunTable | None = None
        self.used: set[str] = set()
        if self.runs["pattern"]:
            self.pattern = name_pattern(self.runs["pattern"])
        if self.runs["table"]:
            self.run_table = read_run_table(self.runs["table"], table)

    def of(self, raw: RawTable, problems: Problems) -> tuple[dict[str, str | float], list[str]]:
        """Return label and settings of a raw table from outside its columns, and notes on them."""
        settings: dict[str, str | float] = {}
        notes: list[str] = []
        self._from_header(raw, settings, notes, problems)
        settings |= self.runs["values"]
        self._from_fields(raw, settings, problems)
        self._from_name(raw, settings, problems)
        self._from_table(raw, settings, problems)
        return settings, notes

    def _complete(self, raw: RawTable) -> bool:
        """Return whether the recording itself holds label and settings."""
        needed = [r for r in SETTINGS if r in self.table.names and self.table.column(r).required]
        return all(role in raw.mappings for role in (self.table.label, *needed))

    def finish(self, problems: Problems) -> None:
        """Report rows of the table of runs that belong to no file."""
        if self.run_table is None:
            return
        for name, (line, _) in self.run_table.items():
            if name not in self.used:
                problems.add(f"{self.runs['table']}:{line}: {name} is not among the files read")

    def _from_header(
        self, raw: RawTable, settings: dict[str, Any], notes: list[str], problems: Problems
    ) -> None:
        """Take settings from header fields whose names are known words."""
        for role in SETTINGS:
            if role not in self.table.names or role in raw.mappings or self._is_text(role):
                continue
            fields = [f for f in raw.fields if role in roles_meant(f.name, self.table.kind)]
            values = {}
            for header_field in fields:
                value = self._field_value(role, header_field, raw.fields, recognised=True)
                if not isinstance(value, str):
                    values[header_field.name] = value
                elif self.table.column(role).required and role not in self.stated:
                    problems.add(f"{raw.place}: {value}")
                    settings[role] = np.nan  # the problem is reported only once
            if len(set(values.values())) > 1 and role not in self.stated:
                shown = ", ".join(f"{n} = {v:g}" for n, v in values.items())
                problems.add(
                    f"{raw.place}: header fields {shown} can be {role}, say which: runs: "
                    f'{{{self.table.kind}: {{fields: {{{role}: "{next(iter(values))}"}}}}}}'
                )
            elif values:
                settings[role] = next(iter(values.values()))
                if role not in values:
                    notes.append(f"read header field {next(iter(values))} as {role}")

    def _is_text(self, role: str) -> bool:
        return self.table.column(role).dtype == "string"

    def _field_value(
        self, role: str, header_field: Field, fields: Sequence[Field], *, recognised: bool
    ) -> float | str:
        """Return the value of a header field in our unit, or an error message."""
        column = self.table.column(role)
        plain = read_field(header_field.name, header_field.text, header_field.unit)
        text = plain.text.strip()
        stated = (self.options.dialect.decimal, self.options.dialect.thousands)
        value = NumberSigns.of([text], *stated).number(text)
        if isinstance(value, str):  # other fields may show which sign is the decimal sign
            texts = [read_field(f.name, f.text, f.unit).text.strip() for f in fields]
            value = NumberSigns.of(texts, *stated).number(text)
        if isinstance(value, str):
            return f'header field {header_field.name} = "{header_field.text}", {value}'
        converted = unit_conversion(
            column,
            header_field.name,
            plain.unit,
            MappingContext(self.table, self.options),
            recognised and header_field.name != role,
        )
        if isinstance(converted, str):
            return converted
        return value if converted is None else converted.apply(value)

    def _from_fields(self, raw: RawTable, settings: dict[str, Any], problems: Problems) -> None:
        """Take settings from header fields that the config names."""
        for role, name in self.runs["fields"].items():
            if role not in self.table.names:
                continue
            fields = [f for f in raw.fields if f.name == name]
            if not fields:
                names = ", ".join(f.name for f in raw.fields[:20]) or "none"
                problems.add(
                    f"{raw.place}: there is no header field {name} (which the config names for "
                    f"{role}); found: {names}"
                )
                continue
            if self._is_text(role):
                settings[role] = fields[0].text
                continue
            value = self._field_value(role, fields[0], raw.fields, recognised=False)
            if isinstance(value, str):
                problems.add(f"{raw.place}: {value}")
            else:
                settings[role] = value

    def _from_name(self, raw: RawTable, settings: dict[str, Any], problems: Problems) -> None:
        """Take label and settings from the file name by the pattern of the config."""
        if self.pattern is None:
            return
        pattern = self.runs["pattern"]
        values = next(
            (v for name in raw.names if (v := self.pattern.values(name)) is not None), None
        )
        if values is None:
            if not self._complete(raw):
                problems.add(
                    f"{raw.place}: the name does not match runs.{self.table.kind}.pattern = "
                    f'"{pattern}"'
                )
            return
        for role, word in values.items():
            if role not in (*SETTINGS, self.table.label) or role not in self.table.names:
                continue
            if self._is_text(role):
                settings[role] = word
            else:
                unit = self.pattern.units.get(role, self.table.column(role).unit)
                by = conversion(unit, self.table.column(role).unit)
                try:
                    value = number(word)
                except ValueError:
                    problems.add(f'{raw.place}: {role} = "{word}" in the name, must be a number')
                    continue
                if by is None:
                    problems.add(f"{raw.place}: {role} cannot be in {unit}")
                else:
                    settings[role] = by.apply(value)

    def _from_table(self, raw: RawTable, settings: dict[str, Any], problems: Problems) -> None:
        """Take label and settings from the table of runs."""
        if self.run_table is None:
            return
        name = next((n for n in raw.names if n in self.run_table), None)
        if name is not None:
            self.used.add(name)
            settings.update(self.run_table[name][1])
        elif not self._complete(raw):
            problems.add(f"{self.runs['table']}: has no row for {raw.names[0]}")


def fill(
    columns: dict[str, np.ndarray], settings: Mapping[str, str | float], length: int
) -> list[str]:
    """Fill columns of a run with stated values; return notes on columns that it replaced."""
    replaced = []
    for role, value in settings.items():
        values = np.full(length, value, dtype=object if isinstance(value, str) else float)
        before = columns.get(role, values[:0])
        values_before = before[~absent(before)]
        differ = (
            values_before != value
            if isinstance(value, str)
            else ~np.isclose(values_before, value, rtol=1e-6)
        )
        if np.any(differ):
            shown, was = shown_value(value), shown_value(values_before[differ][0])
            replaced.append(f"{role} = {shown} as stated replaces {was} in the recording")
        columns[role] = values
    return replaced


def joined(
    raw_tables: Sequence[RawTable], table: Table, options: ReadOptions, problems: Problems
) -> tuple[dict[str, np.ndarray], PlaceOf, list[str], set[str]]:
    """Join the columns of all raw tables, one after the other.

    Parameters
    ----------
    raw_tables : sequence of RawTable
        The raw tables.
    table : Table
        Columns needed.
    options : ReadOptions
        Options stated in the config.
    problems : Problems
        Collects labels used twice and missing settings.

    Returns
    -------
    columns : dict
        Columns of the table in its order; a missing optional one is all nan.
    place : callable
        Index of a sample -> its place for messages, and its line.
    notes : list of str
        Notes for the user.
    stated : set of str
        Columns whose unit is stated.

    Raises
    ------
    InputError
        If label or settings of a run cannot be found.
    """
    run_settings, wrong = RunSettings(table, options), problems.count
    parts: list[dict[str, np.ndarray]] = []
    notes: dict[str, list[str]] = {}
    owners: dict[str, str] = {}
    for raw in raw_tables:
        settings, table_notes = run_settings.of(raw, problems)
        columns = dict(raw.columns)
        words = {*columns.get(table.label, ())} - {None}
        if table.label in settings and len(words) > 1 and "time_s" in table.names:
            problems.add(
                f"{raw.place}: its column {table.label} holds {len(words)} labels, but "
                f"{table.label} = {settings[table.label]} is stated for all of it: remove one of "
                "the two"
            )
        table_notes += fill(columns, settings, len(raw))
        if table.label not in columns and "time_s" in table.names:
            labels, split = run_labels(columns, raw.label, raw.place, problems)
            columns[table.label] = labels
            table_notes += split
        elif "time_s" not in table.names:
            columns[table.label] = row_labels(len(raw), columns.get(table.label))
        for role in SETTINGS:
            if role in table.names and table.column(role).required and role not in columns:
                problems.add(missing_setting(role, table.kind, raw.name_place))
        if "time_s" in table.names:
            _own_labels(columns[table.label], raw, owners, table, problems)
        for note in (*raw.notes, *table_notes):
            notes.setdefault(note, []).append(raw.place)
        parts.append(completed(columns, table, len(raw)))
    run_settings.finish(problems)
    if problems.count > wrong:
        problems.merge_repeated([raw.place for raw in raw_tables])
        problems.raise_if_any()
    starts = np.cumsum([0, *(len(raw) for raw in raw_tables)])[:-1]

    def place(index: int) -> tuple[str, int]:
        k = int(np.searchsorted(starts, index, side="right")) - 1
        where, line = raw_tables[k].place_of(index - int(starts[k]))
        return where, line if len(raw_tables) == 1 else index + 1

    whole = together(parts, table)
    stated_units = [
        {r for r, mapping in raw.mappings.items() if mapping.unit_stated} for raw in raw_tables
    ]
    stated = set.intersection(*stated_units) if stated_units else set()
    return whole, place, _merged(notes, len(raw_tables)), stated


def _own_labels(
    labels: np.ndarray, raw: RawTable, owners: dict[str, str], table: Table, problems: Problems
) -> None:
    """Report labels that another raw table also has."""
    for label in dict.fromkeys(labels.tolist()):
        if label is None:
            continue
        owner = owners.setdefault(label, raw.place)
        if owner != raw.place:
            problems.add(f"{raw.place}: {table.label} {label} is already used in {owner}")


def _merged(notes: Mapping[str, list[str]], count: int) -> list[str]:
    """Merge equal notes of several raw tables into one."""
    return [
        note
        if count == 1 or len(places) == count
        else f"{places[0]}{f' and {len(places) - 1} more' if len(places) > 1 else ''}: {note}"
        for note, places in notes.items()
    ]

"""Label and settings of runs whose recordings do not hold them as columns.

They stand in the name of the file, in its header, in a table beside the files, or hold for all
runs: what the config says comes first, then what the header tells in words that are known.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from beltid.bench.channels.channel_mapping import MappingContext, unit_conversion
from beltid.bench.channels.raw_table import RawTable
from beltid.bench.channels.vocabulary import SETTINGS, roles_meant
from beltid.bench.formats.bench_file import Field
from beltid.bench.formats.dialect import ReadOptions
from beltid.bench.formats.table_head import read_field
from beltid.bench.problems import Problems
from beltid.bench.runs.run_table import RunTable, read_run_table
from beltid.config.name_pattern import name_pattern, number
from beltid.tables.columns import Table
from beltid.tables.units import conversion


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
        self.pattern = None
        self.run_table: RunTable | None = None
        self.used: set[str] = set()
        if self.runs is not None and self.runs.pattern:
            self.pattern = name_pattern(self.runs.pattern)
        if self.runs is not None and self.runs.table is not None:
            self.run_table = read_run_table(self.runs.table, table)

    def of(self, raw: RawTable, problems: Problems) -> tuple[dict[str, str | float], list[str]]:
        """Label and settings told about a raw table outside its columns, and notes about them."""
        told: dict[str, str | float] = {}
        notes: list[str] = []
        self._from_header(raw, told, notes, problems)
        if self.runs is not None:
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
        for name, (line, _) in self.run_table.rows.items():
            if name not in self.used:
                problems.add(f"{self.run_table.path}:{line}: {name} is not among the files read")

    def _from_header(
        self, raw: RawTable, told: dict[str, Any], notes: list[str], problems: Problems
    ) -> None:
        """Header fields whose names are known words."""
        for role in SETTINGS:
            if role not in self.table.names or role in raw.mappings:
                continue
            meant = [f for f in raw.fields if role in roles_meant(f.name, self.table.kind)]
            values = {}
            for found in meant:
                value = self._field_value(role, found, recognised=True)
                if not isinstance(value, str):
                    values[found.name] = value
                elif self.table.column(role).required and not self._stated(role):
                    problems.add(f"{raw.place}: {value}")
                    told[role] = np.nan  # told once what is wrong
            if len(set(values.values())) > 1 and not self._stated(role):
                shown = ", ".join(f"{n} = {v:g}" for n, v in values.items())
                problems.add(
                    f"{raw.place}: header fields {shown} can be {role}, say which: runs: "
                    f'{{{self.table.kind}: {{fields: {{{role}: "{next(iter(values))}"}}}}}}'
                )
            elif values:
                told[role] = next(iter(values.values()))
                if role not in values:
                    notes.append(f"read header field {next(iter(values))} as {role}")

    def _stated(self, role: str) -> bool:
        """Whether the config tells a setting in another way."""
        runs = self.runs
        return runs is not None and (
            getattr(runs.values, role, None) is not None
            or getattr(runs.fields, role, None) is not None
            or (self.pattern is not None and role in self.pattern.names)
            or runs.table is not None
        )

    def _field_value(self, role: str, found: Field, *, recognised: bool) -> float | str:
        """Value of a header field in our unit, or what is wrong with it."""
        column = self.table.column(role)
        plain = read_field(found.name, found.text, found.unit)
        try:
            value = float(plain.text.strip().replace(",", "."))
        except ValueError:
            return f'header field {found.name} = "{found.text}", must be a number'
        by = unit_conversion(
            column,
            found.name,
            plain.unit,
            MappingContext(self.table, self.options),
            recognised and found.name != role,
        )
        if isinstance(by, str):
            return by
        return value if by is None else (value + by.shift) * by.factor

    def _from_fields(self, raw: RawTable, told: dict[str, Any], problems: Problems) -> None:
        """Header fields that the config names."""
        if self.runs is None:
            return
        for role in type(self.runs.fields).model_fields:
            name = getattr(self.runs.fields, role)
            if name is None:
                continue
            found = [f for f in raw.fields if f.name == name]
            if not found:
                known = ", ".join(f.name for f in raw.fields[:20]) or "none"
                problems.add(
                    f"{raw.place}: there is no header field {name} (which the config names for "
                    f"{role}); found: {known}"
                )
                continue
            if role == self.table.label:
                told[role] = found[0].text
                continue
            value = self._field_value(role, found[0], recognised=False)
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
        if values is None and self._complete(raw):
            return
        if values is None:
            problems.add(
                f"{raw.place}: the name is not made up as runs.{self.table.kind}.pattern = "
                f'"{self.runs.pattern}" says'
            )
            return
        for role, text in values.items():
            if role == self.table.label:
                told[role] = text
            elif role in SETTINGS and role in self.table.names:
                unit = self.pattern.units.get(role, self.table.column(role).unit)
                by = conversion(unit, self.table.column(role).unit)
                try:
                    value = number(text)
                except ValueError:
                    problems.add(f'{raw.place}: {role} = "{text}" in the name, must be a number')
                    continue
                if by is None:
                    problems.add(f"{raw.place}: {role} in {unit}, which is no unit of it")
                else:
                    told[role] = (value + by.shift) * by.factor

    def _from_table(self, raw: RawTable, told: dict[str, Any], problems: Problems) -> None:
        if self.run_table is None:
            return
        name = next((n for n in raw.names if n in self.run_table.rows), None)
        if name is None and self._complete(raw):
            return
        if name is None:
            problems.add(f"{self.run_table.path}: has no row for {raw.names[0]}")
            return
        self.used.add(name)
        told.update(self.run_table.rows[name][1])


def fill(columns: dict[str, np.ndarray], told: Mapping[str, str | float], length: int) -> list[str]:
    """Put what is told about a run into its columns; returns the columns it replaced."""
    replaced = []
    for role, value in told.items():
        if isinstance(value, str):
            values = np.empty(length, dtype=object)
            values[:] = value
        else:
            values = np.full(length, float(value))
            before = columns.get(role)
            known = None if before is None else before[np.isfinite(before)]
            if known is not None and known.size and not np.allclose(known, value, rtol=1e-6):
                replaced.append(
                    f"{role} = {value:g} as told replaces {known[0]:g} of the recording"
                )
        columns[role] = values
    return replaced

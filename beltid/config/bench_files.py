"""How the files of a bench differ from ours: names of columns, units, dialect of the CSV.

A section has a key for each column of the table of its kind of recording; so it is made from the
table, and from nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, create_model, field_serializer

from beltid.config.fields import (
    Choice,
    Count,
    Encoding,
    FilePath,
    NamePattern,
    Number,
    OnOff,
    Separator,
    Text,
    UnitOf,
)
from beltid.tables.columns import Column
from beltid.tables.schemas import RECORDINGS, SETTINGS, table
from beltid.tables.units import Calibration

SHOWN: Final = {"deg": "°", "degC": "°C"}
"""Unit of a column -> how a config shows it."""


class Section(BaseModel):
    """A closed, frozen section of the config."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Unstated(Section):
    """A section whose keys mean nothing until they are stated."""


def _model(name: str, base: type[Section], keys: dict[str, Any]) -> Any:
    """A section made of keys, known by its name in this module: workers are sent configs."""
    model = create_model(name, __base__=base, __module__=__name__, **keys)
    globals()[name] = model
    return model


def _of_columns(
    name: str, columns: Iterable[Column], allowed: Callable[[Column], Any]
) -> type[Unstated]:
    """A section with a key for each column; null where nothing is stated."""
    keys = {column.name: (allowed(column) | None, None) for column in columns}
    model: type[Unstated] = _model(name, Unstated, keys)
    return model


def _per_kind(name: str, sections: dict[str, type[Section]]) -> Any:
    """A section with a section for each kind of recording."""
    keys = {kind: (section, section()) for kind, section in sections.items()}
    return _model(name, Section, keys)


def _settings(kind: str) -> list[Column]:
    columns = {column.name: column for column in table(kind).columns}
    return [columns[name] for name in SETTINGS if name in columns]


def _name(column: Column) -> Any:
    return Annotated[str, Text()]


def _unit(column: Column) -> Any:
    return Annotated[Any, UnitOf(column.unit)]


def _value(column: Column) -> Any:
    unit = SHOWN.get(column.unit, column.unit)
    return Annotated[
        float, Number(column.low, column.high, unit, column.open_low, column.open_high)
    ]


_Names: Any = _per_kind(
    "Names", {kind: _of_columns(f"Names_{kind}", table(kind).columns, _name) for kind in RECORDINGS}
)
_Units: Any = _per_kind(
    "Units",
    {
        kind: _of_columns(
            f"Units_{kind}", (c for c in table(kind).columns if c.dtype == "float64"), _unit
        )
        for kind in RECORDINGS
    },
)


class ColumnsSection(_Names):
    """Our name of a column -> its name in the file, per kind of recording."""

    def of(self, kind: str) -> dict[str, str]:
        """The columns that are named otherwise in files of this kind."""
        return _stated(getattr(self, kind))


class UnitsSection(_Units):
    """Our name of a column -> its unit in the file, per kind of recording."""

    def of(self, kind: str) -> dict[str, str | Calibration]:
        """The columns that come in another unit, or as a raw signal, in files of this kind."""
        return _stated(getattr(self, kind))


def _stated(section: Section) -> dict[str, Any]:
    return {name: value for name, value in section if value is not None}


class RunsOfKind(Section):
    """Where label and settings of a run stand that is a file, group or sheet of its own.

    Attributes
    ----------
    pattern : str or None
        How the names of the files (of the groups, where one file holds all runs) are made up.
    table : Path or None
        A CSV file with a row per file.
    fields : Section
        Names of the header fields that hold label and settings.
    values : Section
        Settings that hold for every run.
    """

    pattern: Annotated[str, NamePattern()] | None = None
    table: Annotated[Path, FilePath()] | None = None
    fields: Any
    values: Any

    @field_serializer("table", when_used="json")
    def _table_name(self, table: Path | None) -> str | None:
        """The name without its folder: where a table lies changes no result, its content does."""
        return None if table is None else table.name


def _runs(kind: str) -> type[RunsOfKind]:
    label = table(kind).column(table(kind).label)
    fields = _of_columns(f"Fields_{kind}", [label, *_settings(kind)], _name)
    values = _of_columns(f"Values_{kind}", _settings(kind), _value)
    keys = {"fields": (fields, fields()), "values": (values, values())}
    model: type[RunsOfKind] = _model(f"Runs_{kind}", RunsOfKind, keys)
    return model


_Runs: Any = _per_kind("Runs", {kind: _runs(kind) for kind in RECORDINGS})


class RunsSection(_Runs):
    """Label and settings of runs whose recordings do not hold them, per kind of recording."""

    def of(self, kind: str) -> RunsOfKind:
        """What is said about the runs of a kind of recording."""
        runs: RunsOfKind = getattr(self, kind)
        return runs

    @property
    def tables(self) -> dict[str, Path]:
        """The tables that are named, by the kind of recording."""
        return {kind: found for kind in RECORDINGS if (found := self.of(kind).table) is not None}


class DialectSection(Section):
    """How the CSV files of the bench are written; null means: found out from the file."""

    separator: Annotated[str, Separator()] | None = None
    decimal: Annotated[Literal[".", ","], Choice((".", ","))] | None = None
    encoding: Annotated[str, Encoding()] | None = None
    skip_lines: Annotated[int, Count(0, 10_000)] = 0
    units_row: Annotated[bool, OnOff()] = False

"""What a config may say about the layout of a bench's files: its keys are our columns."""

from __future__ import annotations

from typing import Any, Final

from beltid.config.checks import Check, Keys, Number, complain, file_path, pattern_of_names, unit_of
from beltid.config.checks import text as any_text
from beltid.tables.columns import Column
from beltid.tables.schemas import SETTINGS, table

KINDS: Final = ("press", "rig", "speedloss")
"""Kinds of recordings of which a config may speak; what it says of the rig serves its plateaus."""
SYMBOLS: Final = {"deg": "°", "degC": "°C"}
"""Unit of a column -> its symbol in a config."""


def _value(column: Column) -> Check:
    """Return the check of a setting that the config states for all runs."""

    def choice(value: Any) -> Any:
        if value not in column.choices:
            raise complain(column.allowed)
        return value

    if column.dtype == "string":
        return choice if column.choices else any_text
    unit = SYMBOLS.get(column.unit, column.unit)
    return Number(column.low, column.high, unit, column.open_low, column.open_high)


def _columns(kind: str) -> list[Column]:
    """Return the columns that a config may name; those of the rig serve its plateaus, too."""
    tables = [table("points"), table(kind)] if kind == "rig" else [table(kind)]
    return list({column.name: column for of in tables for column in of.columns}.values())


def _runs(kind: str) -> Keys:
    settings = [column for column in _columns(kind) if column.name in SETTINGS]
    values = {column.name: _value(column) for column in settings}
    files = {"pattern": pattern_of_names, "table": file_path}
    return Keys({**files, "values": Keys(values)}, dict.fromkeys(files))


def _names(kind: str) -> Keys:
    return Keys({column.name: any_text for column in _columns(kind)})


def _units(kind: str) -> Keys:
    return Keys({c.name: unit_of(c.unit) for c in _columns(kind) if c.dtype == "float64"})


COLUMNS: Final = Keys({kind: _names(kind) for kind in KINDS})
UNITS: Final = Keys({kind: _units(kind) for kind in KINDS})
RUNS: Final = Keys({kind: _runs(kind) for kind in KINDS})

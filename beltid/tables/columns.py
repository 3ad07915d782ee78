"""Column and table definitions: names, types, units, ranges, meanings."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

DType = Literal["float64", "int64", "bool", "string", "list"]


@dataclass(frozen=True, slots=True)
class Column:
    """One column of a table.

    Attributes
    ----------
    name : str
        Public name, with the unit as suffix.
    dtype : {"float64", "int64", "bool", "string", "list"}
        Type; "list" is a list of float64 that has the same length in all rows.
    unit : str
        Unit; "" for none, "1" for a dimensionless number.
    meaning : str
        Description.
    nullable : bool
        Whether a value may be missing (nan, or None in a string column).
    low, high : float
        Range of allowed values.
    open_low, open_high : bool
        Whether a bound itself is excluded.
    required : bool
        Whether the table must have the column.
    length : int
        Length of a list; 0: any, but equal in all rows.
    choices : tuple of str
        Allowed texts; empty: any.
    """

    name: str
    dtype: DType
    unit: str
    meaning: str
    nullable: bool = False
    low: float = -math.inf
    high: float = math.inf
    open_low: bool = False
    open_high: bool = False
    required: bool = True
    length: int = 4
    choices: tuple[str, ...] = ()

    @property
    def allowed(self) -> str:
        """Allowed range as text, ``> 0`` or ``in (0, 360)``, or the allowed texts."""
        if self.choices:
            return " or ".join(filter(None, [", ".join(self.choices[:-1]), self.choices[-1]]))
        return interval(self.low, self.high, open_low=self.open_low, open_high=self.open_high)


def interval(low: float, high: float, *, open_low: bool, open_high: bool) -> str:
    """Format a range: ``> 0``, ``in (0, 360)``, or ``finite`` without bounds."""
    if math.isinf(low) and math.isinf(high):
        return "finite"
    if math.isinf(high):
        return f"{'>' if open_low else '>='} {low:g}"
    if math.isinf(low):
        return f"{'<' if open_high else '<='} {high:g}"
    left, right = "[("[open_low], "])"[open_high]
    return f"in {left}{low:g}, {high:g}{right}"


@dataclass(frozen=True, slots=True)
class Table:
    """One kind of table.

    Attributes
    ----------
    kind : str
        Name of the kind.
    version : int
        Schema version; it changes when the name, unit or meaning of a column changes.
    command : str
        Command or bench that writes it, for messages.
    columns : tuple of Column
        Columns in order.
    label : str
        Column with the label of a run or test; "" if there is none.
    """

    kind: str
    version: int
    command: str
    columns: tuple[Column, ...]
    label: str = ""

    def column(self, name: str) -> Column:
        """Return a column by name; KeyError if there is none."""
        for column in self.columns:
            if column.name == name:
                return column
        raise KeyError(f"a {self.kind} table has no column {name}")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all columns, in order."""
        return tuple(column.name for column in self.columns)


def positive(name: str, unit: str, meaning: str, *, nullable: bool = False) -> Column:
    """Define a column of numbers > 0."""
    return Column(name, "float64", unit, meaning, nullable, 0.0, open_low=True)


def nonnegative(name: str, unit: str, meaning: str, *, nullable: bool = False) -> Column:
    """Define a column of numbers >= 0."""
    return Column(name, "float64", unit, meaning, nullable, 0.0)


def standard_error(name: str, unit: str) -> Column:
    """Define a column of uncertainties from noise alone; values may be missing."""
    return nonnegative(name, unit, "standard error", nullable=True)


def uncertainty(name: str, unit: str) -> Column:
    """Define a column of uncertainties from noise and benches; values may be missing."""
    return nonnegative(name, unit, "combined standard uncertainty", nullable=True)


def real(name: str, unit: str, meaning: str, *, nullable: bool = True) -> Column:
    """Define a column of finite numbers; values may be missing unless `nullable` is False."""
    return Column(name, "float64", unit, meaning, nullable)


def numbers(name: str, unit: str, meaning: str) -> Column:
    """Define a column of lists of equal length; values may be missing."""
    return Column(name, "list", unit, meaning, nullable=True, length=0)


def count(name: str, meaning: str) -> Column:
    """Define a column of whole numbers >= 0."""
    return Column(name, "int64", "1", meaning, low=0)


def text(name: str, meaning: str, *, nullable: bool = False) -> Column:
    """Define a column of texts."""
    return Column(name, "string", "", meaning, nullable)


def optional(*columns: Column) -> tuple[Column, ...]:
    """Mark columns that a table may lack."""
    return tuple(replace(column, required=False) for column in columns)

"""Column and table definitions: names, types, units, ranges, meanings; read from their text."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final, Literal

DType = Literal["float64", "int64", "bool", "string", "list"]
RANGE: Final = re.compile(r"(>=?) (\S+)|([\[(])(\S+), (\S+)([\])])")
LENGTH_OF_LIST: Final = re.compile(r"list(?: of (\d+))?")


@dataclass(frozen=True, slots=True)
class Column:
    """One column of a table.

    The unit of its public `name` is the suffix; `unit` is "" for none and "1" for a dimensionless
    number. A `nullable` column may miss values (nan, or None among texts), a table may lack one
    that is not `required`. Lists hold float64 and have the same `length` in all rows (0: any).
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
    length: int = 0
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
    left, right = "[("[open_low], "])"[open_high]
    return f"in {left}{low:g}, {high:g}{right}"


@dataclass(frozen=True, slots=True)
class Table:
    """One kind of table: what writes it, and the column with the label of a run ("": none)."""

    kind: str
    command: str
    label: str
    columns: tuple[Column, ...]
    version: int = 1

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


def table_of(text: str) -> Table:
    """Read a table from its text: its head, and a line per column; see `beltid.tables.schemas`."""
    head, *lines = text.splitlines()
    kind, _, by = head.partition(": ")
    command, _, label = by.partition(", by ")
    return Table(kind, command, label, tuple(map(column_of, lines)))


def column_of(line: str) -> Column:
    """Read a column from its line: name, values, unit, meaning, with two blanks between them."""
    name, values, unit, meaning = re.split(" {2,}", line.strip())
    kind = values.removesuffix("?")
    words = {"count": "int64", "flag": "bool", "text": "string"}
    dtype = words.get(kind, "list" if LENGTH_OF_LIST.match(kind) else "float64")
    more: dict[str, object] = {"nullable": kind != values, "required": not name.endswith("?")}
    if " | " in kind:
        dtype, more["choices"] = "string", tuple(kind.split(" | "))
    elif kind == "count":
        more["low"] = 0.0
    elif of := LENGTH_OF_LIST.match(kind):
        more["length"] = int(of[1] or 0)
    elif of := RANGE.fullmatch(kind):
        more |= {"low": float(of[2] or of[4]), "open_low": (of[1] or of[3]) in (">", "(")}
        more |= {"high": float(of[5] or "inf"), "open_high": of[6] == ")"}
    elif kind not in (*words, "number"):
        raise ValueError(f"{line}: cannot be read as a column")
    return Column(name.removesuffix("?"), dtype, unit.removeprefix("-"), meaning, **more)  # type: ignore[arg-type]

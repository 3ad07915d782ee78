"""What a command shows its user: facts, tables, notes, a verdict; as text, as JSON, as CSV.

Names and values of results become words, units and sensible digits in one place, for pages, too.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from beltid.errors import printable

GAP = 3  # between two columns
Rows = list[dict[str, Any]]
# parts of the units at the end of public names, as printed
UNITS = dict(
    zip(
        ("N", "W", "Hz", "kg", "m", "mm", "s", "rad", "m2", "m3", "deg", "degC", "percent"),
        ("N", "W", "Hz", "kg", "m", "mm", "s", "rad", "m²", "m³", "°", "°C", "%"),
        strict=True,
    )
)
# what a column in a chart is, by a word of its name: words with symbol, unit, scale
QUANTITIES = {
    "mu": ("friction coefficient µ", "-", 1.0),
    "force": ("normal force per length", "N/m", 1.0),
    "slip_speed": ("sliding speed v", "mm/s", 1e3),
    "penetration": ("penetration δ", "µm", 1e6),
    "torque": ("torque", "N m", 1.0),
    "loss": ("speed loss", "rad/s", 1.0),
    "tension": ("tension", "N", 1.0),
    "arc_position": ("position along the arc from the tight side", "mm", 1e3),
    "time": ("time", "s", 1.0),
}
RANGES = ("range", "valid", "measured")
MISSING = "-"


def name_and_unit(name: str) -> tuple[str, str]:
    """Split a public name into words and unit."""
    words, unit = name.split("_"), list[str]()
    while len(words) > 1 and words[-1] in UNITS:
        unit.insert(0, UNITS[words.pop()])
    over = " " if words[-1].endswith("torque") else "/"
    return " ".join(words), over.join([" ".join(unit[:-1]), unit[-1]] if unit[1:] else unit)


def quantity(name: str) -> tuple[str, str, float]:
    """Return words with symbol, unit and scale with which a column stands in charts."""
    return next(of for word, of in QUANTITIES.items() if word in name)


def axis(name: str) -> str:
    """Return the label of an axis: words with the symbol, and the unit in brackets."""
    words, unit, _ = quantity(name)
    return f"{words} [{unit}]"


def cell(name: str, value: Any) -> str:
    """Format a value with the digits suited to its quantity; ``-`` if missing."""
    value = value.item() if hasattr(value, "item") else value
    if value is None or value != value:
        return MISSING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (list, tuple)):
        cells = [cell(name, item) for item in value]
        is_range = len(cells) == 2 and any(word in name for word in RANGES)
        return between(*cells) if is_range else ", ".join(cells)
    return _number(name, value) if isinstance(value, float) else str(value)


def fact(name: str, value: Any) -> tuple[str, str]:
    """Return the words of a single result, and its value with unit."""
    (words, unit), text = name_and_unit(name), cell(name, value)
    return words, f"{text} {unit}" if unit and text != MISSING else text


class Table(NamedTuple):
    """A formatted table; `numeric` tells which columns contain numbers, or ranges of them."""

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    numeric: Sequence[bool]


def table(title: str, rows: Sequence[Mapping[str, Any]], names: Sequence[str] = ()) -> Table | None:
    """Build a table from named columns of rows, by default of all; None without rows."""
    chosen = names or list(dict.fromkeys(name for row in rows for name in row))
    cells = [[cell(name, row.get(name)) for name in chosen] for row in rows]
    number = re.compile(rf"{MISSING}|-*\d(.*\d)?", re.DOTALL)
    numeric = [all(map(number.fullmatch, column)) for column in zip(*cells, strict=True)]
    named = ((words, unit.replace(" ", "\u00a0")) for words, unit in map(name_and_unit, chosen))
    heads = [f"{words} [{unit}]" if unit else words for words, unit in named]  # units do not wrap
    return Table(title, heads, cells, numeric) if rows else None


def between(low: str, high: str) -> str:
    """Format a range; a single value if the two ends are equal."""
    return low if low == high else f"{low} to {high}"


def sentence(text: str) -> str:
    """Capitalize the first letter of a text."""
    return text[:1].upper() + text[1:]


def _number(name: str, value: float) -> str:
    # uncertainties are themselves uncertain: two digits
    if "_se_" in f"{name}_" or "_u_" in f"{name}_":
        return f"{value:.2g}"
    if name.startswith("mu") and math.isfinite(value):
        return f"{value:.4f}"
    if name.endswith("_percent"):
        return f"{round(value, 2) + 0.0:.2f}"  # no -0.00
    if value == 0.0:
        return "0"
    if 1e-3 <= abs(value) < 1e6:
        text = f"{value:.{max(0, 3 - math.floor(math.log10(abs(value))))}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    return f"{value:.5g}"


@dataclass(frozen=True, slots=True)
class Summary:
    """What a command shows, for people and programs."""

    stage: str  # name of the command, such as "fit-friction"
    title: str  # of the table
    out: Path | None = None  # the file with the result
    facts: dict[str, Any] = field(default_factory=dict)  # by name, whose suffix is the unit
    table: Rows = field(default_factory=list)  # the complete result for programs
    overview: Rows = field(default_factory=list)  # short form of a long table for the terminal
    shown: tuple[str, ...] = ()  # columns of the complete table that people see; empty for all
    details: dict[str, Rows] = field(default_factory=dict)  # further tables by title
    always: tuple[str, ...] = ()  # titles of those that are always shown; the others on request
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()  # problems that the user should check
    verdict: str = ""  # final line, such as "PASS: ..."; empty if nothing is judged
    exit_status: int = 0
    up_to_date: bool = False  # whether an earlier artifact from the same inputs was kept
    origin: str | None = None  # of the data: "measured", "synthetic", None if not stated
    snippet: str = ""  # lines to copy into a file, such as a section of a config
    parts: tuple[Summary, ...] = ()  # of several inputs, one after the other

    def as_json(self) -> dict[str, Any]:
        """Convert to one JSON object; missing numbers become null."""
        from beltid.store.artifact import plain

        return {
            "command": self.stage,
            "out": None if self.out is None else str(self.out),
            "up_to_date": self.up_to_date,
            "exit_status": self.exit_status,
            "verdict": self.verdict or None,
            "origin": self.origin,
            "facts": plain(self.facts),
            "table": plain(self.table),
            "details": plain(self.details),
            "notes": list(self.notes),
            "warnings": list(self.warnings),
            **({"snippet": self.snippet} if self.snippet else {}),
            **({"parts": [part.as_json() for part in self.parts]} if self.parts else {}),
        }


def rows_of(columns: Mapping[str, Any]) -> Rows:
    """Return the rows of a table as plain values; nan becomes None."""
    cells = ([None if v != v else v for v in values.tolist()] for values in columns.values())
    return [dict(zip(columns, row, strict=True)) for row in zip(*cells, strict=True)]


def csv_bytes(columns: Mapping[str, Any], origin: str | None) -> bytes:
    """Return a whole table as CSV, with the origin of its data as a column.

    Columns with several numbers in a cell are left out; a text that a spreadsheet would take for a
    formula gets an apostrophe.
    """
    import pandas as pd

    frame = pd.DataFrame({name: values for name, values in columns.items() if values.ndim == 1})
    frame = frame.replace(r"^(?=[=+@-])", "'", regex=True)
    if origin is not None:
        frame["origin"] = origin
    return frame.to_csv(index=False, lineterminator="\n").encode()


def show(summary: Summary, console: Any, *, complete: bool = False) -> None:
    """Print a summary on a console of rich, whose width decides between table and records.

    `complete`: long tables instead of their overview, and all further tables.
    """
    with console.capture() as capture:
        for part in _renderables(summary, console.width, complete):
            # do not wrap lines that the user copies
            unwrapped = getattr(part, "no_wrap", None) is True
            console.print(part, markup=False, highlight=False, soft_wrap=unwrapped)
    # strip the blanks with which a table fills its last column: they disturb programs
    console.file.write("\n".join(map(str.rstrip, capture.get().splitlines())).strip("\n") + "\n")


def _renderables(summary: Summary, width: int, complete: bool) -> Iterator[Any]:
    """Yield the parts of a summary in order: heading, facts, tables, verdict."""
    from rich.table import Column, Table as Grid
    from rich.text import Text

    suffix = " (synthetic data)" if summary.origin == "synthetic" else ""
    if summary.title:
        yield Text(f"{summary.stage}{suffix}: {summary.title}", style="bold")
    for part in summary.parts:
        yield from _renderables(part, width, complete)
        yield Text("")
    grid = Grid.grid(Column(overflow="fold"), Column(overflow="fold"), padding=(0, 2, 0, 2))
    for name, value in summary.facts.items():
        items = value if isinstance(value, (list, tuple)) else (value,)
        if not any(isinstance(item, dict) for item in items):  # tables are for programs only
            grid.add_row(*(Text(printable(text)) for text in fact(name, value)))
    if summary.facts:
        yield grid
    names = summary.shown or tuple(summary.table[0] if summary.table else ())
    first = (summary.table, names) if complete or not summary.overview else (summary.overview,)
    details = [(t, rows) for t, rows in summary.details.items() if complete or t in summary.always]
    for title, *what in (("", *first), *details):
        if shown := table(title, *what):
            yield from [Text(title, style="bold")] if title else []
            yield _table_or_records(shown, width)
    if summary.snippet:
        yield Text(f"\n{summary.snippet}", no_wrap=True)
    if summary.verdict:
        yield Text(summary.verdict, style=f"bold {'red' if summary.exit_status else 'green'}")
    if summary.out is not None:
        # a path must not wrap, so that it can be copied
        yield Text(f"{summary.out}", overflow="ignore", no_wrap=True)


def _table_or_records(shown: Table, room: int) -> Any:
    """Render a table if it fits the console, otherwise each of its rows as a record."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table as Grid
    from rich.text import Text

    heads, cells = shown.headings, zip(shown.headings, *shown.rows, strict=True)
    # numbers stay whole, headings may wrap
    widths = [max(map(len, [*head.split(" "), *column])) for head, *column in cells]
    if not shown.numeric[-1]:
        widths[-1] = min(widths[-1], 24)  # words in the last column may wrap
    if sum(widths) + GAP * len(widths) > room:
        rows = (map("{}: {}".format, heads, row) for row in shown.rows)
        return Text("\n".join("- " + "\n  ".join(map(printable, row)) for row in rows))
    grid = Grid(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1), header_style="bold")
    for head, width, is_number in zip(heads, widths, shown.numeric, strict=True):
        grid.add_column(
            Text(printable(head)),
            justify="right" if is_number else "left",
            width=width,
            overflow="fold",
        )
    for row in shown.rows:
        grid.add_row(*(Text(printable(text)) for text in row))
    return grid

"""What a command shows its user: facts, a table, notes, a verdict; and tables as CSV."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

Rows = list[dict[str, Any]]


def rows_of(columns: Mapping[str, np.ndarray], *names: str) -> Rows:
    """Return rows of the named columns of a table as plain values; nan becomes None.

    A table may lack a column.
    """
    chosen = [name for name in names if name in columns]
    cells = [[_plain(v) for v in columns[name].tolist()] for name in chosen]
    return [dict(zip(chosen, row, strict=True)) for row in zip(*cells, strict=True)]


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and math.isnan(value) else value


def csv_bytes(columns: Mapping[str, np.ndarray], origin: str | None) -> bytes:
    """Return a whole table as CSV, with the origin of its data as a column.

    Columns with several numbers in a cell are left out.
    """
    import pandas as pd

    frame = pd.DataFrame(
        {
            name: [_no_formula(label) for label in values] if values.dtype == object else values
            for name, values in columns.items()
            if values.ndim == 1
        }
    )
    if origin is not None:
        frame["origin"] = origin
    return frame.to_csv(index=False, lineterminator="\n").encode()


def _no_formula(value: Any) -> Any:
    """Put an apostrophe before a text that a spreadsheet would take for a formula."""
    is_formula = isinstance(value, str) and value.startswith(("=", "+", "-", "@"))
    return f"'{value}" if is_formula else value


@dataclass(frozen=True, slots=True)
class Summary:
    """What a command shows, for people and programs.

    Attributes
    ----------
    stage, title : str
        Name of the command, such as ``"fit-friction"``; title of the table.
    out : Path or None
        The file with the result.
    facts : dict
        Single results by name; the suffix of the name is the unit.
    table : list of dict
        The complete result for programs, one row per record.
    overview : list of dict
        Short form of a long table for the terminal; empty if the table is short.
    shown : tuple of str
        Columns of the complete table that are shown to people; empty for all.
    extra_tables, details : dict of str to list of dict
        Further tables by title: short ones, always shown; those shown on request.
    notes, warnings : tuple of str
        Information for the user; problems that the user should check.
    verdict, exit_status : str, int
        Final line, such as ``"PASS: ..."``, empty if nothing is judged; status of the command.
    up_to_date : bool
        Whether an earlier artifact from the same inputs was kept.
    origin : str or None
        Origin of the data: "measured", "synthetic", None if not stated.
    snippet : str
        Lines to copy into a file, such as a section of a config.
    parts : tuple of Summary
        Summaries of several inputs, one after the other.
    """

    stage: str
    title: str
    out: Path | None = None
    facts: dict[str, Any] = field(default_factory=dict)
    table: Rows = field(default_factory=list)
    overview: Rows = field(default_factory=list)
    shown: tuple[str, ...] = ()
    extra_tables: dict[str, Rows] = field(default_factory=dict)
    details: dict[str, Rows] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    verdict: str = ""
    exit_status: int = 0
    up_to_date: bool = False
    origin: str | None = None
    snippet: str = ""
    parts: tuple[Summary, ...] = ()

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
            "details": plain({**self.extra_tables, **self.details}),
            "notes": list(self.notes),
            "warnings": list(self.warnings),
            **({"snippet": self.snippet} if self.snippet else {}),
            **({"parts": [part.as_json() for part in self.parts]} if self.parts else {}),
        }

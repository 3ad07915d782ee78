"""What a stage tells its user when it has finished: facts, a table, notes, a verdict."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from beltid.artifacts.metadata_models import Origin, plain


def combined_origin(origins: Collection[str | None]) -> Origin | None:
    """Origin of what is made from data of some origins; None if nobody said, or of no data.

    One synthetic input makes the result synthetic.
    """
    if "synthetic" in origins:
        return "synthetic"
    return "measured" if set(origins) == {"measured"} else None


@dataclass(frozen=True, slots=True)
class Summary:
    """The product of a stage as a person or a program reads it.

    Attributes
    ----------
    stage : str
        Name of the command, such as ``"fit-friction"``.
    title : str
        What the table shows, in words.
    out : Path or None
        The artifact that holds the result.
    facts : dict
        Single results by name; the unit is the ending of the name.
    table : list of dict
        The complete result, one row per record: what a program gets.
    overview : list of dict
        A short form of a long table for the terminal; empty where the table is short itself.
    shown : tuple of str
        Columns of the complete table that a person gets to see; empty for all of them.
    beside : dict of str to list of dict
        Short further tables by their name that everybody gets to see.
    details : dict of str to list of dict
        Further tables by their name, for the curious and for programs.
    notes, warnings : tuple of str
        What the user should know; what the user should look into.
    verdict : str
        Final line, such as ``"PASS: ..."``; empty where nothing is judged.
    exit_status : int
        Exit status of the command line.
    up_to_date : bool
        Whether an artifact made earlier from the same inputs was kept.
    origin : str or None
        Where the data come from: "measured", "synthetic", None where nobody said. Synthetic data
        are called so wherever they are shown.
    snippet : str
        Lines to be copied into a file, such as a section of a config.
    drawing : Figure or None
        A figure, shown in the terminal as well as it can be.
    parts : tuple of Summary
        What is told of each of several inputs, one after the other.
    """

    stage: str
    title: str
    out: Path | None = None
    facts: dict[str, Any] = field(default_factory=dict)
    table: list[dict[str, Any]] = field(default_factory=list)
    overview: list[dict[str, Any]] = field(default_factory=list)
    shown: tuple[str, ...] = ()
    beside: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    details: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    verdict: str = ""
    exit_status: int = 0
    up_to_date: bool = False
    origin: str | None = None
    snippet: str = ""
    drawing: Any = None
    parts: tuple[Summary, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """One JSON object; a missing number is null."""
        return {
            "command": self.stage,
            "out": None if self.out is None else str(self.out),
            "up_to_date": self.up_to_date,
            "exit_status": self.exit_status,
            "verdict": self.verdict or None,
            "origin": self.origin,
            "facts": plain(self.facts),
            "table": plain(self.table),
            "details": plain({**self.beside, **self.details}),
            "notes": list(self.notes),
            "warnings": list(self.warnings),
            **({"snippet": self.snippet} if self.snippet else {}),
            **({"parts": [part.as_json() for part in self.parts]} if self.parts else {}),
        }

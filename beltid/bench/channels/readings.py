"""What is asked of the channels of a file, and how one of them is read."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from beltid.bench.formats.dialect import ReadOptions
from beltid.bench.formats.table_head import unit_in_name
from beltid.bench.problems import Problems
from beltid.tables.columns import Table
from beltid.tables.units import Conversion

How = Literal["config", "own name", "recognised"]


@dataclass(frozen=True, slots=True)
class Candidate:
    """A channel that may be one of our columns.

    Attributes
    ----------
    name, unit : str
        As the file writes them.
    key : object
        Where the reader finds it.
    group : str
        Group it stands in, "" where the file has no groups.
    """

    name: str
    unit: str
    key: Any
    group: str = ""

    @property
    def shown(self) -> str:
        """Name and unit in words."""
        return (
            f"{self.name} [{self.unit}]" if self.unit and not unit_in_name(self.name) else self.name
        )

    @property
    def qualified(self) -> str:
        """The name with its group: ``group/name``."""
        return f"{self.group}/{self.name}"


@dataclass(frozen=True, slots=True)
class Reading:
    """How one of our columns is read.

    Attributes
    ----------
    role : str
        Our column.
    candidate : Candidate
        The channel.
    how : {"config", "own name", "recognised"}
        Who says so.
    conversion : Conversion
        From the numbers in the file, with the sign.
    unit_stated : bool
        Whether file or config tells the unit.
    negated : bool
        Whether the sign is turned.
    """

    role: str
    candidate: Candidate
    how: How
    conversion: Conversion = field(default_factory=lambda: Conversion(1.0))
    unit_stated: bool = False
    negated: bool = False

    @property
    def shown(self) -> str:
        """How messages call the column."""
        name = self.candidate.name
        return self.role if name == self.role else f'{self.role} (column "{name}")'


@dataclass(frozen=True, slots=True)
class Question:
    """What is asked of the channels of a file.

    Attributes
    ----------
    table : Table
        What is needed.
    options : ReadOptions
        What the config states.
    place : str
        Place of the names, for messages.
    problems : Problems
        Collects what cannot be decided.
    """

    table: Table
    options: ReadOptions
    place: str = ""
    problems: Problems = field(default_factory=Problems)

    @property
    def kind(self) -> str:
        """Kind of recording."""
        return self.table.kind

    def complain(self, text: str) -> None:
        """Note what cannot be decided."""
        self.problems.add(f"{self.place}: {text}")

"""Errors that a user can correct.

Every error of the package is a :class:`BeltidError` and carries the exit status that the command
line returns for it. Anything else that escapes is a bug.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

LONGEST_LINE = 4000  # message shown [characters]; hostile files have names of megabytes
SHOWN = 20  # problems of a file
ALIKE = 3  # similar problems, one by one
PlaceOf = Callable[[int], tuple[str, int]]
"""Row index -> text of its place, and its line number for sorting the messages."""
EXIT_DONE = 0
EXIT_BUG = 1
EXIT_INPUT = 2
EXIT_NUMERICS = 3
EXIT_OUT_OF_TOLERANCE = 4
EXIT_BATCH_FAILED = 5


def printable(text: str) -> str:
    """Escape line breaks, terminal control characters and text-direction marks in a text."""

    def escaped(c: str) -> str:
        return c if c.isprintable() or unicodedata.category(c) == "Zs" else ascii(c)[1:-1]

    return _shortened("".join(map(escaped, _shortened(text))))


def percent(value: float) -> str:
    """Format a percentage with two significant digits, never as a power of ten."""
    return f"{float(f'{value:.2g}'):g} %"


def counted(number: int, what: str) -> str:
    """Format a count with its noun: ``1 run``, ``120 runs``."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _shortened(text: str) -> str:
    return text if len(text) <= LONGEST_LINE else f"{text[: LONGEST_LINE - 300]} ... {text[-295:]}"


class BeltidWarning(UserWarning):
    """Warning about a result that was obtained but needs the user's attention."""


class BeltidError(Exception):
    """Base class of all errors that a user can correct.

    Attributes
    ----------
    exit_status : int
        Exit status of the command line for this error.
    problems : tuple of str
        A printable line per problem, each with its place, what was found and what is allowed.
    """

    exit_status: int = EXIT_INPUT

    def __init__(self, problems: str | Sequence[str]) -> None:
        lines = (problems,) if isinstance(problems, str) else problems
        self.problems: tuple[str, ...] = tuple(map(printable, lines))
        super().__init__("\n".join(self.problems))

    def at(self, place: str) -> list[str]:
        """Prefix every line with a place, for a caller that knows the place and re-raises."""
        return [f"{place}: {line}" for line in self.problems]


class InputError(BeltidError):
    """Invalid recording, config, artifact or argument (status 2)."""


class NotPossible(InputError):
    """The recordings do not allow this computation; a chain of steps does without."""


class ConfigError(InputError):
    """Invalid config file; each problem gives file, line, column and key path."""


class ArtifactError(InputError):
    """Artifact that is damaged, of the wrong kind, or of a schema this version cannot read."""


class NumericsError(BeltidError):
    """Numerical failure: no trustworthy result was obtained (status 3)."""

    exit_status = EXIT_NUMERICS


class ConvergenceError(NumericsError):
    """Iteration that did not converge."""


@dataclass(slots=True)
class Problems:
    """Collector of the problems of one file, reported together in line order."""

    found: list[tuple[int, str]] = field(default_factory=list)  # line (0: whole file), text

    def add(self, text: str, line: int = 0) -> None:
        """Add a problem."""
        self.found.append((line, text))

    def add_alike(
        self, rows: Sequence[int] | np.ndarray, text: Callable[[int], str], place: PlaceOf
    ) -> None:
        """Add the same problem of several rows, by their index; of many, the first and a count."""
        more = f" ({len(rows) - 1} more like it)" if len(rows) > ALIKE else ""
        for row in rows[:1] if more else rows:
            where, line = place(int(row))
            self.add(f"{where}: {text(int(row))}{more}", line)

    def raise_if_any(self) -> None:
        """Raise an InputError that lists the first problems and counts the rest."""
        if not self.found:
            return
        lines = [text for _, text in sorted(self.found, key=lambda item: item[0])]
        more = [f"and {len(lines) - SHOWN} more"] if len(lines) > SHOWN else []
        raise InputError([*lines[:SHOWN], *more])

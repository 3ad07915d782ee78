"""Everything that goes wrong for a reason a user can mend.

Every error of the package is a :class:`BeltidError` and carries the exit status that the command
line returns for it. Anything else that escapes is a bug.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Self

if TYPE_CHECKING:
    import numpy as np

LONGEST_LINE: Final = 4000
"""Characters of a message that are shown; hostile files have names of megabytes."""
SHOWN: Final = 20
"""Problems of one file that are shown."""
ALIKE: Final = 3
"""Problems of one kind that are shown one by one."""
PlaceOf = Callable[[int], tuple[str, int]]
"""Index of a row -> its place in words, and its line for the order of messages."""
EXIT_DONE = 0
EXIT_INPUT = 2
EXIT_NUMERICS = 3
EXIT_OUT_OF_TOLERANCE = 4
EXIT_BATCH_FAILED = 5


def printable(text: str) -> str:
    """A text on one line, without characters that command a terminal or turn the reading order.

    Parameters
    ----------
    text : str
        Anything, such as a cell of a file in a message.
    """
    text = _shortened(text)
    if text.isprintable():
        return text
    return _shortened(
        "".join(
            c if c.isprintable() or unicodedata.category(c) == "Zs" else ascii(c)[1:-1]
            for c in text
        )
    )


def percent(value: float) -> str:
    """A value in percent with two digits, never as a power of ten.

    Examples
    --------
    >>> percent(0.144), percent(99.7)
    ('0.14 %', '100 %')
    """
    return f"{float(f'{value:.2g}'):g} %"


def counted(number: int, what: str) -> str:
    """A number of things, one of them without an s.

    Examples
    --------
    >>> counted(1, "run"), counted(120, "run")
    ('1 run', '120 runs')
    """
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _shortened(text: str) -> str:
    if len(text) <= LONGEST_LINE:
        return text
    return f"{text[: LONGEST_LINE - 300]} ... {text[-295:]}"


class Problem(str):
    """A line of an error, and the code of the page that explains it.

    Attributes
    ----------
    code : str
        The code, for ``beltid explain``; "" where there is no page.
    """

    code: str

    def __new__(cls, text: str, code: str = "") -> Self:  # noqa: D102
        line = super().__new__(cls, text)
        line.code = code or getattr(text, "code", "")
        return line


class BeltidWarning(UserWarning):
    """A result was obtained, but the user should know something about it."""


class BeltidError(Exception):
    """Base of all errors with a reason that a user can mend.

    Parameters
    ----------
    problems : str or sequence of str
        One line per problem, each with its place, what was found and what is allowed.
    code : str
        Code of the page that explains the lines that are no `Problem` with a code of its own.

    Attributes
    ----------
    exit_status : int
        Exit status of the command line for this error.
    code : str
        Code of the page that explains all errors of a class, or "".
    problems : tuple of Problem
        The lines; what they quote is made printable.
    """

    exit_status: int = EXIT_INPUT
    code: str = ""

    def __init__(self, problems: str | Sequence[str], *, code: str = "") -> None:
        given = (problems,) if isinstance(problems, str) else problems
        own = code or self.code
        self.problems: tuple[Problem, ...] = tuple(
            Problem(printable(line), getattr(line, "code", "") or own) for line in given
        )
        super().__init__("\n".join(self.problems))

    @property
    def codes(self) -> tuple[str, ...]:
        """Codes of the pages that explain it, in the order of the lines."""
        return tuple(dict.fromkeys(line.code for line in self.problems if line.code))

    def at(self, place: str) -> list[Problem]:
        """The lines with a place before each, for the error of whoever knows it."""
        return [Problem(f"{place}: {line}", line.code) for line in self.problems]


class InputError(BeltidError):
    """A recording, a config, an artifact or an argument is not what it must be (status 2)."""


class ArgumentTypeError(InputError, TypeError):
    """An argument of a call in Python is of the wrong kind; says what is meant, and where from."""


class TooFewSettings(InputError):
    """Too few settings of the bench were measured for what was asked of them."""


class ConfigError(InputError):
    """A config file is wrong; each problem carries file, line, column and key path."""


class ArtifactError(InputError):
    """An artifact is damaged, of another kind, or of a schema that this version does not read."""


class NumericsError(BeltidError):
    """The numerics could not give a result that may be trusted (status 3)."""

    exit_status = EXIT_NUMERICS
    code = "numerics"


class ConvergenceError(NumericsError):
    """An iteration did not converge.

    Attributes
    ----------
    iterations : int
        Iterations spent.
    residual : float
        Last residual, in the unit that the message states.
    """

    def __init__(
        self, problems: str | Sequence[str], *, iterations: int = 0, residual: float = float("nan")
    ) -> None:
        super().__init__(problems)
        self.iterations = iterations
        self.residual = residual


class FitError(NumericsError):
    """A fit was refused: the data do not determine a law that is physically admissible."""


@dataclass(slots=True)
class Problems:
    """Problems of one file, told together in the order of its lines.

    Attributes
    ----------
    found : list of (int, Problem)
        Line (0 for the whole file) and wording of the problems that are kept.
    count : int
        How many there were, with those that were not kept.
    unread : set of str
        Places of rows with a cell that could not be read: what such a row lacks is told already.
    """

    found: list[tuple[int, Problem]] = field(default_factory=list)
    count: int = 0
    unread: set[str] = field(default_factory=set)

    def add(self, text: str, line: int = 0, code: str = "") -> None:
        """Note a problem; beyond a few hundred only their number is kept."""
        self.count += 1
        if len(self.found) < 20 * SHOWN:
            self.found.append((line, Problem(text, code)))

    def add_alike(
        self, rows: Sequence[int] | np.ndarray, text: Callable[[int], str], place: PlaceOf
    ) -> None:
        """Note what is wrong with some rows in one way: of many the first, and how many they are.

        Parameters
        ----------
        rows : sequence of int, ndarray
            Indices of the rows.
        text : callable
            Index of a row -> what is wrong with it.
        place : callable
            Index of a row -> its place in words, and its line.
        """
        more = f" ({len(rows) - 1} more like it)" if len(rows) > ALIKE else ""
        for row in rows[:1] if more else rows:
            where, line = place(int(row))
            self.add(f"{where}: {text(int(row))}{more}", line, "numbers")

    def take(self, others: Problems) -> None:
        """Note the problems of a part of the file."""
        self.count += others.count
        self.unread |= others.unread
        self.found += others.found[: 20 * SHOWN - len(self.found)]

    def told_once(self, places: Sequence[str]) -> None:
        """Make one of problems that are the same in several files.

        Parameters
        ----------
        places : sequence of str
            Names of the files, with which their problems begin.
        """
        alike: dict[str, list[tuple[int, Problem]]] = {}
        for line, text in self.found:
            place = next((p for p in places if text.startswith(p)), "")
            rest = text[len(place) :].partition(": ")[2] if place else text
            alike.setdefault(rest if place else f"\0{text}", []).append((line, text))
        self.found = []
        for rest, told in alike.items():
            line, text = told[0]
            if len(told) > 1 and not rest.startswith("\0"):
                place = text[: -len(rest) - 2]
                text = Problem(f"{place} and {len(told) - 1} more: {rest}", text.code)
                self.count -= len(told) - 1
            self.found.append((line, text))

    def raise_if_any(self) -> None:
        """Raise an InputError with the first problems and the number of the others.

        Raises
        ------
        InputError
            If there is any problem.
        """
        if not self.count:
            return
        shown = [text for _, text in sorted(self.found, key=lambda item: item[0])[:SHOWN]]
        more = self.count - len(shown)
        raise InputError([*shown, f"and {more} more"] if more else shown)

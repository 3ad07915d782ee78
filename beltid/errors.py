"""Everything that goes wrong for a reason a user can mend.

Every error of the package is a :class:`BeltidError` and carries the exit status that the command
line returns for it. Anything else that escapes is a bug.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

LONGEST_LINE: Final = 4000
"""Characters of a message that are shown; hostile files have names of megabytes."""
SHOWN: Final = 20
"""Problems of one file that are shown."""
EXIT_DONE = 0
EXIT_BUG = 1
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


def _shortened(text: str) -> str:
    if len(text) <= LONGEST_LINE:
        return text
    return f"{text[: LONGEST_LINE - 300]} ... {text[-295:]}"


class BeltidWarning(UserWarning):
    """A result was obtained, but the user should know something about it."""


class BeltidError(Exception):
    """Base of all errors with a reason that a user can mend.

    Attributes
    ----------
    exit_status : int
        Exit status of the command line for this error.
    problems : tuple of str
        One line per problem, each with its place, what was found and what is allowed; what
        they quote is made printable.
    """

    exit_status: int = EXIT_INPUT

    def __init__(self, problems: str | Sequence[str]) -> None:
        given = (problems,) if isinstance(problems, str) else problems
        self.problems: tuple[str, ...] = tuple(printable(line) for line in given)
        super().__init__("\n".join(self.problems))


class InputError(BeltidError):
    """A recording, a config, an artifact or an argument is not what it must be (status 2)."""


class ConfigError(InputError):
    """A config file is wrong; each problem carries file, line, column and key path."""


class ArtifactError(InputError):
    """An artifact is damaged, of another kind, or of a schema that this version does not read."""


class NumericsError(BeltidError):
    """The numerics could not give a result that may be trusted (status 3)."""

    exit_status = EXIT_NUMERICS


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
    found : list of (int, str)
        Line (0 for the whole file) and wording of the problems that are kept.
    count : int
        How many there were, with those that were not kept.
    """

    found: list[tuple[int, str]] = field(default_factory=list)
    count: int = 0

    def add(self, text: str, line: int = 0) -> None:
        """Note a problem; beyond a few hundred only their number is kept."""
        self.count += 1
        if len(self.found) < 20 * SHOWN:
            self.found.append((line, text))

    def take(self, others: Problems) -> None:
        """Note the problems of a part of the file."""
        self.count += others.count
        self.found += others.found[: 20 * SHOWN - len(self.found)]

    def add_uncounted(self, more: int) -> None:
        """Count problems that are like one already noted."""
        self.count += max(0, more)

    def told_once(self, places: Sequence[str]) -> None:
        """Make one of problems that are the same in several files.

        Parameters
        ----------
        places : sequence of str
            Names of the files, with which their problems begin.
        """
        alike: dict[str, list[tuple[int, str]]] = {}
        for line, text in self.found:
            place = next((p for p in places if text.startswith(p)), "")
            rest = text[len(place) :].partition(": ")[2] if place else text
            alike.setdefault(rest if place else f"\0{text}", []).append((line, text))
        self.found = []
        for rest, told in alike.items():
            line, text = told[0]
            if len(told) > 1 and not rest.startswith("\0"):
                text = f"{text[: -len(rest) - 2]} and {len(told) - 1} more: {rest}"
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

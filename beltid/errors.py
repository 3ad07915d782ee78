"""Everything that goes wrong for a reason a user can mend.

Every error of the package is a :class:`BeltidError` and carries the exit status that the command
line returns for it. Anything else that escapes is a bug.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from typing import Final

LONGEST_LINE: Final = 4000
"""Characters of a message that are shown; hostile files have names of megabytes."""
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


def percent(value: float) -> str:
    """A value in percent with two digits, never as a power of ten.

    Examples
    --------
    >>> percent(0.144), percent(99.7)
    ('0.14 %', '100 %')
    """
    return f"{float(f'{value:.2g}'):g} %"


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

"""Everything that goes wrong for a reason a user can mend.

Every error of the package is a :class:`BeltidError` and carries the exit status that the command
line returns for it. Anything else that escapes is a bug.
"""

from __future__ import annotations

from collections.abc import Sequence

EXIT_DONE = 0
EXIT_BUG = 1
EXIT_INPUT = 2
EXIT_NUMERICS = 3
EXIT_OUT_OF_TOLERANCE = 4
EXIT_BATCH_FAILED = 5
EXIT_INTERRUPTED = 130


class BeltidWarning(UserWarning):
    """A result was obtained, but the user should know something about it."""


class BeltidError(Exception):
    """Base of all errors with a reason that a user can mend.

    Attributes
    ----------
    exit_status : int
        Exit status of the command line for this error.
    problems : tuple of str
        One line per problem, each with its place, what was found and what is allowed.
    """

    exit_status: int = EXIT_INPUT

    def __init__(self, problems: str | Sequence[str]) -> None:
        self.problems: tuple[str, ...] = (
            (problems,) if isinstance(problems, str) else tuple(problems)
        )
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

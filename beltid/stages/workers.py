"""Who carries out the heavy calls of a stage: this process, others beside it, or a cluster.

A call is a function of a module with plain data as arguments and as result, so that it can be sent
anywhere; files are written by the caller alone. The result of a call depends on its arguments only.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final, Self, TypeVar

Result = TypeVar("Result")

LOOK_UP_S: Final = 0.2
"""Time after which one who waits wakes up, to hear a signal or that it is to stop [s]."""
ONE_THREAD: Final = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""The workers are the parallelism. Threads of the linear algebra below them only get in the way,
and matrices as small as those here take longer on several cores than on one."""


class Cancelled(Exception):
    """The workers were told to stop: no result comes any more."""


class Workers:
    """Workers that heavy calls are given to; this one is the caller itself, one call at a time.

    Attributes
    ----------
    jobs : int
        Calls at the same time.
    share_files : bool
        Whether they see the files of the caller, so that a whole stage can be given to them.
    about : str
        Who they are, in words.
    """

    jobs: int = 1
    about: str = "this process alone"
    share_files: bool = True

    def prepare(self) -> None:
        """Begin to start, where that takes time; returns at once."""

    def call(self, function: Callable[..., Result], *arguments: Any) -> Result:
        """Result of one call.

        Raises
        ------
        BeltidError
            What the call raises, or that its worker was lost again and again.
        """
        ((_, result),) = self.as_ended(function, [arguments])
        return result

    def as_ended(
        self, function: Callable[..., Result], calls: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Result]]:
        """Results of many calls in the order in which they end, each with its index.

        Parameters
        ----------
        function : callable
            A function of a module.
        calls : sequence of tuple
            The arguments of each call.
        """
        for index, arguments in enumerate(calls):
            yield index, function(*arguments)

    def stop(self) -> None:
        """Give up what is under way, at once."""

    def close(self) -> None:
        """End, when nothing is under way."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()  # an interrupt waits for nobody


def available_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return max(1, len(os.sched_getaffinity(0)))
    return os.cpu_count() or 1

"""Workers for the heavy calls of a stage: this process, a local pool, or a cluster.

A call is a module-level function with plain data as arguments and result, so that it can be sent
anywhere. Only the caller writes files. The result of a call depends on its arguments only.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import Any, Final, Self, TypeVar

Result = TypeVar("Result")

LOOK_UP_S: Final = 0.2
"""Interval at which a waiting caller checks for signals and for a request to stop [s]."""
ONE_THREAD: Final = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that limit a worker's linear algebra to one thread: the workers already
use all cores, and the small matrices here take longer on several cores than on one."""


class Cancelled(Exception):
    """Raised if the workers were stopped: no more results will come."""


class Workers:
    """Workers for heavy calls; the base class runs each call in the caller's own process.

    Attributes
    ----------
    jobs : int
        Number of calls that run at the same time.
    share_files : bool
        Whether they see the caller's files, so that they can run a whole stage.
    about : str
        Description for the user.
    """

    jobs: int = 1
    about: str = "this process alone"
    share_files: bool = True

    def prepare(self) -> None:
        """Start the workers in the background; returns at once."""

    def call(self, function: Callable[..., Result], *arguments: Any) -> Result:
        """Run one call and return its result.

        Raises
        ------
        BeltidError
            The error of the call, or that its worker was lost repeatedly.
        """
        ((_, result),) = self.as_ended(function, [arguments])
        return result

    def as_ended(
        self, function: Callable[..., Result], calls: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Result]]:
        """Yield the results of many calls in order of completion, each with its index.

        Parameters
        ----------
        function : callable
            A module-level function.
        calls : sequence of tuple
            The arguments of each call.
        """
        for index, arguments in enumerate(calls):
            yield index, function(*arguments)

    def stop(self) -> None:
        """Abandon running calls at once."""

    def close(self) -> None:
        """Shut down when no calls are running."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()  # do not wait for running calls after an interrupt


class Threads(Workers):
    """Threads of this process; the compiled kernels run at the same time."""

    def __init__(self, jobs: int) -> None:
        self.jobs = jobs

    def as_ended(
        self, function: Callable[..., Result], calls: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Result]]:
        """Yield the results of many calls in order of completion, each with its index."""
        with ThreadPoolExecutor(self.jobs) as pool:
            futures = {pool.submit(function, *call): i for i, call in enumerate(calls)}
            for future in as_completed(futures):
                yield futures[future], future.result()


def threads(jobs: int | None) -> Workers:
    """Return threads for so many calls at once, None: one per core; this one alone for one."""
    count = jobs or available_cores()
    return Threads(count) if count > 1 else Workers()


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return max(1, len(os.sched_getaffinity(0)))
    return os.cpu_count() or 1

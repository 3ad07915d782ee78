"""Workers for the heavy calls of a stage: this thread, others of this process, or a cluster.

A call is a module-level function with plain data as arguments and result, so that it can be sent
anywhere. Only the caller writes files. The result of a call depends on its arguments only.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed
from typing import Any, TypeVar

Result = TypeVar("Result")


class Workers:
    """An executor of `concurrent.futures` for heavy calls; without one, this thread."""

    def __init__(self, executor: Executor | None = None) -> None:
        self.executor = executor

    def run(
        self, function: Callable[..., Result], calls: Sequence[tuple[Any, ...]]
    ) -> list[Result]:
        """Return the results of many calls, in their order."""
        found = dict(self.as_ended(function, calls))
        return [found[k] for k in range(len(calls))]

    def as_ended(
        self, function: Callable[..., Result], calls: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Result]]:
        """Yield the results of many calls in order of completion, each with its index."""
        if self.executor is None:
            for index, arguments in enumerate(calls):
                yield index, function(*arguments)
            return
        ends = {self.executor.submit(function, *call): i for i, call in enumerate(calls)}
        try:
            for end in as_completed(ends):
                yield ends[end], end.result()
        finally:
            for end in ends:
                end.cancel()


def threads(jobs: int | None = None) -> Workers:
    """Return so many threads of this process, None: one per core; compiled kernels run in all."""
    count = jobs or available_cores()
    return Workers(ThreadPoolExecutor(count)) if count > 1 else Workers()


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

"""Workers for the heavy calls of a stage: this thread, others of this process, or a cluster.

A call is a module-level function with plain data as arguments and result, so that it can be sent
anywhere. Only the caller writes files. The result of a call depends on its arguments only.
"""

import contextlib
import logging
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Executor, ThreadPoolExecutor, as_completed
from typing import Any, TypeVar

from beltid._version import __version__
from beltid.errors import BeltidError, InputError
from beltid.store.disk import source_sha256

Result = TypeVar("Result")
CONNECT_WITHIN_S = 10.0


class Workers:
    """An executor of `concurrent.futures` for heavy calls; without one, this thread.

    `lost` are errors of the executor itself, not of a call.
    """

    def __init__(
        self, executor: Executor | None = None, lost: tuple[type[Exception], ...] = ()
    ) -> None:
        self.executor, self.lost = executor, lost

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
        except self.lost as error:
            raise BeltidError(
                f"cluster: the connection was lost, or workers died ({error}); run again to "
                "continue with what is not finished"
            ) from None
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


@contextlib.contextmanager
def cluster(address: str) -> Iterator[Workers]:
    """Connect to a Dask cluster at an address such as ``tcp://host:8786``, which keeps running.

    Calls are sent as plain data: the workers need beltid with the same sources, but neither the
    recordings nor the results folder. If a worker is lost, Dask repeats its calls on another one.
    """
    try:
        from distributed import Client, KilledWorker
        from distributed.comm import get_address_host_port
    except ImportError:
        raise InputError(
            "--scheduler needs the package distributed: pip install 'beltid[cluster]'"
        ) from None
    # its log would mix with our notes; what matters is raised as an error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        get_address_host_port(address)  # a client of a malformed one ends with a traceback
        client = Client(address, timeout=CONNECT_WITHIN_S, set_as_default=False)
        client.wait_for_workers(1, timeout=CONNECT_WITHIN_S)
    except Exception as error:  # malformed addresses, network errors, no workers
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise InputError(f"cluster {address}: no workers can be reached: {reason}") from None
    refuse_others(client, address)
    try:
        yield Workers(client.get_executor(pure=False), (KilledWorker, CancelledError, OSError))
    finally:
        client.close(timeout=1.0)


def refuse_others(client: Any, address: str) -> None:
    """Refuse workers without beltid, or with other sources, which could give other results."""
    hashes = client.run(source_sha256, on_error="return")
    if others := [worker for worker, found in hashes.items() if found != source_sha256()]:
        raise InputError(
            f"cluster {address}: {len(others)} of {len(hashes)} workers have no beltid or another "
            f"one, such as {others[0]}; install beltid {__version__} there as on this computer"
        )

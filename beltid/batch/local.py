"""Worker processes on this machine: one pool for the calls of all belts.

The workers are forked from a server that imports everything once, while the caller is importing. A
worker that is killed is replaced and its call repeated. Workers end when their caller ends, for any
reason.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import tempfile
import threading
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import process
from typing import Any, Final

from beltid.child_processes import same_package, signals_blocked
from beltid.errors import BeltidError
from beltid.stages.workers import LOOK_UP_S, ONE_THREAD, Cancelled, Result, Workers, available_cores

MOST_LOSSES: Final = 3
"""Workers that may be lost in a row, without any result, before the calls are abandoned."""
LONGEST_SOCKET_FOLDER: Final = 70
"""Longest path of the temporary folder [bytes]. The socket in it then has a path of 102 bytes;
the limit is 103 (macOS) or 107 (Linux)."""
IMPORTED: Final = ("beltid.batch.chain", "pyarrow.csv", "pyarrow.parquet", "scipy.interpolate")


class ProcessWorkers(Workers):
    """A pool of worker processes that starts at the first call.

    Parameters
    ----------
    jobs : int
        Number of processes.
    imported : sequence of str
        Modules that the workers import in advance.
    """

    def __init__(self, jobs: int, imported: Sequence[str] = IMPORTED) -> None:
        self.jobs = jobs
        self._imported = tuple(imported)
        self.about = f"{jobs} processes on this machine"
        self._lock = threading.Lock()
        self._starting = threading.Lock()
        self._pool: ProcessPoolExecutor | None = None
        self._cancelled = False
        self._other_children: Collection[Any] = ()

    def prepare(self) -> None:
        """Start importing in the background and return immediately."""
        if _start_method() != "forkserver":
            return
        from multiprocessing import forkserver, resource_tracker

        forkserver.set_forkserver_preload(list(self._imported))
        # the tracker cleans up after a caller that is stopped, which needs no warning
        with signals_blocked(), _environment("PYTHONWARNINGS", "ignore"):
            resource_tracker.ensure_running()  # it unblocks signals, so it gets a separate block
        with signals_blocked(), _environment("PYTHONPATH", same_package()):
            forkserver.ensure_running()

    def as_ended(
        self, function: Callable[..., Result], calls: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Result]]:
        """Yield the results of many calls as they finish, each with its index.

        Raises
        ------
        BeltidError
            If a call raises it, or its worker was lost repeatedly.
        """
        waiting = dict(enumerate(calls))
        losses = 0
        while waiting:
            pool = self._running_pool()
            futures: dict[Future[Result], int] = {}
            try:
                for index, arguments in waiting.items():
                    with self._starting:
                        if self._cancelled:
                            raise Cancelled
                        futures[pool.submit(function, *arguments)] = index
                for future in self._as_completed(futures):
                    index, result = futures[future], future.result()
                    del waiting[index]
                    losses = 0
                    yield index, result
            except (BrokenProcessPool, RuntimeError, EOFError) as error:
                # RuntimeError: the pool was shut down while calls were submitted;
                # EOFError: the server was killed while it started a worker
                if type(error) is RuntimeError and pool is self._pool:
                    raise
                self._discard(pool)
                losses += 1
                if losses > MOST_LOSSES:
                    raise BeltidError(
                        f"workers were killed {losses} times (by the system, out of memory?); "
                        "use fewer workers with --jobs"
                    ) from None
            finally:
                for future in futures:
                    future.cancel()

    def _as_completed(self, futures: Collection[Future[Result]]) -> Iterator[Future[Result]]:
        """Yield futures as they finish.

        The function of the standard library misses futures that a pool cancels at its shutdown.
        """
        waiting = set(futures)
        while waiting:
            done, waiting = wait(waiting, timeout=LOOK_UP_S, return_when=FIRST_COMPLETED)
            if self._cancelled:
                raise Cancelled
            yield from done

    def stop(self) -> None:
        """Kill the workers; callers waiting for them get `Cancelled`."""
        with self._lock:
            self._cancelled = True
            pool, self._pool = self._pool, None
        if pool is not None:
            _kill(pool, self._other_children)

    def close(self) -> None:
        """Cancel pending calls and end the workers."""
        with self._lock:
            self._cancelled = True
            pool, self._pool = self._pool, None
        if pool is not None:
            pool.shutdown(wait=True, cancel_futures=True)

    def _running_pool(self) -> ProcessPoolExecutor:
        with self._lock:
            if self._cancelled:
                raise Cancelled
            if self._pool is None:
                self.prepare()
                self._other_children = multiprocessing.active_children()
                self._pool = ProcessPoolExecutor(
                    max_workers=self.jobs,
                    mp_context=multiprocessing.get_context(_start_method()),
                    initializer=_start_worker,
                )
            return self._pool

    def _discard(self, pool: ProcessPoolExecutor) -> None:
        """Drop a pool that lost a worker."""
        with self._lock:
            if self._pool is pool:
                self._pool = None
        pool.shutdown(wait=False)


def _start_method() -> str:
    """Choose the fork server if possible; it needs a socket with a short path."""
    methods = multiprocessing.get_all_start_methods()
    try:
        folder = os.fsencode(tempfile.gettempdir())
    except FileNotFoundError:  # all temporary folders are full or read-only
        return "spawn"
    short = len(folder) <= LONGEST_SOCKET_FOLDER
    return "forkserver" if "forkserver" in methods and short else "spawn"


@contextlib.contextmanager
def _environment(name: str, value: str) -> Iterator[None]:
    """Set an environment variable for the processes started inside."""
    before = os.environ.get(name)
    os.environ[name] = value
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before


def _kill(pool: ProcessPoolExecutor, others: Collection[Any]) -> None:
    """Kill the children of a pool, including those that are just being started."""
    ending = threading.Thread(
        target=pool.shutdown, kwargs={"wait": True, "cancel_futures": True}, daemon=True
    )
    ending.start()
    ended = False
    while not ended:  # the pool may wait for a worker that was started after the others died
        ended = not ending.is_alive()  # one more pass after the end, for a worker that came late
        for child in multiprocessing.active_children():
            if child not in others:
                with contextlib.suppress(OSError, ValueError):
                    child.kill()
        ending.join(0.02)


def _start_worker() -> None:
    """Initialize a worker: leave Ctrl-C to the caller, and exit when the caller ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    caller = process.parent_process()
    if caller is not None:
        threading.Thread(target=_exit_with, args=(caller,), daemon=True).start()


def _exit_with(caller: Any) -> None:
    caller.join()
    os._exit(1)


def local_workers(jobs: int | None, imported: Sequence[str] = IMPORTED) -> Workers:
    """Create workers on this machine: processes, or the caller itself for one job.

    Parameters
    ----------
    jobs : int or None
        Number of workers; None for one per core.
    imported : sequence of str
        Modules that the workers import in advance; by default those of a whole chain.
    """
    for name in ONE_THREAD:  # must be set before the workers import numpy
        os.environ.setdefault(name, "1")
    count = jobs or available_cores()
    return Workers() if count == 1 else ProcessWorkers(count, imported)

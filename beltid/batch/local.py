"""Worker processes on this machine: one pool that the calls of all belts go to.

The workers are forked from a server that has imported everything once, in the time in which the
caller imports itself. A worker that is killed is replaced, and its call made again. Workers end
with their caller, however it ends.
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
"""Workers lost one after the other, without a result between them, before a call is given up."""
LONGEST_SOCKET_FOLDER: Final = 70
"""Bytes of the folder of temporary files: with the names of folder and socket in it 102, and a
socket may have 103 (macOS) or 107 (Linux)."""
IMPORTED: Final = ("beltid.batch.chain", "pyarrow.csv", "pyarrow.parquet", "scipy.interpolate")


class ProcessWorkers(Workers):
    """A pool of worker processes, started when the first call comes.

    Parameters
    ----------
    jobs : int
        Number of processes.
    imported : sequence of str
        Modules that they need.
    """

    def __init__(self, jobs: int, imported: Sequence[str] = IMPORTED) -> None:
        self.jobs = jobs
        self._imported = tuple(imported)
        self.about = f"{jobs} processes on this machine"
        self._lock = threading.Lock()
        self._starting = threading.Lock()
        self._pool: ProcessPoolExecutor | None = None
        self._cancelled = False
        self._others: Collection[Any] = ()

    def prepare(self) -> None:
        """Start importing beside the caller; returns at once."""
        if _start_method() != "forkserver":
            return
        from multiprocessing import forkserver, resource_tracker

        forkserver.set_forkserver_preload(list(self._imported))
        # the tracker clears away what a caller leaves that is told to stop: no cause for a warning
        with signals_blocked(), _environment("PYTHONWARNINGS", "ignore"):
            resource_tracker.ensure_running()  # lets signals in again, so not below
        with signals_blocked(), _environment("PYTHONPATH", same_package()):
            forkserver.ensure_running()

    def as_ended(
        self, function: Callable[..., Result], calls: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Result]]:
        """Results of many calls in the order in which they end, each with its index.

        Raises
        ------
        BeltidError
            What a call raises, or that its worker was lost again and again.
        """
        waiting = dict(enumerate(calls))
        losses = 0
        while waiting:
            pool = self._running()
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
                # a pool that is shut down while calls are handed to it says so by RuntimeError,
                # a server that is killed while it starts a worker by the end of its answer
                if type(error) is RuntimeError and pool is self._pool:
                    raise
                self._discard(pool)
                losses += 1
                if losses > MOST_LOSSES:
                    raise BeltidError(
                        f"workers were killed {losses} times (by the system, for want of memory?); "
                        "fewer at a time with --jobs need less of it"
                    ) from None
            finally:
                for future in futures:
                    future.cancel()

    def _as_completed(self, futures: Collection[Future[Result]]) -> Iterator[Future[Result]]:
        """Futures in the order in which they end.

        Not that of the library: it never hears of futures that a pool cancels as it is shut down.
        """
        waiting = set(futures)
        while waiting:
            done, waiting = wait(waiting, timeout=LOOK_UP_S, return_when=FIRST_COMPLETED)
            if self._cancelled:
                raise Cancelled
            yield from done

    def stop(self) -> None:
        """Kill the workers; calls that wait for them raise `Cancelled`."""
        with self._lock:
            self._cancelled = True
            pool, self._pool = self._pool, None
        if pool is not None:
            _kill(pool, self._others)

    def close(self) -> None:
        """Let the workers go; nothing is waited for."""
        with self._lock:
            self._cancelled = True
            pool, self._pool = self._pool, None
        if pool is not None:
            pool.shutdown(wait=True, cancel_futures=True)

    def _running(self) -> ProcessPoolExecutor:
        with self._lock:
            if self._cancelled:
                raise Cancelled
            if self._pool is None:
                self.prepare()
                self._others = multiprocessing.active_children()
                self._pool = ProcessPoolExecutor(
                    max_workers=self.jobs,
                    mp_context=multiprocessing.get_context(_start_method()),
                    initializer=_begin,
                )
            return self._pool

    def _discard(self, pool: ProcessPoolExecutor) -> None:
        """Take a pool that lost a worker out of use."""
        with self._lock:
            if self._pool is pool:
                self._pool = None
        pool.shutdown(wait=False)


def _start_method() -> str:
    """A server to fork from, where there can be one: it is reached by the name of a socket."""
    methods = multiprocessing.get_all_start_methods()
    try:
        folder = os.fsencode(tempfile.gettempdir())
    except FileNotFoundError:  # every folder for temporary files is full or read-only
        return "spawn"
    short = len(folder) <= LONGEST_SOCKET_FOLDER
    return "forkserver" if "forkserver" in methods and short else "spawn"


@contextlib.contextmanager
def _environment(name: str, value: str) -> Iterator[None]:
    """Start processes with another value of a variable."""
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
    """Kill the children that came with a pool, also those that are being started meanwhile."""
    ending = threading.Thread(
        target=pool.shutdown, kwargs={"wait": True, "cancel_futures": True}, daemon=True
    )
    ending.start()
    ended = False
    while not ended:  # the pool waits for a worker that was started after the others died
        ended = not ending.is_alive()  # once more after the end: the last one may have come late
        for child in multiprocessing.active_children():
            if child not in others:
                with contextlib.suppress(OSError, ValueError):
                    child.kill()
        ending.join(0.02)


def _begin() -> None:
    """First thing in a worker: Ctrl-C is for the caller, and so is the end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    caller = process.parent_process()
    if caller is not None:
        threading.Thread(target=_end_with, args=(caller,), daemon=True).start()


def _end_with(caller: Any) -> None:
    caller.join()
    os._exit(1)


def local_workers(jobs: int | None, imported: Sequence[str] = IMPORTED) -> Workers:
    """Workers on this machine, one per core if not told: processes, or for one job the caller.

    Parameters
    ----------
    jobs : int or None
        How many; None for one per core.
    imported : sequence of str
        Modules that they need; by default those of a whole chain.
    """
    for name in ONE_THREAD:  # before numpy is imported in them
        os.environ.setdefault(name, "1")
    count = jobs or available_cores()
    return Workers() if count == 1 else ProcessWorkers(count, imported)

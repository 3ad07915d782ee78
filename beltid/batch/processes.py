"""A process per belt: its notes are heard here; if it is killed, its belt is tried once more."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from logging.handlers import QueueHandler
from typing import Any, Final

from beltid.batch.chain import Belt
from beltid.errors import BeltidError
from beltid.notes import log

SPAWN: Final = multiprocessing.get_context("spawn")
"""Each process starts afresh: nothing is left in a temporary folder, and threads are no matter."""
LAST_NOTES_S: Final = 5.0


def run_in_processes(
    work: Callable[..., Belt], calls: Mapping[str, tuple[Any, ...]], jobs: int
) -> Iterator[Belt]:
    """Yield what becomes of belts as they end, each in a process, `jobs` at the same time.

    If a process is killed, the belts that have not ended are tried once more, one after the other:
    what they had finished is up to date, and the belt to blame is known. `work` is a module-level
    function, `calls` has its arguments by the name of the belt.
    """
    left = dict(calls)
    try:
        for belt in _ended(work, calls, jobs):
            del left[belt.name]
            yield belt
        return
    except BrokenProcessPool:
        log.warning("a process was killed (out of memory?), once more: %s", ", ".join(left))
    for name, call in left.items():
        try:
            yield from _ended(work, {name: call}, 1)
        except BrokenProcessPool:
            belt = Belt(name)
            text = f"{name}: was killed twice (out of memory?); run again, with fewer --jobs"
            belt.failed("process", BeltidError(text))
            yield belt


def _ended(
    work: Callable[..., Belt], calls: Mapping[str, tuple[Any, ...]], jobs: int
) -> Iterator[Belt]:
    with _heard() as notes, ProcessPoolExecutor(jobs, SPAWN, _begin, (notes,)) as pool:
        with _signals_blocked():
            ends = [pool.submit(work, *call) for call in calls.values()]
        for end in as_completed(ends):
            yield end.result()


def _begin(notes: Any) -> None:
    """Initialize a process: it leaves Ctrl-C to its parent, and ends with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    log.setLevel(logging.DEBUG)
    log.addHandler(QueueHandler(notes))
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


@contextlib.contextmanager
def _heard() -> Iterator[Any]:
    """Open a queue whose notes are logged here."""
    with _signals_blocked():  # its semaphores have a process that cleans up after them
        notes = SPAWN.Queue()
    notes.cancel_join_thread()

    def listen() -> None:
        while (record := notes.get()) is not None:
            log.handle(record)

    listener = threading.Thread(target=listen, daemon=True)
    listener.start()
    try:
        yield notes
    finally:
        notes.put(None)
        listener.join(LAST_NOTES_S)  # a process that was killed may have left half a note


@contextlib.contextmanager
def _signals_blocked() -> Iterator[None]:
    """Shield the processes started inside from Ctrl-C and hang-up: the parent ends them."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)

"""Items that a thread makes while those before are in use."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final, TypeVar

T = TypeVar("T")
PATIENCE_S: Final = 0.05


@dataclass(frozen=True, slots=True)
class _End:
    """What the thread ended with."""

    error: BaseException | None = None


def ahead(items: Iterable[T], waiting: int) -> Iterator[T]:
    """The same items, made by a thread of their own.

    It pays where making and using them let go of the interpreter: reading, Arrow, numpy.

    Parameters
    ----------
    items : iterable
        What makes them; what it raises is raised here.
    waiting : int
        Items that are finished and wait for their use, at most; one more is being made.
    """
    made: queue.Queue[T | _End] = queue.Queue(waiting)
    stopped = threading.Event()

    def make() -> None:
        end = _End()
        try:
            for item in items:
                made.put(item)
                if stopped.is_set():
                    break
        except BaseException as error:  # raised where the items are asked for
            end = _End(error)
        finally:
            getattr(items, "close", lambda: None)()
            made.put(end)

    maker = threading.Thread(target=make, daemon=True)
    maker.start()
    try:
        while not isinstance(item := made.get(), _End):
            yield item
        if item.error is not None:
            raise item.error
    finally:
        stopped.set()
        while maker.is_alive():
            _drain(made)
            maker.join(PATIENCE_S)


def _drain(made: queue.Queue[T]) -> None:
    try:
        while True:
            made.get_nowait()
    except queue.Empty:
        pass

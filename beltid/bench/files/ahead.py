"""Items that a thread makes while those before are in use."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")


def ahead(items: Iterable[T], waiting: int) -> Iterator[T]:
    """The same items, made by a thread of their own.

    It pays where making and using them let go of the interpreter: reading, Arrow, numpy.

    Parameters
    ----------
    items : iterable
        What makes them, None not among them; what it raises is raised here.
    waiting : int
        Items that are finished and wait for their use, at most; one more is being made.
    """
    source, maker = iter(items), ThreadPoolExecutor(1)
    made: deque[Future[T | None]] = deque()
    try:
        while True:
            while len(made) < waiting + 2:
                made.append(maker.submit(next, source, None))
            item = made.popleft().result()
            if item is None:
                return
            yield item
    finally:
        maker.shutdown(cancel_futures=True)
        getattr(source, "close", lambda: None)()

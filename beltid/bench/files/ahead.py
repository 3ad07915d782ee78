"""Produce the next items in a thread while the current one is in use."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from threading import get_ident
from typing import TypeVar

T = TypeVar("T")


def ahead(items: Iterable[T], waiting: int) -> Iterator[T]:
    """Yield the same items, produced in a separate thread.

    Worthwhile if producing and using them release the interpreter lock: reading, Arrow, numpy.

    Parameters
    ----------
    items : iterable
        Produces the items, none of which may be None; its exceptions are raised here.
    waiting : int
        Maximum number of finished items that wait; one more is in production.
    """
    source, idents = iter(items), list[int]()
    worker = ThreadPoolExecutor(1, initializer=lambda: idents.append(get_ident()))
    pending: deque[Future[T | None]] = deque()
    try:
        while True:
            while len(pending) < waiting + 2:
                pending.append(worker.submit(next, source, None))
            item = pending.popleft().result()
            if item is None:
                return
            yield item
    finally:
        # the garbage collector may end the generator in the worker, which cannot wait for itself
        in_worker = get_ident() in idents
        worker.shutdown(wait=not in_worker, cancel_futures=True)
        if not in_worker:
            getattr(source, "close", lambda: None)()

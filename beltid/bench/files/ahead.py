"""Items that a thread makes while those before are in use."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Final, TypeVar

T = TypeVar("T")
_END: Final = object()


def ahead(items: Iterable[T], waiting: int) -> Iterator[T]:
    """The same items, made by a thread of their own.

    It pays where making and using them let go of the interpreter: reading, Arrow, numpy.

    Parameters
    ----------
    items : iterable
        What makes them; what it raises is raised here. A generator is closed at the end.
    waiting : int
        Items that are finished and wait for their use, at most; one more is being made.
    """
    source = iter(items)
    with ThreadPoolExecutor(1) as maker:
        under_way = deque(maker.submit(next, source, _END) for _ in range(waiting + 1))
        try:
            while (item := under_way.popleft().result()) is not _END:
                under_way.append(maker.submit(next, source, _END))
                yield item  # type: ignore[misc]
        finally:
            for future in under_way:
                future.cancel()
            maker.submit(getattr(source, "close", lambda: None)).result()

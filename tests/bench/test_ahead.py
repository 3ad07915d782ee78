"""Items made by a thread: the same, in their order; errors and an early end are passed on."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from beltid.bench.files.ahead import ahead
from beltid.errors import InputError


def test_items_come_in_their_order() -> None:
    assert list(ahead(range(1000), 2)) == list(range(1000))


def test_an_error_is_raised_after_the_items_before_it() -> None:
    def broken() -> Iterator[int]:
        yield 1
        yield 2
        raise InputError("rig.csv:3: broken")

    items = ahead(broken(), 4)
    assert [next(items), next(items)] == [1, 2]
    with pytest.raises(InputError, match="broken"):
        next(items)


def test_who_stops_early_ends_the_thread_and_closes_the_source() -> None:
    closed = threading.Event()

    def endless() -> Iterator[int]:
        try:
            while True:
                yield 0
        finally:
            closed.set()

    before = threading.active_count()
    items = ahead(endless(), 1)
    assert next(items) == 0
    items.close()  # type: ignore[attr-defined]
    assert closed.is_set()
    assert threading.active_count() == before


def test_no_more_is_made_than_may_wait() -> None:
    """What waits, and one that is finished and has no place yet."""
    made: list[int] = []
    asked = threading.Event()

    def counted() -> Iterator[int]:
        for k in range(100):
            made.append(k)
            if k == 4:
                asked.set()
            yield k

    items = ahead(counted(), 2)
    assert next(items) == 0
    asked.wait(0.3)
    assert len(made) <= 4
    items.close()  # type: ignore[attr-defined]


def test_the_worker_itself_may_end_the_items() -> None:
    """The garbage collector may run in any thread."""
    received, ended = threading.Event(), threading.Event()
    items: list[Iterator[int]] = []

    def closing() -> Iterator[int]:
        yield 0
        received.wait(10.0)
        items[0].close()  # type: ignore[attr-defined]
        ended.set()
        yield 1

    items.append(ahead(closing(), 0))
    assert next(items[0]) == 0
    received.set()
    assert ended.wait(10.0)

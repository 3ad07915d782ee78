"""What all tests share: linear algebra in one thread, as in every command, before numpy starts.

And how several processes divide the tests: what is built once for a folder (a chain of results, a
page) is built in one process only, and the longest groups come first, so that all end together.
"""

from __future__ import annotations

import pytest

from beltid.cli.process import one_thread_each

one_thread_each()

TOGETHER = ("chain", "report", "cli", "refine")
"""Folders whose tests share costly results; elsewhere the tests of a file stay together."""
FIRST = ("chain", "report", "cli", "docs", "stages", "uncertainty", "refine", "identify")
"""Folders in the order of their length. The first compiles the kernels, the second needs none."""


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Name the group of every test, in a process that shares the work with others."""
    if not hasattr(config, "workerinput"):
        return
    for item in items:
        folder = item.path.parent.name
        group = folder if folder in TOGETHER else f"{folder}/{item.path.stem}"
        item.add_marker(pytest.mark.xdist_group(group))
    items.sort(key=_place)


def _place(item: pytest.Item) -> int:
    folder = item.path.parent.name
    return FIRST.index(folder) if folder in FIRST else len(FIRST)

"""What all tests share: linear algebra in one thread, as in every command, before numpy starts.

And the order in which several processes take the files: the longest folders come first, so that
all processes end together.
"""

from __future__ import annotations

import pytest

from beltid.cli.process import one_thread_each

one_thread_each()

FIRST = ("chain", "report", "cli", "docs", "stages", "uncertainty", "refine", "identify")
"""Folders in the order of their length. The first compiles the kernels, the second needs none."""


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Put the longest folders first, in a process that shares the work with others."""
    if hasattr(config, "workerinput"):
        items.sort(key=_place)


def _place(item: pytest.Item) -> int:
    folder = item.path.parent.name
    return FIRST.index(folder) if folder in FIRST else len(FIRST)

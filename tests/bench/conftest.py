"""Writers of this folder, importable by name; readers of formats in this process."""

from __future__ import annotations

import json
import sys
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from beltid.bench.formats.isolated import process

sys.path.insert(0, str(Path(__file__).parent))

IN_CHILDREN = ("test_damaged.py", "test_round_trip.py")
"""Tests of what a process of its own is for, and of each format read by one."""


@pytest.fixture(autouse=True)
def _readers_without_children(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A child takes longer to start than to read: here it is called as a function."""
    if request.path.name in IN_CHILDREN:
        return

    def run(command: list[str], *, input: bytes, **others: Any) -> SimpleNamespace:
        folder = Path(command[command.index(process.__name__) + 1])
        with warnings.catch_warnings(action="ignore"):
            process.read_all(folder, json.loads(input))
        return SimpleNamespace(returncode=0)

    instead = SimpleNamespace(**{**vars(process.subprocess), "run": run})
    monkeypatch.setattr(process, "subprocess", instead)

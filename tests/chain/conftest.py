"""What the tests of batches share: recordings, and the results of one worker to compare with."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from small_bench import beltid, small_bench


@pytest.fixture(scope="session")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with recordings and configs, made once."""
    return small_bench(tmp_path_factory.mktemp("batch") / "bench")


@pytest.fixture(scope="session")
def by_one(recordings: Path) -> Path:
    """Results of both belts, made by one process."""
    done = beltid(recordings, "run", "one.yaml", "two.yaml", "-j", "1", "-o", "by-one")
    assert done.exit_code == 0, done.stderr
    return recordings / "by-one"


@pytest.fixture
def bench(recordings: Path, tmp_path: Path) -> Path:
    """A copy of the recordings and configs to work in."""
    for name in ("press.csv", "rig.csv", "one.yaml", "two.yaml"):
        shutil.copy(recordings / name, tmp_path)
    return tmp_path

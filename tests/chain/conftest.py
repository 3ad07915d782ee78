"""What the tests of batches share: recordings, and the results of one process to compare with."""

import shutil
from pathlib import Path

import pytest


@pytest.fixture
def by_one(of_two: Path) -> Path:
    """Results of both belts, made one after the other in one process."""
    return of_two / "runs"


@pytest.fixture
def bench(of_two: Path, tmp_path: Path) -> Path:
    """A copy of the recordings and configs to work in."""
    ignore = shutil.ignore_patterns("runs")
    return Path(shutil.copytree(of_two, tmp_path, ignore=ignore, dirs_exist_ok=True))

"""Results that many goldens look at, made once."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from golden.door import ROOT, done

MakeOnce = Callable[[str, Callable[[Path], object]], Path]


@pytest.fixture(scope="session")
def belt_5pk(made_once: MakeOnce) -> Path:
    """Folder of `beltid run` for the 5PK belt of rigdata (synthetic), with its report."""

    def fill(folder: Path) -> None:
        done(ROOT, "run configs/5pk.yaml --out", folder / "runs", "--jobs 2")

    return made_once("golden_5pk", fill) / "runs" / "5pk"


@pytest.fixture
def bench(small: Path, tmp_path: Path) -> Path:
    """A copy of the small bench that a test may change."""
    return Path(shutil.copytree(small, tmp_path / "bench", ignore=shutil.ignore_patterns("runs")))

"""What the tests of batches share: recordings, and the results of one process to compare with."""

import shutil
from pathlib import Path
from typing import Any

import pytest
from small_bench import PartOfRig, beltid, small_bench


@pytest.fixture(scope="session")
def recordings(made_once: Any, part_of_rig: PartOfRig) -> Path:
    """Folder with recordings and configs, made once."""
    return made_once("batch", lambda folder: small_bench(folder, part_of_rig))


@pytest.fixture(scope="session")
def by_one(made_once: Any, recordings: Path) -> Path:
    """Results of both belts, made one after the other in this process."""

    def fill(folder: Path) -> None:
        both = ("one.yaml", "two.yaml", "--no-report")
        done = beltid(recordings, "run", *both, "-j", "1", "-o", str(folder))
        assert done.exit_code == 0, done.stderr

    return made_once("batch-by-one", fill)


@pytest.fixture
def bench(recordings: Path, tmp_path: Path) -> Path:
    """A copy of the recordings and configs to work in."""
    return Path(shutil.copytree(recordings, tmp_path, dirs_exist_ok=True))

"""Results that many goldens look at, made once."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

from golden.door import ROOT, done

MakeOnce = Callable[[str, Callable[[Path], object]], Path]


@pytest.fixture(scope="session")
def belt_5pk(made_once: MakeOnce, small: Path) -> Path:  # that has compiled the kernels
    """Folder of `beltid run` for the 5PK belt of rigdata (synthetic), with its report.

    Its drive at every third operating point, and no runs left out: the long tests have them all.
    """

    def fill(folder: Path) -> None:
        loss = pd.read_csv(ROOT / "rigdata/5pk/speedloss.csv")
        loss = loss[loss["run"].isin(loss["run"].unique()[::3])]
        loss.to_csv(folder / "speedloss.csv", index=False)
        config = (ROOT / "configs/5pk.yaml").read_text() + "cross_validate: {by: none}\n"
        config = config.replace("../rigdata/5pk/speedloss", "speedloss")
        (folder / "5pk.yaml").write_text(config.replace("../rigdata", str(ROOT / "rigdata")))
        done(folder, "run 5pk.yaml --out runs --jobs 1")

    return made_once("golden_5pk", fill) / "runs" / "5pk"


@pytest.fixture
def bench(small: Path, tmp_path: Path) -> Path:
    """A copy of the small bench, with its verdict, that a test may change."""
    folder = tmp_path / "bench"
    shutil.copytree(small, folder, ignore=shutil.ignore_patterns("runs"))
    shutil.copy(small / "runs/small/compare.parquet", folder)
    return folder

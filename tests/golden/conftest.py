"""Results that many goldens look at, made once."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from golden import benches
from golden.door import ROOT, configured, done

MakeOnce = Callable[[str, Callable[[Path], object]], Path]


@pytest.fixture(scope="session")
def belt_5pk(made_once: MakeOnce) -> Path:
    """Folder of `beltid run` for the 5PK belt of rigdata (synthetic), with its report."""

    def fill(folder: Path) -> None:
        done(ROOT, "run configs/5pk.yaml --out", folder / "runs", "--jobs 2")

    return made_once("golden_5pk", fill) / "runs" / "5pk"


@pytest.fixture(scope="session")
def small(made_once: MakeOnce) -> Path:
    """Folder with a small bench (synthetic) and its results: two arcs, three tensions."""

    def fill(folder: Path) -> None:
        benches.Rig().recording()[benches.CELLS].to_csv(folder / "rig.csv", index=False)
        benches.press().to_csv(folder / "press.csv", index=False)
        benches.speed_loss().to_csv(folder / "speedloss.csv", index=False)
        config = {
            "belt": {"name": "small"},
            "simulation": {"method": "steady", "elements": 20},
            "data": {"press": "press.csv", "rig": "rig.csv", "origin": "synthetic"},
        }
        configured(folder, config)
        done(folder, "fit-stiffness press.csv")
        done(folder, "fit-slip speedloss.csv")
        done(folder, "fit-friction rig.csv")
        done(folder, "build-surface friction.parquet")
        done(folder, "refine-surface friction.parquet stiffness.parquet")
        done(folder, "simulate-rig surface.parquet stiffness.parquet --jobs 1")

    return made_once("golden_small", fill)


@pytest.fixture
def bench(small: Path, tmp_path: Path) -> Path:
    """A copy of the small bench that a test may change."""
    return Path(shutil.copytree(small, tmp_path / "bench"))

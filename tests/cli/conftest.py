"""A bench folder with short recordings of the 5PK belt, and the command line on top of it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from beltid.cli import app

ROOT = Path(__file__).parents[2]
DATA = ROOT / "rigdata" / "5pk"

SHORT_CONFIG = """\
belt: {name: 5pk}
rig:
  arcs_deg: [40, 82]
  initial_tensions_N: [100, 220, 310, 411]
  pulley_speeds_rad_s: [0.05, 0.21]
simulation: {method: steady}
data: {press: press.csv, rig: rig.csv, speedloss: speedloss.csv}
"""


@pytest.fixture(scope="session")
def recordings(tmp_path_factory: pytest.TempPathFactory, part_of_rig: Any) -> Path:
    """Folder with the recordings, of the friction rig 16 of 120 runs."""
    folder = tmp_path_factory.mktemp("recordings")
    for name in ("press.csv", "speedloss.csv"):
        shutil.copy(DATA / name, folder / name)
    runs = part_of_rig((40, 82), (100, 220, 310, 411), (0.05, 0.21))
    (folder / "rig.csv").write_text(runs)
    (folder / "beltid.yaml").write_text(SHORT_CONFIG)
    return folder


@pytest.fixture(scope="session")
def finished(made_once: Any, recordings: Path) -> Path:
    """Folder with the recordings and every artifact of the chain, made once by the commands."""
    return made_once("finished", lambda folder: finish(recordings, folder))


def finish(recordings: Path, folder: Path) -> None:
    """Call the commands one after the other."""
    shutil.copytree(recordings, folder, dirs_exist_ok=True)
    runner = CliRunner()
    with pytest.MonkeyPatch.context() as patch:
        # the limits of a drive, most of its work, at one tension and roughly
        patch.setattr("beltid.stages.drive.simulate_drive.TENSIONS", (1.0,))
        patch.setattr("beltid.drive.limits.TOLERANCE", 0.05)
        for call in (
            ["fit-stiffness", "press.csv"],
            ["fit-slip", "speedloss.csv"],
            ["fit-friction", "rig.csv"],
            ["build-surface", "friction.parquet"],
            ["simulate-rig", "surface.parquet", "stiffness.parquet"],
            ["compare", "friction.parquet", "simulated.parquet"],
            ["simulate-drive", "surface.parquet", "stiffness.parquet", "--from", "slip.parquet"],
            ["compare-drive", "slip.parquet", "drive.parquet"],
        ):
            rest = (str(folder / name) if "." in name else name for name in call[1:])
            result = runner.invoke(app, [call[0], *rest])
            assert result.exit_code == 0, result.stderr


@pytest.fixture(scope="session")
def chained(made_once: Any, finished: Path) -> Path:
    """The finished folder with the results of the whole chain in runs/, made once."""

    def fill(folder: Path) -> None:
        shutil.copytree(finished, folder, dirs_exist_ok=True)
        call = ["run", "--no-report", str(folder / "beltid.yaml"), "-o", str(folder / "runs")]
        result = CliRunner().invoke(app, call)
        assert result.exit_code == 0, result.stderr

    return made_once("chained", fill)


def working_copy(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of a folder to work in, as the current folder."""
    copy = tmp_path / "bench"
    shutil.copytree(folder, copy)
    monkeypatch.chdir(copy)
    monkeypatch.delenv("BELTID_CONFIG", raising=False)
    monkeypatch.setenv("COLUMNS", "100")
    return copy


@pytest.fixture
def bench(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the folder with the results of the single commands."""
    return working_copy(finished, tmp_path, monkeypatch)


@pytest.fixture
def ran(chained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The same, with the results of the whole chain."""
    return working_copy(chained, tmp_path, monkeypatch)


Call = Callable[..., object]


@pytest.fixture
def beltid(monkeypatch: pytest.MonkeyPatch) -> Call:
    """The command line in this process: exit_code, stdout, stderr.

    Without workers: to start them takes longer than most of these tests; tests/chain has them.
    """
    monkeypatch.delenv("BELTID_CONFIG", raising=False)
    monkeypatch.setattr("beltid.batch.local.available_cores", lambda: 1)
    runner = CliRunner()
    return lambda *arguments: runner.invoke(app, [str(a) for a in arguments])

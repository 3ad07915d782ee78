"""A bench folder with short recordings of the 5PK belt, and the command line on top of it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from golden.door import ROOT, done
from typer.testing import CliRunner

from beltid.cli import app

DATA = ROOT / "rigdata" / "5pk"

SHORT_CONFIG = """\
belt: {name: 5pk}
rig:
  arcs_deg: [40, 82]
  initial_tensions_N: [100, 220, 310, 411]
  pulley_speeds_rad_s: [0.05, 0.21]
simulation: {method: steady, elements: 20}
data: {press: press.csv, rig: rig.csv, speedloss: speedloss.csv}
"""

PUBLISHED = ("stiffness", "slip", "friction", "surface", "simulated", "compare")


@pytest.fixture(scope="session")
def recordings(tmp_path_factory: pytest.TempPathFactory, part_of_rig: Any) -> Path:
    """Folder with the recordings: 16 of 120 runs of the friction rig, 8 of 48 of the drive."""
    folder = tmp_path_factory.mktemp("recordings")
    shutil.copy(DATA / "press.csv", folder)
    header, *lines = (DATA / "speedloss.csv").read_text().splitlines(keepends=True)
    labels = list(dict.fromkeys(line.split(",")[0] for line in lines))[::6]
    points = [line for line in lines if line.split(",")[0] in labels]
    (folder / "speedloss.csv").write_text("".join([header, *points]))
    runs = part_of_rig((40, 82), (100, 220, 310, 411), (0.05, 0.21))
    (folder / "rig.csv").write_text(runs)
    (folder / "beltid.yaml").write_text(SHORT_CONFIG)
    (folder / "drive.yaml").write_text(f"{SHORT_CONFIG}drive: {{method: string}}\n")
    return folder


@pytest.fixture(scope="session")
def finished(made_once: Any, recordings: Path) -> Path:
    """Folder with the recordings, the results of the chain in runs/ and the published ones here."""
    return made_once("finished", lambda folder: finish(recordings, folder))


def finish(recordings: Path, folder: Path) -> None:
    """Call the chain and the commands of the drive."""
    shutil.copytree(recordings, folder, dirs_exist_ok=True)
    laws = "surface.parquet stiffness.parquet"
    with pytest.MonkeyPatch.context() as patch:
        # the limits of a drive roughly
        patch.setattr("beltid.drive.limits.TOLERANCE", 0.05)
        done(folder, "run beltid.yaml --no-report -j 1")
        for kind in PUBLISHED:
            shutil.copy(folder / f"runs/5pk/{kind}.parquet", folder)
        done(folder, f"simulate-drive {laws} --from slip.parquet -c drive.yaml")
        done(folder, "compare-drive slip.parquet drive.parquet")


def working_copy(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *without: str
) -> Path:
    """A copy of a folder to work in, as the current folder."""
    copy = tmp_path / "bench"
    shutil.copytree(folder, copy, ignore=shutil.ignore_patterns(*without))
    monkeypatch.chdir(copy)
    monkeypatch.delenv("BELTID_CONFIG", raising=False)
    monkeypatch.setenv("COLUMNS", "100")
    return copy


@pytest.fixture
def bench(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the recordings and the published results beside them."""
    return working_copy(finished, tmp_path, monkeypatch, "runs")


@pytest.fixture
def ran(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The same, with the results of the whole chain in runs/."""
    return working_copy(finished, tmp_path, monkeypatch)


Call = Callable[..., object]


@pytest.fixture
def beltid(monkeypatch: pytest.MonkeyPatch) -> Call:
    """The command line in this process: exit_code, stdout, stderr.

    Without workers: to start them takes longer than most of these tests; tests/chain has them.
    """
    monkeypatch.delenv("BELTID_CONFIG", raising=False)
    monkeypatch.setattr("beltid.batch.run.available_cores", lambda: 1)
    runner = CliRunner()
    return lambda *arguments: runner.invoke(app, [str(a) for a in arguments])

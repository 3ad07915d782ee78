"""A bench folder with recordings and results, and the command line on top of it."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from golden.door import configured, done
from typer.testing import CliRunner

from beltid.cli import app


@pytest.fixture(scope="session")
def finished(made_once: Any, small: Path) -> Path:
    """The small bench of the corpus, with the results of its drive beside the others."""

    def fill(folder: Path) -> None:
        shutil.copytree(small, folder, dirs_exist_ok=True)
        shutil.copy(folder / "runs/small/compare.parquet", folder)
        config = json.loads((folder / "beltid.yaml").read_text())
        configured(folder, config | {"drive": {"method": "string"}}, "drive.yaml")
        laws = "surface.parquet stiffness.parquet"
        with pytest.MonkeyPatch.context() as patch:
            # the limits of a drive roughly
            patch.setattr("beltid.drive.simulator.LIMIT_TOLERANCE", 0.05)
            done(folder, f"simulate-drive {laws} --from slip.parquet -c drive.yaml")

    return made_once("finished", fill)


@pytest.fixture
def ran(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of it to work in, as the current folder, with the results of the chain in runs/."""
    copy = tmp_path / "bench"
    shutil.copytree(finished, copy)
    monkeypatch.chdir(copy)
    monkeypatch.delenv("BELTID_CONFIG", raising=False)
    monkeypatch.setenv("COLUMNS", "100")
    return copy


@pytest.fixture
def bench(ran: Path) -> Path:
    """The same, with the recordings and the published results alone."""
    shutil.rmtree(ran / "runs")
    return ran


@pytest.fixture
def beltid(monkeypatch: pytest.MonkeyPatch) -> Callable[..., object]:
    """The command line in this process: exit_code, stdout, stderr.

    Without workers: to start them takes longer than most of these tests; tests/chain has them.
    """
    monkeypatch.delenv("BELTID_CONFIG", raising=False)
    monkeypatch.setattr("beltid.batch.run.available_cores", lambda: 1)
    runner = CliRunner()
    return lambda *arguments: runner.invoke(app, [str(a) for a in arguments])

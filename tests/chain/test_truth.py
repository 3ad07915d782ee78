"""Round trip: the virtual benches of three belts give back what they were made from.

The recordings are synthetic; their truth is in tests/truth and rigdata/README.md. Here the commands
are judged on the 5PK belt; the other two belts and the simulated rigs, by ``make verify``.
The friction of every run of all belts is in tests/identify/test_friction_rigdata.py.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from beltid.artifacts.artifact import read_artifact
from beltid.batch.chain import BatchOptions, run_batch
from beltid.batch.sources import config_sources
from beltid.cli import app
from beltid.stages.tables import load_stiffness, load_surface

ROOT = Path(__file__).parents[2]
# true laws of the virtual bench, rigdata/README.md
LAWS = {"4pk": (5.6e7, 2.20e11), "5pk": (6.5e7, 3.0256e11), "6pk": (7.1e7, 3.90e11)}
FITS = ("fit-stiffness press", "fit-slip speedloss", "fit-friction rig")


def truth(belt: str, name: str) -> dict[str, dict[str, str]]:
    with (ROOT / "tests" / "truth" / belt / name).open(newline="") as file:
        return {row["run"]: row for row in csv.DictReader(file)}


@pytest.fixture(
    scope="module",
    params=[belt if belt == "5pk" else pytest.param(belt, marks=pytest.mark.long) for belt in LAWS],
)
def identified(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[str, Path]:
    """A belt and the folder with what its recordings say; nothing is simulated."""
    belt = request.param
    folder = tmp_path_factory.mktemp(belt)
    config = ROOT / "configs" / f"{belt}.yaml"
    for fit in FITS:
        command, recording = fit.split()
        source = ROOT / "rigdata" / belt / f"{recording}.csv"
        out = folder / f"{command.removeprefix('fit-')}.parquet"
        called(command, source, "-c", config, "-o", out)
    called("build-surface", folder / "friction.parquet", "-c", config)
    return belt, folder


def called(*arguments: object) -> None:
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert done.exit_code == 0, done.output


def test_normal_law(identified: tuple[str, Path]) -> None:
    belt, folder = identified
    path = folder / "stiffness.parquet"
    law = load_stiffness(path)
    columns = read_artifact(path, "stiffness").columns
    pooled = np.isnan(columns["temperature_degC"])
    deepest = float(columns["max_penetration_m"][pooled][0])
    k1, k2 = LAWS[belt]
    delta = np.linspace(0.0, deepest, 2000)
    force = k1 * delta + k2 * delta**2
    used = force >= 0.1 * force[-1]
    assert np.abs(law.force(delta)[used] / force[used] - 1.0).max() < 1e-3


def test_sliding_speeds(identified: tuple[str, Path]) -> None:
    belt, folder = identified
    columns = read_artifact(folder / "slip.parquet", "slip").columns
    rows = truth(belt, "speedloss_truth.csv")
    expected = np.array([float(rows[run]["slip_speed_m_s"]) for run in columns["run"]])
    deviation = (columns["slip_speed_m_s"] - expected) / columns["slip_speed_se_m_s"]
    # standard errors mean what they say: about one, over all runs
    assert 0.5 < np.sqrt(np.mean(deviation**2)) < 2.0


def test_friction_falls_with_the_force_at_every_speed(identified: tuple[str, Path]) -> None:
    _, folder = identified
    columns = read_artifact(folder / "surface.parquet", "surface").columns
    averaged = np.isnan(columns["arc_deg"])
    assert averaged.any()
    for speed in np.unique(columns["slip_speed_m_s"][averaged]):
        here = averaged & (columns["slip_speed_m_s"] == speed)
        order = np.argsort(columns["normal_force_N_m"][here])
        assert np.all(np.diff(columns["mu"][here][order]) < 0)


def test_the_surface_stays_within_the_measured_band(identified: tuple[str, Path]) -> None:
    _, folder = identified
    measured = read_artifact(folder / "friction.parquet", "friction").columns
    surface = load_surface(folder / "surface.parquet")
    for k, speed in enumerate(surface.slip_speed_m_s):
        mu = measured["mu_sliding"][np.abs(measured["slip_speed_m_s"] / speed - 1.0) < 0.02]
        assert mu.size == 24
        assert mu.min() <= surface.mu_nodes[:, k].min()
        assert surface.mu_nodes[:, k].max() <= mu.max()
    f = np.geomspace(100.0, 20_000.0, 300)[:, None]
    anywhere = surface.mu(f, np.geomspace(1e-4, 1.0, 300))
    assert measured["mu_sliding"].min() <= anywhere.min() * (1.0 + 1e-12)
    assert anywhere.max() <= measured["mu_sliding"].max() * (1.0 + 1e-12)


@pytest.mark.long
def test_the_simulated_rig_agrees_with_the_benches_of_the_other_belts(tmp_path: Path) -> None:
    configs = [ROOT / "configs" / f"{belt}.yaml" for belt in ("4pk", "6pk")]
    summary = run_batch(config_sources(configs), tmp_path, BatchOptions(jobs=2, report=False))
    assert summary.exit_status == 0, summary.table
    for row in summary.table:
        assert set(row["stages"].values()) == {"done"}
        assert row["fit_friction"]["runs"] == row["simulate_rig"]["runs"] == 120
        assert row["compare"]["runs_compared"] == 120

"""A known contact law, as a value and as the results of a belt."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from golden import benches
from typer.testing import CliRunner

import beltid
from beltid.cli import app
from beltid.export.law import BeltFacts, ContactLaw, NormalPart, Provenance, Validity, friction_part

FORCES = np.geomspace(400.0, 12000.0, 8)
SPEEDS = np.geomspace(0.0025, 0.04, 5)
K_LINEAR, K_QUADRATIC = 6.5e7, 3.0256e11  # Eq. (3) of the paper


def known_mu(force: Any, speed: Any) -> Any:
    """Falls with the force, rises with the speed, as the paper's Fig. 13."""
    return 0.9 * (np.asarray(force) / 3000.0) ** -0.17 * (np.asarray(speed) / 0.01) ** 0.16


@pytest.fixture(scope="session")
def law() -> ContactLaw:
    mu = known_mu(FORCES[:, None], SPEEDS)
    return ContactLaw(
        origin="synthetic",
        belt=BeltFacts(name="5pk", type="5PK", ribs=5),
        normal=NormalPart(
            k_linear_N_m2=K_LINEAR,
            k_quadratic_N_m3=K_QUADRATIC,
            covariance=((1.4e8, -1.0e12), (-1.0e12, 8.2e15)),
        ),
        friction=friction_part(beltid.FrictionSurface(FORCES, SPEEDS, mu, 0.002 * mu), "refined"),
        validity=Validity(
            measured_force_N_m=(900.0, 8000.0),
            normal_force_N_m=(FORCES[0], FORCES[-1]),
            slip_speed_m_s=(SPEEDS[0], SPEEDS[-1]),
            press_force_N_m=(0.0, 1.0e4),
        ),
        provenance=Provenance(
            software="beltid 0.0", recordings={"press": "a" * 64, "rig": "b" * 64}
        ),
    )


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Stiffness and surface of a 6PK belt with the known law, and the config beside them."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "beltid.yaml").write_text(
        "belt: {name: six, type: 6PK, ribs: 6}\ndata: {origin: synthetic}\n"
    )
    benches.press().to_csv(folder / "press.csv", index=False)
    benches.Rig().recording()[benches.CELLS].to_csv(folder / "rig.csv", index=False)
    for command in (
        ("fit-stiffness", "press.csv"),
        ("fit-friction", "rig.csv"),
        ("build-surface", "friction.parquet"),
    ):
        done = CliRunner().invoke(app, [command[0], str(folder / command[1])])
        assert done.exit_code == 0, done.stderr
    return folder


@pytest.fixture
def results(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of these results that a test may change."""
    monkeypatch.delenv("BELTID_CONFIG", raising=False)
    return shutil.copytree(made, tmp_path / "results")

"""A known contact law, as a value and as the results of a belt."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import beltid
from beltid.export.law import BeltFacts, ContactLaw, NormalPart, Provenance, Validity, friction_part

FORCES = np.geomspace(400.0, 12000.0, 8)
SPEEDS = np.geomspace(0.0025, 0.04, 5)
K_LINEAR, K_QUADRATIC = 6.5e7, 3.0256e11  # Eq. (3) of the paper


@pytest.fixture(scope="session")
def law() -> ContactLaw:
    # falls with the force, rises with the speed, as the paper's Fig. 13
    mu = 0.9 * (FORCES[:, None] / 3000.0) ** -0.17 * (SPEEDS / 0.01) ** 0.16
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


@pytest.fixture
def results(small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of stiffness and surface of the small bench that a test may change."""
    monkeypatch.delenv("BELTID_CONFIG", raising=False)
    others = shutil.ignore_patterns("runs", "surface_refined.parquet", "simulated.parquet")
    return shutil.copytree(small, tmp_path / "results", ignore=others)

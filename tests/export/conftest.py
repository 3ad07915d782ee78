"""A known contact law, as a value and as the artifacts of a folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltid.artifacts.artifact import write_artifact
from beltid.artifacts.file_bytes import sha256
from beltid.artifacts.metadata_models import Metadata
from beltid.config import Config
from beltid.export.law import (
    BeltFacts,
    ContactLaw,
    NormalPart,
    Provenance,
    Validity,
    friction_part,
)
from beltid.laws.friction_surface import FrictionSurface

FORCES = np.geomspace(400.0, 12000.0, 8)
SPEEDS = np.geomspace(0.0025, 0.04, 5)
K_LINEAR, K_QUADRATIC = 6.5e7, 3.0256e11  # Eq. (3) of the paper
COVARIANCE = [[1.4e8, -1.0e12], [-1.0e12, 8.2e15]]
UNUSED = (
    "arc_deg",
    "initial_tension_N",
    "nominal_tension_N",
    "pulley_speed_rad_s",
    "slip_speed_m_s",
    "tension_tight_N",
    "tension_slack_N",
    "mu_sliding_se",
    "normal_force_N_m",
    "temperature_degC",
)
SHA = {"press": "a" * 64, "rig": "b" * 64}


def known_mu(force: Any, speed: Any) -> Any:
    """Falls with the force, rises with the speed, as the paper's Fig. 13."""
    return 0.9 * (np.asarray(force) / 3000.0) ** -0.17 * (np.asarray(speed) / 0.01) ** 0.16


def known_surface() -> FrictionSurface:
    mu = known_mu(FORCES[:, None], SPEEDS[None, :])
    return FrictionSurface(FORCES, SPEEDS, mu, 0.002 * mu)


@pytest.fixture(scope="session")
def law() -> ContactLaw:
    return ContactLaw(
        origin="synthetic",
        belt=BeltFacts(name="5pk", type="5PK", ribs=5),
        normal=NormalPart(
            k_linear_N_m2=K_LINEAR,
            k_quadratic_N_m3=K_QUADRATIC,
            covariance=tuple(map(tuple, COVARIANCE)),
        ),
        friction=friction_part(known_surface(), "refined"),
        validity=Validity(
            normal_force_N_m=(FORCES[0], FORCES[-1]),
            slip_speed_m_s=(SPEEDS[0], SPEEDS[-1]),
            press_force_N_m=(0.0, 1.0e4),
        ),
        provenance=Provenance(software="beltid 0.0", recordings=SHA),
    )


def write_results(folder: Path, config: Config, origin: str | None = "synthetic") -> None:
    """The artifacts of a belt with the known law."""
    write_artifact(
        folder / "stiffness.parquet",
        "stiffness",
        {
            "temperature_degC": [22.0, np.nan],
            "k_linear_N_m2": [6.0e7, K_LINEAR],
            "k_quadratic_N_m3": [3.1e11, K_QUADRATIC],
            "k_linear_se_N_m2": [np.nan, 1.2e4],
            "k_quadratic_se_N_m3": [np.nan, 9.0e7],
            "covariance": [None, [cell for row in COVARIANCE for cell in row]],
            "contact_offset_mm": [0.1, 0.1],
            "rms_residual_N_m": [np.nan, 300.0],
            "hysteresis_ratio": [np.nan, 0.13],
            "max_penetration_m": [1.0e-4, 1.0e-4],
            "max_force_N_m": [1.0e4, 1.0e4],
            "n_samples": [10, 40],
        },
        Metadata(
            inputs={"press": SHA["press"]},
            validity={"penetration_m": [0.0, 1.0e-4], "force_N_m": [0.0, 1.0e4]},
            origin=origin,
        ),
    )
    friction = folder / "friction.parquet"
    sliding = np.array([1.0, 0.8, 0.9, 0.7])
    write_artifact(
        friction,
        "friction",
        {
            **{name: np.full(4, np.nan) for name in UNUSED},
            "run": [f"R{i}" for i in range(4)],
            "mu_sliding": sliding,
            "mu_sticking": sliding * [1.02, 1.06, np.nan, 3.0],
            "n_samples": np.full(4, 100),
            "status": ["ok", "ok", "ok", "no plateau"],
        },
        Metadata(inputs={"rig": SHA["rig"]}),
    )
    surface = known_surface()
    for name, method, factor in (
        ("surface", "published", 0.95),
        ("surface_refined", "refined", 1.0),
    ):
        write_artifact(
            folder / f"{name}.parquet",
            "surface",
            {
                "arc_deg": np.full(40, np.nan),
                "normal_force_N_m": np.repeat(FORCES, 5),
                "slip_speed_m_s": np.tile(SPEEDS, 8),
                "mu": factor * surface.mu_nodes.ravel(),
                "mu_se": factor * surface.mu_se_nodes.ravel(),
                "n_arcs": np.full(40, 3),
            },
            Metadata(
                config_sha256=config.sha256,
                inputs={"friction": sha256(friction.read_bytes())},
                validity={
                    "normal_force_N_m": [FORCES[0], FORCES[-1]],
                    "slip_speed_m_s": [SPEEDS[0], SPEEDS[-1]],
                },
                method=method,
                origin=origin,
                config="beltid.yaml",
            ),
        )


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder with the artifacts of a 6PK belt, and its config beside them."""
    folder = tmp_path / "results"
    folder.mkdir()
    monkeypatch.delenv("BELTID_CONFIG", raising=False)
    config = Config.model_validate({"belt": {"name": "six", "type": "6PK", "ribs": 6}})
    (folder / "beltid.yaml").write_text("belt: {name: six, type: 6PK, ribs: 6}\n")
    write_results(folder, config)
    return folder

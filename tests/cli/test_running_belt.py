"""A running belt: reduced and published, not simulated."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import beltid as library
from beltid.artifacts.artifact import read_artifact
from beltid.errors import InputError

V_B, MOMENTUM, OMEGA = 10.0, 10.0, 200.0
"""Speed of the belt [m/s]; m v² with 0.1 kg/m [N]; speed of the pulley with the belt [rad/s]."""
CONFIG = """\
belt: {name: 5pk, mass_per_length_kg_m: 0.1}
rig: {kind: running}
data: {press: press.csv, rig: rig.csv}
"""
MADE = ("fit-stiffness", "fit-friction", "build-surface")


@pytest.fixture
def running(recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The short recordings as a bench shows them whose belt runs."""
    header, *rows = (recordings / "rig.csv").read_text().splitlines()
    lines = [f"{header},belt_speed_m_s"]
    for cells in (row.split(",") for row in rows):
        for k, more in ((2, MOMENTUM), (3, MOMENTUM), (7, MOMENTUM), (4, OMEGA)):
            cells[k] = f"{float(cells[k]) + more:.9g}" if cells[k] else ""
        lines.append(",".join([*cells, f"{V_B:g}"]))
    (tmp_path / "rig.csv").write_text("\n".join(lines) + "\n")
    (tmp_path / "press.csv").write_bytes((recordings / "press.csv").read_bytes())
    (tmp_path / "beltid.yaml").write_text(CONFIG)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_running_belt_is_reduced_and_published_and_nowhere_simulated(
    running: Path, recordings: Path, beltid: Any
) -> None:
    planned = beltid("run", "beltid.yaml", "--dry-run", "--json")
    assert {row["step"] for row in json.loads(planned.stdout)["table"]} >= set(MADE)
    done = beltid("run", "beltid.yaml", "--json", "--no-report")
    assert done.exit_code == 0, done.stderr
    assert "rig.kind: running" in done.stderr
    (row,) = json.loads(done.stdout)["table"]
    stages = {"fit-slip": "no recording", **dict.fromkeys(MADE, "done")}
    assert row["stages"] == stages
    friction = read_artifact("runs/5pk/friction.parquet", "friction").columns
    at_rest = library.fit_friction(library.read_rig(recordings / "rig.csv")).columns
    np.testing.assert_allclose(friction["momentum_N"], MOMENTUM)
    for name, tolerance in (("mu_sliding", 1e-6), ("slip_speed_m_s", 1e-5)):
        np.testing.assert_allclose(friction[name], at_rest[name], rtol=tolerance)

    folder = "runs/5pk/"
    stiffness, surface = f"{folder}stiffness.parquet", f"{folder}surface.parquet"
    for call in (
        ("simulate-rig", surface, stiffness),
        ("refine-surface", f"{folder}friction.parquet", stiffness),
        ("compare", f"{folder}friction.parquet", stiffness, "--hold-out", "arc"),
        ("plan", surface, stiffness),
    ):
        refused = beltid(*call, "-c", "beltid.yaml")
        assert refused.exit_code == 2, (call, refused.stderr)
        for named in ("rig.kind: running", "fit-friction", "build-surface"):
            assert named in refused.stderr


def test_a_running_belt_is_not_simulated_from_python() -> None:
    run = {"arc_deg": 82.0, "initial_tension_N": 200.0, "pulley_speed_rad_s": 0.2}
    law = library.NormalLaw(6.5e7, 3.0e11)
    with pytest.raises(InputError, match=r"rig\.kind: running"):
        library.simulate_rig({"rig": {"kind": "running"}}, 0.5, law, **run)

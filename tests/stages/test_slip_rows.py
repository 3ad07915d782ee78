"""Every operating point of the speed-loss bench keeps its row, also one that is of no use."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import beltid
from beltid.artifacts.artifact import read_artifact
from beltid.config import ConfigSource, load_config
from beltid.stages.identification import fit_slip
from beltid.stages.reporter import Options


def recording(folder: Path) -> Path:
    """Twelve points with creep, then: driver at rest, no speeds at all, no torque, turned round."""
    rng = np.random.default_rng(5)
    lines = ["run,time_s,initial_tension_N,torque_N_m,driver_speed_rad_s,driven_speed_rad_s"]
    points: list[tuple[Any, float]] = [(k, 60.0) for k in range(12)]
    points += [(3, 0.0), (3, np.nan), (np.nan, 60.0), (4, -60.0)]
    for run, (torque, speed) in enumerate(points, start=1):
        for k in range(50):
            driver = speed * (1 + 1e-5 * rng.standard_normal())
            loss = 0.02 * np.nan_to_num(torque) * np.sign(speed)
            driven = driver - loss + 1e-3 * rng.standard_normal() * (speed != 0.0)
            cells = [310, torque, driver, driven]
            shown = ("" if np.isnan(cell) else f"{cell:.8g}" for cell in cells)
            lines.append(f"P{run},{0.1 * k:.1f},{','.join(shown)}")
    path = folder / "speedloss.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture(scope="module")
def columns(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    path = recording(tmp_path_factory.mktemp("bench"))
    source = ConfigSource(load_config(None), "test")
    out = path.with_name("slip.parquet")
    summary = fit_slip.run(source, {"speedloss": path}, out, Options())
    assert summary.facts["runs"] == 16
    assert len(summary.table) == 16
    artifact = read_artifact(out, "slip")
    aside = [row["run"] for row in artifact.metadata.set_aside]
    assert aside == ["P13", "P14", "P16"]
    assert any(line.startswith("run P13 set aside: ") for line in summary.warnings)
    return artifact.columns


def test_no_point_loses_its_row(columns: dict[str, np.ndarray]) -> None:
    assert list(columns["run"]) == [f"P{k}" for k in range(1, 17)]


def test_a_driver_at_rest_is_reported_as_such(columns: dict[str, np.ndarray]) -> None:
    assert columns["driver_speed_rad_s"][12] == 0.0
    assert columns["status"][12] == "the driver does not turn"
    assert np.isfinite(columns["torque_N_m"][12])


def test_what_is_not_known_is_null(columns: dict[str, np.ndarray]) -> None:
    assert np.isnan(columns["slip_speed_m_s"][13])
    assert np.isnan(columns["driver_speed_rad_s"][13])
    assert "usable samples" in columns["status"][13]
    assert np.isnan(columns["torque_N_m"][14])


def test_a_drive_turned_round_is_refused(columns: dict[str, np.ndarray]) -> None:
    assert columns["driver_speed_rad_s"][15] == pytest.approx(-60.0, rel=1e-4)
    assert "backwards" in columns["status"][15]


def test_the_frame_has_the_same_rows(tmp_path: Path) -> None:
    import pandas as pd

    frame = pd.read_csv(recording(tmp_path))
    assert len(beltid.fit_slip(frame).to_frame()) == 16


def test_speeds_of_the_rig_are_written_only_if_they_are_stated(tmp_path: Path) -> None:
    path = recording(tmp_path)
    told = []
    for rig in ({}, {"pulley_speeds_rad_s": [0.3]}):
        found = beltid.fit_slip(beltid.read_speedloss(path), {"rig": rig})
        told.append("the rig runs at 0.3 rad/s" in " ".join(found.notes))
        assert rig or "the rig runs at" not in " ".join(found.notes)
    assert told == [False, True]


def test_speeds_that_are_stated_as_they_are_built_in_are_written_too(tmp_path: Path) -> None:
    path, out = recording(tmp_path), tmp_path / "slip.parquet"
    built_in = list(load_config(None).rig.pulley_speeds_rad_s)
    for rig, told in (({}, False), ({"pulley_speeds_rad_s": built_in}, True)):
        source = ConfigSource(load_config({"rig": rig}), "test")
        summary = fit_slip.run(source, {"speedloss": path}, out, Options())
        assert any("the rig runs at" in note for note in summary.notes) is told

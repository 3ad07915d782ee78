"""A small laboratory: 120 sheets with German signs, read without a line that has to be pasted."""

from __future__ import annotations

from pathlib import Path

import german_sheets
import numpy as np
import pandas as pd
import pytest
from golden.door import beltid as call
from golden.door import done

from beltid.bench.recording import read_recording
from beltid.config import load_config

CHANNELS = ["time_s", "torque_N_m", "pulley_speed_rad_s", "weight_N", "arc_deg"]


def test_init_states_all_that_the_sheets_of_weight_and_torque_hold(tmp_path: Path) -> None:
    """Columns, units, runs, arcs, weights and speeds; what is guessed has a comment."""
    truth = german_sheets.write_rig(tmp_path / "versuche", samples=60, speeds=2)
    german_sheets.write_press(tmp_path / "presse.xlsx")
    call(tmp_path, "init", "5pk", "versuche", "presse.xlsx")
    config, text = load_config(tmp_path / "5pk.yaml"), (tmp_path / "5pk.yaml").read_text()
    assert {kind: path.name for kind, path in config.data.files.items()} == {
        "rig": "versuche",
        "press": "presse.xlsx",
    }
    assert [*config.rig.arcs_deg] == [40.0, 68.0, 82.0]
    assert config.rig.holds == "weight_slack"  # by the name of the field
    weights = [mass * german_sheets.G for mass in german_sheets.WEIGHTS_KG]
    np.testing.assert_allclose(config.rig.initial_tensions_N, weights, 1e-3)
    np.testing.assert_allclose(config.rig.pulley_speeds_rad_s, german_sheets.SPEEDS_RAD_S[:2], 1e-3)
    assert 'Grad.xlsx"  # guessed' in text
    assert "Zeit  # recognised by its name" in text
    read = read_recording(tmp_path / "versuche", "rig", config)
    assert len(set(read.columns["run"])) == 24
    assert any("sheet Übersicht left out" in note for note in read.notes)
    found = pd.DataFrame({name: read.columns[name] for name in ("run", *CHANNELS)})
    found = found.set_index(["run", "time_s"]).sort_index()
    true = truth[["run", *CHANNELS]].set_index(["run", "time_s"]).sort_index()
    for name in CHANNELS[1:]:
        np.testing.assert_allclose(found[name], true[name], 1e-4, 1e-4, err_msg=name)


def judged(folder: Path, truth: pd.DataFrame) -> None:
    """Check the coefficients of all runs against those that made the sheets."""
    found = pd.read_parquet(folder / "friction.parquet").set_index("run")
    assert set(found["status"]) == {"ok"}
    mu = pd.Series(german_sheets.bench().runs()["mu"].to_numpy(), truth["run"].unique())
    np.testing.assert_allclose(found["mu_sliding"][mu.index], mu, 2e-3)


@pytest.mark.long
@pytest.mark.parametrize("channel", ["tension_tight_N", "torque_N_m"])
def test_from_sheets_to_a_refined_surface_and_a_report_in_four_commands(
    channel: str, tmp_path: Path
) -> None:
    truth = german_sheets.write_rig(tmp_path / "versuche", channel, 150)
    german_sheets.write_press(tmp_path / "presse.xlsx")
    done(tmp_path, "inspect", "presse.xlsx")
    done(tmp_path, "init", "5pk", "versuche", "presse.xlsx")
    said = call(tmp_path, "run", "5pk.yaml")
    assert said.status not in (1, 2), said.stderr  # the verdict is not the subject
    done(tmp_path, "report", "runs/5pk")
    results = tmp_path / "runs" / "5pk"
    assert {"surface_refined.parquet", "report.html"} <= {path.name for path in results.iterdir()}
    judged(results, truth)

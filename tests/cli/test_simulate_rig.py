"""simulate-rig: parts of a campaign, and what the solver did."""

from __future__ import annotations

import json
import math
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltid.store.artifact import read_artifact

CALL = ("simulate-rig", "surface.parquet", "stiffness.parquet")
ONE = ("--arc", "82", "--tension", "220", "--speed", "0.21")


@pytest.mark.parametrize("pick", [("--arc", "82"), ("--tension", "220")])
def test_a_part_of_a_campaign_does_not_take_the_place_of_the_whole(
    bench: Path, beltid: Any, pick: tuple[str, str]
) -> None:
    whole = (bench / "simulated.parquet").read_bytes()
    result = beltid(*CALL, *pick)
    assert result.exit_code == 0, result.stderr
    assert (bench / "simulated.parquet").read_bytes() == whole
    part = read_artifact(bench / "simulated_part.parquet", "simulated")
    assert 0 < len(set(part.columns["run"])) < 16
    assert "simulated_part.parquet" in result.stdout


def test_what_the_solver_did_is_shown_on_request(bench: Path, beltid: Any) -> None:
    call = (*CALL, *ONE, "--method", "transient")
    plain, verbose = beltid(*call), beltid(*call, "-v")
    assert "solver" not in plain.stdout
    for word in ("iterations", "changes", "residual", "clamped"):
        assert word in verbose.stdout.split("solver")[1]
    # a table that fits the terminal, the run first
    assert verbose.stdout.count("S012") == 2
    assert "- run:" not in verbose.stdout
    (row,) = json.loads(beltid(*call, "--json").stdout)["details"]["solver"]
    assert row["run"] == "S012"
    assert row["steps"] >= 52
    assert row["newton_iterations"] >= row["steps"]
    assert 0 <= row["residual"] < 1e-3
    assert 0 <= row["clamped_lookups_percent"] <= 100


def test_a_dead_weight_keeps_its_force_and_its_recording_is_reduced(
    bench: Path, beltid: Any
) -> None:
    config = (bench / "beltid.yaml").read_text()
    with_weight = config.replace("rig:\n", "rig:\n  kind: dead_weight\n  holds: weight_slack\n")
    (bench / "weight.yaml").write_text(with_weight)
    call = (*CALL, *ONE, "--method", "transient", "-o", "run.parquet", "-c", "weight.yaml")
    result = beltid(*call)
    assert result.exit_code == 0, result.stderr
    assert "one that swings freely makes mu lower" in result.stderr
    recorded = read_artifact(bench / "run.parquet", "simulated").columns
    np.testing.assert_allclose(recorded["tension_slack_N"], 220.0, rtol=1e-8)
    assert recorded["tension_tight_N"][-1] > 2.0 * 220.0

    reduced = beltid("fit-friction", "run.parquet", "-o", "back.parquet", "-c", "weight.yaml")
    assert reduced.exit_code == 0, reduced.stderr
    mu = read_artifact(bench / "back.parquet", "friction").columns["mu_sliding"][0]
    # Eq. (6) from the tensions that slide
    ratio = recorded["tension_tight_N"][-1] / 220.0
    assert mu == pytest.approx(math.log(ratio) / math.radians(82), rel=1e-3)


def _runs(path: Path) -> set[tuple[float, float, float]]:
    """Settings of the runs of a simulated recording; of the speeds the nearest hundredth."""
    runs = read_artifact(path, "simulated").tables["simulated_runs"]
    return {
        (row["arc_deg"], row["initial_tension_N"], round(row["pulley_speed_rad_s"], 2))
        for row in runs
    }


def test_the_runs_are_those_measured_where_the_config_states_no_settings(
    bench: Path, beltid: Any
) -> None:
    (bench / "open.yaml").write_text("simulation: {method: steady, elements: 20}\n")
    result = beltid(*CALL, "-c", "open.yaml", "-o", "open.parquet")
    assert result.exit_code == 0, result.stderr
    assert "16 runs, steady, at the settings measured" in result.stderr
    tensions, speeds = (100.0, 220.0, 310.0, 411.0), (0.05, 0.21)
    assert _runs(bench / "open.parquet") == set(product((40.0, 82.0), tensions, speeds))
    compared = beltid("compare", "friction.parquet", "open.parquet", "-c", "open.yaml", "--json")
    assert json.loads(compared.stdout)["facts"]["runs_compared"] == 16
    # elsewhere nothing tells what was measured, unless it is named
    (bench / "away").mkdir()
    (bench / "surface.parquet").rename(bench / "away/surface.parquet")
    away = ("simulate-rig", "away/surface.parquet", "stiffness.parquet", "-c", "open.yaml")
    picked = ("--arc", "82", "--tension", "411", "--speed", "0.21")
    assert "1 run, steady, as the config states" in beltid(*away, *picked).stderr
    named = beltid(*away, *picked, "--from", "friction.parquet", "--force")
    assert "1 run, steady, at the settings measured" in named.stderr


def test_stated_settings_that_differ_are_shown_before_anything_is_simulated(
    bench: Path, beltid: Any
) -> None:
    (bench / "other.yaml").write_text("rig: {arcs_deg: [40, 70]}\nsimulation: {method: steady}\n")
    call = (*CALL, "-c", "other.yaml", "-o", "other.parquet")
    lines = beltid(*call).stderr.splitlines()
    told = [k for k, line in enumerate(lines) if "states 40, 70 °, measured are 40, 82 °" in line]
    begun = [k for k, line in enumerate(lines) if "16 runs, steady, as the config states" in line]
    assert len(told) == 1
    assert told < begun
    assert {run[0] for run in _runs(bench / "other.parquet")} == {40.0, 70.0}
    again = beltid(*call).stderr
    assert "up to date" in again
    assert "measured are 40, 82 °" in again

"""simulate-rig: parts of a campaign, the contact along the arc in time, what the solver did."""

from __future__ import annotations

import json
import math
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltid.artifacts.artifact import read_artifact
from beltid.tables import schemas

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


def test_profiles_are_written_next_to_the_recording(bench: Path, beltid: Any) -> None:
    # slowly turned, so that the travel at a time tells how far the slip front has come
    transient = (*CALL, *ONE, "--method", "transient", "-o", "run.parquet")
    assert beltid(*transient).exit_code == 0
    plain = (bench / "run.parquet").read_bytes()
    result = beltid(*transient, "--profile-time", "0.002", "--profile-time", "0.05", "--json")
    assert result.exit_code == 0, result.stderr
    # looking on changes nothing, and the recording is not made again
    assert (bench / "run.parquet").read_bytes() == plain
    assert json.loads(result.stdout)["facts"]["profiles"] == "run_profiles.parquet"

    profiles = read_artifact(bench / "run_profiles.parquet", "profiles")
    recording = read_artifact(bench / "run.parquet", "simulated").columns
    columns = profiles.columns
    assert tuple(columns) == schemas.table("profiles").names
    assert profiles.metadata.origin == read_artifact(bench / "surface.parquet").metadata.origin
    assert set(columns["run"]) == {"S012"}
    times = np.unique(columns["time_s"])
    assert times.size == 2
    assert set(times) <= set(recording["time_s"])
    turning = np.flatnonzero(recording["pulley_speed_rad_s"] > 0)
    start = recording["time_s"][turning[0] - 1]
    steps = np.diff(recording["time_s"]).max()
    assert times - start == pytest.approx([0.002, 0.05], abs=steps)

    early, late = (columns["time_s"] == t for t in times)
    # 0.21 rad/s x 0.05 m x 2 ms = 21 µm of travel: most sticks; after 0.5 mm everything slides
    assert columns["sticks"][early].mean() > 0.5
    assert not columns["sticks"][late].any()
    # the belt rests, pressed in by at most 150 µm: there the pulley's surface is slower by that
    slip = columns["slip_speed_m_s"][late]
    assert 0.21 * (0.05 - 150e-6) < slip.min() <= slip.max() < 0.21 * 0.05 * (1 + 1e-9)
    for here, time in ((early, times[0]), (late, times[1])):
        sample = np.flatnonzero(recording["time_s"] == time)[0]
        tight = recording["tension_tight_N"][sample]
        slack = recording["tension_slack_N"][sample]
        position = columns["arc_position_m"][here]
        assert np.all(np.diff(position) > 0)
        # moment about the pulley's axis: the friction along the arc is what the supports differ by
        total = np.trapezoid(columns["tangential_force_N_m"][here], position)
        assert abs(total) == pytest.approx(tight - slack, rel=0.01)
        # Eq. (8) at the tight end, and its closed form along the arc
        mu = math.log(tight / slack) / math.radians(82)
        expected = tight * np.exp(-mu * position / 0.05) / 0.05
        assert columns["capstan_force_N_m"][here] == pytest.approx(expected, rel=1e-6)


def test_profiles_are_kept_as_long_as_nothing_changed(bench: Path, beltid: Any) -> None:
    call = (*CALL, *ONE, "--method", "transient", "--profile-time", "0.01")
    assert beltid(*call).exit_code == 0
    path = bench / "simulated_part_profiles.parquet"
    first = path.read_bytes()
    again = beltid(*call)
    assert "up to date" in again.stderr
    assert path.read_bytes() == first
    other = beltid(*call[:-1], "0.02")
    assert "up to date" not in other.stderr
    assert path.read_bytes() != first


def test_a_time_after_the_end_is_reported(bench: Path, beltid: Any) -> None:
    result = beltid(*CALL, *ONE, "--method", "transient", "--profile-time", "99")
    assert result.exit_code == 0
    assert "99 s" in result.stderr
    assert "the state at the end was used" in result.stderr


@pytest.mark.parametrize("time", ["-1", "nan", "inf"])
def test_a_wrong_time_is_refused(bench: Path, beltid: Any, time: str) -> None:
    result = beltid(*CALL, *ONE, "--method", "transient", "--profile-time", time)
    assert result.exit_code == 2
    assert f"--profile-time = {time}, must be >= 0 s" in result.stderr


def test_the_sliding_limit_has_no_times(bench: Path, beltid: Any) -> None:
    result = beltid(*CALL, *ONE, "--method", "steady", "--profile-time", "0.1")
    assert result.exit_code == 2
    assert "--profile-time" in result.stderr
    assert "transient" in result.stderr
    assert not (bench / "simulated_part.parquet").exists()


def test_a_foreign_file_in_the_way_of_the_profiles_is_seen_before_the_work(
    bench: Path, beltid: Any
) -> None:
    (bench / "simulated_part_profiles.parquet").write_text("mine")
    result = beltid(*CALL, *ONE, "--method", "transient", "--profile-time", "0.1")
    assert result.exit_code == 2
    assert "did not write" in result.stderr
    assert not (bench / "simulated_part.parquet").exists()


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
    with_weight = config.replace("rig:\n", "rig:\n  kind: dead_weight\n  weight_on: slack\n")
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
    runs = read_artifact(path, "simulated").metadata.runs
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

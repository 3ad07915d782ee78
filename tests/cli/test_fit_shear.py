"""fit-shear on its own: a synthetic recording with ribs that shear, and recordings without."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

import beltid as package
from beltid.artifacts.artifact import read_artifact
from beltid.config import load_config

RIGDATA = Path(__file__).parents[2] / "rigdata"
K_S, SPAN = 3.4e7, 0.110
"""Of rigdata/shear/rig.csv; supports of 1e-7 m/N are 0.01 m of a belt of 1e5 N."""


@pytest.fixture
def shear(bench: Path) -> Path:
    shutil.copy(RIGDATA / "shear" / "rig.csv", bench / "shear.csv")
    return bench


def test_the_stiffness_of_the_recording_is_found_and_reported(shear: Path, beltid: Any) -> None:
    result = beltid("fit-shear", "shear.csv", "--json", "-o", "shear.parquet")
    assert result.exit_code == 0, result.stderr
    product = json.loads(result.stdout)
    facts = product["facts"]
    assert abs(facts["shear_stiffness_N_m2"] - K_S) < 2.0 * facts["shear_stiffness_u_N_m2"]
    assert facts["shear_stiffness_u_N_m2"] < 0.1 * K_S
    assert facts["shear_stiffness_low_N_m2"] < K_S < facts["shear_stiffness_high_N_m2"]
    assert abs(facts["effective_span_m"] - SPAN) < 2.0 * facts["effective_span_u_m"]
    assert len(product["table"]) == facts["runs_used"] == 6
    # what is to be copied into a config is one
    section = yaml.safe_load(product["snippet"])
    stated = load_config(section).belt.shear_stiffness_N_m2
    assert stated == pytest.approx(facts["shear_stiffness_N_m2"], rel=1e-3)
    # the shares of the budget make up the whole
    rows = facts["budget"]
    parts = [r["contribution_percent"] for r in rows if r["source"] != "combined"]
    whole = 100.0 * facts["shear_stiffness_u_N_m2"] / facts["shear_stiffness_N_m2"]
    assert np.linalg.norm(parts) == pytest.approx(whole, rel=1e-3)


def test_the_press_of_the_belt_makes_the_stiffness_more_certain(shear: Path, beltid: Any) -> None:
    """The usual normal law is known to 40 %, that of the press, the true one here, to 2 to 3 %."""
    beltid("fit-stiffness", "press.csv")
    usual, measured = (
        json.loads(beltid("fit-shear", "shear.csv", *more, "--json", "--force").stdout)["facts"]
        for more in ((), ("--stiffness", "stiffness.parquet"))
    )
    u = measured["shear_stiffness_u_N_m2"]
    assert u < 0.7 * usual["shear_stiffness_u_N_m2"]
    assert abs(measured["shear_stiffness_N_m2"] - K_S) < 2.0 * u
    assert measured["shear_stiffness_low_N_m2"] < K_S < measured["shear_stiffness_high_N_m2"]
    (row,) = (r for r in measured["budget"] if r["source"] == "normal stiffness of the ribs")
    assert row["basis"] == "fitted"
    assert row["contribution_percent"] < 1.0


def test_a_second_call_finds_it_up_to_date_and_shows_it(shear: Path, beltid: Any) -> None:
    first = beltid("fit-shear", "shear.csv")
    again = beltid("fit-shear", "shear.csv")
    assert "up to date" in again.stderr
    assert again.stdout == first.stdout
    stored = read_artifact(shear / "shear.parquet", "shear")
    assert stored.metadata.resolved
    shown = beltid("show", "shear.parquet")
    assert shown.exit_code == 0
    assert "travel per tension difference" in shown.stdout


def test_a_recording_read_run_by_run_gives_the_same(
    shear: Path, beltid: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    beltid("fit-shear", "shear.csv", "-o", "whole.parquet")
    monkeypatch.setattr("beltid.bench.recording.BIG", 1000)
    result = beltid("fit-shear", "shear.csv", "-o", "runs.parquet")
    assert result.exit_code == 0, result.stderr
    whole, runs = (read_artifact(shear / f"{n}.parquet", "shear") for n in ("whole", "runs"))
    assert runs.metadata.shear_stiffness_N_m2 == whole.metadata.shear_stiffness_N_m2
    assert runs.columns["slope_N_m"].tolist() == whole.columns["slope_N_m"].tolist()


def test_a_rig_without_two_cells_is_refused(shear: Path, beltid: Any) -> None:
    (shear / "weight.yaml").write_text("rig: {kind: dead_weight}\n")
    result = beltid("fit-shear", "shear.csv", "-c", "weight.yaml", "-o", "weight.parquet")
    assert result.exit_code == 2
    assert "must be two_cells" in result.stderr


def test_the_function_gives_what_the_command_writes(shear: Path, beltid: Any) -> None:
    beltid("fit-shear", "shear.csv")
    stored = read_artifact(shear / "shear.parquet", "shear")
    found = package.fit_shear(pd.read_csv(shear / "shear.csv"), shear / "beltid.yaml")
    assert found.result.shear_stiffness_N_m2 == stored.metadata.shear_stiffness_N_m2
    assert found.to_frame()["slope_N_m"].tolist() == stored.columns["slope_N_m"].tolist()


def test_the_function_takes_off_what_is_known_of_the_cells() -> None:
    frame = pd.read_csv(RIGDATA / "shear" / "rig.csv")
    cells = ["tension_tight_N", "tension_slack_N"]
    known = {f"{name[:-2]}_gain": 1.25 for name in cells}
    read_low = frame.assign(**{name: frame[name] / 1.25 for name in cells})
    true, corrected = (
        package.fit_shear(read, {"friction": gains}).result.shear_stiffness_N_m2
        for read, gains in ((frame, {}), (read_low, known))
    )
    assert corrected == pytest.approx(true, rel=1e-4)


def test_recordings_that_are_sampled_too_slowly_are_refused(bench: Path, beltid: Any) -> None:
    result = beltid("fit-shear", "rig.csv")
    assert result.exit_code == 2
    assert "16 of 16 runs have" in result.stderr
    assert "must be >= 8: sample at " in result.stderr
    assert not (bench / "shear.parquet").exists()


def test_one_arc_is_refused(shear: Path, beltid: Any) -> None:
    frame = pd.read_csv(shear / "shear.csv")
    frame[frame["arc_deg"] == 82].to_csv(shear / "lone.csv", index=False)
    result = beltid("fit-shear", "lone.csv")
    assert result.exit_code == 2
    assert "contact arc 82 deg only" in result.stderr


def test_runs_that_cannot_be_used_are_kept_with_their_reason(shear: Path, beltid: Any) -> None:
    frame = pd.read_csv(shear / "shear.csv")
    slow = (frame["run"] == "R05") & (frame.index % 8 != 0)
    frame[~slow].to_csv(shear / "some.csv", index=False)
    result = beltid("fit-shear", "some.csv", "--json", "-o", "some.parquet")
    assert result.exit_code == 0, result.stderr
    product = json.loads(result.stdout)
    statuses = {row["run"]: row["status"] for row in product["table"]}
    assert [run for run, status in statuses.items() if status != "ok"] == ["R05"]
    assert "sample at" in statuses["R05"]
    assert any(note.startswith("1 of 6 runs have ") for note in product["notes"])


def test_a_dead_run_is_no_obstacle_to_the_law_of_the_press(shear: Path, beltid: Any) -> None:
    frame = pd.read_csv(shear / "shear.csv")
    frame.loc[frame["run"] == "R01", "tension_tight_N"] = 270.0
    frame.to_csv(shear / "dead.csv", index=False)
    call = ("fit-shear", "dead.csv", "--stiffness", "stiffness.parquet", "--json")
    result = beltid(*call)
    assert result.exit_code == 0, result.stderr
    facts = json.loads(result.stdout)["facts"]
    assert facts["runs_used"] == 5
    assert abs(facts["shear_stiffness_N_m2"] - K_S) < 2.0 * facts["shear_stiffness_u_N_m2"]


@pytest.mark.long
def test_the_function_takes_the_press_as_a_result_too(shear: Path, beltid: Any) -> None:
    """From a file or from memory: the same law, its scatter, and that it is synthetic."""
    press = package.fit_stiffness(
        pd.read_csv(shear / "press.csv"), {"data": {"origin": "synthetic"}}
    )
    path = press.save(shear / "press.parquet")
    frame = pd.read_csv(shear / "shear.csv")
    results = [package.fit_shear(frame, stiffness=given) for given in (path, press)]
    assert [found.origin for found in results] == ["synthetic", "synthetic"]
    budgets = [found.extra["budget"] for found in results]
    assert budgets[0] == budgets[1]
    law = package.fit_shear(frame, stiffness=press.result.pooled.law)
    expected = results[0].result.shear_stiffness_N_m2
    assert law.result.shear_stiffness_N_m2 == pytest.approx(expected, rel=1e-3)
    assert package.fit_shear(frame).origin is None

"""Runs of the simulated campaign, and the recording of a run of which only the limit is known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from beltid.config import load_config
from beltid.errors import InputError
from beltid.identify.friction.reduction import reduce_runs
from beltid.stages.campaign import (
    Picked,
    PlannedRun,
    planned_runs,
    recording_columns,
    result_row,
    simulation_settings,
)
from beltid.tables import schemas

CONFIG = load_config(
    {
        "rig": {
            "arcs_deg": [82, 40],
            "initial_tensions_N": [100, 270.5],
            "pulley_speeds_rad_s": [0.1, 0.2],
        }
    }
)


@dataclass
class Limit:
    """A run of which only the sliding state is known."""

    tension_tight_N: float
    tension_slack_N: float
    mu: float = 0.0
    normal_force_N_m: float = 0.0
    recording: dict[str, Any] | None = None


def test_runs_are_all_settings_in_the_order_of_the_config() -> None:
    runs = planned_runs(CONFIG, Picked())
    assert [run.label for run in runs] == [f"S00{k}" for k in range(1, 9)]
    assert runs[0] == PlannedRun("S001", 82, 100, 0.1)
    assert runs[1].pulley_speed_rad_s == 0.2
    assert runs[2].initial_tension_N == 270.5
    assert runs[4].arc_deg == 40
    assert runs[0].point.beta == pytest.approx(math.radians(82))


def test_picked_runs_keep_their_labels() -> None:
    runs = planned_runs(CONFIG, Picked(arcs_deg=(40.0,), tensions_N=(270.5,)))
    assert [run.label for run in runs] == ["S007", "S008"]


def test_all_wrong_picks_are_said_at_once() -> None:
    with pytest.raises(InputError) as caught:
        planned_runs(CONFIG, Picked((41.0,), (270.0,), (0.1, 0.3)))
    assert caught.value.problems == (
        "--arc = 41, must be one of those of the config: 82, 40",
        "--tension = 270, must be one of those of the config: 100, 270.5",
        "--speed = 0.3, must be one of those of the config: 0.1, 0.2",
    )


@pytest.mark.parametrize("minimum", [8, 20, 500])
def test_the_sliding_limit_survives_the_reduction_exactly(minimum: int) -> None:
    # ln(T_tight/T_slack) = mu beta with mu = 0.7: closed form of Eq. (6)
    runs = planned_runs(CONFIG, Picked())
    limits = [Limit(300.0, 300.0 / math.exp(0.7 * math.radians(run.arc_deg))) for run in runs]
    config = load_config({"friction": {"min_plateau_samples": minimum}})
    columns = recording_columns(runs, limits, config)  # type: ignore[arg-type]
    assert tuple(columns) == schemas.table("simulated").names
    from beltid.stages.reduction import friction_settings

    reduced = reduce_runs(columns, config.rig.pulley_radius_m, friction_settings(config))
    assert [r.run for r in reduced] == [run.label for run in runs]
    for run, r in zip(runs, reduced, strict=True):
        assert r.status == "ok"
        # the model takes 2e-5 of a tension for noise
        assert r.mu_sliding == pytest.approx(0.7, rel=2e-5)
        assert r.initial_tension_N == pytest.approx(run.initial_tension_N, rel=1e-12)
        assert r.pulley_speed_rad_s == pytest.approx(run.pulley_speed_rad_s, rel=1e-12)
        assert math.isnan(r.mu_sticking)  # a limit has no build-up


def test_a_failed_run_has_a_row_with_its_reason() -> None:
    run = planned_runs(CONFIG, Picked())[0]
    row = result_row(run, InputError(["first", "second"]))
    assert row["status"] == "first; second"
    assert row["mu"] is None
    assert result_row(run, Limit(2.0, 1.0, 0.7, 9.0))["status"] == "ok"  # type: ignore[arg-type]


def test_settings_of_the_call_win_over_those_of_the_config() -> None:
    config = load_config({"simulation": {"method": "steady", "elements": 40, "steps_per_run": 99}})
    assert simulation_settings(config).method == "steady"
    assert simulation_settings(config, "transient", 20).method == "transient"
    assert simulation_settings(config, None, 20).elements == 20
    assert simulation_settings(config).elements == 40
    assert simulation_settings(config).steps == 99


def test_recordings_of_all_runs_stand_one_after_the_other() -> None:
    runs = planned_runs(CONFIG, Picked())[:2]
    columns = recording_columns(runs, [Limit(3.0, 2.0), Limit(5.0, 4.0)], CONFIG)  # type: ignore[list-item]
    half = len(columns["run"]) // 2
    assert set(columns["run"][:half]) == {"S001"}
    assert columns["tension_tight_N"][half - 1] == 3.0
    assert columns["tension_slack_N"][-1] == 4.0
    assert np.isnan(columns["temperature_degC"]).all()
    assert np.all(np.diff(columns["time_s"][:half]) > 0)

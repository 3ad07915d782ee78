"""Runs of the simulated campaign, and the recording of a run of which only the limit is known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import pytest

from beltid.config import load_config
from beltid.identify.friction.reduction import reduce_runs
from beltid.stages.campaign import recording_columns, simulation_settings
from beltid.stages.planned_runs import Picked, planned_runs
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


def test_the_sliding_limit_survives_the_reduction_exactly() -> None:
    # ln(T_tight/T_slack) = mu beta with mu = 0.7: closed form of Eq. (6)
    runs = planned_runs(CONFIG, Picked())
    limits = [Limit(300.0, 300.0 / math.exp(0.7 * math.radians(run.arc_deg))) for run in runs]
    config = load_config()
    columns = recording_columns(runs, limits, config)  # type: ignore[arg-type]
    assert tuple(columns) == schemas.table("simulated").names
    reduced = reduce_runs(columns, config.rig.pulley_radius_m)
    assert [r.run for r in reduced] == [run.label for run in runs]
    for run, r in zip(runs, reduced, strict=True):
        assert r.status == "ok"
        # the model takes 2e-5 of a tension for noise
        assert r.mu_sliding == pytest.approx(0.7, rel=2e-5)
        assert r.initial_tension_N == pytest.approx(run.initial_tension_N, rel=1e-12)
        assert r.pulley_speed_rad_s == pytest.approx(run.pulley_speed_rad_s, rel=1e-12)
        assert math.isnan(r.mu_sticking)  # a limit has no build-up


def test_settings_of_the_call_win_over_those_of_the_config() -> None:
    config = load_config({"simulation": {"method": "steady", "elements": 40}})
    assert simulation_settings(config).method == "steady"
    assert simulation_settings(config, "transient", 20).method == "transient"
    assert simulation_settings(config, None, 20).elements == 20
    assert simulation_settings(config).elements == 40


@pytest.mark.parametrize(
    ("section", "given"),
    [
        ({}, "none"),
        ({"kind": "torque"}, "none"),
        ({"kind": "torque", "holds": "weight_slack"}, "slack"),
        ({"kind": "dead_weight", "holds": "weight_tight"}, "tight"),
        ({"kind": "dead_weight", "holds": "weight_slack"}, "slack"),
        ({"kind": "torque_hub"}, "hub"),
        ({"kind": "torque_hub", "holds": "stretch"}, "none"),
        ({"kind": "running"}, "none"),
    ],
)
def test_each_kind_of_rig_has_its_given_force(section: dict[str, str], given: str) -> None:
    assert load_config({"rig": section}).rig_params().given_force == given

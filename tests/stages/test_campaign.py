"""Runs of the simulated campaign, and the recording of a run of which only the limit is known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import pytest

from beltid.config import load_config
from beltid.drive.rod import RodPulley, pulley_map
from beltid.errors import InputError
from beltid.identify.friction.reduction import reduce_runs
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt
from beltid.stages.simulation.campaign import recording_columns, simulation_settings
from beltid.stages.simulation.planned_runs import Picked, PlannedRun, as_resting, planned_runs
from beltid.stages.simulation.simulated_runs import simulate_rig
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


def test_a_running_rig_is_one_at_rest_with_effective_tensions() -> None:
    """Against the rod level of a belt drive, which knows mass flow: a pulley in full slip."""
    mu, v_b, slip, R = FrictionSurface.constant(0.5), 10.0, 0.1, 0.05
    belt, law = Belt(1.0e5, 0.02, 0.10), NormalLaw(6.5e7, 3.0256e11)
    pulley = RodPulley(belt, law, mu, R, math.radians(82), 0.10, 200.0)
    running = pulley_map(pulley, v_b, 200.0, W=(v_b * (1.0 + 200.0 / belt.EA) + slip) / R / v_b)
    momentum = belt.rhoA * v_b**2
    config = load_config({"rig": {"kind": "running", "belt_speed_m_s": v_b}})
    run = simulate_rig(
        config,
        mu,
        law,
        arc_deg=82.0,
        initial_tension_N=0.5 * (running.P_in + running.P_out) + momentum,
        pulley_speed_rad_s=(v_b + slip) / R,
        method="steady",
        elements=120,
    )
    assert run.tension_tight_N == pytest.approx(running.P_in, rel=2e-4)
    assert run.tension_slack_N == pytest.approx(running.P_out, rel=2e-4)
    # with the whole tensions the ratio would be another one
    whole = math.log((running.P_in + momentum) / (running.P_out + momentum))
    assert abs(whole / math.log(running.P_in / running.P_out) - 1) > 0.04


def test_a_running_rig_needs_the_speed_of_its_belt_and_something_left_to_slide() -> None:
    run = PlannedRun("S001", 82.0, 9.0, 200.0)
    with pytest.raises(InputError, match=r"rig\.belt_speed_m_s is not set"):
        as_resting(load_config({"rig": {"kind": "running"}}), [run])
    config = load_config({"rig": {"kind": "running", "belt_speed_m_s": 10.0}})
    with pytest.raises(InputError) as caught:
        as_resting(config, [run])
    assert len(caught.value.problems) == 2
    assert "must be above 10 N, the momentum part of the running belt" in caught.value.problems[0]
    assert "200 rad/s, must differ from that of the belt" in caught.value.problems[1]


@pytest.mark.parametrize(
    ("section", "given"),
    [
        ({}, "none"),
        ({"kind": "torque"}, "none"),
        ({"kind": "dead_weight", "weight_on": "tight"}, "tight"),
        ({"kind": "dead_weight", "weight_on": "slack"}, "slack"),
        ({"kind": "torque_hub"}, "hub"),
        ({"kind": "torque_hub", "slide": "held"}, "none"),
        ({"kind": "running"}, "hub"),
    ],
)
def test_each_kind_of_rig_has_its_given_force(section: dict[str, str], given: str) -> None:
    assert load_config({"rig": section}).rig_params().given_force == given

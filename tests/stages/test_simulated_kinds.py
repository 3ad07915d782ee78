"""Virtual benches of every kind, simulated with the forces that are given there, and back again."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest

import beltid
from beltid.config import Config, load_config
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.stages.rig import (
    bench_of,
    planned_runs,
    recording_columns,
    simulate,
    simulation_settings,
)
from beltid.stages.workers import Workers

R = 0.05
LAW = NormalLaw(6.5e7, 3.0256e11)
LONG = pytest.mark.long
KINDS: dict[str, dict[str, Any]] = {
    "weight on the tight side": {"holds": "weight_tight"},
    "weight on the slack side": {"holds": "weight_slack"},
    "torque": {},
    "torque and hub force": {"holds": "hub_force"},
}
FEW = ((82.0,), (70.0, 300.0), (0.42,))


def true_mu(f: np.ndarray, v: np.ndarray | float) -> np.ndarray:
    """A surface that is no power law."""
    return (0.55 + 0.5 / (1.0 + (f / 2500.0) ** 0.7)) * (1.0 + 0.08 * np.log(v / 0.01))


FORCE, SPEED = np.geomspace(5.0, 9e4, 90), np.geomspace(1e-4, 0.3, 30)
TRUTH = FrictionSurface(FORCE, SPEED, true_mu(FORCE[:, None], SPEED[None, :]))


@functools.cache
def config_of(kind: str) -> Config:
    settings = {
        "arcs_deg": [40, 82],
        "initial_tensions_N": [70, 130, 200, 300],
        "pulley_speeds_rad_s": [0.1, 0.42],
    }
    return load_config({"rig": {**settings, **KINDS[kind]}})


@functools.cache
def simulated(kind: str, picked: Any = FEW) -> dict[str, np.ndarray]:
    """The recording of a bench of that kind, in time, with the columns of rig.csv."""
    config = config_of(kind)
    runs, settings = planned_runs(config, None, picked), simulation_settings(config, "transient")
    campaign = simulate(bench_of(config, TRUTH, LAW), runs, settings, Workers())
    assert not campaign.failures
    return recording_columns(campaign.finished, config)


def as_measured(kind: str, noise_N: float, picked: Any = FEW) -> dict[str, np.ndarray]:
    """What the channels of the bench show of it, each with white noise."""
    columns = dict(simulated(kind, picked))
    tight, slack = columns.pop("tension_tight_N"), columns.pop("tension_slack_N")
    rng = np.random.default_rng(7)

    def noise() -> np.ndarray:
        return noise_N * rng.standard_normal(tight.size)

    if kind == "weight on the tight side":
        return columns | {
            "weight_N": columns["initial_tension_N"],
            "tension_slack_N": slack + noise(),
        }
    if kind == "weight on the slack side":
        return columns | {
            "weight_N": columns["initial_tension_N"],
            "tension_tight_N": tight + noise(),
        }
    columns["torque_N_m"] = R * (tight - slack + noise())
    if kind == "torque":
        return columns | {"tension_slack_N": slack + noise()}
    # the resultant of both spans, which bending turns: EI = 0.02 N m², L = 0.1 m
    angle = np.radians(columns["arc_deg"]) + 0.02 / (2 * R * 0.1) * (1 / tight + 1 / slack)
    square = tight**2 + slack**2 - 2.0 * tight * slack * np.cos(angle)
    return columns | {"hub_force_N": np.sqrt(square) + noise()}


@pytest.mark.parametrize(
    "kind", ["torque and hub force", *(pytest.param(kind, marks=LONG) for kind in [*KINDS][:3])]
)
def test_the_refined_surface_of_a_virtual_bench_is_the_true_one(kind: str) -> None:
    friction = beltid.fit_friction(as_measured(kind, 0.2, ()), config_of(kind))
    outcome = beltid.refine_surface(friction, LAW, config_of(kind))
    # a weight that swings: EI / (2 R W L) over the arc, 4.1 % at 40° with 70 N
    assert any("4.1 %" in note for note in outcome.notes) == ("weight" in kind)
    published = beltid.build_surface(friction, config_of(kind)).result.surface
    force = friction.columns["normal_force_N_m"]
    f, v = np.geomspace(force.min(), force.max(), 40)[:, None], R * np.array([0.1, 0.42])

    def rms(surface: FrictionSurface) -> float:
        return float(np.sqrt(np.mean(np.square(surface.mu(f, v) / true_mu(f, v) - 1.0))))

    assert rms(outcome.result.surface) < 0.005
    assert rms(published) > 0.02  # what the bending does to Eqs. (6) and (8)


@pytest.mark.parametrize("kind", ["weight on the slack side", "torque"])
def test_a_simulated_bench_agrees_with_itself(kind: str) -> None:
    """The simulated recording, which has no cell beside a weight, goes through the reduction."""
    friction = beltid.fit_friction(as_measured(kind, 0.0), config_of(kind))
    result = beltid.compare(friction, simulated(kind), config_of(kind)).result
    assert result.share_compared == 1.0
    assert np.max(np.abs(result.relative_difference)) < 1e-5


def test_runs_whose_tension_nobody_wrote_down_are_simulated_at_the_one_they_had() -> None:
    kind, open_lists = "torque and hub force", load_config({})
    columns = as_measured(kind, 0.2)
    del columns["initial_tension_N"]
    friction = beltid.fit_friction(columns, open_lists)
    assert np.isnan(friction.columns["nominal_tension_N"]).all()
    table = beltid.simulate_campaign(open_lists, TRUTH, LAW, method="steady", friction=friction)
    # of noise of 0.2 N in 100 samples at rest a tenth of a newton is left
    assert table["initial_tension_N"].to_numpy() == pytest.approx([70.0, 300.0], abs=0.3)
    result = beltid.compare(friction, table, open_lists).result
    assert result.share_compared == 1.0
    assert np.max(np.abs(result.relative_difference)) < 0.005

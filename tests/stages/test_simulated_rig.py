"""The simulated rig of every kind of bench, through the reduction of the bench, and back again."""

import functools
import math
from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from golden.test_chain import true_mu as friction_of

import beltid
from beltid.config import Config, load_config
from beltid.errors import ConvergenceError, InputError
from beltid.identify.friction.reduction import reduce_records
from beltid.identify.friction.run import run_records
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.stages import rig as rig_stage
from beltid.stages.inputs import press_law
from beltid.stages.rig import (
    PlannedRun,
    bench_of,
    finished,
    planned_runs,
    recording_columns,
    simulate,
    simulation_settings,
)
from beltid.stages.surface import prepared_campaign
from beltid.stages.workers import Workers
from beltid.tables import schemas

R = 0.05
LAW = NormalLaw(6.5e7, 3.0256e11)
LONG = pytest.mark.long
KINDS: dict[str, dict[str, Any]] = {
    "weight on the tight side": {"holds": "weight_tight"},
    "weight on the slack side": {"holds": "weight_slack"},
    "torque": {},
    "torque and hub force": {"holds": "hub_force"},
}
FEW, ALL = ((82.0,), (70.0, 300.0), (0.42,)), ((), (), ())


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
    results = finished(simulate(bench_of(config, TRUTH, LAW), runs, settings, Workers()))
    assert len(results) == len(runs)
    return recording_columns(results.items(), config)


def as_measured(kind: str, noise_N: float, picked: Any = FEW) -> dict[str, np.ndarray]:
    """What the channels of the bench show of it, each with white noise."""
    columns = dict(simulated(kind, picked))
    tight, slack = columns.pop("tension_tight_N"), columns.pop("tension_slack_N")
    rng = np.random.default_rng(7)

    def noisy(values: np.ndarray) -> np.ndarray:
        return values + noise_N * rng.standard_normal(tight.size)

    weight = columns["initial_tension_N"]
    if kind == "weight on the tight side":
        return columns | {"weight_N": weight, "tension_slack_N": noisy(slack)}
    if kind == "weight on the slack side":
        return columns | {"weight_N": weight, "tension_tight_N": noisy(tight)}
    columns["torque_N_m"] = R * noisy(tight - slack)
    if kind == "torque":
        return columns | {"tension_slack_N": noisy(slack)}
    # the resultant of both spans, which bending turns: EI = 0.02 N m², L = 0.1 m
    angle = np.radians(columns["arc_deg"]) + 0.02 / (2 * R * 0.1) * (1 / tight + 1 / slack)
    square = tight**2 + slack**2 - 2.0 * tight * slack * np.cos(angle)
    return columns | {"hub_force_N": noisy(np.sqrt(square))}


@pytest.mark.parametrize(
    "kind", ["torque and hub force", *(pytest.param(kind, marks=LONG) for kind in [*KINDS][:3])]
)
def test_the_refined_surface_of_a_virtual_bench_is_the_true_one(kind: str) -> None:
    friction = beltid.fit_friction(as_measured(kind, 0.2, ALL), config_of(kind))
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


def test_a_simulated_bench_agrees_with_itself() -> None:
    """The simulated recording, which has no cell beside a weight, goes through the reduction."""
    kind = "weight on the slack side"
    friction = beltid.fit_friction(as_measured(kind, 0.0), config_of(kind))
    result = beltid.compare(friction, simulated(kind), config_of(kind)).result
    assert len(result.columns["run"]) == result.n_usable
    assert np.max(np.abs(result.columns["relative_difference"])) < 1e-5


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
    assert len(result.columns["run"]) == result.n_usable
    assert np.max(np.abs(result.columns["relative_difference"])) < 0.005


@pytest.mark.parametrize(
    "belt",
    [
        ((5.6e7, 2.20e11), (0.8e5, 0.016, 0.08)),
        pytest.param(((6.5e7, 3.0256e11), (1.0e5, 0.02, 0.10)), marks=LONG),
    ],
)
def test_the_level_of_every_run_is_that_on_which_it_settles(belt: Any) -> None:
    law, section = belt  # of two belts of the virtual bench, rigdata/README.md
    keys = ("axial_stiffness_N", "bending_stiffness_N_m2", "mass_per_length_kg_m")
    config = {"belt": dict(zip(keys, section, strict=True))}
    f, v = np.geomspace(100.0, 3e4, 25), np.geomspace(2e-3, 0.05, 15)
    surface, parts, settled = FrictionSurface(f, v, friction_of("4pk", f[:, None], v)), [], []
    for k, (arc, tension, speed) in enumerate(product((40, 82), (40, 340), (0.05, 0.84))):
        run = {"arc_deg": arc, "initial_tension_N": tension, "pulley_speed_rad_s": speed}
        one = beltid.simulate_rig(config, surface, NormalLaw(*law), method="transient", **run)
        parts.append(one.recording.assign(run=str(k)))
        last = one.recording.iloc[-1]
        settled.append(np.log(last.tension_tight_N / last.tension_slack_N) / np.radians(arc))
    columns = pd.concat(parts)
    records = run_records({name: columns[name].to_numpy() for name in columns}, R)
    runs = reduce_records(records, R)
    assert {run.status for run in runs} == {"ok"}
    off = np.array([run.mu_sliding for run in runs]) / settled - 1.0
    assert np.sqrt(np.mean(off**2)) < 6e-5
    assert np.abs(off).max() < 3e-4


def test_runs_are_in_their_places_and_go_on_without_one_that_fails() -> None:
    at = [(40.0, 200.0, 0.2), (82.0, 1e-3, 0.2), (82.0, 200.0, 0.2), (40.0, 200.0, 0.5)]
    runs = [PlannedRun(str(i), *settings) for i, settings in enumerate(at)]
    config = config_of("torque")
    bench, steady = bench_of(config, TRUTH, LAW), simulation_settings(config, "steady")
    results = dict(simulate(bench, runs, steady, Workers()))
    assert list(results) == runs
    assert isinstance(results.pop(runs[1]), ConvergenceError)
    for run, result in finished(results).items():
        alone = finished(simulate(bench, [run], steady, Workers()))[run]
        assert result.mu == pytest.approx(alone.mu, rel=1e-8)


def test_the_sliding_limit_survives_the_reduction_exactly() -> None:
    # ln(T_tight/T_slack) = mu beta with mu = 0.7: closed form of Eq. (6)
    config = config_of("torque")
    runs = planned_runs(config)
    slack = [310.0 / math.exp(0.7 * math.radians(run.arc_deg)) for run in runs]
    limits: list[Any] = [
        SimpleNamespace(tension_tight_N=310.0, tension_slack_N=T, recording=None) for T in slack
    ]
    columns = recording_columns(zip(runs, limits, strict=True), config)
    assert tuple(columns) == schemas.table("simulated").names
    reduced = reduce_records(run_records(columns, R), R)
    assert [r.run for r in reduced] == [run.label for run in runs]
    for run, r in zip(runs, reduced, strict=True):
        assert r.status == "ok"
        # the model takes 2e-5 of a tension for noise; 2.7 mm do not exclude a tail (2.4e-4 stated)
        assert abs(r.mu_sliding - 0.7) < min(0.25 * r.mu_sliding_se, 0.7 * 5e-5)
        assert r.initial_tension_N == pytest.approx(run.initial_tension_N, rel=1e-12)
        assert r.pulley_speed_rad_s == pytest.approx(run.pulley_speed_rad_s, rel=1e-12)
        assert math.isnan(r.mu_sticking)  # a limit has no build-up


def test_a_speed_of_two_runs_that_share_no_force_is_kept() -> None:
    v = np.array([*np.repeat([0.0025, 0.0105], 4), 0.005, 0.005])
    f = np.array([*np.tile([1000.0, 2000.0, 4000.0, 8000.0], 2), 1100.0, 7000.0])
    columns = {
        "run": np.array([f"R{k}" for k in range(10)], dtype=object),
        "arc_deg": np.array([*np.full(8, 82.0), 68.0, 82.0]),
        "initial_tension_N": f * 0.05,
        "pulley_speed_rad_s": v / 0.05,
        "slip_speed_m_s": v,
        "normal_force_N_m": f,
        "mu_sliding": 0.9 * (f / 5000.0) ** -0.18,
        "mu_sliding_se": np.full(10, 0.003),
    }
    config = load_config({})
    press = press_law(LAW, config)
    campaign, speeds, used, set_aside = prepared_campaign(columns, press, config, {})
    np.testing.assert_allclose(speeds, [0.0025, 0.005, 0.0105])
    assert used.size == campaign.measured.mu.size == 10
    assert set_aside == []
    # runs measured with a torque are not taken for those of two cells
    with pytest.raises(InputError, match="torque_with"):
        prepared_campaign({**columns, "torque_with": np.full(10, "tight")}, press, config, {})


def test_look_ups_outside_the_measured_range_are_counted() -> None:
    narrow = FrictionSurface([4000.0, 8000.0], [0.004, 0.01], [[0.5, 0.5], [0.5, 0.5]])
    config = config_of("torque")

    def counts(speed: float) -> tuple[int, int]:
        picked = (82.0,), (300.0,), (speed,)
        facts = rig_stage.simulated(narrow, LAW, None, config, picked, "steady", Workers()).facts
        return facts["clamped_lookups"], facts["lookups"]

    slow, fast = (counts(speed) for speed in (0.1, 0.42))
    assert 0 < slow[0] < slow[1]
    assert 0 < fast[0] == fast[1]

"""The inverse problem on benches with dead weights, torque and hub force."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from truth_bench import SPEEDS, R, bench_and_runs, errors, true_mu

import beltid
from beltid.errors import InputError
from beltid.identify.surface.surface import build_surface
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, GivenForce, OperatingPoint, Rig
from beltid.refine.inverse import refine_surface
from beltid.rig.model import Bench
from beltid.rig.runs import SimulationSettings, simulate
from beltid.uncertainty.campaign import Campaign
from beltid.uncertainty.measured import measured_runs
from beltid.uncertainty.press_law import PressLaw


def campaign(bench: Bench, rows: np.ndarray) -> Campaign:
    """Reduced runs of a bench: arc [deg], tension at rest, speed, both tensions, by Eqs. (6), (8).

    The published procedure gives the surface to start from.
    """
    arc_deg, T_0, v, tight, slack = rows.T
    log_ratio = np.log(tight / slack)
    mu, f = log_ratio / np.radians(arc_deg), (tight - slack) / (R * log_ratio)
    columns = {
        "arc_deg": arc_deg,
        "initial_tension_N": T_0,
        "slip_speed_m_s": v,
        "mu_sliding": mu,
        "mu_sliding_se": 1e-4 * mu,
        "normal_force_N_m": f,
    }
    given = bench.rig.given_force
    measured = measured_runs(columns, np.arange(mu.size), R, given_force=given)
    start = build_surface(arc_deg, f, v, mu, 1e-4 * mu).surface
    press = PressLaw(bench.law, np.zeros((2, 2)), 1.2e-4, 0.04)
    return Campaign(measured, replace(bench, surface=start), press)


@pytest.mark.parametrize(
    "given", ["hub", *(pytest.param(span, marks=pytest.mark.long) for span in ("tight", "slack"))]
)
def test_sliding_states_of_another_model_give_its_surface(given: GivenForce) -> None:
    """The truth of the synthetic bench, its tensions as if one, or their sum, had been given."""
    bench, runs, f = bench_and_runs("5pk")
    rows = []
    for run, force in zip(runs, f, strict=True):
        beta, log_ratio = run.point.beta, run.mu * run.point.beta
        slack = force * R * log_ratio / math.expm1(log_ratio)
        v = run.point.omega * R
        # the tension at rest is not needed where a force is given
        rows.append((math.degrees(beta), np.nan, v, slack * math.exp(log_ratio), slack))
    bench = replace(bench, rig=replace(bench.rig, given_force=given))
    of = campaign(bench, np.array(rows))
    rms, worst = errors("5pk", refine_surface(of.bench, of.runs, SPEEDS).surface, runs, f)
    assert rms < 0.002
    assert worst < 0.005


def simulated_runs(bench: Bench, T_rest: tuple[float, ...]) -> np.ndarray:
    """Runs of a simulated bench on a mesh of its own, for :func:`campaign`."""
    rows = []
    for arc_deg in (40.0, 82.0):
        for T in T_rest:
            for omega in (0.1, 0.42):
                point = OperatingPoint(math.radians(arc_deg), T, omega)
                run = simulate(bench, point, SimulationSettings("steady", elements=120))
                tensions = run.tension_tight_N, run.tension_slack_N
                rows.append((arc_deg, T, omega * R, *tensions))
    return np.array(rows)


GRID_F, GRID_V = np.geomspace(20.0, 6e4, 80), np.array([0.005, 0.021])
T_REST = (70.0, 130.0, 200.0, 300.0)


def virtual_bench(given: GivenForce) -> Bench:
    """A bench of the 5PK belt with the surface of the truth, and some force given."""
    bench, _, _ = bench_and_runs("5pk")
    truth = np.array([true_mu("5pk", GRID_F, v) for v in GRID_V]).T
    return replace(
        bench,
        belt=Belt(1.0e5, 0.02, 0.10),
        rig=Rig(R, 0.10, given_force=given),
        contact=Contact(),
        surface=FrictionSurface(GRID_F, GRID_V, truth),
    )


def rms_error(surface: FrictionSurface, force: np.ndarray) -> float:
    """Error over the forces of some runs."""
    force = np.geomspace(force.min(), force.max(), 40)
    off = [surface.mu(force, v) / true_mu("5pk", force, v) - 1 for v in GRID_V]
    return float(np.sqrt(np.mean(np.square(off))))


@pytest.mark.parametrize(("given", "wrong"), [("slack", 0.03), ("hub", 0.01)])
def test_only_the_right_boundary_recovers_the_surface(given: GivenForce, wrong: float) -> None:
    """Runs simulated with a weight or a hub force; then refined with it, and as if held."""
    bench = virtual_bench(given)
    rows = simulated_runs(bench, T_REST)

    def error(with_force: GivenForce) -> float:
        other = replace(bench, rig=replace(bench.rig, given_force=with_force))
        of = campaign(other, rows)
        surface = refine_surface(of.bench, of.runs, GRID_V).surface
        return rms_error(surface, of.measured.normal_force)

    assert error(given) < 0.002
    assert error("none") > wrong


def test_a_table_without_tensions_at_rest_gives_the_surface() -> None:
    arc_deg, _, v, tight, slack = simulated_runs(virtual_bench("hub"), T_REST).T
    # bending (0.02 N m²) turns the ends of the spans (0.10 m): they enclose more than the arc
    turned = 0.02 / (2.0 * R * 0.10) * (1.0 / tight + 1.0 / slack)
    angle = np.radians(arc_deg) + turned
    table = {
        "run": np.array([f"P{k}" for k in range(v.size)], dtype=object),
        "arc_deg": arc_deg,
        "pulley_speed_rad_s": v / R,
        "mu_se": np.full(v.size, 1e-4),
        "torque_N_m": (tight - slack) * R,
        "hub_force_N": np.sqrt(tight**2 + slack**2 - 2.0 * tight * slack * np.cos(angle)),
    }
    belt = {"axial_stiffness_N": 1.0e5, "bending_stiffness_N_m2": 0.02}
    rig = {"kind": "torque_hub", "pulley_radius_m": R, "span_length_m": 0.10}
    config = {"belt": belt, "rig": rig}
    friction = beltid.fit_friction(table, config, table=True)
    found = beltid.refine_surface(friction, NormalLaw(6.5e7, 3.0256e11), config)
    assert rms_error(found.result.surface, friction.columns["normal_force_N_m"]) < 0.005


def test_a_table_says_which_span_was_measured_with_its_torque() -> None:
    table = {
        "run": np.array(["A", "B"], dtype=object),
        "arc_deg": np.full(2, 60.0),
        "pulley_speed_rad_s": np.full(2, 0.1),
        "torque_N_m": np.array([3.0, 6.0]),
        "tension_tight_N": np.array([120.0, 240.0]),
    }
    # stated is the slack span, as it is where nobody states it
    friction = beltid.fit_friction(table, {"rig": {"kind": "torque"}}, table=True)
    assert list(friction.columns["torque_with"]) == ["tight", "tight"]
    del table["torque_N_m"]
    table["tension_slack_N"] = np.array([60.0, 120.0])
    assert "torque_with" not in beltid.fit_friction(table, table=True).columns


def test_runs_that_cannot_be_used_say_why() -> None:
    table = {
        "run": np.array(["A", "B", "C", "D"], dtype=object),
        "arc_deg": np.array([60.0, 60.0, 90.0, 90.0]),
        "pulley_speed_rad_s": np.full(4, 0.1),
        "tension_tight_N": np.array([120.0, 230.0, 180.0, 340.0]),
        "tension_slack_N": np.array([60.0, 120.0, 60.0, 120.0]),
        "initial_tension_N": np.array([80.0, np.nan, 100.0, np.nan]),
    }
    friction = beltid.fit_friction(table, table=True)
    with pytest.raises(InputError, match=r"2 runs can be used.*initial_tension_N is not known"):
        beltid.refine_surface(friction, NormalLaw(6.5e7, 3.0256e11))

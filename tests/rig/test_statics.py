"""Full sliding: closed forms, identities, given forces, and failures that say what failed."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rig_bench import LAW_5PK, at, bench, slid, surface_5pk
from scipy.optimize import brentq

from beltid.errors import ConvergenceError, InputError, NumericsError
from beltid.laws.capstan import friction_coefficient
from beltid.laws.penalty import NormalLaw
from beltid.rig.mesh import touchdown
from beltid.rig.runs import RunResult, SimulationSettings, runs_of_one_belt, simulate

STEADY = SimulationSettings(method="steady")
STIFF = NormalLaw(1e9)
HOPELESS = at(82, 1e-3)  # a stiff belt needs some newtons to lie on the pulley at all


@pytest.mark.parametrize("EI", [0.002, 0.02])
def test_the_belt_touches_down_where_the_closed_form_says(EI: float) -> None:
    """A linear bed, laid on without friction; the form neglects the change of geometry."""
    rig, point = bench(EI), at()
    model, laid, _ = slid(rig, point, 200)
    offset, layer, slope = touchdown(rig.belt, rig.rig, rig.law, point.T_0)
    first = np.flatnonzero(laid.touching.ravel())[0]
    phi = laid.now["theta"].ravel()[first] + 0.5 * point.beta
    assert rig.rig.R * phi == pytest.approx(offset, abs=0.1 * layer)
    depth = rig.rig.R - laid.now["rho"].ravel()[first + 1 : first + 4]
    s = np.cumsum(np.full(3, float(model.system.mesh.w_c.ravel()[first])))
    assert np.polyfit(s, depth, 1)[0] == pytest.approx(slope, rel=0.35)


@pytest.mark.parametrize("arc", [40.0, 180.0])
@pytest.mark.parametrize("given", ["none", "tight", "slack", "hub"])
def test_a_string_on_a_stiff_pulley_obeys_euler_eytelwein(given: str, arc: float) -> None:
    """T_tight = T_slack exp(mu beta), but for penetration and bending, 2e-4 of the radius."""
    mu, W = 0.4, 270.0
    rig = bench(1e-5, EA=1e6, law=STIFF, mu=mu, given_force=given)
    _, _, state = slid(rig, at(arc, W))
    ratio = math.exp(mu * math.radians(arc))
    assert pytest.approx(ratio, rel=1e-3) == state.T_A / state.T_B
    of = {"tight": state.T_A, "slack": state.T_B, "hub": 0.5 * (state.T_A + state.T_B)}
    assert of.get(given, W) == pytest.approx(W, rel=1e-8)


@pytest.mark.parametrize("given", ["tight", "slack", "hub"])
def test_a_given_force_is_the_held_rig_that_ends_at_it(given: str) -> None:
    """Another initial tension of the held rig gives the same end, wherever the ends have moved."""
    rig, W = bench(law=LAW_5PK), 270.0
    _, _, state = slid(replace(rig, rig=replace(rig.rig, given_force=given)), at(82, W))

    def held(T_0: float) -> tuple[float, float]:
        _, _, s = slid(rig, at(82, T_0))
        return s.T_A, s.T_B

    pick: Any = {"tight": lambda a, b: a, "slack": lambda a, b: b, "hub": lambda a, b: (a + b) / 2}
    T_0 = brentq(lambda T: pick[given](*held(T)) - W, 0.5 * W, 2 * W, xtol=1e-3)
    assert pytest.approx(held(T_0), rel=2e-3) == (state.T_A, state.T_B)


def test_supports_balance_the_contact_forces() -> None:
    model, _, state = slid(bench(law=LAW_5PK), at(), 16)
    points = state.now[state.touching]
    n = np.stack([np.sin(points["theta"]), np.cos(points["theta"])])
    t = np.stack([n[1], -n[0]])
    contact = (points["F_N"] * n + points["F_T"] * t).sum(axis=1)
    supports = state.force[:2] + state.force[2:]
    np.testing.assert_allclose(contact, -supports, atol=1e-6 * state.T_A)
    moment = np.sum(points["rho"] * points["F_T"])
    x, y = state.q[[0, -4]], state.q[[1, -3]]
    of_supports = np.sum(x * state.force[1::2] - y * state.force[::2])
    assert moment == pytest.approx(of_supports, rel=1e-6)
    assert pytest.approx(moment, rel=0.02) == model.path.R * (state.T_A - state.T_B)


def test_the_profile_shows_the_peaks_where_the_belt_enters_and_leaves() -> None:
    """First row of the reference table: 9695 N/m at the peak, 5308 N/m in the mean, 65.8 mm."""
    rig = bench(law=LAW_5PK)
    run = simulate(rig, at(), STEADY)
    profile = run.profile
    assert profile["normal_force_N_m"].max() == pytest.approx(9695, rel=5e-3)
    assert run.normal_force_N_m == pytest.approx(5308, rel=0.05)
    first, last = profile["arc_position_m"][[0, -1]]
    assert last - first == pytest.approx(0.0658, abs=8e-4)
    apart = first, math.radians(82) * 0.05 - last
    free = [touchdown(rig.belt, rig.rig, rig.law, T)[0] for T in (371.1, 182.0)]
    assert apart == pytest.approx(free, abs=4e-4)
    assert profile["tension_N"][[0, -1]] == pytest.approx([371.1, 182.0], rel=0.02)
    assert not profile["sticks"].any()
    np.testing.assert_allclose(profile["slip_speed_m_s"], 0.21 * 0.05)


def test_friction_is_looked_up_at_the_force_and_the_speed_of_the_point() -> None:
    surface = surface_5pk()
    _, _, state = slid(bench(law=LAW_5PK, mu=surface), at())
    points = state.now[state.touching]
    expected = surface.mu(points["f_N"], 0.21 * 0.05) * points["F_N"]
    np.testing.assert_allclose(points["F_T"], expected, rtol=1e-9)


def test_a_static_failure_names_the_run_its_iterations_and_residual() -> None:
    said = r"arc 82 deg, T0 0\.001 N, omega.* in [1-9]\d* Newton iterations \(residual [1-9]"
    with pytest.raises(ConvergenceError, match=said):
        simulate(bench(law=LAW_5PK), HOPELESS)


def test_what_is_meaningless_is_refused() -> None:
    hung = bench(law=LAW_5PK, mu=1.8, given_force="slack")
    with pytest.raises(NumericsError, match=r"stretches the belt by more than 20\s?%"):
        simulate(hung, at(160, 300), STEADY)
    with pytest.raises(NumericsError, match="sinks"):
        simulate(bench(law=NormalLaw(5e5)), at(), STEADY)
    with pytest.raises(InputError, match="20 %"):
        bench().model(at(T_0=3e4))
    with pytest.raises(InputError, match="elements = 7, must be even"):
        SimulationSettings(elements=7)


def test_runs_of_a_belt_start_from_each_other_and_end_where_they_would_alone() -> None:
    points = [at(82, 270), at(82, 270, 0.5), at(82, 270, 0.05)]
    rig = bench(law=LAW_5PK, mu=surface_5pk())
    for point, run in zip(points, runs_of_one_belt(rig, points, STEADY), strict=True):
        assert isinstance(run, RunResult)
        alone = simulate(rig, point, STEADY)
        T_A, T_B = alone.tension_tight_N, alone.tension_slack_N
        assert (run.tension_tight_N, run.tension_slack_N) == pytest.approx((T_A, T_B), rel=1e-8)
        assert run.mu == pytest.approx(friction_coefficient(T_A, T_B, point.beta), rel=1e-8)
    failed = runs_of_one_belt(rig, [HOPELESS] * 2, STEADY)
    assert [type(error) for error in failed] == [ConvergenceError] * 2

"""Ends that give way: a dead weight on one span, or a force on the slide of the pulley."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from rig_bench import LAW_5PK, at, bench, sensitivity_of, true_surface_5pk
from scipy.optimize import brentq

from beltid.errors import InputError
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import GivenForce, OperatingPoint, Rig
from beltid.rigsim.beam.path import swinging_share
from beltid.rigsim.model import Bench
from beltid.rigsim.rig import SimulationSettings, simulate
from beltid.rigsim.steady import StaticState, lay_on, slide

KINDS = ("tight", "slack", "hub")
W = 270.0
STIFF = NormalLaw(1e9)


def with_given(rig: Bench, given: GivenForce) -> Bench:
    return replace(rig, rig=replace(rig.rig, given_force=given))


def sliding(rig: Bench, point: OperatingPoint, elements: int | None = None) -> StaticState:
    model = rig.model(point, elements)
    return slide(model, lay_on(model))


def given_part(given: GivenForce, state: StaticState) -> float:
    """The tension that is given: that of the weight's span, or the mean of both."""
    mean = 0.5 * (state.T_A + state.T_B)
    return {"tight": state.T_A, "slack": state.T_B, "hub": mean}[given]


@pytest.mark.parametrize("arc", [40.0, 180.0])
@pytest.mark.parametrize("given", KINDS)
def test_a_string_on_a_stiff_pulley_obeys_euler_eytelwein_with_the_force_given(
    given: GivenForce, arc: float
) -> None:
    """T_tight = T_slack exp(mu beta), but for penetration and bending, 2e-4 of the radius."""
    mu = 0.4
    state = sliding(with_given(bench(1e-5, EA=1e6, law=STIFF, mu=mu), given), at(arc, W))
    ratio = math.exp(mu * math.radians(arc))
    slack = {"tight": W / ratio, "slack": W, "hub": 2.0 * W / (1.0 + ratio)}[given]
    np.testing.assert_allclose([state.T_A, state.T_B], [ratio * slack, slack], rtol=1e-3)
    assert given_part(given, state) == pytest.approx(W, rel=1e-10)


@pytest.mark.parametrize(("span", "mu"), [(0.3, 0.9), (1.19, 0.85)])
def test_a_small_weight_holds_many_times_its_force(span: float, mu: float) -> None:
    """Euler-Eytelwein over 234 deg, some 35 to 1; bending takes EI/(R**2 T beta) of mu, 6e-4."""
    rig = bench(0.0015, R=0.09, span=span, law=LAW_5PK, mu=mu)
    state = sliding(with_given(rig, "slack"), at(234.0, 72.0, 2.0))
    assert pytest.approx(72.0, rel=1e-8) == state.T_B
    assert math.log(state.T_A / state.T_B) / math.radians(234.0) == pytest.approx(mu, rel=5e-3)


@pytest.mark.parametrize("given", KINDS)
def test_the_ends_move_by_the_elongation_of_the_belt(given: GivenForce) -> None:
    """Strain (T - T_0)/EA of spans and arc: the tension on the arc falls as exp(-mu phi)."""
    mu, EA, beta = 0.4, 1e5, math.radians(82)
    rig = with_given(bench(1e-5, EA=EA, law=NormalLaw(1e11), mu=mu), given)
    model = rig.model(at(82, W))
    laid = lay_on(model)
    state = slide(model, laid)
    T_A, T_B, R, L = state.T_A, state.T_B, rig.rig.R, rig.rig.span
    longer = (L * (T_A + T_B - 2 * W) + R * ((T_A - T_B) / mu - beta * W)) / (EA + W)
    moved = (state.q - laid.q).reshape(-1, 4)[[0, -1], :2]
    tangents = model.path.tangent(np.array([0.0, model.path.length]))
    if given == "hub":  # both ends as the pulley's centre sees them
        movement = longer / (2.0 * math.sin(beta / 2))
        expected = np.array([[0.0, -movement], [0.0, -movement]])
    elif given == "tight":
        expected = np.array([-longer * tangents[0], [0.0, 0.0]])
    else:
        expected = np.array([[0.0, 0.0], longer * tangents[1]])
    # but for squares of the strain, which is some thousandths
    np.testing.assert_allclose(moved, expected, rtol=0, atol=2e-3 * L * (T_A - T_B) / EA)


@pytest.mark.parametrize("supports", ["pinned", "clamped"])
@pytest.mark.parametrize("given", KINDS)
def test_it_is_the_held_rig_whose_tension_ends_at_that_force(
    given: GivenForce, supports: str
) -> None:
    rig = with_given(bench(law=LAW_5PK, mu=true_surface_5pk(), supports=supports), given)
    model = rig.model(at(82, W))
    state = slide(model, lay_on(model))
    assert given_part(given, state) == pytest.approx(W, rel=1e-10)
    # held where the ends have come to: the same state, exactly
    held = replace(
        model,
        system=model.system._replace(supports=model.system.supports._replace(give_way=False)),
    )
    again = slide(held, state)
    np.testing.assert_allclose(again.force, state.force, rtol=1e-10, atol=1e-7)
    # held where they were, with the initial tension that ends at that force: the ends are some
    # tenths of a millimetre off
    elements = model.nodes.size - 1

    def miss(T_0: float) -> float:
        return given_part(given, sliding(with_given(rig, "none"), at(82, T_0), elements)) - W

    T_0 = brentq(miss, 0.2 * W, 4.0 * W, xtol=1e-7)
    near = sliding(with_given(rig, "none"), at(82, T_0), elements)
    assert abs(T_0 / W - 1) > 0.01
    assert math.log(near.T_A / near.T_B) == pytest.approx(
        math.log(state.T_A / state.T_B), rel=1e-3 if given == "hub" else 1e-4
    )


@pytest.mark.parametrize(
    ("given", "solver", "elements"),
    [
        ("tight", "newton", None),
        ("slack", "newton", None),
        ("hub", "newton", None),
        ("hub", "lemke", 20),  # the reference solver needs a step for each point that slips
    ],
)
def test_a_run_in_time_ends_at_steady_sliding(
    given: GivenForce, solver: Literal["newton", "lemke"], elements: int | None
) -> None:
    rig = with_given(bench(law=LAW_5PK, mu=true_surface_5pk()), given)
    chosen = SimulationSettings(elements=elements, friction_solver=solver, steps=60)
    run = simulate(rig, at(82, W), chosen)
    state = sliding(rig, at(82, W), elements)
    assert run.tension_tight_N == pytest.approx(state.T_A, rel=1e-5)
    assert run.tension_slack_N == pytest.approx(state.T_B, rel=1e-5)
    # the force that is given is there all the time, at rest and while the belt starts to slide
    recording = run.recording
    assert recording is not None
    tight, slack = recording["tension_tight_N"], recording["tension_slack_N"]
    acting = {"tight": tight, "slack": slack, "hub": 0.5 * (tight + slack)}[given]
    np.testing.assert_allclose(acting, W, rtol=1e-8)
    assert np.ptp(tight - slack) > 0.5 * W


@pytest.mark.parametrize("supports", ["pinned", "clamped"])
@pytest.mark.parametrize("given", KINDS)
def test_sensitivities_are_differences_of_the_tensions(given: GivenForce, supports: str) -> None:
    surface = true_surface_5pk(40, 5)
    rig = with_given(bench(law=LAW_5PK, mu=surface, supports=supports), given)
    f, v = surface.normal_force_N_m, surface.slip_speed_m_s
    shape, step = np.log(f / 5400.0), 1e-4

    def shifted(sign: float) -> FrictionSurface:
        return FrictionSurface(f, v, surface.mu_nodes + sign * step * shape[:, None])

    settings = SimulationSettings("steady")
    found = sensitivity_of(rig, at(82, W))
    up, down = (simulate(replace(rig, surface=shifted(s)), at(82, W), settings) for s in (1, -1))
    force, speed = found.normal_force_N_m, 0.21 * 0.05
    change = (shifted(1).mu(force, speed) - shifted(-1).mu(force, speed)) / (2 * step)
    for name in ("tension_tight_N", "tension_slack_N"):
        by_difference = (getattr(up, name) - getattr(down, name)) / (2 * step)
        assert getattr(found, name) @ change == pytest.approx(by_difference, rel=2e-4, abs=1e-5)


@pytest.mark.parametrize(("arc", "weight"), [(82.0, 270.0), (82.0, 100.0), (40.0, 200.0)])
@pytest.mark.parametrize("given", ["tight", "slack"])
def test_a_weight_that_swings_freely_loses_the_angle_of_the_guided_end(
    given: GivenForce, arc: float, weight: float
) -> None:
    """Found by moving the end across its span until its force lies in the line of the span."""
    rig = with_given(bench(law=LAW_5PK, mu=true_surface_5pk()), given)
    model = rig.model(at(arc, weight))
    laid = lay_on(model)
    first, end = (0, 0) if given == "tight" else (-4, 1)
    along = model.system.supports.directions[end]
    across = np.array([-along[1], along[0]])

    def swung(offset: float) -> StaticState:
        q = laid.q.copy()
        q[[first, first + 1]] += offset * across
        return slide(model, replace(laid, q=q))

    offset = brentq(lambda x: swung(x).force.reshape(2, 2)[end] @ across, -0.01, 0.01, xtol=1e-8)
    free, guided = swung(offset), swung(0.0)
    lost = 1.0 - math.log(free.T_A / free.T_B) / math.log(guided.T_A / guided.T_B)
    found = swinging_share(rig.belt, rig.rig, model.point)
    assert found == pytest.approx(lost, rel=0.25)


def test_an_unknown_given_force_is_refused() -> None:
    with pytest.raises(InputError, match=r"rig\.given_force = 'left', must be 'none', 'tight'"):
        Rig(0.05, 0.1, given_force="left")  # type: ignore[arg-type]

"""The sliding limit: pressure T/R, rigid pulleys, balance of forces and moments, mesh, look-ups."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rig_bench import LAW_5PK, at, bench, true_surface_5pk
from scipy.optimize import brentq

from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Contact, OperatingPoint
from beltid.rigsim.beam.belt import belt_arrays
from beltid.rigsim.contact.points import Motion
from beltid.rigsim.model import Bench, RigModel
from beltid.rigsim.reference.step import assemble
from beltid.rigsim.rig import SimulationSettings, simulate
from beltid.rigsim.steady import StaticState, lay_on, slide
from beltid.rigsim.step import Kinematics

FIXED = settings(derandomize=True)


def steady(elements: int | None = None) -> SimulationSettings:
    return SimulationSettings("steady", elements)


@pytest.mark.parametrize("law", [LAW_5PK, NormalLaw(1e8)])
@pytest.mark.parametrize("T_0", [100.0, 450.0])
@pytest.mark.parametrize("EI", [5e-4, 1e-3])
def test_pressure_on_the_arc_is_tension_over_radius(law: NormalLaw, T_0: float, EI: float) -> None:
    """Without friction, away from the ends of the contact: f = N/rho per deformed length.

    A rod on a frictionless bed keeps N + N^2/(2 EA) + EI kappa^2/2 - V(delta) along its length; V
    is the energy of the bed. So f (R - delta) = N (1 + N/EA) is known in closed form.
    """
    EA, R = 1e5, 0.05
    laid = lay_on(bench(EI, law=law).model(at(82, T_0), 120))
    f = laid.points.f_N[laid.points.f_N > 0]
    middle = f[2 * f.size // 5 : 3 * f.size // 5]

    def pressure(delta: float) -> float:
        """Pressure of the belt's tension with the arc at a penetration, by the first integral."""
        k1, k2 = law.k_linear_N_m2, law.k_quadratic_N_m3
        V = k1 * delta**2 / 2 + k2 * delta**3 / 3
        eps = T_0 / EA
        for _ in range(50):
            kappa = (1 + eps) / (R - delta)
            head = T_0 + T_0**2 / (2 * EA) + V - EI * kappa**2 / 2
            eps = math.sqrt(1 + 2 * head / EA) - 1
        return EA * eps * (1 + eps) / (R - delta)

    delta = brentq(lambda d: pressure(d) - float(law.force(d)), 0.0, 1e-3, xtol=1e-16)
    np.testing.assert_allclose(middle, float(law.force(delta)), rtol=2e-5)
    # which is T/R but for the penetration and the bending
    assert pressure(0.0) * R == pytest.approx(T_0, rel=EI / (T_0 * R**2) + 1.01 * T_0 / EA)


def rigid_pulley_log_ratio(
    T_A: float, T_B: float, rig: Bench, point: OperatingPoint, mu: float
) -> float:
    """ln(T_A/T_B) of an inextensible belt with bending stiffness on a rigid pulley.

    The relation that docs/theory.md derives: the span leaves the pulley with the curvature 1/R, at
    the angle psi to its own force; the end force T sin(psi) carries friction too; the supports stay
    in place, so that the longer arms R + EI/(2 R T) add to the contact arc.
    """
    R, L, EI = rig.rig.R, rig.rig.span, rig.belt.EI
    D = math.hypot(R, L)
    contact_arc, psi = point.beta, []
    for T in (T_A, T_B):
        psi.append(math.acos(1 - EI / (2 * T * R * R)))
        arm = R + EI / (2 * R * T)
        contact_arc += math.acos(R / D) - math.acos(arm / D) - psi[-1]
    phi = math.atan(mu)
    return mu * contact_arc + math.log(math.cos(phi - psi[1]) / math.cos(phi + psi[0]))


@pytest.mark.parametrize(
    ("arc", "mu", "R", "span", "EI", "digits"),
    [
        (82, 0.5, 0.05, 0.10, 0.02, 3e-6),
        (40, 1.5, 0.08, 0.20, 0.02, 5e-6),
        (150, 1.0, 0.03, 0.20, 0.005, 1e-5),
    ],
)
def test_stiff_contact_tends_to_the_bending_corrected_euler_eytelwein_relation(
    arc: float, mu: float, R: float, span: float, EI: float, digits: float
) -> None:
    """An inextensible belt (EA 1e7: EI/(EA R^2) < 3e-6) on pulleys of growing stiffness."""
    stiffness = np.array([1e8, 1e9, 1e10, 1e11])
    errors = []
    for k in stiffness:
        rig = bench(EI, EA=1e7, R=R, span=span, law=NormalLaw(k), mu=mu)
        run = simulate(rig, at(arc, 270), steady())
        T_A, T_B = run.tension_tight_N, run.tension_slack_N
        exact = rigid_pulley_log_ratio(T_A, T_B, rig, at(arc, 270), mu)
        errors.append(abs(math.log(T_A / T_B) / exact - 1))
    rate = -np.polyfit(np.log(stiffness), np.log(errors), 1)[0]
    assert 0.7 < rate < 1.1
    assert errors[-1] < 2 * digits
    # equation (6) alone is far off: the relation is what makes the difference
    assert abs(math.log(T_A / T_B) / (mu * math.radians(arc)) - 1) > 1e2 * errors[-1]


def test_apparent_friction_tends_to_the_given_one_without_bending_and_with_stiff_contact() -> None:
    """First order in EI and 1/k together, as the relations of docs/theory.md say."""
    mu = 0.5
    factor = 2.0 ** np.arange(3, 6)
    errors = []
    for j in factor:
        run = simulate(bench(4e-3 / j, law=NormalLaw(2e8 * j), mu=mu), at(), steady(200))
        errors.append(abs(run.mu / mu - 1))
    assert 0.85 < -np.polyfit(np.log(factor), np.log(errors), 1)[0] < 1.1
    assert errors[-1] < 5e-5


@pytest.mark.parametrize("EI", [1e-7, 1e-5])
@pytest.mark.parametrize("k", [1e8, 1e9])
def test_a_string_obeys_euler_eytelwein_on_the_default_mesh(EI: float, k: float) -> None:
    """No bending: T_A/T_B = exp(mu beta) but for the penetration, a thousandth of the radius."""
    for T_0 in (50, 450):
        run = simulate(bench(EI, law=NormalLaw(k)), at(82, T_0), steady())
        depth = T_0 / 0.05 / k
        assert run.mu == pytest.approx(0.5, rel=0.6 * depth / 0.05 + 1e-4)


@FIXED
@given(
    st.floats(25, 170),
    st.floats(60, 450),
    st.floats(0.2, 1.0),
    st.integers(6, 30),
    st.booleans(),
)
def test_supports_balance_the_contact_forces_on_any_mesh(
    arc: float, T_0: float, mu: float, half: int, on_surface: bool
) -> None:
    """Both force components, and the moment about the pulley's centre, where friction acts alone.

    Internal forces have no resultant, so this holds on any mesh, to the tolerance of the steps.
    """
    rig = bench(law=LAW_5PK, mu=true_surface_5pk(30, 12) if on_surface else mu)
    model = rig.model(at(arc, T_0), 2 * half)
    laid = lay_on(model)
    state = slide(model, laid)
    ends = state.q.reshape(-1, 4)[[0, -1], :2]
    work = model.workspace()
    motion = Motion(omega=0.21, rate=0.0, friction=1.0, augmentation=0.0)
    trial = Kinematics(state.q, state.q, state.q, state.q)
    assemble(model.system, motion, state.points, trial, state.stretch, work)
    support = work.reactions.force.reshape(2, 2)  # what the supports exert on the belt
    points = state.points
    normal = np.stack([np.sin(points.theta), np.cos(points.theta)], axis=-1)
    along = np.stack([np.cos(points.theta), -np.sin(points.theta)], axis=-1)
    # every part also exerts its couple, as a force P kappa along t and P n on the gradient: its
    # resultant is in the moment only through the forces below, and vanishes about the centre
    push = points.F_N[..., None] * normal + points.F_T[..., None] * along
    moment = np.sum(ends[:, 0] * support[:, 1] - ends[:, 1] * support[:, 0])
    assert moment == pytest.approx(np.sum(points.rho * points.F_T), rel=1e-7)
    # forces: the couples leave P kappa t, of the order of a part's couple over the radius
    resultant = support.sum(axis=0) + push.sum(axis=(0, 1))
    assert np.abs(resultant).max() < 0.01 * T_0
    assert math.hypot(*support[0]) == pytest.approx(state.T_A, rel=1e-9)


def test_a_symmetric_belt_pulls_both_supports_alike() -> None:
    for supports in ("pinned", "clamped"):
        laid = lay_on(bench(law=LAW_5PK, supports=supports).model(at(68, 220)))
        assert pytest.approx(220, rel=1e-8) == laid.T_A
        assert pytest.approx(220, rel=1e-8) == laid.T_B
        np.testing.assert_allclose(laid.points.f_N, laid.points.f_N[::-1, ::-1], rtol=1e-6)


@pytest.mark.parametrize("C_P", [0.0, 300.0, 3000.0])
def test_the_sliding_state_does_not_depend_on_the_normal_damping(C_P: float) -> None:
    rig = bench(law=LAW_5PK, mu=true_surface_5pk(), contact=Contact(C_P=C_P))
    still = simulate(rig, at(), steady())
    moving = simulate(rig, at())
    # ten times the paper's damping still lets the last of the build-up relax at the run's end
    assert moving.mu == pytest.approx(still.mu, rel=2e-4 if C_P > 300 else 2e-5)


@pytest.mark.parametrize("arc", [40, 82, 170])
@pytest.mark.parametrize(("T_0", "omega"), [(50.0, 0.05), (270.0, 0.21), (450.0, 2.0)])
def test_plateau_in_time_is_the_steady_solution(arc: float, T_0: float, omega: float) -> None:
    rig = bench(law=LAW_5PK, mu=true_surface_5pk())
    still = simulate(rig, at(arc, T_0, omega), steady())
    moving = simulate(rig, at(arc, T_0, omega))
    assert moving.tension_tight_N == pytest.approx(still.tension_tight_N, rel=1e-3)
    assert moving.tension_slack_N == pytest.approx(still.tension_slack_N, rel=1e-3)
    assert moving.mu == pytest.approx(still.mu, rel=1e-3)


@pytest.mark.parametrize("supports", ["pinned", "clamped"])
@pytest.mark.parametrize("constant", [True, False])
def test_default_mesh_is_as_good_as_a_fine_one(supports: str, constant: bool) -> None:
    """Arcs, radii, bending stiffnesses and tensions far from those of the bench data."""
    mu = 0.8 if constant else true_surface_5pk()
    for arc in (25, 82, 170):
        for EI in (0.004, 0.03):
            for R in (0.03, 0.08):
                for T_0 in (50, 450):
                    rig = bench(EI, R=R, law=LAW_5PK, mu=mu, supports=supports)
                    coarse = simulate(rig, at(arc, T_0), steady())
                    fine = simulate(rig, at(arc, T_0), steady(4 * coarse.record.elements))
                    assert coarse.tension_tight_N == pytest.approx(fine.tension_tight_N, rel=2e-3)
                    assert coarse.tension_slack_N == pytest.approx(fine.tension_slack_N, rel=2e-3)


@pytest.mark.parametrize("mu", [0.5, 1.0])
def test_graded_mesh_is_as_accurate_as_a_uniform_one_of_more_elements(mu: float) -> None:
    """In the mean: better than twice the elements by far, as good as three times."""
    errors = []
    for arc in (40, 68, 82, 120):
        for T_0 in (100.0, 150.0, 270.0, 450.0):
            rig, point = bench(law=LAW_5PK, mu=mu), at(arc, T_0)
            exact = slide(fine := rig.model(point, 240), lay_on(fine))
            graded = rig.model(point)
            models = [graded, *(with_uniform_mesh(graded, rig, times) for times in (2, 3))]
            states = [slide(model, lay_on(model)) for model in models]
            errors.append([(error_of_mu(s, exact), error_of_tensions(s, exact)) for s in states])
    of_mu, of_tensions = np.exp(np.mean(np.log(errors), axis=0)).T
    assert of_mu[0] < of_mu[2]
    assert of_tensions[0] < 0.6 * of_tensions[1]
    assert of_tensions[0] < 1.2 * of_tensions[2]


def with_uniform_mesh(model: RigModel, rig: Bench, times: int) -> RigModel:
    """The same rig on elements of one length, ``times`` as many."""
    nodes = np.linspace(0.0, model.path.length, times * (model.nodes.size - 1) + 1)
    return replace(
        model, nodes=nodes, system=model.system._replace(belt=belt_arrays(rig.belt, nodes, 5))
    )


def error_of_mu(state: StaticState, exact: StaticState) -> float:
    return abs(math.log(state.T_A / state.T_B) / math.log(exact.T_A / exact.T_B) - 1)


def error_of_tensions(state: StaticState, exact: StaticState) -> float:
    return math.hypot(state.T_A / exact.T_A - 1, state.T_B / exact.T_B - 1)


@pytest.mark.parametrize(
    ("rig", "arc", "T_0"),
    [
        (
            bench(0.041, EA=8.1e4, R=0.013, span=0.07, law=NormalLaw(1.9e10, 4.4e15), mu=0.89),
            79,
            1814,
        ),
        (bench(2.4, EA=6.6e4, R=0.187, span=0.309, law=NormalLaw(1.5e7, 3.1e9), mu=1.05), 70, 454),
    ],
)
def test_very_fine_meshes_are_solved(rig: Bench, arc: float, T_0: float) -> None:
    """Where tangents turn far in the first iterations, and where bending is lost in rounding."""
    coarse = simulate(rig, at(arc, T_0), steady())
    fine = simulate(rig, at(arc, T_0), steady(400))
    assert coarse.tension_tight_N == pytest.approx(fine.tension_tight_N, rel=1e-3)
    assert coarse.tension_slack_N == pytest.approx(fine.tension_slack_N, rel=1e-3)


def test_look_ups_outside_the_measured_range_are_counted() -> None:
    wide = true_surface_5pk()
    v = 0.21 * 0.05
    narrow = FrictionSurface([4000.0, 5500.0], [0.5 * v, 2 * v], [[0.95, 1.0], [0.9, 0.95]])
    slow = FrictionSurface([1.0, 6.0e4], [0.2 * v, 0.5 * v], [[0.95, 1.0], [0.9, 0.95]])
    # the slowest runs of a campaign scatter about the node that is their mean
    edge = FrictionSurface([1.0, 6.0e4], [1.002 * v, 4.0 * v], [[0.95, 1.0], [0.9, 0.95]])
    for settings_ in (steady(), SimulationSettings()):
        run = simulate(bench(law=LAW_5PK, mu=wide), at(), settings_)
        assert run.record.clamped_lookups == 0
        assert run.record.lookups == run.profile["normal_force_N_m"].size
        run = simulate(bench(law=LAW_5PK, mu=narrow), at(), settings_)
        f = np.asarray(run.profile["normal_force_N_m"], dtype=float)
        outside = np.count_nonzero((f < 4000) | (f > 5500))
        assert 0 < run.record.clamped_lookups < run.record.lookups
        # a part that touches in part is looked up at the force where it touches, not at its mean
        assert abs(run.record.clamped_lookups - outside) <= 4
        run = simulate(bench(law=LAW_5PK, mu=slow), at(), settings_)
        assert run.record.clamped_lookups == run.record.lookups
        assert simulate(bench(law=LAW_5PK, mu=edge), at(), settings_).record.clamped_lookups == 0
    constant = simulate(bench(law=LAW_5PK, mu=0.5), at(), steady())
    assert constant.record.clamped_lookups == 0


def test_steady_belt_rests_and_every_point_slides() -> None:
    model = bench(law=LAW_5PK).model(at())
    laid = lay_on(model)
    sliding = slide(model, laid)
    touches = sliding.points.F_N > 0
    np.testing.assert_allclose(
        sliding.points.F_T[touches], 0.5 * sliding.points.F_N[touches], rtol=1e-12
    )
    assert sliding.stretch == laid.stretch
    assert sliding.residual < 1e-9


def test_states_found_in_one_room_are_those_found_in_rooms_of_their_own() -> None:
    """Runs of a rig share the arrays of the linearised system; a state keeps what is its own."""
    model = bench(law=LAW_5PK, mu=true_surface_5pk(30, 12)).model(at())
    slower = replace(model, point=at(omega=0.02))
    room = model.workspace()
    laid = lay_on(model, room)
    shared = [laid, slide(slower, laid, room), slide(model, laid, room)]
    own = [lay_on(model), slide(slower, laid), slide(model, laid)]
    for state, alone in zip(shared, own, strict=True):
        np.testing.assert_array_equal(state.q, alone.q)
        np.testing.assert_array_equal(state.force, alone.force)
        np.testing.assert_array_equal(state.points.F_N, alone.points.F_N)
        assert state.lookups == np.count_nonzero(alone.points.F_N > 0.0)
    assert abs(shared[1].T_A - shared[2].T_A) > 1.0  # other speeds, other states

"""Runs in time: published build-up, laws of friction, both solvers, convergence in the step."""

from typing import Any

import numpy as np
import pytest
from rig_bench import LAW_5PK, at, bench, slid, surface_5pk

from beltid.errors import ConvergenceError
from beltid.laws.friction_surface import FrictionSurface
from beltid.params import Contact
from beltid.rig import lcp
from beltid.rig.model import Bench
from beltid.rig.newton import STEP, march
from beltid.rig.runs import SimulationSettings, at_rest, make_schedule, run_transient, simulate

FALLING = FrictionSurface([1000.0, 20000.0], [0.001, 0.1], [[0.9, 0.3], [0.8, 0.27]])


def travelled(rig: Bench, travel: float, steps: int, omega: float = 0.05) -> tuple[Any, Any]:
    """Tensions (2, steps) of equal steps of travel from rest, and the share that sticks.

    In every step no force leaves its cone, and sticking points hardly move in their springs.
    """
    model, laid, _ = slid(rig, at(omega=omega))
    s, w = at_rest(model, laid), model.system.mesh.w_c
    record, sticking = np.zeros(steps, dtype=STEP), np.zeros(steps)
    record["dt"], record["omega"] = travel / steps / (rig.rig.R * omega), omega
    for k in range(steps):
        assert march(model.system, model.border, s, record[k : k + 1]) == 1
        touches, sticks, force = s.now["F_N"] > 0, s.now["sticks"], np.abs(s.now["F_T"])
        assert np.all((force <= (1 + 2e-9) * s.now["limit"])[touches])
        assert np.all((force < 1e-7 * model.system.pulley.k_t * w)[sticks])
        sticking[k] = w[sticks].sum() / w[touches].sum()
    return np.hypot(record["force"][:, ::2], record["force"][:, 1::2]).T, sticking


@pytest.mark.parametrize("omega", [0.005, 0.5])
def test_build_up_of_the_reference_model(omega: float) -> None:
    """Tensions over travel, with the share that sticks; 0.5 % of the rise, whatever the speed."""
    T, sticks = travelled(bench(damping_time=0.0, contact=Contact(C_P=0.0)), 150e-6, 60, omega)
    rise = 370.97 - 270.0
    table = ((20, 311.6, 230.4, 0.64), (40, 350.1, 197.8, 0.22), (60, 370.97, 181.94, 0.0))
    for k, tight, slack, sticking in table:
        inertia = 0.005 if omega < 0.1 else 0.02
        assert T[:, k - 1] == pytest.approx((tight, slack), abs=inertia * rise)
        assert sticks[k - 1] == pytest.approx(sticking, abs=0.03)


def test_more_friction_at_rest_gives_a_peak_above_the_same_plateau() -> None:
    runs = [
        simulate(bench(law=LAW_5PK, contact=Contact(sticking_ratio=ratio)), at(omega=0.02))
        for ratio in (1.0, 1.5)
    ]
    peaks = [run.recording["tension_tight_N"].max() for run in runs if run.recording]
    assert runs[0].mu == pytest.approx(runs[1].mu, rel=1e-6)
    assert peaks[1] > 1.003 * runs[1].tension_tight_N
    assert peaks[0] == pytest.approx(runs[0].tension_tight_N, rel=1e-4)


def test_steps_converge_with_the_first_power_of_the_time_step() -> None:
    """Quasi-static: the mean tension over the build-up against that of 320 steps."""
    rig = bench(law=LAW_5PK, damping_time=0.0, contact=Contact(C_P=0.0))

    def half_way(steps: int) -> float:
        return float(travelled(rig, 80e-6, steps, 0.005)[0][0, -1])

    fine = half_way(320)
    errors = [abs(half_way(steps) - fine) for steps in (10, 40)]
    assert errors[1] < 0.35 * errors[0] + 1e-3


def test_a_belt_at_rest_does_not_creep_and_slides_back_and_forth_alike() -> None:
    """A tenth of the travel, then rest: the tensions stay. Then the pulley turns either way."""
    model, laid, sliding = slid(bench(law=LAW_5PK), at())
    record = np.zeros(180, dtype=STEP)
    record["dt"] = np.repeat([2e-6, 4e-5, 1e-5], [10, 50, 120]) / (0.05 * 0.21)
    record["omega"] = np.repeat([0.21, 0.0, 0.21, -0.21, 0.21], [10, 50, 40, 40, 40])
    assert march(model.system, model.border, at_rest(model, laid), record) == 180
    T = np.hypot(record["force"][:, 0], record["force"][:, 1])
    assert T[59] == pytest.approx(T[40], rel=1e-5)
    assert T[59] > 1.02 * laid.T_A
    assert T[[99, 179]] == pytest.approx([sliding.T_A] * 2, rel=2e-4)
    assert T[139] == pytest.approx(sliding.T_B, rel=2e-4)


@pytest.mark.parametrize(
    "change",
    [
        {"contact": Contact(C_P=0.0)},
        {"contact": Contact(C_P=3000.0)},
        {"mu": FALLING},
        *({"given_force": given} for given in ("tight", "slack", "hub")),
    ],
)
def test_a_run_in_time_ends_at_steady_sliding(change: dict[str, Any]) -> None:
    """Whatever the damping and the boundary, and where mu falls with the speed."""
    rig = bench(**({"law": LAW_5PK, "mu": surface_5pk()} | change))
    run, steady = simulate(rig, at()), simulate(rig, at(), SimulationSettings("steady"))
    assert run.tension_tight_N == pytest.approx(steady.tension_tight_N, rel=1e-4)
    assert run.tension_slack_N == pytest.approx(steady.tension_slack_N, rel=1e-4)


def test_a_step_without_solution_names_the_moment() -> None:
    model, laid, sliding = slid(bench(law=LAW_5PK), at())

    with pytest.raises(ConvergenceError, match=r"the step at [\d.]+ s found no solution"):
        run_transient(model, laid, sliding, solver=lambda *_: (-1, 1.0))


GOLDEN = [(arc, T_0, law) for arc in (40, 68, 82) for T_0 in (120, 310) for law in (0, 1)]


@pytest.mark.parametrize(
    ("arc", "T_0", "law"),
    [
        case if case[:2] == (40, 120) else pytest.param(*case, marks=pytest.mark.long)
        for case in GOLDEN
    ],
)
def test_return_mapping_agrees_with_the_papers_complementarity_problem(
    arc: float, T_0: float, law: int
) -> None:
    """Ten elements of five points, the same steps: 0.1 % of the rise, plateau within 1e-6."""
    five = Contact(points_per_element=5)
    rig = bench(law=LAW_5PK, mu=0.5 if law else surface_5pk(), contact=five)
    model, laid, sliding = slid(rig, at(arc, T_0, 0.2), 10)
    exact = make_schedule(model, laid, sliding)
    given = exact.copy()
    s = at_rest(model, laid)
    assert march(model.system, model.border, s, exact, lcp.step_by_lemke) == 130
    parts = 2 ** exact["halvings"]  # a step that one solver cuts is cut for the other, too
    newton = np.repeat(given, parts)
    newton["dt"] /= np.repeat(parts, parts)
    s = at_rest(model, laid)
    assert march(model.system, model.border, s, newton) == newton.size
    found, force = newton["force"][np.cumsum(parts) - 1], exact["force"]
    T, T_exact = (np.hypot(f[:, ::2], f[:, 1::2]) for f in (found, force))
    assert np.abs(T - T_exact).max() < 1e-3 * (sliding.T_A - T_0)
    np.testing.assert_allclose(T[-1], T_exact[-1], rtol=1e-6)


@pytest.mark.parametrize("given", ["tight", "hub"])
def test_the_complementarity_problem_holds_a_given_force(given: str) -> None:
    rig = bench(law=LAW_5PK, given_force=given)
    settings = SimulationSettings(elements=10, friction_solver="lemke")
    steady = simulate(rig, at(40, 120), SimulationSettings("steady", elements=10))
    assert simulate(rig, at(40, 120), settings).mu == pytest.approx(steady.mu, rel=1e-5)


@pytest.mark.parametrize("seed", range(6))
def test_lemke_solves_what_has_a_solution(seed: int) -> None:
    """Positive definite and semi-definite problems: w, z >= 0 and z.w = 0."""
    rng = np.random.default_rng(seed)
    n = 8
    factor = rng.normal(size=(n, n if seed % 2 else 3))
    M = factor @ factor.T
    q = rng.normal(size=n) if seed % 2 else M @ rng.normal(size=n) + rng.random(n)
    z = lcp.lemke(M, q)
    w = M @ z + q
    assert z.min() >= 0.0
    assert w.min() > -1e-9
    assert abs(z @ w) < 1e-9


def test_a_problem_without_solution_is_refused() -> None:
    with pytest.raises(ConvergenceError, match="ray"):
        lcp.lemke(np.array([[0.0]]), np.array([-1.0]))


def test_one_contact_by_hand() -> None:
    """Compliance 2 m/N, free slip 1 m: sticks at F = 0.5 N below the limit, else slides."""
    G, free = np.array([[2.0]]), np.array([1.0])
    force, slip = lcp.friction_lcp(G, free, np.array([0.6]))
    assert (force[0], slip[0]) == pytest.approx((0.5, 0.0))
    force, slip = lcp.friction_lcp(G, free, np.array([0.2]))
    assert (force[0], slip[0]) == pytest.approx((0.2, 0.6))

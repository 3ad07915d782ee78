"""Time stepping: the certificate of every step, no creep, the peak, the slip front, the clock."""

from __future__ import annotations

import contextlib
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from rig_bench import LAW_5PK, March, at, bench, start, true_surface_5pk

from beltid.errors import ConvergenceError
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Contact, OperatingPoint
from beltid.rigsim.contact.friction import catch, let_go
from beltid.rigsim.contact.points import SLIDE, STICK, Patches
from beltid.rigsim.model import Bench
from beltid.rigsim.rig import SimulationSettings, simulate

Array = NDArray[np.float64]

SLIP_ALLOWED = 1e-13  # m
TRAVEL = 1e-6  # m per step


def turned(march: March, travel: float, omega: float = 0.21, steps: int = 50) -> None:
    """Turn the pulley by a travel of its surface."""
    assert march.go(travel / steps / (0.05 * omega), omega, steps) == steps


@settings(max_examples=12, deadline=None, derandomize=True)
@given(
    st.floats(30, 165),
    st.floats(60, 450),
    st.floats(-1.5, 0.5),
    st.floats(1.0, 1.3),
    st.booleans(),
)
def test_every_step_ends_with_its_certificate(
    arc: float, T_0: float, log_omega: float, ratio: float, on_surface: bool
) -> None:
    omega = 10.0**log_omega
    mu = true_surface_5pk(30, 12) if on_surface else 0.7
    march = start(
        bench(law=LAW_5PK, mu=mu, contact=Contact(sticking_ratio=ratio)), at(arc, T_0, omega)
    )
    assert march.go(2e-6 / (0.05 * omega), omega, 60) == 60
    record = march.record
    assert record["slip"].max() <= SLIP_ALLOWED
    assert record["cone"].max() <= 1e-9
    # 1e-9 of T_0, or the rounding: of forces 1e-13 EA R/h, of a slip held by the augmentation
    belt = march.model.system.belt
    h, EA = belt.h.min(), belt.EA * (1 + belt.damping_time * 0.05 * omega / 2e-6)
    assert record["residual"].max() <= max(1e-9, 0.05 * EA / h * (1e-13 + 300 * 2e-16) / T_0)
    # the state itself, not the record: sticking within the cone, sliding on its edge, both ways
    points = march.points
    touching = points.patches["limit"] > 0
    stuck = touching & (points.patches["status"] == STICK)
    slides = touching & ~stuck
    assert np.all(
        np.abs(points.patches["force"][stuck]) <= points.patches["limit"][stuck] * (1 + 1e-9)
    )
    np.testing.assert_allclose(
        np.abs(points.patches["force"][slides]), points.patches["limit"][slides], rtol=1e-12
    )
    assert np.all(points.patches["sign"][slides] * points.patches["slip"][slides] >= -SLIP_ALLOWED)
    np.testing.assert_allclose(
        points.F_T.sum(axis=1)[touching], points.patches["force"][touching], rtol=1e-9
    )


@pytest.mark.parametrize("on_surface", [False, True])
def test_a_belt_below_its_friction_limit_does_not_creep(on_surface: bool) -> None:
    """A partial turn, then the pulley held: after the swing of the spans nothing moves for 1 s."""
    mu = true_surface_5pk() if on_surface else 0.5
    march = start(bench(law=LAW_5PK, mu=mu), at())
    turned(march, 40e-6)
    assert march.record["sticking"][-1] > 0.3 * march.record["touching"][-1]
    turned_tension = march.T_A[-1]
    for dt, steps in ((1e-4, 100), (1e-3, 200)):  # 0.2 s of rest
        assert march.go(dt, 0.0, steps) == steps
    before, q = march.points.theta.copy(), march.state.q.copy()
    assert march.go(1e-2, 0.0, 100) == 100
    touches = march.points.F_N > 0
    assert np.abs(march.points.theta - before)[touches].max() * 0.05 < 1e-9
    assert np.abs(march.state.q - q).reshape(-1, 4)[:, :2].max() < 1e-9
    # and the belt holds a difference of tensions by friction alone
    assert march.T_A[-1] - march.T_B[-1] > 0.3 * (turned_tension - 270)
    assert march.record["slip"].max() <= SLIP_ALLOWED


def test_turning_back_and_forth_ends_where_it_slid_before() -> None:
    """Slip in both directions; full sliding forgets what was before."""
    march = start(bench(), at())
    turned(march, 300e-6)
    for _ in range(2):
        march.go(1e-2, 0.21, 40)
    ahead = march.T_A[-1], march.T_B[-1]
    march.go(1e-4, -0.21, 200)
    march.go(1e-2, -0.21, 40)
    assert march.T_B[-1] == pytest.approx(ahead[0], rel=1e-5)
    assert march.T_A[-1] == pytest.approx(ahead[1], rel=1e-5)


def apparent(march_T_A: np.ndarray, march_T_B: np.ndarray) -> np.ndarray:
    return np.asarray(np.log(march_T_A / march_T_B) / math.radians(82))


def test_more_friction_at_rest_gives_a_peak_above_the_same_plateau() -> None:
    peaks, plateaus = [], []
    for ratio in (1.0, 1.05, 1.2):
        # slow and without swinging, so that the peak is that of friction
        rig = bench(contact=Contact(sticking_ratio=ratio), damping_time=1e-3)
        run = simulate(rig, at(82, 270, 0.02))
        assert run.recording is not None
        mu = apparent(run.recording["tension_tight_N"], run.recording["tension_slack_N"])
        peaks.append(mu.max())
        plateaus.append(run.mu)
    np.testing.assert_allclose(plateaus, plateaus[0], rtol=1e-6)
    assert peaks[0] < plateaus[0] * 1.001
    assert peaks[1] > plateaus[0] * 1.001
    assert peaks[2] > peaks[1] + 0.001


def test_slip_front_moves_inward_from_both_ends() -> None:
    march = start(bench(mu=0.5), at(82, 270, 0.02), elements=80)
    steps = 160
    assert march.go(TRAVEL / (0.05 * 0.02), 0.02, steps, profiles=True) == steps
    assert np.all(np.diff(march.record["sticking"]) <= 1e-12)
    assert march.record["sticking"][0] > 0.8 * march.record["touching"][0]
    assert march.record["sticking"][-1] == 0.0
    entry, leave = -np.inf, np.inf
    for contact in march.profiles:
        touches, sticks = contact.line_force > 0, contact.sticks == 1.0
        angle = contact.angle
        stuck = angle[touches & sticks]
        if stuck.size == 0:
            continue
        # one zone of stick, slip on both sides of it, towards B everywhere
        inside = (angle > stuck.min()) & (angle < stuck.max()) & touches
        assert np.all(sticks[inside])
        assert np.any(touches & (angle < stuck.min())) or entry == -np.inf
        # a patch stands as long as it sticks: its points are carried on by the pulley only
        assert stuck.min() >= entry - 1e-12
        assert stuck.max() <= leave + 2 * TRAVEL / 0.05
        entry, leave = stuck.min(), stuck.max()
        # the law binds the mean slip of a patch; at the front one of its points may lag a little
        assert contact.slip_speed[touches & ~sticks].min() > -0.01 * 0.02 * 0.05


def test_sticking_points_are_carried_by_the_pulley() -> None:
    march = start(bench(), at(82, 270, 0.21))
    first = march.laid.points.theta.copy()
    turned(march, 30e-6)
    carried = (march.points.patches["status"] == STICK) & (march.points.patches["limit"] > 0)
    angle = np.mean((march.points.theta - first)[carried], axis=1)
    np.testing.assert_allclose(angle * 0.05, 30e-6, rtol=2e-3)


@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_the_augmentation_does_not_show_in_the_result(factor: float) -> None:
    tensions = []
    for augmentation in (1e2, factor * 1e2):
        march = start(bench(law=LAW_5PK), at(), augmentation=augmentation)
        turned(march, 80e-6, steps=80)
        tensions.append((march.T_A.copy(), march.T_B.copy()))
    np.testing.assert_allclose(tensions[0], tensions[1], rtol=1e-7)


def test_implicit_steps_converge_at_least_with_the_first_power_of_the_time_step() -> None:
    """A sudden fast start, waves and all: the tight tension after 60 um of travel."""
    values = []
    steps = np.array([20, 40, 80, 160, 320])
    for n in steps:
        march = start(bench(law=LAW_5PK), at(82, 270, 1.0))
        turned(march, 60e-6, 1.0, int(n))
        values.append(march.T_A[-1])
    changes = np.abs(np.diff(values))
    assert 0.9 < -np.polyfit(np.log(steps[1:]), np.log(changes), 1)[0] < 1.6
    assert changes[-1] < 1e-5 * values[-1]


@pytest.mark.parametrize(
    ("rig", "point"),
    [
        (
            bench(law=LAW_5PK, mu=true_surface_5pk(30, 12), contact=Contact(sticking_ratio=1.1)),
            at(68, 220),
        ),
        # soft, lightly loaded: the slips of the plateau's steps are large against the rounding
        (bench(1e-3, R=0.095, law=NormalLaw(5.3e5, 1.6e9), mu=0.59), at(17, 45, 0.2)),
        (bench(0.012, R=0.155, span=0.16, law=NormalLaw(2.7e6), mu=0.91), at(88, 425, 0.2)),
    ],
)
def test_newton_and_lemke_agree(rig: Bench, point: OperatingPoint) -> None:
    """The active set and the complementarity problem on the Delassus matrix, step by step."""
    runs = [
        simulate(rig, point, SimulationSettings(steps=60, friction_solver=solver))
        for solver in ("newton", "lemke")
    ]
    for column in ("tension_tight_N", "tension_slack_N"):
        newton, lemke = (run.recording[column] for run in runs if run.recording is not None)
        np.testing.assert_allclose(newton, lemke, rtol=1e-7)
    force = [np.asarray(run.profile["normal_force_N_m"], dtype=float) for run in runs]
    np.testing.assert_allclose(force[1], force[0], rtol=1e-5)
    assert runs[1].record.slip_m <= SLIP_ALLOWED
    assert runs[1].record.cone <= 1e-9


def test_a_step_of_the_reference_solver_is_cut_too() -> None:
    """Strong damping and friction at rest: a step in which many patches close has no end in one."""
    rig = bench(law=LAW_5PK, mu=true_surface_5pk(30, 12), contact=Contact(sticking_ratio=1.1))
    plan = SimulationSettings(steps=60, elements=26, friction_solver="lemke")
    run = simulate(rig, at(68, 220), plan)
    assert run.record.halvings >= 1
    assert run.record.slip_m <= SLIP_ALLOWED
    assert run.record.cone <= 1e-9


def test_a_recording_resolves_the_build_up() -> None:
    run = simulate(bench(law=LAW_5PK), at())
    record = run.recording
    assert record is not None
    time, speed = record["time_s"], record["pulley_speed_rad_s"]
    assert time[0] == 0.0
    assert np.all(np.diff(time) > 0)
    assert time.size >= 101
    # at rest first, with T_0 on both sides; then the pulley turns at its speed
    rest = speed == 0.0
    assert np.count_nonzero(rest) >= 3
    assert np.all(np.diff(rest.astype(int)) <= 0)
    np.testing.assert_allclose(record["tension_tight_N"][rest], 270, rtol=1e-7)
    np.testing.assert_allclose(speed[~rest], 0.21)
    # between rest and 95 % of the rise lie many samples
    rise = record["tension_tight_N"] - 270
    part = (rise > 0.02 * rise[-1]) & (rise < 0.95 * rise[-1])
    assert np.count_nonzero(part) >= 20
    assert record["tension_tight_N"][-1] == run.tension_tight_N


@pytest.mark.parametrize("steps", [52, 130, 400])
def test_the_plateau_does_not_depend_on_the_number_of_steps(steps: int) -> None:
    rig = bench(law=LAW_5PK, mu=true_surface_5pk())
    still = simulate(rig, at(), SimulationSettings("steady"))
    run = simulate(rig, at(), SimulationSettings(steps=steps))
    assert run.record.steps == steps
    assert run.mu == pytest.approx(still.mu, rel=1e-3)


FALLING = {
    "a little": 1.0 - 0.02 * np.arange(5),
    "much": 1.0 - 0.1 * np.arange(5),
    "noise of the nodes": np.array([1.0, 1.01, 0.99, 1.012, 0.995]),
}


@pytest.mark.parametrize("by_speed", FALLING.values(), ids=FALLING.keys())
@pytest.mark.parametrize("omega", [0.05, 0.21, 0.84])
def test_where_mu_falls_with_the_speed_the_plateau_is_the_steady_one(
    by_speed: Array, omega: float
) -> None:
    f = np.array([500.0, 2000.0, 4000.0, 8000.0, 12000.0])
    v = np.array([0.0025, 0.005, 0.0105, 0.021, 0.042])
    surface = FrictionSurface(f, v, np.outer(0.9 * (f / 5400) ** -0.15, by_speed))
    rig, run = bench(law=LAW_5PK, mu=surface), at(82, 270, omega)
    steady = simulate(rig, run, SimulationSettings("steady"))
    transient = simulate(rig, run)
    assert transient.mu == pytest.approx(steady.mu, rel=1e-3)
    # settled, not just passing by: the tensions of the last samples do not change
    last = transient.recording["tension_tight_N"][-10:]
    assert np.ptp(last) < 1e-3 * last.mean()


def test_a_plateau_that_does_not_settle_is_refused() -> None:
    # mu falls to a fifth of its value within a few speeds: the belt sticks and slips
    f, v = np.array([500.0, 12000.0]), np.array([0.0025, 0.005, 0.0105, 0.021, 0.042])
    steep = FrictionSurface(f, v, np.outer([1.2, 1.1], [1.0, 0.85, 0.5, 0.25, 0.2]))
    rig = bench(law=LAW_5PK, mu=steep)
    ends = []
    for omega in (0.1, 0.21, 0.42):
        run = at(82, 270, omega)
        steady = simulate(rig, run, SimulationSettings("steady"))
        with contextlib.suppress(ConvergenceError):
            ends.append(abs(simulate(rig, run).mu / steady.mu - 1.0))
    # never a wrong value without a word: 0.5 % in the tensions is 1 % of their ratio's logarithm
    assert max(ends, default=0.0) < 0.015
    assert len(ends) < 3


@pytest.mark.parametrize("elements", [10, 160])
def test_the_normal_damping_of_a_belt_does_not_depend_on_the_mesh(elements: int) -> None:
    """C_P belongs to a point of the default mesh; others carry the same damping per length."""
    rig = bench()
    default, other = rig.model(at()), rig.model(at(), elements)
    per_length = [
        model.system.pulley.C_P * model.system.belt.w_c.size for model in (default, other)
    ]
    assert per_length[1] == pytest.approx(per_length[0], rel=1e-12)
    assert default.system.pulley.C_P == rig.contact.C_P


def test_a_fine_mesh_reaches_the_plateau() -> None:
    fine = simulate(bench(), at(), SimulationSettings(elements=320))
    still = simulate(bench(), at(), SimulationSettings("steady", 320))
    assert fine.tension_tight_N == pytest.approx(still.tension_tight_N, rel=1e-5)


def test_a_resting_belt_slips_with_the_speed_of_the_pulleys_surface_in_both_methods() -> None:
    """Whatever the penetration, here 1 % of R: the speed is that of the surface, at the radius R.

    In time the belt still creeps to rest, by some 1e-4 of that speed.
    """
    for method in (SimulationSettings(), SimulationSettings("steady")):
        speed = simulate(bench(law=NormalLaw(1e7)), at(82, 270, 0.21), method).profile
        np.testing.assert_allclose(speed["slip_speed_m_s"], 0.21 * 0.05, rtol=1e-3)


@pytest.mark.parametrize("elements", [160, 640])
def test_a_finer_mesh_takes_no_more_iterations_for_its_slip_fronts(elements: int) -> None:
    """Several patches are swept in a step, and still found at once."""
    point = at(82.0, 250.0, 0.5)

    def iterations(n: int) -> int:
        plan = SimulationSettings(method="transient", elements=n, steps=52)
        return simulate(bench(), point, plan).record.newton_iterations

    assert iterations(elements) < 1.3 * iterations(20)


@pytest.mark.parametrize("half", [True, False])
@pytest.mark.parametrize(("begin", "end", "caught"), [(4, 8, (4, 6)), (12, 17, (14, 17))])
def test_half_of_what_slips_behind_a_front_is_caught(
    begin: int, end: int, caught: tuple[int, int], half: bool
) -> None:
    patches = chain_of_patches(20)
    patches["status"][4:17] = SLIDE
    first, last = caught if half else (begin, end)
    assert catch(patches, begin, end, half) == last - first
    sliding = np.zeros(20, dtype=bool)
    sliding[4:17] = True
    sliding[first:last] = False
    np.testing.assert_array_equal(patches["status"] == SLIDE, sliding)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_front_sweeps_the_patches_that_take_its_force(sign: float, mirrored: bool) -> None:
    """A force of 2.8 limits on the first of many patches that carry 0.6 of theirs.

    The first keeps one limit, each of the next takes 0.4 more: 1.8 need four whole ones.
    """
    patches = chain_of_patches(20)
    patches["la_T"][:] = 1.2 * sign
    patches["status"][:3] = SLIDE
    patches["la_T"][3] = 2.0 * (1.0 + 1.8) * sign
    if mirrored:
        patches["status"][:], patches["la_T"][:] = (
            patches["status"][::-1].copy(),
            patches["la_T"][::-1].copy(),
        )
    place = 16 if mirrored else 3
    assert let_go(patches, place, place + 1, True) == 1 + 4
    swept = slice(12, 17) if mirrored else slice(3, 8)
    assert np.all(patches["status"][swept] == SLIDE)
    assert np.all(patches["sign"][swept] == sign)
    assert np.count_nonzero(patches["status"] == SLIDE) == 3 + 5


def chain_of_patches(n: int) -> Patches:
    """Patches that touch and stick, each with a limit of 2 N."""
    march = start(bench(), at(), elements=n)
    march.points.patches["limit"][:] = 2.0
    march.points.patches["status"][:] = STICK
    return march.points.patches


@pytest.mark.parametrize(("T_0", "k", "omega"), [(26.0, 8.7e5, 0.2), (60.0, 1.5e6, 2.0)])
def test_a_soft_damped_contact_is_given_the_time_to_settle(
    T_0: float, k: float, omega: float
) -> None:
    """The damped contact gives way in C_P/(w k), 50 times slower than that of a firm belt."""
    rig = bench(EI=2e-3, R=0.04, law=NormalLaw(k), mu=0.8)
    point = at(140.0, T_0, omega)
    run = simulate(rig, point, SimulationSettings(method="transient"))
    steady = simulate(rig, point, SimulationSettings(method="steady"))
    assert run.tension_tight_N == pytest.approx(steady.tension_tight_N, rel=1e-4)
    assert run.tension_slack_N == pytest.approx(steady.tension_slack_N, rel=1e-4)

"""One pulley of a drive at rod level, against an independent program, closed forms and the rig."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flowing_rod import flowing_rod

from beltid.drive import rod
from beltid.drive.rod import RodPulley, RodState, pulley_map
from beltid.errors import ConvergenceError, InputError
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, OperatingPoint, Rig
from beltid.rigsim.contact.points import STICK, fields_of
from beltid.rigsim.model import Bench
from beltid.rigsim.steady import lay_on, slide

BELT = Belt(EA=1.0e5, EI=0.02, rhoA=0.1)
LAW_5PK = NormalLaw(6.5e7, 3.0256e11)
HALF = FrictionSurface.constant(0.5)


def pulley_of(R: float, elements: int | None = None, law: NormalLaw = LAW_5PK) -> RodPulley:
    return RodPulley(BELT, law, HALF, R, math.pi, 0.10, 300.0, elements=elements)


def synthetic_5pk() -> FrictionSurface:
    """Friction of the synthetic 5PK belt within the measured ranges; nearest value outside."""
    f, v = np.geomspace(500.0, 15000.0, 40), np.geomspace(0.0025, 0.042, 24)
    speed = 1 + 0.45 * (np.log1p(v / 0.0015) / np.log1p(0.01 / 0.0015) - 1)
    return FrictionSurface(f, v, 0.95 * (f / 5400.0)[:, None] ** -0.18 * speed)


# R [m], v0 [m/s], P_in, P_out [N]; omega/v0 [1/m] of a rod whose friction is smoothed over 1e-5 of
# the speed of the belt, and in the limit of none; torque [N m]. Both rods share nothing with this
# program: the first is discrete, the second that of flowing_rod, smoothed over 3e-7 to 3e-6
INDEPENDENT = [
    (0.05, 1.1, 400, 200, 20.1187, 20.118338, 9.98653),
    (0.05, 1.1, 200, 400, 20.0662, 20.066338, -9.98547),
    (0.05, 1.1, 300, 300, 20.0933, 20.092933, 0.0008),
    (0.05, 30.0, 400, 200, 20.1368, 20.136465, 9.98652),
    (0.0275, 1.1, 400, 200, 36.7172, 36.716497, 5.47941),
    (0.0275, 1.1, 200, 400, 36.5753, 36.575698, -5.47512),
    (0.02, 1.1, 400, 200, 50.69895, 50.698550, 3.97497),
    (0.02, 1.1, 200, 400, 50.43122, 50.431757, -3.96711),
]


def check(state: RodState, W: float, torque: float) -> None:
    """The strings' speeds of these rows are 8e-5 to 9e-4 away, so that the bending is seen."""
    np.testing.assert_allclose(state.W, W, rtol=5e-6)
    assert state.torque == pytest.approx(torque, abs=4e-4)
    assert state.residual < 1e-8
    assert state.certificate.slip <= 1e-11 * state.v0
    assert state.certificate.cone <= 1e-9


@pytest.mark.parametrize(("R", "v0", "P_in", "P_out", "smoothed", "W", "torque"), INDEPENDENT)
def test_speed_and_torque_of_an_independent_rod(R, v0, P_in, P_out, smoothed, W, torque) -> None:
    state = pulley_map(pulley_of(R), v0, P_in, P_out=P_out)
    check(state, W, torque)
    # the smoothing moves the speed by more than the mesh does
    np.testing.assert_allclose(state.W, smoothed, rtol=3e-5)


@pytest.mark.long
def test_the_independent_rod_comes_to_the_same_speed_as_its_friction_gets_sharp() -> None:
    speeds = {one.smooth: one.W for one in flowing_rod(0.05, 1.1, 400.0, 200.0)}
    assert speeds[1e-5] == pytest.approx(20.1187, rel=5e-6)
    sharp = pulley_map(pulley_of(0.05), 1.1, 400.0, P_out=200.0).W
    away = [abs(speeds[smooth] / sharp - 1.0) for smooth in (3e-5, 1e-5, 3e-6, 1e-6)]
    assert away == sorted(away, reverse=True)
    assert away[-1] < 5e-6


@pytest.mark.parametrize(
    ("P_in", "P_out", "W", "torque"),
    [(400, 200, 20.116602, 9.98639), (200, 400, 20.065115, -9.98534)],
)
def test_friction_that_depends_on_force_and_speed(P_in, P_out, W, torque) -> None:
    pulley = RodPulley(BELT, LAW_5PK, synthetic_5pk(), 0.05, math.pi, 0.10, 300.0, slow_trend=0.0)
    check(pulley_map(pulley, 1.1, P_in, P_out=P_out), W, torque)


@pytest.mark.parametrize(("R", "P_out"), [(0.05, 85.36), (0.0275, 91.13)])
def test_full_slip_leaves_the_force_of_an_independent_rod(R: float, P_out: float) -> None:
    pulley = pulley_of(R)
    once = pulley_map(pulley, 1.1, 400.0, W=1.01 / R)
    twice = pulley_map(pulley, 1.1, 400.0, W=2.0 / R)
    assert once.P_out == pytest.approx(P_out, abs=0.01)
    assert twice.P_out == pytest.approx(once.P_out, rel=1e-8)  # mu is constant
    touches = once.points.F_N > 0.0
    assert np.all(once.contact.slip_speed[touches] > 0.0)
    assert np.all(once.contact.sticks[touches] == 0.0)


def test_a_belt_that_hardly_runs_is_the_belt_of_the_rig() -> None:
    """The sliding limit of the rig on the same mesh: same shape, same forces."""
    point = OperatingPoint(math.radians(82.0), 270.0, 0.21)
    rig = Bench(BELT, Rig(0.05, 0.10), Contact(), LAW_5PK, synthetic_5pk()).model(point, 48)
    sliding = slide(rig, lay_on(rig))
    pulley = RodPulley(
        BELT, LAW_5PK, synthetic_5pk(), 0.05, point.beta, 0.10, point.T_0, elements=48
    )
    v0 = 1.0e-10  # against a sliding speed of 1e-2 m/s
    state = pulley_map(pulley, v0, sliding.T_A, W=point.omega / v0)
    assert state.P_out == pytest.approx(sliding.T_B, rel=1e-6)
    np.testing.assert_allclose(state.contact.q, sliding.q, atol=1e-8)


@pytest.mark.parametrize("v0", [1.1, 30.0])
@pytest.mark.parametrize(("P_in", "P_out"), [(400, 200), (200, 400), (300, 300)])
def test_the_power_of_the_shaft_is_that_of_friction_and_of_the_belt(v0, P_in, P_out) -> None:
    """First integral of the rod: shaft = friction + v0 times the change of P (1 + eps) - energy.

    Summed over the pulleys of a drive the belt's part vanishes: sum of M omega = friction power.
    """
    state = pulley_map(pulley_of(0.05), v0, P_in, P_out=P_out)

    def carried(P: float) -> float:
        momentum = BELT.rhoA * v0**2
        eps = (P + momentum) / (BELT.EA - momentum)
        kinetic = 0.5 * momentum * (1 + eps) ** 2
        return P * (1 + eps) - 0.5 * BELT.EA * eps**2 + kinetic

    shaft = state.torque * state.W * v0
    of_belt = v0 * (carried(state.P_in) - carried(state.P_out))
    assert state.friction_power > 0.0
    assert shaft - of_belt == pytest.approx(state.friction_power, rel=3e-3)


def test_an_idler_dissipates_because_the_ribs_have_to_seat() -> None:
    state = pulley_map(pulley_of(0.05), 1.1, 300.0, torque=0.0)
    assert state.torque == pytest.approx(0.0, abs=1e-7)
    assert state.friction_power > 0.0
    # no shaft drives it: the leaving span pulls harder
    assert state.friction_power == pytest.approx(1.1 * (state.P_out - state.P_in), rel=0.01)
    patches = fields_of(state.points.patches)
    first = np.flatnonzero(patches.limit > 0.0)[:3]
    assert np.all(patches.status[first] != STICK)
    assert np.all(patches.sign[first] > 0.0)  # both pulleys slip forward where the belt comes on


def test_torque_and_force_of_the_leaving_span_are_two_ways_to_one_state() -> None:
    pulley = pulley_of(0.05)
    by_force = pulley_map(pulley, 1.1, 400.0, P_out=200.0)
    by_torque = pulley_map(pulley, 1.1, 400.0, torque=by_force.torque)
    assert by_torque.P_out == pytest.approx(200.0, abs=1e-4)
    np.testing.assert_allclose(by_torque.W, by_force.W, rtol=1e-7)


def test_a_state_nearby_is_a_start_that_changes_nothing() -> None:
    pulley = pulley_of(0.05)
    nearby = pulley_map(pulley, 1.1, 400.0, P_out=210.0)
    warm = pulley_map(pulley, 1.1, 400.0, P_out=200.0, start=nearby)
    cold = pulley_map(pulley, 1.1, 400.0, P_out=200.0)
    assert warm.iterations < 0.5 * cold.iterations
    np.testing.assert_allclose(warm.W, cold.W, rtol=2e-6)


def test_more_than_friction_can_hold_is_reported() -> None:
    with pytest.raises(ConvergenceError, match=r"50 mm.*no steady running"):
        pulley_map(pulley_of(0.05, elements=48), 1.1, 400.0, P_out=60.0)


def test_spans_too_short_and_unclear_wishes_are_refused() -> None:
    with pytest.raises(InputError, match="six bending lengths"):
        RodPulley(BELT, LAW_5PK, HALF, 0.05, math.pi, 0.04, 300.0)
    with pytest.raises(InputError, match="exactly one"):
        pulley_map(pulley_of(0.05, elements=48), 1.1, 400.0, P_out=200.0, torque=3.0)


def test_the_momentum_of_the_belt_stretches_it_in_closed_form() -> None:
    """At the same effective forces 1 + eps = (EA + P)/(EA - m v0²), and W goes with it."""
    pulley = pulley_of(0.05)
    slow, fast = (pulley_map(pulley, v0, 400.0, P_out=200.0) for v0 in (1.0, 40.0))
    stiffness = [BELT.EA - BELT.rhoA * v0**2 for v0 in (1.0, 40.0)]
    # the ribs carry as much more per stress-free length, which is 1e-6 of the radius
    ratio = fast.W / slow.W
    assert ratio == pytest.approx(stiffness[0] / stiffness[1], rel=5e-6)


@pytest.mark.parametrize("R", [0.02, 0.05])
def test_a_mesh_four_times_finer_changes_the_loss_by_less_than_a_thousandth(
    monkeypatch, R: float
) -> None:
    losses = []
    for fineness in (1, 4):
        monkeypatch.setattr(rod, "AT_ENTRY", 8 * fineness)
        monkeypatch.setattr(rod, "ON_ARC", 2 * fineness)
        pulley = pulley_of(R)
        driver, driven = (
            pulley_map(pulley, 1.1, P_in, P_out=P_out) for P_in, P_out in ((400, 200), (200, 400))
        )
        losses.append(driver.W / driven.W - 1.0)
    assert losses[0] == pytest.approx(losses[1], rel=1e-3)

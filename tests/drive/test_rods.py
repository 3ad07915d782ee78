"""Rods: one pulley and whole drives against independent programs."""

import math
from dataclasses import replace

import numpy as np
import pytest
from drives import BELT_5PK, LAW_5PK, loss_of, simulate, true_surface, two_pulleys

from beltid.drive.model import Drive, DrivePoint, Pulley
from beltid.drive.results import DriveResult
from beltid.drive.simulator import Simulator, slip_limit
from beltid.errors import ConvergenceError, InputError
from beltid.laws.friction_surface import FrictionSurface
from beltid.rig.flow import FlowPulley, FlowState, flow

HALF, TRUE = FrictionSurface.constant(0.5), true_surface("5pk")


def dissipated(rod: FlowState, R: float) -> float:
    """What friction takes at the contact points."""
    return float(np.sum(rod.points["F_T"] * rod.points["slip"] * rod.points["rho"])) / R


def pulley_of(R: float, surface: FrictionSurface = HALF) -> FlowPulley:
    return FlowPulley(BELT_5PK, LAW_5PK, surface.tables(), R, math.pi, 0.10, 300.0)


@pytest.mark.parametrize(
    ("mu", "R", "v0", "P_in", "P_out", "W", "torque"),
    [
        # boundary-value problem of second order, friction smoothed over 3e-7 to 3e-6 of the speed;
        # forces as floats: the kernels would be compiled again for integers
        (HALF, 0.05, 1.1, 400.0, 200.0, 20.118338, 9.98653),
        (HALF, 0.05, 1.1, 200.0, 400.0, 20.066338, -9.98547),
        (HALF, 0.05, 1.1, 300.0, 300.0, 20.092933, 0.0008),
        (HALF, 0.05, 30.0, 400.0, 200.0, 20.136465, 9.98652),
        (HALF, 0.0275, 1.1, 400.0, 200.0, 36.716497, 5.47941),
        (HALF, 0.0275, 1.1, 200.0, 400.0, 36.575698, -5.47512),
        (HALF, 0.02, 1.1, 400.0, 200.0, 50.698550, 3.97497),
        (HALF, 0.02, 1.1, 200.0, 400.0, 50.431757, -3.96711),
        (TRUE, 0.05, 1.1, 400.0, 200.0, 20.116602, 9.98639),
        (TRUE, 0.05, 1.1, 200.0, 400.0, 20.065115, -9.98534),
    ],
)
def test_speed_and_torque_of_an_independent_rod(
    mu: FrictionSurface, R: float, v0: float, P_in: float, P_out: float, W: float, torque: float
) -> None:
    """T6, and a pulley of 20 mm; the strings' speeds of these rows are 8e-5 to 9e-4 away.

    On 20 mm the contact points on the few degrees where the ribs seat scatter: -7e-6 to 2.3e-5 for
    168 to 504 elements.
    """
    state = flow(pulley_of(R, mu), v0, P_in, T_out=P_out)
    np.testing.assert_allclose(state.W, W, rtol=5e-6 if R > 0.02 else 3e-5)
    assert state.torque == pytest.approx(torque, abs=4e-4)
    assert pytest.approx((P_in, P_out), rel=1e-8) == (state.s.T_A, state.s.T_B)
    # the pulley gives what the belt takes along and what friction takes
    along = v0 * (P_in - P_out) * (1.0 + 0.5 * (P_in + P_out) / 1e5)
    given = state.torque * state.W * v0
    assert given - dissipated(state, R) == pytest.approx(along, rel=5e-3, abs=0.02)


def test_a_start_that_does_not_help_leaves_no_trace() -> None:
    """From a belt off the pulley there is no way: the search begins anew, from the belt at rest."""
    pulley = FlowPulley(BELT_5PK, LAW_5PK, HALF.tables(), 0.0812, math.radians(210.2), 0.10, 765.0)
    far = flow(pulley, 6.75, 1400.0, 248.0)
    far = replace(far, s=far.s._replace(q=1.2 * far.s.q))
    state = flow(pulley, 6.75, 765.7, 765.9, start=far)
    assert pytest.approx(flow(pulley, 6.75, 765.7, 765.9).W, rel=1e-7) == state.W


@pytest.mark.parametrize(("R", "P_out"), [(0.05, 85.36), (0.0275, 91.13)])
def test_full_slip_leaves_the_force_of_an_independent_rod(R: float, P_out: float) -> None:
    state = flow(pulley_of(R), 1.1, 400.0, omega=1.01 / R * 1.1)
    assert pytest.approx(P_out, abs=0.01) == state.s.T_B
    assert pytest.approx(1.01 / R) == state.W
    with pytest.raises(ConvergenceError, match="no steady running"):
        flow(pulley_of(R), 1.1, 400.0, T_out=60.0)


# four pulleys at mu 0.5, 100 rad/s, a given slack force; flow [m/s], force behind each [N], then
# omega/v0 [1/m] and torque on the belt [N m] of every pulley, from that boundary-value problem
FOUR = ((0.0, 0.0, 0.08), (0.35, -0.05, 0.03), (0.38, 0.25, 0.05), (0.02, 0.30, 0.06))
LOADED = (
    7.9492679565,
    (285.4000195, 419.3632746, 539.6287030, 539.6452298),
    (12.57981277, 33.56649634, 20.12448127, 16.78436023),
)
IDLING = (
    7.9575759472,
    (443.9235842, 444.0115885, 444.0321867, 444.0445743),
    (12.56668051, 33.65480895, 20.13063165, 16.76575276),
)


def test_four_rods_in_a_loop_are_those_of_an_independent_program() -> None:
    pulleys = tuple(Pulley(f"p{i}", *place) for i, place in enumerate(FOUR))
    drive = Drive(BELT_5PK, LAW_5PK, HALF, pulleys, installation="slack_force")
    points = [
        DrivePoint(100.0, LOADED[1][0], (0.0, 4.0, 6.0, 0.0)),
        DrivePoint(100.0, IDLING[1][0], (0.0,) * 4),
    ]
    results = simulate(drive, points, "rod")
    for result, (v0, forces, W) in zip(results, (LOADED, IDLING), strict=True):
        assert result.state.v0 == pytest.approx(v0, rel=5e-6)
        assert pytest.approx(forces, rel=5e-5) == result.state.P
        assert [rod.W for rod in result.state.rods if rod] == pytest.approx(W, rel=8e-6)
    loaded, idling = (np.array(W) / W[0] for _, _, W in (LOADED, IDLING))
    losses = 100.0 * (idling - loaded)
    ours = results[1].columns["speed_rad_s"] - results[0].columns["speed_rad_s"]
    assert ours[1:3] == pytest.approx(losses[1:3], rel=2e-3)
    strings = simulate(drive, points)
    assert (
        strings[1].columns["speed_rad_s"][1] - strings[0].columns["speed_rad_s"][1]
        > 1.05 * losses[1]
    )


def check_power(result: DriveResult) -> None:
    """What the axes lose is what friction takes at the contact points of the rods."""
    power = result.columns["torque_N_m"] * result.columns["speed_rad_s"]
    lost = sum(
        dissipated(rod, pulley.R)
        for rod, pulley in zip(result.state.rods, result.drive.pulleys, strict=True)
        if rod is not None
    )
    assert lost == pytest.approx(power.sum() - 2.0 * power[1:].sum(), rel=3e-3)


@pytest.mark.parametrize("slack", [5.0, 12.0, 30.0])
def test_small_slack_forces(slack: float) -> None:
    """The belt runs, and the power balances."""
    pulleys = (Pulley("driver", 0.0, 0.0, 0.05), Pulley("driven", 0.6, 0.0, 0.05))
    friction = FrictionSurface.constant(2.0)
    drive = two_pulleys(pulleys=pulleys, surface=friction, installation="slack_force")
    (given,) = simulate(drive, [DrivePoint(60.0, slack, (0.0, 9.0))], "rod")
    assert given.status[0] in ("adhesion", "full slip")
    check_power(given)


def test_reversed_running_is_the_mirror_image() -> None:
    torque = (0.0, 9.0)
    points = [DrivePoint(40.0, 310.0, torque), DrivePoint(-40.0, 310.0, torque)]
    forwards, backwards = simulate(two_pulleys(), points, method="rod")
    assert loss_of(backwards) == pytest.approx(loss_of(forwards), rel=1e-6, abs=1e-9)
    check_power(forwards)


def test_idlers_and_backs() -> None:
    pulleys = (
        Pulley("driver", 0.0, 0.0, 0.05),
        Pulley("idler", 0.2, 0.15, 0.05),
        Pulley("load", 0.4, 0.0, 0.05),
        Pulley("back", 0.2, -0.02, 0.03, ribs=False),
    )
    drive = two_pulleys(pulleys=pulleys)
    points = [DrivePoint(50.0, 300.0, (0.0, 0.0, load, 0.0)) for load in (0.0, 6.0)]
    idle, loaded = simulate(drive, points, method="rod")
    assert not loss_of(idle).any()
    assert loaded.columns["torque_N_m"][1] == pytest.approx(0.0, abs=1e-9)
    assert (
        loaded.columns["friction_power_W"][1] > 0.0
    )  # its ribs have to seat: the string knows none of it
    assert [rod is None for rod in loaded.state.rods] == [False, False, False, True]


def test_more_than_the_bent_belt_carries_is_gross_slip() -> None:
    """Constant friction gives way by nothing: 400 to 85.42 N is all that an independent rod holds.

    The string would go to 400 exp(-pi/2) = 83.2 N.
    """
    drive = two_pulleys(surface=HALF, installation="slack_force")
    simulator = Simulator(drive, "rod")

    def at(slack: float) -> str:
        # the tight side at 400 N for nearly no flow
        return simulator.solve(DrivePoint(1.0, slack, (0.0, (400.0 - slack) * 0.05))).status[0]

    assert at(110.0) == "adhesion"
    assert at(84.2) == "gross slip"
    limits = [
        slip_limit(Simulator(drive, method), DrivePoint(1.0, 85.42, (0.0, 10.0)))
        for method in ("rod", "string")
    ]
    assert 10.0 * limits[0].adhesion == pytest.approx((400.0 - 85.42) * 0.05, rel=0.02)
    assert limits[0].adhesion < 0.98 * limits[1].adhesion


def test_a_slack_belt_that_sticks_nowhere_is_in_full_slip() -> None:
    """At 19 N the belt touches the driven pulley only 23 mm behind the tangent point."""
    f, v = np.geomspace(20.0, 30000.0, 40), np.geomspace(5e-4, 10.0, 40)
    mu = 0.7 * (f[:, None] / 5000.0) ** -0.15 * (v / 0.01) ** (0.4 / 3.0)
    drive = two_pulleys(surface=FrictionSurface(f, v, mu), installation="slack_force")
    (result,) = simulate(drive, [DrivePoint(62.8, 18.9, (0.0, 36.8))], method="rod")
    assert result.status == ("full slip", "full slip")
    assert result.columns["loss_slip_rad_s"][1] > 0.9 * loss_of(result)[1]


def test_friction_at_rest_of_the_loop_is_none_and_tightens_the_arcs_of_a_running_one() -> None:
    """An independent rod has 326 N in the middle of an idling arc that was laid on at 310 N."""
    drive = two_pulleys(surface=true_surface("5pk", 5e-4))
    points = [DrivePoint(22.0, 310.0, (0.0, torque)) for torque in (0.0, 16.0)]
    idling, loaded = simulate(drive, points, "rod")
    assert pytest.approx(302.0, abs=3.0) == idling.state.P
    # noise-free recording S11 of the synthetic 5PK bench
    assert pytest.approx((157.38, 477.84), abs=1.5) == loaded.state.P


def test_rigid_pulleys_have_no_rod() -> None:
    with pytest.raises(InputError, match=r"rod level: .* contact law"):
        simulate(two_pulleys(law=None), [DrivePoint(20.0, 310.0, (0.0, 5.0))], method="rod")

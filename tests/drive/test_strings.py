"""Strings: closed forms, a finite-element drive, a table, and what holds of any drive."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from drives import BELT_5PK, LAW_5PK, loss_of, simulate, two_pulleys
from scipy.integrate import quad
from scipy.optimize import brentq

from beltid.drive.loop import solve_loop
from beltid.drive.model import Drive, DrivePoint, Pulley, Tensioner, layout
from beltid.drive.results import DriveResult
from beltid.drive.simulator import Simulator, short_spans, slip_limit
from beltid.errors import InputError
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw


@pytest.mark.parametrize(
    "row",
    [
        (22.0, 310.0, 8.0, (0.1602, 0.0598), (42.33, 42.33)),
        (22.0, 310.0, 29.5, (0.5909, 0.2218), (161.35, 174.97)),
        (62.8, 310.0, 16.0, (0.3205, 0.1203), (73.41, 77.38)),
        (62.8, 160.0, 14.0, (0.2802, 0.1256), (123.79, 136.44)),
    ],
)
def test_two_pulley_bench_with_the_true_law(row: tuple[Any, ...]) -> None:
    omega, T_0, torque, parts, arcs = row
    (result,) = simulate(two_pulleys(), [DrivePoint(omega, T_0, (0.0, torque))])
    assert np.degrees(result.state.arcs.needed) == pytest.approx(arcs, abs=0.0051)
    # the table has the differences of strain and of delta/R; the parts of the loss are of the
    # logarithm of a ratio of speeds, which is smaller by the mean strain and half the loss itself
    found = [
        100.0 * result.columns[f"loss_{part}_rad_s"][1] / omega for part in ("creep", "seating")
    ]
    assert found == pytest.approx(parts, rel=0.008)
    assert result.columns["loss_slip_rad_s"][1] == 0.0
    assert result.status == ("adhesion", "adhesion")


THREE = (
    Pulley("driver", 0.0, 0.0, 0.06),
    Pulley("idler", 0.15, 0.10, 0.03, ribs=False),
    Pulley("load", 0.30, 0.25, 0.04),
)


def belt_on(R: float, P: float, v0: float, law: NormalLaw | None) -> tuple[float, float]:
    """Stretch and radius of the belt under an effective force, from its definitions."""
    stretch = 1.0 + (P + 0.1 * v0**2) / (1e5 - 0.1 * v0**2)
    if law is None:
        return stretch, R
    delta = brentq(lambda d: law.force(d) * (R - d) - P * stretch, 0.0, 1e-3, xtol=1e-17)
    return stretch, R - delta


def dissipated(result: DriveResult, i: int) -> float:
    """Friction force times sliding speed, integrated over the arc of a pulley."""
    state, pulley = result.state, result.drive.pulleys[i]
    law = result.drive.law if pulley.ribs else None

    def density(P: float) -> float:
        stretch, radius = belt_on(pulley.R, P, state.v0, law)
        return abs(abs(result.columns["speed_rad_s"][i]) - state.v0 * stretch / radius) * radius

    return abs(quad(density, state.P[i], state.P_in[i], epsrel=1e-10)[0])


@pytest.mark.parametrize(
    ("drive", "point", "within"),
    [
        (two_pulleys(), DrivePoint(62.8, 310.0, (0.0, 8.0), (0.0, 500.0)), 1e-6),
        (two_pulleys(pulleys=THREE), DrivePoint(100.0, 400.0, (0.0, 0.0, 9.0), (0.0,) * 3), 1e-5),
    ],
)
def test_friction_power_is_what_the_axes_lose(
    drive: Drive, point: DrivePoint, within: float
) -> None:
    (result,) = simulate(drive, [point])
    speed, friction = (result.columns[name] for name in ("speed_rad_s", "friction_power_W"))
    power = result.columns["torque_N_m"] * speed
    asked = np.array(point.torque) * speed + point.power
    assert power[1:] == pytest.approx(asked[1:], rel=1e-8, abs=1e-7)
    lost = power[0] - power[1:].sum()
    assert friction.sum() == pytest.approx(lost, rel=1e-9)
    independent = [dissipated(result, i) for i in range(power.size)]
    assert abs(sum(independent) - lost) < within * power[0]
    # of a pulley alone the lever is good to its second order in the penetration
    assert friction == pytest.approx(independent, rel=5e-3, abs=1e-9)


def test_idling_drive_loses_nothing() -> None:
    (result,) = simulate(two_pulleys(pulleys=THREE), [DrivePoint(50.0, 300.0, (0.0, 0.0, 0.0))])
    assert np.ptp(result.state.P) == pytest.approx(0.0, abs=1e-8)
    assert loss_of(result) == pytest.approx(0.0, abs=1e-12)
    assert np.all(np.isinf(result.columns["reserve"]))
    # the belt turns a rib pulley by its surface and the idler by its back, both without slip
    _, radius = belt_on(0.06, result.state.P[0], result.state.v0, LAW_5PK)
    assert result.columns["speed_rad_s"][1] == pytest.approx(50.0 * radius / 0.03, rel=1e-12)


def test_speeds_of_unequal_rigid_pulleys() -> None:
    pulleys = (Pulley("small", 0.0, 0.0, 0.03), Pulley("large", 0.4, 0.1, 0.08))
    drive = two_pulleys(pulleys=pulleys, law=None)
    (result,) = simulate(drive, [DrivePoint(120.0, 300.0, (0.0, 10.0))])
    before, behind = (result.columns[f"tension_{at}_N"] for at in ("in", "out"))
    strain_tight, strain_slack = before[0] / 1e5, behind[0] / 1e5
    ratio = (1.0 + strain_slack) / (1.0 + strain_tight) * 0.03 / 0.08
    assert result.columns["speed_rad_s"][1] / 120.0 == pytest.approx(ratio, rel=1e-12)
    assert result.columns["loss_seating_rad_s"] == pytest.approx(0.0, abs=1e-12)


def test_loss_below_full_slip_does_not_depend_on_friction() -> None:
    losses = []
    for mu in (0.5, 1.5):
        drive = two_pulleys(surface=FrictionSurface.constant(mu), installation="slack_force")
        (result,) = simulate(drive, [DrivePoint(62.8, 150.0, (0.0, 10.0))])
        assert result.status == ("adhesion", "adhesion")
        losses.append(loss_of(result)[1])
    assert losses[0] == pytest.approx(losses[1], rel=1e-12)


def test_small_torque_in_closed_form() -> None:
    """About dP (1/EA + 1/(R² k_t)), but with the stretch of the belt on the smaller radius.

    The lever of a change of force is R - delta, though that of the force itself is R - delta/2.
    """
    torque, T_0, omega, R = 1e-3, 310.0, 5.0, 0.05
    (result,) = simulate(two_pulleys(), [DrivePoint(omega, T_0, (0.0, torque))])
    stretch, radius = belt_on(R, T_0, 0.25, LAW_5PK)
    f = T_0 * stretch / radius
    seating = (stretch + T_0 / 1e5) / (LAW_5PK.stiffness(R - radius) * radius - f) / radius
    exact = torque / radius * (1.0 / 1e5 / stretch + seating)
    assert loss_of(result)[1] / omega == pytest.approx(exact, rel=2e-5)


def test_slip_limit_at_fixed_centres_hardly_depends_on_friction() -> None:
    # span forces of an inextensible belt add up to 2 T_0: M = 2 T_0 R tanh(mu pi/2), with
    # d ln M/d ln mu = mu pi/sinh(mu pi), 0.272 at mu = 1. Long spans leave the arcs no say
    pulleys = (Pulley("driver", 0.0, 0.0, 0.05), Pulley("driven", 500.0, 0.0, 0.05))
    limits = []
    for mu in (0.95, 1.05):
        surface, belt = FrictionSurface.constant(mu), BELT_5PK._replace(EA=1e8)
        drive = two_pulleys(surface=surface, belt=belt, pulleys=pulleys, law=None)
        limit = slip_limit(Simulator(drive), DrivePoint(1.0, 310.0, (0.0, 10.0)))
        assert limit.slip == limit.adhesion  # a constant mu has nothing to give way by
        limits.append(10.0 * limit.slip)
        assert limits[-1] == pytest.approx(31.0 * math.tanh(0.5 * math.pi * mu), rel=1e-3)
    slope = math.log(limits[1] / limits[0]) / math.log(1.05 / 0.95)
    assert slope == pytest.approx(math.pi / math.sinh(math.pi), abs=0.01)


@pytest.mark.parametrize(("omega", "rhoA"), [(1e-3, 0.1), (200.0, 0.2)])
def test_a_given_slack_force_carries_what_euler_says_at_any_speed(
    omega: float, rhoA: float
) -> None:
    """P_t = P_s exp(mu pi): the momentum of the belt tightens both spans and carries no torque."""
    belt, friction = BELT_5PK._replace(rhoA=rhoA), FrictionSurface.constant(0.4)
    drive = two_pulleys(belt=belt, surface=friction, law=None, installation="slack_force")
    limit = slip_limit(Simulator(drive), DrivePoint(omega, 100.0, (0.0, 5.0)))
    expected = 100.0 * (np.exp(0.4 * np.pi) - 1.0) * 0.05
    assert 5.0 * limit.adhesion == pytest.approx(expected, rel=4e-5)
    (idle,) = simulate(drive, [DrivePoint(omega, 100.0, (0.0, 0.0))])
    # the mass per length is that of the belt without stretch
    momentum = rhoA * (omega * 0.05) ** 2 / (1.0 + idle.columns["tension_out_N"][0] / 1e5)
    assert idle.columns["tension_out_N"] == pytest.approx([100.0 + momentum] * 2, rel=1e-9)
    frequency = np.sqrt(100.0 / rhoA) / (2.0 * 0.25)
    assert idle.columns["span_frequency_Hz"] == pytest.approx([frequency] * 2, rel=1e-9)


def test_a_bent_belt_on_rigid_pulleys_has_the_length_of_an_elastica() -> None:
    """EI psi'' = P sin psi in a span: where it begins, sin(psi/2) = sqrt(EI/P)/(2 R).

    Away from the pulleys it nears a straight line, at R + EI/(2 P R) from their axes.
    """
    P, R, bend = 500.0, np.array([0.02, 0.1]), math.sqrt(0.02 / 500.0)

    def of_radii(radii: np.ndarray) -> Drive:
        places = zip("ab", (0.0, 0.4), radii.tolist(), strict=True)
        return two_pulleys(pulleys=tuple(Pulley(a, x, 0.0, r, ribs=False) for a, x, r in places))

    straight, lines = layout(of_radii(R)), layout(of_radii(R + bend**2 / (2.0 * R)))
    psi = 2.0 * np.arcsin(bend / (2.0 * R))
    at_ends = 2.0 * np.sum(R * (np.sin(psi) - psi) + 2.0 * bend * (1.0 - np.cos(0.5 * psi)))
    longer = (lines.spans - straight.spans).sum() + (lines.wraps - straight.wraps) @ R + at_ends
    string, rod = (
        Simulator(of_radii(R), method).at_rest(DrivePoint(1.0, P, (0.0, 0.0))).belt_length
        for method in ("string", "rod")
    )
    assert (rod - string) * (1.0 + P / 1e5) == pytest.approx(longer, rel=3e-3)
    short = short_spans(of_radii(R), 6.0 * bend * np.array([0.99, 1.01]), np.full(2, P))
    assert [span[:11] for span in short] == ["span a to b"]


def test_the_belt_is_laid_on_the_way_that_does_not_cross() -> None:
    laid = layout(two_pulleys(pulleys=THREE))
    assert np.sum(laid.senses * laid.wraps) == pytest.approx(2.0 * math.pi * laid.senses[0])
    # spans are tangents: at right angles to the radii at both of their ends
    for i, after in ((0, 1), (1, 2), (2, 0)):
        for point, j in ((laid.starts[i], i), (laid.ends[i], after)):
            radius = point - laid.centres[j]
            assert np.hypot(*radius) == pytest.approx(THREE[j].R, rel=1e-12)
            assert radius @ laid.directions[i] == pytest.approx(0.0, abs=1e-15)


def test_drives_that_cannot_be() -> None:
    close = (Pulley("a", 0.0, 0.0, 0.05), Pulley("b", 0.09, 0.0, 0.05))
    with pytest.raises(InputError, match="pulleys a and b overlap"):
        simulate(two_pulleys(pulleys=close), [DrivePoint(1.0, 310.0, (0.0, 1.0))])
    twisted = (Pulley("a", 0.0, 0.0, 0.05), Pulley("b", 0.3, 0.0, 0.05, ribs=False))
    # a corner on its back: the belt turns once all the same, but crosses itself twice
    for pulleys in (twisted, (*twisted, Pulley("c", 0.3, 0.4, 0.05))):
        with pytest.raises(InputError, match="crosses itself"):
            layout(two_pulleys(pulleys=pulleys))
    # the spring pushes the arm with the belt, not against it
    pulleys = (*close[:1], replace(THREE[1], x=0.15, y=-0.02), replace(close[1], x=0.4))
    pivot = (0.15, -0.12)
    for free, balanced in ((math.radians(120.0), True), (math.radians(60.0), False)):
        arm = Tensioner(1, pivot, 0.1, free, 20.0, 0.0)
        drive = Drive(
            BELT_5PK, LAW_5PK, FrictionSurface.constant(1.0), pulleys, 0, "tensioner", arm
        )
        point = DrivePoint(1.0, math.nan, (0.0, 0.0, 1.0))
        if balanced:
            assert simulate(drive, [point])[0].rest.T_0 > 0.0
        else:
            with pytest.raises(InputError, match="no equilibrium; in its mean"):
                simulate(drive, [point])


def falling_surface() -> FrictionSurface:
    """A wet contact: mu rises up to 5 mm/s and falls beyond."""
    v = np.geomspace(5e-4, 0.05, 24)
    return FrictionSurface([10.0, 30000.0], v, [1.0 - 0.12 * np.log(v / 5e-3) ** 2] * 2)


def test_friction_that_falls_with_speed_has_two_states_and_then_none() -> None:
    drive = two_pulleys(surface=falling_surface(), installation="slack_force", law=None)
    simulator = Simulator(drive)
    limit = slip_limit(simulator, DrivePoint(20.0, 20.0, (0.0, 10.0)))
    assert limit.adhesion < limit.slip
    between = 10.0 * (0.5 * limit.adhesion + 0.5 * limit.slip)
    result = simulator.solve(DrivePoint(20.0, 20.0, (0.0, between)))
    assert "full slip" in result.status
    assert result.columns["steady_states"][i := result.status.index("full slip")] == 2
    assert result.state.arcs.slip[i] < 5e-3  # the smaller one, on the rising branch
    beyond = simulator.solve(DrivePoint(20.0, 20.0, (0.0, 10.1 * limit.slip)))
    assert "gross slip" in beyond.status
    assert np.isnan(loss_of(beyond)[1])


def test_share_of_friction_below_the_slowest_speed_of_the_rig() -> None:
    # creep speed grows almost in proportion to the fall of P: 2.5 mm/s are reached half-way here
    result = Simulator(two_pulleys()).solve(DrivePoint(22.0, 310.0, (0.0, 16.0)))
    state, shares = result.state, result.columns
    flat, point = replace(state, jacobian=np.ones((3, 3))), DrivePoint(22.0, 310.0, (0.0, 15.0))
    expected = solve_loop(point, result.rest)  # a singular Jacobian to start from does no harm
    assert pytest.approx(expected.P, rel=1e-7) == solve_loop(point, result.rest, flat).P
    entry = np.divide(*belt_on(0.05, state.P_in[0], state.v0, LAW_5PK))

    def creep(P: float) -> float:
        return 0.05 * state.v0 * abs(entry - np.divide(*belt_on(0.05, P, state.v0, LAW_5PK)))

    at_limit = brentq(lambda P: creep(P) - 0.0025, state.P[0], state.P_in[0], xtol=1e-12)
    share = (state.P_in[0] - at_limit) / (state.P_in[0] - state.P[0])
    assert shares["share_below_speed_range"][0] == pytest.approx(share, rel=1e-9)
    assert shares["slip_speed_max_m_s"][0] == pytest.approx(creep(state.P[0]), rel=1e-9)
    assert shares["share_outside_force_range"] == pytest.approx(0.0, abs=1e-15)

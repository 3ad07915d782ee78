"""Drives whose state is known: closed forms, a finite-element model, a vendor's report, a table."""

from __future__ import annotations

import math

import numpy as np
import pytest
from drives import simulate, two_pulleys
from scipy.optimize import brentq

from beltid.drive.geometry import layout
from beltid.drive.model import Drive, DrivePoint, Pulley, Tensioner
from beltid.drive.results import Simulator
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt

RIGID_PAIR = (Pulley("driver", 0.0, 0.0, 0.1), Pulley("driven", 0.1 * math.pi, 0.0, 0.1))


@pytest.mark.parametrize(
    ("EA", "T_0", "omega", "torque", "expected"),
    [
        (1e5, 310.0, 62.8, 8.0, (350.1629596, 270.1598264, 62.7499333, 30.1078088)),
        # 55.897 deg without the stretching acceleration, 38.78 deg without inertia
        (1e4, 300.0, 300.0, 10.0, (351.2478746, 250.4008025, 297.0772488, 54.4752881)),
    ],
)
def test_string_with_inertia_on_rigid_pulleys(
    EA: float, T_0: float, omega: float, torque: float, expected: tuple[float, ...]
) -> None:
    # closed forms of Bechtel et al., J. Appl. Mech. 67 (2000), on fixed centres
    drive = Drive(Belt(EA, 0.02, 0.1), None, FrictionSurface.constant(0.5), RIGID_PAIR)
    (result,) = simulate(drive, [DrivePoint(omega, T_0, (0.0, torque))])
    before, behind = result.tensions
    tight, slack = before[0], behind[0]
    found = (tight, slack, result.speed[1], math.degrees(result.state.arcs.needed[1]))
    np.testing.assert_allclose(found, expected, rtol=0, atol=5.1e-8)  # half of the last digit
    # the same arc from the span forces alone: mu Phi = ln[(N_t - N_c)/(N_s - N_c)]
    flow = 0.1 * result.state.v0**2
    N_c = flow / (1.0 - flow / EA)
    phi = math.log((tight - N_c) / (slack - N_c)) / 0.5
    np.testing.assert_allclose(result.state.arcs.needed, phi, rtol=1e-12)


def finite_element_drive(mu: float, load: float) -> tuple[float, float, float, float, float]:
    """State of the drive of THREAD-2-3/beltDriveSimulation, whose driver turns at 12 rad/s.

    Its strain counts from a reference length, of which the stress-free length is 0.95: stiffness,
    mass and bed per stress-free length follow. Given is the length of the belt; T_0 is that of this
    length at rest.
    """
    EA, R, span = 8000.0 * 0.95, 0.1, 0.1 * math.pi
    bed = NormalLaw(3.2e8 / 0.95)
    belt = Belt(EA, 0.02, 0.8288 / 0.95)
    length = 0.95 * (2.0 * span + 2.0 * math.pi * R)

    def excess(T_0: float) -> float:
        stretch = 1.0 + T_0 / EA
        delta = brentq(lambda d: bed.force(d) * (R - d) - T_0 * stretch, 0.0, 1e-3, xtol=1e-16)
        return (2.0 * span + 2.0 * math.pi * (R - delta)) / stretch - length

    T_0 = brentq(excess, 100.0, 1000.0, xtol=1e-10)
    simulator = Simulator(Drive(belt, bed, FrictionSurface.constant(mu), RIGID_PAIR))
    omega_2 = 12.0
    for _ in range(30):  # the load follows the speed of the driven pulley
        result = simulator.solve(DrivePoint(12.0, T_0, (0.0, load + 2.0 * omega_2)))
        omega_2 = float(result.speed[1])
    before, behind = result.tensions
    arc = math.degrees(result.state.arcs.needed[1])
    return before[0], behind[0], omega_2 / 12.0, float(result.torque[0]), arc


def test_finite_element_drive_at_high_load() -> None:
    tight, slack, ratio, torque, arc = finite_element_drive(0.5, 25.0)
    # 480 nodes: 664.52 and 186.27 with gravity of +-0.8 N, 47.653; ratio extrapolated over 60,
    # 240 and 480 nodes. String level solved independently: 662.80, 186.47, 0.94221, 47.613, 145.8
    assert tight == pytest.approx(664.52, rel=3e-3)
    assert slack == pytest.approx(186.27, rel=3e-3)
    assert torque == pytest.approx(47.653, rel=1e-3)
    assert ratio == pytest.approx(0.9424, abs=3e-4)
    assert (tight, slack) == pytest.approx((662.80, 186.47), rel=2e-4)
    assert (ratio, torque) == pytest.approx((0.94221, 47.613), rel=1e-5)
    assert arc == pytest.approx(145.8, abs=0.05)


def test_finite_element_drive_at_low_load_and_with_more_friction() -> None:
    tight, slack, *_ = finite_element_drive(0.5, 0.0)
    assert (tight, slack) == pytest.approx((520.57, 286.21), rel=3e-3)
    assert (tight, slack) == pytest.approx((519.77, 286.59), rel=2e-4)
    tight, slack, *_ = finite_element_drive(1.0, 25.0)
    # 656.58 and 177.90 at 480 nodes, where numerical creep still moves the forces
    assert (tight, slack) == pytest.approx((654.27, 177.97), rel=2e-4)


@pytest.mark.parametrize(
    ("omega", "T_0", "torque", "tight", "slack", "loss", "parts", "arcs"),
    [
        (22.0, 310.0, 8.0, 391.162, 230.932, 0.048255, (0.1602, 0.0598), (42.33, 42.33)),
        (22.0, 310.0, 16.0, 476.497, 156.035, 0.096533, (0.3205, 0.1201), (84.63, 86.11)),
        (22.0, 310.0, 29.5, 642.989, 52.092, 0.177687, (0.5909, 0.2218), (161.35, 174.97)),
        (62.8, 310.0, 16.0, 475.711, 155.249, 0.275689, (0.3205, 0.1203), (73.41, 77.38)),
        (76.8, 411.0, 16.0, 574.822, 254.246, 0.328767, (0.3206, 0.1096), (55.63, 58.00)),
        (62.8, 160.0, 14.0, 313.217, 32.974, 0.254106, (0.2802, 0.1256), (123.79, 136.44)),
    ],
)
def test_two_pulley_bench_with_the_true_law(
    omega: float,
    T_0: float,
    torque: float,
    tight: float,
    slack: float,
    loss: float,
    parts: tuple[float, float],
    arcs: tuple[float, float],
) -> None:
    (result,) = simulate(two_pulleys(), [DrivePoint(omega, T_0, (0.0, torque))])
    before, behind = result.tensions
    assert (before[0], behind[0]) == pytest.approx((tight, slack), rel=1e-5)
    assert result.loss.total[1] == pytest.approx(loss, rel=1e-5)
    assert np.degrees(result.state.arcs.needed) == pytest.approx(arcs, abs=0.0051)
    # the table has the differences of strain and of delta/R; the parts of the loss are of the
    # logarithm of a ratio of speeds, which is smaller by the mean strain and half the loss itself
    creep, seating = result.loss.creep[1] / omega * 100.0, result.loss.seating[1] / omega * 100.0
    assert creep == pytest.approx(parts[0], rel=0.008)
    assert seating == pytest.approx(parts[1], rel=0.008)
    assert result.loss.slip[1] == 0.0
    assert result.status == ("adhesion", "adhesion")


def accessory_drive() -> Drive:
    """Accessory drive of the report Gates AG00686, as cited in kaydgn/MFSim; clockwise.

    In the mean position the arm has left its free angle of 42 deg by 33.1 deg.
    """
    mean = math.radians(42.0 + 33.1)
    arm = Tensioner(1, (-0.180, 0.100), 0.090, math.radians(42.0), 8.59, math.degrees(0.482))
    x, y = -0.180 + 0.090 * math.cos(mean), 0.100 + 0.090 * math.sin(mean)
    pulleys = (
        Pulley("CRK", 0.0, 0.0, 0.0812),
        Pulley("TEN", x, y, 0.0386, ribs=False),
        Pulley("A_C", -0.224, 0.448, 0.0647),
        Pulley("IDR", -0.072, 0.267, 0.0386, ribs=False),
    )
    # the report has neither mass nor stretch nor an elastic bed
    belt, surface = Belt(1.0e9, 0.02, 1.0e-6), FrictionSurface.constant(0.5)
    return Drive(belt, None, surface, pulleys, 0, "tensioner", arm)


def test_accessory_drive_geometry_and_mean_tension() -> None:
    drive = accessory_drive()
    laid = layout(drive)
    assert laid.spans * 1e3 == pytest.approx((212.6, 248.9, 212.6, 249.2), abs=0.06)
    assert np.degrees(laid.wraps) == pytest.approx((210.2, 26.4, 202.9, 26.7), abs=0.06)
    (result,) = simulate(drive, [DrivePoint(80.0, math.nan, (0.0,) * 4)])
    mean_tension = result.rest.T_0
    assert mean_tension == pytest.approx(765.7, rel=3e-3)


RIB, BACK = True, False
# reports of Gates as cited in kaydgn/MFSim: pulleys x, y, radius [mm] and side; pivot [mm], angles
# [deg] of the free arm and at the mean, preload [N m], rate [N m/deg]; arm at its load stop [deg]
# and tension there [N], which the report rounds to 0.1
STOPS = {
    "AG00686-1520": (
        [(0, 0, 87.2, RIB), (-72, 267, 38.6, BACK), (-224, 448, 69.7, RIB)],
        ((-180, 100), 42.0, 70.0, 8.86, 0.476),
        (96.5, 1579.2),
    ),
    "AG00810": (
        [(0, 0, 89.2, RIB), (-200, 150, 38.6, BACK), (-391, 131, 28.7, RIB)],
        ((-303, 7), 55.1, 18.0, 11.561, 0.483),
        (348.6 - 360.0, 2404.6),
    ),
    "AG00976": (
        [
            (0, 0, 82.2, RIB),
            (143, 140, 38.6, BACK),
            (184, 314.6, 77.2, RIB),
            (0, 272.5, 38.6, BACK),
            (-267, 241, 29.7, RIB),
        ],
        ((-240, 115), 12.0, 344.0 - 360.0, 8.87, 0.484),
        (323.7 - 360.0, 1007.1),
    ),
}


@pytest.mark.parametrize("report", STOPS)
def test_arm_of_the_tensioner_at_its_load_stop(report: str) -> None:
    others, (pivot, free, mean, preload, rate), (angle, tension) = STOPS[report]
    x, y = (pivot[k] + 90.0 * f(math.radians(mean)) for k, f in enumerate((math.cos, math.sin)))
    pulleys = tuple(
        Pulley(f"p{i}", 1e-3 * x, 1e-3 * y, 1e-3 * R, side)
        for i, (x, y, R, side) in enumerate([*others, (x, y, 38.6, BACK)])
    )
    axis = (1e-3 * pivot[0], 1e-3 * pivot[1])
    arm = Tensioner(len(others), axis, 0.09, math.radians(free), preload, math.degrees(rate))
    belt, surface = Belt(1.0e9, 0.02, 1.0e-6), FrictionSurface.constant(0.5)
    drive = Drive(belt, None, surface, pulleys, 0, "tensioner", arm)
    (result,) = simulate(drive, [DrivePoint(80.0, tension, (0.0,) * len(pulleys))])
    assert result.rest.arm_angle is not None
    assert math.degrees(result.rest.arm_angle) == pytest.approx(angle, abs=0.05)
    assert pytest.approx(tension, rel=1e-3) == result.state.P


@pytest.mark.parametrize(
    ("rpm", "power_kW", "tight", "crank", "compressor", "idler"),
    [
        (800, 3.0, 1208, 1911, 1938, 557),
        (1000, 4.0, 1237, 1939, 1967, 571),
        (1250, 5.0, 1237, 1939, 1966, 571),
        (1500, 5.5, 1198, 1900, 1927, 552),
        (1750, 6.8, 1223, 1925, 1952, 564),
        (2000, 8.2, 1248, 1949, 1977, 576),
    ],
)
def test_accessory_drive_forces(
    rpm: float, power_kW: float, tight: float, crank: float, compressor: float, idler: float
) -> None:
    power = (0.0, 0.0, power_kW * 1e3, 0.0)
    point = DrivePoint(rpm * math.pi / 30.0, math.nan, (0.0,) * 4, power)
    (result,) = simulate(accessory_drive(), [point])
    before, _ = result.tensions
    hub = np.hypot(*result.hub_force.T)
    assert before[0] == pytest.approx(tight, rel=3e-3)
    assert (hub[0], hub[2], hub[3]) == pytest.approx((crank, compressor, idler), rel=3e-3)
    assert result.torque[2] * result.speed[2] == pytest.approx(power_kW * 1e3, rel=1e-9)

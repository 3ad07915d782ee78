"""Drives of four and six pulleys against their differential equations, solved by other code."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from capstan_chain import Chain, Wheel
from drives import BELT_5PK, LAW_5PK, simulate

from beltid.drive.model import Drive, DrivePoint, Pulley
from beltid.laws.friction_surface import FrictionSurface

FOUR = (
    Wheel(0.0, 0.0, 0.08, True),
    Wheel(0.35, -0.05, 0.03, True, 4.0),
    Wheel(0.38, 0.25, 0.05, True, 6.0),
    Wheel(0.02, 0.30, 0.06, True),
)
SIX = (
    Wheel(0.0, 0.0, 0.07, True),
    Wheel(0.30, -0.10, 0.03, True, 3.0),
    Wheel(0.28, 0.05, 0.035, False, ribs=False),
    Wheel(0.38, 0.25, 0.05, True, 7.0),
    Wheel(0.15, 0.20, 0.04, False, ribs=False),
    Wheel(0.02, 0.35, 0.06, True, 2.0),
)


def wet(f: float, v: float) -> float:
    """A coefficient that falls with force and speed; nearest value outside 0.5 to 50 mm/s."""
    v = min(max(v, 5e-4), 0.05)
    return 1.2 * (max(f, 1.0) / 5400.0) ** -0.15 * (1.0 - 0.08 * math.log(v / 5e-4))


# wheels, tension at rest [N], speed of the driver [rad/s] (belts at 20 and 39 m/s); tensions behind
# each wheel [N] and losses of speed [rad/s] from the differential equations of capstan_chain, which
# `make verify` solves again
SOLVED = [
    (
        *(FOUR, 450.0, 250.0),
        (291.4895260, 425.3617509, 545.6388964, 545.6388964),
        (0.0, 2.697981798, 0.5716361196, -0.02884949073),
    ),
    (
        *(SIX, 500.0, 560.0),
        (355.3605496, 455.8189338, 455.8189338, 596.2652090, 596.2652090, 629.6965642),
        (0.0, 5.715103775, 2.188413976, 1.692589320, 0.5486183725, 0.2257706844),
    ),
]
DRIVES = pytest.mark.parametrize(
    ("wheels", "T_0", "omega", "tensions", "losses"), SOLVED, ids=["four", "six"]
)


@pytest.mark.long
@DRIVES
def test_the_numbers_stated_solve_the_differential_equations(
    wheels: tuple[Wheel, ...],
    T_0: float,
    omega: float,
    tensions: tuple[float, ...],
    losses: tuple[float, ...],
) -> None:
    chain = Chain(wheels, 1.0e5, 0.10, 6.5e7, 3.0256e11, wet, 0.4)
    idle = replace(chain, wheels=tuple(replace(wheel, torque=0.0) for wheel in wheels))
    found, speeds = chain.solve(T_0, omega)
    assert found == pytest.approx(tensions, rel=1e-7)
    assert idle.solve(T_0, omega)[1] - speeds == pytest.approx(losses, rel=1e-6, abs=1e-9)


@DRIVES
def test_tensions_and_losses_of_the_differential_equations(
    wheels: tuple[Wheel, ...],
    T_0: float,
    omega: float,
    tensions: tuple[float, ...],
    losses: tuple[float, ...],
) -> None:
    f, v = np.geomspace(20.0, 30000.0, 80), np.geomspace(5e-4, 0.05, 40)
    drive = Drive(
        BELT_5PK,
        LAW_5PK,
        FrictionSurface(f, v, np.array([[wet(a, b) for b in v] for a in f])),
        tuple(Pulley(f"p{i}", w.x, w.y, w.R, w.ribs) for i, w in enumerate(wheels)),
        back_friction=0.4,
        slow_trend=0.0,
    )
    point = DrivePoint(omega, T_0, tuple(wheel.torque for wheel in wheels))
    (string,) = simulate(drive, [point])
    assert string.tensions[1] == pytest.approx(tensions, rel=1e-5)
    assert string.loss.total == pytest.approx(losses, rel=2e-5, abs=1e-9)


# FOUR at mu 0.5, 100 rad/s, a given slack force; flow [m/s], force behind each wheel [N] of a
# state, then omega/v0 [1/m] and torque on the belt [N m] of every wheel with these forces, from the
# boundary-value problem of flowing_rod with its friction smoothed over 1e-6
LOADED = (
    7.9492679565,
    (285.4000195, 419.3632746, 539.6287030, 539.6452298),
    (12.57981277, 33.56649634, 20.12448127, 16.78436023),
    (20.32423, -3.99997, -6.00001, 0.00001),
)
IDLING = (
    7.9575759472,
    (443.9235842, 444.0115885, 444.0321867, 444.0445743),
    (12.56668051, 33.65480895, 20.13063165, 16.76575276),
    (0.01012, 0.00008, 0.00002, 0.00002),
)


def test_four_rods_in_a_loop_are_those_of_an_independent_program() -> None:
    """Bending, bed, creep and sliding of each wheel by other code, at the forces of the loop.

    The loop is right if the wheels then take off what they should, at one flow of belt.
    """
    drive = Drive(
        BELT_5PK,
        LAW_5PK,
        FrictionSurface.constant(0.5),
        tuple(Pulley(f"p{i}", w.x, w.y, w.R) for i, w in enumerate(FOUR)),
        installation="slack_force",
    )
    asked = [wheel.torque for wheel in FOUR]
    points = [
        DrivePoint(100.0, LOADED[1][0], tuple(asked)),
        DrivePoint(100.0, IDLING[1][0], (0.0,) * 4),
    ]
    results = simulate(drive, points, "rod")
    for state, (v0, forces, W, torque) in zip(
        (result.state for result in results), (LOADED, IDLING), strict=True
    ):
        assert state.v0 == pytest.approx(v0, rel=1e-6)
        assert pytest.approx(forces, rel=1e-5) == state.P
        assert [rod.W for rod in state.rods if rod] == pytest.approx(W, rel=6e-6)
        assert [rod.torque for rod in state.rods if rod] == pytest.approx(torque, abs=1e-4)
    assert LOADED[3][1:] == pytest.approx([-load for load in asked[1:]], abs=1e-4)
    loaded, idling = (np.array(W) / W[0] for _, _, W, _ in (LOADED, IDLING))
    losses = 100.0 * (idling - loaded)
    ours = results[1].speed - results[0].speed
    assert ours[1:3] == pytest.approx(losses[1:3], rel=1e-3)
    strings = simulate(drive, points)
    assert strings[1].speed[1] - strings[0].speed[1] > 1.05 * losses[1]

"""Drives of four and six pulleys against their differential equations, solved by other code."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from capstan_chain import Chain, Wheel
from drives import BELT_5PK, LAW_5PK

from beltid.drive.model import Drive, DrivePoint, Pulley
from beltid.drive.results import simulate
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


@pytest.mark.parametrize(
    ("wheels", "T_0", "omega"),
    [(FOUR, 450.0, 250.0), (SIX, 500.0, 560.0)],  # belts at 20 and 39 m/s
)
def test_tensions_and_losses_of_the_differential_equations(
    wheels: tuple[Wheel, ...], T_0: float, omega: float
) -> None:
    chain = Chain(wheels, 1.0e5, 0.10, 6.5e7, 3.0256e11, wet, 0.4)
    idle = replace(chain, wheels=tuple(replace(wheel, torque=0.0) for wheel in wheels))
    tensions, speeds = chain.solve(T_0, omega)
    losses = idle.solve(T_0, omega)[1] - speeds
    f, v = np.geomspace(20.0, 30000.0, 80), np.geomspace(5e-4, 0.05, 40)
    drive = Drive(
        BELT_5PK,
        LAW_5PK,
        FrictionSurface(f, v, np.array([[wet(a, b) for b in v] for a in f])),
        tuple(Pulley(f"p{i}", w.x, w.y, w.R, w.ribs) for i, w in enumerate(wheels)),
        back_friction=0.4,
    )
    point = DrivePoint(omega, T_0, tuple(wheel.torque for wheel in wheels))
    string, rod = (simulate(drive, [point], method)[0] for method in ("string", "rod"))
    assert string.tensions[1] == pytest.approx(tensions, rel=1e-5)
    assert string.loss.total == pytest.approx(losses, rel=2e-5, abs=1e-9)
    # bending changes the loss, by up to a tenth, but hardly the forces
    assert rod.tensions[1] == pytest.approx(tensions, rel=3e-3)

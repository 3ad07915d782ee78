"""Predicted drives: time a point by string and rod.

python -m benchmarks.drive
"""

from __future__ import annotations

import time

import numpy as np

from beltid.drive.model import Drive, DrivePoint, Pulley
from beltid.drive.results import Simulator
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt

SERIES = ((22.0, 310.0, 16.0), (62.8, 310.0, 16.0), (76.8, 411.0, 16.0), (62.8, 155.0, 15.0))
POINTS_OF_SERIES = 13


def surface() -> FrictionSurface:
    """A surface like that of a 5PK belt, at the settings of its rig."""
    f, v = np.geomspace(1000.0, 8000.0, 8), np.geomspace(0.0025, 0.042, 5)
    mu = (f[:, None] / 5400.0) ** -0.18 * (1.0 + 0.2 * np.log(v / 0.01))
    return FrictionSurface(f, v, mu)


def main() -> None:
    """Print the times."""
    pulleys = (Pulley("driver", 0.0, 0.0, 0.05), Pulley("driven", 0.25, 0.0, 0.05))
    law = NormalLaw(6.5e7, 3.0256e11)
    drive = Drive(Belt(1.0e5, 0.02, 0.10), law, surface(), pulleys)
    points = [
        DrivePoint(omega, tension, (0.0, torque))
        for omega, tension, largest in SERIES
        for torque in np.linspace(0.0, largest, POINTS_OF_SERIES)
    ]
    Simulator(drive).solve(points[0])  # compiles
    start = time.process_time()
    string = Simulator(drive)
    for point in points:
        string.solve(point)
    spent = time.process_time() - start
    print(f"{1e3 * spent / len(points):.2f} ms of processor time a point (aim: 1 ms)")
    Simulator(drive, "rod").solve(points[1])  # compiles
    start = time.process_time()
    rods = Simulator(drive, "rod")
    for point in points:
        rods.solve(point)
    spent = time.process_time() - start
    of_pulley = 1e3 * spent / (len(points) * len(pulleys))
    print(
        f"{spent:.1f} s for the rods of {len(points)} points (aim: 3 s), {of_pulley:.0f} ms a "
        "pulley (aim: 30 ms)"
    )


if __name__ == "__main__":
    main()

"""Drives that several tests share, and the known law of the synthetic 5PK belt."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from golden.test_chain import true_mu

from beltid.drive.model import Drive, DrivePoint, Pulley
from beltid.drive.results import DriveResult
from beltid.drive.simulator import Method, Simulator
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt

LAW_5PK = NormalLaw(6.5e7, 3.0256e11)
BELT_5PK = Belt(1.0e5, 0.02, 0.10)
SLOWEST, FASTEST = 0.0025, 0.042  # sliding speeds of the rig, m/s


def two_pulleys(**changes: Any) -> Drive:
    """The two-pulley bench of the synthetic belts: equal pulleys, fixed centres."""
    parts: dict[str, Any] = {
        "belt": BELT_5PK,
        "law": LAW_5PK,
        "surface": true_surface("5pk"),
        "pulleys": (Pulley("driver", 0.0, 0.0, 0.05), Pulley("driven", 0.25, 0.0, 0.05)),
        "slow_trend": 0.0,  # the law of the tables: the nearest value below SLOWEST
    }
    return Drive(**(parts | changes))


def simulate(
    drive: Drive, points: Sequence[DrivePoint], method: Method = "string"
) -> list[DriveResult]:
    """The steady states of several points of a drive."""
    simulator = Simulator(drive, method)
    return [simulator.solve(point) for point in points]


def loss_of(result: DriveResult) -> np.ndarray:
    """Speed losses against idling, by pulley as stated."""
    return result.columns["speed_loss_rad_s"]


def true_surface(belt: str, slowest: float = SLOWEST) -> FrictionSurface:
    """True friction of a synthetic belt from a sliding speed [m/s] on; nearest value outside."""
    f, v = np.geomspace(20.0, 30000.0, 70), np.geomspace(slowest, FASTEST, 30)
    return FrictionSurface(f, v, true_mu(belt, f[:, None], v))

"""How much torque a drive carries: where adhesion ends, and where slipping has no end."""

from __future__ import annotations

import math
from dataclasses import dataclass

from beltid.drive.model import DrivePoint
from beltid.drive.results import ADHESION, FULL_SLIP, Simulator
from beltid.errors import ConvergenceError

BISECTIONS = 18  # to 4e-6 of the limit
LARGEST_FACTOR = 2.0**20


@dataclass(frozen=True, slots=True)
class SlipLimit:
    """Limits of the torques of an operating point, all torques and powers scaled together.

    Attributes
    ----------
    adhesion : float
        Factor on the torques with which the first pulley has no adhesion arc left [-].
    slip : float
        Factor beyond which no steady sliding within the measured speeds carries them [-].
    """

    adhesion: float
    slip: float


def slip_limit(simulator: Simulator, point: DrivePoint) -> SlipLimit:
    """Find by bisection how far the torques of a point may grow.

    Parameters
    ----------
    simulator : Simulator
        Of the drive.
    point : DrivePoint
        Speed, tension and the proportion of the torques; not all zero.

    Notes
    -----
    Torques with which no steady state is found count as not carried: just below gross slip the
    sliding speed grows without bound over the torque.
    """
    return SlipLimit(
        _largest(simulator, point, (ADHESION,)),
        _largest(simulator, point, (ADHESION, FULL_SLIP)),
    )


def _largest(simulator: Simulator, point: DrivePoint, carried: tuple[str, ...]) -> float:
    """Largest factor on the torques with which every pulley is in one of the states."""

    def carries(factor: float) -> bool:
        try:
            return set(simulator.solve(point.scaled(factor)).status) <= set(carried)
        except ConvergenceError:
            return False

    low, high = 0.0, 1.0
    while carries(high):
        low, high = high, 2.0 * high
        if high > LARGEST_FACTOR:
            return math.inf
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if carries(middle) else (low, middle)
    return low

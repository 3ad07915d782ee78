"""How much torque a drive carries: where adhesion ends, and where slipping has no end."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from beltid.drive.model import DrivePoint
from beltid.drive.results import SLACK, DriveResult, Simulator
from beltid.errors import ConvergenceError

Array = NDArray[np.float64]

TOLERANCE: Final = 2e-5
"""Of a limit, relative."""
LARGEST_FACTOR: Final = 2.0**20
MOST_RESERVE: Final = 10.0


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
    """Find how far the torques of a point may grow.

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
        _largest(simulator, point, lambda result: result.reserve),
        _largest(simulator, point, lambda result: result.largest_reserve),
    )


def _largest(
    simulator: Simulator, point: DrivePoint, reserve: Callable[[DriveResult], Array]
) -> float:
    """Largest factor on the torques with which every pulley keeps a reserve of 1."""
    near: DriveResult | None = None

    def margin(factor: float) -> float:
        nonlocal near
        # a state that is not steady is no good start
        starts = (near, None) if near is not None else (None,)
        for start in starts:
            try:
                result = simulator.solve(point.scaled(factor), start)
                break
            except ConvergenceError:
                continue
        else:
            return -1.0
        if SLACK in result.status:
            return -1.0
        # an idling pulley has an infinite reserve, and it could not be interpolated
        left = min(float(reserve(result).min()), MOST_RESERVE) - 1.0
        if left > 0.0:
            near = result
        return left

    low, high = 0.0, 1.0
    while margin(high) > 0.0:
        low, high = high, 2.0 * high
        if high > LARGEST_FACTOR:
            return math.inf
    return float(brentq(margin, low, high, xtol=TOLERANCE * high, rtol=TOLERANCE))

"""Torque limits of a drive: the end of adhesion, and the onset of unbounded slip."""

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
"""Relative tolerance of a limit."""
LARGEST_FACTOR: Final = 2.0**20
MOST_RESERVE: Final = 10.0


@dataclass(frozen=True, slots=True)
class SlipLimit:
    """Torque limits of an operating point, with all torques and powers scaled together.

    Attributes
    ----------
    adhesion : float
        Factor on the torques at which the first pulley loses its adhesion arc [-].
    slip : float
        Factor beyond which no steady sliding within the measured speeds transmits them [-].
    """

    adhesion: float
    slip: float


def slip_limit(simulator: Simulator, point: DrivePoint) -> SlipLimit:
    """Find the largest factors on the torques of a point.

    Parameters
    ----------
    simulator : Simulator
        Simulator of the drive.
    point : DrivePoint
        Speed, tension and the proportion of the torques, which must not all be zero.

    Notes
    -----
    Torques without a steady state count as not transmitted: just below gross slip the sliding speed
    grows without bound with the torque.
    """
    return SlipLimit(
        _largest(simulator, point, lambda result: result.reserve),
        _largest(simulator, point, lambda result: result.largest_reserve),
    )


def _largest(
    simulator: Simulator, point: DrivePoint, reserve: Callable[[DriveResult], Array]
) -> float:
    """Find the largest factor on the torques at which every pulley keeps a reserve of 1."""
    near: DriveResult | None = None

    def margin(factor: float) -> float:
        nonlocal near
        # from the last steady state, then from scratch
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
        # bounded: the infinite reserve of an idling pulley could not be interpolated
        excess = min(float(reserve(result).min()), MOST_RESERVE) - 1.0
        if excess > 0.0:
            near = result
        return excess

    low, high = 0.0, 1.0
    while margin(high) > 0.0:
        low, high = high, 2.0 * high
        if high > LARGEST_FACTOR:
            return math.inf
    return float(brentq(margin, low, high, xtol=TOLERANCE * high, rtol=TOLERANCE))

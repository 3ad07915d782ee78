"""Torque limits of a drive: the end of adhesion, and the onset of unbounded slip."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, root

from beltid.drive.loop import Loop, LoopState, solve_loop
from beltid.drive.model import DrivePoint
from beltid.drive.results import Simulator
from beltid.drive.string import StringLevel
from beltid.errors import ConvergenceError

Array = NDArray[np.float64]

TOLERANCE: Final = 2e-5
"""Relative tolerance of a limit of a string."""
ROD_TOLERANCE: Final = 3e-3
"""Relative change at which a limit of rods is left."""
BELOW: Final = (0.999, 0.97, 0.9)
"""Shares of a limit of rods at which they are solved next."""
MOST_ROUNDS: Final = 4
LARGEST_FACTOR: Final = 2.0**20
SMALLEST_FACTOR: Final = 2.0**-20
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
    """Find the largest factors on the torques of a point, by the method of the simulator.

    Parameters
    ----------
    simulator : Simulator
        Simulator of the drive.
    point : DrivePoint
        Speed, tension and the proportion of the torques, which must not all be zero.

    Notes
    -----
    Torques without a steady state count as not transmitted: just below gross slip the sliding speed
    grows without bound with the torque. With rods the limit is that of the string with the
    differences of rods and string of a state just below it.
    """
    if point.omega < 0.0:
        forwards = replace(point.reversed(), omega=-point.omega)
        return slip_limit(simulator.backwards, forwards)
    return SlipLimit(_largest(simulator, point, False), _largest(simulator, point, True))


def _largest(simulator: Simulator, point: DrivePoint, with_slip: bool) -> float:
    """Find the largest factor at which every pulley keeps room for what its forces need."""
    state, factor = simulator.solve(point.scaled(0.0)).state, 0.0
    for _ in range(MOST_ROUNDS):
        last, factor = factor, _of_loop(simulator, point, with_slip, state, factor)
        is_exact = simulator.method == "string" or not math.isfinite(factor)
        if is_exact or abs(factor - last) <= ROD_TOLERANCE * factor:
            break
        for share in BELOW:
            with suppress(ConvergenceError):
                below = simulator.solve(point.scaled(share * factor))
                if below.state.rods:
                    state = below.state
                    break
    return factor


def _of_loop(
    simulator: Simulator, point: DrivePoint, with_slip: bool, state: LoopState, guess: float
) -> float:
    """Find the factor with the belt on its pulleys as in a state.

    It is one more unknown of the loop, from a state near the limit that is bracketed if no guess
    is known.
    """
    drive, rest, level = simulator.drive, simulator.at_rest(point), state.level
    string, near = StringLevel(drive), state

    def margin(found: LoopState) -> float:
        """Room over the arc that is needed, less 1, of the pulley with the least."""
        if found.slack or found.v0 <= 0.0:
            return -1.0
        needed = found.arcs.needed
        if with_slip:
            forces = zip(found.P_in.tolist(), found.P.tolist(), strict=True)
            arcs = [string.arcs_by_speed(i, *P, found.v0) for i, P in enumerate(forces)]
            needed = np.array([of_pulley.min() for of_pulley in arcs])
        # bounded: the infinite reserve of an idling pulley could not be interpolated
        most = found.arcs.room / np.maximum(needed, found.arcs.room / MOST_RESERVE)
        return float(most.min()) - 1.0

    def margin_at(factor: float) -> float:
        nonlocal near
        try:
            found = solve_loop(drive, point.scaled(factor), level, rest, near)
        except ConvergenceError:
            return -1.0
        excess = margin(found)
        if excess > 0.0:
            near = found
        return excess

    loop = Loop(drive, point, level, rest)

    def residual(unknowns: Array) -> Array:
        loop.factor = float(unknowns[-1])
        return np.append(loop.residual(unknowns[:-1]), margin(loop.last))

    def from_near(low: float, high: float) -> float | None:
        if drive.tensioner is not None and np.isfinite(drive.tensioner.stops).any():
            return None
        found = root(residual, np.append(loop.start(near), low), tol=1e-9)
        solved = np.abs(found.fun).max() < TOLERANCE and low <= found.x[-1] <= high
        return float(found.x[-1]) if solved else None

    exact = from_near(0.8 * guess, 1.25 * guess) if guess > 0.0 else None
    if exact is not None:
        return exact
    low = high = 1.0
    while margin_at(high) > 0.0:
        low, high = high, 2.0 * high
        if high > LARGEST_FACTOR:
            return math.inf
    while low == high or margin_at(low) <= 0.0:  # the limit is below 1
        low, high = 0.5 * low, low
        if low < SMALLEST_FACTOR:
            return 0.0
    exact = from_near(low, high)
    if exact is not None:
        return exact
    return float(brentq(margin_at, low, high, xtol=TOLERANCE * high, rtol=TOLERANCE))

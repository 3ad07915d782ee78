"""Torque limits of a drive: the end of adhesion, and the onset of unbounded slip."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import brentq

from beltid.drive.loop import LoopState, solve_loop
from beltid.drive.model import DrivePoint
from beltid.drive.results import Simulator
from beltid.drive.string import StringLevel
from beltid.errors import ConvergenceError

TOLERANCE: Final = 2e-5
"""Relative tolerance of a limit of a string."""
ROD_TOLERANCE: Final = 5e-4
"""Relative tolerance of a limit of rods."""
MOST_ROUNDS: Final = 6
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
    """Find the largest factors on the torques of a point, by the method of the simulator.

    Parameters
    ----------
    simulator : Simulator
        Simulator of the drive.
    point : DrivePoint
        Speed, tension and the proportion of the torques, which must not all be zero.

    Raises
    ------
    ConvergenceError
        If rods have no steady state just below a limit.

    Notes
    -----
    Torques without a steady state count as not transmitted: just below gross slip the sliding speed
    grows without bound with the torque. With rods the limit is that of the string with the
    differences of rods and string of a state just below it.
    """
    if point.omega < 0.0:
        return slip_limit(simulator.backwards, point.reversed())
    return SlipLimit(_largest(simulator, point, False), _largest(simulator, point, True))


def _largest(simulator: Simulator, point: DrivePoint, with_slip: bool) -> float:
    """Find the largest factor at which every pulley keeps room for what its forces need."""
    if simulator.method == "string":
        return _of_loop(simulator, point, with_slip, simulator.solve(point.scaled(0.0)).state)
    state, factor = simulator.solve(point.scaled(0.0)).state, 0.0
    for _ in range(MOST_ROUNDS):
        last, factor = factor, _of_loop(simulator, point, with_slip, state)
        if not math.isfinite(factor) or abs(factor - last) <= ROD_TOLERANCE * factor:
            return factor
        for share in (1.0 - ROD_TOLERANCE, 0.98, 0.9):
            try:
                below = simulator.solve(point.scaled(share * factor))
            except ConvergenceError:
                continue
            if below.state.rods:
                state = below.state
                break
        else:
            raise ConvergenceError(f"slip limit near {factor:g} times the torque: no steady state")
    return factor


def _of_loop(
    simulator: Simulator, point: DrivePoint, with_slip: bool, state: LoopState
) -> float:
    """Find the factor with the belt on its pulleys as in a state."""
    drive, rest, level = simulator.drive, simulator.at_rest(point), state.level
    string = StringLevel(drive)
    near = state

    def margin(factor: float) -> float:
        nonlocal near
        try:
            found = solve_loop(drive, point.scaled(factor), level, rest, near)
        except ConvergenceError:
            return -1.0
        if found.slack or found.v0 <= 0.0:
            return -1.0
        needed = found.arcs.needed
        if with_slip:
            forces = zip(found.P_in.tolist(), found.P.tolist(), strict=True)
            needed = [
                string.arcs_by_speed(i, *of_pulley, found.v0).min()
                for i, of_pulley in enumerate(forces)
            ]
        # bounded: the infinite reserve of an idling pulley could not be interpolated
        most = found.arcs.room / np.maximum(needed, found.arcs.room / MOST_RESERVE)
        if most.min() > 1.0:
            near = found
        return float(most.min()) - 1.0

    low, high = 0.0, 1.0
    while margin(high) > 0.0:
        low, high = high, 2.0 * high
        if high > LARGEST_FACTOR:
            return math.inf
    return float(brentq(margin, low, high, xtol=TOLERANCE * high, rtol=TOLERANCE))

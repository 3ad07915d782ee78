"""Limits of a drive: end of adhesion, onset of unbounded slip, belts within their tolerance."""

from __future__ import annotations

import functools
import math
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from beltid.drive.loop import LoopState, solve_loop
from beltid.drive.model import Drive, DrivePoint
from beltid.drive.results import DriveResult
from beltid.drive.simulator import Method, Simulator
from beltid.errors import ConvergenceError, InputError

TOLERANCE = 2e-5  # relative, of a limit of a string
# shares of a limit at which its rods are solved; with whole pulleys sliding the first has none
BELOW = (0.97, 0.9)
STEP = 1.5  # ratio of two factors at which a limit is bracketed
SMALLEST_FACTOR, LARGEST_FACTOR = 2.0**-20, 2.0**20
MOST_RESERVE = 10.0


class SlipLimit(NamedTuple):
    """Torque limits of an operating point, as factors on all of its torques and powers [-]."""

    adhesion: float  # at which the first pulley loses its adhesion arc
    slip: float  # beyond which no steady sliding within the measured speeds transmits them


def slip_limit(simulator: Simulator, point: DrivePoint) -> SlipLimit:
    """Find the largest factors on the torques of a point, which must not all be zero.

    Torques without a steady state count as not transmitted. With rods the limit is that of the
    string with the differences of rods and string of a state just below it.
    """
    if point.omega < 0.0:
        forwards = replace(point.reversed(), omega=-point.omega)
        return slip_limit(simulator.backwards, forwards)
    state, limits = simulator.solve(point.scaled(0.0)).state, [1.0]
    for with_slip in (False, True):
        factor = _of_level(simulator, point, with_slip, state, limits[-1])
        is_found = 0.0 < factor < math.inf
        for share in BELOW[with_slip:] if is_found and simulator.method == "rod" else ():
            with suppress(ConvergenceError):
                below = simulator.solve(point.scaled(share * factor)).state
                if below.rods:
                    state, factor = below, _of_level(simulator, point, with_slip, below, factor)
                    break
        limits.append(factor)
        if not is_found:
            break
    return SlipLimit(limits[1], limits[-1])


def _of_level(
    simulator: Simulator, point: DrivePoint, with_slip: bool, near: LoopState, guess: float
) -> float:
    """Find the factor with the belt on its pulleys as in a state, bracketed about a guess."""
    level = near.level
    rest = replace(simulator.at_rest(point), level=level)

    @functools.cache
    def margin(factor: float) -> float:
        """Room over the arc that is needed, less 1, of the pulley with the least."""
        nonlocal near
        found = None
        with suppress(ConvergenceError):
            found = solve_loop(point.scaled(factor), rest, near)
        if found is None or found.slack or found.v0 <= 0.0:
            return -1.0
        needed = found.arcs.needed
        if with_slip:
            forces = zip(found.P_in.tolist(), found.P.tolist(), strict=True)
            arcs = [level.arcs_by_speed(i, *P, found.v0) for i, P in enumerate(forces)]
            needed = np.array([of_pulley.min() for of_pulley in arcs])
        # bounded: the infinite reserve of an idling pulley could not be interpolated
        most = found.arcs.room / np.maximum(needed, found.arcs.room / MOST_RESERVE)
        if most.min() > 1.0:
            near = found
        return float(most.min()) - 1.0

    low = high = guess
    while margin(high) > 0.0:
        low, high = high, STEP * high
        if high > LARGEST_FACTOR:
            return math.inf
    while low == high or margin(low) <= 0.0:
        low, high = low / STEP, low
        if low < SMALLEST_FACTOR:
            return 0.0
    return float(brentq(margin, low, high, xtol=TOLERANCE * high, rtol=TOLERANCE))


def installed_belts(
    drive: Drive, method: Method, point: DrivePoint, tolerance: float
) -> dict[str, DriveResult]:
    """Solve a point with the shortest, the mean and the longest belt, by a tolerance both ways [m].

    An InputError says that a belt does not fit the pulleys, or that any does.
    """
    if drive.installation == "slack_force":
        raise InputError(
            "drive.belt_length_tolerance_m: must be left out with installation: slack_force"
        )
    mean = Simulator(drive, method).solve(point).rest.belt_length
    lengths = {"min": mean - tolerance, "mean": mean, "max": mean + tolerance}
    return {
        name: Simulator(replace(drive, belt_length=length), method).solve(
            replace(point, T_0=np.nan)
        )
        for name, length in lengths.items()
    }

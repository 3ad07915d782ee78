"""Newton's method for a rod that runs over a pulley, with the forces of both spans given.

Beside the coordinates the stretch and the speed of the pulley are unknown, and with ribs that shear
a number for each zone that sticks: border columns of the banded tangent, which is factorised once.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.rigsim.contact.ribs import Ribs, linearize_with_shear
from beltid.rigsim.banded import factorize, solve
from beltid.rigsim.beam.belt import BeltArrays
from beltid.rigsim.beam.supports import force_change, release
from beltid.rigsim.compiled import allocating_kernel, kernel, leaf
from beltid.rigsim.contact.friction import Certificate, violations
from beltid.rigsim.contact.points import Motion, Points
from beltid.rigsim.model import System, Workspace
from beltid.rigsim.step import force_tolerance, largest_force, linearize, move

Array = NDArray[np.float64]

MOST_ITERATIONS = 60
MOST_WITH_RIBS = 25  # they find their state in a few, or go in circles


class Target(NamedTuple):
    """What is given beside the force of the entering span, as ``weights . force = value`` [N].

    ``force`` (4,) are the forces of both supports. With ``free`` False nothing of the forces is
    given, but the speed of the pulley. ``leaving`` stands for the magnitude of the second force.
    """

    leaving: bool
    weights: Array
    value: float
    free: bool


class FlowOutcome(NamedTuple):
    """How the iteration ended."""

    converged: bool
    iterations: int
    residual: float
    stretch: float
    omega: float
    outside: int


@kernel
def certificate_of(belt: BeltArrays, points: Points) -> Certificate:
    """How far a state breaks the law of friction."""
    return violations(belt, points)


@allocating_kernel
def run_through(
    system: System,
    motion: Motion,
    points: Points,
    ribs: Ribs | None,
    q: Array,
    stretch: float,
    P_in: float,
    target: Target,
    work: Workspace,
) -> FlowOutcome:
    """Newton's method for a belt that runs over the pulley; ``q`` is updated in place.

    Unknown are the coordinates, the stretch, the speed of the pulley, and with ``ribs`` that shear
    the number of each zone that sticks: one factorisation, a right-hand side for each of them.
    """
    tolerance = force_tolerance(system, motion, P_in)
    force = work.reactions.force
    omega, error, zones = motion.omega, math.inf, 0
    most = MOST_ITERATIONS if ribs is None else MOST_WITH_RIBS
    along = np.zeros((2, 4))
    for iteration in range(most):
        now = Motion(omega, 0.0, motion.friction, motion.augmentation, motion.flow)
        if ribs is None:
            outside = linearize(system, now, points, q, q, stretch, work)
        else:
            outside, zones = linearize_with_shear(system, now, points, ribs, q, stretch, work)
        entry = math.hypot(force[0], force[1])
        leave = math.hypot(force[2], force[3])
        got = leave
        for i in range(2):
            along[0, i], along[1, 2 + i] = force[i] / entry, force[2 + i] / leave
        if not target.leaving:
            got = 0.0
            for i in range(4):
                along[1, i] = target.weights[i]
                got += target.weights[i] * force[i]
        missing = target.value - got if target.free else 0.0
        error = max(largest_force(system, work.vectors[0]), abs(P_in - entry), abs(missing))
        if error <= tolerance:
            return FlowOutcome(True, iteration, error / P_in, stretch, omega, outside)
        if not (math.isfinite(error) and factorize(work.A, work.pivots)):
            break
        # what is missing of entry force, target and the numbers of the zones, and in the columns
        # behind it how they change with the unknowns beside the coordinates
        borders = 2 + min(zones, work.steps.shape[0] - 3)
        border = np.zeros((borders, 1 + borders))
        border[0, 0], border[1, 0] = P_in - entry, missing
        for k in range(1 + borders):
            for i in range(q.size):
                work.steps[k, i] = -work.vectors[k, i]
            solve(work.A, work.pivots, work.steps[k])
            sense = -1.0 if k == 0 else 1.0
            for row in range(2):
                for i in range(4):
                    if along[row, i] != 0.0:
                        change = force_change(work.reactions, i, work.steps[k])
                        if k == 1:
                            change += work.reactions.stretch[i]
                        border[row, k] += sense * along[row, i] * change
            if ribs is not None:
                for z in range(borders - 2):
                    change = 0.0
                    for j in range(8):
                        change += ribs.by_q[z, j] * work.steps[k, 4 * ribs.element[z] + j]
                    border[2 + z, k] -= sense * change
        if ribs is not None:
            for z in range(borders - 2):
                border[2 + z, 1] -= ribs.by_stretch[z]
                border[2 + z, 2] -= ribs.by_omega[z]
                border[2 + z, 3 + z] += 1.0
        if not target.free:
            border[1] = 0.0
            border[1, 2] = 1.0
        if not eliminate(border):
            break
        step = work.steps[0]
        for k in range(borders):
            for i in range(q.size):
                step[i] += border[k, 0] * work.steps[1 + k, i]
        release(system.supports, step)
        factor = move(q, step)
        stretch += factor * border[0, 0]
        omega += factor * border[1, 0]
    return FlowOutcome(False, most, error / P_in, stretch, omega, outside)


@leaf
def eliminate(system: Array) -> bool:
    """Solve equations (n, 1 + n), right-hand sides first, which their solution takes the place of.

    Returns whether there is one; Gauss-Jordan with the largest pivot of a column.
    """
    n = system.shape[0]
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(system[i, 1 + k]) > abs(system[pivot, 1 + k]):
                pivot = i
        if not abs(system[pivot, 1 + k]) > 0.0:
            return False
        for j in range(1 + n):
            system[k, j], system[pivot, j] = system[pivot, j], system[k, j]
        scale = 1.0 / system[k, 1 + k]
        for j in range(1 + n):
            system[k, j] *= scale
        for i in range(n):
            factor = system[i, 1 + k]
            if i != k and factor != 0.0:
                for j in range(1 + n):
                    system[i, j] -= factor * system[k, j]
    return True

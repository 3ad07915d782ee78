"""Constrain the belt ends at supports A and B, Eq. (10): fixed, or movable under a given force.

The constraints fix single coordinates (or one combination of two), so ``C_e`` selects rows. The
Lagrange multipliers, which are the support forces, are the residual of the fixed rows.

If a dead weight or a force on the pulley's slide is given, the ends move in fixed directions d by
one unknown ``y`` until the weighted sum of the tensions equals that force. With the tangent K of
the fixed system and the columns K_d of its fixed coordinates, the step is
``dq = dq_held + y z``, ``K z = -K_d``, with y from the change of the given force.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.params import Rig
from beltid.rigsim.banded import HALF, WIDTH, solve
from beltid.rigsim.compiled import leaf, shared_leaf

Array = NDArray[np.float64]

WEIGHTS: Final = {
    "none": (0.0, 0.0),
    "tight": (1.0, 0.0),
    "slack": (0.0, 1.0),
    "hub": (1.0, 1.0),
}
"""Weights of the tensions at A and B in the given force."""


class SupportArrays(NamedTuple):
    """Support conditions: positions are always fixed, directions only if ``clamped``.

    ``directions`` (2, 2) are the unit tangents of the path at A and B. If ``give_way``, the sum of
    the tensions at A and B with the ``weights`` (2,) is given, and A and B move along the rows of
    ``moves`` (2, 2): unit vectors that tighten the belt, or zero.
    """

    clamped: bool
    directions: Array
    give_way: bool
    weights: Array
    moves: Array


class Reactions(NamedTuple):
    """Equations of the fixed positions: A (0, 1) and B (2, 3).

    ``force`` (4,) are the forces of the supports on the belt [N]; ``rows`` (4, WIDTH) are their
    derivatives in the coordinates, ``stretch`` (4,) those in the stretch.
    """

    force: Array
    rows: Array
    stretch: Array


def support_arrays(rig: Rig, beta: float) -> SupportArrays:
    """Build the supports of a rig with the contact arc ``beta`` [rad] for compiled code."""
    along, down = math.cos(0.5 * beta), math.sin(0.5 * beta)
    directions = np.array([[along, down], [along, -down]])
    moves = np.zeros((2, 2))
    if rig.given_force == "tight":
        moves[0] = -directions[0]
    elif rig.given_force == "slack":
        moves[1] = directions[1]
    elif rig.given_force == "hub":
        moves[:, 1] = -1.0  # relative to the pulley, which stays at the origin
    return SupportArrays(
        clamped=rig.supports == "clamped",
        directions=directions,
        give_way=rig.given_force != "none",
        weights=np.array(WEIGHTS[rig.given_force]),
        moves=moves,
    )


def new_reactions() -> Reactions:
    """Allocate the reactions of one rig."""
    return Reactions(np.zeros(4), np.zeros((4, WIDTH)), np.zeros(4))


@leaf
def held_row(i: int, n: int) -> int:
    """Return the index of the coordinate fixed by reaction ``i`` of 0..3, of ``n`` coordinates."""
    return i if i < 2 else n - 6 + i


@leaf
def _turn(A: Array, vectors: Array, first: int, cosine: float, sine: float) -> None:
    """Rotate coordinates (first, first + 1) of matrix and vectors (m, n) to (along, across)."""
    n = A.shape[0]
    a, b = first, first + 1
    for i in range(max(0, b - HALF), min(n, a + HALF + 1)):
        ca, cb = HALF + a - i, HALF + b - i
        x, y = A[i, ca], A[i, cb]
        A[i, ca], A[i, cb] = cosine * x + sine * y, -sine * x + cosine * y
    for j in range(max(0, b - HALF), min(n, a + HALF + 1)):
        ra, rb = HALF + j - a, HALF + j - b
        x, y = A[a, ra], A[b, rb]
        A[a, ra], A[b, rb] = cosine * x + sine * y, -sine * x + cosine * y
    for i in range(vectors.shape[0]):
        x, y = vectors[i, a], vectors[i, b]
        vectors[i, a], vectors[i, b] = cosine * x + sine * y, -sine * x + cosine * y


@leaf
def _fix(A: Array, vectors: Array, row: int) -> None:
    """Replace one equation by a zero change of its coordinate."""
    for j in range(max(0, row - HALF), min(A.shape[0], row + HALF + 1)):
        A[j, HALF + row - j] = 0.0
    for j in range(WIDTH):
        A[row, j] = 0.0
    A[row, HALF] = 1.0
    for i in range(vectors.shape[0]):
        vectors[i, row] = 0.0


@leaf
def hold(supports: SupportArrays, A: Array, vectors: Array, reactions: Reactions) -> None:
    """Apply the constraints to tangent and right-hand sides, and save the fixed rows.

    Parameters
    ----------
    supports : SupportArrays
        Support conditions.
    A : ndarray, shape (n, WIDTH)
        Banded tangent.
    vectors : ndarray, shape (2, n)
        Residual and its derivative in the stretch.
    reactions : Reactions
        Output.
    """
    n = A.shape[0]
    if supports.clamped:
        for end in range(2):
            first = 2 if end == 0 else n - 2
            _turn(A, vectors, first, supports.directions[end, 0], supports.directions[end, 1])
    for i in range(4):
        row = held_row(i, n)
        reactions.force[i] = vectors[0, row]
        reactions.stretch[i] = vectors[1, row]
        for j in range(WIDTH):
            reactions.rows[i, j] = A[row, j]
    for i in range(4):
        _fix(A, vectors, held_row(i, n))
    if supports.clamped:
        for row in (3, n - 1):
            _fix(A, vectors, row)


@shared_leaf
def restrain(supports: SupportArrays, vector: Array) -> None:
    """Constrain one more right-hand side (n,) as :func:`hold` does; fixed rows become zero."""
    n = vector.size
    if supports.clamped:
        for end in range(2):
            a = 2 if end == 0 else n - 2
            cosine, sine = supports.directions[end, 0], supports.directions[end, 1]
            x, y = vector[a], vector[a + 1]
            vector[a], vector[a + 1] = cosine * x + sine * y, 0.0
    for i in range(4):
        vector[held_row(i, n)] = 0.0


@shared_leaf
def release(supports: SupportArrays, step: Array) -> None:
    """Rotate the solution (n,) of the constrained system back to nodal coordinates."""
    if supports.clamped:
        n = step.size
        for end in range(2):
            a = 2 if end == 0 else n - 2
            cosine, sine = supports.directions[end, 0], supports.directions[end, 1]
            u, w = step[a], step[a + 1]
            step[a], step[a + 1] = cosine * u - sine * w, sine * u + cosine * w


@leaf
def force_change(reactions: Reactions, i: int, step: Array) -> float:
    """Return the change of reaction ``i`` [N] for the solution ``step`` (n,)."""
    n = step.size
    row = held_row(i, n)
    total = 0.0
    for j in range(max(0, row - HALF), min(n, row + HALF + 1)):
        total += reactions.rows[i, HALF + j - row] * step[j]
    return total


@leaf
def tension_change(reactions: Reactions, end: int, step: Array) -> float:
    """Return the change of the tension at an end, 0 (A) or 1 (B), for the ``step`` (n,) [N]."""
    x, y = reactions.force[2 * end], reactions.force[2 * end + 1]
    by_x, by_y = force_change(reactions, 2 * end, step), force_change(reactions, 2 * end + 1, step)
    return (x * by_x + y * by_y) / math.hypot(x, y)


@leaf
def missing_force(supports: SupportArrays, reactions: Reactions, T_0: float) -> float:
    """Return the given force (tension ``T_0`` in both spans) minus the present force [N]."""
    missing = 0.0
    for end in range(2):
        T = math.hypot(reactions.force[2 * end], reactions.force[2 * end + 1])
        missing += supports.weights[end] * (T_0 - T)
    return missing


@shared_leaf
def unit_movement(
    supports: SupportArrays,
    reactions: Reactions,
    A: Array,
    pivots: NDArray[np.int64],
    movement: Array,
) -> None:
    """Solve the constrained, factorised system for ends that move by 1 m: ``movement`` (n,).

    No contact reaches the ends, so the columns of the fixed coordinates equal their rows.
    """
    n = movement.size
    for j in range(n):
        movement[j] = 0.0
    for i in range(4):
        row = held_row(i, n)
        for j in range(max(0, row - HALF), min(n, row + HALF + 1)):
            movement[j] -= supports.moves[i // 2, i % 2] * reactions.rows[i, HALF + j - row]
    for i in range(4):
        movement[held_row(i, n)] = 0.0
    if supports.clamped:
        movement[3] = movement[n - 1] = 0.0
    solve(A, pivots, movement)
    for i in range(4):
        movement[held_row(i, n)] = supports.moves[i // 2, i % 2]


@shared_leaf
def give_way(
    supports: SupportArrays, reactions: Reactions, movement: Array, change: float, step: Array
) -> None:
    """Add end movement to ``step`` (n,) until the given force changes by ``change`` [N]."""
    by_step = by_movement = 0.0
    for end in range(2):
        by_step += supports.weights[end] * tension_change(reactions, end, step)
        by_movement += supports.weights[end] * tension_change(reactions, end, movement)
    moved = (change - by_step) / by_movement
    for j in range(step.size):
        step[j] += moved * movement[j]

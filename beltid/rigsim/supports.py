"""Supports A and B as constraints of Eq. (10): belt ends that stay in place.

The constraints hold coordinates (or one combination of two), so ``C_e`` selects rows: the Lagrange
multipliers, that is the support forces, are the residual of the held rows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.rigsim.banded import HALF, WIDTH
from beltid.rigsim.compiled import kernel, leaf

Array = NDArray[np.float64]


class SupportArrays(NamedTuple):
    """How the ends are held: positions always; directions too if ``clamped``.

    ``directions`` (2, 2) are the unit tangents of the path at A and B.
    """

    clamped: bool
    directions: Array


class Reactions(NamedTuple):
    """Rows of the held positions: A (0, 1) and B (2, 3).

    ``force`` (4,) are the forces of the belt on the supports with reversed sign [N]; ``rows``
    (4, WIDTH) and ``stretch`` (4,) their derivatives.
    """

    force: Array
    rows: Array
    stretch: Array


def new_reactions() -> Reactions:
    """Room for the reactions of one rig."""
    return Reactions(np.zeros(4), np.zeros((4, WIDTH)), np.zeros(4))


@kernel
def held_row(i: int, n: int) -> int:
    """Coordinate that reaction ``i`` of 0..3 belongs to, for ``n`` coordinates."""
    return i if i < 2 else n - 6 + i


@leaf
def _turn(A: Array, vectors: Array, first: int, cosine: float, sine: float) -> None:
    """Turn coordinates (first, first + 1) of matrix and vectors (m, n) to (along, across)."""
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


@kernel
def _fix(A: Array, vectors: Array, row: int) -> None:
    """Replace one equation by "this coordinate does not move"."""
    for j in range(max(0, row - HALF), min(A.shape[0], row + HALF + 1)):
        A[j, HALF + row - j] = 0.0
    for j in range(WIDTH):
        A[row, j] = 0.0
    A[row, HALF] = 1.0
    for i in range(vectors.shape[0]):
        vectors[i, row] = 0.0


@leaf
def hold(supports: SupportArrays, A: Array, vectors: Array, reactions: Reactions) -> None:
    """Apply the constraints to tangent and right-hand sides, and keep the held rows.

    Parameters
    ----------
    supports : SupportArrays
        How the ends are held.
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


@kernel
def restrain(supports: SupportArrays, vector: Array) -> None:
    """Turn further right-hand sides (n,) like those of :func:`hold`; held rows become zero."""
    n = vector.size
    if supports.clamped:
        for end in range(2):
            a = 2 if end == 0 else n - 2
            cosine, sine = supports.directions[end, 0], supports.directions[end, 1]
            x, y = vector[a], vector[a + 1]
            vector[a], vector[a + 1] = cosine * x + sine * y, 0.0
    for i in range(4):
        vector[held_row(i, n)] = 0.0


@kernel
def release(supports: SupportArrays, step: Array) -> None:
    """Turn the solution (n,) of the held system back to nodal coordinates."""
    if supports.clamped:
        n = step.size
        for end in range(2):
            a = 2 if end == 0 else n - 2
            cosine, sine = supports.directions[end, 0], supports.directions[end, 1]
            u, w = step[a], step[a + 1]
            step[a], step[a + 1] = cosine * u - sine * w, sine * u + cosine * w


@kernel
def force_change(reactions: Reactions, i: int, step: Array) -> float:
    """Change of reaction ``i`` with the held system's solution ``step`` (n,) [N]."""
    n = step.size
    row = held_row(i, n)
    total = 0.0
    for j in range(max(0, row - HALF), min(n, row + HALF + 1)):
        total += reactions.rows[i, HALF + j - row] * step[j]
    return total

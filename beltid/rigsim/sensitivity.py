"""Differentiate the sliding state with respect to the friction surface, implicitly.

In the sliding state ``r(q, mu_1 ... mu_m) = 0``, where mu_i is the coefficient of friction of
look-up i. With the tangent K, which includes the change of mu with the force, and a tension T that
depends on q through the fixed rows,

    dT/dmu_i = a . (W_T F_N)_i,   K^T a = dT/dq.

At the fixed coordinates a is minus the direction of the tension: the belt does not carry friction
that acts directly on a support. One solve with the transposed tangent gives the derivatives of both
tensions with respect to mu of every look-up; for any parameter p of the surface
``dT/dp = sum_i dT/dmu_i dmu(f_i, v)/dp``.

If a force ``w.T`` is given, the ends move by y in the directions d of the fixed coordinates. With
the columns K_d of the tangent at these coordinates, the derivatives T_y of the tensions with
respect to y, and the derivatives dT for fixed ends,

    dT_given = dT - T_y (w.dT)/(w.T_y),   T_y = dT/dq_held . d - a . K_d d.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgbsv

from beltid.errors import ConvergenceError
from beltid.rigsim.banded import HALF
from beltid.rigsim.beam.supports import held_row, release
from beltid.rigsim.contact.points import Points
from beltid.rigsim.model import RigModel
from beltid.rigsim.steady import StaticState

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TensionSensitivity:
    """Derivatives of the tensions with respect to mu at the look-ups of the touching points.

    Attributes
    ----------
    normal_force_N_m : ndarray, shape (m,)
        Line forces at which mu is looked up [N/m].
    tension_tight_N, tension_slack_N : ndarray, shape (m,)
        Derivatives of the tensions with respect to mu of the look-up [N].
    """

    normal_force_N_m: Array
    tension_tight_N: Array
    tension_slack_N: Array


def tension_sensitivity(model: RigModel, sliding: StaticState) -> TensionSensitivity:
    """Compute the derivatives of both tensions in mu at every look-up of a sliding state.

    Raises
    ------
    ConvergenceError
        If the tangent is singular.
    """
    supports, points, work = model.system.supports, sliding.points, sliding.work
    n = sliding.q.size
    held = [held_row(i, n) for i in range(4)]
    fixed = [*held, 3, n - 1] if supports.clamped else held
    rows = _full_rows(work.reactions.rows, held, n)
    force = sliding.force.reshape(2, 2)
    along = force / np.linalg.norm(force, axis=1, keepdims=True)
    gradient = np.stack([along[0] @ rows[:2], along[1] @ rows[2:]])
    free = gradient.copy()
    free[:, fixed] = 0.0
    # row i of the storage is column i of the transposed matrix in LAPACK's band layout
    transposed = np.zeros((3 * HALF + 1, n), order="F")
    transposed[HALF:] = work.A[:, : 2 * HALF + 1].T
    _, _, solution, singular = dgbsv(HALF, HALF, transposed, free.T, overwrite_ab=True)
    if singular:
        raise ConvergenceError("the tangent of the sliding state is singular")
    adjoint = solution.T
    moves = supports.moves.ravel()
    load = moves @ rows  # no contact reaches the ends: the columns K_d equal the rows
    load[fixed] = 0.0
    by_movement = gradient[:, held] @ moves - adjoint @ load
    touching = points.F_N > 0.0
    tensions = np.empty((2, 2 * np.count_nonzero(touching)))
    for end in (0, 1):
        a = adjoint[end].copy()
        release(supports, a)
        # on a very short span the element at a support touches: its friction acts on the support
        a[held[2 * end : 2 * end + 2]] = -along[end]
        tensions[end] = _along_friction(model.system.belt.N_c, points, a)[touching].ravel()
    if supports.give_way:
        moved = supports.weights @ tensions / (supports.weights @ by_movement)
        tensions -= np.outer(by_movement, moved)
    return TensionSensitivity(points.f_look[touching].ravel(), tensions[0], tensions[1])


def _full_rows(rows: Array, held: list[int], n: int) -> Array:
    """Expand the rows of the fixed coordinates from banded storage (4, WIDTH) to (4, n)."""
    full = np.zeros((4, n))
    for i, row in enumerate(held):
        first, last = max(0, row - HALF), min(n, row + HALF + 1)
        full[i, first:last] = rows[i, HALF + first - row : HALF + last - row]
    return full


def _along_friction(N_c: Array, points: Points, adjoint: Array) -> Array:
    """Multiply the adjoint (n,) by the friction forces per mu; shape (n_e, n_c, 2)."""
    nodes = adjoint.reshape(-1, 2, 2)
    at_elements = np.concatenate([nodes[:-1], nodes[1:]], axis=1)
    at_points = np.einsum("ecj,ejk->eck", N_c, at_elements)
    along = at_points[..., 0] * np.cos(points.theta) - at_points[..., 1] * np.sin(points.theta)
    return np.asarray(along[..., None] * points.F_look)

"""Sensitivities of the sliding state to the friction surface, by implicit differentiation.

In the sliding state ``r(q, mu_1 ... mu_m) = 0``, where mu_i is the coefficient of friction of
look-up i. With the tangent K, which holds the change of mu with the force, and a tension T
that depends on q through the held rows,

    dT/dmu_i = a . (W_T F_N)_i,   K^T a = dT/dq.

At the held coordinates a is minus the direction of the tension: friction that acts on a support
itself is not carried by the belt. Two transposed solves with the factors of the tangent give both
tensions' derivatives with respect to mu of every look-up; any parameter p of the surface follows
by ``dT/dp = sum_i dT/dmu_i dmu(f_i, v)/dp``.

Where a force ``w.T`` is given, the ends give way by y. With the derivatives T_y of the tensions
with respect to y, and dT that of held ends,

    dT_given = dT - T_y (w.dT)/(w.T_y).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.errors import ConvergenceError
from beltid.rigsim.banded import HALF, factorize, solve_transposed
from beltid.rigsim.beam.supports import held_row, release, tension_change, unit_movement
from beltid.rigsim.contact.points import Motion, Points
from beltid.rigsim.model import RigModel
from beltid.rigsim.steady import StaticState, linearize

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
    """Sensitivities of both tensions to mu at every look-up of a sliding state.

    Raises
    ------
    ConvergenceError
        If the tangent is singular.
    """
    system, work = model.system, model.workspace()
    motion = Motion(omega=model.point.omega, rate=0.0, friction=1.0, augmentation=0.0)
    points = sliding.points
    linearize(system, motion, points, sliding.q, sliding.q, sliding.stretch, work)
    if not factorize(work.A, work.pivots):
        raise ConvergenceError("the tangent of the sliding state is singular")
    touching = points.F_N > 0.0
    held = []
    for first in (0, 2):
        adjoint = _tension_gradient(work.reactions.rows, work.reactions.force, first, model)
        solve_transposed(work.A, work.pivots, adjoint)
        release(system.supports, adjoint)
        # on a very short span the element at a support touches: its friction acts on the support
        force = work.reactions.force
        for i in (first, first + 1):
            along = force[i] / math.hypot(force[first], force[first + 1])
            adjoint[held_row(i, adjoint.size)] = -along
        held.append(_along_friction(system.belt.N_c, points, adjoint)[touching].ravel())
    tensions = np.array(held)
    supports, reactions, movement = system.supports, work.reactions, work.steps[-1]
    if supports.give_way:
        unit_movement(supports, reactions, work.A, work.pivots, movement)
        by_movement = np.array([tension_change(reactions, end, movement) for end in (0, 1)])
        moved = supports.weights @ tensions / (supports.weights @ by_movement)
        tensions -= np.outer(by_movement, moved)
    return TensionSensitivity(points.f_look[touching].ravel(), tensions[0], tensions[1])


def _tension_gradient(rows: Array, force: Array, first: int, model: RigModel) -> Array:
    """Derivative of a support force's magnitude with respect to the coordinates, shape (n,)."""
    n = 4 * model.nodes.size
    size = math.hypot(force[first], force[first + 1])
    gradient = np.zeros(n)
    for i in (first, first + 1):
        row = held_row(i, n)
        for j in range(max(0, row - HALF), min(n, row + HALF + 1)):
            gradient[j] += force[i] / size * rows[i, HALF + j - row]
    # the held coordinates do not move
    for i in range(4):
        gradient[held_row(i, n)] = 0.0
    if model.system.supports.clamped:
        gradient[[3, n - 1]] = 0.0
    return gradient


def _along_friction(N_c: Array, points: Points, adjoint: Array) -> Array:
    """Products of the adjoint (n,) with the friction forces per mu, shape (n_e, n_c, 2)."""
    nodes = adjoint.reshape(-1, 2, 2)
    of_element = np.concatenate([nodes[:-1], nodes[1:]], axis=1)
    at_points = np.einsum("ecj,ejk->eck", N_c, of_element)
    along = at_points[..., 0] * np.cos(points.theta) - at_points[..., 1] * np.sin(points.theta)
    return np.asarray(along[..., None] * points.F_look)

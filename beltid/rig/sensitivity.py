"""Differentiate the tensions of the discrete rig by its friction, exactly, by the adjoint.

In an equilibrium the residual r(q; p) vanishes at the free coordinates and is the support force at
the held ones, whose magnitudes are the tensions T. With the tangent K, which contains the change of
mu with the force, and the directions t of the support forces,

    dT/dp = -a . dr/dp,   K_free' a_free = (dT/dq)_free,   a_held = -t.

One solve with the transposed tangent gives the derivatives of a tension in mu of every point. If a
force ``w.T = W`` is given, the ends move by y, of which the tensions have the derivatives T_y:

    dT_given = dT - T_y (w.dT)/(w.T_y).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, solve_banded

from beltid.errors import ConvergenceError
from beltid.rig.banded import HALF
from beltid.rig.contact import Motion
from beltid.rig.model import RigModel
from beltid.rig.newton import assemble, hold
from beltid.rig.steady import StaticState

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
    a, points, touching = _adjoint(model, sliding), sliding.points, sliding.touching
    nodes = a.reshape(2, -1, 2, 2)
    elements = np.concatenate([nodes[:, :-1], nodes[:, 1:]], axis=2)
    at = np.einsum("ecj,tejk->teck", model.system.mesh.N, elements)
    theta = points["theta"]
    along = at[..., 0] * np.cos(theta) - at[..., 1] * np.sin(theta)
    tight, slack = (along * points["F_N"])[:, touching]
    return TensionSensitivity(points["f_N"][touching], tight, slack)


def _adjoint(model: RigModel, sliding: StaticState) -> Array:
    """Return a (2, n) of both tensions; the derivative in a parameter is ``-a @ dr/dp``."""
    s, border = model.state(), model.border
    s.q[:], s.u[:] = sliding.q, (sliding.stretch, 0.0)
    assemble(model.system, Motion(0.0, model.point.omega, 1.0, 0.0, 0.0), s, False)
    hold(s, border.moves)
    n = s.q.size
    held = np.array([0, 1, n - 4, n - 3])
    t, rows = np.zeros((2, 4)), np.zeros((4, n))
    t[0, :2], t[1, 2:] = s.force[:2] / sliding.T_A, s.force[2:] / sliding.T_B
    for i, row in enumerate(held.tolist()):
        first, last = max(0, row - HALF), min(n, row + HALF + 1)
        rows[i, first:last] = s.rows[i, HALF + first - row : HALF + last - row]
    by_q = t @ rows
    by_q[:, held] = 0.0
    try:  # row i of the storage is column i of the transposed matrix
        a = solve_banded((HALF, HALF), s.A[:, : 2 * HALF + 1].T, by_q.T).T
    except LinAlgError:
        raise ConvergenceError("the tangent of the sliding state is singular") from None
    a[:, held] = -t
    if border.kinds.size:
        by_movement = s.columns[1].copy()
        by_movement[held] = s.kept[1]
        T_y, w = -a @ by_movement, border.weights[0]
        a = a - np.outer(T_y / (w @ T_y), w @ a)
    return np.asarray(a)

"""Differentiate the tensions of the discrete rig exactly, by its adjoint.

In an equilibrium the residual r(q; p) vanishes at the free coordinates and is the support force at
the held ones, whose magnitudes are the tensions T. With the tangent K, which contains the change of
mu with the force, and the directions t of the support forces,

    dT/dp = -a . dr/dp,   K_free' a_free = (dT/dq)_free,   a_held = -t.

One solve with the transposed tangent gives the derivatives of a tension in every parameter. If a
force ``w.T = W`` is given, the ends move by y, of which the tensions have the derivatives T_y:

    dT_given = dT + T_y (dW - w.dT)/(w.T_y).

A parameter of belt, rig or laws acts twice: on the belt that is laid on, whose stretch follows from
T_A = T_0, and on the sliding one, also through that stretch. For these, dr/dp is a difference of
residuals at the same coordinates on the same mesh, moved with the path; no solution is repeated.
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
from beltid.rig.newton import State, assemble, hold
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


class Adjoint:
    """The derivatives of both tensions in an equilibrium.

    Parameters
    ----------
    model : RigModel
        The rig.
    state : StaticState
        Its equilibrium: laid on (without friction), or sliding.
    share : float
        Share of the friction that acts: 0 laid on, 1 sliding.

    Attributes
    ----------
    a : ndarray, shape (2, n)
        Adjoint of T_A and T_B; the derivative in a parameter is ``-a @ dr/dp``.
    by_given : ndarray, shape (2,)
        Derivative of the tensions in a given force [-]; zero if none is given.
    r_s : ndarray, shape (n,)
        Derivative of the residual in the stretch [N].

    Raises
    ------
    ConvergenceError
        If the tangent is singular.
    """

    def __init__(self, model: RigModel, state: StaticState, share: float) -> None:
        self.model, self.state, self.share = model, state, share
        s = self._assembled(model, state.q)
        n = s.q.size
        held = np.array([0, 1, n - 4, n - 3])
        self.r_s = s.columns[0].copy()
        border, weights = model.border, model.border.weights
        hold(s, border.moves, False)
        t = np.zeros((2, 4))
        t[0, :2], t[1, 2:] = s.force[:2] / state.T_A, s.force[2:] / state.T_B
        by_q = t @ _full_rows(s.rows, held)
        by_q[:, held] = 0.0
        try:
            # row i of the storage is column i of the transposed matrix
            self.a = solve_banded((HALF, HALF), s.A[:, : 2 * HALF + 1].T, by_q.T).T
        except LinAlgError:
            raise ConvergenceError("the tangent of the sliding state is singular") from None
        self.a[:, held] = -t
        self.by_given = np.zeros(2)
        if border.kinds.size and share:
            by_movement = s.columns[1].copy()
            by_movement[held] = s.kept[1]
            T_y = -self.a @ by_movement
            self.by_given = T_y / (weights[0] @ T_y)
            self.a = self.a - np.outer(self.by_given, weights[0] @ self.a)

    def _assembled(self, model: RigModel, q: Array) -> State:
        """Assemble a rig at coordinates ``q``."""
        s = model.state()
        s.q[:], s.u[:] = q, (self.state.stretch, 0.0)
        motion = Motion(0.0, model.point.omega, self.share, 0.0, 0.0)
        assemble(model.system, motion, s, False)
        return s

    def residual(self, other: RigModel) -> Array:
        """Return the residual (n,) of a rig that differs a little, moved with its path."""
        model, moved = self.model, self.state.moved
        q = self.state.q + other.path_coordinates() - model.path_coordinates()
        q[[0, 1, -4, -3]] += moved * (other.border.moves - model.border.moves)
        return self._assembled(other, q).r


class Response:
    """The first-order change of the sliding tensions with any parameter of bench and run.

    Parameters
    ----------
    model : RigModel
        The rig.
    laid, sliding : StaticState
        The belt laid on and tightened, and the sliding limit.
    """

    def __init__(self, model: RigModel, laid: StaticState, sliding: StaticState) -> None:
        self.laid, self.sliding = Adjoint(model, laid, 0.0), Adjoint(model, sliding, 1.0)

    def change(self, less: RigModel, more: RigModel) -> Array:
        """Return the change of T_A and T_B [N] from one to another model, first order.

        Parameters
        ----------
        less, more : RigModel
            The rig with a parameter a little smaller and larger, on the mesh of this one
            (:meth:`beltid.rig.model.Bench.model` with ``mesh``).
        """
        laid, sliding = self.laid, self.sliding
        residual = laid.residual(more) - laid.residual(less)
        T_0 = more.point.T_0 - less.point.T_0
        stretch = -(T_0 + laid.a[0] @ residual) / (laid.a[0] @ laid.r_s)
        residual = sliding.residual(more) - sliding.residual(less) + sliding.r_s * stretch
        given = np.sum(more.border.given) - np.sum(less.border.given)
        return np.asarray(-sliding.a @ residual + sliding.by_given * given)


def tension_sensitivity(model: RigModel, sliding: StaticState) -> TensionSensitivity:
    """Compute the derivatives of both tensions in mu at every look-up of a sliding state.

    Raises
    ------
    ConvergenceError
        If the tangent is singular.
    """
    a, points, touching = Adjoint(model, sliding, 1.0).a, sliding.points, sliding.touching
    nodes = a.reshape(2, -1, 2, 2)
    elements = np.concatenate([nodes[:, :-1], nodes[:, 1:]], axis=2)
    at = np.einsum("ecj,tejk->teck", model.system.mesh.N, elements)
    theta = points["theta"]
    along = at[..., 0] * np.cos(theta) - at[..., 1] * np.sin(theta)
    tight, slack = (along * points["F_N"])[:, touching]
    return TensionSensitivity(points["f_N"][touching], tight, slack)


def _full_rows(rows: Array, held: NDArray[np.intp]) -> Array:
    """Expand the rows of the held coordinates from banded storage (4, WIDTH) to (4, n)."""
    n = int(held[-1]) + 3
    full = np.zeros((4, n))
    for i, row in enumerate(held.tolist()):
        first, last = max(0, row - HALF), min(n, row + HALF + 1)
        full[i, first:last] = rows[i, HALF + first - row : HALF + last - row]
    return full

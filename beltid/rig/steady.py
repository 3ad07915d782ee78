"""Solve the statics of the rig: the belt laid on and tightened to T_0, and full sliding.

The lay-on is frictionless; its unknowns are the coordinates and the stretch, its border is
|support force| = T_0, so the belt is tightened with the contact in place (a pre-strain T_0/EA alone
would miss T_0 by 5 to 10 %). Then the stretch is constant, the pulley turns, and every touching
point slides; the supports are fixed, or move until the given force acts.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, solve_banded

from beltid.errors import ConvergenceError, NumericsError
from beltid.params import OperatingPoint
from beltid.rig.banded import HALF
from beltid.rig.forces import Motion, State
from beltid.rig.model import LARGEST_STRAIN, RigModel
from beltid.rig.newton import MOST_ITERATIONS, Border, assemble, equilibrium, hold

Array = NDArray[np.float64]

# sequences of tensions over T_0, and of shares of the friction; if one fails, the next is tried
DETOURS = ((1.0,), (2.0, 1.0), (8.0, 4.0, 2.0, 1.4, 1.0))
STAGES = tuple(tuple(k / n for k in range(1, n + 1)) for n in (1, 4, 16, 64))
DEEPEST = 0.1  # largest plausible penetration over the radius


def lay_on(model: RigModel) -> State:
    """Lay the belt on the pulley without friction and tighten it until the support force is T_0.

    A ConvergenceError says that there is no equilibrium, also when T_0 is approached from higher
    tensions; a NumericsError that it is meaningless.
    """
    T_0 = model.point.T_0
    by_stretch = np.array([[1.0, 0.0], [0.0, 0.0]])
    stages = [
        [(0.0, Border(by_stretch, np.array([k * T_0, 0.0]), np.zeros(4))) for k in factors]
        for factors in DETOURS
    ]
    stretch = 1.0 / (1.0 + T_0 / model.system.belt.EA)
    on_path = model.path.coordinates(model.nodes).ravel()
    return _approach(model, on_path, stretch, stages, "laying the belt on")


def slide(model: RigModel, laid: State) -> State:
    """Turn the pulley under the laid-on belt until every touching point slides; as `lay_on`."""
    stages = [[(share, model.border) for share in shares] for shares in STAGES]
    return _approach(model, laid.q, float(laid.u[0]), stages, "the sliding belt")


def _approach(
    model: RigModel,
    start: Array,
    stretch: float,
    sequences: list[list[tuple[float, Border]]],
    aim: str,
) -> State:
    """Find an equilibrium through one of the sequences of friction shares and borders."""
    s, spent, residual = State.of(model.system.mesh), 0, math.inf
    for sequence in sequences:
        s.q_old[:], s.u[:] = start, (stretch, 0.0)
        for share, border in sequence:
            motion = Motion(0.0, model.point.omega, share)
            count, residual = equilibrium(model.system, motion, border, s, MOST_ITERATIONS)
            spent += count if count >= 0 else MOST_ITERATIONS
            if count < 0:
                break
            s.q_old[:] = s.q
        else:
            _check_plausible(model, s)
            return s
    raise ConvergenceError(
        f"{describe(model.point)}: {aim} found no equilibrium in {spent} Newton iterations "
        f"(residual {residual:.2g} of T0)",
    )


def _check_plausible(model: RigModel, s: State) -> None:
    """Raise a NumericsError if the equilibrium is physically meaningless."""
    R, largest = model.path.R, max(s.T_A, s.T_B)
    depth = R - float(s.now["rho"].min())
    for is_wrong, problem in (
        (not s.touching.any(), "the belt does not touch the pulley"),
        (
            depth > DEEPEST * R,
            f"the belt sinks {1e3 * depth:.3g} mm into the pulley, must be below {DEEPEST:.0%} of "
            "its radius: contact law too soft or tension too high",
        ),
        (
            largest > LARGEST_STRAIN * model.system.belt.EA,
            f"a tension of {largest:.4g} N stretches the belt by more than {LARGEST_STRAIN:.0%}",
        ),
    ):
        if is_wrong:
            raise NumericsError(f"{describe(model.point)}: {problem}")


def describe(point: OperatingPoint) -> str:
    """Describe the settings of a run for messages."""
    return f"arc {math.degrees(point.beta):g} deg, T0 {point.T_0:g} N, omega {point.omega:g} rad/s"


def tension_sensitivity(model: RigModel, sliding: State) -> tuple[Array, Array, Array]:
    """Differentiate both tensions of a sliding state by mu at every look-up, by the adjoint.

    In an equilibrium the residual r(q; p) vanishes at the free coordinates and is the support force
    at the held ones, whose magnitudes are the tensions T. With the tangent K, which contains the
    change of mu with the force, and the directions t of the support forces,

        dT/dp = -a . dr/dp,   K_free' a_free = (dT/dq)_free,   a_held = -t.

    If a force ``w.T = W`` is given, the ends move by y, of which the tensions have the derivatives
    T_y: ``dT_given = dT - T_y (w.dT)/(w.T_y)``. Returned are the line forces at which mu is looked
    up [N/m], and the derivatives of tight and slack tension by mu there [N], shapes (m,). A
    ConvergenceError says that the tangent is singular.
    """
    s, border = State.of(model.system.mesh), model.border
    s.q[:], s.u[:] = sliding.q, (sliding.u[0], 0.0)
    assemble(model.system, Motion(0.0, model.point.omega), s, False)
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
    if border.weights.any():
        by_movement = s.columns[1].copy()
        by_movement[held] = s.kept[1]
        T_y, w = -a @ by_movement, border.weights[1]
        a = a - np.outer(T_y / (w @ T_y), w @ a)
    nodes, points, touching = a.reshape(2, -1, 2, 2), sliding.now, sliding.touching
    elements = np.concatenate([nodes[:, :-1], nodes[:, 1:]], axis=2)
    at = np.einsum("ecj,tejk->teck", model.system.mesh.N, elements)
    theta = points["theta"]
    along = at[..., 0] * np.cos(theta) - at[..., 1] * np.sin(theta)
    tight, slack = (along * points["F_N"])[:, touching]
    return points["f_N"][touching], tight, slack

"""Newton's method for one equilibrium of the rig, and the march through many in time.

The coordinates of the supports are held; the force of a support is the residual of its rows, Eq.
(10). A boundary that gives a force in place of a position is a *border*: one more unknown, which
has a column in the tangent, and one more equation, on the forces T_A and T_B of the two spans:

======================  =========================  ============================
Boundary                Unknown                    Equation
======================  =========================  ============================
belt tightened          stretch                    T_A = T_0
dead weight             movement of that end       T_A = W, or T_B = W
force on the hub        movement of both ends      T_A + T_B = H
belt flowing (a drive)  stretch, speed of pulley   T_A = P_in, T_B = P_out
======================  =========================  ============================
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.arrays import Array
from beltid.params import Belt
from beltid.rig.banded import HALF, factorize, kernel, solve
from beltid.rig.forces import Motion, Pulley, State, add_belt, add_contact, add_inertia
from beltid.rig.mesh import Mesh

TOLERANCE = 1.0e-9  # residual force over T_A [-]
ROUNDING = 1.0e-13  # of positions over R [-]
LONGEST_STEP = 0.1  # of an iteration: positions over R, gradients [-]
MOST_ITERATIONS, MOST_IN_TIME, MOST_HALVINGS = 60, 30, 10
PATIENCE, SLIPS_BACK, CIRCLES = 15, 1.0e-13, 1.0e-9  # iterations; slip back in a step [m], then


class System(NamedTuple):
    """The rig for compiled code.

    ``clamp`` is the rotational stiffness of the ends [N m] (0: pinned), ``across`` (2, 2) the
    normals of the path at A and B, against which it turns them back; ``h_min`` [m] is the length of
    the shortest element.
    """

    mesh: Mesh
    belt: Belt
    pulley: Pulley
    clamp: float
    across: Array
    h_min: float


class Border(NamedTuple):
    """Boundaries: equations ``weights @ (T_A, T_B) = given`` for up to two unknowns.

    Unknown 0 is the stretch; unknown 1 is the speed of the pulley if the belt flows, else the
    movement of the held coordinates (x, y of A, then of B) by ``moves`` (4,). An unknown whose row
    of ``weights`` (2, 2) is zero is given itself.
    """

    weights: Array
    given: Array
    moves: Array


STEP = np.dtype(
    [  # of a march
        ("dt", float),  # duration [s], given
        ("omega", float),  # speed of the pulley [rad/s], given
        ("force", float, (4,)),  # forces of the supports A and B on the belt [N]
        ("iterations", int),
        ("halvings", int),
        ("residual", float),  # largest force that is left over T_A [-]
    ]
)


@kernel
def held_row(i: int, n: int) -> int:
    """Return the coordinate held by component ``i`` of 0..3 of the support forces, of ``n``."""
    return i if i < 2 else n - 6 + i


@kernel
def assemble(system: System, motion: Motion, s: State, back: float) -> int:
    """Assemble residual, tangent and columns at ``s.q``, ``s.u``; return the changes of status."""
    mesh, belt, n, rate, A, r = system.mesh, system.belt, s.q.size, motion.rate, s.A, s.r
    r[:], s.columns[:], A[:] = 0.0, 0.0, 0.0
    add_belt(mesh, belt, motion, s)
    if rate > 0.0:
        for i in range(n):
            s.dq[i] = s.q[i] - s.q_old[i] - s.q_dot[i] / rate
        add_inertia(mesh, belt, s, rate)
    changes = add_contact(mesh, system.pulley, motion, s, back)
    for end in range(2):
        first = 2 + end * (n - 4)
        d = system.across[end]
        turned = s.q[first] * d[0] + s.q[first + 1] * d[1]
        for i in range(2):
            r[first + i] += system.clamp * turned * d[i]
            for j in range(2):
                A[first + i, HALF + j - i] += system.clamp * d[i] * d[j]
    return changes


@kernel
def hold(s: State, moves: Array) -> None:
    """Turn the rows of the held coordinates into support forces, and hold the coordinates."""
    n = s.q.size
    for i in range(4):  # the column of a movement is that of the coordinates that it moves
        row = held_row(i, n)
        for j in range(max(0, row - HALF), min(n, row + HALF + 1)):
            s.columns[1, j] += s.A[j, HALF + row - j] * moves[i]
    for i in range(4):
        row = held_row(i, n)
        s.force[i], s.kept[0, i], s.kept[1, i] = s.r[row], s.columns[0, row], s.columns[1, row]
        for j in range(s.A.shape[1]):
            s.rows[i, j] = s.A[row, j]
    for i in range(4):
        row = held_row(i, n)
        s.r[row] = s.columns[0, row] = s.columns[1, row] = 0.0
        for j in range(max(0, row - HALF), min(n, row + HALF + 1)):
            s.A[j, HALF + row - j] = 0.0
        s.A[row] = 0.0
        s.A[row, HALF] = 1.0


@kernel
def held_forces(s: State, x: Array, out: Array) -> None:
    """Multiply the rows of the held coordinates in the tangent by ``x`` (n,)."""
    for i in range(4):
        row, out[i] = held_row(i, x.size), 0.0
        for j in range(max(0, row - HALF), min(x.size, row + HALF + 1)):
            out[i] += s.rows[i, HALF + j - row] * x[j]


@kernel
def accept(s: State, rate: float) -> None:
    """End a step: rates, strains and contact are those that the next one starts from."""
    for i in range(s.q.size):
        s.q_dot[i] = (s.q[i] - s.q_old[i]) * rate
    for el in range(s.now.shape[0]):
        for g in range(s.strains.shape[1]):
            for k in range(2):
                s.strains_old[el, g, k] = s.strains[el, g, k]
        for c in range(s.now.shape[1]):
            s.last[el, c] = s.now[el, c]


@kernel
def equilibrium(
    system: System, motion: Motion, border: Border, s: State, most: int
) -> tuple[int, float]:
    """Solve one static equilibrium or one implicit step from ``s.q_old``, ``s.q_dot``, ``s.u``.

    Returned are the iterations, -1 if there is no solution, and the largest force left over T_A.
    """
    n, rate, h_min, R, error = s.q.size, motion.rate, system.h_min, system.pulley.R, math.inf
    stiffest = (1.0 + system.belt.damping_time * rate) * system.belt.EA / h_min
    if rate > 0.0:
        stiffest += 1e-2 * system.pulley.k_t * h_min
    miss, du, change = np.zeros(2), np.zeros(2), np.zeros(4)
    S, by = np.zeros((2, 2)), np.zeros((2, 4))
    for i in range(n):
        s.q[i] = s.q_old[i] + (s.q_dot[i] / rate if rate > 0.0 else 0.0)
    for iteration in range(most):
        # a point whose limit falls when it slides could stick and slide in turn for ever
        back = SLIPS_BACK if iteration < PATIENCE else CIRCLES
        changes = assemble(system, motion, s, back if iteration > 0 else -1.0)
        hold(s, border.moves)
        T = (math.hypot(s.force[0], s.force[1]), math.hypot(s.force[2], s.force[3]))
        error = 0.0
        for k in range(2):
            miss[k] = border.given[k] - border.weights[k, 0] * T[0] - border.weights[k, 1] * T[1]
            for i in range(4):
                by[k, i] = border.weights[k, i // 2] * s.force[i] / T[i // 2]
            error = max(error, abs(miss[k]))
        for i in range(n):
            error = max(error, abs(s.r[i]) / (1.0 if i % 4 < 2 else h_min))
        if changes == 0 and error <= TOLERANCE * T[0] + ROUNDING * R * stiffest:
            if rate > 0.0:
                accept(s, rate)
            return iteration, error / T[0]
        if not (error < 1e300 and factorize(s.A, s.pivots)):
            break
        solve(s.A, s.pivots, s.r, s.columns[0], s.columns[1])
        # the equations, with the coordinates eliminated: S du = miss
        held_forces(s, s.r, change)
        for k in range(2):
            for i in range(4):
                miss[k] += by[k, i] * change[i]
        for j in range(2):
            held_forces(s, s.columns[j], change)
            for k in range(2):
                is_given = border.weights[k, 0] == 0.0 and border.weights[k, 1] == 0.0
                S[k, j] = 1.0 if k == j and is_given else 0.0
                for i in range(4):
                    S[k, j] += by[k, i] * (s.kept[j, i] - change[i])
        determinant = S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0]
        du[0] = (miss[0] * S[1, 1] - S[0, 1] * miss[1]) / determinant
        du[1] = (S[0, 0] * miss[1] - miss[0] * S[1, 0]) / determinant
        factor = 1.0
        for i in range(n):
            s.r[i] = -s.r[i] - du[0] * s.columns[0, i] - du[1] * s.columns[1, i]
        for i in range(4):
            s.r[held_row(i, n)] += du[1] * border.moves[i]
        for i in range(n):
            longest = LONGEST_STEP * (R if i % 4 < 2 else 1.0)
            factor = min(factor, longest / max(abs(s.r[i]), 1e-30))
        for i in range(n):
            s.q[i] += factor * s.r[i]
        for k in range(2):
            s.u[k] += factor * du[k]
    return -1, error / max(1e-30, math.hypot(s.force[0], s.force[1]))


def march(
    system: System,
    border: Border,
    s: State,
    record: NDArray[np.void],
    solver: Callable[..., tuple[int, float]] = equilibrium,
) -> int:
    """Take the steps of a record, in two, four, ... parts if need be; return how many succeeded."""
    s.now[:] = s.last
    dts, omegas, force, iterations, halvings, residual = (record[name] for name in STEP.names or ())
    for number, (dt, omega) in enumerate(zip(dts.tolist(), omegas.tolist(), strict=True)):
        parts, done = 1, 0
        while done < parts:
            s.q_old[:], moved = s.q, s.u[1]
            motion = Motion(parts / dt, omega)
            spent, residual[number] = solver(system, motion, border, s, MOST_IN_TIME)
            if spent >= 0:
                iterations[number] += spent
                done += 1
                continue
            iterations[number] += MOST_IN_TIME
            halvings[number] += 1
            if halvings[number] > MOST_HALVINGS:
                return number
            s.q[:], s.u[1], s.now[:] = s.q_old, moved, s.last
            parts, done = 2 * parts, 2 * done
        force[number] = s.force
    return record.size

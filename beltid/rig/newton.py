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

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.rig.banded import HALF, WIDTH, factorize, solve
from beltid.rig.belt import Section, add_belt, add_inertia
from beltid.rig.compiler import kernel
from beltid.rig.contact import Motion, Points, Pulley, add_contact, new_points
from beltid.rig.mesh import Mesh

Array = NDArray[np.float64]

TOLERANCE = 1.0e-9  # residual force over T_A [-]
ROUNDING = 1.0e-13  # of positions over R [-]
LONGEST_STEP = 0.1  # of an iteration: positions over R, gradients [-]
MOST_ITERATIONS, MOST_IN_TIME, MOST_HALVINGS = 60, 30, 10


class System(NamedTuple):
    """The rig for compiled code.

    ``clamp`` is the rotational stiffness of the ends [N m] (0: pinned), ``across`` (2, 2) the
    normals of the path at A and B, against which it turns them back; ``h_min`` [m] is the length of
    the shortest element.
    """

    mesh: Mesh
    section: Section
    pulley: Pulley
    clamp: float
    across: Array
    h_min: float


class Border(NamedTuple):
    """Boundaries: unknowns ``kinds`` (k,) and as many equations on the forces of the supports.

    Kind 0 is the stretch; kind 1 is the speed of the pulley if the belt flows, else the movement of
    the held coordinates (x, y of A, then of B) by ``moves`` (4,). The equations are
    ``weights @ (T_A, T_B) = given``, shapes (k, 2), (k,).
    """

    kinds: NDArray[np.int64]
    weights: Array
    given: Array
    moves: Array


class State(NamedTuple):
    """Coordinates, contact and linearised system of one rig; every solution overwrites them.

    Attributes
    ----------
    q, q_old, q_dot : ndarray, shape (n,)
        Nodal coordinates, those at the last step, and their rates.
    u : ndarray, shape (2,)
        The unknowns of the borders, or their given values.
    force : ndarray, shape (4,)
        Forces of the supports A and B on the belt, x and y each [N].
    last, now : Points
        Contact points at the last step, and now.
    strains, strains_old : ndarray, shape (n_e, n_g, 2)
        Axial strain and curvature.
    A, pivots, r, columns, rows, kept, dq
        Tangent (n, WIDTH), its pivots, residual (n,), its derivatives in the unknowns (2, n), rows
        of the held coordinates (4, WIDTH), derivatives of the support forces in the unknowns
        (3, 4; the last row is zero), and deviation from uniform motion (n,).
    """

    q: Array
    q_old: Array
    q_dot: Array
    u: Array
    force: Array
    last: Points
    now: Points
    strains: Array
    strains_old: Array
    A: Array
    pivots: NDArray[np.int64]
    r: Array
    columns: Array
    rows: Array
    kept: Array
    dq: Array


def new_state(mesh: Mesh) -> State:
    """Allocate a state."""
    (n_e, n_c), n = mesh.w_c.shape, 4 * mesh.h.size + 4
    strains = (*mesh.w_g.shape, 2)
    return State(
        q=np.zeros(n),
        q_old=np.zeros(n),
        q_dot=np.zeros(n),
        u=np.array([1.0, 0.0]),
        force=np.zeros(4),
        last=new_points(n_e, n_c),
        now=new_points(n_e, n_c),
        strains=np.zeros(strains),
        strains_old=np.zeros(strains),
        A=np.zeros((n, WIDTH)),
        pivots=np.zeros(n, dtype=np.int64),
        r=np.zeros(n),
        columns=np.zeros((2, n)),
        rows=np.zeros((4, WIDTH)),
        kept=np.zeros((3, 4)),
        dq=np.zeros(n),
    )


STEP: Final = np.dtype(
    [
        ("dt", float),  # duration [s], given
        ("omega", float),  # speed of the pulley [rad/s], given
        ("force", float, (4,)),  # forces of the supports A and B on the belt [N]
        ("iterations", int),
        ("changes", int),  # of points between stick and slide, in all iterations
        ("halvings", int),
        ("residual", float),  # largest force that is left over T_A [-]
        ("drift", float),  # largest movement of a sticking point in its spring [m]
        ("cone", float),  # largest force beyond the cone over its limit [-]
        ("sticking", float),  # share of the contact that sticks [-]
    ]
)
"""A step of a march."""


@kernel
def held_row(i: int, n: int) -> int:
    """Return the coordinate held by component ``i`` of 0..3 of the support forces, of ``n``."""
    return i if i < 2 else n - 6 + i


@kernel
def row_times(row: Array, i: int, x: Array) -> float:
    """Multiply row ``i`` of a banded matrix by ``x`` (n,)."""
    total = 0.0
    for j in range(max(0, i - HALF), min(x.size, i + HALF + 1)):
        total += row[HALF + j - i] * x[j]
    return total


@kernel
def assemble(system: System, motion: Motion, s: State, revise: bool) -> int:
    """Assemble residual, tangent and columns at ``s.q``, ``s.u``; return the changes of status."""
    mesh, n, rate, u = system.mesh, s.q.size, motion.rate, s.u
    for i in range(n):
        s.r[i] = s.columns[0, i] = s.columns[1, i] = 0.0
        for j in range(WIDTH):
            s.A[i, j] = 0.0
    A, r, r_s, r_omega = s.A, s.r, s.columns[0], s.columns[1]
    add_belt(mesh, system.section, s.q, u[0], s.strains_old, s.strains, rate, A, r, r_s)
    if rate > 0.0:
        for i in range(n):
            s.dq[i] = s.q[i] - s.q_old[i] - s.q_dot[i] / rate
        add_inertia(mesh, system.section, u[0], s.dq, rate, A, r)
    pulley, last, now = system.pulley, s.last, s.now
    changes = add_contact(mesh, pulley, motion, s.q, u, last, now, revise, A, r, r_s, r_omega)
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
        for j in range(WIDTH):
            s.rows[i, j] = s.A[row, j]
    for i in range(4):
        row = held_row(i, n)
        s.r[row] = s.columns[0, row] = s.columns[1, row] = 0.0
        for j in range(max(0, row - HALF), min(n, row + HALF + 1)):
            s.A[j, HALF + row - j] = 0.0
        for j in range(WIDTH):
            s.A[row, j] = 1.0 if j == HALF else 0.0


@kernel
def force_changes(s: State, x: Array, k: int, out: Array) -> None:
    """Write the changes of the support forces with ``-x`` (n,) and, unless k = 2, the unknown k."""
    for i in range(4):
        out[i] = s.kept[k, i] - row_times(s.rows[i], held_row(i, x.size), x)


@kernel
def equilibrium(
    system: System, motion: Motion, border: Border, s: State, most: int
) -> tuple[int, int, float]:
    """Solve one static equilibrium or one implicit step from ``s.q_old``, ``s.q_dot``, ``s.u``.

    The state is overwritten by the solution, after ``most`` iterations at most. Returned are their
    number, -1 if there is no solution, the changes of points between stick and slide in all of
    them, and the largest force that is left over T_A [-].
    """
    n, unknowns, rate = s.q.size, border.kinds.size, motion.rate
    h_min, R, total, error = system.h_min, system.pulley.R, 0, math.inf
    stiffest = (1.0 + system.section.damping_time * rate) * system.section.EA / h_min
    if rate > 0.0:
        stiffest += 1e-2 * system.pulley.k_t * h_min
    miss, S, by, change, du = np.zeros(2), np.eye(2), np.zeros((2, 4)), np.zeros(4), np.zeros(2)
    for i in range(n):
        s.q[i] = s.q_old[i]
        if rate > 0.0:
            s.q[i] += s.q_dot[i] / rate
    for iteration in range(most):
        changes = assemble(system, motion, s, iteration > 0)
        hold(s, border.moves)
        total += changes
        T = (math.hypot(s.force[0], s.force[1]), math.hypot(s.force[2], s.force[3]))
        error = 0.0
        for k in range(unknowns):
            miss[k] = border.given[k] - border.weights[k, 0] * T[0] - border.weights[k, 1] * T[1]
            for i in range(4):
                by[k, i] = border.weights[k, i // 2] * s.force[i] / T[i // 2]
            error = max(error, abs(miss[k]))
        for i in range(n):
            error = max(error, abs(s.r[i]) / (1.0 if i % 4 < 2 else h_min))
        if changes == 0 and error <= TOLERANCE * T[0] + ROUNDING * R * stiffest:
            return iteration, total, error / T[0]
        if not (error < 1e300 and factorize(s.A, s.pivots)):
            break
        solve(s.A, s.pivots, s.r)
        force_changes(s, s.r, 2, change)
        for k in range(unknowns):
            for i in range(4):
                miss[k] -= by[k, i] * change[i]
        for j in range(unknowns):
            kind = border.kinds[j]
            solve(s.A, s.pivots, s.columns[kind])
            force_changes(s, s.columns[kind], kind, change)
            for k in range(unknowns):
                S[k, j] = 0.0
                for i in range(4):
                    S[k, j] += by[k, i] * change[i]
        determinant = S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0]
        du[0] = (miss[0] * S[1, 1] - S[0, 1] * miss[1]) / determinant
        du[1] = (S[0, 0] * miss[1] - miss[0] * S[1, 0]) / determinant
        for i in range(n):
            s.r[i] = -s.r[i]
        for j in range(unknowns):
            kind = border.kinds[j]
            for i in range(n):
                s.r[i] -= du[j] * s.columns[kind, i]
            if kind == 1:
                for i in range(4):
                    s.r[held_row(i, n)] += du[j] * border.moves[i]
        factor = 1.0
        for i in range(n):
            longest = LONGEST_STEP * (R if i % 4 < 2 else 1.0)
            factor = min(factor, longest / max(abs(s.r[i]), 1e-30))
        for i in range(n):
            s.q[i] += factor * s.r[i]
        for j in range(unknowns):
            s.u[border.kinds[j]] += factor * du[j]
    return -1, total, error / max(1e-30, math.hypot(s.force[0], s.force[1]))


@kernel
def march(system: System, border: Border, s: State, record: Any, begin: int, end: int) -> int:
    """Take the steps ``begin`` to ``end`` of a record from ``s.q``, ``s.q_dot``, ``s.last``.

    A step that has no solution is taken in two, four, eight ... parts. Returned is the number of
    steps taken, less than ``end`` if one failed.
    """
    most = min(MOST_IN_TIME, MOST_ITERATIONS)  # no literal, for which all were compiled once more
    for number in range(begin, end):
        step, parts, done = record[number], 1, 0
        while done < parts:
            motion, moved = Motion(parts / step.dt, step.omega, 1.0, 0.0, 0.0), s.u[1]
            s.q_old[:] = s.q
            for el in range(s.now.shape[0]):
                for c in range(s.now.shape[1]):
                    s.now[el, c].sticks = s.last[el, c].sticks
                    s.now[el, c].sign = s.last[el, c].sign
            spent, changes, step.residual = equilibrium(system, motion, border, s, most)
            step.iterations += spent if spent >= 0 else most
            step.changes += changes
            if spent < 0:
                step.halvings += 1
                if step.halvings > MOST_HALVINGS:
                    return number
                s.q[:] = s.q_old
                s.u[1], parts, done = moved, 2 * parts, 2 * done
                continue
            done += 1
            s.q_dot[:] = (s.q - s.q_old) * motion.rate
            s.strains_old[:] = s.strains
            for el in range(s.now.shape[0]):
                for c in range(s.now.shape[1]):
                    s.last[el, c] = s.now[el, c]
        for i in range(4):
            step.force[i] = s.force[i]
        certify(system, s.now, step)
    return end


@kernel
def certify(system: System, now: Any, step: Any) -> None:
    """Write into a step how well its solution keeps Coulomb's law."""
    touching = sticking = 0.0
    for el in range(now.shape[0]):
        for c in range(now.shape[1]):
            point, w = now[el, c], system.mesh.w_c[el, c]
            if point.F_N <= 0.0:
                continue
            touching += w
            step.cone = max(step.cone, abs(point.F_T) / point.limit - 1.0)
            if point.sticks:
                sticking += w
                step.drift = max(step.drift, abs(point.F_T) / (system.pulley.k_t * w))
    step.sticking = sticking / touching if touching > 0.0 else 0.0

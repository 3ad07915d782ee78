"""The paper's own friction: a step as a linear complementarity problem, Eqs. (11) and (12).

Coulomb's law is exactly set-valued here: a sticking point does not move at all. The linearised
step matrix S takes the place of the mass matrix of Eq. (12). With the directions W_T of the
friction forces the slips of a step are ``slip_free - G F_T``, with the Delassus matrix
``G = W_T' S^-1 W_T``.
Five points per element are more constraints than an element has freedoms: G is only positive
semi-definite, the slips are unique, the split of the stick forces is not (trap (b) of the method).
"""

import numpy as np
from numpy.typing import NDArray

from beltid.arrays import Array
from beltid.errors import ConvergenceError
from beltid.rig.banded import factorize, solve
from beltid.rig.forces import CONE_TOLERANCE, Motion, State
from beltid.rig.newton import TOLERANCE, Border, System, accept, assemble, held_forces, hold

STILL = 1.0e-12  # of a sticking point in a step, or backward of a sliding one [m]
PIVOT_TOLERANCE = 1.0e-11


def lemke(M: Array, q: Array) -> Array:
    """Solve ``w = M z + q, z >= 0, w >= 0, z.w = 0`` by Lemke's method.

    R. W. Cottle, J.-S. Pang, R. E. Stone, The Linear Complementarity Problem, 2009, Algorithm
    4.4.5: an artificial variable makes w >= 0; complementary bases are followed until it leaves.
    The lexicographic ratio test makes every pivot unique: degenerate problems do not cycle. For
    copositive-plus M, as of friction, a ConvergenceError says that there is no solution.
    """
    n = q.size
    if np.all(q >= 0.0):
        return np.zeros(n)
    # rows of  w - M z - z_0 = q;  the columns of w carry the inverse of the basis
    tableau = np.hstack([np.eye(n), -M, -np.ones((n, 1)), q[:, None]])
    basis, artificial = np.arange(n), 2 * n
    row, entering = _leaving_row(tableau, np.ones(n), basis, -1), artificial
    for _ in range(50 * (n + 1)):
        leaving = int(basis[row])
        tableau[row] /= tableau[row, entering]
        factors = tableau[:, entering].copy()
        factors[row] = 0.0
        tableau -= np.outer(factors, tableau[row])
        basis[row] = entering
        if leaving == artificial:
            z, within = np.zeros(n), basis >= n
            z[basis[within] - n] = np.maximum(tableau[within, -1], 0.0)
            return z
        entering = leaving + n if leaving < n else leaving - n
        row = _leaving_row(tableau, tableau[:, entering], basis, artificial)
        if row < 0:
            break
    raise ConvergenceError(
        f"complementarity problem of {n} unknowns: no solution, the method ended on a ray"
    )


def _leaving_row(tableau: Array, column: Array, basis: NDArray[np.intp], artificial: int) -> int:
    """Return the row of the least (right-hand side, basis inverse)/column, or -1."""
    rows = np.flatnonzero(column > PIVOT_TOLERANCE * max(1.0, float(np.abs(column).max())))
    for k in range(-1, basis.size):
        if rows.size <= 1:
            break
        values = tableau[rows, k] / column[rows]
        smallest = values.min()
        rows = rows[values <= smallest + 1e-12 * max(1.0, abs(smallest))]
        leaves = rows[basis[rows] == artificial]
        if k == -1 and leaves.size:
            return int(leaves[0])
    return int(rows[0]) if rows.size else -1


def friction_lcp(G: Array, slip_free: Array, limits: Array) -> tuple[Array, Array]:
    """Solve Coulomb friction with given limits as a complementarity problem, Eqs. (11), (12).

    The slips are ``slip = slip_free - G F``; a sticking point has slip 0 and |F| <= limit, a
    sliding one F = limit sign(slip). With x = F + limit in [0, 2 limit] and the multiplier y of the
    upper bound, ``M = [[G, 1], [-1, 0]]`` and ``q = [-G limit - slip_free, 2 limit]``.

    The limits mu F_N [N] are >= 0. Returned are friction forces [N] and slips [m], exactly zero
    where a point sticks.
    """
    n = limits.size
    # forces over the largest limit, slips over the largest free slip
    force_scale = float(np.max(limits, initial=0.0)) or 1.0
    slip_scale = float(np.max(np.abs(slip_free), initial=0.0)) or 1.0
    G_scaled, c, unit = G * (force_scale / slip_scale), limits / force_scale, np.eye(n)
    M = np.block([[G_scaled, unit], [-unit, np.zeros((n, n))]])
    q = np.concatenate([-G_scaled @ c - slip_free / slip_scale, 2.0 * c])
    z = lemke(M, q)
    w = np.maximum(M @ z + q, 0.0)
    w[z > 0.0] = 0.0
    force = np.clip(z[:n] * force_scale - limits, -limits, limits)
    return force, (z[n:] - w[:n]) * slip_scale


def step_by_lemke(
    system: System, motion: Motion, border: Border, s: State, most: int
) -> tuple[int, float]:
    """Solve a step as :func:`beltid.rig.newton.equilibrium`, with an LCP for the friction."""
    system = system._replace(pulley=system.pulley._replace(k_t=0.0))  # sticks are no springs here
    now, last, before, error = s.now, s.last, s.last.copy(), np.inf
    s.q[:] = s.q_old + s.q_dot / motion.rate
    units = np.tile([1.0, 1.0, system.h_min, system.h_min], s.q.size // 4)
    for iteration in range(2 * most):
        assemble(system, motion, s, -1.0)  # a sticking point carries the force of ``last``
        hold(s, border.moves)
        at = np.nonzero(now["F_N"] > 0.0)
        slip, force, limit, sticks = (now[key][at] for key in ("slip", "F_T", "limit", "sticks"))
        T = np.hypot(s.force[::2], s.force[1::2])
        missing = float(border.given[1] - border.weights[1] @ T)
        by = np.repeat(border.weights[1] / T, 2) * s.force  # of the given force in the forces
        error = max(float(np.max(np.abs(s.r) / units)), abs(missing)) / T[0]
        wrong = np.where(sticks, np.abs(slip), -now["sign"][at] * slip)
        beyond = float(np.max(np.abs(force) / limit, initial=0.0)) - 1.0
        if error <= TOLERANCE and beyond <= CONE_TOLERANCE and max(wrong, default=0.0) <= STILL:
            accept(s, motion.rate)
            return iteration, error
        if not factorize(s.A, s.pivots):
            break
        # W_T, then the step without new friction, with its forces, with a movement of the ends
        W, theta = np.zeros((s.q.size, slip.size)), now["theta"][at]
        for i, (el, c) in enumerate(zip(*at, strict=True)):
            W[4 * el : 4 * el + 8 : 2, i] = system.mesh.N[el, c] * np.cos(theta[i])
            W[4 * el + 1 : 4 * el + 8 : 2, i] = -system.mesh.N[el, c] * np.sin(theta[i])
        W[[0, 1, -4, -3]] = 0.0
        x = np.vstack([-s.r, W.T, -s.columns[1]])
        at_supports, moved = np.zeros((len(x), 4)), np.zeros(len(x) - 1)
        for load, out in zip(x, at_supports, strict=True):
            solve(s.A, s.pivots, load, np.zeros(load.size), np.zeros(load.size))
            held_forces(s, load, out)
        if by.any():  # the ends move until the force is the given one
            missing_to, forces = np.append(missing, np.zeros(len(W.T))), at_supports @ by
            moved = (missing_to - forces[:-1]) / (by @ s.kept[1] + forces[-1])
            x[-1, [0, 1, -4, -3]] += border.moves
        free, *responses = x[:-1] + np.outer(moved, x[-1])
        compliance = np.reshape(responses, W.T.shape).T
        G = W.T @ compliance
        try:
            wanted, slip = friction_lcp(G, slip - W.T @ free + G @ force, limit)
        except ConvergenceError:
            break
        s.q[:] += free + compliance @ (wanted - force)
        s.u[1] += moved @ np.append(1.0, wanted - force)
        last["F_T"][at], now["sticks"][at] = wanted, slip == 0.0
        now["sign"][at] = np.where(slip == 0.0, np.sign(wanted), np.sign(slip))
    last[:] = before
    return -1, error

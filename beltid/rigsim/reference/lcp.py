"""Solve linear complementarity problems by Lemke's method with lexicographic pivoting.

    w = M z + q,   z >= 0,   w >= 0,   z.w = 0

Lemke's method (R. W. Cottle, J.-S. Pang, R. E. Stone, The Linear Complementarity Problem, 2009,
Algorithm 4.4.5) starts from an artificial variable that makes w >= 0 and follows complementary
bases until that variable leaves. The lexicographic ratio test makes every pivot unique, so
degenerate problems do not cycle. For copositive-plus matrices, including friction with a positive
semi-definite compliance, it finds a solution whenever one exists.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.errors import ConvergenceError

Array = NDArray[np.float64]


class LcpError(ConvergenceError):
    """A linear complementarity problem has no solution that Lemke's method can reach."""


@dataclass(frozen=True, slots=True)
class LcpSolution:
    """Solution of a linear complementarity problem with its certificate.

    Attributes
    ----------
    z, w : ndarray, shape (n,)
        Complementary variables, both >= 0.
    pivots : int
        Number of pivots.
    residual : float
        Largest absolute entry of w - M z - q.
    complementarity : float
        Largest z_i w_i.
    """

    z: Array
    w: Array
    pivots: int
    residual: float
    complementarity: float


def lemke(M: Array, q: Array, most_pivots: int | None = None) -> LcpSolution:
    """Solve a linear complementarity problem.

    Parameters
    ----------
    M : ndarray, shape (n, n)
        Matrix.
    q : ndarray, shape (n,)
        Right-hand side.
    most_pivots : int, optional
        Largest number of pivots; default 50 (n + 1).

    Raises
    ------
    LcpError
        If the method ends on a ray (for copositive-plus M no solution exists), or needs more than
        ``most_pivots`` pivots.
    """
    M = np.asarray(M, dtype=float)
    q = np.asarray(q, dtype=float)
    n = q.size
    if n == 0 or np.all(q >= 0.0):
        return _certified(M, q, np.zeros(n), 0)
    # rows of  w - M z - cover z_0 = q;  the columns of w carry the inverse of the basis
    cover = np.ones(n)
    tableau = np.hstack([np.eye(n), -M, -cover[:, None], q[:, None]])
    artificial = 2 * n
    basis = np.arange(n)
    row = _lexicographic_minimum(tableau, np.arange(n), cover, n)
    entering = artificial
    limit = 50 * (n + 1) if most_pivots is None else most_pivots
    for pivots in range(1, limit + 1):
        leaving = int(basis[row])
        _pivot(tableau, row, entering)
        basis[row] = entering
        if leaving == artificial:
            z = np.zeros(n)
            in_basis = (basis >= n) & (basis < 2 * n)
            z[basis[in_basis] - n] = np.maximum(tableau[in_basis, -1], 0.0)
            return _certified(M, q, z, pivots)
        entering = leaving + n if leaving < n else leaving - n
        column = tableau[:, entering]
        candidates = np.flatnonzero(column > 1e-11 * max(1.0, float(np.abs(column).max())))
        if candidates.size == 0:
            raise LcpError(
                f"complementarity problem of {n} unknowns: no solution, the method ended on a ray "
                f"after {pivots} pivots",
                iterations=pivots,
            )
        row = _lexicographic_minimum(tableau, candidates, column[candidates], n, basis, artificial)
    raise LcpError(
        f"complementarity problem of {n} unknowns: no solution after {limit} pivots",
        iterations=limit,
    )


def _pivot(tableau: Array, row: int, column: int) -> None:
    """Make ``column`` the unit vector of ``row`` by a Gauss–Jordan step."""
    tableau[row] /= tableau[row, column]
    factors = tableau[:, column].copy()
    factors[row] = 0.0
    tableau -= np.outer(factors, tableau[row])


def _lexicographic_minimum(
    tableau: Array,
    rows: NDArray[np.intp],
    divisors: Array,
    n: int,
    basis: NDArray[np.intp] | None = None,
    artificial: int = -1,
) -> int:
    """Return the row with the lexicographic minimum of (right-hand side, basis inverse)/divisor.

    The artificial variable leaves as soon as possible.
    """
    alive = rows
    values = tableau[rows, -1] / divisors
    for k in range(-1, n):
        if k >= 0:
            values = tableau[alive, k] / divisors
        smallest = values.min()
        keep = values <= smallest + 1e-12 * max(1.0, abs(smallest))
        alive, divisors = alive[keep], divisors[keep]
        if basis is not None and k == -1:
            out = alive[basis[alive] == artificial]
            if out.size:
                return int(out[0])
        if alive.size == 1:
            break
    return int(alive[0])


def _certified(M: Array, q: Array, z: Array, pivots: int) -> LcpSolution:
    w = M @ z + q
    positive = np.maximum(w, 0.0)
    return LcpSolution(
        z=z,
        w=positive,
        pivots=pivots,
        residual=float(np.max(np.abs(positive - w), initial=0.0)),
        complementarity=float(np.max(np.abs(z * w), initial=0.0)),
    )


def friction_lcp(G: Array, slip_free: Array, limits: Array) -> tuple[Array, Array, LcpSolution]:
    """Solve Coulomb friction with given limits as an LCP, Eqs. (11), (12).

    The slips are ``slip = slip_free - G F``; a sticking patch has slip 0 and |F| <= limit, a
    sliding one F = limit sign(slip). With x = F + limit in [0, 2 limit] and the multiplier y of the
    upper bound, the LCP has

        M = [[G, 1], [-1, 0]],   q = [-G limit - slip_free, 2 limit].

    Parameters
    ----------
    G : ndarray, shape (n, n)
        Delassus matrix W_T^T S^-1 W_T [m/N], positive semi-definite.
    slip_free : ndarray, shape (n,)
        Slips without friction forces [m].
    limits : ndarray, shape (n,)
        Friction limits mu F_N [N], >= 0.

    Returns
    -------
    force, slip : ndarray, shape (n,)
        Friction forces [N] and slips [m].
    solution : LcpSolution
        Solution of the scaled problem with its certificate.

    Raises
    ------
    LcpError
        See :func:`lemke`.
    """
    n = limits.size
    # scale the unknowns: forces by the largest limit, slips by the largest free slip
    force_scale = float(np.max(limits, initial=0.0)) or 1.0
    slip_scale = float(np.max(np.abs(slip_free), initial=0.0)) or 1.0
    G_scaled = G * (force_scale / slip_scale)
    c = limits / force_scale
    eye = np.eye(n)
    M = np.block([[G_scaled, eye], [-eye, np.zeros((n, n))]])
    q = np.concatenate([-G_scaled @ c - slip_free / slip_scale, 2.0 * c])
    solution = lemke(M, q)
    force = np.clip(solution.z[:n] * force_scale - limits, -limits, limits)
    # w = -slip + y in the first rows: slip = y - w, exactly zero for a sticking patch
    slip = (solution.z[n:] - solution.w[:n]) * slip_scale
    return force, slip, solution

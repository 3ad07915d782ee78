"""Bicubic patches over a rectangular grid: their coefficients, and how they are looked up.

The patches form the C2 tensor-product cubic spline (not-a-knot ends) in the coordinates
``x = ln(1 + f / f_ref)`` and ``y = ln(1 + v / v_ref)``, with the smallest positive node as
reference: benches space their settings geometrically, and friction laws are nearly straight in
logarithms. On 8 x 5 grids of the three known laws the largest error is 0.07 %; with f and v
themselves it would be 0.9 %, with natural ends 0.3 %.

A spline through noisy values overshoots them. The derivatives at the nodes are therefore scaled
down where needed until the 16 Bézier control points of every cell lie in the band of its four
corner values, so the patch does, too. Where nothing is scaled, the surface *is* the C2 spline;
elsewhere it is C1.
"""

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from beltid.arrays import Array

# power-basis coefficients of a cubic from (value, value, slope, slope) at s = 0, 1
_HERMITE = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [-3.0, 3.0, -2.0, -1.0], [2.0, -2.0, 1.0, 1.0]]
)


class SurfaceTables(NamedTuple):
    """A friction surface as plain arrays, for compiled kernels.

    ``x_nodes`` (nx,) and ``y_nodes`` (ny,) are ``ln(1 + f/f_ref)`` of the force nodes and
    ``ln(1 + v/v_ref)`` of the speed nodes; with one node, mu does not depend on that variable. The
    references [N/m], [m/s] are infinite if the axis is the single node 0. A cell has the
    coefficients C[i, j] (4, 4): ``mu = sum_ab C[i, j, a, b] s**a t**b``, ``s = (x - x_i)/(x_{i+1} -
    x_i)`` and ``t`` likewise, both in [0, 1].
    """

    x_nodes: Array
    y_nodes: Array
    f_ref: float
    v_ref: float
    C: Array


def log_nodes(nodes: Array) -> tuple[Array, float]:
    """Return the coordinates of the nodes (n,) of an axis, and their reference."""
    positive = nodes[nodes > 0.0]
    reference = float(positive[0]) if positive.size else math.inf
    return np.log1p(nodes / reference), reference


def coordinate(reference: float, value: Any) -> tuple[Any, Any]:
    """Return the coordinates of values (numbers or arrays) on an axis, and their derivatives."""
    x = np.log1p(np.maximum(value, 0.0) / reference)
    return x, 1.0 * (value >= 0.0) / (reference + value)


def local(nodes: Any, cell: Any, x: Any) -> tuple[Any, Any]:
    """Return the local coordinate of x in a cell and its slope; 0 or 1 and 0 beyond the ends."""
    if nodes.size == 1:
        return 0.0 * x, 0.0 * x
    inside = np.minimum(np.maximum(x, nodes[0]), nodes[-1])
    width = nodes[cell + 1] - nodes[cell]
    return (inside - nodes[cell]) / width, 1.0 * (x == inside) / width


def evaluate_cell(C: Any, i: Any, j: Any, s: Any, t: Any) -> tuple[Any, Any, Any]:
    """Evaluate mu, mu_s, mu_t in cells (i, j) at local coordinates s, t (numbers or arrays)."""
    mu = mu_s = mu_t = 0.0
    for a in range(3, -1, -1):  # Horner in s of the Horner sums in t
        c1, c2, c3 = C[i, j, a, 1], C[i, j, a, 2], C[i, j, a, 3]
        row = ((c3 * t + c2) * t + c1) * t + C[i, j, a, 0]
        row_t = (3.0 * c3 * t + 2.0 * c2) * t + c1
        mu_s = mu_s * s + mu
        mu = mu * s + row
        mu_t = mu_t * s + row_t
    return mu, mu_s, mu_t


def bounded_patches(x: Array, y: Array, z: Array) -> Array:
    """Compute the coefficients of bounded patches through values z (nx, ny) at x (nx,), y (ny,)."""
    if x.size == 1:  # represent a constant direction by one cell of width 1 with equal values
        x, z = np.array([0.0, 1.0]), np.repeat(z, 2, axis=0)
    if y.size == 1:
        y, z = np.array([0.0, 1.0]), np.repeat(z, 2, axis=1)
    zx = CubicSpline(x, z, axis=0)(x, 1)
    zy = CubicSpline(y, z, axis=1)(y, 1)
    zxy = CubicSpline(y, zx, axis=1)(y, 1)
    return hermite_patches(x, y, z, *_limited(x, y, z, zx, zy, zxy))


def bounded_cubic(x: Array, z: Array, at: Array) -> Array:
    """Evaluate, within its points, a natural cubic spline that stays between neighbouring ones."""
    if x.size == 1:
        return np.full(at.shape, z[0])
    # between zero and three times the slope of the chord, the control points stay in the band
    chords = np.pad(3.0 * np.diff(z) / np.diff(x), 1, mode="edge")
    low, high = np.minimum(chords, 0.0), np.maximum(chords, 0.0)
    slopes = CubicSpline(x, z, bc_type="natural")(x, 1)
    slopes = np.clip(slopes, np.maximum(low[:-1], low[1:]), np.minimum(high[:-1], high[1:]))
    return np.asarray(CubicHermiteSpline(x, z, slopes)(at))


def hermite_patches(x: Array, y: Array, z: Array, zx: Array, zy: Array, zxy: Array) -> Array:
    """Compute patches from the values and slopes (nx, ny) at the nodes."""
    hx, hy = np.diff(x)[:, None], np.diff(y)
    by_x = (z, zx), (zy, zxy)
    corner = np.empty((x.size - 1, y.size - 1, 4, 4))
    ends = slice(None, -1), slice(1, None)
    for a, b, p, q in itertools.product((0, 1), repeat=4):
        corner[..., 2 * p + a, 2 * q + b] = by_x[q][p][ends[a], ends[b]] * hx**p * hy**q
    return np.ascontiguousarray(_HERMITE @ corner @ _HERMITE.T)


def _limited(
    x: Array, y: Array, z: Array, zx: Array, zy: Array, zxy: Array
) -> tuple[Array, Array, Array]:
    """Scale nodal derivatives until every Bézier control point is in the band of its cell."""
    # the control points of a node in one of its four cells are z, z + p, z + q and z + p + q + r
    # with p = dx z_x, q = dy z_y, r = dx dy z_xy; dx and dy are a third of its signed widths
    corners = np.stack([z[:-1, :-1], z[1:, :-1], z[:-1, 1:], z[1:, 1:]])
    floor = np.pad(corners.min(axis=0), 1, constant_values=-np.inf)
    ceiling = np.pad(corners.max(axis=0), 1, constant_values=np.inf)
    hx = np.pad(np.diff(x) / 3.0, 1, constant_values=1.0)[:, None]
    hy = np.pad(np.diff(y) / 3.0, 1, constant_values=1.0)[None, :]
    sides = ((-1.0, slice(None, -1)), (1.0, slice(1, None)))
    cells = [(a, rows, b, cols) for a, rows in sides for b, cols in sides]
    low = np.stack([floor[rows, cols] - z for _, rows, _, cols in cells])
    high = np.stack([ceiling[rows, cols] - z for _, rows, _, cols in cells])
    dx = np.stack([a * hx[rows] + 0.0 * z for a, rows, _, _ in cells])
    dy = np.stack([b * hy[:, cols] + 0.0 * z for _, _, b, cols in cells])

    def interval(base: Array | float, step: Array) -> tuple[Array, Array]:
        """Return the range of d with ``low <= base + step d <= high`` in all cells of a node."""
        a, b = (low - base) / step, (high - base) / step
        return np.minimum(a, b).max(axis=0), np.maximum(a, b).min(axis=0)

    zx, zy = np.clip(zx, *interval(0.0, dx)), np.clip(zy, *interval(0.0, dy))
    base = dx * zx + dy * zy
    least, most = interval(base, dx * dy)
    limit = np.where(base > 0.0, high, low)
    share = np.divide(limit, base, out=np.ones_like(base), where=base != 0.0).min(axis=0)
    share = np.where(least > most, np.minimum(share, 1.0), 1.0)
    least, most = interval(base * share, dx * dy)
    # ordered except for rounding
    zxy = np.clip(zxy, np.minimum(least, most), np.maximum(least, most))
    return zx * share, zy * share, zxy

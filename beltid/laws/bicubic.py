"""Bicubic patches over a rectangular grid that stay within the band of the values they join.

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

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, CubicSpline

Array = NDArray[np.float64]

# power-basis coefficients of a cubic from (value, value, slope, slope) at s = 0, 1
_HERMITE = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [-3.0, 3.0, -2.0, -1.0], [2.0, -2.0, 1.0, 1.0]]
)


def bounded_patches(x: Array, y: Array, z: Array) -> Array:
    """Compute the coefficients of bounded patches through values z (nx, ny) at x (nx,), y (ny,).

    They are those of :class:`beltid.laws.surface_tables.SurfaceTables`. With fewer than four nodes
    the spline has a lower degree.
    """
    if x.size == 1:  # represent a constant direction by one cell of width 1 with equal values
        x, z = np.array([0.0, 1.0]), np.repeat(z, 2, axis=0)
    if y.size == 1:
        y, z = np.array([0.0, 1.0]), np.repeat(z, 2, axis=1)
    zx = CubicSpline(x, z, axis=0)(x, 1)
    zy = CubicSpline(y, z, axis=1)(y, 1)
    zxy = CubicSpline(y, zx, axis=1)(y, 1)
    return hermite_patches(x, y, z, *_limited(x, y, z, zx, zy, zxy))


def bounded_cubic(x: Array, z: Array, at: Array) -> Array:
    """Evaluate a natural cubic spline that stays between neighbouring points, z at x (n,).

    Positions ``at`` (m,) lie within the points; a single point has its value everywhere.
    """
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
    hx, hy = np.diff(x)[:, None], np.diff(y)[None, :]
    corner = np.empty((x.size - 1, y.size - 1, 4, 4))
    for a, rows in enumerate((slice(None, -1), slice(1, None))):
        for b, cols in enumerate((slice(None, -1), slice(1, None))):
            corner[..., a, b] = z[rows, cols]
            corner[..., 2 + a, b] = zx[rows, cols] * hx
            corner[..., a, 2 + b] = zy[rows, cols] * hy
            corner[..., 2 + a, 2 + b] = zxy[rows, cols] * hx * hy
    return np.ascontiguousarray(_HERMITE @ corner @ _HERMITE.T)


def _limited(
    x: Array, y: Array, z: Array, zx: Array, zy: Array, zxy: Array
) -> tuple[Array, Array, Array]:
    """Scale nodal derivatives until every Bézier control point is in the band of its cell.

    The control points of a node in one of its four cells are ``z``, ``z + p``, ``z + q`` and
    ``z + p + q + r`` with ``p = dx z_x``, ``q = dy z_y``, ``r = dx dy z_xy`` and a third of the
    signed widths of the cell, dx and dy. First p and q are clipped to the band, then r; where no r
    is possible, p and q shrink together.
    """
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

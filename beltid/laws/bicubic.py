"""Bicubic patches over a rectangular grid that stay within the band of the values they join.

The patches form the C2 tensor-product cubic spline (not-a-knot ends) in the coordinates

    x = ln(1 + f / f_ref),    y = ln(1 + v / v_ref)

with the smallest positive node as reference. Friction benches space their settings geometrically,
and friction laws are nearly straight in logarithms. On the 8 x 5 grids of the virtual benches the
largest interpolation error of the three known laws is

    ==========================  ===========  ===========  ===========
    coordinates, end condition  4pk          5pk          6pk
    ==========================  ===========  ===========  ===========
    f, v          not-a-knot    0.92 %       0.76 %       0.59 %
    f, v          natural       1.16 %       1.10 %       0.88 %
    x, y          natural       0.33 %       0.32 %       0.25 %
    x, y          not-a-knot    0.067 %      0.064 %      0.049 %
    ==========================  ===========  ===========  ===========

The plain logarithm would be even better (0.011 % at worst), but a grid may begin at zero, hence
``ln(1 + .)``.

A spline through noisy values overshoots them. The derivatives at the nodes are therefore scaled
down where needed until the 16 Bézier control points of every cell lie in the band of its four
corner values; a patch is a convex combination of its control points. Where nothing is scaled, the
surface *is* the C2 spline; elsewhere it is C1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, CubicSpline

Array = NDArray[np.float64]

# power-basis coefficients of a cubic from (value, value, slope, slope) at s = 0, 1
_HERMITE = np.array(
    [
        [1.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
        [-3.0, 3.0, -2.0, -1.0],
        [2.0, -2.0, 1.0, 1.0],
    ]
)


def patches(x: Array, y: Array, z: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Compute the coefficients of the bounded bicubic patches through the values ``z``.

    Parameters
    ----------
    x : ndarray (nx,)
        Strictly increasing.
    y : ndarray (ny,)
        Strictly increasing.
    z : ndarray (nx, ny)
        Values at the nodes.

    Returns
    -------
    C : ndarray (max(nx - 1, 1), max(ny - 1, 1), 4, 4)
        As in :class:`beltid.laws.surface_tables.SurfaceTables`.
    limited : ndarray of bool (nx, ny)
        Nodes whose derivatives were scaled down to keep the surface inside the band.
    """
    nx, ny = z.shape
    if nx == 1:  # represent a constant direction by one cell of width 1 with equal values
        x, z = np.array([0.0, 1.0]), np.repeat(z, 2, axis=0)
    if ny == 1:
        y, z = np.array([0.0, 1.0]), np.repeat(z, 2, axis=1)
    zx, zy, zxy, limited = _limit(x, y, z, *_nodal_derivatives(x, y, z))
    return hermite_patches(x, y, z, zx, zy, zxy), limited[:nx, :ny]


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


def _nodal_derivatives(x: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
    """Return z_x, z_y, z_xy of the tensor spline; a parabola of three nodes, a line of two."""
    zx = CubicSpline(x, z, axis=0)(x, 1)
    zy = CubicSpline(y, z, axis=1)(y, 1)
    zxy = CubicSpline(y, zx, axis=1)(y, 1)
    return zx, zy, zxy


def hermite_patches(x: Array, y: Array, z: Array, zx: Array, zy: Array, zxy: Array) -> Array:
    """Compute bicubic patches from the values and slopes at the nodes.

    Parameters
    ----------
    x, y : ndarray (nx,), (ny,)
        Strictly increasing.
    z, zx, zy, zxy : ndarray (nx, ny)
        Values at the nodes and their derivatives.

    Returns
    -------
    ndarray (nx - 1, ny - 1, 4, 4)
        Coefficients as in :class:`beltid.laws.surface_tables.SurfaceTables`.
    """
    hx, hy = np.diff(x)[:, None], np.diff(y)[None, :]
    corner = np.empty((x.size - 1, y.size - 1, 4, 4))
    for a, rows in enumerate((slice(None, -1), slice(1, None))):
        for b, cols in enumerate((slice(None, -1), slice(1, None))):
            corner[..., a, b] = z[rows, cols]
            corner[..., 2 + a, b] = zx[rows, cols] * hx
            corner[..., a, 2 + b] = zy[rows, cols] * hy
            corner[..., 2 + a, 2 + b] = zxy[rows, cols] * hx * hy
    return np.ascontiguousarray(_HERMITE @ corner @ _HERMITE.T)


def _quadrants(x: Array, y: Array, z: Array) -> tuple[Array, ...]:
    """Return the permitted range of the control points of each node in its four cells (4, nx, ny).

    `low` and `high` are the band of the cell minus the value of the node (``low <= 0 <= high``,
    infinite where there is no cell); `dx` and `dy` are a third of the signed cell widths.
    """
    corners = np.stack([z[:-1, :-1], z[1:, :-1], z[:-1, 1:], z[1:, 1:]])
    low = np.pad(corners.min(axis=0), 1, constant_values=-np.inf)
    high = np.pad(corners.max(axis=0), 1, constant_values=np.inf)
    hx = np.pad(np.diff(x), 1, constant_values=1.0)[:, None] / 3.0
    hy = np.pad(np.diff(y), 1, constant_values=1.0)[None, :] / 3.0
    sides = ((-1.0, slice(None, -1)), (1.0, slice(1, None)))
    parts = [
        np.broadcast_arrays(low[ix, iy] - z, high[ix, iy] - z, sx * hx[ix], sy * hy[:, iy])
        for sx, ix in sides
        for sy, iy in sides
    ]
    return tuple(np.stack(column) for column in zip(*parts, strict=True))


def _interval(low: Array, high: Array, step: Array) -> tuple[Array, Array]:
    """Return the range of d with ``low <= step d <= high`` in all quadrants, each (nx, ny)."""
    a, b = low / step, high / step
    return np.minimum(a, b).max(axis=0), np.maximum(a, b).min(axis=0)


def _limit(
    x: Array, y: Array, z: Array, zx: Array, zy: Array, zxy: Array
) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Scale nodal derivatives until every Bézier control point is in the band of its cell.

    The control points of a node in one of its cells are ``z``, ``z + p``, ``z + q`` and
    ``z + p + q + r`` with ``p = dx z_x``, ``q = dy z_y``, ``r = dx dy z_xy``. First p and q are
    clipped to the band, then r; where no r is possible, p and q shrink together.
    """
    low, high, dx, dy = _quadrants(x, y, z)
    gx = np.clip(zx, *_interval(low, high, dx))
    gy = np.clip(zy, *_interval(low, high, dy))

    def twist_range() -> tuple[Array, Array]:
        base = dx * gx + dy * gy
        return _interval(low - base, high - base, dx * dy)

    lowest, highest = twist_range()
    infeasible = lowest > highest
    if np.any(infeasible):
        base = dx * gx + dy * gy
        limit = np.where(base > 0.0, high, low)
        share = np.divide(limit, base, out=np.ones_like(base), where=base != 0.0).min(axis=0)
        share = np.where(infeasible, np.minimum(share, 1.0), 1.0)
        gx, gy = gx * share, gy * share
        lowest, highest = twist_range()
        # equal except for rounding
        lowest, highest = np.minimum(lowest, highest), np.maximum(lowest, highest)
    gxy = np.clip(zxy, lowest, highest)
    step_x, step_y = np.abs(dx).max(axis=0), np.abs(dy).max(axis=0)
    change = (
        np.abs(gx - zx) * step_x + np.abs(gy - zy) * step_y + np.abs(gxy - zxy) * step_x * step_y
    )
    return gx, gy, gxy, change > 1e-10 * np.abs(z).max()

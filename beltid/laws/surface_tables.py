"""A friction surface as plain tables, and the two functions that evaluate it everywhere.

Compiled kernels cannot take objects, so they take the arrays of :class:`SurfaceTables`. The bodies
of :func:`locate` and :func:`evaluate_cell` hold for numbers and for arrays: kernels compile them
unchanged for one point, :class:`beltid.laws.friction_surface.FrictionSurface` calls them with many.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class SurfaceTables(NamedTuple):
    """A friction surface as plain arrays, for compiled kernels.

    Attributes
    ----------
    x_nodes, y_nodes : ndarray (nx,), (ny,)
        ``ln(1 + f / f_ref)`` of the force nodes and ``ln(1 + v / v_ref)`` of the speed nodes [-].
        With one node, mu does not depend on that variable.
    f_ref, v_ref : float
        Reference line force [N/m] and sliding speed [m/s]; infinite if the axis is the single
        node 0.
    C : ndarray (max(nx - 1, 1), max(ny - 1, 1), 4, 4)
        Coefficients of the cells: ``mu = sum_ab C[i, j, a, b] s**a t**b`` with
        ``s = (x - x_i)/(x_{i+1} - x_i)`` and ``t`` likewise, both in [0, 1].
    """

    x_nodes: Array
    y_nodes: Array
    f_ref: float
    v_ref: float
    C: Array


def log_nodes(nodes: Array) -> tuple[Array, float]:
    """Return ``ln(1 + node / reference)`` of the nodes (n,) of an axis, and the reference.

    That is the smallest positive node; infinite if there is none: all values have coordinate 0.
    """
    positive = nodes[nodes > 0.0]
    reference = float(positive[0]) if positive.size else math.inf
    return np.log1p(nodes / reference), reference


def locate(nodes: Any, reference: float, value: Any) -> tuple[Any, Any, Any]:
    """Find the cell and the local coordinate of values on one axis; outside, of the nearest node.

    ``nodes`` (n,) and ``reference`` are those of the axis; a value is a force [N/m] or the
    magnitude of a speed [m/s].

    Returns
    -------
    cell : int or ndarray
        Index of the cell.
    local : float or ndarray
        Coordinate in the cell, in [0, 1]; nan where the value is nan.
    slope : float or ndarray
        Derivative of the local coordinate with respect to the value; 0 outside the nodes.
    """
    x = np.log1p(np.maximum(value, 0.0) / reference)
    cell = 0
    if nodes.size == 1:
        return cell, 0.0 * x, 0.0 * x
    inside = np.minimum(np.maximum(x, nodes[0]), nodes[-1])
    for node in nodes[1:-1]:
        cell = cell + (inside >= node)
    width = nodes[cell + 1] - nodes[cell]
    is_inside = 1.0 * ((x == inside) & (value >= 0.0))
    return cell, (inside - nodes[cell]) / width, is_inside / (width * (reference + value))


def evaluate_cell(C: Any, i: Any, j: Any, s: Any, t: Any) -> tuple[Any, Any, Any]:
    """Evaluate mu in cells (i, j) at local coordinates s, t in [0, 1]; also return mu_s, mu_t."""
    mu = 0.0
    mu_s = 0.0
    mu_t = 0.0
    for a in range(3, -1, -1):  # Horner in s of the Horner sums in t
        c1, c2, c3 = C[i, j, a, 1], C[i, j, a, 2], C[i, j, a, 3]
        row = ((c3 * t + c2) * t + c1) * t + C[i, j, a, 0]
        row_t = (3.0 * c3 * t + 2.0 * c2) * t + c1
        mu_s = mu_s * s + mu
        mu = mu * s + row
        mu_t = mu_t * s + row_t
    return mu, mu_s, mu_t

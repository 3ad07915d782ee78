"""A friction surface as plain tables, and the functions that evaluate them.

Compiled kernels cannot take objects, so they take the arrays of :class:`SurfaceTables`. The bodies
of :func:`locate` and :func:`evaluate_cell` use only indexing and ``math``, so they can be compiled
unchanged.
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
    x_nodes : ndarray (nx,)
        ``ln(1 + f / f_ref)`` of the force nodes [-]. With one node, mu does not depend on the
        force.
    y_nodes : ndarray (ny,)
        ``ln(1 + v / v_ref)`` of the speed nodes [-], likewise.
    f_ref : float
        Reference line force [N/m]; infinite if the force axis is the single node 0.
    v_ref : float
        Reference sliding speed [m/s]; infinite if the speed axis is the single node 0.
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
    """Convert the nodes of an axis to logarithmic coordinates.

    Parameters
    ----------
    nodes : ndarray (n,)
        Strictly increasing, >= 0.

    Returns
    -------
    coordinate : ndarray (n,)
        ``ln(1 + node / reference)`` [-].
    reference : float
        Smallest positive node; infinite if there is none, so that every value has coordinate 0.
    """
    positive = nodes[nodes > 0.0]
    reference = float(positive[0]) if positive.size else math.inf
    # math.log1p, as in locate: both must give a node the same coordinate to the last bit
    return np.array([math.log1p(node / reference) for node in nodes]), reference


def locate(nodes: Any, reference: float, value: float) -> tuple[int, float, float]:
    """Find the cell and the local coordinate of a value on one axis of the tables.

    Parameters
    ----------
    nodes : sequence of float (n,)
        Coordinates of the nodes [-].
    reference : float
        ``f_ref`` or ``v_ref`` of the axis.
    value : float
        Force [N/m] or magnitude of the speed [m/s].

    Returns
    -------
    cell : int
        Index of the cell.
    local : float
        Coordinate in the cell, in [0, 1].
    slope : float
        Derivative of the local coordinate with respect to the value; 0 outside the nodes.
    """
    last = len(nodes) - 1
    if value < 0.0 or last == 0:
        return 0, 0.0, 0.0
    x = math.log1p(value / reference)
    if x < nodes[0]:
        return 0, 0.0, 0.0
    if x > nodes[last]:
        return last - 1, 1.0, 0.0
    cell = 0
    while cell < last - 1 and x >= nodes[cell + 1]:
        cell += 1
    width = nodes[cell + 1] - nodes[cell]
    return cell, (x - nodes[cell]) / width, 1.0 / (width * (reference + value))


def evaluate_cell(C: Any, i: Any, j: Any, s: Any, t: Any) -> tuple[Any, Any, Any]:
    """Evaluate the friction coefficient in a cell and its derivatives in local coordinates.

    Parameters
    ----------
    C : ndarray
        Coefficients of all cells; see :class:`SurfaceTables`.
    i, j : int or ndarray of int
        Cell on the force axis and on the speed axis; arrays of equal shape for several points.
    s, t : float or ndarray
        Local coordinates in the cell, in [0, 1].

    Returns
    -------
    mu, mu_s, mu_t : float or ndarray
        Friction coefficient [-] and its derivatives with respect to s and t.
    """
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

"""A friction surface as plain tables, and the scalar law that reads them.

Kernels that know no objects take the arrays of :class:`SurfaceTables`; the bodies of
:func:`locate`, :func:`evaluate_cell` and :func:`evaluate_tables` are fit for compilation as they
stand (indexing and ``math`` only).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceTables:
    """A friction surface as plain arrays, for kernels that know no objects.

    Attributes
    ----------
    x_nodes : ndarray (nx,)
        ``ln(1 + f / f_ref)`` of the force nodes [-]. One node: no dependence on that axis.
    y_nodes : ndarray (ny,)
        ``ln(1 + v / v_ref)`` of the speed nodes [-].
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
    """Nodes of an axis in logarithmic coordinates, and the reference value they are made with.

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
    # math.log1p, as in evaluate_tables: a node must have the same coordinate in both, to the bit
    return np.array([math.log1p(node / reference) for node in nodes]), reference


def locate(nodes: Any, reference: float, value: float) -> tuple[int, float, float, int]:
    """Cell and local coordinate of a value on one axis of the tables.

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
        Derivative of the local coordinate with respect to the value; 0 outside.
    outside : int
        1 if the value was clamped to the nearest node, else 0.
    """
    last = len(nodes) - 1
    if value < 0.0:
        return 0, 0.0, 0.0, 1
    if reference == math.inf:
        return 0, 0.0, 0.0, 0
    x = math.log1p(value / reference)
    if x < nodes[0]:
        return 0, 0.0, 0.0, 1
    if x > nodes[last]:
        if last == 0:
            return 0, 0.0, 0.0, 1
        return last - 1, 1.0, 0.0, 1
    if last == 0:
        return 0, 0.0, 0.0, 0
    cell = 0
    while cell < last - 1 and x >= nodes[cell + 1]:
        cell += 1
    width = nodes[cell + 1] - nodes[cell]
    return cell, (x - nodes[cell]) / width, 1.0 / (width * (reference + value)), 0


def evaluate_tables(
    x_nodes: Any, y_nodes: Any, f_ref: float, v_ref: float, C: Any, f: float, v: float
) -> tuple[float, float, float, int]:
    """Friction coefficient and its derivatives at one point.

    Parameters
    ----------
    x_nodes, y_nodes, f_ref, v_ref, C
        Fields of :class:`SurfaceTables`.
    f : float
        Normal force per length [N/m].
    v : float
        Sliding speed [m/s]; its sign does not matter for mu.

    Returns
    -------
    mu : float
        Friction coefficient [-]; of the nearest measured point outside the range.
    dmu_df : float
        Derivative with respect to f [m/N], 0 where f is outside.
    dmu_dv : float
        Derivative with respect to v [s/m], 0 where v is outside; odd in v.
    outside : int
        0 within the measured range, 1 if f is outside, 2 if v is, 3 if both are.
    """
    if f != f or v != v:
        return math.nan, math.nan, math.nan, 3
    i, s, ds_df, f_outside = locate(x_nodes, f_ref, f)
    j, t, dt_dv, v_outside = locate(y_nodes, v_ref, abs(v))
    mu, mu_s, mu_t = evaluate_cell(C, i, j, s, t)
    if v < 0.0:
        mu_t = -mu_t
    return mu, mu_s * ds_df, mu_t * dt_dv, f_outside + 2 * v_outside


def evaluate_cell(C: Any, i: int, j: int, s: float, t: float) -> tuple[float, float, float]:
    """Friction coefficient in cell (i, j) and its derivatives in the local coordinates s and t."""
    mu = 0.0
    mu_s = 0.0
    mu_t = 0.0
    for a in range(3, -1, -1):  # Horner in s of the Horner sums in t
        row = ((C[i, j, a, 3] * t + C[i, j, a, 2]) * t + C[i, j, a, 1]) * t + C[i, j, a, 0]
        row_t = (3.0 * C[i, j, a, 3] * t + 2.0 * C[i, j, a, 2]) * t + C[i, j, a, 1]
        mu_s = mu_s * s + mu
        mu = mu * s + row
        mu_t = mu_t * s + row_t
    return mu, mu_s, mu_t

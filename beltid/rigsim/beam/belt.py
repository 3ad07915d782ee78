"""Assemble the belt: shape functions at all points, internal and inertia forces, Eq. (10).

Coordinates are ordered node by node (x, y, x', y'). Residuals are internal minus external forces.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.params import Belt
from beltid.rigsim.banded import HALF
from beltid.rigsim.beam.ancf import (
    GAUSS_POINTS,
    length_powers,
    mass_matrix,
    section,
    shapes,
    strains,
    unit_shapes,
)
from beltid.rigsim.compiled import leaf, shared_leaf
from beltid.rigsim.compiled_laws import section_force

Array = NDArray[np.float64]


_x, _w = np.polynomial.legendre.leggauss(GAUSS_POINTS)
_AT_GAUSS_POINTS, _GAUSS_WEIGHTS = unit_shapes(0.5 * (_x + 1.0)), 0.5 * _w  # on [0, 1]


@functools.cache
def _at_middles(parts: int) -> Array:
    """Tabulate the shape functions at the midpoints of equal parts of an element."""
    return unit_shapes((np.arange(parts) + 0.5) / parts)


class BeltArrays(NamedTuple):
    """Properties of the belt that stay constant during a run, for compiled code.

    Attributes
    ----------
    h : ndarray, shape (n_e,)
        Reference lengths of the elements [m].
    B_s, B_ss : ndarray, shape (n_e, n_g, 4)
        First and second derivatives of the shape functions at the Gauss points.
    w_g : ndarray, shape (n_e, n_g)
        Weights of the Gauss points [m].
    N_c : ndarray, shape (n_e, n_c, 4)
        Shape functions at the contact points, the midpoints of n_c equal parts of each element.
    D_c : ndarray, shape (n_e, n_c, 4)
        Their first derivatives [1/m].
    w_c : ndarray, shape (n_e, n_c)
        Reference lengths of the parts that the contact points represent [m].
    M : ndarray, shape (n_e, 4, 4)
        Mass matrices of the shape functions [kg].
    EA, EI, damping_time : float
        Section properties, see :class:`beltid.params.Belt`.
    momentum : float
        Momentum flux of a running belt, ``m v0**2`` [N]; 0 for a belt that does not run.
    """

    h: Array
    B_s: Array
    B_ss: Array
    w_g: Array
    N_c: Array
    D_c: Array
    w_c: Array
    M: Array
    EA: float
    EI: float
    damping_time: float
    momentum: float


def belt_arrays(belt: Belt, nodes: Array, points_per_element: int) -> BeltArrays:
    """Tabulate shape functions, weights and masses of a belt on the ``nodes`` (n_e + 1,) [m]."""
    h = nodes[1:] - nodes[:-1]
    powers, at_middles = length_powers(h), _at_middles(points_per_element)
    return BeltArrays(
        h=h,
        B_s=shapes(_AT_GAUSS_POINTS, powers, 1),
        B_ss=shapes(_AT_GAUSS_POINTS, powers, 2),
        w_g=h[:, None] * _GAUSS_WEIGHTS,
        N_c=shapes(at_middles, powers, 0),
        D_c=shapes(at_middles, powers, 1),
        w_c=(h / points_per_element)[:, None].repeat(points_per_element, axis=1),
        M=mass_matrix(powers, belt.rhoA),
        EA=float(belt.EA),
        EI=float(belt.EI),
        damping_time=float(belt.damping_time),
        momentum=0.0,
    )


@leaf
def derivatives(belt: BeltArrays, q: Array, e: int, i: int) -> tuple[float, float, float, float]:
    """Return x and y of ``r'`` [-] and of ``r''`` [1/m] at a Gauss point."""
    ax = ay = bx = by = 0.0
    for j in range(4):
        ax += belt.B_s[e, i, j] * q[4 * e + 2 * j]
        ay += belt.B_s[e, i, j] * q[4 * e + 2 * j + 1]
        bx += belt.B_ss[e, i, j] * q[4 * e + 2 * j]
        by += belt.B_ss[e, i, j] * q[4 * e + 2 * j + 1]
    return ax, ay, bx, by


@leaf
def add_internal(
    belt: BeltArrays,
    q: Array,
    stretch: float,
    strain_old: Array,
    rate: float,
    A: Array,
    residual: Array,
    residual_stretch: Array,
) -> None:
    """Add the belt's internal forces, their tangent and their derivative in the stretch.

    Parameters
    ----------
    belt : BeltArrays
        The belt.
    q : ndarray, shape (n,)
        Nodal coordinates.
    stretch : float
        Stress-free length over reference length [-].
    strain_old : ndarray, shape (n_e, n_g, 2)
        Axial strain and curvature at the last step, for the strain rates of Eq. (9).
    rate : float
        1/dt [1/s]; 0 in statics.
    A : ndarray, shape (n, WIDTH)
        Banded tangent (added to).
    residual, residual_stretch : ndarray, shape (n,)
        Forces [N] and their derivative with respect to the stretch (added to).
    """
    tau = belt.damping_time * rate  # time in units of the step
    # strain and strain increment grow together in a step: evaluate the law at 1 for both
    EA = section_force(belt.EA, 1.0, 1.0, tau) - belt.momentum
    EI = section_force(belt.EI, 1.0, 1.0, tau)
    for e in range(belt.h.size):
        d = 4 * e
        for i in range(belt.w_g.shape[1]):
            N_s = belt.B_s[e, i]
            N_ss = belt.B_ss[e, i]
            ax, ay, bx, by = derivatives(belt, q, e, i)
            eps, kappa = strains(ax, ay, bx, by, stretch)
            N = section_force(belt.EA, eps, eps - strain_old[e, i, 0], tau)
            N -= belt.momentum * (1.0 + eps)
            M = section_force(belt.EI, kappa, kappa - strain_old[e, i, 1], tau)
            U = section(ax, ay, bx, by, (N, M), (EA, EI, stretch))
            w = belt.w_g[e, i]
            for j in range(4):
                r = d + 2 * j
                p, s = w * N_s[j], w * N_ss[j]
                residual[r] += p * U.a_x + s * U.b_x
                residual[r + 1] += p * U.a_y + s * U.b_y
                residual_stretch[r] += p * U.stretch_a_x + s * U.stretch_b_x
                residual_stretch[r + 1] += p * U.stretch_a_y + s * U.stretch_b_y
                x_ax, x_ay = p * U.aa_xx + s * U.ab_xx, p * U.aa_xy + s * U.ab_yx
                x_bx, x_by = p * U.ab_xx + s * U.bb_xx, p * U.ab_xy + s * U.bb_xy
                y_ax, y_ay = p * U.aa_xy + s * U.ab_xy, p * U.aa_yy + s * U.ab_yy
                y_bx, y_by = p * U.ab_yx + s * U.bb_xy, p * U.ab_yy + s * U.bb_yy
                for k in range(4):
                    c = HALF + 2 * (k - j)
                    A[r, c] += x_ax * N_s[k] + x_bx * N_ss[k]
                    A[r, c + 1] += x_ay * N_s[k] + x_by * N_ss[k]
                    A[r + 1, c - 1] += y_ax * N_s[k] + y_bx * N_ss[k]
                    A[r + 1, c] += y_ay * N_s[k] + y_by * N_ss[k]


@leaf
def add_inertia(belt: BeltArrays, dq: Array, rate2: float, A: Array, residual: Array) -> None:
    """Add ``M dq / dt**2`` with the constant mass matrix; ``rate2`` is 1/dt**2 [1/s²]."""
    for e in range(belt.h.size):
        d = 4 * e
        for j in range(4):
            for k in range(4):
                m = belt.M[e, j, k] * rate2
                r, c = d + 2 * j, HALF + 2 * (k - j)
                A[r, c] += m
                A[r + 1, c] += m
                residual[r] += m * dq[d + 2 * k]
                residual[r + 1] += m * dq[d + 2 * k + 1]


@shared_leaf
def store_strains(belt: BeltArrays, q: Array, stretch: float, out: Array) -> None:
    """Write axial strain and curvature at the Gauss points into ``out`` (n_e, n_g, 2)."""
    for e in range(belt.h.size):
        for i in range(belt.w_g.shape[1]):
            ax, ay, bx, by = derivatives(belt, q, e, i)
            out[e, i, 0], out[e, i, 1] = strains(ax, ay, bx, by, stretch)

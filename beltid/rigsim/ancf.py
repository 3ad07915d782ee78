"""Planar gradient-deficient ANCF cable element (Bernoulli–Euler).

A node carries its position ``r`` and its gradient ``r' = dr/ds``; cubic Hermite polynomials
interpolate between two nodes. ``s`` is the reference coordinate. The stress-free length of ``ds``
is ``stretch * ds``: one scalar for the whole belt, by which the rig is tightened. Per stress-free
length the strain energy is

    W = 1/2 EA eps**2 + 1/2 EI kappa**2,   eps = |r'|/stretch - 1,
    kappa = dtheta/dS = (r' x r'') / (|r'|**2 stretch),

with the engineering strain and the exact material curvature (rotation per stress-free length). With
Kelvin–Voigt material, Eq. (9), N = EA (eps + c/E eps_dot) and M = EI (kappa + c/E kappa_dot).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from beltid.rigsim.compiled import kernel, leaf

Array = NDArray[np.float64]

GAUSS_POINTS = 3


@kernel
def hermite(xi: Array, h: Array) -> tuple[Array, Array, Array]:
    """Shape functions of elements of length ``h`` and their first two derivatives in s.

    Parameters
    ----------
    xi : ndarray, shape (m,)
        Local coordinates in [0, 1].
    h : ndarray, shape (n_e,)
        Reference lengths of the elements [m].

    Returns
    -------
    N, N_s, N_ss : ndarray, shape (n_e, m, 4)
        Values, first [1/m] and second [1/m²] derivatives for (r_i, r'_i, r_j, r'_j); the functions
        of r' carry a length, so their units are [m], [-] and [1/m].
    """
    shape = (h.size, xi.size, 4)
    N, N_s, N_ss = np.empty(shape), np.empty(shape), np.empty(shape)
    for e in range(h.size):
        L = h[e]
        for i in range(xi.size):
            x = xi[i]
            N[e, i, 2] = x * x * (3.0 - 2.0 * x)
            N[e, i, 0] = 1.0 - N[e, i, 2]
            N[e, i, 1] = L * x * (1.0 - x) * (1.0 - x)
            N[e, i, 3] = L * x * x * (x - 1.0)
            N_s[e, i, 2] = 6.0 * x * (1.0 - x) / L
            N_s[e, i, 0] = -N_s[e, i, 2]
            N_s[e, i, 1] = 1.0 + x * (3.0 * x - 4.0)
            N_s[e, i, 3] = x * (3.0 * x - 2.0)
            N_ss[e, i, 2] = 6.0 * (1.0 - 2.0 * x) / (L * L)
            N_ss[e, i, 0] = -N_ss[e, i, 2]
            N_ss[e, i, 1] = (6.0 * x - 4.0) / L
            N_ss[e, i, 3] = (6.0 * x - 2.0) / L
    return N, N_s, N_ss


_UNIT_MASS = np.array(
    [
        [156.0, 22.0, 54.0, -13.0],
        [22.0, 4.0, 13.0, -3.0],
        [54.0, 13.0, 156.0, -22.0],
        [-13.0, -3.0, -22.0, 4.0],
    ]
)


@kernel
def mass_matrix(h: Array, rhoA: float) -> Array:
    """Consistent mass matrices of the shape functions, shape (n_e, 4, 4); constant, Eq. (10)."""
    M = np.empty((h.size, 4, 4))
    for e in range(h.size):
        for j in range(4):
            for k in range(4):
                length = h[e] ** (1 + j % 2 + k % 2)
                M[e, j, k] = rhoA * length / 420.0 * _UNIT_MASS[j, k]
    return M


@leaf
def strains(ax: float, ay: float, bx: float, by: float, stretch: float) -> tuple[float, float]:
    """Axial strain [-] and material curvature [1/m] of gradient ``a = r'`` and ``b = r''``."""
    p2 = ax * ax + ay * ay
    return math.sqrt(p2) / stretch - 1.0, (ax * by - ay * bx) / (p2 * stretch)


@leaf
def section(
    ax: float,
    ay: float,
    bx: float,
    by: float,
    forces: tuple[float, float],
    moduli: tuple[float, float, float],
    g: Array,
    H: Array,
    g_stretch: Array,
) -> None:
    """Gradient and tangent of the section's strain energy with respect to (r', r'').

    Parameters
    ----------
    ax, ay, bx, by : float
        Components of ``r'`` [-] and ``r''`` [1/m].
    forces : tuple
        Axial force N [N] and bending moment M [N m] at this state.
    moduli : tuple
        dN/d(eps) [N], dM/d(kappa) [N m²] and the stretch [-].
    g, H : ndarray, shape (4,), (4, 4)
        Gradient and tangent per reference length (output).
    g_stretch : ndarray, shape (4,)
        Derivative of ``g`` with respect to the stretch (output).
    """
    N, M = forces
    EA, EI, stretch = moduli
    p2 = ax * ax + ay * ay
    p = math.sqrt(p2)
    ex, ey = ax / p, ay / p
    c = ax * by - ay * bx
    i2 = 1.0 / p2
    k = c * i2
    # gradient of k = (r' x r'')/|r'|^2
    kax = (by - 2.0 * k * ax) * i2
    kay = (-bx - 2.0 * k * ay) * i2
    kbx = -ay * i2
    kby = ax * i2
    g[0] = N * ex + M * kax
    g[1] = N * ey + M * kay
    g[2] = M * kbx
    g[3] = M * kby
    # stretch: d(eps)/d(stretch) = -p/stretch^2, d(kappa)/d(stretch) = -k/stretch^2
    dN = -EA * p / (stretch * stretch)
    dM = -EI * k / (stretch * stretch)
    g_stretch[0] = dN * ex + dM * kax
    g_stretch[1] = dN * ey + dM * kay
    g_stretch[2] = dM * kbx
    g_stretch[3] = dM * kby
    # material part: rank one in eps and kappa; geometric part: N grad^2|r'| + M grad^2 k
    A = EA / stretch
    B = EI / stretch
    Np = N / p
    m4 = -2.0 * M * i2 * i2
    cax, cay = by, -bx
    H[0, 0] = A * ex * ex + B * kax * kax + Np * ey * ey
    H[0, 0] += m4 * (2.0 * cax * ax + c - 4.0 * c * ax * ax * i2)
    H[1, 1] = A * ey * ey + B * kay * kay + Np * ex * ex
    H[1, 1] += m4 * (2.0 * cay * ay + c - 4.0 * c * ay * ay * i2)
    H[0, 1] = A * ex * ey + B * kax * kay - Np * ex * ey
    H[0, 1] += m4 * (cax * ay + cay * ax - 4.0 * c * ax * ay * i2)
    H[0, 2] = B * kax * kbx - m4 * ax * ay
    H[0, 3] = B * kax * kby + m4 * ax * ax + M * i2
    H[1, 2] = B * kay * kbx - m4 * ay * ay - M * i2
    H[1, 3] = B * kay * kby + m4 * ax * ay
    H[2, 2] = B * kbx * kbx
    H[2, 3] = B * kbx * kby
    H[3, 3] = B * kby * kby
    H[1, 0] = H[0, 1]
    H[2, 0], H[2, 1] = H[0, 2], H[1, 2]
    H[3, 0], H[3, 1], H[3, 2] = H[0, 3], H[1, 3], H[2, 3]

"""Planar gradient-deficient ANCF cable element (Bernoulli–Euler).

The coordinates of a node are its position ``r`` and gradient ``r' = dr/ds``; cubic Hermite
polynomials interpolate between two nodes. ``s`` is the reference coordinate. The stress-free length
of ``ds`` is ``stretch * ds``; changing this one scalar tightens the whole belt. The strain energy
per stress-free length is

    W = 1/2 EA eps**2 + 1/2 EI kappa**2,   eps = |r'|/stretch - 1,
    kappa = dtheta/dS = (r' x r'') / (|r'|**2 stretch),

with the engineering strain and the exact material curvature (rotation per stress-free length). For
Kelvin–Voigt material, Eq. (9), N = EA (eps + c/E eps_dot) and M = EI (kappa + c/E kappa_dot).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.rigsim.compiled import leaf

Array = NDArray[np.float64]

GAUSS_POINTS = 3


CARRIES = np.array([0, 1, 0, 1])
"""Power of the element length in the shape functions for (r_i, r'_i, r_j, r'_j)."""
_POWERS = np.arange(-2.0, 4.0)


def length_powers(h: Array) -> Array:
    """Return the powers -2 to 3 of the element lengths ``h`` (n_e,) [m], shape (n_e, 6)."""
    return np.asarray(h[:, None] ** _POWERS)


def unit_shapes(xi: Array) -> Array:
    """Tabulate the shape functions, cubic Hermite polynomials, and their derivatives.

    Parameters
    ----------
    xi : ndarray, shape (m,)
        Local coordinates in [0, 1].

    Returns
    -------
    ndarray, shape (3, 6, 4 m)
        Values, first and second derivatives for (r_i, r'_i, r_j, r'_j) at each point, as
        coefficients of the powers of the element length, :func:`length_powers`.
    """
    x, x2 = xi, xi * xi * (3.0 - 2.0 * xi)
    N = np.stack([1.0 - x2, x * (1.0 - x) ** 2, x2, x * x * (x - 1.0)], axis=-1)
    x2_s = 6.0 * x * (1.0 - x)
    N_s = np.stack([-x2_s, 1.0 + x * (3.0 * x - 4.0), x2_s, x * (3.0 * x - 2.0)], axis=-1)
    x2_ss = 6.0 * (1.0 - 2.0 * x)
    N_ss = np.stack([-x2_ss, 6.0 * x - 4.0, x2_ss, 6.0 * x - 2.0], axis=-1)
    tables = np.zeros((3, _POWERS.size, x.size, 4))
    for order, values in enumerate((N, N_s, N_ss)):
        for j, carried in enumerate(CARRIES):
            tables[order, 2 + carried - order, :, j] = values[:, j]
    return tables.reshape(3, _POWERS.size, -1)


def shapes(unit: Array, powers: Array, order: int) -> Array:
    """Evaluate the shape functions, or their derivatives in s, of elements of given length.

    Parameters
    ----------
    unit : ndarray, shape (3, 6, 4 m)
        Table of the shape functions, :func:`unit_shapes`.
    powers : ndarray, shape (n_e, 6)
        Powers of the element lengths, :func:`length_powers`.
    order : int
        Order of the derivative, 0 to 2.

    Returns
    -------
    ndarray, shape (n_e, m, 4)
        For (r_i, r'_i, r_j, r'_j): [m**-order] for r, [m**(1 - order)] for r'.
    """
    values: Array = powers.dot(unit[order])  # "@" takes twice as long for small matrices
    return values.reshape(len(powers), -1, 4)


_UNIT_MASS = np.array(
    [
        [156.0, 22.0, 54.0, -13.0],
        [22.0, 4.0, 13.0, -3.0],
        [54.0, 13.0, 156.0, -22.0],
        [-13.0, -3.0, -22.0, 4.0],
    ]
)
_MASSES = np.stack(
    [np.where(1 + CARRIES[:, None] + CARRIES == k, _UNIT_MASS, 0.0).ravel() for k in _POWERS]
)


def mass_matrix(powers: Array, rhoA: float) -> Array:
    """Return the consistent mass matrices, shape (n_e, 4, 4); constant, Eq. (10)."""
    masses: Array = (rhoA / 420.0 * powers).dot(_MASSES)
    return masses.reshape(-1, 4, 4)


@leaf
def strains(ax: float, ay: float, bx: float, by: float, stretch: float) -> tuple[float, float]:
    """Return axial strain [-] and material curvature [1/m] for ``a = r'`` and ``b = r''``."""
    p2 = ax * ax + ay * ay
    return math.sqrt(p2) / stretch - 1.0, (ax * by - ay * bx) / (p2 * stretch)


class SectionEnergy(NamedTuple):
    """Derivatives of the strain energy of a section per reference length.

    ``a`` stands for ``r'`` and ``b`` for ``r''``: ``a_x`` is the first derivative with respect to
    the x component of ``r'``, ``stretch_a_x`` its derivative with respect to the stretch, and
    ``ab_xy`` the second derivative with respect to the x component of ``r'`` and the y component of
    ``r''``. The blocks ``aa`` and ``bb`` are symmetric.
    """

    a_x: float
    a_y: float
    b_x: float
    b_y: float
    stretch_a_x: float
    stretch_a_y: float
    stretch_b_x: float
    stretch_b_y: float
    aa_xx: float
    aa_xy: float
    aa_yy: float
    ab_xx: float
    ab_xy: float
    ab_yx: float
    ab_yy: float
    bb_xx: float
    bb_xy: float
    bb_yy: float


@leaf
def section(
    ax: float,
    ay: float,
    bx: float,
    by: float,
    forces: tuple[float, float],
    moduli: tuple[float, float, float],
) -> SectionEnergy:
    """Differentiate the strain energy of a section with respect to (r', r'') and the stretch.

    Parameters
    ----------
    ax, ay, bx, by : float
        Components of ``r'`` [-] and ``r''`` [1/m].
    forces : tuple
        Axial force N [N] and bending moment M [N m] at this state.
    moduli : tuple
        dN/d(eps) [N], dM/d(kappa) [N m²] and the stretch [-].
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
    # stretch: d(eps)/d(stretch) = -p/stretch^2, d(kappa)/d(stretch) = -k/stretch^2
    dN = -EA * p / (stretch * stretch)
    dM = -EI * k / (stretch * stretch)
    # material part: rank one each in eps and kappa; geometric part: N grad^2|r'| + M grad^2 k
    A = EA / stretch
    B = EI / stretch
    Np = N / p
    m4 = -2.0 * M * i2 * i2
    cax, cay = by, -bx
    aa_xx = A * ex * ex + B * kax * kax + Np * ey * ey
    aa_yy = A * ey * ey + B * kay * kay + Np * ex * ex
    aa_xy = A * ex * ey + B * kax * kay - Np * ex * ey
    return SectionEnergy(
        a_x=N * ex + M * kax,
        a_y=N * ey + M * kay,
        b_x=M * kbx,
        b_y=M * kby,
        stretch_a_x=dN * ex + dM * kax,
        stretch_a_y=dN * ey + dM * kay,
        stretch_b_x=dM * kbx,
        stretch_b_y=dM * kby,
        aa_xx=aa_xx + m4 * (2.0 * cax * ax + c - 4.0 * c * ax * ax * i2),
        aa_xy=aa_xy + m4 * (cax * ay + cay * ax - 4.0 * c * ax * ay * i2),
        aa_yy=aa_yy + m4 * (2.0 * cay * ay + c - 4.0 * c * ay * ay * i2),
        ab_xx=B * kax * kbx - m4 * ax * ay,
        ab_xy=B * kax * kby + m4 * ax * ax + M * i2,
        ab_yx=B * kay * kbx - m4 * ay * ay - M * i2,
        ab_yy=B * kay * kby + m4 * ax * ay,
        bb_xx=B * kbx * kbx,
        bb_xy=B * kbx * kby,
        bb_yy=B * kby * kby,
    )

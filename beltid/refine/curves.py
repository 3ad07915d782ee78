"""ln mu over ln f_N: one natural cubic spline per speed, and two measures of roughness.

The parameters are the values of ln mu at common knots in ln f_N, a column per speed. Beyond the
knots the nearest value applies, as everywhere in the package. Two quadratic forms measure the
roughness of a set of curves: the bending of each curve, and the difference in shape between
neighbouring speeds.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Curves:
    """Splines of ln mu over ln f_N at common knots.

    Parameters
    ----------
    log_force : ndarray, shape (k,)
        Knots in ln f_N, f_N in [N/m].
    log_speed : ndarray, shape (m,)
        ln of the speeds, v in [m/s], increasing.
    """

    log_force: Array
    log_speed: Array
    _cardinal: CubicSpline = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        # computed once, as every simulated run needs the basis
        cardinal = CubicSpline(self.log_force, np.eye(self.log_force.size), bc_type="natural")
        object.__setattr__(self, "_cardinal", cardinal)

    @property
    def size(self) -> int:
        """Number of parameters."""
        return self.log_force.size * self.log_speed.size

    def basis(self, log_force: Array) -> Array:
        """Evaluate ln mu per unit of each knot value, shape (n, k); constant beyond the knots."""
        inside = np.clip(log_force, self.log_force[0], self.log_force[-1])
        return np.asarray(self._cardinal(inside), dtype=float)

    def bending(self) -> Array:
        """Compute the quadratic form of the bending of all curves, shape (size, size).

        ``p' Q p`` is the integral of (d² ln mu / d(ln f)²)² over ln f, summed over the speeds. The
        parameters are ordered speed by speed.
        """
        block = self._integral(2)
        return np.asarray(np.kron(np.eye(self.log_speed.size), block), dtype=float)

    def difference(self) -> Array:
        """Compute the quadratic form of the difference in shape between neighbouring speeds.

        ``p' Q p`` is the integral of (d slope / d(ln v))² over ln f, with slope = d ln mu/d(ln f),
        summed over the gaps between speeds times their width. It is zero for mu = a(f) b(v).
        """
        block = self._integral(1)
        m = self.log_speed.size
        gaps = np.diff(self.log_speed)
        D = (np.eye(m, k=1) - np.eye(m))[: m - 1]
        coupling = D.T @ (D / gaps[:, None])
        return np.asarray(np.kron(coupling, block), dtype=float)

    def _integral(self, order: int) -> Array:
        """Integrate the products of the basis functions' derivatives over ln f, (k, k)."""
        x, w = np.polynomial.legendre.leggauss(4)
        mid = 0.5 * (self.log_force[1:] + self.log_force[:-1])
        half = 0.5 * np.diff(self.log_force)
        points = (mid[:, None] + half[:, None] * x).ravel()
        weights = (half[:, None] * w).ravel()
        values = np.asarray(self._cardinal(points, order), dtype=float)
        product: Array = values.T @ (weights[:, None] * values)
        return product

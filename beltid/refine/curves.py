"""ln mu over ln f_N: one natural cubic spline per speed, in coordinates that are smooth.

The values p of ln mu at common knots in ln f_N, speed by speed, are

    p = B h,    B = (levels and slope, curve, difference),

with a level for each speed and a slope that all share (free), a curve that all speeds share, and
the differences in slope between speeds. With h ~ N(0, 1) the curve has a white second derivative
over ln f_N of unit intensity, and the differences have a slope over ln f_N that is white in ln f_N
and in ln v: the integrals of (d² ln mu / d(ln f)²)² and of (d² ln mu / d ln f d ln v)² are h' h.
Beyond the knots the nearest value applies, as
everywhere in the package.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from beltid.laws.friction_surface import FrictionSurface

Array = NDArray[np.float64]

FINE_NODES = 48  # nodes of a tabulated curve, over the range of the knots
SPEED_BEND = 0.1
"""Standard deviation of the change of d ln mu / d ln v over one unit of ln v."""


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

    def basis(self, log_force: Array) -> Array:
        """Evaluate ln mu per unit of each knot value, shape (n, k); constant beyond the knots."""
        inside = np.clip(log_force, self.log_force[0], self.log_force[-1])
        return np.asarray(self._cardinal(inside), dtype=float)

    def by_speed(self, values: Array) -> Array:
        """Reshape values at the knots, speed by speed, to (m, k, ...)."""
        return np.asarray(
            values.reshape(self.log_speed.size, self.log_force.size, *values.shape[1:])
        )

    def coordinates(self) -> dict[str, Array]:
        """Return the columns of B by the name of their part; together they are square."""
        k, m = self.log_force.size, self.log_speed.size
        x = (self.log_force - self.log_force.mean())[:, None]
        D = np.diff(np.eye(m), axis=0)
        between = _unit(D.T @ (D / np.diff(self.log_speed)[:, None]))
        return {
            "level": np.hstack([np.kron(np.eye(m), np.ones((k, 1))), np.tile(x, (m, 1))]),
            "curve": np.tile(_unit(self._integral(2)), (m, 1)),
            "difference": np.kron(between, _unit(self._integral(1))),
        }

    def surfaces(self, values: Array) -> list[FrictionSurface]:
        """Tabulate the curve of each speed finely, as mu is a spline only in the logarithm."""
        log_force = np.linspace(self.log_force[0], self.log_force[-1], FINE_NODES)
        log_mu = self.by_speed(values) @ self.basis(log_force).T
        return [
            FrictionSurface(np.exp(log_force), [float(np.exp(v))], np.exp(row)[:, None])
            for v, row in zip(self.log_speed, log_mu, strict=True)
        ]

    def at_nodes(self, forces: Array, vectors: Array) -> Array:
        """Convert vectors at the knots (size, K) to values at forces and speeds, (nf, m, K)."""
        basis = self.basis(np.log(forces))
        return np.asarray(np.einsum("fk,vks->fvs", basis, self.by_speed(vectors)))

    def _integral(self, order: int) -> Array:
        """Integrate products of the derivatives of the basis functions over ln f, (k, k)."""
        x, w = np.polynomial.legendre.leggauss(3)
        half = 0.5 * np.diff(self.log_force)[:, None]
        points = self.log_force[:-1, None] + half * (1.0 + x)
        values = np.asarray(self._cardinal(points.ravel(), order), dtype=float)
        return np.asarray(values.T @ ((half * w).ravel()[:, None] * values))


def _unit(precision: Array) -> Array:
    """Return columns with unit normal coefficients for a singular inverse covariance."""
    values, vectors = np.linalg.eigh(precision)
    kept = values > 1e-9 * values[-1] if values[-1] > 0.0 else np.zeros(values.size, dtype=bool)
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]))

"""How smooth is the surface? Chosen by the data: marginal likelihood of a linear Gaussian model.

With data y = J p + noise, noise ~ N(0, s² diag(se²)), and the improper prior

    p ~ exp(-1/2 p' P p),   P = a Q_bending + b Q_difference,

the probability of the data given (s, a, b), with p integrated out, has a maximum where the model is
neither too stiff nor too loose (restricted maximum likelihood; D. J. C. MacKay, Neural Computation
4 (1992) 415). What P does not see (a level per speed and a common slope) is free.

Where noise hides the curvature, the marginal likelihood hardly falls towards a rigid power law, and
its maximum often lies there: the surface would then be surer of itself than it may be (its 95 %
intervals held the truth of curved laws in 73 % of cases). So s, a and b have wide log-normal priors
of their own: stated standard errors that are right within a half, curvatures of ln mu over ln f_N
of about 0.1, slopes that differ by some hundredths between speeds, each within a factor of two to
three at one standard deviation. Data that see the shape override them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

Array = NDArray[np.float64]

SMALLEST_SCALE, LARGEST_SCALE = 0.5, 20.0
# centre and width of ln of the hyperparameters before the data
SCALE_BEFORE = (0.0, 0.5)
BENDING_BEFORE = (5.0, 1.5)
DIFFERENCE_BEFORE = (7.0, 2.0)


@dataclass(frozen=True, slots=True)
class Smoothness:
    """Hyperparameters of the surface.

    Attributes
    ----------
    bending, difference : float
        Weights of the two roughnesses.
    noise_scale : float
        Factor on the stated standard errors that the data show [-].
    """

    bending: float
    difference: float
    noise_scale: float


@dataclass(frozen=True, slots=True)
class LinearModel:
    """Linearised data: ``y = J p + noise`` in units of the stated standard errors.

    Attributes
    ----------
    J : ndarray, shape (n, size)
        Sensitivities over standard errors.
    y : ndarray, shape (n,)
        Data over standard errors.
    bending, difference : ndarray, shape (size, size)
        Quadratic forms of the roughness.
    """

    J: Array
    y: Array
    bending: Array
    difference: Array

    def solve(self, smoothness: Smoothness) -> tuple[Array, Array]:
        """Most probable parameters (size,) and their covariance (size, size)."""
        A = self._normal(smoothness)
        factor = cho_factor(A)
        weight = 1.0 / smoothness.noise_scale**2
        mean = cho_solve(factor, weight * (self.J.T @ self.y))
        return np.asarray(mean), np.asarray(cho_solve(factor, np.eye(A.shape[0])))

    def effective_parameters(self, smoothness: Smoothness) -> float:
        """Number of parameters that the data determine: trace of the influence matrix."""
        _, covariance = self.solve(smoothness)
        data = self.J.T @ self.J / smoothness.noise_scale**2
        return float(np.trace(covariance @ data))

    def log_evidence(self, smoothness: Smoothness) -> float:
        """Logarithm of the marginal likelihood, up to a constant."""
        mean, _ = self.solve(smoothness)
        P = self.roughness(smoothness)
        residual = self.y - self.J @ mean
        eigenvalues = np.linalg.eigvalsh(P)
        seen = eigenvalues[eigenvalues > 1e-9 * eigenvalues[-1]]
        _, log_normal = np.linalg.slogdet(self._normal(smoothness))
        s2 = smoothness.noise_scale**2
        quadratic = residual @ residual / s2 + mean @ P @ mean
        return float(0.5 * (np.log(seen).sum() - log_normal - quadratic - self.y.size * np.log(s2)))

    def roughness(self, smoothness: Smoothness) -> Array:
        """Quadratic form of both roughnesses with their weights, shape (size, size)."""
        return smoothness.bending * self.bending + smoothness.difference * self.difference

    def _normal(self, smoothness: Smoothness) -> Array:
        A = self.J.T @ self.J / smoothness.noise_scale**2 + self.roughness(smoothness)
        return A + 1e-10 * np.trace(A) / A.shape[0] * np.eye(A.shape[0])


def choose_smoothness(model: LinearModel, start: Smoothness) -> Smoothness:
    """Most probable hyperparameters: marginal likelihood times their own wide priors."""
    several = bool(np.any(model.difference))

    def unpack(x: Array) -> Smoothness:
        b = float(np.exp(x[2])) if several else 0.0
        return Smoothness(float(np.exp(x[1])), b, float(np.exp(x[0])))

    bounds = [(np.log(SMALLEST_SCALE), np.log(LARGEST_SCALE)), (-6.0, 18.0), (-6.0, 18.0)]
    x0 = [np.log(start.noise_scale), np.log(start.bending), np.log(start.difference or 1.0)]
    n = 3 if several else 2
    before = np.array([SCALE_BEFORE, BENDING_BEFORE, DIFFERENCE_BEFORE][:n])

    def cost(x: Array) -> float:
        away = (x - before[:, 0]) / before[:, 1]
        return float(0.5 * away @ away) - model.log_evidence(unpack(x))

    best = minimize(
        cost,
        np.array(x0[:n]),
        bounds=bounds[:n],
        method="L-BFGS-B",
    )
    return unpack(best.x)

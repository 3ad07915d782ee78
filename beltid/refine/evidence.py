"""How smooth is the surface, how far do the arcs differ? Chosen by the data: marginal likelihood.

With the data of the runs in units of their standard errors, y = J p + s_a Z u + noise, where

    noise ~ N(0, s²)                one scale for all runs,
    s_a Z u, u ~ N(0, 1)            one effect for each arc setting (Z: sensitivity of each run to a
                                    factor on the surface, in the column of its arc),
    p ~ exp(-1/2 p' P p)            P = a Q_bending + b Q_difference, an improper prior,

the probability of the data given (s, a, b, s_a), with p and u integrated out, has a maximum where
the model is neither too stiff nor too loose (restricted maximum likelihood; D. J. C. MacKay, Neural
Computation 4 (1992) 415). What P does not see (a level per speed and a common slope) is free.

Where noise hides the curvature, the marginal likelihood hardly falls towards a rigid power law, and
its maximum often lies there: the surface would then be surer of itself than it may be (its 95 %
intervals held the truth of curved laws in 73 % of cases). So s, a and b have wide log-normal priors
of their own: stated standard errors that are right within a half, curvatures of ln mu over ln f_N
of about 0.1, slopes that differ by some hundredths between speeds, each within a factor of two to
three at one standard deviation. Data that see the shape override them.

A few arcs say little about the size of their differences: with three there are two degrees of
freedom, and the most probable s_a is too small in most draws. The mean of s_a² over its posterior
is taken in its place, which is what the variance of the surface asks for. Its prior (0.3 % within a
factor of three) is that of an arc set by a scale; a single arc has no effect of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.optimize import minimize

Array = NDArray[np.float64]

SMALLEST_SCALE, LARGEST_SCALE = 0.5, 20.0
# centre and width of ln of the hyperparameters before the data
SCALE_BEFORE = (0.0, 0.5)
BENDING_BEFORE = (5.0, 1.5)
DIFFERENCE_BEFORE = (7.0, 2.0)
ARCS_BEFORE = (np.log(3.0e-3), 2.0)
ARCS_RANGE = (np.log(1.0e-5), np.log(0.3))
ARCS_STEPS = 60  # of the quadrature over ln s_a


@dataclass(frozen=True, slots=True)
class Smoothness:
    """Hyperparameters of the surface.

    Attributes
    ----------
    bending, difference : float
        Weights of the two roughnesses.
    noise_scale : float
        Factor on the stated standard errors that the data show [-].
    arcs : float
        Standard deviation of ln mu between arc settings, beyond what the surface explains [-].
    """

    bending: float
    difference: float
    noise_scale: float
    arcs: float = 0.0


@dataclass(frozen=True, slots=True)
class Solution:
    """Most probable parameters and effects of the arcs, with their covariance.

    Attributes
    ----------
    parameters : ndarray, shape (size,)
        Of the surface.
    arcs : ndarray, shape (K,)
        Effect of each arc setting on ln mu.
    covariance : ndarray, shape (size, size)
        Of the parameters.
    arcs_covariance : ndarray, shape (K, K)
        Of the effects.
    gain : ndarray, shape (size, n)
        Derivatives of the parameters by the data (in units of their standard errors).
    """

    parameters: Array
    arcs: Array
    covariance: Array
    arcs_covariance: Array
    gain: Array


@dataclass(frozen=True, slots=True)
class LinearModel:
    """Linearised data: ``y = J p + arcs + noise`` in units of the stated standard errors.

    Attributes
    ----------
    J : ndarray, shape (n, size)
        Sensitivities over standard errors.
    y : ndarray, shape (n,)
        Data over standard errors.
    bending, difference : ndarray, shape (size, size)
        Quadratic forms of the roughness.
    Z : ndarray, shape (n, K)
        Sensitivities to the effect of each arc over standard errors; no columns for a single arc.
    """

    J: Array
    y: Array
    bending: Array
    difference: Array
    Z: Array

    def solve(self, smoothness: Smoothness) -> Solution:
        """Most probable parameters and effects."""
        size = self.J.shape[1]
        design, A = self._design(smoothness), self._normal(smoothness)
        covariance = cho_solve(cho_factor(A), np.eye(A.shape[0]))
        gain = covariance @ design.T / smoothness.noise_scale**2
        both = gain @ self.y
        return Solution(
            parameters=both[:size],
            arcs=smoothness.arcs * both[size:],
            covariance=covariance[:size, :size],
            arcs_covariance=smoothness.arcs**2 * covariance[size:, size:],
            gain=gain[:size],
        )

    def effective_parameters(self, smoothness: Smoothness) -> float:
        """Number of parameters that the data determine: trace of the influence matrix."""
        design = self._design(smoothness)
        data = design.T @ design / smoothness.noise_scale**2
        return float(np.trace(cho_solve(cho_factor(self._normal(smoothness)), data)))

    def log_evidence(self, smoothness: Smoothness) -> float:
        """Logarithm of the marginal likelihood, up to a constant."""
        design, A = self._design(smoothness), self._normal(smoothness)
        s2 = smoothness.noise_scale**2
        both = cho_solve(cho_factor(A), design.T @ self.y / s2)
        residual = self.y - design @ both
        eigenvalues = np.linalg.eigvalsh(self.roughness(smoothness))
        seen = eigenvalues[eigenvalues > 1e-9 * eigenvalues[-1]]
        _, log_normal = np.linalg.slogdet(A)
        quadratic = residual @ residual / s2 + both @ self._prior(smoothness) @ both
        return float(0.5 * (np.log(seen).sum() - log_normal - quadratic - self.y.size * np.log(s2)))

    def misfit(self, residual: Array, parameters: Array, smoothness: Smoothness) -> float:
        """Penalised misfit: ``r' V^-1 r + p' P p``, V the covariance of noise and arcs.

        `residual` (n,) is measured less simulated ln mu over standard errors, of whatever model:
        it need not be the linear one.
        """
        r = residual / smoothness.noise_scale
        B = self.Z * (smoothness.arcs / smoothness.noise_scale)
        b = B.T @ r
        explained = b @ np.linalg.solve(np.eye(b.size) + B.T @ B, b)
        return float(r @ r - explained + parameters @ self.roughness(smoothness) @ parameters)

    def roughness(self, smoothness: Smoothness) -> Array:
        """Quadratic form of both roughnesses with their weights, shape (size, size)."""
        return smoothness.bending * self.bending + smoothness.difference * self.difference

    def _design(self, smoothness: Smoothness) -> Array:
        return np.hstack([self.J, smoothness.arcs * self.Z])

    def _prior(self, smoothness: Smoothness) -> Array:
        return np.asarray(block_diag(self.roughness(smoothness), np.eye(self.Z.shape[1])))

    def _normal(self, smoothness: Smoothness) -> Array:
        design = self._design(smoothness)
        A = design.T @ design / smoothness.noise_scale**2 + self._prior(smoothness)
        return np.asarray(A + 1e-10 * np.trace(A) / A.shape[0] * np.eye(A.shape[0]))


def choose_smoothness(model: LinearModel, start: Smoothness) -> Smoothness:
    """Most probable hyperparameters: marginal likelihood times their own wide priors.

    `arcs` is the root of the posterior mean of its square, given the others.
    """
    # noise scale and bending always; the others where there are several speeds, several arcs
    free = np.array([True, True, bool(np.any(model.difference)), model.Z.shape[1] > 0])
    before = np.array([SCALE_BEFORE, BENDING_BEFORE, DIFFERENCE_BEFORE, ARCS_BEFORE])[free]
    limits = [(np.log(SMALLEST_SCALE), np.log(LARGEST_SCALE)), *2 * [(-6.0, 18.0)], ARCS_RANGE]
    started = [start.noise_scale, start.bending, start.difference or 1.0]
    x0 = np.append(np.log(started), np.log(start.arcs) if start.arcs else ARCS_BEFORE[0])

    def unpack(x: Array) -> Smoothness:
        values = np.zeros(4)
        values[free] = np.exp(x)
        scale, bending, difference, arcs = values.tolist()
        return Smoothness(bending, difference, scale, arcs)

    def cost(x: Array) -> float:
        away = (x - before[:, 0]) / before[:, 1]
        return float(0.5 * away @ away) - model.log_evidence(unpack(x))

    bounds = [limit for limit, chosen in zip(limits, free, strict=True) if chosen]
    limited = np.clip(x0[free], *np.transpose(bounds))
    # steps of the differences far above the rounding of a determinant
    options = {"eps": 1.0e-4, "ftol": 1.0e-12, "gtol": 1.0e-4}
    best = minimize(cost, limited, bounds=bounds, method="L-BFGS-B", options=options)
    found = unpack(best.x)
    return replace(found, arcs=_mean_square_root(model, found)) if free[3] else found


def _mean_square_root(model: LinearModel, found: Smoothness) -> float:
    """Root of the posterior mean of s_a², the other hyperparameters as found."""
    grid = np.linspace(*ARCS_RANGE, ARCS_STEPS)
    away = (grid - ARCS_BEFORE[0]) / ARCS_BEFORE[1]
    log_density = [model.log_evidence(replace(found, arcs=float(np.exp(x)))) for x in grid]
    log_density = np.array(log_density) - 0.5 * away**2
    density = np.exp(log_density - log_density.max())
    return float(np.sqrt(density @ np.exp(2.0 * grid) / density.sum()))

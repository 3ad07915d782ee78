"""Which tails the sticking peaks of a bench can have, and their posterior.

A tail a g(x) is a mixture of exponentials (:mod:`tail_shapes`): the centre l_c of its lengths is
log-normal, their widths s_slow and s_fast above and below it are exponential, and the height
a >= 0 is half-normal. The height is integrated out in closed form, the rest by importance sampling.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, logsumexp, ndtri

from beltid.identify.friction.tail_shapes import tail_coefficients

Array = NDArray[np.float64]

HEIGHT = 0.1
"""Standard deviation of the height a >= 0 of the tail, relative to the level (half-normal)."""
CENTRE = (5e-3, 0.2, 1.2)
"""Median of l_c: so many m, or this share of the longest travel if that is less; and the standard
deviation of ln l_c."""
WIDTH = 0.7
"""Mean of s_slow + s_fast (exponential)."""
GRID = (28, 7, 5)
"""Points of the first look over ln l_c, s_slow and s_fast."""
LOOKS = 10
RESOLVED = 0.15
"""Share of the points that must carry the posterior."""


@dataclass(frozen=True, slots=True, eq=False)
class Spectra:
    """Tails that stand for all tails of a bench.

    Attributes
    ----------
    points : ndarray, shape (3, n)
        ln l_c (l_c in m), s_slow and s_fast.
    tails : ndarray, shape (n, RANK)
        Tails of height 1.
    log_prior : ndarray, shape (n,)
        Logarithm of the prior probability that each stands for.
    """

    points: Array
    tails: Array
    log_prior: Array

    def posterior(self, M: Array, b: Array) -> tuple[Array, Array, Array]:
        """Logarithms of the probabilities (n,), most likely heights and roots of their precision.

        M (RANK, RANK) and b (RANK,) are the squares and products of the basis; the height is
        integrated out.
        """
        root = np.sqrt(
            np.maximum(np.sum((self.tails @ M) * self.tails, axis=1), 0.0) + 1.0 / HEIGHT**2
        )
        best = (self.tails @ b) / root**2
        u = best * root
        log_p = self.log_prior + 0.5 * u**2 + log_ndtr(u) - np.log(0.5 * root * HEIGHT)
        return log_p, best, root


@lru_cache(maxsize=1)
def _normal_points() -> Array:
    """Evenly spread points of three standard normal variables, shape (512, 3).

    Multiples of the powers of 1/g with g**4 = g + 1 fill the cube evenly (additive recurrence).
    """
    g = 1.2207440846057596
    even = (0.5 + np.outer(np.arange(1, 513), g ** -np.arange(1.0, 4.0))) % 1.0
    return np.asarray(ndtri(even))


def spectra_of(M: Array, b: Array, range_m: tuple[float, float]) -> Spectra:
    """Tails that stand for the posterior given squares (RANK, RANK) and products (RANK,).

    The posterior of quiet records is a narrow ridge. Importance sampling by a Gaussian closes in
    on it: what the points of one look do not resolve is made flatter till they do, and gives the
    Gaussian of the next look.
    """
    low = np.array([np.log(max(range_m[0], 2e-4)), 0.0, 0.0])
    high = np.array([np.log(min(max(range_m[1], 2e-3), 0.6)), 2.5, 2.0])
    middle = float(np.log(min(CENTRE[0], CENTRE[1] * range_m[1] / 3.0)))

    def weighed(points: Array, log_density: Array | float) -> Spectra:
        c, s, f = points
        log_prior = -0.5 * ((c - middle) / CENTRE[2]) ** 2 - (s + f) / WIDTH - log_density
        inside = np.all(points <= high[:, None], axis=0) & (c >= low[0])
        return Spectra(points, tail_coefficients(c, s, f), np.where(inside, log_prior, -np.inf))

    axes = [np.linspace(a, b, n) for a, b, n in zip(low, high, GRID, strict=True)]
    grid = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")])
    step = np.log((high - low) / (np.array(GRID) - 1.0))
    spectra = weighed(grid, -float(np.sum(step)))
    normal = _normal_points()
    enough = RESOLVED * len(normal)
    for _ in range(LOOKS):
        log_p = spectra.posterior(M, b)[0]
        away = log_p - np.max(log_p)
        flat, weight = 1.0, np.exp(away)
        while np.sum(weight) ** 2 < enough * np.sum(weight**2):
            flat *= 0.8
            weight = np.exp(flat * away)
        if flat == 1.0 and spectra.points.shape[1] == len(normal):
            break
        mean = np.average(spectra.points, axis=1, weights=weight)
        C = np.cov(spectra.points, aweights=weight)
        root = 1.3 * np.linalg.cholesky(C + np.diag((0.05 * np.exp(step)) ** 2))
        points = mean[:, None] + root @ normal.T
        points[1:] = np.abs(points[1:])
        # widths below zero are folded back: the density is that of all four signs
        log_q = [
            -0.5 * np.sum(np.linalg.solve(root, points * sign - mean[:, None]) ** 2, axis=0)
            for sign in np.array([[1, 1, 1], [1, -1, 1], [1, 1, -1], [1, -1, -1]])[:, :, None]
        ]
        log_det = float(np.sum(np.log(np.diag(root)))) + 1.5 * np.log(2.0 * np.pi)
        spectra = weighed(points, logsumexp(log_q, axis=0) - log_det + np.log(len(normal)))
    return spectra


@dataclass(frozen=True, slots=True, eq=False)
class TailPosterior:
    """Moments of a tail in the basis, shapes (RANK,) and (RANK, RANK)."""

    mean: Array
    covariance: Array
    log_evidence: float
    height: float


def summed(M: Array, b: Array, spectra: Spectra) -> TailPosterior:
    """Posterior of a tail from its squares (RANK, RANK) and products (RANK,)."""
    C = spectra.tails
    log_p, best, root = spectra.posterior(M, b)
    total = float(logsumexp(log_p))
    weight = np.exp(log_p - total)
    u = best * root
    # moments of a height >= 0
    ratio = np.exp(-0.5 * u**2 - log_ndtr(u)) / np.sqrt(2.0 * np.pi)
    height = best + ratio / root
    square = height**2 + np.maximum(1.0 - ratio * (u + ratio), 1e-12) / root**2
    mean = (weight * height) @ C
    second = (C * (weight * square)[:, None]).T @ C
    return TailPosterior(
        mean=mean,
        covariance=second - np.outer(mean, mean),
        log_evidence=total,
        height=float(weight @ height),
    )

"""Posterior of what all runs of a bench share: the tail of the sticking peak and common drifts.

What the bench does not know of them has one sign in all runs. Each drift, and each slow part of the
tail beyond the longest record, is a hypothesis of its own; they differ in the prior only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from beltid.identify.friction.spectra import Spectra, TailPosterior, spectra_of, summed
from beltid.identify.friction.tail_shapes import RANK, stretched, tail_coefficients

Array = NDArray[np.float64]

UNLIKE = 0.01
"""Deviations of a tail from its family: standard deviation of each of some exponentials with
lengths within the record, relative to the height."""
DRIFTING = 0.04
"""Probability that something drifts in all runs alike: the zero of either cell or of both, or the
friction itself."""
DRIFT_OF_ZERO, DRIFT_OF_MU = 4e-4, 0.03
"""Standard deviations of the drifts, in 1/s of the median initial tension, and over the sliding of
a run relative to mu."""
SLOW_PART = (0.07, 0.25, 0.15)
"""Probability that a part of the tail decays over a length beyond the longest record, its size
relative to the height and the standard deviation of that."""
STILL = 1e-6
"""Relative change of the tension in a second that is none: no rest is known better [1/s]."""
TREND = 0.4
"""Standard deviation of the powers with which the length of the tail goes with the settings."""
SETTINGS = 3
"""Settings that it goes with: speed, mean tension and level of ln(T_tight/T_slack), so the arc."""
SHARED = RANK + 3 + SETTINGS
"""Columns that all runs share: the basis of the tails, drifts of both cells and of mu, powers."""
DRIFTS, POWERS = slice(RANK, RANK + 3), slice(RANK + 3, SHARED)
"""Where the drifts and the powers are in them."""
BEFORE = np.array([1.0 - DRIFTING, *[DRIFTING / 4.0] * 4])
"""Probabilities of no drift, one of the tight, the slack, both cells, and of mu."""


@dataclass(frozen=True, slots=True, eq=False)
class Shared:
    """Posterior of what is the same in all runs: tail in the basis, drift of both cells [N/s].

    Attributes
    ----------
    mean : ndarray, shape (SHARED,)
        Posterior mean.
    factor : ndarray, shape (SHARED, k)
        Factor of its covariance, the largest direction first.
    log_evidence : float
        Logarithm of the integral over all of it.
    height : float
        Posterior mean of the height of the tail, relative to the level.
    powers : ndarray, shape (SETTINGS,)
        Powers of the settings with which its length goes.
    weights : ndarray, shape (5,)
        Probabilities of no drift, one of the tight, the slack, both cells, and of mu.
    spectra : Spectra
        Tails over which it was summed.
    """

    mean: Array
    factor: Array
    log_evidence: float
    height: float
    powers: Array
    weights: Array
    spectra: Spectra

    @property
    def rough(self) -> Rough:
        """What the next posterior starts from."""
        return Rough(max(self.height, 1e-3), self.powers, self.weights, self.spectra)

    @property
    def stretched_mean(self) -> Array:
        """The mean for tails that are stretched by the powers already."""
        return np.append(self.mean[: POWERS.start], np.zeros(SETTINGS))

    @property
    def deviations(self) -> Array:
        """What makes the tail higher and longer, by the logarithms of both (RANK, 2)."""
        return np.column_stack([self.mean[:RANK], stretched(self.mean[:RANK])])


@dataclass(frozen=True, slots=True, eq=False)
class RestSlopes:
    """Information on common drifts in the rest phases, as squares (2, 2) and products (2,)."""

    squares: Array
    products: Array


def rest_slopes(
    difference: Array, difference_se: Array, total: Array, total_se: Array, tension_N: Array
) -> RestSlopes:
    """What the slopes of the cells at rest say about a drift of all runs.

    Parameters
    ----------
    difference, total : ndarray
        Slopes of the difference (tight less slack) and of the sum of both cells [N/s], shape (R,).
    difference_se, total_se : ndarray
        Their standard errors.
    tension_N : ndarray
        Initial tensions [N].
    """
    n = difference.size
    squares, products = np.zeros((2, 2)), np.zeros(2)
    for slope, se, sign in ((difference, difference_se, -1.0), (total, total_se, 1.0)):
        weight = 1.0 / np.maximum(se, STILL * tension_N) ** 2
        mean = float(np.sum(weight * slope) / np.sum(weight))
        # slopes that differ by more than their noise are worth less
        excess = float(np.sum(weight * (slope - mean) ** 2)) / max(n - 1, 1)
        variance = max(excess, 1.0) / float(np.sum(weight))
        if sign > 0.0:
            variance += mean**2  # a slope of the sum may be all relaxation of the belt
        h = np.array([1.0, sign])
        squares += np.outer(h, h) / variance
        products += h * mean / variance
    return RestSlopes(squares, products)


@dataclass(frozen=True, slots=True, eq=False)
class Rough:
    """What is known roughly of the tail and the drift before they are sought.

    Attributes
    ----------
    height : float
        Height of the tail, relative to the level.
    powers : ndarray, shape (SETTINGS,)
        Powers of the settings that the tails were stretched by.
    weights : ndarray, shape (5,)
        Probabilities of the drifts.
    spectra : Spectra, optional
        Tails that stand for the posterior.
    """

    height: float
    powers: Array
    weights: Array
    spectra: Spectra | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """What is known of a bench beside its sliding phases.

    Attributes
    ----------
    rest : RestSlopes
        What the rest phases say about a common drift.
    unit_N : float
        Median initial tension [N].
    range_m : tuple of float
        Shortest and longest length of a tail that is looked for [m].
    """

    rest: RestSlopes
    unit_N: float
    range_m: tuple[float, float]


def posterior(M: Array, b: Array, given: Given, rough: Rough, every_drift: bool = True) -> Shared:
    """Posterior of the tail and the common drift.

    The squares and products of the shared columns, summed over the runs, are all that the runs say
    about them; the hypotheses differ in the prior only.

    Parameters
    ----------
    M, b : ndarray, shape (SHARED, SHARED), (SHARED,)
        Squares and products.
    given : Given
        What is known beside them.
    rough : Rough
        Tail and drift, roughly.
    every_drift : bool
        Each drift, and each slow part of the tail, is a hypothesis of its own; else one Gaussian
        has the moments of all drifts.
    """
    M, b = M.copy(), b.copy()
    cells = slice(RANK, RANK + 2)
    M[cells, cells] += given.rest.squares
    b[cells] += given.rest.products
    # the columns hold the change of the powers from what the tails were stretched by
    expected = np.zeros(SHARED)
    expected[POWERS] = -rough.powers
    D = np.zeros_like(M)
    D[POWERS, POWERS] = TREND**2 * np.eye(SETTINGS)
    shortest, longest = given.range_m
    low, high = np.log(max(shortest, 2e-4)), np.log(max(longest / 9.0, 1e-3))
    lengths = np.linspace(low, max(high, low + 1.0), 8)
    unlike = tail_coefficients(lengths, np.zeros(8), np.zeros(8))
    D[:RANK, :RANK] = (UNLIKE * rough.height) ** 2 * (unlike.T @ unlike)
    zero = DRIFT_OF_ZERO * given.unit_N
    drifts = np.array([[0, 0, 0], [zero, 0, 0], [0, zero, 0], [zero, zero, 0], [0, 0, DRIFT_OF_MU]])
    # one Gaussian with the moments of all drifts, to find where the tails are
    moments = np.einsum("h,hk,hl->kl", rough.weights, drifts, drifts)
    mixed = D + _blocks(np.zeros(RANK), moments)
    spectra = rough.spectra
    if every_drift or spectra is None:
        left = _free(M, mixed)[0]
        spectra = spectra_of(
            (left @ M)[:RANK, :RANK], (left @ (b - M @ expected))[:RANK], given.range_m
        )
    if not every_drift:
        candidates = [(0.0, _given(M, b, expected, mixed, spectra))]
    else:
        slow, part, scatter = SLOW_PART
        reach = np.log(np.clip(longest / 3.0 * np.array([1.0, 4.0]), 2e-4, 1.0))
        tails = rough.height * tail_coefficients(reach, np.zeros(2), np.zeros(2))
        extras = [(1.0 - slow, np.zeros(RANK)), *((slow / 2.0, tail) for tail in tails)]
        candidates = []
        for weight, drift in zip(BEFORE, drifts, strict=True):
            for q, tail in extras:
                more = expected.copy()
                more[:RANK] = part * tail
                prior = D + _blocks(scatter * tail, np.outer(drift, drift))
                candidates.append((np.log(weight * q), _given(M, b, more, prior, spectra)))
    log_p = np.array([prior + f[0].log_evidence for prior, f in candidates])
    found = [f for _, f in candidates]
    log_evidence = float(logsumexp(log_p))
    p = np.exp(log_p - log_evidence)
    means = np.array([mean for _, mean, _ in found])
    mean = p @ means
    away = means - mean
    second = np.tensordot(p, [C for *_, C in found], axes=1) + (away * p[:, None]).T @ away
    values, vectors = np.linalg.eigh(second)
    factor = (vectors * np.sqrt(np.maximum(values, 0.0)))[:, ::-1]
    best = found[int(np.argmax(p))][0]
    return Shared(
        mean=mean,
        factor=factor,
        log_evidence=log_evidence,
        height=best.height,
        powers=np.clip(rough.powers + mean[POWERS], -1.5, 1.5),
        weights=p.reshape(len(BEFORE), -1).sum(axis=1) if every_drift else rough.weights,
        spectra=spectra,
    )


def _blocks(extra: Array, drift: Array) -> Array:
    """Covariance of an extra tail, and of a drift."""
    D = np.zeros((SHARED, SHARED))
    D[:RANK, :RANK] = np.outer(extra, extra)
    D[DRIFTS, DRIFTS] = drift
    return D


def _free(M: Array, D: Array) -> tuple[Array, Array, float]:
    """Integrate a part u ~ N(0, D) out of the information M.

    Returns
    -------
    left, G, log_det : ndarray, ndarray, float
        ``left @ M`` and ``left @ b`` are the squares and products that are left, G is the
        covariance of u given the rest, log_det the logarithm of det(1 + M D).
    """
    values, vectors = np.linalg.eigh(D)
    F = vectors * np.sqrt(np.maximum(values, 0.0))
    inner = np.eye(len(D)) + F.T @ M @ F
    G = np.asarray(F @ np.linalg.solve(inner, F.T))
    G = 0.5 * (G + G.T)
    return np.eye(len(D)) - M @ G, G, float(np.linalg.slogdet(inner)[1])


def _given(
    M: Array, b: Array, more: Array, D: Array, spectra: Spectra
) -> tuple[TailPosterior, Array, Array]:
    """Posterior with a part v - [tail, 0] ~ N(more, D) integrated out: tail, mean, covariance."""
    left, G, log_det = _free(M, D)
    c = b - M @ more
    tail = summed((left @ M)[:RANK, :RANK], (left @ c)[:RANK], spectra)
    constant = 0.5 * float(c @ G @ c) + float(b @ more) - 0.5 * float(more @ M @ more)
    log_evidence = tail.log_evidence + constant - 0.5 * log_det
    mean = more + left.T[:, :RANK] @ tail.mean + G @ c
    covariance = left.T[:, :RANK] @ tail.covariance @ left[:RANK] + G
    return replace(tail, log_evidence=log_evidence), mean, covariance

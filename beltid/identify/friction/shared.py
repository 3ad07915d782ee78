"""Model the effects common to all runs of a bench: the tail of the sticking peak and drifts.

Rubber relaxes along a completely monotone curve, a mixture of exponentials over the travel x,

    g(x) = int w(ln l) exp(-x/l) d ln l,  w ~ exp(-(ln l - ln l_c)²/(2 s²)),
    s = s_slow for l > l_c, s_fast below.                                                    (S2)

The spectrum (l_c, s_slow, s_fast) includes the single exponential (s = 0) and, within a record,
approximates stretched exponentials, power laws and double exponentials to 1e-4 of
ln(T_tight/T_slack); the tail beyond the record may be off by some percent of the height. All tails
lie close to a space of a few dimensions and are stored as coefficients in a basis of that space.
The priors are log-normal for the centre l_c, exponential for the widths and half-normal for the
height a >= 0 of the tail a g; the height is integrated out in closed form, the rest by importance
sampling.

Errors of the tail and of the drifts have the same sign in all runs. Each drift, and each slow part
of the tail at least half as long as the longest record, is a separate hypothesis; the hypotheses
differ only in the prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.sparse import csr_array
from scipy.special import log_ndtr, ndtri

from beltid.identify.friction.rest import Rest

Array = NDArray[np.float64]


SHORTEST, LONGEST = 1e-4, 1.0
"""Range of the lengths of exponentials that the basis covers [m]."""
RANK = 14
"""Dimension of the basis; its error is at most 2e-3 of the height of a tail."""
HALF = np.arange(0.1, 3.0, 0.2)
"""Midpoints of each half of a spectrum, in units of its width."""


TABLE = np.linspace(np.log(SHORTEST), np.log(LONGEST), 1024)
"""Logarithms of the lengths at which the coefficients of exponentials are tabulated."""


@lru_cache(maxsize=1)
def _basis() -> tuple[Array, Array, Array, Array]:
    """Build the basis: lengths of exponentials, their mix to basis functions, and two tables.

    Shapes (k,), (k, RANK). The tables hold, in that basis, the exponentials at :data:`TABLE`
    (., RANK) and -x d/dx of every function (RANK, RANK).
    """
    lengths = np.geomspace(SHORTEST, LONGEST, 45)
    x = np.concatenate([[0.0], np.geomspace(0.25 * SHORTEST, 2.0 * LONGEST, 120)])
    _, size, across = np.linalg.svd(np.exp(-x[:, None] / lengths), full_matrices=False)
    mix = across[:RANK].T / size[:RANK]
    basis = np.exp(-x[:, None] / lengths) @ mix
    exponentials = np.exp(-x / np.exp(TABLE)[:, None]) @ basis
    slope = (x[:, None] / lengths * np.exp(-x[:, None] / lengths)) @ mix
    return lengths, mix, exponentials, slope.T @ basis


def tail_basis(travel: Array) -> Array:
    """Evaluate the basis functions at travels [m], shape (n, RANK)."""
    lengths, mix, _, _ = _basis()
    return np.asarray(np.exp(-travel[:, None] / lengths) @ mix)


def tail_coefficients(log_centre: Array, slow: Array, fast: Array) -> Array:
    """Compute the coefficients of the tails of spectra, shape (n, RANK).

    Parameters
    ----------
    log_centre : ndarray
        ln l_c, l_c in m, shape (n,).
    slow, fast : ndarray
        Widths of the spectrum above and below l_c in ln l, >= 0, shape (n,).
    """
    _, _, exponentials, _ = _basis()
    floor = 1e-3  # of a width: the single exponential
    slow, fast = np.maximum(slow, floor), np.maximum(fast, floor)
    away = np.concatenate([slow[:, None] * HALF, -fast[:, None] * HALF], axis=1)
    weight = np.exp(-0.5 * np.concatenate([HALF, HALF]) ** 2)
    weight = weight * np.repeat(np.stack([slow, fast], axis=1), HALF.size, axis=1)
    weight /= weight.sum(axis=1, keepdims=True)
    position = (log_centre[:, None] + away - TABLE[0]) / (TABLE[1] - TABLE[0])
    position = np.clip(position, 0.0, TABLE.size - 1.0)
    below = np.minimum(position.astype(np.intp), TABLE.size - 2)
    fraction = position - below
    # interpolate linearly in the table: weights of the two neighbours of every node
    shares = np.concatenate([weight * (1.0 - fraction), weight * fraction], axis=1)
    columns = np.concatenate([below, below + 1], axis=1)
    ends = np.arange(0, columns.size + 1, columns.shape[1])
    mixing = csr_array((shares.ravel(), columns.ravel(), ends), (len(columns), TABLE.size))
    return np.asarray(mixing @ exponentials)


def stretched(coefficients: Array) -> Array:
    """Differentiate tails with respect to the logarithm of their length (..., RANK)."""
    return np.asarray(coefficients @ _basis()[3])


def stretching(log_factor: Array) -> Array:
    """Return matrices E that stretch tails, ``c -> E c``, by exp(log_factor), (n, RANK, RANK).

    Exact for tails in the space of the basis: E = exp(log_factor S) with S of `stretched`.
    """
    return np.asarray(expm(np.asarray(log_factor)[:, None, None] * _basis()[3].T))


HEIGHT = 0.1
"""Standard deviation of the height a >= 0 of the tail, relative to the level (half-normal)."""
CENTRE = (5e-3, 0.2, 1.2)
"""Median of l_c: the smaller of a length [m] and a share of the longest travel; and the standard
deviation of ln l_c."""
WIDTH = 0.7
"""Mean of s_slow and of s_fast (each exponential)."""
GRID = (28, 7, 5)
"""Grid points of the first iteration over ln l_c, s_slow and s_fast."""
LOOKS = 10
"""Largest number of iterations of the importance sampling."""
RESOLVED = 0.15
"""Smallest effective share of the points that resolves the posterior."""


@dataclass(frozen=True, slots=True, eq=False)
class Spectra:
    """Sample of tails that represents the possible tails of a bench.

    Attributes
    ----------
    points : ndarray, shape (3, n)
        ln l_c (l_c in m), s_slow and s_fast.
    tails : ndarray, shape (n, RANK)
        Tails of height 1.
    log_prior : ndarray, shape (n,)
        Logarithm of the prior probability that each represents.
    """

    points: Array
    tails: Array
    log_prior: Array

    def posterior(self, M: Array, b: Array) -> tuple[Array, Array, Array]:
        """Return log probabilities, most likely heights and roots of their precision (n,).

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
    """Return quasi-random points of three standard normal variables, shape (512, 3).

    Multiples of the powers of 1/g with g**4 = g + 1 fill the cube evenly (additive recurrence).
    """
    g = 1.2207440846057596
    even = (0.5 + np.outer(np.arange(1, 513), g ** -np.arange(1.0, 4.0))) % 1.0
    return np.asarray(ndtri(even))


def spectra_of(
    M: Array, b: Array, range_m: tuple[float, float], start: Spectra | None = None
) -> Spectra:
    """Sample tails from the posterior given squares (RANK, RANK) and products (RANK,).

    The posterior of quiet records is a narrow ridge. Importance sampling with a Gaussian converges
    on it iteratively: a posterior that the points do not resolve is flattened until they do, and
    gives the Gaussian of the next iteration. The first iteration uses a grid, or the tails of a
    similar posterior.
    """
    low = np.array([np.log(max(range_m[0], 2e-4)), 0.0, 0.0])
    high = np.array([np.log(min(max(range_m[1], 2e-3), 0.6)), 2.5, 2.0])
    middle = float(np.log(min(CENTRE[0], CENTRE[1] * range_m[1] / 3.0)))

    def weighed(points: Array, log_density: Array | float) -> Spectra:
        c, s, f = points
        log_prior = -0.5 * ((c - middle) / CENTRE[2]) ** 2 - (s + f) / WIDTH - log_density
        inside = np.all(points <= high[:, None], axis=0) & (c >= low[0])
        return Spectra(points, tail_coefficients(c, s, f), np.where(inside, log_prior, -np.inf))

    step = np.log((high - low) / (np.array(GRID) - 1.0))
    if start is None:
        axes = [np.linspace(a, b, n) for a, b, n in zip(low, high, GRID, strict=True)]
        grid = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")])
        start = weighed(grid, -float(np.sum(step)))
    spectra = start
    normal = _normal_points()
    enough = RESOLVED * len(normal)
    for _ in range(LOOKS):
        log_p = spectra.posterior(M, b)[0]
        away = log_p - np.max(log_p)
        flat, weight = 1.0, np.exp(away)
        while np.sum(weight) ** 2 < enough * np.sum(weight**2):
            flat *= 0.8
            weight = np.exp(flat * away)
        if flat == 1.0 and spectra is not start:
            break
        mean = np.average(spectra.points, axis=1, weights=weight)
        C = np.cov(spectra.points, aweights=weight)
        root = 1.3 * np.linalg.cholesky(C + np.diag((0.05 * np.exp(step)) ** 2))
        points = mean[:, None] + root @ normal.T
        points[1:] = np.abs(points[1:])
        # negative widths are reflected: the density sums over all four combinations of signs
        log_q = [
            -0.5 * np.sum(np.linalg.solve(root, points * sign - mean[:, None]) ** 2, axis=0)
            for sign in np.array([[1, 1, 1], [1, -1, 1], [1, 1, -1], [1, -1, -1]])[:, :, None]
        ]
        log_det = float(np.sum(np.log(np.diag(root)))) + 1.5 * np.log(2.0 * np.pi)
        spectra = weighed(points, np.logaddexp.reduce(log_q) - log_det + np.log(len(normal)))
    return spectra


def summed(M: Array, b: Array, spectra: Spectra) -> tuple[Array, Array, float, float]:
    """Compute the posterior of a tail from its squares (RANK, RANK) and products (RANK,).

    Returns
    -------
    mean, covariance : ndarray, shape (RANK,), (RANK, RANK)
        Mean and covariance of the coefficients of the tail.
    log_evidence, height : float
        Logarithm of the integral over all tails, and the mean of their heights.
    """
    C = spectra.tails
    log_p, best, root = spectra.posterior(M, b)
    total = float(np.logaddexp.reduce(log_p))
    weight = np.exp(log_p - total)
    u = best * root
    # moments of a height >= 0
    ratio = np.exp(-0.5 * u**2 - log_ndtr(u)) / np.sqrt(2.0 * np.pi)
    height = best + ratio / root
    square = height**2 + np.maximum(1.0 - ratio * (u + ratio), 1e-12) / root**2
    mean = (weight * height) @ C
    second = (C * (weight * square)[:, None]).T @ C
    return mean, second - np.outer(mean, mean), total, float(weight @ height)


SLOW_TAKE_UP = np.geomspace(0.5, 5.0, 4)
"""Lengths of slow decays of the build-up, over its travel: if friction grows strongly with speed,
the belt slides more slowly while its tensions still separate, and part of a build-up may take
several times as long as the rest. It resembles the tail of the peak; the fit separates the two."""
UNLIKE = np.array([[0.01, 0.0], [0.03, 0.0], [0.01, 0.05], [0.1, 0.0]])
"""Deviations from the model, one hypothesis per row: deviation of the tail from its family, as the
standard deviation of each of several exponentials with lengths within two thirds of the record,
relative to the height; and of each slow decay of the build-up, relative to the level."""
UNLIKE_BEFORE = np.array([0.75, 0.15, 0.05, 0.05])
"""Prior probabilities of them. The runs decide: one size for all benches would be too small for
quiet records of another family, or would widen the intervals of all others."""
DRIFTING = 0.08
"""Prior probability of a drift common to all runs: of the zeros of the cells or the friction."""
DRIFTS_OF = np.array(
    [np.diag(np.square(sd)) for sd in ([0, 0, 0], [2e-4, 2e-4, 0], [6e-4, 6e-4, 0], [0, 0, 0.03])]
)
"""Covariances of the drifts: none; small and large drifts of the zeros of both cells, in 1/s of the
median initial tension; and a drift of the friction over the sliding of a run, relative to mu."""
BEFORE = np.append(1.0 - DRIFTING, DRIFTING * np.array([0.45, 0.45, 0.1]))
"""Prior probabilities of them."""
SLOW_PART = (0.05, 0.25, 0.15)
"""Probability that part of the tail decays over a length of about the longest record or more; its
size relative to the height, and the standard deviation of that size."""
SLOW_LENGTHS = np.array([0.5, 1.0, 2.0, 4.0])
"""Lengths of such a part, over the longest record; the data cannot resolve lengths in between."""
STILL = 1e-6
"""Smallest standard error of the slope at rest, relative to the tension [1/s]."""
TREND = 0.4
"""Standard deviation of the powers of the settings in the length of the tail."""
SETTINGS = 3
"""Settings that affect it: speed, mean tension and level of ln(T_tight/T_slack), thus the arc."""
SHARED = RANK + 3 + SETTINGS + SLOW_TAKE_UP.size
"""Columns common to all runs: the basis of the tails, drifts of both cells and of mu, powers, slow
decays of the build-up."""
DRIFTS, POWERS = slice(RANK, RANK + 3), slice(RANK + 3, RANK + 3 + SETTINGS)
DECAYS = slice(POWERS.stop, SHARED)
"""Positions of drifts, powers and decays of the build-up in these columns."""


@dataclass(frozen=True, slots=True, eq=False)
class Hypotheses:
    """Posterior of the shared columns under each of K hypotheses about tail and drifts.

    Attributes
    ----------
    probability : ndarray, shape (K,)
        Posterior probabilities.
    away : ndarray, shape (K, SHARED)
        Means less the mean over all hypotheses.
    covariance : ndarray, shape (K, SHARED, SHARED)
        Covariances under each hypothesis.
    """

    probability: Array
    away: Array
    covariance: Array

    @property
    def whole(self) -> Array:
        """Total covariance over all hypotheses, shape (SHARED, SHARED)."""
        within = np.tensordot(self.probability, self.covariance, axes=1)
        return np.asarray(within + (self.away * self.probability[:, None]).T @ self.away)

    def along(self, shift: Array) -> tuple[Array, Array]:
        """Return mean and variance of ``shift @ columns`` under each hypothesis, shape (R, K)."""
        variance = np.einsum("ri,kij,rj->rk", shift, self.covariance, shift, optimize=True)
        return shift @ self.away.T, np.maximum(variance, 0.0)


@dataclass(frozen=True, eq=False)
class Shared:
    """Posterior of the effects common to all runs, :data:`SHARED` columns.

    Attributes
    ----------
    mean : ndarray, shape (SHARED,)
        Posterior mean.
    hypotheses : Hypotheses
        Hypotheses that were averaged; a single one in an approximate fit.
    log_evidence : float
        Logarithm of the integral over all columns.
    height : float
        Posterior mean of the height of the tail, relative to the level.
    powers : ndarray, shape (SETTINGS,)
        Powers of the settings in the length of the tail.
    weights : ndarray
        Probabilities of :data:`UNLIKE` with :data:`DRIFTS_OF` (4, 4).
    spectra : Spectra, optional
        Tails over which the posterior was summed.
    """

    mean: Array
    hypotheses: Hypotheses
    log_evidence: float
    height: float
    powers: Array
    weights: Array
    spectra: Spectra | None = None

    @classmethod
    def before(cls, powers: Array) -> Shared:
        """Create the state before any run is evaluated, with given powers of the tail length."""
        return cls(
            mean=np.zeros(SHARED),
            hypotheses=Hypotheses(np.ones(1), np.zeros((1, SHARED)), np.zeros((1, SHARED, SHARED))),
            log_evidence=-np.inf,
            height=0.05,
            powers=powers,
            weights=np.outer(UNLIKE_BEFORE, BEFORE),
        )

    @cached_property
    def factor(self) -> Array:
        """Factor of the covariance, the largest direction first, shape (SHARED, SHARED)."""
        values, vectors = np.linalg.eigh(self.hypotheses.whole)
        return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0)))[:, ::-1])

    @property
    def stretched_mean(self) -> Array:
        """Mean for tails that are already stretched by the powers."""
        mean = self.mean.copy()
        mean[POWERS] = 0.0
        return mean

    @property
    def deviations(self) -> Array:
        """Derivatives of the tail with respect to ln of its height and of its length (RANK, 2)."""
        return np.column_stack([self.mean[:RANK], stretched(self.mean[:RANK])])


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """Information on a bench from sources other than its sliding phases.

    Attributes
    ----------
    squares, products : ndarray, shape (2, 2), (2,)
        Information of the rest phases on drifts of the tight and the slack cell.
    unit_N : float
        Median initial tension [N].
    limits_m : ndarray, shape (R, 2)
        Shortest and longest length of a tail that is fitted to each run [m].
    settings : ndarray, shape (R, SETTINGS)
        ln of the settings of the runs, less their means.
    """

    squares: Array
    products: Array
    unit_N: float
    limits_m: Array
    settings: Array

    def range_m(self, powers: Array) -> tuple[float, float]:
        """Return the shortest and longest length [m] at the mean of the settings."""
        limits = self.limits_m * np.exp(-(self.settings @ powers))[:, None]
        return float(np.min(limits[:, 0])), float(np.max(limits[:, 1]))

    @classmethod
    def by(cls, rests: Sequence[Rest], limits_m: Array, settings: Array) -> Given:
        """Evaluate the rest phases; slopes of the cells at rest indicate drifts of all runs."""
        tension = np.array([rest.tension_N for rest in rests])
        slopes = np.array([rest.slopes_N_s for rest in rests])
        errors = np.array([rest.slope_ses_N_s for rest in rests])
        squares, products = np.zeros((2, 2)), np.zeros(2)
        for k, sign in enumerate((-1.0, 1.0)):  # of the difference, and of the sum
            slope, weight = slopes[:, k], np.maximum(errors[:, k], STILL * tension) ** -2.0
            if not weight.any():  # too few samples at rest for any slope
                continue
            # a drift of the zeros is the same in all runs, relaxation goes with the tension
            columns = np.column_stack([np.ones(tension.size), tension])[:, : 1 + k]
            root = np.sqrt(weight)
            line = np.linalg.lstsq(columns * root[:, None], slope * root, rcond=None)[0]
            # slopes that differ by more than their noise get less weight
            excess = float(weight @ (slope - columns @ line) ** 2)
            weight /= max(excess / max(len(rests) - 1 - k, 1), 1.0)
            if sign > 0.0:
                # relaxation, with a standard deviation of a size that explains the mean slope
                relaxation = tension * (weight @ slope) / (weight @ tension)
                weighted = weight * relaxation
                weight = weight - weighted * weighted.sum() / (1.0 + weighted @ relaxation)
            h = np.array([1.0, sign])
            squares += np.outer(h, h) * weight.sum()
            products += h * (weight @ slope)
        return cls(squares, products, float(np.median(tension)), limits_m, settings)


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """Gaussian prior of all shared columns except the tail of the family.

    Attributes
    ----------
    mean, covariance : ndarray, shape (SHARED,), (SHARED, SHARED)
        Mean and covariance of the columns; the tail columns describe the deviation from the family.
    """

    mean: Array
    covariance: Array

    @classmethod
    def of(cls, powers: Array, slow: Array, tail: Array, drift: Array, decay: float) -> Hypothesis:
        """Build it from the mean of the slow part of the tail and the covariances."""
        mean, covariance = np.zeros(SHARED), np.zeros((SHARED, SHARED))
        mean[:RANK] = slow
        # the columns hold the change relative to the powers by which the tails were stretched
        mean[POWERS] = -powers
        covariance[:RANK, :RANK] = tail
        covariance[DRIFTS, DRIFTS] = drift
        covariance[POWERS, POWERS] = TREND**2 * np.eye(SETTINGS)
        covariance[DECAYS, DECAYS] = decay * np.eye(SLOW_TAKE_UP.size)
        return cls(mean, covariance)

    def spectra(
        self, M: Array, b: Array, range_m: tuple[float, float], start: Spectra | None = None
    ) -> Spectra:
        """Sample the tails of the family under this hypothesis."""
        projection = _integrate_out(M, self.covariance)[0]
        products = (projection @ (b - M @ self.mean))[:RANK]
        return spectra_of((projection @ M)[:RANK, :RANK], products, range_m, start)


def posterior(M: Array, b: Array, given: Given, before: Shared, every_drift: bool = True) -> Shared:
    """Compute the posterior of the tail and of all other effects common to the runs.

    The squares and products of the shared columns, summed over the runs, contain all information
    of the runs on them; the hypotheses differ only in the prior.

    Parameters
    ----------
    M, b : ndarray, shape (SHARED, SHARED), (SHARED,)
        Squares and products.
    given : Given
        Information from other sources.
    before : Shared
        Earlier, approximate estimate of tail and drift.
    every_drift : bool
        Whether each drift, deviation and slow part of the tail is a separate hypothesis; otherwise
        a single Gaussian has the moments of all drifts and deviations.
    """
    M, b = M.copy(), b.copy()
    cells = slice(RANK, RANK + 2)
    M[cells, cells] += given.squares
    b[cells] += given.products
    unit = np.array([given.unit_N, given.unit_N, 1.0])
    drifts = DRIFTS_OF * np.outer(unit, unit)
    height = max(before.height, 1e-3)
    range_m = given.range_m(before.powers)
    deviation = height**2 * _deviations(range_m)

    # a single Gaussian with the moments of all drifts and deviations locates the tails
    mean_drift = np.tensordot(before.weights.sum(axis=0), drifts, axes=1)
    size, decay = before.weights.sum(axis=1) @ UNLIKE**2
    rough = Hypothesis.of(before.powers, np.zeros(RANK), size * deviation, mean_drift, decay)
    spectra = before.spectra
    if every_drift or spectra is None:
        spectra = rough.spectra(M, b, range_m)
    if every_drift:
        posteriors = []
        log_p = []
        for p_slow, slow, scatter in _slow_parts(range_m[1], height):
            for p_unlike, (size, decay) in zip(UNLIKE_BEFORE, UNLIKE**2, strict=True):
                tail = size * deviation + np.outer(scatter, scatter)
                common = before.powers, slow, tail
                # with a slow part, the rest of the tail is different
                points = Hypothesis.of(*common, mean_drift, decay).spectra(M, b, range_m, spectra)
                for p_drift, drift in zip(BEFORE, drifts, strict=True):
                    hypothesis = Hypothesis.of(*common, drift, decay)
                    posteriors.append(_posterior_under(M, b, hypothesis, points))
                    log_p.append(np.log(p_slow * p_unlike * p_drift) + posteriors[-1][2])
    else:
        posteriors = [_posterior_under(M, b, rough, spectra)]
        log_p = [posteriors[0][2]]
    log_evidence = float(np.logaddexp.reduce(log_p))
    p = np.exp(np.array(log_p) - log_evidence)
    means = np.array([mean for mean, *_ in posteriors])
    mean = p @ means
    weights = p.reshape(-1, *before.weights.shape).sum(axis=0) if every_drift else before.weights
    return Shared(
        mean=mean,
        hypotheses=Hypotheses(p, means - mean, np.array([C for _, C, *_ in posteriors])),
        log_evidence=log_evidence,
        height=posteriors[int(np.argmax(p))][-1],
        powers=np.clip(before.powers + mean[POWERS], -1.5, 1.5),
        weights=weights,
        spectra=spectra,
    )


@lru_cache(maxsize=4)
def _deviations(range_m: tuple[float, float]) -> Array:
    """Return the covariance of a unit deviation of the tail from its family (RANK, RANK)."""
    low, high = np.log(max(range_m[0], 2e-4)), np.log(max(range_m[1] / 4.5, 1e-3))
    log_lengths = np.linspace(low, max(high, low + 1.0), 8)
    exponentials = tail_coefficients(log_lengths, np.zeros(8), np.zeros(8))
    return np.asarray(exponentials.T @ exponentials)


def _slow_parts(longest: float, height: float) -> list[tuple[float, Array, Array]]:
    """Return no slow part, then each slow part of the tail: probability, mean and sd (RANK,)."""
    probability, share, scatter = SLOW_PART
    log_lengths = np.log(np.clip(longest / 3.0 * SLOW_LENGTHS, 2e-4, 1.0))
    n = log_lengths.size
    tails = height * tail_coefficients(log_lengths, *np.zeros((2, n)))
    parts = [(probability / n, share * tail, scatter * tail) for tail in tails]
    return [(1.0 - probability, np.zeros(RANK), np.zeros(RANK)), *parts]


def _integrate_out(M: Array, D: Array) -> tuple[Array, Array, float]:
    """Integrate a part u ~ N(0, D) out of the information M.

    Returns
    -------
    projection, G, log_det : ndarray, ndarray, float
        ``projection @ M`` and ``projection @ b`` are the remaining squares and products, G is the
        covariance of u given the rest, log_det the logarithm of det(1 + M D).
    """
    values, vectors = np.linalg.eigh(D)
    F = vectors * np.sqrt(np.maximum(values, 0.0))
    inner = np.eye(len(D)) + F.T @ M @ F
    G = np.asarray(F @ np.linalg.solve(inner, F.T))
    G = 0.5 * (G + G.T)
    return np.eye(len(D)) - M @ G, G, float(np.linalg.slogdet(inner)[1])


def _posterior_under(
    M: Array, b: Array, hypothesis: Hypothesis, spectra: Spectra
) -> tuple[Array, Array, float, float]:
    """Compute `summed` with the columns of the hypothesis integrated out."""
    projection, G, log_det = _integrate_out(M, hypothesis.covariance)
    m = hypothesis.mean
    c = b - M @ m
    tail, spread, log_evidence, height = summed(
        (projection @ M)[:RANK, :RANK], (projection @ c)[:RANK], spectra
    )
    log_evidence += 0.5 * float(c @ G @ c) + float(b @ m) - 0.5 * float(m @ M @ m)
    mean = m + projection.T[:, :RANK] @ tail + G @ c
    covariance = projection.T[:, :RANK] @ spread @ projection[:RANK] + G
    return mean, covariance, log_evidence - 0.5 * log_det, height

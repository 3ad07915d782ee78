"""What all runs of a bench share: the tail of the sticking peak and common drifts.

Rubber relaxes by a completely monotone curve, a mixture of exponentials over the travel x,

    g(x) = int w(ln l) exp(-x/l) d ln l,  w ~ exp(-(ln l - ln l_c)²/(2 s²)),
    s = s_slow for l > l_c, s_fast below.                                                    (S2)

One spectrum (l_c, s_slow, s_fast) holds the single exponential (s = 0) and comes within 1e-4 of
ln(T_tight/T_slack) of stretched exponentials, power laws and double exponentials within a record,
without naming them; what is left behind it may be off by some percent of the height. All tails lie
close to a space of a few dimensions; a tail is its coefficients in a basis of that space. The
centre l_c is log-normal, the widths are exponential and the height a >= 0 of the tail a g is
half-normal; the height is integrated out in closed form, the rest by importance
sampling.

What the bench does not know of its tail and its drifts has one sign in all runs. Each drift, and
each slow part of the tail as long as half the longest record or longer, is a hypothesis of its own;
they differ in the prior only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.sparse import csr_array
from scipy.special import log_ndtr, ndtri

from beltid.identify.friction.rest import Rest

Array = NDArray[np.float64]


SHORTEST, LONGEST = 1e-4, 1.0
"""Lengths of exponentials that the basis describes [m]."""
RANK = 14
"""Dimension of the basis: it is off by at most 2e-3 of the height of a tail."""
HALF = np.arange(0.1, 3.0, 0.2)
"""Midpoints of either half of a spectrum, in units of its width."""


TABLE = np.linspace(np.log(SHORTEST), np.log(LONGEST), 1024)
"""Logarithms of the lengths at which the coefficients of exponentials are tabulated."""


@lru_cache(maxsize=1)
def _basis() -> tuple[Array, Array, Array, Array]:
    """Lengths of exponentials and their mix to basis functions, and two tables in that basis.

    Shapes (k,), (k, RANK); exponentials at :data:`TABLE` (., RANK); -x d/dx of every function
    (RANK, RANK).
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
    """Values of the basis functions at travels [m], shape (n, RANK)."""
    lengths, mix, _, _ = _basis()
    return np.asarray(np.exp(-travel[:, None] / lengths) @ mix)


def tail_coefficients(log_centre: Array, slow: Array, fast: Array) -> Array:
    """Coefficients of the tails of spectra, shape (n, RANK).

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
    place = (log_centre[:, None] + away - TABLE[0]) / (TABLE[1] - TABLE[0])
    place = np.clip(place, 0.0, TABLE.size - 1.0)
    below = np.minimum(place.astype(np.intp), TABLE.size - 2)
    part = place - below
    # linear in the table: a row of weights of its two neighbours for every node
    shares = np.concatenate([weight * (1.0 - part), weight * part], axis=1)
    columns = np.concatenate([below, below + 1], axis=1)
    ends = np.arange(0, columns.size + 1, columns.shape[1])
    mixing = csr_array((shares.ravel(), columns.ravel(), ends), (len(columns), TABLE.size))
    return np.asarray(mixing @ exponentials)


def stretched(coefficients: Array) -> Array:
    """Derivative of tails by the logarithm of their length, as coefficients (..., RANK)."""
    return np.asarray(coefficients @ _basis()[3])


def stretching(log_factor: Array) -> Array:
    """Matrices that make tails longer, ``c -> E c``, by factors exp(log_factor), (n, RANK, RANK).

    They are exact for tails in the space of the basis, E = exp(log_factor S) with S of `stretched`.
    """
    return np.asarray(expm(np.asarray(log_factor)[:, None, None] * _basis()[3].T))


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


def spectra_of(
    M: Array, b: Array, range_m: tuple[float, float], start: Spectra | None = None
) -> Spectra:
    """Tails that stand for the posterior given squares (RANK, RANK) and products (RANK,).

    The posterior of quiet records is a narrow ridge. Importance sampling by a Gaussian closes in
    on it: what the points of one look do not resolve is made flatter till they do, and gives the
    Gaussian of the next look. The first look is at a grid, or at the tails of a like posterior.
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
        # widths below zero are folded back: the density is that of all four signs
        log_q = [
            -0.5 * np.sum(np.linalg.solve(root, points * sign - mean[:, None]) ** 2, axis=0)
            for sign in np.array([[1, 1, 1], [1, -1, 1], [1, 1, -1], [1, -1, -1]])[:, :, None]
        ]
        log_det = float(np.sum(np.log(np.diag(root)))) + 1.5 * np.log(2.0 * np.pi)
        spectra = weighed(points, np.logaddexp.reduce(log_q) - log_det + np.log(len(normal)))
    return spectra


def summed(M: Array, b: Array, spectra: Spectra) -> tuple[Array, Array, float, float]:
    """Posterior of a tail from its squares (RANK, RANK) and products (RANK,).

    Returns
    -------
    mean, covariance : ndarray, shape (RANK,), (RANK, RANK)
        Of the tail in the basis.
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
"""Lengths of slow decays of the build-up, over its travel: where friction grows strongly with the
speed the belt slides more slowly while its tensions still part, and a part of a build-up may take
several times as long as the rest. They could be the tail of the peak; the bench says which."""
UNLIKE = np.array([[0.01, 0.0], [0.03, 0.0], [0.01, 0.05], [0.1, 0.0]])
"""What family and drift do not tell, one row a hypothesis: deviations of the tail from its family,
as the standard deviation of each of some exponentials with lengths within two thirds of the record,
relative to the height; and the same of each slow decay of the build-up, relative to the level."""
UNLIKE_BEFORE = np.array([0.75, 0.15, 0.05, 0.05])
"""Probabilities of them. Which it is, is for the runs to say: one size for all benches is either
too small for quiet records of another family, or widens all others."""
DRIFTING = 0.08
"""Probability that something drifts in all runs alike: the zeros of the cells, or the friction."""
DRIFTS_OF = np.array(
    [np.diag(np.square(sd)) for sd in ([0, 0, 0], [2e-4, 2e-4, 0], [6e-4, 6e-4, 0], [0, 0, 0.03])]
)
"""Covariances of the drifts: none, small and large ones of the zeros of both cells, in 1/s of the
median initial tension, and one of the friction itself, over the sliding of a run relative to mu."""
BEFORE = np.append(1.0 - DRIFTING, DRIFTING * np.array([0.45, 0.45, 0.1]))
"""Probabilities of them."""
SLOW_PART = (0.05, 0.25, 0.15)
"""Probability that a part of the tail decays over a length about the longest record or beyond, its
size relative to the height and the standard deviation of that."""
SLOW_LENGTHS = np.array([0.5, 1.0, 2.0, 4.0])
"""Lengths of such a part, over the longest record: a tail between two of them is not told apart."""
STILL = 1e-6
"""Relative change of the tension in a second that is none: no rest is known better [1/s]."""
TREND = 0.4
"""Standard deviation of the powers with which the length of the tail goes with the settings."""
SETTINGS = 3
"""Settings that it goes with: speed, mean tension and level of ln(T_tight/T_slack), so the arc."""
SHARED = RANK + 3 + SETTINGS + SLOW_TAKE_UP.size
"""Columns that all runs share: the basis of the tails, drifts of both cells and of mu, powers, slow
decays of the build-up."""
DRIFTS, POWERS = slice(RANK, RANK + 3), slice(RANK + 3, RANK + 3 + SETTINGS)
DECAYS = slice(POWERS.stop, SHARED)
"""Where drifts, powers and decays of the build-up are in them."""


@dataclass(frozen=True, slots=True, eq=False)
class Hypotheses:
    """Posterior of the shared columns given each of K hypotheses about tail and drifts.

    Attributes
    ----------
    probability : ndarray, shape (K,)
        Posterior probabilities.
    away : ndarray, shape (K, SHARED)
        Means less that over all hypotheses.
    covariance : ndarray, shape (K, SHARED, SHARED)
        Covariances given each.
    """

    probability: Array
    away: Array
    covariance: Array

    @classmethod
    def alone(cls, covariance: Array) -> Hypotheses:
        """One that is certain."""
        return cls(np.ones(1), np.zeros((1, SHARED)), covariance[None])

    @property
    def whole(self) -> Array:
        """Covariance over all of them, shape (SHARED, SHARED)."""
        within = np.tensordot(self.probability, self.covariance, axes=1)
        return np.asarray(within + (self.away * self.probability[:, None]).T @ self.away)

    def along(self, shift: Array) -> tuple[Array, Array]:
        """Mean and variance of ``shift @ columns`` given each of them, shape (R, K) each."""
        variance = np.einsum("ri,kij,rj->rk", shift, self.covariance, shift, optimize=True)
        return shift @ self.away.T, np.maximum(variance, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Shared:
    """Posterior of what is the same in all runs, :data:`SHARED` columns.

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
    weights : ndarray
        Probabilities of :data:`UNLIKE` with :data:`DRIFTS_OF` (4, 4).
    hypotheses : Hypotheses
        What it is the mean of; one alone in a rough look.
    spectra : Spectra, optional
        Tails over which it was summed.
    """

    mean: Array
    factor: Array
    log_evidence: float
    height: float
    powers: Array
    weights: Array
    hypotheses: Hypotheses
    spectra: Spectra | None = None

    @classmethod
    def before(cls, powers: Array) -> Shared:
        """What is known before any run is seen, if the length of the tail goes with such powers."""
        unknown = np.zeros(SHARED), np.zeros((SHARED, 0)), -np.inf
        weights = np.outer(UNLIKE_BEFORE, BEFORE)
        alone = Hypotheses.alone(np.zeros((SHARED, SHARED)))
        return cls(*unknown, height=0.05, powers=powers, weights=weights, hypotheses=alone)

    @classmethod
    def of(
        cls,
        mean: Array,
        hypotheses: Hypotheses,
        log_evidence: float,
        height: float,
        powers: Array,
        weights: Array,
        spectra: Spectra,
    ) -> Shared:
        """From all hypotheses, with tails that were stretched by some powers."""
        values, vectors = np.linalg.eigh(hypotheses.whole)
        return cls(
            mean=mean,
            factor=(vectors * np.sqrt(np.maximum(values, 0.0)))[:, ::-1],
            log_evidence=log_evidence,
            height=height,
            powers=np.clip(powers + mean[POWERS], -1.5, 1.5),
            weights=weights,
            spectra=spectra,
            hypotheses=hypotheses,
        )

    @property
    def stretched_mean(self) -> Array:
        """The mean for tails that are stretched by the powers already."""
        mean = self.mean.copy()
        mean[POWERS] = 0.0
        return mean

    @property
    def deviations(self) -> Array:
        """What makes the tail higher and longer, by the logarithms of both (RANK, 2)."""
        return np.column_stack([self.mean[:RANK], stretched(self.mean[:RANK])])


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """What is known of a bench beside its sliding phases.

    Attributes
    ----------
    squares, products : ndarray, shape (2, 2), (2,)
        Information of the rest phases on drifts of the tight and the slack cell.
    unit_N : float
        Median initial tension [N].
    range_m : tuple of float
        Shortest and longest length of a tail that is looked for [m].
    """

    squares: Array
    products: Array
    unit_N: float
    range_m: tuple[float, float]

    @classmethod
    def by(cls, rests: Sequence[Rest], range_m: tuple[float, float]) -> Given:
        """What the rest phases say; slopes of the cells at rest are drifts of all runs."""
        tension = np.array([rest.tension_N for rest in rests])
        found = np.array([rest.slopes_N_s for rest in rests])
        errors = np.array([rest.slope_ses_N_s for rest in rests])
        squares, products = np.zeros((2, 2)), np.zeros(2)
        for k, sign in enumerate((-1.0, 1.0)):  # of the difference, and of the sum
            slope, weight = found[:, k], np.maximum(errors[:, k], STILL * tension) ** -2.0
            mean = float(np.sum(weight * slope) / np.sum(weight))
            # slopes that differ by more than their noise are worth less
            excess = float(np.sum(weight * (slope - mean) ** 2)) / max(len(rests) - 1, 1)
            variance = max(excess, 1.0) / float(np.sum(weight))
            if sign > 0.0:
                variance += mean**2  # a slope of the sum may be all relaxation of the belt
            h = np.array([1.0, sign])
            squares += np.outer(h, h) / variance
            products += h * mean / variance
        return cls(squares, products, float(np.median(tension)), range_m)


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """Gaussian prior of all shared columns beside the tail of the family, and its probability.

    Attributes
    ----------
    probability : float
        Before any run is seen.
    mean, covariance : ndarray, shape (SHARED,), (SHARED, SHARED)
        Of the columns; of the tail, of what is added to that of the family.
    """

    probability: float
    mean: Array
    covariance: Array

    @classmethod
    def of(
        cls, probability: float, powers: Array, slow: Array, tail: Array, drift: Array, decay: float
    ) -> Hypothesis:
        """One with a mean of the slow part of the tail, and these covariances."""
        mean, covariance = np.zeros(SHARED), np.zeros((SHARED, SHARED))
        mean[:RANK] = slow
        # the columns hold the change of the powers from what the tails were stretched by
        mean[POWERS] = -powers
        covariance[:RANK, :RANK] = tail
        covariance[DRIFTS, DRIFTS] = drift
        covariance[POWERS, POWERS] = TREND**2 * np.eye(SETTINGS)
        covariance[DECAYS, DECAYS] = decay * np.eye(SLOW_TAKE_UP.size)
        return cls(probability, mean, covariance)

    def spectra(self, M: Array, b: Array, given: Given, start: Spectra | None = None) -> Spectra:
        """Tails that stand for those of the family beside it."""
        left = _free(M, self.covariance)[0]
        products = (left @ (b - M @ self.mean))[:RANK]
        return spectra_of((left @ M)[:RANK, :RANK], products, given.range_m, start)


def posterior(M: Array, b: Array, given: Given, before: Shared, every_drift: bool = True) -> Shared:
    """Posterior of the tail and of all else that the runs share.

    The squares and products of the shared columns, summed over the runs, are all that the runs say
    about them; the hypotheses differ in the prior only.

    Parameters
    ----------
    M, b : ndarray, shape (SHARED, SHARED), (SHARED,)
        Squares and products.
    given : Given
        What is known beside them.
    before : Shared
        Tail and drift as far as they were known before, roughly.
    every_drift : bool
        Each drift, deviation and slow part of the tail is a hypothesis of its own; else one
        Gaussian has the moments of all drifts and deviations.
    """
    M, b = M.copy(), b.copy()
    cells = slice(RANK, RANK + 2)
    M[cells, cells] += given.squares
    b[cells] += given.products
    unit = np.array([given.unit_N, given.unit_N, 1.0])
    drifts = DRIFTS_OF * np.outer(unit, unit)
    height = max(before.height, 1e-3)
    deviation = height**2 * _deviations(given.range_m)

    # one Gaussian with the moments of all drifts and deviations finds where the tails are
    some_drift = np.tensordot(before.weights.sum(axis=0), drifts, axes=1)
    size, decay = before.weights.sum(axis=1) @ UNLIKE**2
    rough = Hypothesis.of(1.0, before.powers, np.zeros(RANK), size * deviation, some_drift, decay)
    spectra = before.spectra
    if every_drift or spectra is None:
        spectra = rough.spectra(M, b, given)
    if not every_drift:
        mean, C, log_evidence, height = _given(M, b, rough, spectra)
        alone = Hypotheses.alone(C)
        return Shared.of(mean, alone, log_evidence, height, before.powers, before.weights, spectra)

    log_p, found = [], []
    for p_slow, slow, scatter in _slow_parts(given.range_m[1], height):
        for p_unlike, (size, decay) in zip(UNLIKE_BEFORE, UNLIKE**2, strict=True):
            tail = size * deviation + np.outer(scatter, scatter)
            common = before.powers, slow, tail
            # beside a slow part the rest of the tail is another one
            points = Hypothesis.of(1.0, *common, some_drift, decay).spectra(M, b, given, spectra)
            for p_drift, drift in zip(BEFORE, drifts, strict=True):
                one = Hypothesis.of(p_slow * p_unlike * p_drift, *common, drift, decay)
                found.append(_given(M, b, one, points))
                log_p.append(np.log(one.probability) + found[-1][2])
    log_evidence = float(np.logaddexp.reduce(log_p))
    p = np.exp(np.array(log_p) - log_evidence)
    means = np.array([mean for mean, *_ in found])
    mean = p @ means
    every = Hypotheses(p, means - mean, np.array([C for _, C, *_ in found]))
    weights = p.reshape(-1, *before.weights.shape).sum(axis=0)
    height = found[int(np.argmax(p))][-1]
    return Shared.of(mean, every, log_evidence, height, before.powers, weights, spectra)


@lru_cache(maxsize=4)
def _deviations(range_m: tuple[float, float]) -> Array:
    """Covariance of a tail of height 1 that is off its family by as much (RANK, RANK)."""
    low, high = np.log(max(range_m[0], 2e-4)), np.log(max(range_m[1] / 4.5, 1e-3))
    lengths = np.linspace(low, max(high, low + 1.0), 8)
    others = tail_coefficients(lengths, np.zeros(8), np.zeros(8))
    return np.asarray(others.T @ others)


def _slow_parts(longest: float, height: float) -> list[tuple[float, Array, Array]]:
    """None, and slow parts of the tail: probability, mean and sd (RANK,) of each."""
    chance, part, scatter = SLOW_PART
    reach = np.log(np.clip(longest / 3.0 * SLOW_LENGTHS, 2e-4, 1.0))
    tails = height * tail_coefficients(reach, *np.zeros((2, reach.size)))
    parts = [(chance / reach.size, part * tail, scatter * tail) for tail in tails]
    return [(1.0 - chance, np.zeros(RANK), np.zeros(RANK)), *parts]


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
    M: Array, b: Array, beside: Hypothesis, spectra: Spectra
) -> tuple[Array, Array, float, float]:
    """As `summed`, with what is beside the tail of the family integrated out."""
    left, G, log_det = _free(M, beside.covariance)
    more = beside.mean
    c = b - M @ more
    tail, spread, log_evidence, height = summed(
        (left @ M)[:RANK, :RANK], (left @ c)[:RANK], spectra
    )
    log_evidence += 0.5 * float(c @ G @ c) + float(b @ more) - 0.5 * float(more @ M @ more)
    mean = more + left.T[:, :RANK] @ tail + G @ c
    covariance = left.T[:, :RANK] @ spread @ left[:RANK] + G
    return mean, covariance, log_evidence - 0.5 * log_det, height

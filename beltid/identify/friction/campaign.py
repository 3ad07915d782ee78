"""What the runs of a bench share: the noise of the cells and the tail of the sticking peak.

One Gaussian model holds for the block means z of every run (:mod:`sliding_record`):

    z = y [1 + a g(x)] + y a (height g + length dg/d ln l) + ripple + turn
        + c (white noise + zeros that wander) + common drift of the zeros,                   (S3)

with the level y = mu beta that is sought (flat prior) and c the sensitivity of z to an error of a
cell. The tail a g(x) (:mod:`tail_shapes`) belongs to the bench, its deviations in height and length
to the run. Their variances, and those of the noise, are found by the marginal likelihood of all
runs, with weak log-normal priors. What a run does not know it borrows from its bench. What the
bench does not know of its tail and its drift has one sign in all runs, and is kept apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import log_ndtr, logsumexp, ndtri
from scipy.stats import qmc

from beltid.identify.friction.noise import block_covariance, early_misfit, wander_since_rest
from beltid.identify.friction.sliding_record import SlidingRecord
from beltid.identify.friction.tail_shapes import (
    RANK,
    stretched,
    stretching,
    tail_basis,
    tail_coefficients,
)

Array = NDArray[np.float64]

MEMORIES_S = (0.04, 0.16, 0.64, 20.0)
"""Memories of the wandering zeros [s]; the last one is a walk over the time of a run, and counts
from the rest, where the zeros show."""
RUNS_FOR_VARIANCES = 32
"""Runs, evenly chosen, that the variances are found from; more would tell nothing new."""
SCALE_FREEDOM = 20.0
"""Degrees of freedom with which the noise of a run keeps to that of its bench."""
FREE = 0.1
"""Standard deviation of the amplitude of a ripple that was found and of what is left of the
build-up, in z: as good as free."""

# priors: median and width (standard deviation of the logarithm)
WANDER = (0.4, 1.5)
"""Of the wandering zeros, in units of the error that white noise leaves in the mean of a run."""
WALK = (2.5, 1.2)
"""The same of the walk with the longest memory, which a short sliding hardly shows."""
NEIGHBOURS = 0.5
"""Correlation of the priors of neighbouring memories: the spectrum of real noise is smooth."""
TURN = (0.7, 1.5)
"""Of the ripple once per turn, in the same unit."""
HEIGHT_SPREAD = (0.15, 1.0)
LENGTH_SPREAD = (0.10, 1.0)
"""Of the deviations of a run's tail from that of its bench, relative."""
HEIGHT = 0.1
"""Standard deviation of the height a >= 0 of the tail, relative to the level (half-normal)."""
CENTRE = (5e-3, 0.2, 1.2)
"""Median of l_c: so many m, or this share of the longest travel if that is less; and the standard
deviation of ln l_c."""
WIDTH = 0.7
"""Mean of s_slow + s_fast (exponential)."""
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


def log_settings(records: Sequence[SlidingRecord]) -> Array:
    """Logarithms of what the length of the tail may go with (R, SETTINGS)."""
    tension = [np.sqrt(np.prod(r.tensions_N)) for r in records]
    return np.log(
        np.column_stack([[r.speed_m_s for r in records], tension, [r.level for r in records]])
    )


class Stack:
    """Records of several runs side by side, padded to one length by blocks without weight.

    All is in units of the sensitivity of z: newtons at a cell.
    """

    def __init__(self, records: Sequence[SlidingRecord], centre: Array) -> None:
        n, m = len(records), max(r.z.size for r in records)
        self.n_runs = n
        self.level = np.array([r.level for r in records])
        self.sensitivity = np.array([r.sensitivity for r in records])
        self.noise_N = np.array([r.noise_N for r in records])
        self.freedom = np.array([r.z.size - 2.0 for r in records])
        self.shortest_m = 2.0 * min(r.step_m for r in records)
        self.longest_m = 3.0 * max(float(r.travel[-1]) for r in records)
        self.count = np.zeros((n, m))
        self.z = np.zeros((n, m))
        self.one = np.zeros((n, m))
        self.settings = log_settings(records) - centre
        self.basis = np.zeros((n, m, RANK))
        self.shared = np.zeros((n, m, SHARED))
        """Basis of the tails, drifts of 1 N/s of the tight and of the slack cell and of all of mu,
        and the changes of the tail with the powers."""
        self.fixed = np.zeros((n, m, m))
        self.parts = np.zeros((len(MEMORIES_S) + 2, n, m, m))
        for k, r in enumerate(records):
            b, c = r.z.size, r.sensitivity
            since = 0.5 * (r.first_s + r.last_s) - 0.5 * sum(r.rest_s)
            self.count[k, :b] = r.count
            self.z[k, :b] = r.z / c
            self.one[k, :b] = 1.0 / c
            self.basis[k, :b] = r.basis * (r.level / c)
            self.shared[k, :b, RANK] = since / (r.tensions_N[0] * c)
            self.shared[k, :b, RANK + 1] = -since / (r.tensions_N[1] * c)
            # mu_sliding of a run in which friction drifts is that of the middle of its second half
            elapsed = (0.5 * (r.first_s + r.last_s) - r.first_s[0]) / (r.last_s[-1] - r.first_s[0])
            self.shared[k, :b, RANK + 2] = (r.level / c) * (elapsed - 0.75)
            free = np.column_stack([r.waves, r.take_up])
            self.fixed[k, :b, :b] = (FREE / c) ** 2 * (free @ free.T)
            for j, tau in enumerate(MEMORIES_S[:-1]):
                self.parts[j, k, :b, :b] = block_covariance(r.first_s, r.last_s, r.count, tau)
            self.parts[-3, k, :b, :b] = wander_since_rest(
                r.first_s, r.last_s, r.count, r.rest_s, r.rest_count, MEMORIES_S[-1]
            )
            self.parts[-2, k, :b, :b] = early_misfit(r.travel)
            self.parts[-1, k, :b, :b] = (r.level / c) ** 2 * (r.turn @ r.turn.T)
        diagonal = np.arange(m)
        self.fixed[:, diagonal, diagonal] += self.noise_N[:, None] ** 2 / np.maximum(
            self.count, 1e-9
        )

    def stretch(self, powers: Array, shared: Shared | None = None) -> None:
        """Make the tails of every run as long as its settings ask for."""
        self.stretches = stretching(self.settings @ powers)
        self.shared[:, :, :RANK] = self.basis @ self.stretches
        if shared is not None:
            change = self.shared[:, :, :RANK] @ stretched(shared.mean[:RANK])
            self.shared[:, :, POWERS] = change[:, :, None] * self.settings[:, None, :]

    @property
    def typical_error_N(self) -> float:
        """Error that white noise leaves in the mean of a cell over a run, median [N]."""
        return float(np.median(self.noise_N / np.sqrt(self.count.sum(axis=1))))


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
    spectrum : ndarray, shape (3,)
        Posterior means of ln l_c (l_c in m), s_slow and s_fast.
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
    spectrum: Array
    powers: Array
    weights: Array
    spectra: Spectra

    @property
    def rough(self) -> Rough:
        """What the next posterior starts from."""
        return Rough(max(self.height, 1e-3), self.powers, self.weights, self.spectra)

    @property
    def deviations(self) -> Array:
        """What makes the tail higher and longer, by the logarithms of both (RANK, 2)."""
        return np.column_stack([self.mean[:RANK], stretched(self.mean[:RANK])])


@dataclass(frozen=True, slots=True, eq=False)
class Bench:
    """What the runs of a bench share.

    Attributes
    ----------
    sd : ndarray
        Standard deviations: zeros that wander, by :data:`MEMORIES_S` [N], ripple once per turn,
        height and length of the tail of a run [-].
    shared : Shared
        Tail and drift.
    """

    sd: Array
    shared: Shared


@dataclass(frozen=True, slots=True, eq=False)
class Whitened:
    """All runs under given variances, with the level projected out; the run is the first axis.

    Attributes
    ----------
    P : ndarray, shape (R, m, m)
        Inverse covariance of the blocks without the level.
    M, b : ndarray, shape (R, q, q), (R, q)
        Squares of the shared columns, and their products with z.
    shift : ndarray, shape (R, q)
        Change of the level by the shared columns.
    level, variance, squares, log_det : ndarray, shape (R,)
        Level without them and its variance; sum of squares and log determinant of the likelihood.
    """

    P: Array
    M: Array
    b: Array
    shift: Array
    level: Array
    variance: Array
    squares: Array
    log_det: Array


def covariance(stack: Stack, sd: Array, shared: Shared | None) -> tuple[Array, Array]:
    """Covariance of the block means (R, m, m), and its parts of unit variance (K, R, m, m)."""
    parts = stack.parts
    if shared is not None:
        own = stack.shared[:, :, :RANK] @ shared.deviations
        own = own.transpose(2, 0, 1)
        parts = np.concatenate([parts, own[:, :, :, None] * own[:, :, None, :]])
    return stack.fixed + np.tensordot(np.square(sd[: len(parts)]), parts, axes=1), parts


def whiten(stack: Stack, V: Array) -> Whitened:
    """Generalised least squares of all runs, whatever is shared."""
    inverse = np.linalg.inv(V)
    log_det = np.linalg.slogdet(V)[1]
    of_one = np.einsum("rij,rj->ri", inverse, stack.one)
    ones = np.einsum("ri,ri->r", stack.one, of_one)
    P = inverse - of_one[:, :, None] * of_one[:, None, :] / ones[:, None, None]
    Pz = np.einsum("rij,rj->ri", P, stack.z)
    return Whitened(
        P=P,
        M=stack.shared.transpose(0, 2, 1) @ (P @ stack.shared),
        b=np.einsum("rik,ri->rk", stack.shared, Pz),
        shift=np.einsum("ri,rik->rk", of_one, stack.shared) / ones[:, None],
        level=np.einsum("ri,ri->r", of_one, stack.z) / ones,
        variance=1.0 / ones,
        squares=np.einsum("ri,ri->r", stack.z, Pz),
        log_det=log_det + np.log(ones),
    )


def noise_scale(stack: Stack, w: Whitened, mean: Array) -> Array:
    """Most probable variance of the noise of each run over that of the bench (R,).

    The bench is the middle of its runs: what is common to all belongs to its variances.
    """
    misfit = w.squares - 2.0 * w.b @ mean + np.einsum("k,rkl,l->r", mean, w.M, mean)
    scale = (SCALE_FREEDOM + np.maximum(misfit, 0.0)) / (SCALE_FREEDOM + stack.freedom)
    return np.asarray(scale / np.median(scale))


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


BEFORE = np.array([1.0 - DRIFTING, *[DRIFTING / 4.0] * 4])
"""Probabilities of no drift, one of the tight, the slack, both cells, and of mu."""


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


def fit_shared(
    stack: Stack, w: Whitened, scale: Array, given: Given, rough: Rough, every_drift: bool = False
) -> Shared:
    """Posterior of the tail and the common drift from some runs."""
    share = 1.0 / scale
    return posterior(np.einsum("r,rkl->kl", share, w.M), w.b.T @ share, given, rough, every_drift)


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
        spectrum=best.centre,
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
) -> tuple[_Tail, Array, Array]:
    """Posterior with a part v - [tail, 0] ~ N(more, D) integrated out: tail, mean, covariance."""
    left, G, log_det = _free(M, D)
    c = b - M @ more
    tail = _summed((left @ M)[:RANK, :RANK], (left @ c)[:RANK], spectra)
    constant = 0.5 * float(c @ G @ c) + float(b @ more) - 0.5 * float(more @ M @ more)
    log_evidence = tail.log_evidence + constant - 0.5 * log_det
    mean = more + left.T[:, :RANK] @ tail.mean + G @ c
    covariance = left.T[:, :RANK] @ tail.covariance @ left[:RANK] + G
    return replace(tail, log_evidence=log_evidence), mean, covariance


@dataclass(frozen=True, slots=True, eq=False)
class _Tail:
    mean: Array
    covariance: Array
    log_evidence: float
    height: float
    centre: Array
    """Posterior means of ln l_c, s_slow and s_fast, shape (3,)."""


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


GRID = (28, 7, 5)
"""Points of the first look over ln l_c, s_slow and s_fast."""
LOOKS = 10
RESOLVED = 0.15
"""Share of the points that must carry the posterior."""


@lru_cache(maxsize=1)
def _normal_points() -> Array:
    """Evenly spread points of three standard normal variables, shape (512, 3)."""
    even = qmc.Sobol(3, scramble=False).random_base2(9)
    return np.asarray(ndtri(even + 0.5 / len(even)))


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

    axes = [np.linspace(*ends, n) for *ends, n in zip(low, high, GRID, strict=True)]
    grid = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")])
    step = np.log((high - low) / (np.array(GRID) - 1.0))
    spectra = weighed(grid, -float(np.sum(step)))
    normal = _normal_points()
    for _ in range(LOOKS):
        log_p = spectra.posterior(M, b)[0]
        away = log_p - np.max(log_p)
        flat, weight = 1.0, np.exp(away)
        enough = RESOLVED * len(normal)
        while np.sum(weight) ** 2 < enough * np.sum(weight**2):
            flat *= 0.8
            weight = np.exp(flat * away)
        if flat == 1.0 and spectra.points.shape[1] == len(normal):
            break
        mean, C = (
            np.average(spectra.points, axis=1, weights=weight),
            np.cov(spectra.points, aweights=weight),
        )
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


def _summed(M: Array, b: Array, spectra: Spectra) -> _Tail:
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
    return _Tail(
        mean=mean,
        covariance=second - np.outer(mean, mean),
        log_evidence=total,
        height=float(weight @ height),
        centre=spectra.points @ weight,
    )


CLOCKS = (np.zeros(SETTINGS), np.eye(SETTINGS)[0])
"""Powers to start from: a tail that decays over the travel, or over the time."""
SWEEPS = 2
HIDDEN_STEPS = (-2.4, -1.8, -1.2, -0.6, 0.0, 0.6, 1.2, 1.8)
"""Steps about the mode over which the variances are averaged that a record hardly shows, in widths
of their priors."""


def _log_evidence_of(stack: Stack, powers: Array, sd: Array, given: Given) -> float:
    """Evidence for tails that are stretched so, before anything else is known of the bench."""
    stack.stretch(powers)
    w = whiten(stack, covariance(stack, sd, None)[0])
    one = np.ones(stack.n_runs)
    return fit_shared(stack, w, one, given, Rough(0.05, powers, BEFORE)).log_evidence


def fit_bench(stack: Stack, given: Given) -> Bench:
    """Most probable variances of a bench, with its tail and drift."""
    typical = stack.typical_error_N
    typical_z = typical * float(np.median(stack.sensitivity / stack.level))
    n = len(MEMORIES_S)
    priors = np.array(
        [
            *[(np.log(WANDER[0] * typical), WANDER[1])] * (n - 1),
            (np.log(WALK[0] * typical), WALK[1]),
            (np.log(WANDER[0] * typical), WANDER[1]),
            (np.log(TURN[0] * typical_z), TURN[1]),
            (np.log(HEIGHT_SPREAD[0]), HEIGHT_SPREAD[1]),
            (np.log(LENGTH_SPREAD[0]), LENGTH_SPREAD[1]),
        ]
    )
    centre, width = priors.T
    apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    precision = np.eye(n + 4)
    precision[:n, :n] = np.linalg.inv(NEIGHBOURS**apart)
    shared: Shared | None = None
    scale = np.ones(stack.n_runs)

    def evidence(sd: Array) -> tuple[float, Array, Whitened, Shared]:
        V, parts = covariance(stack, sd, shared)
        w = whiten(stack, V)
        found = fit_shared(stack, w, scale, given, rough)
        log_z = found.log_evidence - 0.5 * float(np.sum(w.squares / scale + w.log_det))
        return log_z, parts, w, found

    def cost(x: Array) -> tuple[float, Array]:
        sd = np.exp(centre + width * x)
        log_z, parts, w, found = evidence(sd)
        # Fisher's identity: the gradient is that of the likelihood, averaged over the posterior
        residual = stack.z - stack.shared @ found.mean
        columns = np.concatenate([residual[:, :, None], stack.shared @ found.factor], axis=2)
        Pe = w.P @ columns
        outer = (Pe / scale[:, None, None]) @ Pe.transpose(0, 2, 1) - w.P
        slope = np.zeros(x.size)
        slope[: len(parts)] = np.tensordot(parts, outer, axes=3)
        away = precision @ x
        return 0.5 * float(x @ away) - log_z, away - slope * sd**2 * width

    # from above: a variance that is too small has no gradient
    x = np.where(np.arange(n + 4) <= n + 1, 1.5, 0.0)
    sd = np.exp(centre + width * x)
    odds = [_log_evidence_of(stack, clock, sd, given) for clock in CLOCKS]
    rough = Rough(0.05, CLOCKS[int(np.argmax(odds))], BEFORE)
    stack.stretch(rough.powers)
    w = whiten(stack, covariance(stack, sd, None)[0])
    # a rough tail, of which the change with the powers can be told
    stack.stretch(rough.powers, fit_shared(stack, w, scale, given, rough))
    for _ in range(SWEEPS):
        w = whiten(stack, covariance(stack, np.exp(centre + width * x), shared)[0])
        shared = fit_shared(stack, w, scale, given, rough, every_drift=True)
        scale = noise_scale(stack, w, shared.mean)
        rough = shared.rough
        stack.stretch(rough.powers, shared)
        x = minimize(
            cost,
            x,
            jac=True,
            method="L-BFGS-B",
            bounds=[(-4.0, 6.0)] * x.size,
            options={"maxiter": 30, "ftol": 1e-7},
        ).x
    assert shared is not None
    sd = np.exp(centre + width * x)
    # walk and ripple once per turn move the level most and show least: the mean of their variances
    # in place of the mode, with an even chance that there is none
    mode = sd.copy()
    for k in (n - 1, n + 1):
        along = x[k] + np.array(HIDDEN_STEPS)
        sizes = np.append(np.exp(centre[k] + width[k] * along), 0.0)
        log_p = np.array([evidence(np.where(np.arange(x.size) == k, s, mode))[0] for s in sizes])
        # density of the prior given the other variances, over a step
        away = along - x[k] + precision[k] @ x / precision[k, k]
        log_p[:-1] -= 0.5 * precision[k, k] * away**2 - 0.5 * np.log(
            precision[k, k] / (2.0 * np.pi)
        )
        log_p[:-1] += np.log(HIDDEN_STEPS[1] - HIDDEN_STEPS[0])
        sd[k] = np.sqrt(np.exp(log_p - logsumexp(log_p)) @ sizes**2)
    return Bench(sd, shared)


@dataclass(frozen=True, slots=True, eq=False)
class RunLevel:
    """Level of a run and what is not known of it; all as parts of z.

    Attributes
    ----------
    y : float
        Level ln(T_tight/T_slack) that is left when the tail has decayed.
    variance : float
        Its variance by what differs from run to run.
    shared_tail, shared_drift : float
        Its standard deviation by what all runs share, with the sign that all have in common.
    misfit : float
        Noise of the run about the model over that of the bench, standard deviations.
    drift : float
        Change by zeros that wander over the sliding, as far as it shows.
    tail : ndarray, shape (RANK,)
        Tail of the run in the basis.
    own : ndarray, shape (RANK, 2)
        Standard deviations of its height and its length, as tails.
    known, lean : ndarray, shape (2, 2), (2,)
        Share of those that the record tells, and change of the level with them.
    """

    y: float
    variance: float
    shared_tail: float
    shared_drift: float
    misfit: float
    drift: float
    tail: Array
    own: Array
    known: Array
    lean: Array

    def at(self, travel: float, shared: Shared, level: float) -> tuple[float, float]:
        """Value of z on the model at a travel since the end of the build-up [m], and its error."""
        basis = tail_basis(np.array([travel]))[0]
        h = basis @ self.own
        variance = self.variance * (1.0 - 2.0 * float(self.lean @ h))
        variance += float(h @ h - h @ self.known @ h)
        common = np.linalg.norm(level * (basis @ shared.factor[:RANK])) + abs(self.shared_tail)
        error = np.sqrt(max(variance, 0.0) + float(common) ** 2)
        return self.y + float(basis @ self.tail), float(error)


_TAIL = np.array([*range(RANK), *range(RANK + 3, SHARED)])
BATCH = 128
"""Runs that are whitened at a time: a bench of any size takes the same memory."""


def reduce_bench(
    records: Sequence[SlidingRecord], rest: RestSlopes, unit_N: float
) -> tuple[Bench, list[RunLevel]]:
    """What the runs of a bench share, and the level of every one of them.

    Parameters
    ----------
    records : sequence of SlidingRecord
        The runs, at least one.
    rest : RestSlopes
        What their rest phases say about a common drift.
    unit_N : float
        Median initial tension [N].
    """
    centre = np.mean(log_settings(records), axis=0)
    every = np.linspace(0, len(records) - 1, min(len(records), RUNS_FOR_VARIANCES)).astype(int)
    stack = Stack([records[k] for k in every], centre)
    given = Given(rest, unit_N, (stack.shortest_m, stack.longest_m))
    bench = fit_bench(stack, given)
    parts = [records[k : k + BATCH] for k in range(0, len(records), BATCH)]
    # a small bench is stacked once, of a large one only a part at a time is held
    stacks = [Stack(parts[0], centre)] if len(parts) == 1 else (Stack(p, centre) for p in parts)
    if len(every) < len(records):
        M, b = np.zeros((SHARED, SHARED)), np.zeros(SHARED)
        for stack in stacks:
            stack.stretch(bench.shared.powers, bench.shared)
            w = whiten(stack, covariance(stack, bench.sd, bench.shared)[0])
            share = 1.0 / noise_scale(stack, w, bench.shared.mean)
            M, b = M + np.einsum("r,rkl->kl", share, w.M), b + w.b.T @ share
        shortest = 2.0 * min(r.step_m for r in records)
        longest = 3.0 * max(float(r.travel[-1]) for r in records)
        given = replace(given, range_m=(shortest, longest))
        shared = posterior(M, b, given, bench.shared.rough)
        bench = Bench(bench.sd, shared)
    if len(parts) > 1:
        stacks = (Stack(p, centre) for p in parts)
    levels = [level for stack in stacks for level in _levels(stack, bench)]
    return bench, levels


def _levels(stack: Stack, bench: Bench) -> list[RunLevel]:
    """Levels of some runs of a bench."""
    shared = bench.shared
    stack.stretch(shared.powers, shared)
    V, parts = covariance(stack, bench.sd, shared)
    w = whiten(stack, V)
    mean = shared.mean.copy()
    mean[POWERS] = 0.0  # the tails are stretched by all of it
    scale = noise_scale(stack, w, mean)
    tail, drift = (-(w.shift[:, part] @ shared.factor[part]) for part in (_TAIL, DRIFTS))
    both = tail + drift
    # the sign of the largest direction is that of all runs
    size = np.where(both[:, 0] < 0.0, -1.0, 1.0) * np.linalg.norm(both, axis=1)
    share = np.clip(np.sum(drift * both, axis=1) / np.maximum(size**2, 1e-300), 0.0, 1.0)
    residual = stack.z - stack.shared @ mean
    Pe = np.einsum("rij,rj->ri", w.P, residual)
    wander = np.einsum("rij,rj->ri", parts[len(MEMORIES_S) - 1], Pe)
    wander *= (bench.sd[len(MEMORIES_S) - 1] ** 2 * stack.sensitivity)[:, None]
    own = shared.deviations * bench.sd[-2:]
    H = stack.shared[:, :, :RANK] @ own
    known = H.transpose(0, 2, 1) @ (w.P @ H)
    lean = w.shift[:, :RANK] @ own
    deviation = np.einsum("rik,ri->rk", H, Pe)
    y = w.level - w.shift @ mean
    last = np.array([np.flatnonzero(c)[-1] for c in stack.count])
    return [
        RunLevel(
            y=float(y[k]),
            variance=float(w.variance[k] * scale[k]),
            shared_tail=float(size[k] * np.sqrt(1.0 - share[k])),
            shared_drift=float(size[k] * np.sqrt(share[k])),
            misfit=float(np.sqrt(scale[k])),
            drift=float(wander[k, last[k]] - wander[k, 0] + mean[RANK + 2] * stack.level[k]),
            tail=stack.level[k] * stack.stretches[k] @ (shared.mean[:RANK] + own @ deviation[k]),
            own=stack.level[k] * stack.stretches[k] @ own,
            known=known[k],
            lean=lean[k] / stack.level[k],
        )
        for k in range(stack.n_runs)
    ]

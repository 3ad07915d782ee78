"""Reduce all runs together (second pass): variances of a bench, and the level of each run.

One Gaussian model describes the block means z of every run (:mod:`prepare`):

    z = y [1 + a g(x)] + y a (height g + length dg/d ln l) + ripple + turn
        + c (white noise + zeros that wander) + common drift of the zeros,                   (S3)

with the unknown level y = mu beta (flat prior) and the sensitivity c of z to an error of a cell.
The tail a g(x) (:mod:`shared`) belongs to the bench, its deviations in height and length to the
run. Their variances, and those of the noise, maximise the marginal likelihood of all runs with
weak log-normal priors. A run takes from its bench what its own record does not determine. Errors
of tail and drift of the bench have the same sign in all runs and are reported separately.

The noise is white plus wandering zeros: an Ornstein-Uhlenbeck process of unit variance and
correlation time tau has the covariance exp(-|t-t'|/tau). Its means over blocks of evenly spaced
samples have a covariance in closed form (geometric sums).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from beltid.identify.friction.prepare import SlidingRecord
from beltid.identify.friction.rest import Rest
from beltid.identify.friction.shared import (
    DECAYS,
    DRIFTS,
    POWERS,
    RANK,
    SETTINGS,
    SHARED,
    Given,
    Shared,
    posterior,
    stretched,
    stretching,
    tail_basis,
)

Array = NDArray[np.float64]


def block_covariance(first: Array, last: Array, count: Array, tau: float | Array) -> Array:
    """Compute the covariance of block means of an Ornstein-Uhlenbeck process of unit variance.

    Parameters
    ----------
    first, last : ndarray
        Times of the first and last sample of each block [s], in order, shape (m,).
    count : ndarray
        Number of evenly spaced samples of each block, shape (m,).
    tau : float or ndarray
        Correlation time of the process, or of several processes [s], shape (...).

    Returns
    -------
    ndarray, shape (..., m, m)
    """
    steps = np.where(count > 1.0, (last - first) / np.maximum(count - 1.0, 1.0), 1.0)
    memory = np.asarray(tau, dtype=float)[..., None]
    step = steps / memory
    rho = np.exp(-step)
    left = -np.expm1(-step)  # 1 - rho, without cancellation
    total = -np.expm1(-count * step) / left  # sum of rho^k over the block
    share = total / count
    gap = np.maximum(first[None, :] - last[:, None], 0.0)
    across = share[..., :, None] * share[..., None, :] * np.exp(-gap / memory[..., None])
    upper = np.triu(across, 1)
    covariance = upper + np.swapaxes(upper, -1, -2)
    within = (count * (1.0 + rho) / left - 2.0 * rho * total / left) / count**2
    diagonal = np.arange(count.size)
    covariance[..., diagonal, diagonal] = np.where(count > 1.0, within, 1.0)
    return np.asarray(covariance)


def wander_since_rest(first: Array, last: Array, count: Array, rest: Rest, tau: float) -> Array:
    """Compute the same for the change of the process since its mean at rest, shape (m, m)."""
    covariance = block_covariance(
        np.append(rest.first_s, first),
        np.append(rest.last_s, last),
        np.append(rest.n_samples, count),
        tau,
    )
    with_rest = covariance[0, 1:]
    return covariance[1:, 1:] - with_rest[:, None] - with_rest[None, :] + covariance[0, 0]


def error_by_rest(rest: Rest, n_samples: float) -> float:
    """Estimate the error of the mean of a cell over some samples by the noise seen at rest [N].

    The variance of a mean falls with the number of samples; it is at most that of one sample.
    """
    of_mean = 0.5 * rest.imbalance_se_N**2 * rest.n_samples / n_samples
    return float(min(np.sqrt(of_mean), rest.noise_N))


MEMORIES_S = (0.04, 0.16, 0.64, 20.0)
"""Correlation times of the wandering zeros [s]; the last one is a walk over the time of a run,
measured from the rest phase, where the zeros are visible."""
N_VARIANCES = len(MEMORIES_S) + 4
"""Number of variances of a bench."""
WALK_PART, TURN_PART = len(MEMORIES_S) - 1, len(MEMORIES_S)
OWN_PARTS = slice(TURN_PART + 1, TURN_PART + 3)
"""Positions of the walk, of the ripple once per turn and of the tail of a run in the variances."""
RUNS_FOR_VARIANCES = 32
"""Number of evenly chosen runs that determine the variances; more would add nothing."""
SCALE_FREEDOM = 20.0
"""Degrees of freedom of the prior that ties the noise of a run to that of its bench."""
FREE = 0.1
"""Standard deviation of the amplitudes of detected ripples and of the rest of the build-up, in z:
practically free."""

# priors: median and width (standard deviation of the logarithm)
WANDER = (0.4, 1.5)
"""Prior of the wandering zeros, in units of the error of the mean of a run by white noise."""
WALK = (10.0, 1.0)
"""The same for the walk with the longest correlation time, hardly visible in a short sliding."""
NEIGHBOURS = 0.5
"""Prior correlation of neighbouring correlation times: the spectrum of real noise is smooth."""
TURN = (1.0, 1.5)
"""Prior of the ripple once per turn, in the same unit: about where it begins to matter."""
HEIGHT_SPREAD = (0.15, 1.0)
LENGTH_SPREAD = (0.10, 1.0)
"""Priors of the relative deviations of the tail of a run from that of its bench."""
DECAY_SPREAD = (3e-3, 1.5)
"""Prior of the deviation of slow decays of the build-up from those of all runs, relative to the
level."""


def log_settings(records: Sequence[SlidingRecord]) -> Array:
    """Return ln of the settings that may affect the length of the tail (R, SETTINGS)."""
    tension = [np.sqrt(np.prod(r.tensions_N)) for r in records]
    return np.log(
        np.column_stack([[r.speed_m_s for r in records], tension, [r.level for r in records]])
    )


class Stack:
    """Records of several runs as arrays, padded to equal length with blocks of zero weight.

    All quantities are divided by the sensitivity of z: newtons at a cell.
    """

    def __init__(self, records: Sequence[SlidingRecord], centre: Array) -> None:
        n, m = len(records), max(r.z.size for r in records)
        self.n_runs = n
        self.level = np.array([r.level for r in records])
        self.sensitivity = np.array([r.sensitivity for r in records])
        self.noise_N = np.array([r.noise_N for r in records])
        self.freedom = np.array([r.z.size - 2.0 for r in records])
        self.least_N = np.array([error_by_rest(r.rest, float(r.count.sum())) for r in records])
        self.count = np.zeros((n, m))
        self.z = np.zeros((n, m))
        self.one = np.zeros((n, m))
        self.settings = log_settings(records) - centre
        self.basis = np.zeros((n, m, RANK))
        self.shared = np.zeros((n, m, SHARED))
        """Basis of the tails, drifts of 1 N/s of the tight and of the slack cell and of 100 % of
        mu, the changes of the tail with the powers, and slow decays of the build-up."""
        median_level = np.median(self.level)
        self.fixed = np.zeros((n, m, m))
        """Covariance of a run that does not depend on the variances (n, m, m)."""
        self.parts = np.zeros((N_VARIANCES, n, m, m))
        """Covariance added per unit of each variance: wandering zeros, by :data:`MEMORIES_S` [N];
        ripple once per turn, height and length of the tail of a run, slow decays of the build-up
        [-]."""
        for k, r in enumerate(records):
            b, c = r.z.size, r.sensitivity
            since_rest = 0.5 * (r.first_s + r.last_s) - 0.5 * (r.rest.first_s + r.rest.last_s)
            self.count[k, :b] = r.count
            self.z[k, :b] = r.z / c
            self.one[k, :b] = 1.0 / c
            self.basis[k, :b] = r.basis * (r.level / c)
            self.shared[k, :b, RANK : RANK + 2] = np.outer(since_rest, r.zero_shifts / c)
            # if the friction drifts, mu_sliding refers to the middle of the second half of the run
            elapsed = (0.5 * (r.first_s + r.last_s) - r.first_s[0]) / (r.last_s[-1] - r.first_s[0])
            self.shared[k, :b, RANK + 2] = (r.level / c) * (elapsed - 0.75)
            self.shared[k, :b, DECAYS] = r.slow_take_up * (r.level / c)
            free = np.column_stack([r.waves, r.take_up])
            self.fixed[k, :b, :b] = (FREE / c) ** 2 * (free @ free.T)
            short, walk = np.array(MEMORIES_S[:-1]), MEMORIES_S[-1]
            blocks = (r.first_s, r.last_s, r.count)
            self.parts[: short.size, k, :b, :b] = block_covariance(*blocks, short)
            self.parts[WALK_PART, k, :b, :b] = wander_since_rest(*blocks, r.rest, walk)
            # a ripple once per turn may scale with the friction, thus the level, or with the
            # tensions: half its variance each
            turning = 0.5 * (r.level**2 + median_level**2) / c**2
            self.parts[TURN_PART, k, :b, :b] = turning * (r.turn @ r.turn.T)
            self.parts[-1, k, :b, :b] = (r.level / c) ** 2 * (r.slow_take_up @ r.slow_take_up.T)
        diagonal = np.arange(m)
        self.fixed[:, diagonal, diagonal] += self.noise_N[:, None] ** 2 / np.maximum(
            self.count, 1e-9
        )

    def stretch(self, powers: Array, shared: Shared | None = None) -> None:
        """Stretch the tail of every run according to its settings."""
        self.stretches = stretching(self.settings @ powers)
        self.shared[:, :, :RANK] = self.basis @ self.stretches
        if shared is not None:
            change = self.shared[:, :, :RANK] @ stretched(shared.mean[:RANK])
            self.shared[:, :, POWERS] = change[:, :, None] * self.settings[:, None, :]

    def deviate(self, shared: Shared) -> None:
        """Allow each run deviations in height and length of its tail; call `stretch` before."""
        deviations = np.moveaxis(self.shared[:, :, :RANK] @ shared.deviations, -1, 0)
        self.parts[OWN_PARTS] = deviations[..., :, None] * deviations[..., None, :]

    @property
    def typical_error_N(self) -> float:
        """Median over the runs of the error of the mean of a cell by white noise [N]."""
        return float(np.median(self.noise_N / np.sqrt(self.count.sum(axis=1))))


@dataclass(frozen=True, slots=True, eq=False)
class Whitened:
    """All runs under given variances, with the level projected out; first axis: runs.

    Attributes
    ----------
    P : ndarray, shape (R, m, m)
        Inverse covariance of the blocks without the level.
    M, b : ndarray, shape (R, q, q), (R, q)
        Squares of the shared columns, and their products with z.
    shift : ndarray, shape (R, q)
        Change of the level by the shared columns.
    level, variance, squares, log_det : ndarray, shape (R,)
        Level without the shared columns and its variance; sum of squares and log determinant of the
        likelihood.
    """

    P: Array
    M: Array
    b: Array
    shift: Array
    level: Array
    variance: Array
    squares: Array
    log_det: Array


def whiten(stack: Stack, sd: Array) -> Whitened:
    """Apply generalised least squares to all runs under given variances."""
    V = stack.fixed + np.tensordot(np.square(sd), stack.parts, axes=1)
    inverse = np.linalg.inv(V)
    log_det = np.linalg.slogdet(V)[1]
    weights = np.einsum("rij,rj->ri", inverse, stack.one)
    precision = np.einsum("ri,ri->r", stack.one, weights)
    P = inverse - weights[:, :, None] * weights[:, None, :] / precision[:, None, None]
    Pz = np.einsum("rij,rj->ri", P, stack.z)
    return Whitened(
        P=P,
        M=stack.shared.transpose(0, 2, 1) @ (P @ stack.shared),
        b=np.einsum("rik,ri->rk", stack.shared, Pz),
        shift=np.einsum("ri,rik->rk", weights, stack.shared) / precision[:, None],
        level=np.einsum("ri,ri->r", weights, stack.z) / precision,
        variance=1.0 / precision,
        squares=np.einsum("ri,ri->r", stack.z, Pz),
        log_det=log_det + np.log(precision),
    )


def noise_scale(stack: Stack, w: Whitened, mean: Array) -> Array:
    """Estimate the ratio of the noise variance of each run to that of the bench (R,).

    The ratios have a median of 1: a common factor belongs to the variances of the bench.
    """
    misfit = w.squares - 2.0 * w.b @ mean + np.einsum("k,rkl,l->r", mean, w.M, mean)
    scale = (SCALE_FREEDOM + np.maximum(misfit, 0.0)) / (SCALE_FREEDOM + stack.freedom)
    return np.asarray(scale / np.median(scale))


def fit_shared(
    w: Whitened, scale: Array, given: Given, before: Shared, every_drift: bool = False
) -> Shared:
    """Compute the posterior of the tail and the common drift from some runs."""
    weight = 1.0 / scale
    M = np.einsum("r,rkl->kl", weight, w.M)
    return posterior(M, w.b.T @ weight, given, before, every_drift)


CLOCKS = (np.zeros(SETTINGS), np.eye(SETTINGS)[0])
"""Initial powers of a fit: a tail that decays over the travel, or over the time."""
SAME_END = 0.5
"""Difference of the final powers of the speed below which both fits have found the same end."""
NEGLIGIBLE = 1e-3
"""Odds of a fit below which it changes no interval."""
SWEEPS = 2
"""Alternations between shared effects and variances."""
STEPS = np.linspace(-2.4, 1.8, 10)
"""Steps about the mode over which a variance is averaged, in widths of its prior."""


def log_evidence(
    stack: Stack, sd: Array, scale: Array, given: Given, before: Shared
) -> tuple[float, Whitened, Shared]:
    """Compute the log marginal likelihood of all runs under given variances.

    Parameters
    ----------
    stack : Stack
        The runs.
    sd : ndarray
        Standard deviations, in the order of `Stack.parts`.
    scale : ndarray, shape (R,)
        Ratios of the noise variance of each run to that of the bench.
    given, before : Given, Shared
        Information from other sources, and an approximate estimate.

    Returns
    -------
    log_z : float
        Logarithm of the marginal likelihood.
    w, shared : Whitened, Shared
        The runs under these variances, and their common effects.
    """
    w = whiten(stack, sd)
    shared = fit_shared(w, scale, given, before)
    log_z = shared.log_evidence - 0.5 * float(np.sum(w.squares / scale + w.log_det))
    return log_z, w, shared


def slope_of_evidence(stack: Stack, sd: Array, scale: Array, w: Whitened, shared: Shared) -> Array:
    """Differentiate `log_evidence` with respect to ln `sd`, from its results.

    The derivative is that of the likelihood, averaged over the posterior (Fisher's identity).
    """
    residual = stack.z - stack.shared @ shared.mean
    columns = np.concatenate([residual[:, :, None], stack.shared @ shared.factor], axis=2)
    Pe = w.P @ columns
    outer = (Pe / scale[:, None, None]) @ Pe.transpose(0, 2, 1) - w.P
    return np.tensordot(stack.parts, outer, axes=3) * sd**2


@dataclass(frozen=True, slots=True, eq=False)
class Priors:
    """Log-normal priors of the variances, shape (N_VARIANCES,) each.

    Attributes
    ----------
    centre, width : ndarray
        Medians and standard deviations of the logarithms of the standard deviations.
    precision : ndarray, shape (N_VARIANCES, N_VARIANCES)
        Inverse covariance of the logarithms, in units of their widths.
    """

    centre: Array
    width: Array
    precision: Array

    @classmethod
    def of(cls, stack: Stack) -> Priors:
        """Build the priors of a bench; most scale with the error by its white noise."""
        typical = stack.typical_error_N
        typical_z = typical * float(np.median(stack.sensitivity / stack.level))
        n = len(MEMORIES_S)
        medians, widths = np.array(
            [
                *[(WANDER[0] * typical, WANDER[1])] * (n - 1),
                (WALK[0] * typical, WALK[1]),
                (TURN[0] * typical_z, TURN[1]),
                HEIGHT_SPREAD,
                LENGTH_SPREAD,
                DECAY_SPREAD,
            ]
        ).T
        distance = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
        precision = np.eye(N_VARIANCES)
        precision[:n, :n] = np.linalg.inv(NEIGHBOURS**distance)
        return cls(np.log(medians), widths, precision)

    def sd(self, x: Array) -> Array:
        """Return the standard deviations at steps x from the medians, in widths."""
        return np.asarray(np.exp(self.centre + self.width * x))


def fit_bench(stack: Stack, given: Given) -> list[tuple[float, Array, Shared]]:
    """Fit standard deviations, tail and drift of a bench with tails over travel and over time.

    Returns
    -------
    list of tuple
        Probability over that of the first, most probable standard deviations and common effects.
    """
    priors = Priors.of(stack)
    clocks = CLOCKS if np.any(given.settings[:, 0]) else CLOCKS[:1]  # alike at a single speed
    fits = [_fit_from(stack, priors, given, powers) for powers in clocks]
    fits.sort(key=lambda fit: -fit[0])
    likeliest, _, nearest, _ = fits[0]
    found: list[tuple[float, Array, Shared]] = []
    for log_p, x, shared, scale in fits:
        odds = float(np.exp(log_p - likeliest))
        is_same = found and abs(shared.powers[0] - nearest.powers[0]) < SAME_END
        if is_same or odds < NEGLIGIBLE:
            continue
        stack.stretch(shared.powers, shared)
        stack.deviate(shared)
        # the walk affects the level most and is least visible
        sd = priors.sd(x)
        sd[WALK_PART] = _mean_size(stack, priors, sd, WALK_PART, scale, given, shared)
        found.append((odds, sd, shared))
    return found


def _mean_size(
    stack: Stack, priors: Priors, sd: Array, part: int, scale: Array, given: Given, shared: Shared
) -> float:
    """Average one variance about its mode, with probability 1/2 for zero; return its root."""
    precision = priors.precision[part]
    x = (np.log(np.maximum(sd, 1e-300)) - priors.centre) / priors.width
    along = x[part] + STEPS
    tried = np.append(np.exp(priors.centre[part] + priors.width[part] * along), 0.0)
    # density of the prior given the other variances
    offset = along - x[part] + precision @ x / precision[part]
    log_prior = -0.5 * precision[part] * offset**2 + 0.5 * np.log(precision[part] / (2.0 * np.pi))
    log_p = np.append(log_prior + np.log(STEPS[1] - STEPS[0]), 0.0)
    for k, size in enumerate(tried):
        trial = sd.copy()
        trial[part] = size
        log_p[k] += log_evidence(stack, trial, scale, given, shared)[0]
    return float(np.sqrt(np.exp(log_p - np.logaddexp.reduce(log_p)) @ tried**2))


def _fit_from(
    stack: Stack, priors: Priors, given: Given, powers: Array
) -> tuple[float, Array, Shared, Array]:
    """Fit a bench from initial powers of the tail length.

    Returns
    -------
    log_p : float
        Logarithm of the posterior density of the variances, up to a constant.
    x, shared, scale : ndarray, Shared, ndarray
        Variances in steps from their medians, common effects, and noise of the runs.
    """
    scale = np.ones(stack.n_runs)
    # start from above: a variance that is too small has no gradient
    x = np.full(N_VARIANCES, 1.5)
    x[OWN_PARTS] = 0.0
    stack.stretch(powers)
    shared = fit_shared(whiten(stack, priors.sd(x)), scale, given, Shared.before(powers))
    # an approximate tail is enough for its derivatives with respect to the powers
    stack.stretch(powers, shared)
    shared, log_p = Shared.before(powers), -np.inf
    for _ in range(SWEEPS):
        w = whiten(stack, priors.sd(x))
        shared = fit_shared(w, scale, given, shared, every_drift=True)
        scale = noise_scale(stack, w, shared.mean)
        stack.stretch(shared.powers, shared)
        stack.deviate(shared)
        x, log_p = _most_probable(stack, priors, x, scale, given, shared)
    return log_p, x, shared, scale


def _most_probable(
    stack: Stack,
    priors: Priors,
    x: Array,
    scale: Array,
    given: Given,
    before: Shared,
) -> tuple[Array, float]:
    """Find the mode of the variances, in steps from their medians, and the log density there."""

    def cost(x: Array) -> tuple[float, Array]:
        sd = priors.sd(x)
        log_z, w, shared = log_evidence(stack, sd, scale, given, before)
        slope = slope_of_evidence(stack, sd, scale, w, shared)
        prior_slope = priors.precision @ x
        return 0.5 * float(x @ prior_slope) - log_z, prior_slope - slope * priors.width

    options = {"maxiter": 30, "ftol": 1e-7}
    bounds = [(-4.0, 6.0)] * x.size
    found = minimize(cost, x, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    return np.asarray(found.x), -float(found.fun)


@dataclass(frozen=True, slots=True, eq=False)
class RunLevel:
    """Level of a run and its uncertainty; all in units of z.

    Attributes
    ----------
    y : float
        Level ln(T_tight/T_slack) after the tail has decayed.
    variance : float
        Variance of `y` that is independent between runs.
    shared_tail, shared_drift : float
        Standard deviations of `y` by errors common to all runs, with their common sign.
    away, spread : ndarray, shape (K,)
        Difference of the level from `y` under each hypothesis about the common effects, and its
        standard deviation, including `variance`.
    misfit : float
        Ratio of the noise of the run about the model to that of the bench, standard deviations.
    drift : float
        Visible change by wandering zeros and drift of the friction over the sliding.
    tail : ndarray, shape (RANK,)
        Tail of the run in the basis.
    own : ndarray, shape (RANK, 2)
        Standard deviations of its height and its length, as tails.
    known, lean : ndarray, shape (2, 2), (2,)
        Share of these deviations that the record determines, and change of the level with them.
    """

    y: float
    variance: float
    shared_tail: float
    shared_drift: float
    away: Array
    spread: Array
    misfit: float
    drift: float
    tail: Array
    own: Array
    known: Array
    lean: Array

    def at(self, travel: float, shared: Shared, level: float) -> tuple[float, float]:
        """Return z of the model and its error at a travel since the end of the build-up [m]."""
        basis = tail_basis(np.array([travel]))[0]
        h = basis @ self.own
        variance = self.variance * (1.0 - 2.0 * float(self.lean @ h))
        variance += float(h @ h - h @ self.known @ h)
        common = np.linalg.norm(level * (basis @ shared.factor[:RANK])) + abs(self.shared_tail)
        error = np.sqrt(max(variance, 0.0) + float(common) ** 2)
        return self.y + float(basis @ self.tail), float(error)


_TAIL = np.array([*range(RANK), *range(RANK + 3, SHARED)])
BATCH = 128
"""Number of runs whitened at a time, so that the memory does not grow with the bench."""


def reduce_bench(records: Sequence[SlidingRecord]) -> tuple[Shared, Array, list[RunLevel]]:
    """Fit the common effects of a bench of one or more runs, and the level of every run.

    Returns
    -------
    shared : Shared
        Common effects, for the more probable of tails over travel and tails over time.
    probability : ndarray, shape (K,)
        Probabilities of the hypotheses in `RunLevel.away`.
    levels : list of RunLevel
        Levels of the runs, averaged over both.
    """
    settings = log_settings(records)
    centre = np.mean(settings, axis=0)
    limits_m = np.array([(2.0 * r.step_m, 3.0 * float(r.travel[-1])) for r in records])
    given = Given.by([r.rest for r in records], limits_m, settings - centre)
    fits = fit_bench(Stack(_evenly_chosen(records, RUNS_FOR_VARIANCES), centre), given)
    weight = np.array([fit[0] for fit in fits])
    weight /= weight.sum()
    found = [_reduced(records, centre, given, sd, shared) for _, sd, shared in fits]
    levels = [
        _averaged(parts, weight) for parts in zip(*(levels for _, levels in found), strict=True)
    ]
    posteriors = [shared.hypotheses.probability for shared, _ in found]
    probability = np.concatenate([w * p for w, p in zip(weight, posteriors, strict=True)])
    return found[0][0], probability, levels


def _reduced(
    records: Sequence[SlidingRecord], centre: Array, given: Given, sd: Array, shared: Shared
) -> tuple[Shared, list[RunLevel]]:
    """Find the common effects of all runs and their levels from a fit to some of them."""
    # no run sees much of a turn: the ripple takes more runs to be visible
    many = Stack(_evenly_chosen(records, BATCH), centre)
    scale = noise_scale(many, _whitened(many, sd, shared), shared.stretched_mean)
    sd[TURN_PART] = _mean_size(many, Priors.of(many), sd, TURN_PART, scale, given, shared)
    # stack a small bench once, a large one batch by batch
    is_small = len(records) <= BATCH
    batches = [records[k : k + BATCH] for k in range(0, len(records), BATCH)]
    stacks = [many] if is_small else (Stack(x, centre) for x in batches)
    M, b, shift = np.zeros((SHARED, SHARED)), np.zeros(SHARED), np.zeros(SHARED)
    for stack in stacks:
        w = _whitened(stack, sd, shared)
        weight = 1.0 / noise_scale(stack, w, shared.stretched_mean)
        M += np.einsum("r,rkl->kl", weight, w.M)
        b += w.b.T @ weight
        shift += w.shift.sum(axis=0)
    shared = posterior(M, b, given, shared)
    if not is_small:
        stacks = (Stack(x, centre) for x in batches)
    return shared, [level for stack in stacks for level in _levels(stack, sd, shared, shift)]


def _averaged(parts: Sequence[RunLevel], weight: Array) -> RunLevel:
    """Average the level of a run over fits with the given probabilities, the likeliest first."""
    if len(parts) == 1:
        return parts[0]
    y, tail, drift, variance = np.array(
        [(part.y, part.shared_tail, part.shared_drift, part.variance) for part in parts]
    ).T
    mean = float(weight @ y)
    # between the fits all runs move together
    squares = weight @ tail**2 + weight @ (y - mean) ** 2, weight @ drift**2
    tail_sd, drift_sd = np.copysign(np.sqrt(squares), (tail[0], drift[0]))
    return replace(
        parts[0],
        y=mean,
        variance=float(weight @ variance),
        shared_tail=float(tail_sd),
        shared_drift=float(drift_sd),
        away=np.concatenate([part.away + part.y - mean for part in parts]),
        spread=np.concatenate([part.spread for part in parts]),
    )


def _evenly_chosen(records: Sequence[SlidingRecord], most: int) -> list[SlidingRecord]:
    chosen = np.linspace(0, len(records) - 1, min(len(records), most)).astype(int)
    return [records[k] for k in chosen]


def _whitened(stack: Stack, sd: Array, shared: Shared) -> Whitened:
    """Apply tails and variances of the bench to some runs."""
    stack.stretch(shared.powers, shared)
    stack.deviate(shared)
    return whiten(stack, sd)


def _levels(stack: Stack, sd: Array, shared: Shared, shift: Array) -> list[RunLevel]:
    """Compute the levels of some runs; `shift` is the sum of `Whitened.shift` over all runs."""
    w = _whitened(stack, sd, shared)
    mean = shared.stretched_mean
    scale = noise_scale(stack, w, mean)
    tail, drift = (-(w.shift[:, part] @ shared.factor[part]) for part in (_TAIL, DRIFTS))
    error = tail + drift
    # one column represents all directions: its sign is that of the correlation with the mean run
    mean_error = -(shift @ shared.factor)
    size = np.where(error @ mean_error < 0.0, -1.0, 1.0) * np.linalg.norm(error, axis=1)
    share = np.clip(np.sum(drift * error, axis=1) / np.maximum(size**2, 1e-300), 0.0, 1.0)
    residual = stack.z - stack.shared @ mean
    Pe = np.einsum("rij,rj->ri", w.P, residual)
    wander = np.einsum("rij,rj->ri", stack.parts[WALK_PART], Pe)
    wander *= (sd[WALK_PART] ** 2 * stack.sensitivity)[:, None]
    own = shared.deviations * sd[OWN_PARTS]
    H = stack.shared[:, :, :RANK] @ own
    known = H.transpose(0, 2, 1) @ (w.P @ H)
    lean = w.shift[:, :RANK] @ own
    deviation = np.einsum("rik,ri->rk", H, Pe)
    y = w.level - w.shift @ mean
    last = np.array([np.flatnonzero(c)[-1] for c in stack.count])
    # a short sliding does not show noise that is correlated over longer than itself; the rest does
    variance = np.maximum(w.variance * scale, np.square(stack.sensitivity * stack.least_N))
    away, by_hypothesis = shared.hypotheses.along(-w.shift)
    spread = np.sqrt(variance[:, None] + by_hypothesis)
    return [
        RunLevel(
            y=float(y[k]),
            variance=float(variance[k]),
            shared_tail=float(size[k] * np.sqrt(1.0 - share[k])),
            shared_drift=float(size[k] * np.sqrt(share[k])),
            away=away[k],
            spread=spread[k],
            misfit=float(np.sqrt(scale[k])),
            drift=float(wander[k, last[k]] - wander[k, 0] + mean[RANK + 2] * stack.level[k]),
            tail=stack.level[k] * stack.stretches[k] @ (shared.mean[:RANK] + own @ deviation[k]),
            own=stack.level[k] * stack.stretches[k] @ own,
            known=known[k],
            lean=lean[k] / stack.level[k],
        )
        for k in range(stack.n_runs)
    ]

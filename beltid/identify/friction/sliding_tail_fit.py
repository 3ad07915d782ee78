"""Weigh what a record says about its tail: one exponential or two, see `sliding_tails`.

The evidence of each hypothesis and the moments of its level are integrals over amplitudes (closed
form) and time constants (grids that close in on the probability). The slow amplitude of a double
tail has the sign of the whole one; ripple is a regressor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from beltid.identify.friction.sliding_errors import MOST_TAKEN, ROUNDING, correlation_time
from beltid.identify.friction.sliding_model import SlidingFit
from beltid.identify.friction.sliding_tail_record import POINTS, Decays, TailRecord
from beltid.identify.friction.sliding_tails import Hypothesis, Tails, mixture

Array = NDArray[np.float64]

LEAST_RATIO = 1.25
"""Least ratio of the two time constants of a double tail."""
SLOW_PART = 0.5
"""Typical slow amplitude over that of the whole tail (scale of a half-normal prior)."""
NO_TAIL_HAS_THAT = 2.0
"""Gain in log odds that a drift must bring where no tail shows, to count at all."""
NO_TAIL = 0.2
"""Prior probability that a single tail is none."""
ZOOMS = 2
NEGLIGIBLE = 1.0e-4
"""Weight, relative to the largest, at which a grid of time constants is cut off."""


def weigh_tails(t: Array, fit: SlidingFit) -> Tails:
    """Level and evidence of both hypotheses.

    Parameters
    ----------
    t : ndarray
        Times of the samples that were fitted [s], non-decreasing, shape (n,).
    fit : SlidingFit
        Fit with a single tail: levels to first approximation, ripple, outliers.
    """
    record = TailRecord.of(t, fit)
    low, high_1, high_2 = record.log_range
    grid = np.linspace(low, high_1, POINTS)
    first = record.decays(grid)
    second = np.linspace(low + np.log(LEAST_RATIO), high_2, POINTS)
    pairs = _Pairs.of(record, (grid, first), (second, record.decays(second)))
    single, amplitude = _single(record, grid, first, pairs.noise)
    for _ in range(ZOOMS):
        pairs = pairs.closer(amplitude)
        single, amplitude = _single(record, grid, first, pairs.noise)
    odds = 0.5 * (float(np.min(pairs.squares)) - record.fit_squares) / pairs.noise
    # no tail explains what moves in the combination in which the tail does not show
    odds += max(0.5 * record.unexplained - NO_TAIL_HAS_THAT, 0.0)
    return Tails(single, pairs.summary(amplitude), odds)


def _single(
    record: TailRecord, grid: Array, decays: Decays, noise: float
) -> tuple[Hypothesis, float]:
    """A single tail or none, and the largest amplitude that it may have (with its sign).

    The search begins with the exponentials `decays` of a grid over all time constants.
    """
    low, high, _ = record.log_range
    for zoom in range(ZOOMS + 1):
        power, shares = decays.power, decays.share
        amplitudes, variances = decays.projection / power, noise / power
        evidence = -0.5 * (record.squares - power * amplitudes**2) / noise
        evidence += record.log_freedom(variances)
        best = int(np.argmax(evidence))
        weights = np.exp(evidence - evidence[best])
        if zoom < ZOOMS:
            grid = _closer(grid, weights, low, high)
            decays = record.decays(grid)
    cell = float(grid[1] - grid[0]) / (high - low)
    with_tail = float(evidence[best] + np.log(np.sum(weights) * cell))
    level_noise = noise * record.level_cofactor
    tail = _summed(
        weights, record.level - amplitudes * shares, level_noise + variances * shares**2, with_tail
    )
    none = Hypothesis(record.level, float(np.sqrt(level_noise)), -0.5 * record.squares / noise)
    amplitude = float(amplitudes[best])
    size = min(abs(amplitude) + 2.0 * float(np.sqrt(variances[best])), record.largest)
    return _either(none, tail), float(np.copysign(size, amplitude))


def _either(none: Hypothesis, tail: Hypothesis) -> Hypothesis:
    """No tail or one."""
    log_weights = np.array([none.log_evidence, tail.log_evidence])
    log_weights += np.log([NO_TAIL, 1.0 - NO_TAIL])
    total = float(np.logaddexp(*log_weights))
    return Hypothesis(*mixture(np.exp(log_weights - total).tolist(), [none, tail]), total)


@dataclass(frozen=True, slots=True)
class _Pairs:
    """Least squares with two tails for every pair of time constants, shape (m, k) each."""

    record: TailRecord
    first: Array
    second: Array
    slow: Array
    """Amplitude of the slower one."""
    slow_cofactor: Array
    fast_cofactor: Array
    """That of the faster one if the slower is known; shape (m, 1)."""
    squares: Array
    """Residual sum of squares; infinite where the time constants are too close."""
    level: Array
    """Level without the slower tail."""
    slope: Array
    """Change of the level by the amplitude of the slower tail."""
    fast_share: Array
    noise: float
    """Variance of a sample by its autocorrelation time, of the pair that fits best."""

    @classmethod
    def over(cls, record: TailRecord, first: Array, second: Array) -> _Pairs:
        """All pairs of two grids."""
        return cls.of(record, (first, record.decays(first)), (second, record.decays(second)))

    @classmethod
    def of(
        cls, record: TailRecord, faster: tuple[Array, Decays], slower: tuple[Array, Decays]
    ) -> _Pairs:
        """Solve the 2 x 2 normal equations of all pairs; grids with their exponentials."""
        (first, one), (second, two) = faster, slower
        g_11, g_22 = one.power[:, None], two.power
        g_12 = one.decay @ two.decay.T - one.explained @ two.explained.T
        c_1, c_2 = one.projection[:, None], two.projection
        determinant = np.maximum(g_11 * g_22 - g_12**2, 1e-9 * g_11 * g_22)
        slow = (g_11 * c_2 - g_12 * c_1) / determinant
        squares = record.squares - c_1**2 / g_11 - slow**2 * determinant / g_11
        squares[second < first[:, None] + np.log(LEAST_RATIO) * (1.0 - 1e-9)] = np.inf
        i, j = np.unravel_index(np.argmin(squares), squares.shape)
        fast = (c_1[i, 0] - g_12[i, j] * slow[i, j]) / g_11[i, 0]
        residual = record.rest - fast * one.left(int(i), record.q)
        residual -= slow[i, j] * two.left(int(j), record.q)
        share = one.share[:, None]
        return cls(
            record=record,
            first=first,
            second=second,
            slow=slow,
            slow_cofactor=g_11 / determinant,
            fast_cofactor=1.0 / g_11,
            squares=squares,
            level=record.level - share * c_1 / g_11,
            slope=share * g_12 / g_11 - two.share,
            fast_share=share,
            noise=_noise(record, residual),
        )

    def weighted(self, amplitude: float) -> tuple[Array, Array, Array, float]:
        """Weight of each pair, mean and variance of its slow amplitude, and the log evidence.

        The slower tail has the sign of the whole one and half-normal size.
        """
        sign, scale = np.sign(amplitude) or 1.0, SLOW_PART * abs(amplitude)
        own = self.noise * self.slow_cofactor
        variance = 1.0 / (1.0 / own + 1.0 / scale**2)
        sd, mean = np.sqrt(variance), variance / own * sign * self.slow
        z = mean / sd
        positive = log_ndtr(z)
        ratio = np.exp(-0.5 * z**2 - positive) / np.sqrt(2.0 * np.pi)
        evidence = -0.5 * (self.squares / self.noise + self.slow**2 / (own + scale**2))
        evidence += np.log(2.0 * sd / scale) + positive
        evidence += self.record.log_freedom(self.noise * self.fast_cofactor)
        low, high_1, high_2 = self.record.log_range
        evidence -= np.log(high_2 - self.first - np.log(LEAST_RATIO))[:, None] + np.log(
            high_1 - low
        )
        largest = float(np.max(evidence))
        weights = np.exp(evidence - largest)
        cell = float((self.first[1] - self.first[0]) * (self.second[1] - self.second[0]))
        log_evidence = largest + float(np.log(np.sum(weights) * cell)) + float(np.log1p(-NO_TAIL))
        spread = variance * np.maximum(1.0 - ratio * (ratio + z), 0.0)
        return weights, sign * (mean + sd * ratio), spread, log_evidence

    def closer(self, amplitude: float) -> _Pairs:
        """The same over grids that close in on the probability."""
        weights = self.weighted(amplitude)[0]
        low, high_1, high_2 = self.record.log_range
        return _Pairs.over(
            self.record,
            _closer(self.first, np.max(weights, axis=1), low, high_1),
            _closer(self.second, np.max(weights, axis=0), low + np.log(LEAST_RATIO), high_2),
        )

    def summary(self, amplitude: float) -> Hypothesis:
        """Level over all pairs."""
        weights, slow, spread, log_evidence = self.weighted(amplitude)
        record = self.record
        known = record.level_cofactor + self.fast_share**2 * self.fast_cofactor
        variance = self.noise * known + self.slope**2 * spread
        return _summed(weights, self.level + self.slope * slow, variance, log_evidence)


def _noise(record: TailRecord, residual: Array) -> float:
    """Variance of a sample by its autocorrelation time."""
    n, n_terms = residual.size, record.q.shape[1] + 4
    time = correlation_time(residual, n_terms)
    free = n * (1.0 - min(n_terms * time / n, MOST_TAKEN))
    return time * max(float(residual @ residual) / free, ROUNDING**2)


def _summed(weights: Array, levels: Array, variances: Array, log_evidence: float) -> Hypothesis:
    """Moments of the level over weighted alternatives."""
    w = weights / np.sum(weights)
    mean = float(np.sum(w * levels))
    variance = float(np.sum(w * (variances + (levels - mean) ** 2)))
    return Hypothesis(mean, float(np.sqrt(variance)), log_evidence)


def _closer(grid: Array, weights: Array, low: float, high: float) -> Array:
    """Grid over the part that carries weight, a step wider on either side."""
    kept = np.flatnonzero(weights > NEGLIGIBLE * np.max(weights))
    step = grid[1] - grid[0]
    start, end = max(low, grid[kept[0]] - step), min(high, grid[kept[-1]] + step)
    return np.linspace(start, end, POINTS)

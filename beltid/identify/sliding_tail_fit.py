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

from beltid.identify.signal import line_columns
from beltid.identify.sliding_errors import MOST_TAKEN, ROUNDING, correlation_time
from beltid.identify.sliding_model import SlidingFit
from beltid.identify.sliding_tails import Hypothesis, Tails, mixture

Array = NDArray[np.float64]

RANGE = (0.01, 0.5, 2.0)
"""Shortest time constant, longest one of a single or first tail and of a second tail, over the
length of the record; log-uniform a priori."""
BELOW_FIT = 0.25
"""Shortest time constant over that of the fit, where many samples resolve a tail so short."""
LEAST_RATIO = 1.25
"""Least ratio of the two time constants of a double tail."""
SLOW_PART = 0.5
"""Typical slow amplitude over that of the whole tail (scale of a half-normal prior)."""
LARGEST_TAIL = 0.3
"""Amplitudes are uniform a priori up to this part of ln(T_tight/T_slack)."""
NO_TAIL_HAS_THAT = 2.0
"""Gain in log odds that a drift must bring where no tail shows, to count at all."""
NO_TAIL = 0.2
"""Prior probability that a single tail is none."""
POINTS = 28
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
    record = _Record.of(t, fit)
    low, high_1, high_2 = record.log_range
    pairs = _Pairs.over(
        record,
        np.linspace(low, high_1, POINTS),
        np.linspace(low + np.log(LEAST_RATIO), high_2, POINTS),
    )
    single, amplitude = _single(record, pairs.noise)
    for _ in range(ZOOMS):
        pairs = pairs.closer(amplitude)
        single, amplitude = _single(record, pairs.noise)
    odds = 0.5 * (float(np.min(pairs.squares)) - record.fit_squares) / pairs.noise
    # no tail explains what moves in the combination in which the tail does not show
    odds += max(0.5 * record.unexplained - NO_TAIL_HAS_THAT, 0.0)
    return Tails(single, pairs.summary(amplitude), odds)


@dataclass(frozen=True, slots=True)
class _Decays:
    """Exponentials of k time constants; a record is orthogonal to the regressors already."""

    decay: Array
    """Shape (k, n)."""
    explained: Array
    """Coefficients over the regressors, shape (k, m)."""
    power: Array
    """Sums of squares of what the regressors leave, shape (k,)."""
    projection: Array
    """Products with the record, shape (k,)."""
    share: Array
    """What they add to the level, shape (k,)."""

    def left(self, k: int, q: Array) -> Array:
        """What the regressors leave of one of them."""
        return np.asarray(self.decay[k] - q @ self.explained[k], dtype=float)


@dataclass(frozen=True, slots=True)
class _Record:
    """A record with all but its tail taken off; `q` is an orthonormal basis of the regressors."""

    t: Array
    log_range: tuple[float, float, float]
    """Logarithms of the shortest and the longest time constants, see `RANGE`."""
    q: Array
    row: Array
    """Weights of the samples in the level without a tail, shape (n,)."""
    rest: Array
    """Series with the tail of y and the least noise, less what the regressors explain, (n,)."""
    level: float
    """Level without a tail [-]."""
    level_cofactor: float
    """Its variance over that of a sample of `rest`."""
    reference: float
    """ln(T_tight/T_slack) of the fit [-]."""
    fit_squares: float
    """Sum of squares that the fit leaves of `rest`."""
    unexplained: float
    """Sum of squares that the fit takes off the combination without a tail, over its noise."""

    @classmethod
    def of(cls, t: Array, fit: SlidingFit) -> _Record:
        """Combine both tensions so that the tail stands out of the noise the most.

        y itself has not the least noise for that: its companion, the combination with as much
        noise that is not correlated with it, carries the tail, too, in some proportion to y.
        """
        combinations = fit.combinations
        series = (fit.deviation(t) @ combinations)[fit.used]
        t = t - t[0]
        columns = [np.ones((t.size, 1)), *(line_columns(t, line) for line in fit.lines)]
        q, r = np.linalg.qr(np.hstack(columns)[fit.used])
        row = np.linalg.solve(r, q.T)[0]
        rest = series - q @ (q.T @ series)
        log_range = _log_range(float(t[fit.used][-1]), fit.tau)
        share = _proportion(t[fit.used], rest, q, *log_range[:2])
        weights = np.array([1.0, share]) / (1.0 + share**2)
        residual = fit.residual[fit.used] @ combinations
        across = np.array([-share, 1.0])
        rest_of_fit = residual @ across
        left = float(rest_of_fit @ rest_of_fit)
        taken = max(float(np.sum((rest @ across) ** 2)) - left, 0.0)
        time = correlation_time(rest_of_fit, q.shape[1] + 2)
        return cls(
            t=t[fit.used],
            log_range=log_range,
            q=q,
            row=row,
            rest=rest @ weights,
            level=fit.log_ratio + float(row @ series[:, 0]),
            level_cofactor=(1.0 + share**2) * float(row @ row),
            reference=fit.log_ratio,
            fit_squares=float(np.sum((residual @ weights) ** 2)),
            unexplained=taken * rest_of_fit.size / (left * time) if left > 0.0 else 0.0,
        )

    @property
    def squares(self) -> float:
        """Sum of squares without a tail."""
        return float(self.rest @ self.rest)

    @property
    def largest(self) -> float:
        """Largest credible amplitude [-]."""
        return LARGEST_TAIL * abs(self.reference)

    def decays(self, log_tau: Array) -> _Decays:
        """Exponentials, and what the regressors explain of them."""
        decay = np.exp(np.outer(-np.exp(-log_tau), self.t))
        explained = decay @ self.q
        power = np.einsum("ij,ij->i", decay, decay) - np.sum(explained**2, axis=1)
        return _Decays(decay, explained, power, decay @ self.rest, decay @ self.row)

    def log_freedom(self, variance: Array) -> Array:
        """Logarithm of the integral over an amplitude that is known with `variance`."""
        return 0.5 * np.log(2.0 * np.pi * variance) - np.log(2.0 * self.largest)


def _log_range(length: float, tau: float) -> tuple[float, float, float]:
    """Logarithms of the time constants of `RANGE`, around that of the fit [s] (nan without)."""
    low, high_1, high_2 = np.log(length * np.array(RANGE)).tolist()
    return (min(low, float(np.log(BELOW_FIT * tau))) if tau > 0.0 else low), high_1, high_2


def _proportion(t: Array, rest: Array, q: Array, low: float, high: float) -> float:
    """Amplitude of the tail in the companion over that in y; less where noise hides the tail."""
    grid = np.linspace(low, high, POINTS)
    decays = np.exp(np.outer(-np.exp(-grid), t))
    explained = decays @ q
    power = np.einsum("ij,ij->i", decays, decays) - np.sum(explained**2, axis=1)
    both = (decays @ rest) / power[:, None]
    best = int(np.argmax(power * np.sum(both**2, axis=1)))
    amplitudes = both[best]
    residual = rest - np.outer(decays[best] - q @ explained[best], amplitudes)
    noise = float(np.mean(residual**2)) / power[best]
    size = amplitudes[0] ** 2 + noise
    return float(amplitudes[0] * amplitudes[1] / size) if size > 0.0 else 0.0


def _single(record: _Record, noise: float) -> tuple[Hypothesis, float]:
    """A single tail or none, and the largest amplitude that it may have (with its sign)."""
    low, high, _ = record.log_range
    grid = np.linspace(low, high, POINTS)
    for zoom in range(ZOOMS + 1):
        decays = record.decays(grid)
        power, shares = decays.power, decays.share
        amplitudes, variances = decays.projection / power, noise / power
        evidence = -0.5 * (record.squares - power * amplitudes**2) / noise
        evidence += record.log_freedom(variances)
        best = int(np.argmax(evidence))
        weights = np.exp(evidence - evidence[best])
        if zoom < ZOOMS:
            grid = _closer(grid, weights, low, high)
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

    record: _Record
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
    def over(cls, record: _Record, first: Array, second: Array) -> _Pairs:
        """Solve the 2 x 2 normal equations of all pairs."""
        one, two = record.decays(first), record.decays(second)
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


def _noise(record: _Record, residual: Array) -> float:
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

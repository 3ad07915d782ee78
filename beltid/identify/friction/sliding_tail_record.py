"""A record of the sliding phase with all but its tail taken off, and the tails tried on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.identify.estimators.signal import exponentials, line_columns, sums_of_squares
from beltid.identify.friction.sliding_errors import correlation_time
from beltid.identify.friction.sliding_model import SlidingFit

Array = NDArray[np.float64]

RANGE = (0.01, 0.5, 2.0)
"""Shortest time constant, longest one of a single or first tail and of a second tail, over the
length of the record; log-uniform a priori."""
BELOW_FIT = 0.25
"""Shortest time constant over that of the fit, where many samples resolve a tail so short."""
LARGEST_TAIL = 0.3
"""Amplitudes are uniform a priori up to this part of ln(T_tight/T_slack)."""
POINTS = 28
"""Time constants of a grid."""


@dataclass(frozen=True, slots=True)
class Decays:
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
class TailRecord:
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
    def of(cls, t: Array, fit: SlidingFit) -> TailRecord:
        """Combine both tensions so that the tail stands out of the noise the most.

        y itself has not the least noise for that: its companion, the combination with as much
        noise that is not correlated with it, carries the tail, too, in some proportion to y.
        """
        combinations = fit.combinations
        series = np.compress(fit.used, fit.deviation(t) @ combinations, axis=0)
        t = t - t[0]
        columns = [np.ones((t.size, 1)), *(line_columns(t, line) for line in fit.lines)]
        q, r = np.linalg.qr(np.compress(fit.used, np.hstack(columns), axis=0))
        row = np.linalg.inv(r)[0] @ q.T
        rest = series - q @ (q.T @ series)
        log_range = _log_range(float(t[fit.used][-1]), fit.tau)
        share = _proportion(t[fit.used], rest, q, *log_range[:2])
        weights = np.array([1.0, share]) / (1.0 + share**2)
        residual = np.compress(fit.used, fit.residual, axis=0) @ combinations
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

    def decays(self, log_tau: Array) -> Decays:
        """Exponentials, and what the regressors explain of them."""
        decay = exponentials(np.exp(log_tau), self.t)
        explained = decay @ self.q
        power = sums_of_squares(decay) - sums_of_squares(explained)
        return Decays(decay, explained, power, decay @ self.rest, decay @ self.row)

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
    decays = exponentials(np.exp(grid), t)
    explained = decays @ q
    power = sums_of_squares(decays) - sums_of_squares(explained)
    both = (decays @ rest) / power[:, None]
    best = int(np.argmax(power * np.sum(both**2, axis=1)))
    amplitudes = both[best]
    residual = rest - np.outer(decays[best] - q @ explained[best], amplitudes)
    noise = float(np.mean(residual**2)) / power[best]
    size = amplitudes[0] ** 2 + noise
    return float(amplitudes[0] * amplitudes[1] / size) if size > 0.0 else 0.0

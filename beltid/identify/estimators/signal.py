"""Tools for bench signals: noise, spikes, thinning, periodic lines.

These functions work on any signal, whatever its physical quantity, and on noise-free records too:
a spread of zero is allowed, and every threshold has a floor relative to the size of the signal.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import median_filter

from beltid.identify.estimators.statistics import MAD_TO_SIGMA, median

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SPIKE_WINDOW = 7
"""Window of the running median [samples]; it ignores up to three deviating samples in a row."""
NOISE_FLOOR = 2.0e-5
"""Deviations below this fraction of a signal always count as rounding."""


def running_median(x: Array, window: int) -> Array:
    """Return the median over a centred odd window, mirrored at the ends to catch spikes there."""
    n = x.size
    return median_filter(x, size=min(window, n - 1 + n % 2), mode="mirror") if n > 2 else x.copy()


def difference_sigma(x: Array, order: int = 1) -> float:
    """Estimate the standard deviation of white noise on a slowly changing signal by differencing.

    Parameters
    ----------
    x : ndarray
        Finite samples in time order, shape (n,).
    order : int
        Order of the differences. It removes a polynomial of lower degree: use 2 on a ramp.

    Returns
    -------
    float
        ``1.4826 median |differences|`` divided by the root of the sum of their squared weights,
        which is ``(2 order)! / order!²``; 0 with fewer than ``order + 1`` samples. If a coarse
        ADC makes more than half of the differences zero, the root mean square of the smallest
        98 % replaces the median.
    """
    if x.size <= order:
        return 0.0
    step = np.abs(np.diff(x, order))
    sigma = MAD_TO_SIGMA * median(step)
    if sigma == 0.0 and np.any(step > 0.0):
        central = np.sort(step)[: max(1, int(0.98 * step.size))]
        sigma = float(np.sqrt(np.mean(central**2)))
    return sigma / math.sqrt(math.comb(2 * order, order))


COARSEST = 0.1
"""Largest step of an ADC, over the largest value that it reads."""


def resolution(*signals: Array) -> float:
    """Return the largest step of an A/D converter that several signals show; zero if none shows.

    The values of a coarse converter repeat and lie on an even grid through zero, or chatter. Round
    numbers without noise are no grid: a step is at most :data:`COARSEST` of the largest value.

    Parameters
    ----------
    *signals : ndarray
        Samples in time order, in one unit; values that are zero or not finite do not count.
    """
    finite = [x[np.isfinite(x) & (x != 0.0)] for x in signals]
    every = np.abs(np.concatenate(finite))
    levels = np.unique(every)
    if not 2 <= levels.size <= every.size // 2:
        return 0.0
    step = _grid(levels)
    if step == 0.0 or abs(levels[0] / step - np.rint(levels[0] / step)) > 0.02:
        step = max(_chatter_step(x) for x in finite)
    return step if step <= COARSEST * levels[-1] else 0.0


def _chatter_step(x: Array) -> float:
    """Return the grid spacing of a signal that jumps to and fro; zero if it does not."""
    moves, levels = np.diff(x), np.unique(x)
    turns = np.count_nonzero(np.diff(np.sign(moves[moves != 0.0])))
    return _grid(levels) if turns >= 3 and levels.size <= x.size // 2 else 0.0


def _grid(levels: Array) -> float:
    """Return the spacing of an even grid through all levels; zero if there is none."""
    gaps = np.diff(levels)
    if levels[-1] - levels[0] > 1e6 * np.min(gaps):
        return 0.0
    for part in (1, 2, 3):  # with few levels the smallest gap may span several steps
        step = float(np.min(gaps)) / part
        for _ in range(2):  # levels are rounded: the full range gives a better step than one gap
            count = np.rint((levels - levels[0]) / step)
            step = float(np.sum(count * (levels - levels[0])) / np.sum(count**2))
        if np.max(np.abs(levels - levels[0] - step * count)) <= 0.02 * step:
            return step
    return 0.0


def rounding_of_mean(recorded: ArrayLike, step: ArrayLike) -> Array:
    """Return the standard error of means due to readings in steps; averaging does not lower it.

    It is ``step/sqrt(12)`` without noise; noise before the rounding, here a safe lower estimate
    from the recorded scatter, smooths it as ``exp(-2 pi² noise²/step²)``.

    Parameters
    ----------
    recorded, step : array_like
        Standard deviation of the readings, and their step (zero: fine), in one unit.
    """
    scatter, width = np.broadcast_arrays(np.asarray(recorded, float), np.asarray(step, float))
    ratio = np.divide(scatter, width, out=np.full(scatter.shape, np.inf), where=width > 0.0)
    noise2 = np.clip(ratio**2 - 1.0 / 6.0, 0.0, 100.0)
    return np.asarray(width / math.sqrt(12.0) * np.exp(-2.0 * math.pi**2 * noise2))


def spike_mask(x: Array, threshold: float) -> Mask:
    """Mark samples that lie far from the running median of their neighbours, shape (n,).

    The limit grows with the local change of the median, so that the steep build-up of a run and
    its corner do not count as spikes.

    Parameters
    ----------
    x : ndarray
        Finite samples in time order, shape (n,).
    threshold : float
        Limit in standard deviations of the white noise.
    """
    if x.size < 5:
        return np.zeros(x.size, dtype=bool)
    middle = running_median(x, SPIKE_WINDOW)
    padded = np.pad(middle, SPIKE_WINDOW // 2, mode="edge")
    local_change = np.abs(padded[SPIKE_WINDOW - 1 :] - padded[: 1 - SPIKE_WINDOW])
    sigma = max(difference_sigma(x), 10.0 * NOISE_FLOOR * median(np.abs(x)))
    return np.abs(x - middle) > threshold * sigma + local_change


def block_means(x: Array, starts: NDArray[np.intp]) -> Array:
    """Average a record (n,) or (n, m) over blocks that begin at `starts`.

    Only finite samples count; a block is nan if most of its samples are missing.
    """
    size = np.diff(np.append(starts, len(x))).astype(float).reshape(-1, *[1] * (x.ndim - 1))
    finite = np.isfinite(x)
    if finite.all():
        return np.asarray(np.add.reduceat(x, starts) / size)
    total = np.add.reduceat(np.where(finite, x, 0.0), starts)
    count = np.add.reduceat(finite.astype(float), starts)
    return np.where(count > 0.5 * size, total / np.maximum(count, 1.0), np.nan)


def line_columns(t: Array, frequency: float) -> Array:
    """Return the cosine and sine of one frequency [Hz] at the times t, shape (n, 2)."""
    phase = 2.0 * np.pi * frequency * t
    return np.column_stack([np.cos(phase), np.sin(phase)])


def strongest_line(t: Array, residuals: Array, basis: Array) -> float | None:
    """Find the frequency of the strongest periodic component above the noise.

    A line needs at least one and a half periods in the record, and must exceed both white noise and
    its neighbourhood in the spectrum (so that red noise does not count as a line).

    Parameters
    ----------
    t : ndarray
        Times [s], non-decreasing, shape (n,).
    residuals : ndarray
        Residual signals in units of their noise, orthogonal to `basis`, shape (n, m).
    basis : ndarray
        Orthonormal columns already fitted, shape (n, p).

    Returns
    -------
    float or None
        Frequency [Hz], refined by least squares; None if no line is significant.
    """
    n = t.size
    duration = float(t[-1] - t[0])
    if n < 24 or duration <= 0.0:
        return None
    grid = np.linspace(t[0], t[-1], n)
    length = 2 * (1 << (n - 1).bit_length())
    even = np.array([np.interp(grid, t, column) for column in residuals.T])
    power = np.sum(np.abs(np.fft.rfft(even, length)) ** 2, axis=0) / n
    frequency = np.fft.rfftfreq(length, duration / (n - 1))
    first, last = np.searchsorted(frequency, [1.5 / duration, 0.45 * (n - 1) / duration])
    if last - first < 3:
        return None
    k = first + int(np.argmax(power[first:last]))
    neighbourhood = power[max(first, k // 3) : min(last, 3 * k + 1)]
    # chi-square with 2 m degrees of freedom, over n/2 independent frequencies, at about 1e-3
    limit = residuals.shape[1] + np.log(n / 2.0) + 9.0
    if power[k] < limit or power[k] < 10.0 * median(neighbourhood):
        return None
    from scipy.optimize import minimize_scalar  # slow to import

    def negative_gain(at: float) -> float:
        columns = line_columns(t - t[0], at)
        columns -= basis @ (basis.T @ columns)
        products = columns.T @ residuals
        return -float(np.sum(products * np.linalg.solve(columns.T @ columns, products)))

    near = 0.5 / duration
    bounds, options = (frequency[k] - near, frequency[k] + near), {"xatol": 1e-3 * near}
    return float(minimize_scalar(negative_gain, bounds=bounds, options=options).x)

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
    """Return the median over a centred odd window, mirrored at the ends to catch spikes there.

    Signals of shape (..., n) are filtered separately.
    """
    n = x.shape[-1]
    if n < 3:
        return x.copy()
    size = [1] * (x.ndim - 1) + [min(window, n - 1 + n % 2)]
    return median_filter(x, size=size, mode="mirror")


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


def adc_resolution(first: Array, second: Array) -> tuple[float, float]:
    """Estimate the ADC steps of two signals, in their unit; zero if no step is visible.

    The values of a coarse ADC repeat and lie on an even grid. The values of a noise-free recording
    with a straight build-up may do so too. Therefore the grid of both signals must pass through
    zero, or the signal itself must chatter; and round numbers without noise are no grid: a step is
    at most :data:`COARSEST` of the largest value.

    `first` and `second` are finite samples in time order, shape (n,) and (m,).
    """
    levels = np.unique(np.concatenate([first, second]))
    if 2 <= levels.size <= (first.size + second.size) // 2:
        step = _grid(np.append(levels, 0.0) if levels[0] > 0.0 else levels)
        is_plausible = 0.0 < step <= COARSEST * float(np.max(np.abs(levels)))
        if is_plausible and abs(levels[0] / step - np.rint(levels[0] / step)) < 0.02:
            return step, step
    return _chatter_step(first), _chatter_step(second)


def _chatter_step(x: Array) -> float:
    """Return the grid spacing of a signal that jumps to and fro; zero if it does not."""
    moves = np.diff(x)
    moves = moves[moves != 0.0]
    levels = np.unique(x)
    if np.count_nonzero(np.diff(np.sign(moves))) < 3 or levels.size > x.size // 2:
        return 0.0
    return _grid(levels)


def _grid(levels: Array) -> float:
    """Return the spacing of an even grid through all levels; zero if there is none."""
    levels = np.sort(levels)
    gaps = np.diff(levels)
    if gaps.size == 0 or levels[-1] - levels[0] > 1e6 * np.min(gaps):
        return 0.0
    for part in (1, 2, 3):  # with few levels the smallest gap may span several steps
        step = float(np.min(gaps)) / part
        for _ in range(2):  # levels are rounded: the full range gives a better step than one gap
            count = np.rint((levels - levels[0]) / step)
            step = float(np.sum(count * (levels - levels[0])) / np.sum(count**2))
        if np.max(np.abs(levels - levels[0] - step * count)) <= 0.02 * step:
            return step
    return 0.0


def converter_rounding(noise: ArrayLike, step: ArrayLike) -> Array:
    """Return the rounding error of a mean from a coarse ADC; averaging does not reduce it.

    The rounding error is a saw tooth over the position of the signal between two steps. Noise
    smooths it; the root mean square of what remains is a sum over the harmonics,
    ``step/pi sqrt(sum exp(-4 pi² k² noise²/step²)/(2 k²))``: ``step/sqrt(12)`` without noise, and
    almost zero with noise of half a step.

    Parameters
    ----------
    noise, step : array_like
        Standard deviation of the noise before rounding, and ADC step, in the same unit.
    """
    sigma, width = np.broadcast_arrays(np.asarray(noise, float), np.asarray(step, float))
    if not np.any(width > 0.0):
        return np.zeros(sigma.shape)
    ratio = np.divide(sigma, width, out=np.full(sigma.shape, np.inf), where=width > 0.0)
    k = np.arange(1.0, 301.0)
    fading = np.exp(-np.square(2.0 * np.pi * k * np.minimum(ratio, 2.0)[..., None]))
    return np.asarray(width / np.pi * np.sqrt(0.5 * np.sum(fading / k**2, axis=-1)))


def noise_before_rounding(recorded: ArrayLike, step: ArrayLike) -> Array:
    """Return a safe lower estimate of the noise of a signal before a coarse ADC rounded it.

    Rounding adds step²/12 to the variance. A signal with hardly any noise near the edge between
    two steps jumps by a whole step, which adds up to step²/12 more.
    """
    excess = np.square(np.asarray(recorded, float)) - np.square(np.asarray(step, float)) / 6.0
    return np.asarray(np.sqrt(np.maximum(excess, 0.0)))


def spike_mask(x: Array, threshold: float) -> Mask:
    """Mark samples that lie far from the running median of their neighbours.

    The limit grows with the local change of the median, so that the steep build-up of a run and
    its corner do not count as spikes.

    Parameters
    ----------
    x : ndarray
        Finite samples in time order, shape (n,), or several signals, shape (k, n).
    threshold : float
        Limit in standard deviations of the white noise.

    Returns
    -------
    ndarray of bool
        True for a spike; same shape as `x`.
    """
    if x.shape[-1] < 5:
        return np.zeros(x.shape, dtype=bool)
    middle = running_median(x, SPIKE_WINDOW)
    half = SPIKE_WINDOW // 2
    before, after = (np.repeat(end, half, axis=-1) for end in (middle[..., :1], middle[..., -1:]))
    padded = np.concatenate([before, middle, after], axis=-1)
    local_change = np.abs(padded[..., 2 * half :] - padded[..., : -2 * half])
    sigma = np.array([spike_sigma(row) for row in np.atleast_2d(x)]).reshape(*x.shape[:-1], 1)
    return np.abs(x - middle) > threshold * sigma + local_change


def spike_sigma(x: Array) -> float:
    """Return the white noise of a signal, with a floor for noise-free signals."""
    return max(difference_sigma(x), 10.0 * NOISE_FLOOR * median(np.abs(x)))


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
        Frequency [Hz], refined by least squares; None if no line is significant. A line needs at
        least one and a half periods in the record, and must exceed both white noise and its
        neighbourhood in the spectrum (so that red noise does not count as a line).
    """
    n = t.size
    duration = float(t[-1] - t[0])
    if n < 24 or duration <= 0.0:
        return None
    grid = np.linspace(t[0], t[-1], n)
    length = 2 * (1 << (n - 1).bit_length())
    even = np.array([np.interp(grid, t, column) for column in residuals.T])
    spectrum = np.fft.rfft(even, length)
    power = np.sum(spectrum.real**2 + spectrum.imag**2, axis=0) / n
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
    return _refined(t, residuals, basis, float(frequency[k]), 0.5 / duration)


def _refined(t: Array, residuals: Array, basis: Array, centre: float, half_width: float) -> float:
    """Return the frequency near `centre` [Hz] whose line reduces the sum of squares most."""
    from scipy.optimize import minimize_scalar  # slow to import

    def negative_gain(frequency: float) -> float:
        columns = line_columns(t - t[0], frequency)
        columns -= basis @ (basis.T @ columns)
        products = columns.T @ residuals
        return -float(np.sum(products * np.linalg.solve(columns.T @ columns, products)))

    bounds = (centre - half_width, centre + half_width)
    options = {"xatol": 1e-3 * half_width}
    return float(minimize_scalar(negative_gain, bounds=bounds, options=options).x)

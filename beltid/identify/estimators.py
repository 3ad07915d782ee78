"""Statistics of bench signals, robust to spikes: noise, correlation, ADC steps, periodic lines.

Neighbouring samples are correlated, by filters, ripple and drift: the standard error of a mean is
``s sqrt(tau / n)`` with the integrated autocorrelation time ``tau`` [samples]. Records without
noise are allowed: every threshold has a floor relative to the size of the signal.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.arrays import Array, Mask

MAD_TO_SIGMA, MEAN_DEVIATION_TO_SIGMA = 1.482602218505602, 1.2533141373155003
"""Ratio of standard deviation to median and mean absolute deviation, normal distribution."""
ROUNDING = 8.0 * np.finfo(float).eps  # deviations up to this, over the largest value, are no noise
OUTLIER = 6.0  # distance from the median, in robust spreads, beyond which a sample is an outlier


def median(x: Array) -> float:
    """Return the median of finite samples, n >= 1; ten times faster than numpy on short arrays."""
    half = x.size // 2
    if x.size % 2:
        return float(np.partition(x, half)[half])
    low, high = np.partition(x, (half - 1, half))[half - 1 : half + 1]
    return 0.5 * float(low + high)


def mad_sigma(x: ArrayLike) -> float:
    """Estimate the standard deviation of finite samples from their median deviation; nan if none.

    If more than half are equal (a coarse ADC), the mean deviation is used: zero only if all are.
    """
    values = np.asarray(x, dtype=float).ravel()
    values = values[np.isfinite(values)]
    if values.size == 0:
        return float("nan")
    deviation = np.abs(values - median(values))
    sigma = MAD_TO_SIGMA * median(deviation)
    return sigma if sigma > 0.0 else MEAN_DEVIATION_TO_SIGMA * float(np.mean(deviation))


def outlier_mask(x: ArrayLike, least_spread: float = 0.0) -> Mask:
    """Mark samples (n,) of a steady signal that are missing or far from its median.

    The limit is :data:`OUTLIER` times their spread, at least `least_spread`; none of two or fewer.
    """
    values = np.asarray(x, dtype=float).ravel()
    mask = ~np.isfinite(values)
    good = values[~mask]
    if good.size < 3:
        return mask
    # without this floor, rounding of the last bit could make a sample an outlier
    limit = OUTLIER * max(mad_sigma(good), least_spread, ROUNDING * float(np.max(np.abs(good))))
    mask[~mask] = np.abs(good - median(good)) > limit
    return mask


def integrated_autocorrelation_time(*runs: ArrayLike) -> float:
    """Estimate the autocorrelation time ``tau = 1 + 2 sum_k (1 - k/n) rho_k``, pooled over runs.

    Subtracting the mean of a run of n samples lowers all correlations by ``tau/n``; this is
    corrected. From the first lag at which the correlation is within two standard errors of zero,
    it is taken to fade exponentially with this tau. The runs are evenly spaced samples in time
    order (n,), not finite where missing. tau is in samples, at least 1 (independent).
    """
    known = [x for x in (np.ravel(run).astype(float) for run in runs) if np.isfinite(x).any()]
    centred = [(x - np.nanmean(x), ROUNDING * np.nanmax(np.abs(x))) for x in known]
    residuals = [r for r, limit in centred if np.nanmax(np.abs(r)) > limit]
    lagged = np.zeros((2, max((r.size for r in residuals), default=0)))
    for r in residuals:
        valid, length = np.isfinite(r), 1 << (2 * r.size).bit_length()
        # sums of products, and numbers of pairs, at every lag, by FFT
        spectra = np.abs(np.fft.rfft([np.where(valid, r, 0.0), valid.astype(float)], length)) ** 2
        lagged[:, : r.size] += np.fft.irfft(spectra, length)[:, : r.size]
    n_seen = int(np.argmin(np.append(lagged[1] > 0.5, False)))
    if n_seen < 2:
        return 1.0
    products, pairs = lagged[:, :n_seen]
    rho, n = products[1:] / pairs[1:] * (pairs[0] / products[0]), pairs[0] / len(residuals)
    share = 2.0 * np.maximum(1.0 - np.arange(1, n_seen) / n, 0.0)
    weak = 2.0 / np.sqrt(pairs[1:])
    terms = share * [rho, (1.0 - rho) / n]
    seen, lost = np.cumsum(terms, axis=1) - terms
    # tau at every lag, by those before it: it is on both sides of the equation
    tau = 1.0 + np.maximum(seen + lost, 0.0) / np.maximum(1.0 - lost - weak, 0.5)
    ends = rho + (1.0 - rho) * np.minimum(tau / n, 0.5) < weak
    return float(tau[np.argmax(np.append(ends[:-1], True))])


def settings_of(values: Array, gap: float) -> NDArray[np.intp]:
    """Number the settings from 0 upwards; a relative gap above `gap` starts a new setting."""
    order = np.argsort(values, kind="stable")
    jump = np.diff(values[order]) > gap * np.abs(values[order][:-1])
    labels = np.empty(values.size, dtype=np.intp)
    labels[order] = np.concatenate([[0], np.cumsum(jump)])[: values.size]
    return labels


def snap_to_settings(values: np.ndarray, gap: float = 0.03) -> np.ndarray:
    """Replace each measured value by the median of its setting; nan stays nan."""
    snapped, finite = values + np.nan, np.isfinite(values)
    labels = settings_of(values[finite], gap)
    snapped[finite] = [np.median(values[finite][labels == k]) for k in labels]
    return snapped


SPIKE_WINDOW = 7
"""Window of the running median [samples]; it ignores up to three deviating samples in a row."""
NOISE_FLOOR = 2.0e-5  # deviations below this fraction of a signal always count as rounding


def running_median(x: Array, window: int) -> Array:
    """Return the median over a centred odd window, mirrored at the ends to catch spikes there."""
    from scipy.ndimage import median_filter  # slow to import

    n = x.size
    return median_filter(x, size=min(window, n - 1 + n % 2), mode="mirror") if n > 2 else x.copy()


def difference_sigma(x: Array, order: int = 1) -> float:
    """Estimate the standard deviation of white noise on a slowly changing signal by differencing.

    Differences of some order of the finite samples (n,) remove a polynomial of lower degree: their
    ``1.4826 median |differences|`` over the root of ``(2 order)! / order!²``; 0 with too few
    samples. If a coarse ADC makes most of them zero: the root mean square of the smallest 98 %.
    """
    if x.size <= order:
        return 0.0
    step = np.abs(np.diff(x, order))
    sigma = MAD_TO_SIGMA * median(step)
    if sigma == 0.0 and np.any(step > 0.0):
        central = np.sort(step)[: max(1, int(0.98 * step.size))]
        sigma = float(np.sqrt(np.mean(central**2)))
    return sigma / math.sqrt(math.comb(2 * order, order))


COARSEST = 0.1  # largest step of a converter, over the largest value that it reads


def resolution(*signals: Array) -> float:
    """Return the largest step of an A/D converter that several signals show; zero if none shows.

    A coarse converter repeats its values: no more than half of them are new. Its step is the
    smallest difference between them, at most :data:`COARSEST` of the largest. Values that are not
    finite, or exactly zero, do not count.
    """
    steps = [0.0]
    for signal in signals:
        values = np.abs(signal[np.isfinite(signal) & (signal != 0.0)])
        levels = np.unique(values)
        if 2 <= levels.size <= values.size // 2:
            step = float(np.min(np.diff(levels)))
            steps.append(step if step <= COARSEST * levels[-1] else 0.0)
    return max(steps)


def rounding_of_mean(recorded: ArrayLike, step: ArrayLike) -> Array:
    """Return the standard error of means due to readings in steps; averaging does not lower it.

    It is ``step/sqrt(12)`` without noise; noise before the rounding, by the standard deviation of
    the readings as recorded, smooths it as ``exp(-2 pi² noise²/step²)``. A step of zero is fine.
    """
    scatter, width = np.broadcast_arrays(np.asarray(recorded, float), np.asarray(step, float))
    ratio = np.divide(scatter, width, out=np.full(scatter.shape, np.inf), where=width > 0.0)
    noise2 = np.clip(ratio**2 - 1.0 / 6.0, 0.0, 100.0)
    return np.asarray(width / math.sqrt(12.0) * np.exp(-2.0 * math.pi**2 * noise2))


def spike_mask(x: Array, threshold: float) -> Mask:
    """Mark finite samples (n,) far from the running median, in deviations of the white noise.

    The limit grows with the local change of the median: a steep build-up is no spike.
    """
    if x.size < 5:
        return np.zeros(x.size, dtype=bool)
    middle = running_median(x, SPIKE_WINDOW)
    padded = np.pad(middle, SPIKE_WINDOW // 2, mode="edge")
    local_change = np.abs(padded[SPIKE_WINDOW - 1 :] - padded[: 1 - SPIKE_WINDOW])
    sigma = max(difference_sigma(x), 10.0 * NOISE_FLOOR * median(np.abs(x)))
    return np.abs(x - middle) > threshold * sigma + local_change


def block_means(x: Array, starts: NDArray[np.intp]) -> Array:
    """Average a record (n,) or (n, m) over blocks from `starts` on; nan if most is missing."""
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
    """Find the frequency [Hz] of the strongest periodic component above the noise, or None.

    It needs one and a half periods, and must exceed white noise and its neighbourhood in the
    spectrum (red noise is no line). The residuals (n, m) at t [s], in units of their noise, are
    orthogonal to the orthonormal columns already fitted (n, p).
    """
    n, duration = t.size, float(t[-1] - t[0])
    if n < 24 or duration <= 0.0:
        return None
    length = 2 * (1 << (n - 1).bit_length())
    even = [np.interp(np.linspace(t[0], t[-1], n), t, column) for column in residuals.T]
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

"""Statistics of bench signals: robust to spikes, with standard errors for correlated samples.

A recording holds many samples but few independent ones: amplifier filters, the ripple of a
turning pulley and slow drift correlate neighbouring samples. The standard error of a mean is
therefore ``s sqrt(tau / n)`` with the integrated autocorrelation time ``tau`` [samples], not
``s / sqrt(n)``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAD_TO_SIGMA = 1.482602218505602
"""Ratio of standard deviation to median absolute deviation, normal distribution."""
MEAN_DEVIATION_TO_SIGMA = 1.2533141373155003
"""Ratio of standard deviation to mean absolute deviation, normal distribution: sqrt(pi/2)."""
OUTLIER = 6.0
"""Distance from the median, in robust spreads, beyond which a sample is an outlier."""


def median(x: Array) -> float:
    """Return the median of finite samples, n >= 1; ten times faster than numpy on short arrays."""
    half = x.size // 2
    if x.size % 2:
        return float(np.partition(x, half)[half])
    low, high = np.partition(x, (half - 1, half))[half - 1 : half + 1]
    return 0.5 * float(low + high)


def mad_sigma(x: ArrayLike) -> float:
    """Estimate the standard deviation of a sample from its median absolute deviation.

    Parameters
    ----------
    x : array_like
        Samples; values that are not finite are ignored.

    Returns
    -------
    float
        Spread in the unit of `x`, nan without samples. If more than half of the samples are equal
        (a coarse ADC), the mean absolute deviation is used instead, so that the spread is
        zero only if all samples are equal.
    """
    values = np.asarray(x, dtype=float).ravel()
    values = values[np.isfinite(values)]
    if values.size == 0:
        return float("nan")
    deviation = np.abs(values - median(values))
    sigma = MAD_TO_SIGMA * median(deviation)
    return sigma if sigma > 0.0 else MEAN_DEVIATION_TO_SIGMA * float(np.mean(deviation))


def outlier_mask(x: ArrayLike, least_spread: float = 0.0) -> Mask:
    """Mark samples of a steady signal that are missing or far from its median.

    Parameters
    ----------
    x : array_like
        Samples, shape (n,).
    least_spread : float
        Lower limit of the spread that :data:`OUTLIER` multiplies, in the unit of `x`.

    Returns
    -------
    ndarray of bool
        True where a sample is not finite or an outlier, shape (n,). With fewer than three finite
        samples none is an outlier.
    """
    values = np.asarray(x, dtype=float).ravel()
    mask = ~np.isfinite(values)
    good = values[~mask]
    if good.size < 3:
        return mask
    # without this floor, rounding of the last bit could make a sample an outlier
    rounding = 8.0 * np.finfo(float).eps * float(np.max(np.abs(good)))
    limit = OUTLIER * max(mad_sigma(good), least_spread, rounding)
    mask[~mask] = np.abs(good - median(good)) > limit
    return mask


def integrated_autocorrelation_time(*runs: ArrayLike) -> float:
    """Estimate the autocorrelation time ``tau = 1 + 2 sum_k (1 - k/n) rho_k``, pooled over runs.

    Subtracting the mean of a run of n samples lowers all correlations by ``tau/n``; this is
    corrected. From the first lag at which the correlation is within two standard errors of zero,
    it is assumed to decay exponentially at the same rate as before.

    Parameters
    ----------
    *runs : array_like
        Evenly spaced samples of one or several runs in time order, shape (n,) each. Values that
        are not finite are gaps: pairs with a gap are ignored, and all other lags stay correct.

    Returns
    -------
    float
        tau in samples, at least 1 (independent); negative correlation does not lower it.
    """
    residuals = [r for r in (_less_mean(run) for run in runs) if np.nansum(r * r) > 0.0]
    longest = max((r.size for r in residuals), default=0)
    products, pairs = np.zeros(longest), np.zeros(longest)
    for r in residuals:
        valid = np.isfinite(r)
        length = 1 << (2 * r.size).bit_length()  # sums of products at every lag, by FFT
        spectra = np.abs(np.fft.rfft([np.where(valid, r, 0.0), valid.astype(float)], length)) ** 2
        lagged = np.fft.irfft(spectra, length)[:, : r.size]
        products[: r.size] += lagged[0]
        pairs[: r.size] += np.round(lagged[1])
    gap = np.flatnonzero(pairs < 0.5)
    rho = products[: gap[0] if gap.size else longest]
    pairs = pairs[: rho.size]
    if rho.size < 2:
        return 1.0
    rho = rho / pairs * (pairs[0] / products[0])
    n = pairs[0] / len(residuals)
    tau = before = 1.0
    for _ in range(20):
        corrected = rho + (1.0 - rho) * min(tau / n, 0.5)
        weak = np.flatnonzero(corrected < 2.0 / np.sqrt(pairs))
        end = max(int(weak[0]), 1) if weak.size else rho.size
        share = np.maximum(1.0 - np.arange(1, rho.size) / n, 0.0)
        tau, before = 1.0 + 2.0 * float(share[: end - 1] @ corrected[1:end]), tau
        if 1 < end < rho.size:
            fading = np.exp(-2.0 * np.arange(1, rho.size - end + 1) / (tau - 1.0))
            tau += 4.0 / np.sqrt(pairs[end - 1]) * float(share[end - 1 :] @ fading)
        if abs(tau - before) < 1e-6:
            break
    return max(tau, 1.0)


def _less_mean(run: ArrayLike) -> Array:
    """Subtract the mean; return a single zero if only rounding is left."""
    values = np.asarray(run, dtype=float).ravel()
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return finite
    residual = np.where(np.isfinite(values), values - np.mean(finite), np.nan)
    largest = float(np.nanmax(np.abs(residual)))
    rounding = 8.0 * np.finfo(float).eps * float(np.max(np.abs(finite)))
    return residual if largest > rounding else np.zeros(1)


def settings_of(values: Array, gap: float) -> NDArray[np.intp]:
    """Number the settings from 0 upwards; a relative gap above `gap` starts a new setting."""
    order = np.argsort(values, kind="stable")
    jump = np.diff(values[order]) > gap * np.abs(values[order][:-1])
    labels = np.empty(values.size, dtype=np.intp)
    labels[order] = np.concatenate([[0], np.cumsum(jump)])[: values.size]
    return labels


def snap_to_settings(values: np.ndarray, gap: float = 0.03) -> np.ndarray:
    """Replace each measured value by the median of its setting; nan stays nan."""
    settings, finite = np.full(values.shape, np.nan), np.isfinite(values)
    known = values[finite]
    labels = settings_of(known, gap)
    medians = [np.median(known[labels == k]) for k in np.unique(labels)]
    settings[finite] = np.array(medians)[labels]
    return settings

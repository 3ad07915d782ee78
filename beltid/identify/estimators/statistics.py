"""Means of bench signals: robust against spikes, honest about correlated samples.

A recording holds many samples but few independent ones: filters of the amplifier, the ripple of a
turning pulley and slow drifts correlate neighbours. The standard error of a mean is therefore
``s sqrt(tau / n)`` with the integrated autocorrelation time ``tau`` [samples], not ``s / sqrt(n)``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAD_TO_SIGMA = 1.482602218505602
"""Standard deviation of a normal sample over its median absolute deviation."""
MEAN_DEVIATION_TO_SIGMA = 1.2533141373155003
"""Standard deviation of a normal sample over its mean absolute deviation, sqrt(pi/2)."""
SOKAL_WINDOW = 5.0
"""The autocorrelation is summed up to this many times its own integral (Sokal's rule)."""


class MeanWithError(NamedTuple):
    """A mean, its standard error and what it rests on; unpacks as ``mean, se, n_eff``."""

    mean: float
    """Mean of the samples that are no outliers, in their unit; nan without samples."""
    se: float
    """Standard error of the mean with correlation allowed for; nan below two samples."""
    n_eff: float
    """Number of independent samples with the same standard error."""


def mad_sigma(x: ArrayLike) -> float:
    """Spread of a sample from its median absolute deviation, scaled to a standard deviation.

    Parameters
    ----------
    x : array_like
        Samples; those that are not finite are left out.

    Returns
    -------
    float
        Spread in the unit of `x`, nan without samples. If more than half of the samples are equal
        (a coarse converter) the mean absolute deviation takes its place, so that the spread is
        zero only if all samples are equal.
    """
    values = np.asarray(x, dtype=float).ravel()
    values = values[np.isfinite(values)]
    if values.size == 0:
        return float("nan")
    deviation = np.abs(values - np.median(values))
    sigma = MAD_TO_SIGMA * float(np.median(deviation))
    return sigma if sigma > 0.0 else MEAN_DEVIATION_TO_SIGMA * float(np.mean(deviation))


def outlier_mask(x: ArrayLike, threshold: float = 6.0, window: int | None = None) -> Mask:
    """Mark samples that are missing or lie off the others.

    Parameters
    ----------
    x : array_like
        Samples in their order of time, shape (n,).
    threshold : float
        Distance from the median above which a sample is an outlier, in robust spreads.
    window : int, optional
        Odd number of samples of a local reference (see :func:`local_reference`): with it a spike
        is found on a signal that changes, too. Without it the median of all samples is the
        reference, which suits a steady signal.

    Returns
    -------
    ndarray of bool
        True where a sample is not finite or an outlier, shape (n,).
    """
    values = np.asarray(x, dtype=float).ravel()
    mask = ~np.isfinite(values)
    good = values[~mask]
    if good.size < 3:
        return mask
    if window is None:
        distance = good - np.median(good)
    else:
        distance = good - local_reference(good, window // 2)
    sigma = mad_sigma(distance)
    # a spread below the rounding of the samples themselves would make every last bit an outlier
    floor = 8.0 * np.finfo(float).eps * float(np.max(np.abs(good)))
    mask[~mask] = np.abs(distance) > threshold * max(sigma, floor)
    return mask


def local_reference(x: Array, half_width: int) -> Array:
    """Value that the neighbours of each sample suggest for it, blind to single spikes.

    The median of the means of the pairs at equal distance, ``(x[i-k] + x[i+k])/2``. Unlike a
    running median it is exact on a ramp, so that what is left is noise and not slope. Near the
    ends, where a partner is missing, ``2 x[i+k] - x[i+2k]`` takes the place of a pair.

    Parameters
    ----------
    x : ndarray
        Samples without gaps, shape (n,).
    half_width : int
        Number of pairs, >= 1; reduced for short signals.

    Returns
    -------
    ndarray
        Reference, shape (n,); the signal's median if it has fewer than five samples.
    """
    n = x.size
    w = min(max(half_width, 1), (n - 1) // 4)
    if w < 1:
        return np.full(n, np.median(x))
    steps = np.arange(1, w + 1)[:, None]
    inner = np.arange(w, n - w)
    reference = np.empty(n)
    reference[inner] = np.median(0.5 * (x[inner - steps] + x[inner + steps]), axis=0)
    edge = np.arange(w)
    for view, target in ((x, reference), (x[::-1], reference[::-1])):
        target[edge] = np.median(2.0 * view[edge + steps] - view[edge + 2 * steps], axis=0)
    return reference


def spike_mask(x: ArrayLike, threshold: float = 12.0, floor: float = 0.0) -> Mask:
    """Mark missing samples and single spikes of a signal that ramps, turns and has kinks.

    A spike disagrees with everything around it: with the line through its neighbours and with the
    continuations from either side. A sample at a reversal or at the moment of contact agrees with
    at least one of them.

    Parameters
    ----------
    x : array_like
        Samples in their order of time, shape (n,).
    threshold : float
        Smallest disagreement of a spike, in robust spreads of all disagreements.
    floor : float
        Smallest disagreement of a spike, in the unit of `x`.

    Returns
    -------
    ndarray of bool
        True where a sample is not finite or a spike, shape (n,).
    """
    values = np.asarray(x, dtype=float).ravel()
    mask = ~np.isfinite(values)
    good = values[~mask]
    if good.size < 9:
        return mask
    steps = np.arange(1, 4)[:, None]
    inner = np.arange(6, good.size - 6)
    disagreement = np.abs(good - local_reference(good, 3))
    if inner.size:
        before = np.median(2.0 * good[inner - steps] - good[inner - 2 * steps], axis=0)
        after = np.median(2.0 * good[inner + steps] - good[inner + 2 * steps], axis=0)
        either = np.minimum(np.abs(good[inner] - before), np.abs(good[inner] - after))
        disagreement[inner] = np.minimum(disagreement[inner], either)
    mask[~mask] = disagreement > max(
        threshold * MAD_TO_SIGMA * float(np.median(disagreement)), floor
    )
    return mask


def sample_noise(x: ArrayLike) -> float:
    """Standard deviation of the white noise on a signal that changes slowly from sample to sample.

    Parameters
    ----------
    x : array_like
        Samples in their order of time, shape (n,); those that are not finite are left out.

    Returns
    -------
    float
        Noise in the unit of `x`, from second differences, whose spread is sqrt(6) times the noise;
        0 with fewer than five samples.
    """
    values = np.asarray(x, dtype=float).ravel()
    values = values[np.isfinite(values)]
    if values.size < 5:
        return 0.0
    second = np.diff(values, 2)
    return MAD_TO_SIGMA * float(np.median(np.abs(second))) / np.sqrt(6.0)


def integrated_autocorrelation_time(x: ArrayLike) -> float:
    """Integrated autocorrelation time ``tau = 1 + 2 sum_k rho_k`` of a sampled signal.

    The sum ends at the first lag beyond ``SOKAL_WINDOW * tau`` (Sokal 1997); the bias from taking
    off the sample mean is corrected to first order in ``1/n`` (Wolff 2004).

    Parameters
    ----------
    x : array_like
        Evenly spaced samples in their order of time, shape (n,); those that are not finite are
        gaps: their pairs are left out, the lags of the others stay right.

    Returns
    -------
    float
        tau in samples, between 1 (independent) and the number of samples. Anticorrelation, which
        would give less than 1, is not made use of.
    """
    values = np.asarray(x, dtype=float).ravel()
    valid = np.isfinite(values)
    n = int(np.count_nonzero(valid))
    if n < 4:
        return 1.0
    residual = np.where(valid, values - np.mean(values[valid]), 0.0)
    scale = float(np.max(np.abs(residual)))
    if scale <= 8.0 * np.finfo(float).eps * float(np.max(np.abs(values[valid]))):
        return 1.0  # equal samples: what is left is rounding
    covariance, pairs = _lagged_sums(residual / scale, valid)
    rho = np.divide(covariance, pairs, out=np.zeros_like(covariance), where=pairs > 0.5)
    rho /= rho[0]
    lags = np.arange(rho.size)
    tau = 2.0 * np.cumsum(rho) - 1.0
    closed = np.flatnonzero(lags >= SOKAL_WINDOW * np.maximum(tau, 1.0))
    last = int(closed[0]) if closed.size else int(np.argmax(tau[: max(values.size // 2, 1)]))
    corrected = float(tau[last]) * (1.0 + (2.0 * last + 1.0) / n)
    return float(np.clip(corrected, 1.0, n))


def _lagged_sums(residual: Array, valid: Mask) -> tuple[Array, Array]:
    """Sums of products and numbers of pairs for every lag, by FFT, shape (n,) each."""
    n = residual.size
    length = 1 << (2 * n - 1).bit_length()
    spectrum = np.fft.rfft(residual, length)
    products = np.fft.irfft(spectrum.real**2 + spectrum.imag**2, length)[:n]
    if valid.all():
        return products, np.arange(n, 0.0, -1.0)
    presence = np.fft.rfft(valid.astype(float), length)
    pairs = np.fft.irfft(np.abs(presence) ** 2, length)[:n]
    return products, pairs


def robust_mean_with_se(x: ArrayLike, threshold: float = 6.0) -> MeanWithError:
    """Mean of a steady signal without its spikes, with a standard error for correlated samples.

    Parameters
    ----------
    x : array_like
        Evenly spaced samples of a steady signal in their order of time, shape (n,); samples that
        are not finite and outliers (see :func:`outlier_mask`) are left out.
    threshold : float
        Limit for outliers in robust spreads.

    Returns
    -------
    MeanWithError
        ``(mean, se, n_eff)``: the mean of the kept samples, ``se = s / sqrt(n_eff)`` with
        ``s² = sum (x - mean)² / (n - tau)``, and ``n_eff = n / tau``. All nan (n_eff 0) without
        samples; the error alone is nan where fewer than two independent samples are left.
        Below a hundred samples the error tends to be on the safe side, as tau is never below 1.
    """
    values = np.asarray(x, dtype=float).ravel()
    kept = np.where(outlier_mask(values, threshold), np.nan, values)
    n = int(np.count_nonzero(np.isfinite(kept)))
    if n == 0:
        return MeanWithError(float("nan"), float("nan"), 0.0)
    mean = float(np.nanmean(kept))
    tau = integrated_autocorrelation_time(kept)
    n_eff = n / tau
    if n_eff <= 1.0:
        return MeanWithError(mean, float("nan"), n_eff)
    variance = float(np.nansum((kept - mean) ** 2)) / (n - tau)
    return MeanWithError(mean, float(np.sqrt(variance / n_eff)), n_eff)


def as_set(values: np.ndarray, gap: float = 0.03) -> np.ndarray:
    """Settings that measured values belong to: within a share `gap` they are one, their median."""
    found = np.full(values.shape, np.nan)
    known = np.flatnonzero(np.isfinite(values))
    ordered = known[np.argsort(values[known], kind="stable")]
    if ordered.size:
        steps = np.flatnonzero(np.diff(values[ordered]) > gap * np.abs(values[ordered][:-1]))
        for group in np.split(ordered, steps + 1):
            found[group] = np.median(values[group])
    return found

"""Means of short runs whose noise is pooled: all runs of a series have the same sensors.

A run that scatters far beyond its series (it shakes) keeps its own variance and correlation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, chdtri, ndtr, stdtrit

from beltid.identify.estimators.statistics import (
    MeanWithError,
    integrated_autocorrelation_time,
    mad_sigma,
)

Array = NDArray[np.float64]

OUTLIER = 6.0
"""Distance of a spike from the median, in the larger of the run's and the series' spread."""
SHAKES = 1.0e-4  # probability of a scatter that is no longer that of the series
FEWEST_RUNS = 3  # a series of fewer runs is pooled with all others
SERIES_WIDTH = 0.02  # runs whose speeds agree to this share are one series


def speed_series(speed_rad_s: Mapping[str, float]) -> tuple[tuple[str, ...], ...]:
    """Runs at the same speed [rad/s]; all runs as one series where some speed has too few."""
    series: list[list[str]] = []
    first = np.nan
    for label in sorted(speed_rad_s, key=lambda r: (np.isnan(speed_rad_s[r]), abs(speed_rad_s[r]))):
        speed = abs(speed_rad_s[label])
        if not speed <= (1.0 + SERIES_WIDTH) * first:
            series.append([])
            first = speed
        series[-1].append(label)
    if min((len(s) for s in series), default=0) < FEWEST_RUNS:
        return (tuple(speed_rad_s),)
    return tuple(tuple(s) for s in series)


def pooled_means(
    samples: Mapping[str, Array], series: Sequence[Sequence[str]]
) -> dict[str, MeanWithError]:
    """Mean of every run without its spikes, its standard error from the pooled noise.

    Parameters
    ----------
    samples : mapping of str to ndarray
        Evenly spaced samples of a steady signal for each run, nan where missing, shape (n,).
    series : sequence of sequence of str
        Runs whose noise is alike.

    Returns
    -------
    dict of str to MeanWithError
        The standard error is ``t sqrt(s² tau / n)`` with the pooled variance s² and correlation
        time tau [samples]; t widens it to a probability of 68 % for the degrees of freedom of s²
        (Student). nan where nothing determines the noise.
    """
    found: dict[str, MeanWithError] = {}
    for labels in series:
        means = _means_of_series([np.asarray(samples[label], dtype=float) for label in labels])
        found |= zip(labels, means, strict=True)
    return found


def _means_of_series(recorded: Sequence[Array]) -> list[MeanWithError]:
    runs = _without_spikes(recorded)
    n = np.array([np.count_nonzero(np.isfinite(r)) for r in runs], dtype=float)
    mean = [float(np.nanmean(r)) if k else np.nan for r, k in zip(runs, n, strict=True)]
    rest = [r - m for r, m in zip(runs, mean, strict=True)]
    squares = np.array([np.nansum(r * r) for r in rest])
    # a run that shakes must not settle the correlation of all: each has the same weight at first
    alike = [r / max(float(np.sqrt(s)), 1e-300) for r, s in zip(rest, squares, strict=True)]
    tau = np.minimum(pooled_correlation_time(alike), np.maximum(n, 1.0))
    told = (n / tau > 1.0) & (squares > 0.0)
    shakes = np.zeros(n.size, dtype=bool)
    if np.count_nonzero(told) >= FEWEST_RUNS:
        # chi² over the median of the runs, which is blind to those that shake
        freedom = n[told] / tau[told] - 1.0
        typical = np.median(squares[told] / chdtri(freedom, 0.5))
        shakes[told] = chdtrc(freedom, squares[told] / typical) < SHAKES
    calm = [r for r, k in zip(rest, shakes, strict=True) if not k]
    tau = np.minimum(pooled_correlation_time(calm), np.maximum(n, 1.0))
    tau[shakes] = [integrated_autocorrelation_time(rest[k]) for k in np.flatnonzero(shakes)]
    freedom = np.maximum(n / tau - 1.0, 0.0)  # independent samples less the mean of the run
    variance = np.divide(squares, tau * freedom, out=np.zeros(n.size), where=freedom > 0.0)
    pool = float(freedom[~shakes].sum())
    if pool > 0.0:
        variance[~shakes] = freedom[~shakes] @ variance[~shakes] / pool
        freedom[~shakes] = pool
    known = (freedom > 0.0) & (n > 0.0)
    se = np.full(n.size, np.nan)
    student = stdtrit(np.maximum(freedom[known], 1.0), float(ndtr(1.0)))
    se[known] = student * np.sqrt(variance[known] * tau[known] / n[known])
    return [MeanWithError(*map(float, row)) for row in zip(mean, se, n / tau, strict=True)]


def _without_spikes(runs: Sequence[Array]) -> list[Array]:
    """Runs with nan in place of spikes."""
    steps = np.concatenate([np.diff(r[np.isfinite(r)]) for r in runs])
    common = mad_sigma(np.concatenate([steps, -steps])) / np.sqrt(2.0) if steps.size else 0.0
    kept = []
    for run in runs:
        good = run[np.isfinite(run)]
        if good.size >= 3:
            rounding = 8.0 * np.finfo(float).eps * float(np.max(np.abs(good)))
            limit = OUTLIER * max(mad_sigma(good), common, rounding)
            run = np.where(np.abs(run - np.median(good)) > limit, np.nan, run)
        kept.append(run)
    return kept


def pooled_correlation_time(residuals: Sequence[Array]) -> float:
    """Autocorrelation time ``1 + 2 sum (1 - k/n) rho_k`` of several short runs together, >= 1.

    Parameters
    ----------
    residuals : sequence of ndarray
        Samples less the mean of their run, nan where missing; the mean lowers all correlations by
        ``tau/n``, which is corrected. They are summed up to the first that is not significant.
    """
    used = [r for r in residuals if np.nansum(r * r) > 0.0]
    longest = max((r.size for r in used), default=0)
    products, pairs = np.zeros(longest), np.zeros(longest)
    for r in used:
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
    n = pairs[0] / len(used)
    tau = 1.0
    for _ in range(20):
        corrected = rho + (1.0 - rho) * min(tau / n, 0.5)
        weak = np.flatnonzero(corrected < 2.0 / np.sqrt(pairs))
        end = int(weak[0]) if weak.size else rho.size
        share = np.maximum(1.0 - np.arange(1, end) / n, 0.0)
        tau = 1.0 + 2.0 * float(share @ corrected[1:end])
    return max(tau, 1.0)

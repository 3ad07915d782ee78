"""Means of short runs whose noise is pooled over the runs of a series.

The scatter of three samples says little about their noise: by chance it is often far too small,
and so would be the standard error. The sensors are the same in all runs of a series, so their
noise is, too. The variance of each run is drawn towards that of its series by as much as the runs
agree (empirical Bayes, Smyth 2004)

    s̃² = (d0 s0² + d s²) / (d0 + d),

with the run's own variance s² of d degrees of freedom and the series' s0² of d0. d0 follows from
the scatter of ln s² over the runs beyond what chance gives them; a run that shakes keeps its own
variance the more the longer it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, polygamma, psi, stdtrit

from beltid.identify.estimators.statistics import (
    MAD_TO_SIGMA,
    MeanWithError,
    integrated_autocorrelation_time,
    mad_sigma,
)

Array = NDArray[np.float64]

OUTLIER = 6.0
"""Distance of a spike from the median, in the larger of the run's and the series' spread."""
OWN_CORRELATION = 50
"""Samples from which a run tells the correlation of its own samples."""
FEWEST_RUNS = 3
"""A series of fewer runs is pooled with all others."""
SERIES_WIDTH = 0.02
"""Runs whose speeds agree to this share are one series."""
MAX_PRIOR = 1.0e6
ONE_SIGMA = float(ndtr(1.0))


def speed_series(speed_rad_s: Mapping[str, float]) -> tuple[tuple[str, ...], ...]:
    """Runs at the same speed; all runs as one series where some speed has too few of them.

    Parameters
    ----------
    speed_rad_s : mapping of str to float
        Mean speed of each run [rad/s], nan if unknown.
    """
    series: list[list[str]] = []
    first = float("nan")
    for label in sorted(speed_rad_s, key=lambda r: (np.isnan(speed_rad_s[r]), abs(speed_rad_s[r]))):
        speed = abs(speed_rad_s[label])
        if not series or speed > (1.0 + SERIES_WIDTH) * first or np.isnan(speed - first):
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
        The standard error is ``t sqrt(s̃² tau / n)``; t widens it to a probability of 68 % for the
        degrees of freedom of s̃² (Student). nan where nothing tells the noise.
    """
    found: dict[str, MeanWithError] = {}
    for labels in series:
        kept = _without_spikes([np.asarray(samples[label], dtype=float) for label in labels])
        found |= zip(labels, _means(kept), strict=True)
    return found


def _without_spikes(runs: Sequence[Array]) -> list[Array]:
    """Runs with nan in place of spikes."""
    steps = np.concatenate([np.diff(r[np.isfinite(r)]) for r in runs])
    common = MAD_TO_SIGMA * float(np.median(np.abs(steps))) / np.sqrt(2.0) if steps.size else 0.0
    kept = []
    for run in runs:
        known = run[np.isfinite(run)]
        if known.size < 3:
            kept.append(run)
            continue
        off = np.abs(run - np.median(known))
        rounding = 8.0 * np.finfo(float).eps * float(np.max(np.abs(known)))
        kept.append(np.where(off > OUTLIER * max(mad_sigma(known), common, rounding), np.nan, run))
    return kept


def _means(runs: Sequence[Array]) -> list[MeanWithError]:
    n = np.array([np.count_nonzero(np.isfinite(r)) for r in runs], dtype=float)
    mean = np.array([np.nanmean(r) if k else np.nan for r, k in zip(runs, n, strict=True)])
    rest = [r - m for r, m in zip(runs, mean, strict=True)]
    common = pooled_correlation_time(rest)
    tau = np.array(
        [
            integrated_autocorrelation_time(r) if k >= OWN_CORRELATION else min(common, max(k, 1.0))
            for r, k in zip(runs, n, strict=True)
        ]
    )
    dof = np.maximum(n / tau - 1.0, 0.0)
    square = np.array([float(np.nansum(r * r)) for r in rest])
    own = np.divide(square, n - tau, out=np.zeros_like(square), where=dof > 0.0)
    prior, prior_dof = pooled_variance(own, dof)
    total = prior_dof + dof
    se = np.full(n.size, np.nan)
    known = (total > 0.0) & (n > 0.0)
    variance = (prior_dof * prior + dof[known] * own[known]) / total[known]
    widened = stdtrit(np.maximum(total[known], 1.0), ONE_SIGMA)
    se[known] = widened * np.sqrt(variance * tau[known] / n[known])
    return [MeanWithError(*map(float, row)) for row in zip(mean, se, n / tau, strict=True)]


def pooled_correlation_time(residuals: Sequence[Array]) -> float:
    """Autocorrelation time ``1 + 2 sum (1 - k/n) rho_k`` of several short runs together, >= 1.

    Parameters
    ----------
    residuals : sequence of ndarray
        Samples less the mean of their run, nan where missing. That the mean is taken off each run
        lowers all correlations by ``tau/n``, which is corrected. Correlations are summed up to the
        first that is not significant.
    """
    longest = max((r.size for r in residuals), default=0)
    products, pairs = np.zeros(longest), np.zeros(longest)
    for r in residuals:
        valid = np.isfinite(r)
        filled = np.where(valid, r, 0.0)
        products[: r.size] += _lagged(filled)
        pairs[: r.size] += np.round(_lagged(valid.astype(float)))
    used = int(np.argmin(pairs > 0.5)) if np.any(pairs < 0.5) else longest
    if used < 2 or products[0] <= 0.0:
        return 1.0
    c = products[:used] / pairs[:used] * (pairs[0] / products[0])
    n = pairs[0] / len([r for r in residuals if np.isfinite(r).any()])
    tau = 1.0
    for _ in range(20):
        share = min(tau / n, 0.5)
        rho = c * (1.0 - share) + share
        weak = np.flatnonzero(rho < 2.0 / np.sqrt(pairs[:used]))
        end = int(weak[0]) if weak.size else used
        weights = np.maximum(1.0 - np.arange(1, end) / n, 0.0)
        tau = 1.0 + 2.0 * float(weights @ rho[1:end])
    return max(tau, 1.0)


def _lagged(x: Array) -> Array:
    """Sums of products at every lag, by FFT, shape (n,)."""
    length = 1 << (2 * x.size).bit_length()
    return np.fft.irfft(np.abs(np.fft.rfft(x, length)) ** 2, length)[: x.size]


def pooled_variance(variance: Array, dof: Array) -> tuple[float, float]:
    """Variance that runs share and the degrees of freedom that it counts for (Smyth 2004).

    Parameters
    ----------
    variance, dof : ndarray
        Variance of each run and its degrees of freedom, shape (runs,).

    Returns
    -------
    tuple of float
        (0, 0) with fewer than two runs that tell a variance. The degrees of freedom are at most
        all those of the runs.
    """
    used = (dof > 0.0) & (variance > 0.0)
    if np.count_nonzero(used) < 2:
        return 0.0, 0.0
    half = 0.5 * dof[used]
    level = np.log(variance[used]) - psi(half) + np.log(half)
    excess = float(np.var(level, ddof=1) - np.mean(polygamma(1, half)))
    half_prior = _inverse_trigamma(excess) if excess > 0.0 else MAX_PRIOR
    prior = np.exp(float(np.mean(level)) + float(psi(half_prior)) - np.log(half_prior))
    return float(prior), float(min(2.0 * half_prior, np.sum(dof[used])))


def _inverse_trigamma(x: float) -> float:
    """Positive y with trigamma(y) = x, by Newton's method on its reciprocal."""
    if x < 1.0 / MAX_PRIOR:
        return MAX_PRIOR
    y = 0.5 + 1.0 / x
    for _ in range(50):
        value = float(polygamma(1, y))
        step = value * (1.0 - value / x) / float(polygamma(2, y))
        y += step
        if abs(step) < 1e-10 * y:
            break
    return y

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
    outlier_mask,
    settings_of,
)

Array = NDArray[np.float64]

SHAKES = 1.0e-4  # probability of a scatter that is no longer that of the series
FEWEST_RUNS = 3  # a series of fewer runs is pooled with all others
SERIES_WIDTH = 0.02  # runs whose speeds agree to this share are one series


def speed_series(speed_rad_s: Mapping[str, float]) -> tuple[tuple[str, ...], ...]:
    """Runs at the same speed [rad/s]; all runs as one series where some speed has too few."""
    runs = np.array(list(speed_rad_s), dtype=object)
    speeds = np.abs(np.array(list(speed_rad_s.values()), dtype=float))
    labels = settings_of(speeds, SERIES_WIDTH)
    if not np.isfinite(speeds).all() or np.bincount(labels, minlength=1).min() < FEWEST_RUNS:
        return (tuple(runs),)
    return tuple(tuple(runs[labels == k]) for k in np.unique(labels))


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
    squares = np.array([np.nansum((r - m) ** 2) for r, m in zip(runs, mean, strict=True)])
    # a run that shakes must not settle the correlation of all: each has the same weight at first
    alike = [r / max(float(np.sqrt(s)), 1e-300) for r, s in zip(runs, squares, strict=True)]
    tau = np.minimum(integrated_autocorrelation_time(*alike), np.maximum(n, 1.0))
    known = (n / tau > 1.0) & (squares > 0.0)
    shakes = np.zeros(n.size, dtype=bool)
    if np.count_nonzero(known) >= FEWEST_RUNS:
        # chi² over the median of the runs, which is blind to those that shake
        freedom = n[known] / tau[known] - 1.0
        typical = np.median(squares[known] / chdtri(freedom, 0.5))
        shakes[known] = chdtrc(freedom, squares[known] / typical) < SHAKES
    for same in (np.flatnonzero(~shakes), *np.flatnonzero(shakes)[:, None]):
        of_noise = integrated_autocorrelation_time(*(runs[k] for k in same))
        tau[same] = np.minimum(of_noise, np.maximum(n[same], 1.0))
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
    """Runs with nan in place of spikes, which exceed the noise of their run and of all runs."""
    steps = np.concatenate([np.diff(r[np.isfinite(r)]) for r in runs])
    common = mad_sigma(np.concatenate([steps, -steps])) / np.sqrt(2.0) if steps.size else 0.0
    return [np.where(outlier_mask(r, common), np.nan, r) for r in runs]

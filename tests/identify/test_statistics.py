"""Robust statistics: sums written out by hand, and processes of known correlation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from beltid.identify.estimators import (
    integrated_autocorrelation_time,
    mad_sigma,
    outlier_mask,
    settings_of,
    snap_to_settings,
)

NORMAL_QUARTILE = 0.6744897501960817  # of a standard normal variable: half of them lie within it
STEADY = np.tile([-1.0, 0.0, 1.0], 20)  # median 0, median deviation 1


def autoregressive(rng: np.random.Generator, n: int, a: float) -> np.ndarray:
    """x[k] = a x[k-1] + e[k], stationary, unit variance: tau = (1 + a)/(1 - a) in closed form."""
    return lfilter([np.sqrt(1 - a * a)], [1.0, -a], rng.normal(size=n + 400))[400:]


@pytest.mark.parametrize(
    ("a", "n", "runs"),
    [(0.0, 4, 60), (0.6, 20, 60), (0.6, 50, 60), (0.9, 100, 2), (0.9, 100, 5), (0.9, 300, 5)],
)
def test_the_correlation_of_short_runs_is_seen_together(a, n, runs):
    """The variance of the mean of n samples: 1 + 2 sum (1 - k/n) a^k times that of one, over n."""
    rng, lags = np.random.default_rng(11), np.arange(1, n)
    found = [
        integrated_autocorrelation_time(*(autoregressive(rng, n, a) for _ in range(runs)))
        for _ in range(400 // runs)
    ]
    expected = 1.0 + 2.0 * np.sum((1.0 - lags / n) * a**lags)
    assert np.mean(found) == pytest.approx(expected, rel=0.1)


def test_gaps_keep_the_lags_of_the_other_samples():
    rng = np.random.default_rng(5)
    x = autoregressive(rng, 40000, 0.8)
    x[rng.random(x.size) < 0.3] = np.nan
    assert integrated_autocorrelation_time(x) == pytest.approx(9.0, rel=0.15)


def test_samples_that_say_nothing_about_their_correlation_are_independent():
    gap = np.array([1.0, np.nan, -1.0, np.nan, 1.0])
    for nothing in ([], [[]], [np.zeros(5)], [gap], [[0.3], [-0.3]], [np.full(3, np.nan)]):
        assert integrated_autocorrelation_time(*nothing) == 1.0
    later, eps = np.arange(50) >= 25, np.finfo(float).eps
    for size in (2.0**-20, 1.0, 2.0**20):
        equal, different = size * (1.0 + 12 * eps * later), size * (1.0 + 40 * eps * later)
        assert integrated_autocorrelation_time(equal) == 1.0  # six units of rounding to each side
        assert integrated_autocorrelation_time(different) > 5.0
    assert integrated_autocorrelation_time((-1.0) ** np.arange(50)) == 1.0


def test_spread_of_a_few_samples():
    sigma = 1.0 / NORMAL_QUARTILE
    assert mad_sigma([1.0, 2.0, 3.0, 4.0, 100.0, np.nan]) == pytest.approx(sigma, rel=1e-12)
    # of a coarse converter: the mean deviation takes the place of a median of zero
    by_mean = 0.25 * math.sqrt(math.pi / 2)
    assert mad_sigma([5.0, 5.0, 5.0, 6.0]) == pytest.approx(by_mean, rel=1e-12)
    assert math.isnan(mad_sigma([np.inf]))
    assert mad_sigma([2.0, 2.0]) == 0.0


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_outlier_lies_six_spreads_off(sign):
    limit = 6.0 / NORMAL_QUARTILE
    for share, marked in ((0.999, False), (1.001, True)):
        assert outlier_mask(np.append(STEADY, sign * share * limit)).any() == marked
        far = np.append(STEADY, sign * share * 6.0 * 10.0)
        assert outlier_mask(far, least_spread=10.0).any() == marked
    assert outlier_mask([0.0, 9e9, 1.0]).tolist() == [False, True, False]
    assert not outlier_mask([0.0, 9e9, np.nan])[:2].any()


@pytest.mark.parametrize("size", [2.0**-20, 1.0, 2.0**20])
def test_the_last_bit_of_equal_samples_is_no_outlier(size):
    x = np.full(100, size)
    x[[3, 50]] += np.array([1, -4]) * size * np.finfo(float).eps
    assert not outlier_mask(x).any()
    x[7] += 1e-13 * size  # some hundred times the rounding
    assert outlier_mask(x).nonzero()[0].tolist() == [7]


def test_settings_are_distinguished_by_their_relative_gap():
    speeds = np.array([0.0211, 0.005, 0.0105, 0.0209, 0.00502, 0.021])
    assert settings_of(speeds, 0.03).tolist() == [2, 0, 1, 2, 0, 2]
    assert settings_of(np.array([]), 0.03).size == 0
    values = np.array([100.0, 205.0, np.nan, 102.9, 200.0, -1.0])
    expected = [101.45, 202.5, np.nan, 101.45, 202.5, -1.0]
    assert snap_to_settings(values) == pytest.approx(expected, nan_ok=True)
    assert snap_to_settings(np.array([100.0, 103.1])) == pytest.approx([100.0, 103.1])
    assert snap_to_settings(np.array([100.0, 103.1]), gap=0.04) == pytest.approx([101.55, 101.55])
    assert np.isnan(snap_to_settings(np.array([np.nan]))).all()

"""Statistics of bench signals against sums by hand, and both sides of every limit."""

import math

import numpy as np
import pytest
from virtual_rig import with_memory

from beltid.identify.estimators import (
    difference_sigma,
    integrated_autocorrelation_time,
    mad_sigma,
    outlier_mask,
    resolution,
    rounding_of_mean,
    settings_of,
    snap_to_settings,
    strongest_line,
)

NORMAL_QUARTILE = 0.6744897501960817  # of a standard normal variable: half of them lie within it
STEADY = np.tile([-1.0, 0.0, 1.0], 20)  # median 0, median deviation 1


def autoregressive(rng: np.random.Generator, n: int, a: float) -> np.ndarray:
    """x[k] = a x[k-1] + e[k], stationary, unit variance: tau = (1 + a)/(1 - a) in closed form."""
    return with_memory(np.sqrt(1 - a * a) * rng.normal(size=n + 400), a)[400:]


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
    assert np.isnan(snap_to_settings(np.array([np.nan]))).all()


def test_noise_of_alternating_and_of_coarse_samples():
    x = 0.3 * (-1.0) ** np.arange(21)
    for samples, step in ((x, 0.6), (np.array([1.0, 3.0]), 2.0), (np.array([1.0]), 0.0)):
        expected = step / NORMAL_QUARTILE / math.sqrt(2.0)
        assert difference_sigma(samples) == pytest.approx(expected, rel=1e-12)
    # second differences of 1.2, a ramp does not matter
    ramp = x + 5.0 * np.arange(21.0)
    expected = 1.2 / NORMAL_QUARTILE / math.sqrt(6.0)
    assert difference_sigma(ramp, order=2) == pytest.approx(expected, rel=1e-12)
    assert difference_sigma(ramp[:2], order=2) == 0.0
    # a hundred steps, seven of 1, five of 3, the others none: the largest two are left out
    steps = np.zeros(100)
    steps[2::8], steps[[5, 21, 37, 53, 69]] = 0.0, 3.0
    steps[[7, 23, 39, 55, 71, 87, 95]] = 1.0
    expected = math.sqrt((7 * 1.0 + 3 * 9.0) / 97) / math.sqrt(2.0)
    assert difference_sigma(np.cumsum(steps)) == pytest.approx(expected, rel=1e-12)


STAIRS = np.repeat(np.arange(20.0), 5)


@pytest.mark.parametrize(
    ("signals", "step"),
    [
        ([250.1 + 0.25 * STAIRS, 100.0 + 0.5 * STAIRS], 0.5),  # that of the coarser one
        ([250.1 + 0.25 * STAIRS[::2], np.full(9, np.nan), np.zeros(9)], 0.25),
        ([np.full(60, 7.0), STAIRS[::7]], 0.0),  # one level tells no step; nor new values
        ([np.repeat([100.0, 200.0], 50)], 0.0),  # round numbers, not a converter
    ],
)
def test_the_step_of_a_converter_is_the_smallest_difference_of_repeated_values(signals, step):
    assert resolution(*signals) == pytest.approx(step, rel=1e-9)


@pytest.mark.parametrize("noise", [0.02, 0.1, 0.2, 0.4])
def test_stated_rounding_is_no_smaller_than_the_errors_of_rounded_means(noise):
    """In steps; 100 samples each of 3000 signals anywhere between two of them."""
    rng = np.random.default_rng(1)
    level = rng.uniform(0.0, 1.0, 3000)
    samples = np.round(level[:, None] + noise * rng.normal(size=(3000, 100)))
    spread = np.std(samples, axis=1)
    stated = np.hypot(rounding_of_mean(spread, 1.0), spread / 10.0)
    z = (samples.mean(axis=1) - level) / np.maximum(stated, 1e-3)
    assert 0.2 < np.sqrt(np.mean(z**2)) < 1.15
    # without noise, a uniform distribution as wide as a step
    assert rounding_of_mean([0.0, 1.0, 9.0], [2.0, 0.0, 2.0]) == pytest.approx(
        [2.0 / math.sqrt(12.0), 0.0, 0.0], abs=1e-12
    )


def lined(periods, amplitude, n=200, seed=0, noise=1.0):
    """Two residual signals with a line, orthogonal to constants, and the basis of constants."""
    t = np.linspace(2.0, 12.0, n)
    noise = noise * np.random.default_rng(seed).normal(size=(n, 2))
    wave = np.sin(2 * np.pi * periods / 10.0 * (t - 2.0) + 0.3)[:, None] * [amplitude, 0.0]
    basis = np.full((n, 1), 1.0 / np.sqrt(n))
    signals = noise + wave
    return t, signals - basis @ (basis.T @ signals), basis


@pytest.mark.parametrize("periods", [2.0, 2.6, 7.3, 40.0])
def test_a_line_without_noise_is_where_it_is(periods):
    found = strongest_line(*lined(periods, 2.0, noise=0.0))
    assert found == pytest.approx(periods / 10.0, abs=1e-3 * 0.1)


@pytest.mark.parametrize("n", [200, 4000])
def test_a_line_must_stand_out_of_white_noise(n):
    """Power a^2 n / 4 against m + ln(n / 2) + 9 with m = 2, and the noise adds its own 2."""
    limit = 2.0 * math.sqrt((2 + math.log(n / 2.0) + 9.0) / n)
    found = {
        share: sum(
            strongest_line(*lined(12.25, share * limit, n, seed)) is not None for seed in range(20)
        )
        for share in (0.6, 1.4)
    }
    assert found[0.6] <= 2
    assert found[1.4] >= 18


def test_what_is_no_line():
    t, residuals, basis = lined(6.0, 3.0)
    assert strongest_line(t, residuals, basis) is not None
    assert strongest_line(np.zeros_like(t), residuals, basis) is None
    few = slice(None, 23)
    small = np.full((23, 1), 1.0 / np.sqrt(23))
    assert strongest_line(t[few], 9.0 * np.sin(np.arange(23.0))[:, None], small) is None
    # red noise rises towards low frequencies: no line stands out of its neighbours
    rng = np.random.default_rng(4)
    walks = np.cumsum(rng.normal(size=(200, 2)), axis=0)
    found = [strongest_line(t, 3.0 * (w - w.mean(axis=0)), basis) for w in (walks, walks[::-1])]
    assert found == [None, None]
    # less than one and a half periods
    slow = np.cos(2 * np.pi * 0.7 / 10.0 * (t - 2.0))[:, None] + 0.01 * rng.normal(size=(200, 1))
    assert strongest_line(t, 50.0 * (slow - slow.mean()), basis) is None

"""Robust statistics against sums written out by hand, and both sides of every threshold."""

from __future__ import annotations

import math

import numpy as np
import pytest

from beltid.identify.estimators.statistics import (
    as_set,
    integrated_autocorrelation_time,
    local_reference,
    mad_sigma,
    outlier_mask,
    robust_mean_with_se,
    sample_noise,
    spike_mask,
)

NORMAL_QUARTILE = 0.6744897501960817  # of a standard normal variable: half of them lie within it
STEADY = np.tile([-1.0, 0.0, 1.0], 20)  # median 0, median deviation 1


def tau_by_hand(x: np.ndarray) -> float:
    """1 + 2 sum of the autocorrelation over the pairs that exist, to five times the sum itself."""
    valid = np.isfinite(x)
    n, residual = int(valid.sum()), x - np.mean(x[valid])
    tau, largest = -1.0, (-math.inf, 0)
    variance = np.mean(residual[valid] ** 2)
    for lag in range(x.size):
        products = [residual[k] * residual[k + lag] for k in range(x.size - lag)]
        pairs = [p for p in products if math.isfinite(p)]
        tau += 2.0 * (float(np.mean(pairs)) / variance if pairs else 0.0)
        if lag < x.size // 2:
            largest = max(largest, (tau, -lag))
        if lag >= 5.0 * max(tau, 1.0):
            break
    else:  # no end of the correlation in sight: the largest sum within half of the record
        tau, lag = largest[0], -largest[1]
    return min(max(tau * (1.0 + (2 * lag + 1) / n), 1.0), n)


def signals() -> list[np.ndarray]:
    rng = np.random.default_rng(8)
    noise = rng.normal(size=90)
    smooth = np.convolve(noise, np.ones(6), mode="valid")
    with_gaps = smooth.copy()
    with_gaps[rng.random(smooth.size) < 0.3] = np.nan
    slow, ramp = np.cos(np.linspace(0.0, 3.0, 40)), np.linspace(5.0, 6.0, 12)
    return [noise, smooth, with_gaps, slow, ramp, 1e6 + noise, np.array([1.0, 2.0, 1.0, 3.0])]


@pytest.mark.parametrize("number", range(7))
def test_autocorrelation_time_is_the_sum_over_the_pairs(number):
    x = signals()[number]
    assert integrated_autocorrelation_time(x) == pytest.approx(tau_by_hand(x), rel=1e-6)


def test_samples_that_say_nothing_about_their_correlation_are_independent():
    assert integrated_autocorrelation_time([1.0, 2.0, 3.0]) == 1.0
    assert integrated_autocorrelation_time(np.full(50, 0.1)) == 1.0
    later, eps = np.arange(50) >= 25, np.finfo(float).eps
    for size in (2.0**-20, 1.0, 2.0**20):
        equal, different = size * (1.0 + 12 * eps * later), size * (1.0 + 40 * eps * later)
        assert integrated_autocorrelation_time(equal) == 1.0  # six units of rounding to each side
        assert integrated_autocorrelation_time(different) > 5.0
    assert integrated_autocorrelation_time((-1.0) ** np.arange(50)) == 1.0


def test_mean_and_error_are_those_of_the_kept_samples():
    x = signals()[1]
    x[40] = 99.0
    kept = np.delete(x, 40)
    tau = tau_by_hand(np.where(np.arange(x.size) == 40, np.nan, x))
    mean, se, n_eff = robust_mean_with_se(x)
    assert mean == pytest.approx(kept.mean(), rel=1e-12)
    assert n_eff == pytest.approx(kept.size / tau, rel=1e-6)
    squares = float(np.sum((kept - kept.mean()) ** 2))
    assert se == pytest.approx(math.sqrt(squares / (kept.size - tau) / n_eff), rel=1e-6)


def test_two_samples_have_an_error():
    mean, se, n_eff = robust_mean_with_se([1.0, 3.0])
    assert (mean, n_eff) == (2.0, 2.0)
    assert se == pytest.approx(1.0, rel=1e-12)  # sqrt(2 / 1 / 2)


def test_spread_of_a_few_samples():
    assert mad_sigma([1.0, 2.0, 3.0, 4.0, 100.0, np.nan]) == pytest.approx(
        1.0 / NORMAL_QUARTILE, rel=1e-12
    )
    assert mad_sigma([5.0, 5.0, 5.0, 6.0]) == pytest.approx(
        0.25 * math.sqrt(math.pi / 2), rel=1e-12
    )
    assert mad_sigma([0.01, 0.02, 0.03]) == pytest.approx(0.01 / NORMAL_QUARTILE, rel=1e-12)
    assert math.isnan(mad_sigma([np.inf]))
    assert mad_sigma([2.0, 2.0]) == 0.0


@pytest.mark.parametrize(("threshold", "limit"), [(None, 6.0), (3.0, 3.0)])
def test_an_outlier_lies_beyond_its_threshold(threshold, limit):
    more = {} if threshold is None else {"threshold": threshold}
    for share, marked in ((0.999, False), (1.001, True)):
        for sign in (-1.0, 1.0):
            far = np.append(STEADY, sign * share * limit / NORMAL_QUARTILE)
            assert outlier_mask(far, **more).any() == marked
            assert (robust_mean_with_se(far, **more).mean == pytest.approx(0.0)) == marked
    assert outlier_mask([0.0, 9e9, 1.0]).tolist() == [False, True, False]
    assert not outlier_mask([0.0, 9e9, np.nan])[:2].any()


@pytest.mark.parametrize("size", [2.0**-20, 1.0, 2.0**20])
def test_the_last_bit_of_equal_samples_is_no_outlier(size):
    x = np.full(100, size)
    x[[3, 50]] += np.array([1, -4]) * size * np.finfo(float).eps
    assert not outlier_mask(x).any()
    x[7] += 1e-13 * size  # some hundred times the rounding
    assert outlier_mask(x).nonzero()[0].tolist() == [7]


def test_the_window_of_a_local_reference_holds_its_pairs():
    x = np.random.default_rng(9).normal(size=40) + np.arange(40.0)
    distance = x - reference_by_hand(list(x), 2)
    for threshold in (1.0, 2.0):
        expected = np.abs(distance) > threshold * mad_sigma(distance)
        assert np.array_equal(outlier_mask(x, threshold, window=5), expected)


def reference_by_hand(x: list[float], w: int) -> list[float]:
    found, n = [], len(x)
    for i in range(n):
        if i < w:
            tries = [2 * x[i + k] - x[i + 2 * k] for k in range(1, w + 1)]
        elif i >= n - w:
            tries = [2 * x[i - k] - x[i - 2 * k] for k in range(1, w + 1)]
        else:
            tries = [(x[i - k] + x[i + k]) / 2 for k in range(1, w + 1)]
        found.append(float(np.median(tries)))
    return found


@pytest.mark.parametrize(("n", "half", "used"), [(30, 3, 3), (13, 3, 3), (12, 3, 2), (5, 0, 1)])
def test_neighbours_suggest_the_median_of_their_pairs(n, half, used):
    x = np.random.default_rng(n).normal(size=n)
    assert local_reference(x, half) == pytest.approx(reference_by_hand(list(x), used), rel=1e-12)
    assert local_reference(x[:4], half) == pytest.approx([np.median(x[:4])] * 4)


def disagreements(x: list[float]) -> np.ndarray:
    """Of each sample with its surroundings: with both sides, or with the better of one of them."""
    found = np.abs(np.array(x) - reference_by_hand(x, min(3, (len(x) - 1) // 4)))
    for i in range(6, len(x) - 6):
        sides = [[2 * x[i + s * k] - x[i + 2 * s * k] for k in (1, 2, 3)] for s in (-1, 1)]
        found[i] = min(found[i], *(abs(x[i] - float(np.median(side))) for side in sides))
    return found


@pytest.mark.parametrize("n", [13, 14, 40])
def test_a_spike_disagrees_with_all_that_is_around_it(n):
    rng = np.random.default_rng(n)
    x = 0.2 * np.arange(n) + 0.01 * rng.normal(size=n)
    x[n // 2] += 3.0
    far = disagreements(list(x))
    spread = float(np.median(far)) / NORMAL_QUARTILE
    assert np.array_equal(spike_mask(x), far > 12.0 * spread)
    assert spike_mask(x)[n // 2]
    highest = far.max()
    assert spike_mask(x, threshold=0.999 * highest / spread).sum() == 1
    assert not spike_mask(x, threshold=1.001 * highest / spread).any()
    assert spike_mask(x, floor=0.999 * highest).sum() == 1
    assert not spike_mask(x, floor=1.001 * highest).any()


@pytest.mark.parametrize("place", [0, 5, 6, 7, 20, 32, 33, 34, 39])
def test_the_smallest_spike_is_twelve_spreads(place):
    rng = np.random.default_rng(place)
    clean = 0.2 * np.arange(40) + 0.01 * rng.normal(size=40)
    found = []
    for height in np.linspace(0.02, 0.4, 39):
        x = clean + height * (np.arange(40) == place)
        far = disagreements(list(x))
        expected = far > 12.0 * float(np.median(far)) / NORMAL_QUARTILE
        assert np.array_equal(spike_mask(x), expected)
        found.append(bool(expected[place]))
    assert found[0] is False
    assert found[-1] is True


def test_nine_samples_are_enough_to_tell_a_spike():
    x = np.arange(9.0) ** 2
    far = disagreements(list(x + 50.0 * (np.arange(9) == 8)))
    limit = far.max() / float(np.median(far)) * NORMAL_QUARTILE
    x[8] += 50.0
    assert spike_mask(x, threshold=0.999 * limit).any()
    assert not spike_mask(x, threshold=1.001 * limit).any()
    assert not spike_mask(x[1:], threshold=0.0).any()


def test_noise_of_alternating_samples():
    x = 0.3 * (-1.0) ** np.arange(20)  # second differences of 1.2
    assert sample_noise(x) == pytest.approx(1.2 / NORMAL_QUARTILE / math.sqrt(6.0), rel=1e-12)
    assert sample_noise(x[:5]) == pytest.approx(sample_noise(x), rel=1e-12)
    assert sample_noise([*x[:3], np.nan, x[3]]) == 0.0


def test_settings_are_told_apart_by_their_relative_gap():
    values = np.array([100.0, 205.0, np.nan, 102.9, 200.0, -1.0])
    expected = [101.45, 202.5, np.nan, 101.45, 202.5, -1.0]
    assert as_set(values) == pytest.approx(expected, nan_ok=True)
    assert as_set(np.array([100.0, 103.1])) == pytest.approx([100.0, 103.1])
    assert as_set(np.array([100.0, 103.1]), gap=0.04) == pytest.approx([101.55, 101.55])
    assert np.isnan(as_set(np.array([np.nan]))).all()

"""Pooled noise of short runs against sums written out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import digamma, polygamma
from scipy.stats import t as student

from beltid.identify.slip.noise import (
    pooled_correlation_time,
    pooled_means,
    pooled_variance,
    speed_series,
)

NORMAL_QUARTILE = 0.6744897501960817
ONE_SIGMA = 0.8413447460685429  # a normal variable lies below one standard deviation


def correlation_by_hand(runs):
    longest = max(r.size for r in runs)
    sums, pairs = np.zeros(longest), np.zeros(longest)
    for r in runs:
        for lag in range(r.size):
            products = r[lag:] * r[: r.size - lag]
            sums[lag] += np.nansum(products)
            pairs[lag] += np.isfinite(products).sum()
    usable = longest if np.all(pairs > 0) else int(np.argmin(pairs > 0))
    c = sums[:usable] / pairs[:usable] / (sums[0] / pairs[0])
    n = pairs[0] / sum(np.isfinite(r).any() for r in runs)
    tau = 1.0
    for _ in range(20):
        share = min(tau / n, 0.5)
        rho, tau = c * (1 - share) + share, 1.0
        for lag in range(1, usable):
            if rho[lag] < 2.0 / math.sqrt(pairs[lag]):
                break
            tau += 2.0 * max(1.0 - lag / n, 0.0) * rho[lag]
    return max(tau, 1.0)


def correlated(seed, sizes, a):
    rng, runs = np.random.default_rng(seed), []
    for n in sizes:
        x = rng.normal(size=n + 100)
        for k in range(1, x.size):
            x[k] += a * x[k - 1]
        runs.append(x[100:] - x[100:].mean())
    return runs


@pytest.mark.parametrize("a", [0.0, 0.5, 0.8, 0.95])
def test_correlation_of_short_runs_is_the_sum_over_all_pairs(a):
    runs = correlated(1, [20, 13, 30, 8, 25, 30, 18], a)
    assert pooled_correlation_time(runs) == pytest.approx(correlation_by_hand(runs), rel=1e-9)
    runs[2][[3, 4, 9]] = np.nan
    runs.append(np.full(5, np.nan))
    assert pooled_correlation_time(runs) == pytest.approx(correlation_by_hand(runs), rel=1e-9)


def test_no_pairs_no_correlation():
    assert pooled_correlation_time([]) == 1.0
    assert pooled_correlation_time([np.zeros(5)]) == 1.0
    assert pooled_correlation_time([np.array([0.3]), np.array([-0.3])]) == 1.0
    gap = np.array([1.0, np.nan, -1.0, np.nan, 1.0])
    assert pooled_correlation_time([gap]) == 1.0  # no neighbours
    two = [np.array([1.0, 1.0]), np.array([-1.0, -1.0])] * 20
    assert pooled_correlation_time(two) == pytest.approx(correlation_by_hand(two), rel=1e-12)


def test_pooled_variance_solves_the_equations_of_smyth():
    rng = np.random.default_rng(3)
    dof = rng.integers(2, 9, 60).astype(float)
    variance = 4.0 * 5.0 / rng.chisquare(5, 60) * rng.chisquare(dof) / dof
    variance[7], dof[9] = 0.0, 0.0  # tell nothing
    used = (variance > 0) & (dof > 0)
    e = np.log(variance[used]) - digamma(dof[used] / 2) + np.log(dof[used] / 2)
    excess = np.var(e, ddof=1) - np.mean(polygamma(1, dof[used] / 2))
    half = brentq(lambda y: polygamma(1, y) - excess, 1e-3, 1e4)
    found, found_dof = pooled_variance(variance, dof)
    assert found_dof == pytest.approx(2 * half, rel=1e-8)
    assert found == pytest.approx(math.exp(e.mean() + digamma(half) - math.log(half)), rel=1e-8)


def test_runs_that_scatter_by_chance_alone_count_with_all_they_know():
    dof = np.array([4.0, 4.0, 6.0])
    variance, pooled = pooled_variance(np.array([2.0, 2.0, 2.0]), dof)
    assert pooled == 14.0
    e = math.log(2.0) - digamma(dof / 2) + np.log(dof / 2)
    assert variance == pytest.approx(math.exp(e.mean()), rel=1e-5)  # digamma(d) = ln d for many
    assert pooled_variance(np.array([1.0]), np.array([5.0])) == (0.0, 0.0)
    # two runs are a scatter
    wide, its_dof = pooled_variance(np.array([1e-3, 1e3]), np.array([5.0, 5.0]))
    assert 0.0 < its_dof < 1.0
    assert wide > 0.0


def test_the_error_of_a_run_is_drawn_towards_that_of_its_series():
    rng = np.random.default_rng(4)
    samples = {f"{k}": rng.normal(0.0, 1.0 + 0.2 * k, 6) for k in range(12)}
    tau = correlation_by_hand([x - x.mean() for x in samples.values()])
    dof = np.full(12, 6.0 / tau - 1.0)
    squares = np.array([np.sum((x - x.mean()) ** 2) for x in samples.values()])
    own = squares / (6.0 - tau)
    prior, prior_dof = pooled_variance(own, dof)
    found = pooled_means(samples, [list(samples)])
    for k, (label, x) in enumerate(samples.items()):
        pooled = (prior_dof * prior + dof[k] * own[k]) / (prior_dof + dof[k])
        factor = student.ppf(ONE_SIGMA, prior_dof + dof[k])
        mean, se, n_eff = found[label]
        assert mean == pytest.approx(x.mean(), rel=1e-12)
        assert n_eff == pytest.approx(6.0 / tau, rel=1e-9)
        assert se == pytest.approx(factor * math.sqrt(pooled * tau / 6.0), rel=1e-6)


def test_runs_without_samples_and_with_one():
    series = {"a": np.array([np.nan, np.nan]), "b": np.array([2.0]), "c": np.arange(8.0) % 2}
    found = pooled_means(series, [["a", "b", "c"]])
    assert math.isnan(found["a"].mean)
    assert math.isnan(found["a"].se)
    assert found["b"].mean == 2.0
    assert math.isnan(found["b"].se)  # one run alone tells no common noise
    assert found["c"].mean == 0.5


@pytest.mark.parametrize(("far", "kept"), [(0.99, True), (1.01, False)])
def test_a_spike_lies_six_spreads_off(far, kept):
    """Of its own run, or of the differences of the series where these are wider."""
    base = np.array([-1.0, 0.0, 1.0] * 4)
    wide = np.tile([5.0, -5.0], 10)  # its differences of ten
    own, common = 1.0 / NORMAL_QUARTILE, 10.0 / NORMAL_QUARTILE / math.sqrt(2.0)
    alone = pooled_means({"a": np.append(base, 6.0 * far * own)}, [["a"]])["a"]
    # differences of one in the run itself: the smaller spread
    assert (abs(alone.mean) > 1e-12) == kept
    with_others = {"a": np.append(base, 6.0 * far * common), "b": wide, "c": wide, "d": wide}
    found = pooled_means(with_others, [list(with_others)])["a"]
    assert (abs(found.mean) > 1e-12) == kept


def test_two_samples_hold_no_spike_and_the_last_bit_is_none():
    found = pooled_means({"a": np.array([0.0, 9e9])}, [["a"]])["a"]
    assert found.mean == 4.5e9
    flat = np.full(20, 62.8)
    flat[3] += 4 * np.spacing(62.8)
    assert pooled_means({"a": flat}, [["a"]])["a"].n_eff > 0
    kept = pooled_means({"a": flat}, [["a"]])["a"].mean
    assert kept == pytest.approx(flat.mean(), rel=1e-16)


def test_runs_within_two_percent_are_one_series():
    speeds = {f"{k}": v for k, v in enumerate([10.0, 10.1, 10.19, 10.21, 10.3, 10.4])}
    found = speed_series(speeds)
    assert found == (("0", "1", "2"), ("3", "4", "5"))
    assert speed_series({}) == ((),)
    unknown = dict.fromkeys("xyz", float("nan"))
    assert set(map(frozenset, speed_series(speeds | unknown))) <= {
        frozenset(speeds | unknown),
        *map(frozenset, found),
        frozenset("xyz"),
    }

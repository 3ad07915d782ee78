"""The mean of a bench signal and its standard error against processes of known correlation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.signal import lfilter

from beltid.identify.estimators.statistics import (
    integrated_autocorrelation_time,
    mad_sigma,
    outlier_mask,
    robust_mean_with_se,
    sample_noise,
    spike_mask,
)


def autoregressive(rng: np.random.Generator, n: int, a: float) -> np.ndarray:
    """x[k] = a x[k-1] + e[k], stationary, unit variance: tau = (1 + a)/(1 - a) in closed form."""
    return lfilter([np.sqrt(1 - a * a)], [1.0, -a], rng.normal(size=n + 400))[400:]


@pytest.mark.parametrize("a", [0.0, 0.5, 0.8])
def test_autocorrelation_time_of_an_autoregressive_process(a):
    rng = np.random.default_rng(1)
    tau = np.mean(
        [integrated_autocorrelation_time(autoregressive(rng, 4000, a)) for _ in range(30)]
    )
    assert tau == pytest.approx((1 + a) / (1 - a), rel=0.06)


@pytest.mark.parametrize(("a", "n"), [(0.0, 200), (0.5, 300), (0.8, 1000)])
def test_standard_error_equals_the_scatter_of_repeated_means(a, n):
    rng = np.random.default_rng(2)
    results = [robust_mean_with_se(autoregressive(rng, n, a)) for _ in range(400)]
    scatter = np.std([r.mean for r in results])
    stated = np.sqrt(np.mean([r.se**2 for r in results]))
    # 400 repetitions determine the scatter itself to 3.5 %
    assert stated == pytest.approx(scatter, rel=0.12)


def test_spikes_and_gaps_do_not_move_the_mean():
    rng = np.random.default_rng(3)
    clean = 250.0 + rng.normal(size=500)
    dirty = clean.copy()
    dirty[[20, 90, 300]] = 900.0, -300.0, np.inf
    dirty[[7, 8, 450]] = np.nan
    hit = np.array([7, 8, 20, 90, 300, 450])
    assert np.flatnonzero(outlier_mask(dirty)).tolist() == hit.tolist()
    mean, se, _ = robust_mean_with_se(dirty)
    assert mean == pytest.approx(np.delete(clean, hit).mean(), rel=1e-14)
    assert 0.03 < se < 0.06


def test_running_median_finds_a_spike_on_a_ramp():
    rng = np.random.default_rng(4)
    x = np.linspace(0.0, 400.0, 300) + 0.1 * rng.normal(size=300)
    x[100] += 15.0
    assert not outlier_mask(x).any()
    assert np.flatnonzero(outlier_mask(x, threshold=8.0, window=7)).tolist() == [100]


def test_spikes_at_the_ends_of_a_ramp_are_found():
    x = np.linspace(0.0, 40.0, 50) + 0.1 * np.random.default_rng(6).normal(size=50)
    x[0] -= 9.0
    x[-2] += 9.0
    assert np.flatnonzero(outlier_mask(x, window=7)).tolist() == [0, 48]


def test_spikes_are_told_from_kinks_and_reversals():
    rng = np.random.default_rng(7)
    x = np.concatenate([np.zeros(50), np.linspace(0, 400, 300), np.linspace(400, 0, 80)])
    x += 0.05 * rng.normal(size=x.size)
    assert not spike_mask(x).any()
    x[[0, 120, 349, 420]] += 10.0
    x[200] = np.nan
    assert np.flatnonzero(spike_mask(x)).tolist() == [0, 120, 200, 349, 420]
    assert np.flatnonzero(spike_mask(x, floor=20.0)).tolist() == [200]
    assert sample_noise(x) == pytest.approx(0.05, rel=0.15)


def test_gaps_keep_the_lags_of_the_other_samples():
    rng = np.random.default_rng(5)
    x = autoregressive(rng, 40000, 0.8)
    x[rng.random(x.size) < 0.3] = np.nan
    assert integrated_autocorrelation_time(x) == pytest.approx(9.0, rel=0.15)


def test_a_coarse_converter_has_a_spread():
    x = np.array([5.0] * 60 + [5.1] * 20 + [4.9] * 20)
    assert 0.02 < mad_sigma(x) < 0.08
    assert not outlier_mask(x).any()


def test_too_few_samples_say_so():
    assert np.isnan(robust_mean_with_se([]).mean)
    assert robust_mean_with_se([np.nan]).n_eff == 0.0
    assert robust_mean_with_se([3.0]).mean == 3.0
    assert np.isnan(robust_mean_with_se([3.0]).se)


@given(
    hnp.arrays(float, st.integers(4, 60), elements=st.floats(-10, 10, width=32)),
    st.sampled_from([2.0**-9, 0.5, 4.0, 1024.0]),
)
def test_bounds_and_change_of_unit(x, scale):
    mean, _se, n_eff = robust_mean_with_se(x)
    assert x.min() - 1e-9 <= mean <= x.max() + 1e-9
    assert n_eff <= x.size
    assert 1.0 <= integrated_autocorrelation_time(x) <= x.size
    assert integrated_autocorrelation_time(scale * x) == pytest.approx(
        integrated_autocorrelation_time(x), rel=1e-6
    )

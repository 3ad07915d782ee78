"""Terms and samples that the fit of the sliding phase takes, on records put together by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from beltid.identify.friction.sliding import fit_sliding, plausible_samples

T = np.linspace(3.0, 13.0, 201)
ONE = np.array([1.0, 1.0])


def level(n=T.size):
    return np.tile([400.0, 160.0], (n, 1))


def chatter(n=T.size):
    """Noise of one in both cells, in ones, and in no way alike."""
    return np.random.default_rng(2).choice([-1.0, 1.0], size=(n, 2))


# --- which samples ---


@pytest.mark.parametrize(
    ("spread", "sigma", "limit"),
    [
        (0.0, 1.0, 23.0),  # 8 · 1 + 0.15 · 100
        (2.0, 1.0, 39.0),  # 8 · 1.5 · 2 + 15
        (2.0, 4.0, 47.0),
    ],
)
def test_plausible_samples_lie_near_the_median(spread, sigma, limit):
    column = 100.0 + spread * (-1.0) ** np.arange(21)
    column[10] = 100.0
    for off, plausible in ((0.1, False), (-0.1, True)):
        for k, side in ((4, 1.0), (5, -1.0)):  # the median stays
            tensions = np.column_stack([column, np.full(21, -1000.0)])
            tensions[k, 0] = 100.0 + side * (limit + off)
            found = plausible_samples(tensions, np.array([sigma, 1.0]))
            assert found.tolist() == [plausible or i != k for i in range(21)]


@pytest.mark.parametrize(("n", "enough"), [(19, False), (20, True)])
def test_all_samples_are_plausible_if_fewer_than_eight_are(n, enough):
    tensions = level(n)
    tensions[:6, 0] = tensions[-6:, 1] = 1.0
    expected = [not enough or 6 <= k < n - 6 for k in range(n)]
    assert plausible_samples(tensions, ONE).tolist() == expected


@pytest.mark.parametrize("sigma", [1.0, 2.0])
@pytest.mark.parametrize("channel", [0, 1])
def test_an_outlier_lies_off_by_six_times_the_noise(sigma, channel):
    for off, used in ((5.7, True), (6.4, False)):
        tensions = level()
        tensions[120, channel] += off * sigma
        fit = fit_sliding(T, tensions, sigma * ONE)
        assert fit.used.tolist() == [used or k != 120 for k in range(201)]
        if not used:
            assert fit.levels == pytest.approx([400.0, 160.0], rel=1e-12)


def test_noise_that_is_larger_than_stated_makes_no_outliers():
    noise = np.random.default_rng(3).normal(size=T.size)
    assert 0.05 < np.mean(np.abs(4.0 * noise) > 6.0) < 0.3
    tensions = level() + np.column_stack([4.0 * noise, 0.5 * chatter()[:, 1]])
    assert fit_sliding(T, tensions, ONE).used.all()
    assert fit_sliding(T, tensions[:, ::-1] + [-240.0, 240.0], ONE).used.all()


@pytest.mark.parametrize(("n", "used"), [(8, 8), (9, 8)])
def test_eight_samples_are_kept_at_least(n, used):
    tensions = level(n)
    tensions[4, 0] += 30.0
    assert np.count_nonzero(fit_sliding(T[:n], tensions, ONE).used) == used


# --- which terms ---


def with_tail(t, tight=20.0, slack=-6.0, tau=1.7):
    return level(t.size) + np.exp(-(t - t[0]) / tau)[:, None] * [tight, slack]


def test_a_late_record_is_fitted_like_an_early_one():
    tensions = with_tail(T) + np.sin(2 * np.pi * 1.3 * T)[:, None] * [3.0, 1.0] + 0.1 * chatter()
    early = fit_sliding(T, tensions, 0.1 * ONE)
    late = fit_sliding(T + 1e5, tensions, 0.1 * ONE)
    assert early.tau == pytest.approx(1.7, rel=0.01)
    assert early.lines == (pytest.approx(1.3, rel=1e-3),)
    assert late.lines == pytest.approx(early.lines, rel=1e-6)
    assert late.tau == pytest.approx(early.tau, rel=1e-6)
    assert late.levels == pytest.approx(early.levels, rel=1e-8)
    assert late.tail == pytest.approx(early.tail, rel=1e-6)
    assert late.ripple_N == pytest.approx(early.ripple_N, rel=1e-6)
    assert late.t_0 == T[0] + 1e5


def test_a_tail_of_ten_samples():
    t = np.linspace(0.0, 10.0, 10)
    fit = fit_sliding(t, with_tail(t), ONE)
    assert fit.tau == pytest.approx(1.7, rel=2e-3)
    assert fit.levels == pytest.approx([400.0, 160.0], rel=1e-4)


def test_level_with_a_drift_is_that_in_the_middle():
    tensions = level() + (T - 8.0)[:, None] * [0.5, -0.2]
    fit = fit_sliding(T, tensions, 0.01 * ONE, drift=True)
    assert fit.drift == pytest.approx([0.5, -0.2], rel=1e-9)
    assert fit.levels == pytest.approx([400.0, 160.0], rel=1e-9)
    assert math.isnan(fit.tau)


def test_the_quiet_cell_tells_the_tail():
    tensions = level() + chatter() * [0.1, 10.0]
    tensions[:, 0] += np.exp(-(T - 3.0) / 1.2)
    fit = fit_sliding(T, tensions, np.array([0.1, 10.0]))
    assert fit.tau == pytest.approx(1.2, rel=0.15)
    assert fit.tail[0] == pytest.approx(1.0, rel=0.1)


def test_at_most_three_lines_the_strongest_first():
    waves = [(4.0, 2.35), (3.0, 0.9), (2.0, 1.45), (1.5, 3.3)]
    ripple = sum(a * np.sin(2 * np.pi * f * T + f) for a, f in waves)
    tensions = level() + ripple[:, None] * [1.0, 0.5] + 0.01 * chatter()
    fit = fit_sliding(T, tensions, 0.01 * ONE)
    assert fit.lines == pytest.approx((2.35, 0.9, 1.45), rel=5e-3)
    two = level() + sum(a * np.sin(2 * np.pi * f * T) for a, f in waves[:2])[:, None] * [1, 0.5]
    fit = fit_sliding(T, two + 0.01 * chatter(), 0.01 * ONE)
    assert fit.lines == pytest.approx((2.35, 0.9), rel=1e-3)
    assert fit.ripple_N == pytest.approx([4.0, 2.0], rel=1e-3)


def test_a_line_stands_out_of_the_noise_that_is_there_not_of_that_stated():
    tensions = level() + 0.02 * np.sin(2 * np.pi * 1.3 * T)[:, None] + 0.01 * chatter()
    assert fit_sliding(T, tensions, ONE).lines == (pytest.approx(1.3, rel=0.01),)

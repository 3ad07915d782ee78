"""What is read off a fit of the sliding phase, for fits put together by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from beltid.identify.friction.sliding_drift import (
    drift_rate,
    odds_of_a_cell,
    rate_se,
    settled_levels,
)
from beltid.identify.friction.sliding_errors import (
    ROUNDING,
    LinearScheme,
    correlation_time,
    with_errors,
)
from beltid.identify.friction.sliding_misfit import misfit, rise_before, rounding_se
from beltid.identify.friction.sliding_model import SlidingFit

from beltid.identify.estimators.signal import NOISE_FLOOR
from beltid.identify.estimators.statistics import integrated_autocorrelation_time

T = np.linspace(3.0, 13.0, 101)
LEVELS = np.array([400.0, 160.0])
NOISE = np.random.default_rng(0).normal(size=(101, 2)) * [0.8, 0.3]
NOISE -= NOISE.mean(axis=0)


def fit_by_hand(**changed) -> SlidingFit:
    fields = {
        "t_0": 3.0,
        "levels": LEVELS,
        "tail": np.zeros(2),
        "tau": math.nan,
        "tau_at_bound": False,
        "drift": np.zeros(2),
        "lines": (),
        "ripple_N": np.zeros(2),
        "used": np.ones(T.size, dtype=bool),
        "residual": NOISE,
        "ripple": np.zeros((T.size, 2)),
        "log_ratio_se": 1e-4,
        "start_log_ratio_se": 1e-4,
        "correlation_time": 1.0,
        "drift_score": 0.0,
    }
    return SlidingFit(**{**fields, **changed})


def test_parts_of_the_model():
    fit = fit_by_hand(
        tail=np.array([20.0, -8.0]), tau=2.0, drift=np.array([0.5, -0.1]), ripple=NOISE**2
    )
    assert fit.log_ratio == pytest.approx(math.log(2.5), rel=1e-14)
    assert math.isnan(replace(fit, levels=np.array([400.0, 0.0])).log_ratio)
    half_life = 3.0 + 2.0 * math.log(2.0)
    assert fit.decay(half_life) == pytest.approx(0.5, rel=1e-14)
    assert fit.tail_at(half_life) == pytest.approx(math.log(410.0 / 156.0 / 2.5), rel=1e-12)
    assert np.array_equal(fit_by_hand().decay(T), np.zeros(T.size))
    expected = NOISE[:, 0] / 400.0 - NOISE[:, 1] / 160.0
    assert fit.log_residual == pytest.approx(expected, rel=1e-12)
    k = 30
    expected = NOISE[k] + NOISE[k] ** 2 + np.array([20.0, -8.0]) * math.exp(-(T[k] - 3.0) / 2.0)
    expected = expected + np.array([0.5, -0.1]) * (T[k] - 8.0)
    assert fit.deviation(T)[k] == pytest.approx(expected, rel=1e-12)


def test_combinations_are_the_log_ratio_and_what_is_free_of_it():
    fit = fit_by_hand()
    noise = fit.residual / fit.residual.std(axis=0)
    independent = noise @ np.linalg.inv(np.linalg.cholesky(np.corrcoef(noise.T))).T
    fit = replace(fit, residual=independent * [0.8, 0.3])
    both = fit.residual @ fit.combinations
    assert both[:, 0] == pytest.approx(fit.log_residual, rel=1e-12)
    assert np.std(both[:, 0]) == pytest.approx(np.std(both[:, 1]), rel=1e-6)
    assert np.corrcoef(both.T)[0, 1] == pytest.approx(0.0, abs=1e-6)
    quiet = replace(fit, residual=fit.residual * [1.0, 0.0])  # no ratio of the noise is known
    expected = [[1 / 400.0, 1 / 160.0], [-1 / 160.0, 1 / 400.0]]
    assert quiet.combinations == pytest.approx(np.array(expected), rel=1e-12)


def test_misfit_is_the_power_of_block_means_over_that_of_white_noise():
    sigma = np.array([0.8, 0.3])
    white = math.hypot(0.8 / 400.0, 0.3 / 160.0)
    offset = np.column_stack([np.full(T.size, 0.4), np.zeros(T.size)])
    # twelve blocks of eight
    assert misfit(fit_by_hand(residual=offset), sigma) == pytest.approx(
        8.0 * (0.4 / 400.0 / white) ** 2, rel=1e-12
    )
    used = np.arange(T.size) < 8
    fit = fit_by_hand(residual=offset, used=used)  # two blocks of four
    assert misfit(fit, sigma) == pytest.approx(4.0 * (0.4 / 400.0 / white) ** 2, rel=1e-12)
    assert misfit(replace(fit, used=np.arange(T.size) < 7), sigma) == 0.0
    series = NOISE[-96:] @ (np.array([1.0, -1.0]) / LEVELS)
    blocks = [series[8 * k : 8 * k + 8].mean() for k in range(12)]
    expected = 8.0 * np.mean(np.square(blocks)) / white**2
    assert misfit(fit_by_hand(), sigma) == pytest.approx(expected, rel=1e-9)


def test_rise_before_a_fit_beyond_four_errors():
    fit, m = fit_by_hand(log_ratio_se=2e-4), 20
    t_early = np.linspace(1.0, 2.9, m)
    early = np.column_stack([np.full(m, 380.0), np.full(m, 160.0)])
    spread = np.std(fit.log_residual) / math.sqrt(m)
    least = math.log(400.0 / 380.0) - 4.0 * math.hypot(1.25 * spread, 2e-4)
    drifting = replace(fit, drift=np.array([0.1, 0.0]))
    assert rise_before(t_early, early, T, drifting) == pytest.approx(least, rel=1e-12)
    assert rise_before(t_early, early, T, fit) == 0.0  # over: the level does not go on rising
    going_on = np.column_stack([400.0 * 0.004 * (T - 8.0), np.zeros(T.size)])
    rising = replace(fit, residual=NOISE + going_on)
    assert rise_before(t_early, early, T, rising) > 0.0
    above = np.column_stack([np.full(m, 401.0), np.full(m, 160.0)])
    assert rise_before(t_early, above, T, drifting) < 0.0
    assert rise_before(t_early[:7], early[:7], T, drifting) == 0.0
    assert rise_before(t_early[:8], early[:8], T, drifting) > 0.0
    assert rise_before(t_early, -early, T, drifting) == 0.0


@pytest.mark.parametrize(("part", "goes_on"), [(0.15, False), (0.35, True)])
def test_a_rise_goes_on_from_a_quarter_of_its_rate(part, goes_on):
    m, quiet = 20, 1e-6 * NOISE
    t_early = np.linspace(1.0, 2.9, m)
    early = np.column_stack([np.full(m, 380.0), np.full(m, 160.0)])
    rate = math.log(400.0 / 380.0) / float(np.mean(T) - np.mean(t_early))
    slope = np.column_stack([400.0 * part * rate * (T - 8.0) * (T > 8.0), np.zeros(T.size)])
    fit = fit_by_hand(residual=quiet + slope, log_ratio_se=1e-7)
    found = rise_before(t_early, early, T, fit)
    assert (found > 0.0) == goes_on


def test_rounding_of_converters_in_the_log_ratio():
    fit = fit_by_hand()
    assert rounding_se(NOISE, fit, 1, (0.0, 0.0)) == 0.0
    coarse = math.hypot(2.0 / 400.0, 1.0 / 160.0) / math.sqrt(12.0)
    assert rounding_se(NOISE, fit, 1, (2.0, 1.0)) == pytest.approx(coarse, rel=1e-9)
    # steps below twice the noise are carried across; of block means the samples tell the noise
    assert rounding_se(NOISE, fit, 1, (1.0, 0.5)) == 0.0
    assert rounding_se(0.1 * NOISE, fit, 5, (1.0, 0.5)) == pytest.approx(0.5 * coarse, rel=1e-9)


def test_drift_of_the_log_ratio_and_levels_of_the_window():
    fit = fit_by_hand(drift=np.array([2.0, -0.4]), log_ratio_se=3e-4)
    rate = 2.0 / 400.0 + 0.4 / 160.0
    assert drift_rate(fit) == pytest.approx(rate, rel=1e-14)
    levels, se = settled_levels(T, fit, 7.0, 6.0)
    # the middle of the window, 10 s, lies two seconds behind that of the record
    assert levels == pytest.approx([404.0, 159.2], rel=1e-14)
    parts = [3e-4, rate * 6.0 / math.sqrt(12.0), rate * 6.0 / math.sqrt(2.0)]
    assert se == pytest.approx(math.sqrt(sum(x * x for x in parts)), rel=1e-12)


def drift_noise(fit, tail):
    """Errors of slopes beside a level and a tail, by least squares with all columns."""
    columns = np.column_stack([T - T.mean(), np.ones(T.size), *([fit.decay(T)] if tail else [])])
    unit = math.sqrt(np.linalg.inv(columns.T @ columns)[0, 0])
    return fit.residual.std(axis=0) * math.sqrt(fit.correlation_time) * unit


@pytest.mark.parametrize("tail", [False, True])
def test_error_of_the_drift_is_that_of_least_squares(tail):
    fit = fit_by_hand(correlation_time=2.25, tau=4.0 if tail else math.nan)
    noise = drift_noise(fit, tail)
    assert rate_se(T, fit) == pytest.approx(math.hypot(*(noise / LEVELS)), rel=1e-9)
    silent = fit_by_hand(residual=np.zeros((T.size, 2)))
    unit = 1.0 / math.sqrt(float(np.sum((T - T.mean()) ** 2)))
    assert rate_se(T, silent) == pytest.approx(math.sqrt(2.0) * NOISE_FLOOR * unit, rel=1e-9)


def test_a_drift_that_friction_may_cause_is_no_sign_of_a_cell():
    noise = drift_noise(fit_by_hand(), False)
    for move in ((1.0, 0.0), (2.0, -1.0), (0.81, -1.0), (-1.0, 0.5), (0.0, 0.0)):
        assert odds_of_a_cell(T, fit_by_hand(drift=np.array(move))) == 0.0
    for move in ((1.0, 1.0), (0.0, 1.0), (0.5, -1.0), (-1.0, -0.2)):
        drift = 3.0 * np.array(move)
        edges = [np.array([1.0, 0.0]) / noise, np.array([0.8, -1.0]) / noise]
        scaled = drift / noise
        along = max((e @ scaled) ** 2 / (e @ e) for e in edges)
        found = odds_of_a_cell(T, fit_by_hand(drift=drift))
        assert found == pytest.approx(0.5 * (scaled @ scaled - along), rel=1e-9)
        assert found > 0.0


def test_correlation_time_allows_for_the_fitted_terms():
    rng = np.random.default_rng(3)
    x = rng.normal(size=400)
    for k in range(1, 400):
        x[k] += 0.7 * x[k - 1]
    x -= x.mean()
    rho_1 = float(np.mean(x[1:] * x[:-1]) / np.mean(x * x))
    plain = correlation_time(x, 0)
    assert plain == pytest.approx(
        max((1 + rho_1) / (1 - rho_1), integrated_autocorrelation_time(x)), rel=1e-9
    )
    # the fixed point of rho = rho_1 (1 - taken) + taken with tau = (1 + rho) / (1 - rho)
    time = correlation_time(x, 12)
    taken = 12 * time / 400
    rho = rho_1 * (1 - taken) + taken
    assert time > plain
    assert time == pytest.approx((1 + rho) / (1 - rho), rel=1e-2)
    rho = rho_1 * 0.6 + 0.4  # four tenths are taken at most
    assert correlation_time(x, 40) == pytest.approx((1 + rho) / (1 - rho), rel=1e-9)
    assert correlation_time(np.zeros(50), 3) == 1.0
    assert correlation_time((-1.0) ** np.arange(50), 1) == pytest.approx(1.0, abs=0.2)


def test_errors_of_a_mean_of_two_correlated_cells():
    """Constant model: the row of the mean is 1/n, its covariance that of the residuals."""
    rng = np.random.default_rng(5)
    common = rng.normal(size=(400, 1))
    residual = 0.5 * rng.normal(size=(400, 2)) + common
    residual -= residual.mean(axis=0)
    t = np.linspace(0.0, 10.0, 400)
    fit = fit_by_hand(
        residual=residual, used=np.ones(400, dtype=bool), tail=np.zeros(2), ripple=residual
    )
    scheme = LinearScheme(np.full((1, 400), 1.0 / 400.0), np.full((400, 1), 1.0 / 20.0))
    found = with_errors(fit, scheme, t, np.array([1.0, 1.0]))
    series = residual @ (np.array([1.0, -1.0]) / LEVELS)
    time = found.correlation_time
    assert 1.0 <= time < 1.3
    variance = np.mean(series**2) / (1.0 - time / 400.0) / 400.0 * time
    assert found.log_ratio_se == pytest.approx(math.sqrt(variance + ROUNDING**2), rel=1e-9)
    assert found.start_log_ratio_se == pytest.approx(found.log_ratio_se, rel=1e-12)
    slope = (t - t.mean()) / np.linalg.norm(t - t.mean())
    scores = [slope @ (residual @ w) / np.std(residual @ w) for w in found.combinations.T]
    assert found.drift_score == pytest.approx(max(scores, key=abs), rel=1e-9)
    negative = with_errors(
        replace(fit, levels=np.array([400.0, -1.0])), scheme, t, np.array([1.0, 1.0])
    )
    assert negative.log_ratio_se == fit.log_ratio_se


def test_errors_of_level_and_start_beside_a_tail_are_those_of_least_squares():
    """All parameters at once, the time constant included, in a Gauss-Newton problem by hand."""
    n, tau, tail = 600, 2.0, np.array([20.0, -6.0])
    t, rng = np.linspace(0.0, 10.0, n), np.random.default_rng(6)
    sigma = np.array([0.5, 0.2])
    decay = np.exp(-t / tau)
    linear = np.column_stack([np.ones(n), decay])
    residual = rng.normal(size=(n, 2)) * sigma
    q, r = np.linalg.qr(linear)
    residual -= q @ (q.T @ residual)
    fit = fit_by_hand(
        t_0=0.0, tail=tail, tau=tau, residual=residual, used=np.ones(n, dtype=bool), ripple=residual
    )
    found = with_errors(fit, LinearScheme(np.linalg.solve(r, q.T), q), t, sigma)
    # unknowns: levels and amplitudes of both cells, and the common time constant
    by_tau = (t / tau**2 * decay)[:, None] * tail / sigma
    J = np.zeros((2 * n, 5))
    for c in (0, 1):
        J[c * n : (c + 1) * n, [c, 2 + c]] = linear / sigma[c]
        J[c * n : (c + 1) * n, 4] = by_tau[:, c]
    covariance = np.linalg.inv(J.T @ J)
    start = LEVELS + tail
    level = np.array([1 / LEVELS[0], -1 / LEVELS[1], 0.0, 0.0, 0.0])
    begin = np.array([1 / start[0], -1 / start[1], 1 / start[0], -1 / start[1], 0.0])
    # what differs: the noise is estimated from 600 samples, and its memory with it
    for row, stated in ((level, found.log_ratio_se), (begin, found.start_log_ratio_se)):
        expected = math.sqrt(row @ covariance @ row * found.correlation_time)
        assert stated == pytest.approx(expected, rel=0.08)

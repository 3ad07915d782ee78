"""Evidence and levels of the tails of a plateau, by brute-force integration over their shapes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from beltid.identify.friction.sliding import fit_sliding
from beltid.identify.friction.sliding_errors import correlation_time
from beltid.identify.friction.sliding_tail_fit import weigh_tails
from beltid.identify.friction.sliding_tail_record import TailRecord
from beltid.identify.friction.sliding_tails import Hypothesis, Tails, mixture, share_of_double

from beltid.identify.friction import sliding_tail_fit

T = np.linspace(0.0, 10.0, 300)
GRID = 150


def fitted(late, seed=0, noise=0.5):
    """A fit of a record with the tails (amplitude of the tight cell [N], time constant [s])."""
    move = sum(a * np.exp(-T / tau) for a, tau in late)
    tensions = np.column_stack([400.0 + move, 150.0 - 0.3 * move])
    tensions += noise * np.random.default_rng(seed).normal(size=(300, 2))
    return fit_sliding(T, tensions, np.array([noise, noise]))


def brute_force(record):
    """(level, se, log evidence) of a single and of a double tail; log odds of the fit."""
    low, high_1, high_2 = record.log_range
    first = np.linspace(low, high_1, GRID)
    second = np.linspace(low + math.log(1.25), high_2, GRID + 7)
    free = lambda x: x - record.q @ (record.q.T @ x)  # noqa: E731
    raw = [np.exp(-np.outer(record.t, np.exp(-g))) for g in (first, second)]
    E, S = (free(r) for r in raw)
    share_1, share_2 = (record.row @ r for r in raw)
    y, largest = record.rest, 0.3 * abs(record.reference)
    g_11, g_22, g_12 = np.sum(E * E, 0)[:, None], np.sum(S * S, 0), E.T @ S
    c_1, c_2 = (E.T @ y)[:, None], S.T @ y
    slow = (g_11 * c_2 - g_12 * c_1) / (g_11 * g_22 - g_12**2)
    fast = (c_1 - g_12 * slow) / g_11
    squares = y @ y - fast * c_1 - slow * c_2
    apart = second > first[:, None] + math.log(1.25)
    i, j = np.unravel_index(np.argmin(np.where(apart, squares, np.inf)), squares.shape)
    residual = y - fast[i, j] * E[:, i] - slow[i, j] * S[:, j]
    n_terms = record.q.shape[1] + 4
    time = correlation_time(residual, n_terms)
    noise = time * float(residual @ residual) / (y.size * (1 - min(n_terms * time / y.size, 0.4)))
    width = np.log(2 * np.pi * noise / g_11[:, 0]) / 2 - math.log(2 * largest)
    # single: uniform in ln tau and amplitude, or none with a probability of 0.2
    a = c_1[:, 0] / g_11[:, 0]
    log_e = -0.5 * (y @ y - a * c_1[:, 0]) / noise + width - math.log(high_1 - low)
    step = first[1] - first[0]
    peak = log_e.max()
    w = np.exp(log_e - peak)
    levels = record.level - a * share_1
    own = noise * record.level_cofactor + noise / g_11[:, 0] * share_1**2
    mean = w @ levels / w.sum()
    sd = math.sqrt(w @ (own + (levels - mean) ** 2) / w.sum())
    tail = Hypothesis(mean, sd, peak + math.log(w.sum() * step) + math.log(0.8))
    none = math.sqrt(noise * record.level_cofactor)
    none = Hypothesis(record.level, none, -0.5 * float(y @ y) / noise + math.log(0.2))
    total = np.logaddexp(tail.log_evidence, none.log_evidence)
    share = math.exp(tail.log_evidence - total)
    single = (*mixture([1 - share, share], [none, tail]), float(total))
    # double: the slower amplitude half-normal on the side of the whole tail
    best = int(np.argmax(log_e))
    size = min(abs(a[best]) + 2 * math.sqrt(noise / g_11[best, 0]), largest)
    scale, sign = 0.5 * size, math.copysign(1.0, a[best])
    b = (np.arange(100) + 0.5) * (5 * scale / 100)
    prior = -0.5 * (b / scale) ** 2 + math.log(2 / (scale * math.sqrt(2 * math.pi)))
    rss = (
        squares[..., None] + (sign * b - slow[..., None]) ** 2 * (g_22 - g_12**2 / g_11)[..., None]
    )
    log_e = -0.5 * rss / noise + prior + width[:, None, None] - math.log(high_1 - low)
    log_e -= np.log(high_2 - first - math.log(1.25))[:, None, None]
    log_e = np.where(apart[..., None], log_e, -np.inf)
    peak = log_e.max()
    w = np.exp(log_e - peak)
    left = (c_1[..., None] - g_12[..., None] * sign * b) / g_11[..., None]  # faster amplitude
    levels = record.level - left * share_1[:, None, None] - sign * b * share_2[:, None]
    own = (noise * (record.level_cofactor + share_1**2 / g_11[:, 0]))[:, None, None]
    mean = float(np.sum(w * levels) / w.sum())
    sd = math.sqrt(float(np.sum(w * (own + (levels - mean) ** 2)) / w.sum()))
    cell = step * (second[1] - second[0]) * (b[1] - b[0])
    double = (mean, sd, peak + math.log(w.sum() * cell) + math.log(0.8))
    odds = 0.5 * (float(squares[i, j]) - record.fit_squares) / noise
    return single, double, odds


@pytest.mark.parametrize(
    "late", [[(12.0, 1.5)], [(20.0, 0.5), (6.0, 3.0)], [(-9.0, 2.0)], [(15.0, 0.3), (5.0, 8.0)]]
)
def test_levels_errors_and_evidence_are_integrals_over_all_tails(late):
    fit = fitted(late)
    found = weigh_tails(T, fit)
    single, double, _ = brute_force(TailRecord.of(T, fit))
    for stated, expected in ((found.single, single), (found.double, double)):
        assert stated.level == pytest.approx(expected[0], abs=0.03 * expected[1])
        assert stated.se == pytest.approx(expected[1], rel=0.03)
        # the noise is that of the best pair of the grid, and its memory: known to a percent
        assert stated.log_evidence == pytest.approx(expected[2], rel=0.01)
    odds = found.double.log_evidence - found.single.log_evidence
    # a grid of 28 time constants tells the odds to a quarter; with 112 the numbers are these
    assert odds == pytest.approx(double[2] - single[2], rel=0.01, abs=0.25)


@pytest.mark.parametrize("late", [[(12.0, 1.5)], [(-9.0, 2.0)], [(0.2, 1.5)]])
def test_odds_on_a_fine_grid(late, monkeypatch):
    monkeypatch.setattr(sliding_tail_fit, "POINTS", 112)
    fit = fitted(late)
    found = weigh_tails(T, fit)
    record = TailRecord.of(T, fit)
    single, double, odds = brute_force(record)
    stated = found.double.log_evidence - found.single.log_evidence
    assert stated == pytest.approx(double[2] - single[2], abs=0.03)
    if late == [(0.2, 1.5)]:  # noise hides it: there may be none
        assert math.isnan(fit.tau)
        assert found.single.log_evidence == pytest.approx(single[2], abs=0.02)
        assert found.single.se == pytest.approx(single[1], rel=1e-3)
    assert found.log_odds_of_fit == pytest.approx(odds, abs=0.03)
    # what moves across the tail counts from two on
    moving = replace(record, unexplained=4.0 + 2.0 * 0.7)
    monkeypatch.setattr(TailRecord, "of", lambda *_: moving)
    assert weigh_tails(T, fit).log_odds_of_fit == pytest.approx(found.log_odds_of_fit + 0.7)


def test_record_of_a_tail_is_least_squares_without_it():
    fit = fitted([(12.0, 1.5)])
    record = TailRecord.of(T, fit)
    # one level, no line: the level without a tail is the mean of the series
    series = fit.deviation(T) @ (np.array([1.0, -1.0]) / fit.levels)
    assert fit.lines == ()
    assert record.level == pytest.approx(fit.log_ratio + series[fit.used].mean(), rel=1e-12)
    n = int(fit.used.sum())
    assert record.row == pytest.approx(np.full(n, 1.0 / n), rel=1e-12)
    assert record.rest.mean() == pytest.approx(0.0, abs=1e-12)
    # the tight cell moves by 1/400, the slack one by -0.3/150: how much of each is in the series
    by = fit.combinations.T @ [1.0, -0.3]
    share = by[1] / by[0]
    noise = fit.residual.std() ** 2
    assert record.level_cofactor * n == pytest.approx(1 + share**2, rel=0.1)
    assert noise > 0.0
    low, high_1, high_2 = np.exp(record.log_range)
    assert (low, high_1, high_2) == pytest.approx((0.1, 5.0, 20.0), rel=1e-9)
    short = TailRecord.of(T, replace(fit, tau=0.2))
    assert math.exp(short.log_range[0]) == pytest.approx(0.05, rel=1e-9)  # a quarter of the fit's
    assert record.largest == pytest.approx(0.3 * abs(fit.log_ratio), rel=1e-12)


# --- how the hypotheses of a run and of all runs are put together ---

SINGLE, DOUBLE = Hypothesis(0.90, 0.01, -3.0), Hypothesis(0.87, 0.02, -1.5)


def test_odds_and_probabilities_of_a_run():
    tails = Tails(SINGLE, DOUBLE, 0.7)
    assert tails.log_odds == pytest.approx(1.5 - 0.3, rel=1e-12)
    p = 1.0 / (1.0 + math.exp(-(math.log(0.25 / 0.75) + 1.2)))
    assert tails.probability_of_double(0.25) == pytest.approx(p, rel=1e-12)
    assert tails.probability_of_fit == 1.0
    beside = tails.beside(0.95, 0.005, 0.4)
    assert beside.rival == Hypothesis(0.95, 0.005, pytest.approx(1.1))
    assert tails.beside(0.95, 0.005).rival.log_evidence == 0.7
    assert beside.probability_of_fit == pytest.approx(1.0 / (1.0 + math.exp(-1.1)), rel=1e-12)


def test_level_of_a_run_is_that_of_its_hypotheses():
    tails = Tails(SINGLE, DOUBLE, 0.7)
    p = tails.probability_of_double(0.5)
    # what the second exponential clearly changed is the scale of a third one
    wider = math.sqrt(0.02**2 + 1.5**2 * (0.03**2 - 0.02**2))
    mean = (1 - p) * 0.90 + p * 0.87
    variance = (1 - p) * (0.01**2 + (0.90 - mean) ** 2) + p * (wider**2 + (0.87 - mean) ** 2)
    assert tails.level(0.5, 1.0) == pytest.approx((mean, math.sqrt(variance)), rel=1e-12)
    beside = tails.beside(0.95, 0.005)
    both = 0.6 * mean + 0.4 * 0.95
    spread = 0.6 * (variance + (mean - both) ** 2) + 0.4 * (0.005**2 + (0.95 - both) ** 2)
    assert beside.level(0.5, 0.4) == pytest.approx((both, math.sqrt(spread)), rel=1e-12)
    alike = Tails(SINGLE, replace(DOUBLE, level=0.889), 0.0)  # less than its own error: no third
    p = alike.probability_of_double(0.5)
    mean = (1 - p) * 0.90 + p * 0.889
    variance = (1 - p) * (0.01**2 + (0.90 - mean) ** 2) + p * (0.02**2 + (0.889 - mean) ** 2)
    assert alike.level(0.5, 1.0)[1] == pytest.approx(math.sqrt(variance), rel=1e-12)


def test_share_of_runs_with_a_double_tail_is_the_most_likely_one():
    def run(odds):
        return Tails(Hypothesis(0.0, 1.0, 0.0), Hypothesis(0.0, 1.0, odds + 0.3), 0.0)

    assert share_of_double([]) == 0.5
    odds = np.array([1.5, -0.4, 0.2, 5.0, -9.0, 0.9])
    votes = np.clip(odds, -2.0, 2.0)
    share = np.linspace(0.0, 1.0, 200_001)[1:-1]
    # a run of either kind beforehand
    likely = np.log(share) + np.log(1 - share)
    likely += np.sum(np.log(1 - share + np.exp(votes)[:, None] * share), axis=0)
    found = share_of_double([run(x) for x in odds])
    assert found == pytest.approx(float(share[np.argmax(likely)]), abs=2e-5)

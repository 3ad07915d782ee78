"""The choice of runs, against closed forms, exhaustive search and another program."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from beltid.plan.knowledge import Knowledge, RunRows, choose_runs


def line(x: np.ndarray, shared: float = 0.0, arcs: int = 1) -> RunRows:
    """Runs of unit noise on a straight line a + b x, with one error that all share."""
    return RunRows(
        J=np.column_stack([np.ones(x.size), x]),
        S=np.full((x.size, 1), shared),
        variance=np.ones(x.size),
        arc=np.arange(x.size) % arcs,
    )


VAGUE = Knowledge(1.0e6 * np.eye(2), np.zeros((2, 1)))
# mean of a² + 2 a b x + b² x² over -1 <= x <= 1
MEAN_OVER_LINE = np.diag([1.0, 1.0 / 3.0])


@pytest.mark.parametrize(("shared", "runs"), [(0.0, 6), (0.3, 8)])
def test_runs_of_a_straight_line_are_at_its_ends(shared, runs):
    x = np.linspace(-1.0, 1.0, 21)
    chosen = choose_runs(VAGUE, line(x, shared), MEAN_OVER_LINE, runs)
    assert [x[i] for i in chosen] == [-1.0] * (runs // 2) + [1.0] * (runs // 2)
    # mean variance (1 + 1/3) / n, and the shared error whole, however many runs
    after = VAGUE.after(line(x, shared), chosen).variance(MEAN_OVER_LINE)
    assert after == pytest.approx(4.0 / 3.0 / runs + shared**2, rel=1e-4)


def test_arcs_with_errors_of_their_own_share_the_runs():
    # one level, two arcs; on the first the noise is smaller, on each an error u of its own: weights
    # w_k by noise, variance 1 / sum(w) + u² (w_1² + w_2²) / (w_1 + w_2)²
    noise, u = np.array([1.0, 1.5]), 0.5
    runs = RunRows(np.ones((2, 1)), u * np.eye(2), noise**2, np.arange(2))
    nothing = Knowledge(np.array([[1.0e8]]), np.zeros((1, 2)))

    def variance(first: int) -> float:
        w = np.array([first, 20 - first]) / noise**2
        return float(1.0 / w.sum() + u**2 * (w @ w) / w.sum() ** 2)

    best = min(range(1, 20), key=variance)
    chosen = choose_runs(nothing, runs, np.eye(1), 20)
    assert chosen.count(0) == best
    assert nothing.after(runs, chosen).variance(np.eye(1)) == pytest.approx(variance(best), 1e-6)
    # were the errors known, all but the one run that is asked for would be on the quiet arc
    known = RunRows(runs.J, 0.0 * runs.S, runs.variance, runs.arc)
    assert choose_runs(nothing, known, np.eye(1), 20).count(0) == 19


def a_model(seed: int, n: int, size: int = 3) -> tuple[Knowledge, RunRows, np.ndarray, np.ndarray]:
    """A random linear model: knowledge, candidates, weights, and the precision before."""
    rng = np.random.default_rng(seed)
    root, weights = rng.normal(size=(2, size, size))
    precision = root @ root.T + 0.1 * np.eye(size)
    runs = RunRows(
        rng.normal(size=(n, size)),
        0.5 * rng.normal(size=(n, 2)),
        rng.uniform(0.5, 2.0, n),
        np.arange(n) % 2,
    )
    before = Knowledge(np.linalg.inv(precision), np.zeros((size, 2)))
    return before, runs, weights @ weights.T, precision


def variance_by_hand(
    precision: np.ndarray, runs: RunRows, W: np.ndarray, chosen: list[int]
) -> float:
    """The normal equations of the weighted fit, and what a shared error does to its solution."""
    J, S, v = runs.J[chosen], runs.S[chosen], runs.variance[chosen]
    covariance = np.linalg.inv(precision + J.T @ (J / v[:, None]))
    changes = covariance @ J.T @ (S / v[:, None])
    return float(np.trace(W @ (covariance + changes @ changes.T)))


def test_knowledge_after_runs_is_that_of_the_weighted_fit_in_any_order():
    before, runs, W, precision = a_model(seed=1, n=12)
    chosen = [3, 7, 7, 0, 11, 3, 3]
    by_hand = variance_by_hand(precision, runs, W, chosen)
    assert before.after(runs, chosen).variance(W) == pytest.approx(by_hand, rel=1e-10)
    step = before
    for i in reversed(chosen):
        step = step.after(runs, [i])
    assert step.variance(W) == pytest.approx(by_hand, rel=1e-10)
    # one run more, all candidates at once
    each = step.variance_after_one(runs, W)
    direct = [variance_by_hand(precision, runs, W, [*chosen, i]) for i in range(12)]
    np.testing.assert_allclose(each, direct, rtol=1e-9)


def best_of_all(precision: np.ndarray, runs: RunRows, W: np.ndarray, count: int) -> float:
    """The smallest variance of any choice of so many runs with two arcs and a repetition."""
    n = runs.variance.size
    return min(
        variance_by_hand(precision, runs, W, list(choice))
        for choice in itertools.combinations_with_replacement(range(n), count)
        if np.unique(runs.arc[list(choice)]).size == 2 and len(set(choice)) < count
    )


def test_greedy_with_exchange_comes_within_5_percent_of_the_best_choice():
    over = []
    for seed in range(8):
        before, runs, W, precision = a_model(seed, n=7)
        chosen = choose_runs(before, runs, W, 6)
        best = best_of_all(precision, runs, W, 6)
        over.append(variance_by_hand(precision, runs, W, chosen) / best - 1.0)
    assert min(over) > -1e-9
    assert max(over) < 0.05


@pytest.mark.parametrize("count", [2, 3, 6])
def test_a_plan_has_two_arcs_and_a_repeated_run_though_the_noise_asks_for_neither(count):
    x = np.linspace(-1.0, 1.0, 10)
    runs = line(x, arcs=2)
    quiet = RunRows(runs.J, runs.S, np.where(runs.arc == 0, 1.0, 50.0), runs.arc)
    chosen = choose_runs(VAGUE, quiet, MEAN_OVER_LINE, count)
    assert len(chosen) == count
    assert set(runs.arc[chosen]) == {0, 1}
    assert (len(set(chosen)) < count) == (count >= 3)


def test_the_same_candidates_give_the_same_plan():
    before, runs, W, _ = a_model(seed=5, n=30)
    first = choose_runs(before, runs, W, 9)
    assert all(choose_runs(before, runs, W, 9) == first for _ in range(3))
    # candidates that are worth the same: the first of them
    twice = RunRows(
        *(np.concatenate([part, part]) for part in (runs.J, runs.S)),
        *(np.concatenate([part, part]) for part in (runs.variance, runs.arc)),
    )
    assert choose_runs(before, twice, W, 9) == first


# A decay exp(-g t), g unknown, noise 0.005 (1 + t): the time that NIST's optbayesexpt measures at
# next, and its mean of g before and after the datum, its standard deviation of g after. Computed
# with the particle update and the utility `variance_approx` of its source (obe_base.py,
# particlepdf.py): 400,000 particles of a prior N(1.0, 0.06²) without resampling, 4000 draws, times
# 0.05, 0.10, ..., 4.00, true g = 1.05, noise of the data 0.3, -1.1, 0.7, 0.1, -0.4, 1.2, -0.6, 0.2
# standard deviations.
OPTBAYESEXPT = (
    (0.60, 1.00003, 1.03662, 0.02291),
    (0.60, 1.03662, 1.05544, 0.01705),
    (0.60, 1.05544, 1.04818, 0.01408),
    (0.60, 1.04818, 1.04801, 0.01228),
    (0.60, 1.04801, 1.05034, 0.01104),
    (0.60, 1.05034, 1.04540, 0.01007),
    (0.60, 1.04540, 1.04814, 0.00936),
    (0.60, 1.04814, 1.04775, 0.00876),
)
TIMES = np.arange(0.05, 4.0001, 0.05)


def decay(rate: float) -> RunRows:
    """A datum at each time, linear about a rate."""
    return RunRows(
        J=(-TIMES * np.exp(-rate * TIMES))[:, None],
        S=np.zeros((TIMES.size, 0)),
        variance=np.square(0.005 * (1.0 + TIMES)),
        arc=np.zeros(TIMES.size, dtype=int),
    )


def test_a_sequence_for_one_parameter_is_that_of_optbayesexpt():
    before, data = Knowledge(np.array([[0.06**2]]), np.zeros((1, 0))), []
    known = before
    for time, mean, mean_after, deviation in OPTBAYESEXPT:
        (chosen,) = choose_runs(known, decay(mean), np.eye(1), 1)
        # its draws decide between neighbours at a flat optimum
        assert TIMES[chosen] == pytest.approx(time, abs=0.051)
        # what is known, linear about where the data lead, as a fit is
        data.append(int(np.argmin(np.abs(TIMES - time))))
        known = before.after(decay(mean_after), data)
        assert math.sqrt(known.scatter[0, 0]) == pytest.approx(deviation, rel=0.015)

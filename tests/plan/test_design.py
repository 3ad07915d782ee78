"""The choice of runs, against closed forms, exhaustive search and another program; the session."""

import itertools
import math

import numpy as np
import pytest

from beltid.plan.design import (
    Knowledge,
    RunRows,
    Target,
    choose_plan,
    choose_runs,
    schedule,
    surface_target,
)
from beltid.refine.posterior import Curves
from beltid.uncertainty.sources import Source


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
    runs = line(np.linspace(-1.0, 1.0, 10), arcs=2)
    quiet = RunRows(runs.J, runs.S, np.where(runs.arc == 0, 1.0, 50.0), runs.arc)
    chosen = choose_runs(VAGUE, quiet, MEAN_OVER_LINE, count)
    assert len(chosen) == count
    assert set(runs.arc[chosen]) == {0, 1}
    assert (len(set(chosen)) < count) == (count >= 3)


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


# --- when to stop, what would help, and the order of the runs ---

GAIN = Source("gain of the torque", "torque_gain", 0, 0.01, "%", 0.01, "stated")
ARC = Source("contact arc", "arc", 0, 0.002, "deg", math.pi / 180.0, "assumed")
TAIL = Source("shape of the tail", "shared_tail", 0, 1.0, "1", 1.0, "fitted")
SOURCES = (GAIN, ARC, TAIL)
# one level of ln mu, wanted at four places
TARGET = Target(
    normal_force=np.array([1e3, 1e3, 8e3, 8e3]),
    slip_speed=np.array([0.001, 0.1, 0.001, 0.1]),
    weight=np.full(4, 0.25),
    rows=np.ones((4, 1)),
)


def level_runs(noise: float, shared: tuple[float, float, float]) -> RunRows:
    return RunRows(
        np.ones((4, 1)), np.tile(shared, (4, 1)), np.full(4, noise**2), np.array([0, 0, 1, 1])
    )


def known_by(runs: RunRows, count: int) -> Knowledge:
    return Knowledge(np.array([[1e6]]), np.zeros((1, 3))).after(runs, [0, 2] * (count // 2))


def test_as_few_runs_as_reach_the_goal():
    # of unit noise, after n runs the variance is 1/n: 0.25² asks for 16, four are there
    runs = level_runs(1.0, (0.0, 0.0, 0.0))
    plan = choose_plan(known_by(runs, 4), runs, TARGET, SOURCES, 20, goal=0.25)
    assert plan.stop is None
    assert len(plan.chosen) == 12
    assert plan.before == pytest.approx(0.5, rel=1e-5)
    assert plan.after == pytest.approx(0.25, rel=1e-5)
    assert plan.shared == pytest.approx(0.0, abs=1e-12)
    # one of 12 + 4 left out: sqrt(16 / 15)
    np.testing.assert_allclose(list(plan.gains.values()), math.sqrt(16.0 / 15.0) - 1.0, rtol=1e-4)
    assert [row["after_percent"] for row in plan.regions] == pytest.approx([25.0] * 4, rel=1e-5)


def test_stop_where_shared_errors_remain_with_the_statement_that_helps_most():
    runs = level_runs(0.01, (0.03, 0.04, 0.05))
    plan = choose_plan(known_by(runs, 20), runs, TARGET, SOURCES, 12, goal=0.01)
    scatter, shared = 0.01**2 / 20, 0.03**2 + 0.04**2 + 0.05**2
    assert plan.stop == "shared errors remain"
    assert plan.chosen == ()
    assert plan.shared == pytest.approx(shared / (shared + scatter), rel=1e-6)
    assert [one.source for one in plan.statements] == [TAIL, ARC, GAIN]
    # what the reduction shares no statement shrinks: the larger of the others helps most
    arc = plan.best_statement
    assert arc is not None
    assert arc.source == ARC
    assert arc.contribution == pytest.approx(0.04, rel=1e-6)
    assert arc.halved == pytest.approx(math.sqrt(shared + scatter - 0.75 * 0.04**2), rel=1e-6)


def test_runs_in_both_directions_where_the_gain_of_the_cells_is_not_known():
    gains = tuple(
        Source("gain of each load cell", "cell_gain", k, 0.01, "%", 0.01, "stated") for k in (0, 1)
    )
    runs = RunRows(
        np.ones((4, 1)),
        np.tile([0.01, -0.01], (4, 1)),
        np.full(4, 0.001**2),
        np.array([0, 0, 1, 1]),
    )
    before = Knowledge(np.array([[1e6]]), np.zeros((1, 2)))
    one_way = choose_plan(before, runs, TARGET, gains, 4, goal=0.0)
    assert one_way.after == pytest.approx(0.01 * math.sqrt(2.0), rel=0.01)
    both = choose_plan(before, runs, TARGET, gains, 4, goal=0.0, can_reverse=True)
    # as many one way as the other: what is left is the noise
    assert sum(i >= 4 for i in both.chosen) == 2
    assert both.after == pytest.approx(0.001 / 2.0, rel=0.01)


def test_stop_where_runs_are_too_noisy_to_help():
    quiet = level_runs(0.1, (0.0, 0.0, 0.0))
    noisy = level_runs(30.0, (0.0, 0.0, 0.0))
    plan = choose_plan(known_by(quiet, 20), noisy, TARGET, SOURCES, 12, goal=0.001)
    assert plan.stop == "runs do not help"


def test_a_run_that_the_plan_has_to_have_is_named_where_it_gains_nothing():
    # the second arc has a large error of its own: one run there is all that is taken
    runs = level_runs(1.0, (0.0, 0.0, 0.0))
    runs = RunRows(runs.J, np.array([[0.0], [0.0], [5.0], [5.0]]), runs.variance, runs.arc)
    before = Knowledge(np.array([[0.25]]), np.zeros((1, 1)))
    plan = choose_plan(before, runs, TARGET, (ARC,), 6, goal=0.0)
    # four runs before, then six: 1/10 + (5/10)²; without that run 1/9
    (second,) = [i for i in plan.chosen if runs.arc[i] == 1]
    assert plan.needed == {second: "arc"}
    gains = dict(plan.gains)
    assert gains.pop(second) == pytest.approx(math.sqrt((1 / 9) / 0.35) - 1.0, rel=1e-6)
    assert min(gains.values()) > 0.0


def test_runs_that_make_it_worse_by_what_they_share_are_left_out():
    # unit variance before; n runs of unit noise with a shared error of one weigh n/(n + 1):
    # 1/(n + 1) + (n/(n + 1))² is least for one run
    runs = RunRows(np.ones((2, 1)), np.ones((2, 1)), np.ones(2), np.zeros(2, dtype=np.intp))
    before = Knowledge(np.ones((1, 1)), np.zeros((1, 1)))
    plan = choose_plan(before, runs, TARGET, (ARC,), 2, goal=0.0)
    assert len(plan.chosen) == 1
    assert plan.after == pytest.approx(math.sqrt(0.75), rel=1e-12)


def test_the_surface_target_is_uniform_in_the_logarithms():
    curves = Curves(np.log(np.geomspace(500.0, 9000.0, 7)), np.log([0.001, 0.002, 0.004, 0.2]))
    target = surface_target(curves, (1000.0, 8000.0), (0.002, 0.2))
    assert target.weight.sum() == pytest.approx(1.0)
    # mean of (ln f)² over the range, and of ln v: the middle, wherever its speeds are
    power = np.tile(curves.log_force - np.log(1000.0), 4)
    range_ = np.log(8.0)
    assert power @ target.W @ power == pytest.approx(range_**2 / 3.0, rel=0.02)
    rising = np.repeat(curves.log_speed, 7)
    mean = target.weight @ (target.rows @ rising)
    assert mean == pytest.approx(np.log([0.002, 0.2]).mean(), rel=1e-12)
    # a bench misses the speeds that it is set to
    missed = surface_target(curves, (1000.0, 8000.0), (0.00203, 0.197))
    np.testing.assert_allclose(missed.W, target.W, rtol=1e-12)


def test_a_session_changes_the_arc_least_and_repeats_last():
    settings = [
        (arc, T, w) for arc in (40.0, 82.0) for T in (50.0, 100.0, 200.0) for w in (1.0, 2.0)
    ]
    chosen = [0, 2, 4, 5, 6, 7, 7, 7, 8, 10, 11]
    runs = schedule(chosen, settings, 5.0, 30.0)
    assert sorted(one.run for one in runs) == chosen
    arcs = [settings[one.run][0] for one in runs]
    assert arcs == sorted(arcs)
    assert [one.start_minutes for one in runs] == [0, 5, 10, 15, 50, 55, 60, 65, 70, 75, 80]
    at = [place for place, one in enumerate(runs) if one.run == 7]
    assert at == [4, 9, 10]  # first, and again after all others of its arc
    assert [runs[k].repeat for k in at] == [1, 2, 3]
    assert {runs[k].repeats for k in at} == {3}
    # up through every other one, down through those between
    assert [one.run for one in runs[:8]] == [0, 4, 5, 2, 7, 6, 8, 11]

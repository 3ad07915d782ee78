"""When to stop, what would help, and the order of the runs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from beltid.plan.advice import Target, choose_plan, schedule, surface_target
from beltid.plan.knowledge import Knowledge, RunRows, needed_for
from beltid.refine.posterior import Curves
from beltid.uncertainty.sources import Source

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
    assert plan.gains == pytest.approx([math.sqrt(16.0 / 15.0) - 1.0] * 12, rel=1e-4)
    assert [region.after for region in plan.regions] == pytest.approx([0.25] * 4, rel=1e-5)


def test_stop_where_the_goal_is_reached():
    runs = level_runs(1.0, (0.0, 0.0, 0.0))
    plan = choose_plan(known_by(runs, 20), runs, TARGET, SOURCES, 12, goal=0.25)
    assert (plan.stop, plan.chosen, plan.after) == ("goal reached", (), plan.before)


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
    gains = dict(zip(plan.chosen, plan.gains, strict=True))
    assert gains.pop(second) == pytest.approx(math.sqrt((1 / 9) / 0.35) - 1.0, rel=1e-6)
    assert min(gains.values()) > 0.0


def test_the_only_repetition_is_needed():
    runs = RunRows(np.eye(3)[[0, 1]], np.zeros((2, 0)), np.ones(2), np.array([0, 1]))
    assert needed_for(runs, [0, 0, 1], 3) == {0: "repetition", 1: "arc"}
    assert needed_for(runs, [0, 0, 0, 1, 1], 5) == {}


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


def test_a_session_changes_the_arc_least_and_spreads_repetitions():
    settings = [
        (arc, T, w) for arc in (40.0, 82.0) for T in (50.0, 100.0, 200.0) for w in (1.0, 2.0)
    ]
    chosen = [0, 2, 4, 5, 6, 7, 7, 7, 8, 10, 11]
    runs = schedule(chosen, settings, 5.0, 30.0)
    assert sorted(one.run for one in runs) == chosen
    arcs = [settings[one.run][0] for one in runs]
    assert arcs == sorted(arcs)
    starts = [one.start_minutes for one in runs]
    assert starts == [0, 5, 10, 15, 50, 55, 60, 65, 70, 75, 80]
    at = [place for place, one in enumerate(runs) if one.run == 7]
    assert at == [4, 7, 10]  # first, middle and last of its arc
    assert [runs[k].repeat for k in at] == [1, 2, 3]
    assert {runs[k].repeats for k in at} == {3}
    # up through every other one, down through those between
    assert [one.run for one in runs[:4]] == [0, 4, 5, 2]

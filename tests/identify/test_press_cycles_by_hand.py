"""Cycles of presses of a few samples, and the curves of their branches, counted by hand."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from beltid.errors import InputError
from beltid.identify.press.curves import press_curve
from beltid.identify.press.recording import (
    PressCycle,
    PressTest,
    choose_cycles,
    find_cycles,
    turning_points,
)


def cycles_of(travel, force=None):
    """Cycles of a test whose force is its travel, if no other is given."""
    x = np.asarray(travel, float)
    return find_cycles(x, x if force is None else np.asarray(force, float))


def path(*corners):
    """Every whole number on the way from corner to corner."""
    ways = [np.arange(a, b, np.sign(b - a)) for a, b in pairwise(corners)]
    return np.concatenate([*ways, [corners[-1]]])


def ends(found):
    return [(c.loading.start, c.loading.stop, c.unloading.start, c.unloading.stop) for c in found]


@pytest.mark.parametrize(
    ("travel", "expected"),
    [
        ([0, 1, 2, 3], [0, 3]),
        ([0, 1, 3, 2.5, 3, 5], [0, 5]),  # back by half: no turn
        ([0, 1, 3, 1.9, 3, 5], [0, 2, 3, 5]),
        ([0, 3, 0, 3, 0], [0, 1, 2, 3, 4]),
        ([0, 3, 2.0, 4], [0, 3]),  # back by one, and no more
        ([2, 0, 3], [0, 1, 2]),
        ([0, 3, 0, 0.5], [0, 1, 2]),  # what is left is no turn: the end is the lowest point
        ([0, 0.2, 0.1], [0, 2]),
        ([2, 1.5, 1, 0.5, 0, 0.5], [0, 4]),  # in small steps
        ([0, 3, 3, 0, 0, 3], [0, 1, 3, 5]),  # the first of equal extremes
    ],
)
def test_turns_are_ways_back_beyond_the_threshold(travel, expected):
    assert turning_points(np.array(travel, float), 1.0).tolist() == expected


def test_cycles_share_their_turning_points():
    first, second = cycles_of(path(0, 10, 0, 12, 3))
    assert ends([first, second]) == [(0, 11, 10, 21), (20, 33, 32, 42)]
    assert (first.number, first.peak_force_N, first.complete) == (1, 10.0, True)
    assert (second.number, second.peak_force_N, second.complete) == (2, 12.0, True)
    # the way down before the first cycle belongs to none
    assert ends(cycles_of(path(5, 0, 12, 0))) == [(5, 18, 17, 30)]
    assert ends(cycles_of(path(0, 10))) == [(0, 11, 10, 11)]


@pytest.mark.parametrize(("least", "complete"), [(4.9, True), (5.0, False), (5.4, False)])
def test_a_cycle_is_complete_from_below_half_its_peak(least, complete):
    way = path(0, 10, 5)
    force = way.astype(float)
    force[-1] = least
    (cycle,) = cycles_of(way, force)
    assert cycle.complete == complete
    # the crosshead has to come back: a loss of force at the end of the way is none
    (cycle,) = cycles_of(path(0, 10), [*range(10), 4])
    assert (cycle.complete, cycle.peak_force_N) == (False, 9.0)
    (cycle,) = cycles_of(path(0, 10))
    assert (cycle.complete, cycle.peak_force_N) == (False, 10.0)


@pytest.mark.parametrize(("preload", "cycles"), [(49, 1), (50, 2)])
def test_a_preload_below_half_the_largest_force_is_no_cycle(preload, cycles):
    found = cycles_of(path(0, preload, 0, 100, 0))
    assert len(found) == cycles
    assert found[-1].number == cycles
    assert found[-1].loading == slice(2 * preload, 2 * preload + 101)


def test_a_crosshead_that_only_lifts_has_no_cycle():
    with pytest.raises(InputError, match="no loading found"):
        cycles_of(path(10, 0), path(10, 0))


def cycle(number, complete=True):
    part = slice(0, 1)
    return PressCycle(number, part, part, 1.0, complete)


PARTLY = (cycle(1, False), cycle(2), cycle(3), cycle(4, False))
WHOLE = (cycle(2), cycle(3), cycle(5))
OPEN = (cycle(1, False), cycle(4, False), cycle(6, False))


@pytest.mark.parametrize(
    ("cycles", "choice", "chosen", "said"),
    [
        (PARTLY, "all", (2, 3), "2 cycles without unloading left out"),
        (PARTLY, "first", (2,), "cycle 1 is not unloaded, cycle 2 used in its place"),
        (PARTLY, "last", (3,), "cycle 4 is not unloaded, cycle 3 used in its place"),
        (WHOLE, "all", (2, 3, 5), ""),
        (WHOLE, "first", (2,), ""),
        (WHOLE, "last", (5,), ""),
        (OPEN, "all", (1, 4, 6), "never unloaded"),
        (OPEN, "first", (1,), "never unloaded"),
        (OPEN, "last", (6,), "never unloaded"),
    ],
)
def test_choice_of_cycles(cycles, choice, chosen, said):
    kept, notes = choose_cycles(cycles, choice)
    assert tuple(c.number for c in kept) == chosen
    used = f"{len(cycles)} cycles found, used: {', '.join(map(str, chosen))}"
    assert notes == (*filter(None, [said]), *([used] if cycles is not OPEN else []))


# --- curves of the branches ---


def press(x, force):
    """A test without noise."""
    return PressTest("A", 22.0, np.arange(x.size), x, x, force, -1.0, 0.0, 0.0, True, 0, 0, ())


def loop(width=10.0, n=101):
    """Loading along F = x + width, unloading along F = x - width; a segment of half a metre."""
    up = np.linspace(0.0, 100.0, n)
    x = np.concatenate([up, up[-2::-1]])
    test = press(x, np.concatenate([up + width, up[-2::-1] - width]))
    return test, PressCycle(3, slice(0, n), slice(n - 1, 2 * n - 1), 100.0 + width, True)


def test_curve_half_way_between_two_straight_branches():
    curve = press_curve(*loop(), 0.5)
    assert (curve.test, curve.cycle, curve.recorded.travel_sign) == ("A", 3, -1.0)
    # force per metre: twice the force; both branches carry 1 % of 110 N from 11.1 mm on
    half = 0.5 * (curve.position_m[1] - curve.position_m[0])
    low, high = curve.position_m[0] - half, curve.position_m[-1] + half
    assert (low, high) == (pytest.approx(11.0, rel=1e-12), pytest.approx(99.0, abs=1.0))
    assert [(b.position_m.min(), b.position_m.size) for b in curve.fitted] == [(11.0, 89)] * 2
    assert curve.middle_N_m == pytest.approx(2.0 * curve.position_m, rel=1e-9)
    # a node for every four samples of the branch that has fewer, in the middles of equal bins
    count = int(high - low + 1) // 4
    edges = np.linspace(low, high, count + 1)
    assert curve.position_m == pytest.approx(0.5 * (edges[1:] + edges[:-1]), rel=1e-12)
    assert curve.unloads
    # the loading branch carries force everywhere: its ends are running medians of five samples
    assert (curve.touch_m, curve.top_position_m, curve.top_force_N_m) == (1.0, 99.0, 218.0)
    # loading: 2 (50 + 10) 100; unloading 8000, and 20 for the sample that both branches share
    assert curve.dissipated_J_m == pytest.approx(3980.0, rel=1e-9)
    assert curve.stored_J_m == pytest.approx(12000.0, rel=1e-9)


@pytest.mark.parametrize(("inside", "enough"), [(7, False), (8, True)])
def test_eight_samples_of_each_branch_are_enough(inside, enough):
    """Loading alone along a law through zero; contact begins at the sample at zero."""
    x = np.arange(float(inside + 1))
    force = np.concatenate([[0.0], x[1:] + 10.0])
    cycle = PressCycle(1, slice(0, x.size), slice(x.size - 1, x.size), float(x[-1]), False)
    # the running median of five takes the last sample off
    if not enough:
        with pytest.raises(InputError, match="cycle 1: 7 loading samples"):
            press_curve(press(x, force), cycle, 0.5)
        return
    curve = press_curve(press(x, force), cycle, 0.5)
    assert not curve.unloads
    assert curve.position_m.size == 6

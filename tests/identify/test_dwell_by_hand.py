"""Samples of a dwell, counted by hand on travels of a few samples."""

from __future__ import annotations

import numpy as np
import pytest

from beltid.identify.press.dwell import moving_part


def kept(steps, *, force=1.0, dt=0.1, branch=None, noise=0.0, start=0.0):
    """Samples that move, for a travel that begins at zero and goes on in these steps."""
    travel = np.concatenate([[0.0], np.cumsum(steps)])
    time = start + np.concatenate([[0.0], np.cumsum(np.broadcast_to(dt, len(steps)))])
    load = np.broadcast_to(np.asarray(force, float), travel.shape)
    found = moving_part(time, travel, load, branch or slice(0, travel.size), noise)
    return found.tolist()


def whole(n):
    return list(range(n))


def test_the_half_window_grows_until_the_noise_leaves_the_speed():
    # eight samples hold eight half windows of one; the error of the speed is sqrt(2) noise then
    short = [1, 1, 1, 0, 0, 0, 0]
    assert kept(short, noise=0.03 / np.sqrt(2.0) * 0.99) == [0, 1, 2]
    assert kept(short, noise=0.03 / np.sqrt(2.0) * 1.01) == whole(8)
    assert kept(short[:-1]) == whole(7)
    # with two samples on either side it is noise / 2, with four noise / sqrt(32)
    long = [1] * 99 + [0] * 60
    assert kept(long, noise=0.055) == whole(99)
    for noise in (0.061, 0.16):
        found = kept(long, noise=noise)
        assert found[:90] == whole(90)
        assert found[-1] in (96, 97)
    # with eight noise / (8 sqrt(4)); eight windows of eight need 64 samples
    half = [1] * 40 + [0] * 23
    assert kept(half, noise=0.18)[-1] < 40
    assert kept(half[:-1], noise=0.18) == whole(63)


def test_a_record_of_one_sample_moves():
    assert kept([]) == [0]


@pytest.mark.parametrize(("share", "moves"), [(0.141, False), (0.159, True)])
def test_what_stands_is_slower_than_three_twentieths_of_the_branch(share, moves):
    assert kept([1] * 30 + [share] * 20) == whole(51 if moves else 30)


@pytest.mark.parametrize(("force", "fast_only"), [(2.0, False), (4.9, False), (5.2, True)])
def test_the_way_to_the_belt_carries_less_than_a_twentieth_of_the_force(force, fast_only):
    load = np.concatenate([np.full(20, force), np.linspace(10.0, 100.0, 21)])
    found = kept([10] * 19 + [1] * 21, force=load)
    assert found == whole(19 if fast_only else 41)


def test_without_force_there_is_no_speed_of_the_branch():
    assert kept([1] * 20 + [0] * 20, force=0.0) == whole(41)
    # a single sample under force has one: that of the last step
    load = np.zeros(41)
    load[-1] = 1.0
    assert kept([0.1] * 20 + [1] * 20, force=load) == list(range(21, 41))


@pytest.mark.parametrize(("slow", "expected"), [(52, whole(59)), (40, list(range(41, 47)))])
def test_the_speed_of_the_branch_is_that_above_which_half_the_way_is_made(slow, expected):
    """Slow by 1 per sample, fast by 8: the ways are 52 and 52.5, or 40 and 52.5."""
    assert kept([1] * slow + [8] * 6) == expected


def test_slow_is_slow_in_time():
    steps = np.repeat([0.001, 0.1], [39, 40])
    assert kept([1] * 79, dt=steps) == whole(38)
    doubled = steps.copy()
    doubled[10] = 0.0  # two samples at the same time
    assert kept([1] * 79, dt=doubled) == whole(38)
    doubled[11] = 0.0  # three: that in their middle has no speed
    assert kept([1] * 79, dt=doubled) == [i for i in range(38) if i != 11]
    # a clock that runs back, stops or is not known is no clock: the samples are even then
    for back in (-0.0005, np.nan):
        wrong = steps.copy()
        wrong[10] = back
        assert kept([1] * 79, dt=wrong) == whole(80)
    assert kept([1] * 79, dt=np.where(np.arange(79) < 45, 0.0, steps)) == whole(80)


def test_large_numbers_on_the_clock_cost_no_digits():
    steps, dt = [2**-20] * 12_000 + [0] * 20, 2**-10
    assert kept(steps, dt=dt, start=1.7e9) == kept(steps, dt=dt) == whole(12_000)


def test_a_dwell_is_widened_at_both_ends():
    assert kept([0] * 9 + [1] * 20) == list(range(10, 30))
    assert kept([1] * 20 + [0, 0, 0] + [1] * 20) == [i for i in range(44) if not 20 <= i < 24]
    # as short as the window: the sample alone
    assert kept([1] * 20 + [0, 0] + [1] * 20) == [i for i in range(43) if i != 21]
    # after one sample that moves; a crosshead that chatters stands from its second sample on
    assert kept([1] + [0] * 9 + [1] * 20) == [0, *range(11, 31)]
    assert kept([1, -1] * 5 + [1] * 20) == list(range(12, 31))


@pytest.mark.parametrize("hold", [38, 39])
def test_a_dwell_of_more_than_half_the_branch_is_part_of_it(hold):
    """Of 40 + hold samples hold + 1 stand."""
    found = kept([1] * 19 + [0] * hold + [1] * 20)
    assert (found == whole(39 + hold + 1)) == (hold == 39)
    assert len(found) == (39 if hold == 38 else 79)
    # dwells at the ends are left out in either case, and a sample beside each with them
    found = kept([0] * 9 + [1] * 19 + [0] * (hold - 2) + [1] * 20 + [0] * 9)
    assert (found[0], found[-1]) == (10, 45 + hold)
    assert len(found) == (37 if hold == 38 else 36 + hold)


def test_all_samples_of_a_single_jump_are_kept():
    assert kept([0] * 19 + [1] + [0] * 20) == whole(41)


def test_the_speed_at_the_ends_of_a_branch_is_known_from_beyond_them():
    steps = [1] * 10 + [0, 0] + [1] * 37
    assert kept(steps, branch=slice(10, 50)) == [10, *range(12, 50)]
    assert kept(steps, branch=slice(0, 13)) == [*range(11), 12]

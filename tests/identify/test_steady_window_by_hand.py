"""Steady windows of signals whose blocks are known by hand: limits from both sides."""

from __future__ import annotations

import numpy as np
import pytest
from beltid.identify.friction.plateau import PlateauCriteria, settle
from beltid.identify.friction.steady_window import steady_window

from beltid.identify.friction.rest_phase import SetAsideError

WHITE = 1.482602218505602 * 2.0 / np.sqrt(2.0)
"""White noise that first differences tell of a signal that goes up and down by one."""


def window(signal, tolerance=1.0, *, t=None, min_samples=1, min_fraction=0.0):
    """First sample of the window and the change over it; None without a window."""
    x = np.asarray(signal, float)
    time = np.arange(float(x.size)) if t is None else np.asarray(t, float)
    found = steady_window(time, x, tolerance, min_samples=min_samples, min_fraction=min_fraction)
    return None if found is None else (found.first, pytest.approx(found.change, abs=1e-12))


def blocks(values, size=5, noise=0.0):
    """Samples of even blocks: up and down by the noise around each value."""
    x = np.repeat(np.asarray(values, float), size)
    return x + noise * (-1.0) ** np.arange(x.size)


def test_blocks_that_fill_the_signal_are_preferred():
    # 101 samples: 20 blocks of 5 and one sample over, 24 of 4 and five over
    assert window(np.zeros(101)) == (1, 0.0)
    assert window(np.zeros(120)) == (0, 0.0)
    # 98 samples: of 19 to 24 blocks 19 leave 3, 20 leave 18, 21 leave 14, 22, 23, 24 leave 2 or 6
    assert window(np.zeros(98)) == (98 - 24 * 4, 0.0)
    # 95 samples: 19 blocks of 5 leave none
    assert window(np.zeros(95)) == (0, 0.0)
    # 108 samples: 18 would leave none but are too few, 21 leave three
    assert window(np.zeros(108)) == (3, 0.0)
    # 125 samples: 25 blocks would leave none but are too many
    assert window(np.zeros(125)) == (5, 0.0)
    # four blocks at least, four samples each where there are few
    assert window(np.zeros(4)) == (0, 0.0)
    assert window(np.zeros(7)) == (3, 0.0)
    assert window(np.zeros(27)) == (27 - 5 * 5, 0.0)
    assert window(np.zeros(3)) is None


def test_a_window_is_as_long_as_asked():
    for least in (20, 21):
        expected = (0, 0.0) if least == 20 else None
        assert window(np.zeros(20), min_samples=least) == expected
    # after a step of two blocks 110 of 120 samples are level
    step = blocks([9.0] * 2 + [0.0] * 22)
    assert window(step, min_samples=110) == (10, 0.0)
    assert window(step, min_samples=111) is None
    assert window(step, min_fraction=110 / 120) == (10, 0.0)
    assert window(step, min_fraction=110.1 / 120) is None


def test_a_window_of_no_duration_is_none():
    assert window(np.zeros(120), t=np.zeros(120)) is None
    # the clock stands in the second half
    t = np.minimum(np.arange(120.0), 60.0)
    assert window(blocks([9.0] * 12 + [0.0] * 12), t=t) is None


def test_slope_is_the_median_over_all_pairs_of_blocks():
    # a straight line: block means are four samples apart
    x = 0.01 * np.arange(96.0)
    assert window(x) == (0, 0.01 * 92.0)
    uneven = np.array([0.0, 0.3, 0.1, 0.5])
    t = np.repeat([10.0, 11.0, 13.0, 14.0], 4)
    slopes = [0.3 / 1, 0.1 / 3, 0.5 / 4, -0.2 / 2, 0.2 / 3, 0.4 / 1]
    assert window(blocks(uneven, 4), t=t) == (0, float(np.median(slopes)) * 4.0)
    # pairs at the same time tell no slope
    t = np.repeat([10.0, 10.0, 13.0, 14.0], 4)
    slopes = [0.1 / 3, 0.5 / 4, -0.2 / 3, 0.2 / 4, 0.4 / 1]
    assert window(blocks(uneven, 4), t=t) == (0, float(np.median(slopes)) * 4.0)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("start", [0.0, 50.0])
def test_change_within_the_tolerance(sign, start):
    for change, first in ((0.98, 0), (1.02, 4)):
        x = sign * change / 92.0 * np.arange(96.0)
        found = window(x, t=start + np.arange(96.0))
        # without its first block the window is shorter
        assert found == (first, sign * change * (92.0 - first) / 92.0)


@pytest.mark.parametrize(("change", "steady"), [(0.97, True), (1.03, False)])
def test_change_within_the_noise(change, steady):
    """Blocks of five with noise 1.25 WHITE / sqrt(5); three errors of the slope of 24 of them."""
    noise = 1.25 * WHITE / np.sqrt(5.0)
    limit = 3.0 * noise * np.sqrt(12.0 / 24.0)
    line = change * limit * (np.arange(24) / 23.0 - 0.5)
    # the blocks begin up and down in turn: their medians lie one above and one below
    found = window(blocks(line, noise=1.0) - np.tile(np.repeat([1.0, -1.0], 5), 12), 1e-9)
    assert (found is not None and found[0] == 0) == steady


@pytest.mark.parametrize(("spread", "steady"), [(0.98, True), (1.02, False)])
def test_spread_within_the_tolerance(spread, steady):
    """Symmetric blocks have no slope; the median of their deviations is the amplitude."""
    a = spread / 1.482602218505602
    # seven blocks: too few to tell their own noise
    even = np.array([0.0, a, -a, a, -a, a, 0.0])
    for slope in (0.0, 0.8, -0.8):  # the slope is taken off
        found = window(blocks(even + slope * np.arange(7) / 6.0, 4), 1.0)
        assert (found == (0, slope)) == steady


@pytest.mark.parametrize(("n", "lead", "first"), [(24, 3, 1.0), (16, 2, 1.0), (8, 1, 1.0)])
def test_the_first_blocks_lie_on_the_others(n, lead, first):
    """The first eighth of the blocks, and the very first of them."""
    for level, steady in ((0.98 * first, True), (1.02 * first, False)):
        found = window(blocks([level] * lead + [0.0] * (n - lead), 4), 1.0)
        assert (found is not None and found[0] == 0) == steady
    if lead > 1:  # the mean of the lead and its first block have a limit each
        found = window(blocks([1.02] + [-1.0] * (lead - 1) + [0.0] * (n - lead), 4), 1.0)
        assert found[0] > 0


# --- noise of blocks that repeat 0, 1, 1, 0: half of their steps are one, the others none ---

EVEN = 100.0 + np.tile([0.0, 1.0, 1.0, 0.0], 6)
STEP_NOISE = 1.482602218505602 / np.sqrt(2.0)


def holds(offsets):
    """Whether all blocks are steady; samples within a block are alike and tell no noise."""
    found = window(blocks(EVEN + offsets, 50), 1e-9)
    return found is not None and found[0] == 0


@pytest.mark.parametrize(("share", "steady"), [(0.99, True), (1.01, False)])
def test_blocks_tell_their_own_noise(share, steady):
    line = 3.0 * STEP_NOISE * np.sqrt(12.0 / 24.0) * np.linspace(-0.5, 0.5, 24)
    assert holds(share * line) == steady
    assert holds(-share * line) == steady
    # the first block: four times; the first eighth, at 2/3 on average: three times
    blocks_on = np.arange(24)
    assert holds(share * 4.0 * STEP_NOISE * (blocks_on < 1)) == steady
    assert holds((share * 3.0 * STEP_NOISE - 2.0 / 3.0) * (blocks_on < 3)) == steady
    # half of the blocks lie higher by h: the median of the deviations is h / 2
    higher = 2.0 * 2.5 * STEP_NOISE / 1.482602218505602
    assert holds(share * higher * ((blocks_on >= 6) & (blocks_on < 18))) == steady


def test_a_window_has_three_blocks():
    assert window(blocks([12.0, 9.0, 6.0, 3.0, 0.0, 0.0], 4)) is None
    assert window(blocks([12.0, 9.0, 6.0, 0.0, 0.0, 0.0], 4)) == (12, 0.0)


# --- what is said of a sliding phase that does not settle ---


def settled(log_ratio, *, slack=160.0, min_samples=12, min_fraction=0.2):
    """The plateau of tensions with this ln(T_tight/T_slack), sampled every 0.02 s."""
    ratio = np.asarray(log_ratio, float)
    low = np.broadcast_to(slack, ratio.shape)
    criteria = PlateauCriteria(
        steady_tolerance=0.005,
        max_drift=0.02,
        min_samples=min_samples,
        min_fraction=min_fraction,
    )
    t = 5.0 + 0.02 * np.arange(ratio.size)
    return settle(t, np.column_stack([low * np.exp(ratio), low]), criteria)


@pytest.mark.parametrize(("asked", "least"), [(12, 12), (3, 8)])
def test_fewest_samples_of_a_sliding_phase(asked, least):
    found = settled(np.full(least, 0.9), min_samples=asked)
    assert np.log(found.levels[0] / found.levels[1]) == pytest.approx(0.9, rel=1e-9)
    with pytest.raises(SetAsideError, match=f"too short: {least - 1} usable .* >= {least}"):
        settled(np.full(least - 1, 0.9), min_samples=asked)


@pytest.mark.parametrize(
    ("fraction", "part", "duration"), [(0.1, 60, "1.18"), (0.2, 60, "1.18"), (0.4, 120, "2.38")]
)
def test_change_over_the_last_part_of_what_never_settles(fraction, part, duration):
    """Twice the distance of the medians of its halves: the rise of a line of as many samples.

    One exponential describes the last 300 of the 500 samples; the part is a fifth or more of them.
    """
    for sign, word in ((1.0, "rises"), (-1.0, "falls")):
        line = 0.9 + sign * 0.001 * np.arange(500)
        middle = float(np.median(line[-part:]))
        size = f"{100 * 0.001 * part / middle:.2g}"
        said = f"never settles: mu still {word} by {size} % over {duration} s, allowed is 0.5 %"
        with pytest.raises(SetAsideError) as error:
            settled(line, min_fraction=fraction)
        assert str(error.value) == said

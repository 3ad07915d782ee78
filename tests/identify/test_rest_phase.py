"""When the pulley turns, and what the cells show before: records whose answer is known by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from beltid.identify.friction.channels import find_rotation
from beltid.identify.friction.rest import rest_state
from beltid.identify.friction.run import RunRejected


def speed_record(top=0.2, rest=100, ramp=20, full=200, after=30):
    """At rest, a straight ramp, full speed, at rest again: sample k of the ramp has k / ramp."""
    up = top * np.arange(1, ramp + 1) / (ramp + 1)
    return np.concatenate([np.zeros(rest), up, np.full(full, top), np.zeros(after)])


@pytest.mark.parametrize("unit", [1.0, -1.0, 1000.0, 1e-3])
def test_rotation_of_a_clean_record(unit):
    # so long that no difference but zero counts for its noise
    found = find_rotation(unit * speed_record(full=2000))
    # the ramp begins at 1/21 of the top, above 3 %, and ends at 20/21, below 97 %
    assert (found.first, found.full_speed, found.end) == (100, 120, 2120)
    assert found.speed_rad_s == pytest.approx(0.2 * abs(unit), rel=1e-12)
    assert found.reversed == (unit < 0)
    assert found.unsteadiness == pytest.approx(0.0, abs=1e-12)


def test_noise_at_rest_is_no_rotation_and_noise_at_speed_no_end_of_it():
    rng = np.random.default_rng(0)
    speed = speed_record(rest=200, ramp=40, full=400, after=0)
    speed += rng.normal(0.0, 0.004, speed.size)
    found = find_rotation(speed)
    # four medians of |noise|, doubled: 8 * 0.67 * 0.004 = 0.022 rad/s, 4.5 samples of the ramp
    assert 202 <= found.first <= 208
    assert 232 <= found.full_speed <= 242
    assert found.end == 640
    assert found.speed_rad_s == pytest.approx(0.2, rel=0.005)


@pytest.mark.parametrize(("full", "counts"), [(30, True), (16, False)])
def test_the_first_rotation_counts_if_it_is_no_jerk(full, counts):
    """A fifth as long as the longest one of 218 samples above a tenth of the speed."""
    first = speed_record(full=full, ramp=20, after=40)
    speed = np.concatenate([first, speed_record(top=0.2, rest=50)])
    found = find_rotation(speed)
    begin = 100 if counts else first.size + 50
    end = 100 + 20 + full if counts else first.size + 50 + 220
    assert (found.first, found.end) == (begin, end)


def test_change_of_the_speed_between_the_halves_of_full_speed():
    speed = speed_record(full=2000, after=0)
    speed[1120:] = 0.204
    found = find_rotation(speed)
    assert found.full_speed == 120
    assert found.speed_rad_s == pytest.approx(0.204)
    assert found.unsteadiness == pytest.approx(0.004 / 0.204, rel=1e-9)


def test_what_is_no_rotation():
    with pytest.raises(RunRejected, match="never turns: pulley_speed_rad_s stays within 0 rad/s"):
        find_rotation(np.zeros(300))
    noise = np.random.default_rng(1).normal(0.0, 0.01, 400)
    with pytest.raises(RunRejected, match="never turns"):
        find_rotation(noise)
    short = np.random.default_rng(2).normal(0.0, 0.001, 400)
    short[392:396] = 0.2  # the noise is above half of its own largest values for longer
    with pytest.raises(RunRejected, match="turns in fewer than 20 samples"):
        find_rotation(short)
    short[370:396] = 0.2
    assert find_rotation(short).first == 370


@pytest.mark.parametrize("turning", [24, 300])
def test_a_rotation_is_found_after_any_rest(turning):
    """At 3 m/s all is over in a second, a thousandth of the record or a fiftieth."""
    speed = np.random.default_rng(3).normal(0.0, 1e-3, 20_000)
    speed[-turning - 40 : -40] += 60.0
    found = find_rotation(speed)
    assert (found.first, found.end) == (19_960 - turning, 19_960)
    assert found.speed_rad_s == pytest.approx(60.0, rel=1e-4)
    # a glitch of four samples before it is none
    speed[5000:5004] = 900.0
    assert find_rotation(speed).first == 19_960 - turning


def test_a_reverse_jerk_before_the_rotation_is_no_part_of_it():
    speed = speed_record(ramp=0)
    speed[97:100] = -0.05
    assert find_rotation(speed).first == 100
    speed[97:100] = 0.05
    assert find_rotation(speed).first == 97


def state(tight, slack, first=None, steps=(0.0, 0.0)):
    t = 0.02 * np.arange(tight.size)
    return rest_state(t, np.column_stack([tight, slack]), first or tight.size, np.array(steps))


def resting(n=200, tension=270.0, imbalance=4.0, noise=0.5, seed=0):
    rng = np.random.default_rng(seed)
    tight = tension + 0.5 * imbalance + noise * rng.normal(size=n)
    return tight, tension - 0.5 * imbalance + noise * rng.normal(size=n)


def test_rest_is_the_mean_of_both_cells_and_their_difference():
    tight, slack = resting()
    found = state(np.append(tight, 999.0), np.append(slack, 1.0), 200)
    assert found.n_samples == 200
    assert found.tension_N == pytest.approx(0.5 * np.mean(tight + slack), rel=1e-12)
    assert found.imbalance_N == pytest.approx(np.mean(tight - slack), rel=1e-12)
    # two cells of 0.5 N; the memory of white noise is estimated, and never below one sample
    white = float(np.std(tight - slack, ddof=1)) / math.sqrt(200.0)
    assert white * 0.999 < found.imbalance_se_N < 1.3 * white


@pytest.mark.parametrize("signs", [(1.0, -1.0), (1.0, 0.0), (0.0, -1.0)])
def test_tensions_that_part_before_the_speed_rises_are_left_out(signs):
    tight, slack = resting()
    away = np.concatenate([np.zeros(170), np.linspace(4.0, 60.0, 30)])
    found = state(tight + signs[0] * away, slack + signs[1] * away)
    assert 168 <= found.n_samples <= 174
    assert found.imbalance_N == pytest.approx(4.0, abs=0.2)
    assert found.tension_N == pytest.approx(270.0, abs=0.1)


def test_gaps_and_outliers_at_rest_are_left_out():
    tight, slack = resting()
    tight[[5, 6]], slack[70] = np.nan, np.nan
    tight[50] += 30.0  # moves difference and mean
    tight[90], slack[90] = tight[90] + 20.0, slack[90] + 20.0  # the mean alone
    kept = np.delete(np.arange(200), [5, 6, 70, 50, 90])
    found = state(tight, slack)
    assert found.n_samples == 195
    assert found.imbalance_N == pytest.approx(np.mean((tight - slack)[kept]), rel=1e-12)
    assert found.tension_N == pytest.approx(0.5 * np.mean((tight + slack)[kept]), rel=1e-12)


def test_too_short_a_rest():
    tight, slack = resting(3)
    assert state(tight, slack).n_samples == 3
    tight[1] = np.nan
    with pytest.raises(RunRejected, match=r"no rest phase: 2 usable samples .* must be >= 3"):
        state(tight, slack)


def test_coarse_converters_leave_their_rounding_in_the_imbalance():
    tight, slack = np.full(100, 270.0), np.full(100, 265.0)
    found = state(tight, slack, steps=(1.0, 2.0))
    assert found.imbalance_N == 5.0
    assert found.imbalance_se_N == pytest.approx(math.sqrt((1.0 + 4.0) / 12.0), rel=2e-3)
    assert state(tight, slack).imbalance_se_N == 0.0


def test_slopes_of_the_cells_at_rest_are_those_of_least_squares():
    t, rng = 0.02 * np.arange(200), np.random.default_rng(4)
    tight, slack = 270.0 + 0.3 * t, 268.0 - 0.1 * t
    tight, slack = tight + 0.2 * rng.normal(size=200), slack + 0.2 * rng.normal(size=200)
    found = state(tight, slack)
    for k, x in enumerate((tight - slack, tight + slack)):
        (slope, _), cov = np.polyfit(t, x, 1, cov="unscaled")
        assert found.slopes_N_s[k] == pytest.approx(slope, rel=1e-9)
        # 0.2 sqrt(2) N of noise, estimated from 200 samples, and a memory of one sample or more
        assert 0.85 < found.slope_ses_N_s[k] / (0.2 * np.sqrt(2.0 * cov[0, 0])) < 1.4
    # the last eighth, 25 samples of the mean of two cells: white noise of 0.2 / sqrt(2) N
    assert found.end_N == pytest.approx(np.mean(0.5 * (tight + slack)[-25:]), rel=1e-12)
    assert found.end_se_N == pytest.approx(0.2 / math.sqrt(2.0 * 25), rel=0.15)
    residual = tight - slack - np.polyval(np.polyfit(t, tight - slack, 1), t)
    assert found.noise_N == pytest.approx(np.sqrt(residual @ residual / 198.0 / 2.0), rel=1e-9)
    assert (found.first_s, found.last_s) == (0.0, t[-1])

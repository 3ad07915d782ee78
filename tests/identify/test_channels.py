"""Channels of one run and what is set aside: counts by hand, both sides of every limit."""

import math
from contextlib import nullcontext

import numpy as np
import pytest
from virtual_rig import Recipe, record

from beltid.identify.friction.prepare import BLOCKS, Rest, Rotation, read_channels
from beltid.identify.friction.reduction import against_stated
from beltid.identify.friction.run import RunRecord, RunReduction, RunRejected

N, FIRST = 200, 50
TIGHT, SLACK, SPEED = "tension_tight_N", "tension_slack_N", "pulley_speed_rad_s"


def columns(seed=0):
    """At rest at 250 N for 50 samples, then at 350 and 150 N with white noise of 0.5 N."""
    rng = np.random.default_rng(seed)
    part = np.where(np.arange(N) < FIRST, 0.0, 100.0)
    return {
        "time_s": 0.05 * np.arange(N),
        TIGHT: 250.0 + part + 0.5 * rng.normal(size=N),
        SLACK: 250.0 - part + 0.5 * rng.normal(size=N),
        SPEED: np.where(np.arange(N) < FIRST, 0.0, 0.2),
    }


def recorded(time_s, tension_tight_N, tension_slack_N, pulley_speed_rad_s, temperature=None):
    tensions = np.column_stack([tension_tight_N, tension_slack_N])
    temperature = np.full(time_s.size, np.nan) if temperature is None else temperature
    return RunRecord(time_s, tensions, pulley_speed_rad_s, temperature)


def prepared(**changed):
    """The usable channels, and the result with the counts."""
    run = RunReduction()
    return *read_channels(recorded(**{**columns(), **changed}), run), run


def limit(fine, message):
    """Either side of a limit: nothing happens, or the run is rejected."""
    return nullcontext() if fine else pytest.raises(RunRejected, match=message)


def test_gaps_and_spikes_are_counted_once_each():
    c = columns()
    tight, slack, speed = c[TIGHT], c[SLACK], c[SPEED]
    tight[[60, 61]], slack[[61, 70]] = np.nan, 0.0
    tight[100], slack[[100, 120]] = tight[100] + 40.0, slack[[100, 120]] - 30.0
    speed[[10, 11, 170]] = -9999.0, 9.9e37, np.inf  # marks of an overflow
    found, rounding_N, run = prepared(**c, temperature=np.arange(float(N)))
    assert run.n_spikes == 2  # samples 100 and 120
    assert run.n_missing == 3  # samples 60, 61 and 70
    assert found.time_s.size == N
    usable = np.isfinite(found.tensions).all(axis=1)
    assert np.flatnonzero(~usable).tolist() == [60, 61, 70, 100, 120]
    assert found.temperature[150] == 150.0
    assert found.speed.tolist() == [0.0] * FIRST + [0.2] * (N - FIRST)
    assert not rounding_N.any()


LOST = np.random.default_rng(0).permutation(N)


@pytest.mark.parametrize(
    ("name", "value", "most", "message"),
    [
        (TIGHT, np.nan, 60, f"{TIGHT} is missing in 30.5 %"),
        (SLACK, np.nan, 60, f"{SLACK} is missing in 30.5 %"),
        (TIGHT, -5.0, 60, f"{TIGHT} is not positive in 30.5"),
        (SPEED, np.nan, 100, "pulley_speed_rad_s is missing"),
    ],
)
def test_a_channel_may_lack_so_many_samples(name, value, most, message):
    for lost in (most, most + 1):
        x = columns()[name]
        x[LOST[:lost]] = value - 0.1 * np.arange(lost)
        with limit(lost == most, message):
            prepared(**{name: x})


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({name: values[:1] for name, values in columns().items()}, "too short"),
        ({"time_s": np.full(N, 2.0)}, "stands still"),
        ({TIGHT: np.full(N, 250.0)}, f"{TIGHT} is dead"),
    ],
)
def test_records_that_cannot_be_a_run(changed, message):
    with limit(False, message):
        prepared(**changed)


@pytest.mark.parametrize(("name", "sign"), [(TIGHT, 1.0), (SLACK, -1.0)])
@pytest.mark.parametrize(("equal", "fine"), [(6, True), (7, False)])
def test_a_cell_at_one_extreme_for_a_twentyfifth_of_the_sliding_is_saturated(
    name, sign, equal, fine
):
    x = sign * columns()[name]
    order = FIRST + np.argsort(x[FIRST:])
    x[order[-equal:]] = x[order[-equal]]
    with limit(fine, f"{name} is saturated"):  # of 150 samples
        prepared(**{name: sign * x})


def test_a_coarse_converter_is_not_saturated_and_rounds_its_means():
    c = columns(1)
    _, rounding_N, _ = prepared(**{name: 3.0 * np.round(c[name] / 3.0) for name in (TIGHT, SLACK)})
    # without noise a uniform distribution as wide as a step
    assert np.all((rounding_N > 0.5) & (rounding_N <= 3.0 / np.sqrt(12.0)))
    fine = {name: np.round(c[name], 1) for name in (TIGHT, SLACK)}
    assert np.all(prepared(**fine)[1] < 1e-6)  # noise averages over its steps


def test_a_long_run_is_averaged_over_blocks():
    for n in (2 * BLOCKS - 1, 20_011):
        c = record(Recipe(peak=0.0, ripple=0.0, rate=n / 12.0, duration=12.0))
        found, _ = read_channels(recorded(**c), RunReduction())
        size = n // BLOCKS if n >= 2 * BLOCKS else 1
        counts = np.full(found.time_s.size, size)
        counts[-1] = n - counts[:-1].sum()
        assert found.time_s.size == -(-n // size)
        for mean, whole in zip(found.tensions.T, (c[TIGHT], c[SLACK]), strict=True):
            assert counts @ mean / n == pytest.approx(np.mean(whole), rel=1e-12)
    at = [0, 40, 5000, 5001, n - 40, n - 1]
    c[TIGHT][at] += 40.0
    read_channels(recorded(**c), run := RunReduction())
    assert run.n_spikes == len(at)


# --- rotation ---


def speed_record(top=0.2, rest=100, ramp=20, full=200, after=30):
    """At rest, a straight ramp, full speed, at rest again: sample k of the ramp has k / ramp."""
    up = top * np.arange(1, ramp + 1) / (ramp + 1)
    return np.concatenate([np.zeros(rest), up, np.full(full, top), np.zeros(after)])


@pytest.mark.parametrize("unit", [1.0, -1.0, 1000.0, 1e-3])
def test_rotation_of_a_clean_record(unit):
    # so long that no difference but zero counts for its noise
    speed = speed_record(full=2000)
    speed[1620:2120] = 0.204
    found = Rotation(unit * speed)
    # the ramp begins at 1/21 of the top, above 3 %, and ends at 20/21, below 97 %
    assert (found.first, found.full_speed, found.end) == (100, 120, 2120)
    assert found.speed_rad_s == pytest.approx(0.2 * unit, rel=0.021)


def test_noise_at_rest_is_no_rotation_and_noise_at_speed_no_end_of_it():
    rng = np.random.default_rng(0)
    speed = speed_record(rest=200, ramp=40, full=400, after=0)
    speed += rng.normal(0.0, 0.004, speed.size)
    found = Rotation(speed)
    # four medians of |noise|, doubled: 8 * 0.67 * 0.004 = 0.022 rad/s, 4.5 samples of the ramp
    assert 202 <= found.first <= 208
    assert 232 <= found.full_speed <= 242
    assert found.end == 640


@pytest.mark.parametrize(("full", "counts"), [(30, True), (16, False)])
def test_the_first_rotation_counts_if_it_is_no_jerk(full, counts):
    """A fifth as long as the longest one of 218 samples above a tenth of the speed."""
    first = speed_record(full=full, ramp=20, after=40)
    found = Rotation(np.concatenate([first, speed_record(top=0.2, rest=50)]))
    begin = 100 if counts else first.size + 50
    end = 100 + 20 + full if counts else first.size + 50 + 220
    assert (found.first, found.end) == (begin, end)


@pytest.mark.parametrize(("turning", "fine"), [(0, False), (4, False), (30, True), (300, True)])
def test_a_rotation_is_found_after_any_rest(turning, fine):
    """At 3 m/s all is over in a second, a thousandth of the record or a fiftieth."""
    speed = np.random.default_rng(3).normal(0.0, 1e-3, 20_000)
    speed[20_000 - turning - 40 : 20_000 - 40] += 60.0
    speed[5000:5004] = 900.0 if fine else 0.0  # a glitch is no rotation
    with limit(fine, "turns"):
        found = Rotation(speed)
        assert (found.first, found.end) == (19_960 - turning, 19_960)


def test_a_reverse_jerk_before_the_rotation_is_no_part_of_it():
    for jerk, first in ((-0.05, 100), (0.05, 97)):
        speed = speed_record(ramp=0)
        speed[97:100] = jerk
        assert Rotation(speed).first == first


# --- rest ---


def state(tight, slack, rounding_N=0.0):
    usable = np.isfinite(tight - slack)
    t = 0.02 * np.flatnonzero(usable)
    return Rest(t, np.column_stack([tight, slack])[usable], rounding_N)


def resting(n=200, tension=270.0, imbalance=4.0, noise=0.5, seed=0):
    rng = np.random.default_rng(seed)
    tight = tension + 0.5 * imbalance + noise * rng.normal(size=n)
    return tight, tension - 0.5 * imbalance + noise * rng.normal(size=n)


@pytest.mark.parametrize("signs", [(1.0, -1.0), (1.0, 0.0), (0.0, -1.0)])
def test_tensions_that_part_before_the_speed_rises_are_left_out(signs):
    tight, slack = resting()
    away = np.concatenate([np.zeros(170), np.linspace(4.0, 60.0, 30)])
    found = state(tight + signs[0] * away, slack + signs[1] * away)
    assert 168 <= found.n_samples <= 174
    assert (found.imbalance_N, found.tension_N) == pytest.approx((4.0, 270.0), abs=0.1)


def test_friction_that_is_released_does_not_shorten_the_rest():
    held = 30.0 * np.exp(-np.arange(200) / 70.0)
    assert state(*resting(imbalance=held)).imbalance_N == pytest.approx(np.mean(held), abs=0.2)


def test_gaps_and_outliers_at_rest_are_left_out():
    tight, slack = resting()
    tight[[5, 6]], slack[70] = np.nan, np.nan
    tight[50] += 30.0  # moves difference and mean
    tight[90], slack[90] = tight[90] + 20.0, slack[90] + 20.0  # the mean alone
    found, kept = state(tight, slack), np.delete(np.arange(200), [5, 6, 70, 50, 90])
    assert found.n_samples == 195
    assert found.imbalance_N == pytest.approx(np.mean((tight - slack)[kept]), rel=1e-12)
    assert found.tension_N == pytest.approx(0.5 * np.mean((tight + slack)[kept]), rel=1e-12)
    # two cells of 0.5 N; the memory of white noise is estimated, and never below one sample
    white = float(np.std((tight - slack)[kept], ddof=1)) / math.sqrt(195.0)
    assert white * 0.999 < found.imbalance_se_N < 1.3 * white


def test_too_short_a_rest():
    tight, slack = resting(3)
    assert state(tight, slack).n_samples == 3
    tight[1] = np.nan
    with pytest.raises(RunRejected, match="no rest phase"):
        state(tight, slack)


def test_coarse_converters_leave_their_rounding_in_the_imbalance():
    found = state(np.full(100, 270.0), np.full(100, 265.0), [3.0, 4.0])
    assert (found.imbalance_N, found.imbalance_se_N) == (5.0, 5.0)


def test_slopes_of_the_cells_at_rest_are_those_of_least_squares():
    t, rng = 0.02 * np.arange(200), np.random.default_rng(4)
    tight, slack = np.array([270.0 + 0.3 * t, 268.0 - 0.1 * t]) + 0.2 * rng.normal(size=(2, 200))
    found = state(tight, slack)
    for k, x in enumerate((tight - slack, tight + slack)):
        (slope, _), cov = np.polyfit(t, x, 1, cov="unscaled")
        assert found.slopes_N_s[k] == pytest.approx(slope, rel=1e-9)
        assert found.slope_ses_N_s[k] == pytest.approx(0.2 * np.sqrt(2.0 * cov[0, 0]), rel=0.15)
    assert found.end_N == pytest.approx(np.mean(0.5 * (tight + slack)[-25:]), rel=1e-12)


# --- tensions at rest against the stated ones ---

STATED = np.repeat([50.0, 100.0, 160.0, 220.0, 270.0, 310.0, 360.0, 411.0], 5)


@pytest.mark.parametrize(
    ("offset", "factor", "remedy"),
    [(20.0, 1.0, "tension_tight_tare_N"), (0.0, 1.0 / 4.448, "units.rig")],
)
def test_cells_not_tared_or_in_another_unit_are_recognised(offset, factor, remedy):
    """Set to 1 % and 1 N, two runs by mistake to something else."""
    rng = np.random.default_rng(0)
    measured = offset + factor * STATED * (1.0 + 0.01 * rng.normal(size=40)) + rng.normal(size=40)
    measured[[3, 30]] += 80.0
    assert remedy in against_stated(measured, STATED)

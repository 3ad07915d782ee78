"""What is done to a press test before the fit, on records without noise or with known chatter."""

from __future__ import annotations

import math

import numpy as np
import pytest

from beltid.errors import InputError
from beltid.identify.press.curves import read_recording
from beltid.identify.press.recording import StiffnessSettings, prepare_test


def prepared(travel, force, *, compliance=0.0, temperature=np.nan):
    x, f = np.asarray(travel, float), np.asarray(force, float)
    part = {
        "time_s": np.arange(float(x.size)),
        "displacement_mm": x,
        "force_N": f,
        "temperature_degC": np.broadcast_to(temperature, x.shape),
    }
    return prepare_test("A", part, StiffnessSettings(0.04, machine_compliance_m_N=compliance))


def zigzag(n, size=1.0):
    return size * (-1.0) ** np.arange(n)


def test_twenty_samples_are_enough():
    ramp = np.arange(20.0)
    found = prepared(ramp, 10.0 * ramp, temperature=[np.nan, 21.0, 22.0, 30.0] * 5)
    assert found.travel_m == pytest.approx(1e-3 * ramp, rel=1e-12)
    assert found.force_N.tolist() == (10.0 * ramp).tolist()
    assert (found.travel_sign, found.temperature_degC, found.notes) == (1.0, 22.0, ())
    assert (found.free_travel, found.n_missing, found.n_spikes) == (False, 0, 0)
    assert math.isnan(prepared(ramp, ramp).temperature_degC)
    with pytest.raises(InputError, match="19 usable samples, must be at least 20"):
        prepared(ramp[1:], ramp[1:])


def test_signs_make_force_and_travel_rise():
    ramp = np.arange(30.0)
    for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        found = prepared(signs[0] * ramp, signs[1] * ramp)
        assert found.travel_sign == signs[0]
        assert found.travel_m == pytest.approx(1e-3 * ramp, rel=1e-12)
        assert found.force_N.tolist() == ramp.tolist()
        turned = [x for x, sign in (("force", signs[1]), ("travel", signs[0])) if sign < 0]
        assert [n.split("negative ")[1] for n in found.notes] == [
            f"{x}, sign reversed" for x in turned
        ]
    # the change since the start tells, whatever an untared cell reads there
    for zero in (60.0, -14.6):
        found = prepared(-ramp, zero + ramp)
        assert (found.travel_sign, found.travel_m[-1]) == (-1.0, 0.029)
        assert found.force_N[-1] == zero + 29.0
        assert [n.split(",")[0] for n in found.notes] == ["compression recorded as negative travel"]
    assert prepared(ramp, ramp - 14.5).force_N[-1] == 14.5  # as much pull as push


def test_a_cell_that_is_not_tared_needs_free_travel():
    ramp = np.arange(30.0)
    with pytest.raises(InputError, match="from -40 N to -11 N, and without travel before"):
        prepared(ramp, ramp - 40.0)


def test_missing_samples_and_spikes_are_left_out():
    n = 2001
    share = np.linspace(0.0, 1.0, n)
    force = 100.0 * share
    force[[5, 7]] = np.nan
    found = prepared(share, force)
    assert (found.n_missing, found.n_spikes, found.time_s.size) == (2, 0, n - 2)
    assert found.notes == ("2 samples without displacement or force left out",)
    # two thousandths of the range of the bulk, 98 N, or four steps; the median of seven samples
    # that hold the spike lies one step higher
    for n, step, limit in ((4001, 0.025, 0.196), (101, 1.0, 4.0)):
        for size, spikes in ((0.98 * limit + step, 0), (1.02 * limit + step, 1)):
            force = np.linspace(0.0, 100.0, n)
            force[n // 2] += size
            found = prepared(np.linspace(0.0, 1.0, n), force)
            assert found.n_spikes == spikes
            assert found.notes == (("1 spikes left out",) if spikes else ())
            assert (n // 2 in found.time_s) == (not spikes)


def test_no_turn_and_no_kink_is_a_spike():
    way = np.concatenate([np.zeros(50), np.linspace(0, 400, 300), np.linspace(400, 0, 80)])
    rough = way + 0.05 * np.random.default_rng(7).normal(size=way.size)
    assert prepared(way, way).n_spikes == prepared(rough, rough).n_spikes == 0
    rough[[2, 120, 349, 420]] += 40.0
    assert prepared(way, rough).n_spikes == 4


def test_the_machine_yields_less_than_the_crosshead_moves():
    x = np.linspace(0.0, 1.0, 101)
    force = 200.0 * x**2
    found = prepared(x, force, compliance=0.3e-5)
    assert found.position_m == pytest.approx(1e-3 * (x - 0.6 * x**2), abs=1e-12)
    with pytest.raises(InputError, match=r"machine compliance 0.006 mm/N"):
        prepared(x, force, compliance=0.6e-5)
    with pytest.raises(InputError, match="the crosshead moves by 0 mm"):
        prepared(0.0 * x, force)


# --- zero of the load cell: 2 N per sample up to 200 N after the free travel ---


def zeroed(free, *, noise=0.0):
    """Force of the first sample that presses, and whether there is free travel."""
    n = len(free)
    force = np.concatenate([free, free[0] + 2.0 * np.arange(1.0, 101.0)]) + 0.0
    force += zigzag(n + 100, noise)
    found = prepared(np.arange(n + 100.0), force)
    return float(force[-1] - found.force_N[-1]), found.free_travel


def test_zero_is_that_of_the_first_half_of_the_free_travel():
    assert zeroed([-300.0] * 40) == (-300.0, True)  # more than the 200 N of the test
    assert zeroed([5.0] * 40) == (5.0, True)
    assert zeroed([0.0] * 40) == (0.0, True)
    assert zeroed([-3.0] * 20 + [-2.7] * 20) == (-3.0, True)
    found = prepared(np.arange(140.0), [5.0] * 40 + [5.0 + 2.0 * k for k in range(1, 101)])
    assert found.notes == ("zero of the load cell 5 N subtracted",)


@pytest.mark.parametrize(("errors", "taken"), [(3.9, False), (4.5, True), (-4.5, True)])
def test_zero_beyond_four_standard_errors(errors, taken):
    """Twenty samples of chatter by 0.1 N around it: the error is 0.1 / sqrt(19)."""
    level = errors * 0.1 / math.sqrt(19.0)
    zero, free = zeroed(level + zigzag(40, 0.1))
    assert free
    assert zero == pytest.approx(level if taken else 0.0, abs=1e-12)


@pytest.mark.parametrize(("move", "zero"), [(0.18, 5.09), (0.2, 5.0)])
def test_a_zero_that_drifts_is_that_of_the_first_samples(move, zero):
    """Ten samples each: standard errors of 0.1 / 3, four times their hypotenuse is 0.189."""
    level = 5.0 + np.repeat([0.0, move, 0.0], [10, 10, 20]) + zigzag(40, 0.1)
    assert zeroed(level) == (pytest.approx(zero, abs=1e-12), True)


@pytest.mark.parametrize(("errors", "seen"), [(3.9, False), (4.1, True), (-4.1, True)])
def test_a_drift_is_the_force_after_the_release_beyond_four_standard_errors(errors, seen):
    """Chatter by 0.1 N: twenty samples before, as many after."""
    way = np.concatenate([np.arange(40.0), np.arange(40.0, 140.0), np.arange(139.0, 9.0, -1.0)])
    force = 2.0 * np.maximum(way - 40.0, 0.0) + zigzag(way.size, 0.1)
    free = way <= 29.0  # three quarters of the travel before contact
    after = np.flatnonzero(free)[np.flatnonzero(free) > 100]
    assert after.size == 20
    drift = errors * 0.1 / math.sqrt(19.0) * math.sqrt(2.0)
    force[after] += drift
    assert prepared(way, force).drift_N == pytest.approx(drift if seen else 0.0, abs=1e-12)
    short = way.size - 16  # four samples after the release are too few
    assert prepared(way[:short], force[:short]).drift_N == 0.0


def test_samples_at_the_end_of_the_range_of_the_cell_are_left_out():
    way = np.concatenate([np.arange(140.0), np.arange(140.0, -1.0, -1.0)])
    force = 2.0 * np.maximum(way - 40.0, 0.0)
    whole = prepared(way, force)
    assert (whole.n_missing, whole.notes) == (0, ())
    clipped = prepared(way, np.minimum(force, 150.0))
    n = 1 + 2 * (140 - 115)  # from 115 mm to the top and back
    assert (clipped.n_missing, clipped.force_N.max()) == (n, 148.0)
    (note,) = clipped.notes
    assert note.startswith(f"{n} samples left out: the force stays at 150 N while the crosshead")
    with pytest.raises(InputError, match="usable samples, must be at least 20"):
        prepared(np.arange(40.0), np.minimum(np.maximum(np.arange(40.0) - 10.0, 0.0), 6.0))
    # a hold at the top, a coarse converter and a force that creeps are none
    hold = np.concatenate([way[:141], np.full(50, 140.0), way[141:]])
    for travel, force in (
        (hold, 2.0 * np.maximum(hold - 40.0, 0.0)),
        (way, 20.0 * np.round(0.1 * np.maximum(way - 40.0, 0.0))),
    ):
        assert prepared(travel, force).n_missing == 0


@pytest.mark.parametrize(
    ("level", "touch", "noise", "free"),
    [
        (0.0, 0.9, 0.0, True),  # half a hundredth of 200 N is 1 N
        (0.0, 1.05, 0.0, False),
        (100.0, 0.9, 0.0, True),  # it is the rise that counts
        (100.0, 1.05, 0.0, False),
        (0.0, 1.5, 0.1, True),  # six times the noise of 0.242 N, above the median of 0.1 N
        (0.0, 1.6, 0.1, False),
    ],
)
def test_free_travel_ends_where_the_force_rises(level, touch, noise, free):
    before = level + np.repeat([0.0, touch], [8, 3])
    before[8:] -= zigzag(11, noise)[8:]
    assert zeroed(before, noise=noise)[1] == free


# --- what a recording says about itself ---


RAMP = np.concatenate([np.zeros(30), np.arange(1.0, 101.0)])


def recording_of(*parts):
    """A recording of parts (name, force, time); the crosshead goes up by one per sample and back.

    All begin with thirty samples of free travel.
    """
    columns = {"test": [], "time_s": [], "displacement_mm": [], "force_N": []}
    for name, force, time in parts:
        steps = np.arange(float(force.size))
        columns["test"].append(np.full(force.size, name))
        columns["time_s"].append(steps if time is None else time)
        columns["displacement_mm"].append(np.minimum(steps, 258.0 - steps))
        columns["force_N"].append(force)
    return {name: np.concatenate(values) for name, values in columns.items()}


def test_tests_that_are_not_used_are_reported_with_their_reason():
    settings = StiffnessSettings(segment_length_m=0.04)
    both = np.concatenate([RAMP, RAMP[-2::-1]])
    back = np.arange(float(both.size))
    back[7], back[50] = back[6], np.nan  # standing and unknown are no faults
    holes = both.copy()
    holes[[10, 12]] = np.nan
    found = read_recording(
        recording_of(("A", holes, back), ("B", RAMP, None), ("C", holes, None)), settings
    )
    assert [c.test for c in found.curves] == ["A", "C"]
    assert found.set_aside == (("B", "test B: never unloaded, while other tests are"),)
    assert (found.n_missing, found.n_spikes) == (4, 0)
    assert found.notes == (
        "tests A, C: 2 samples without displacement or force left out",
        "set aside: test B: never unloaded, while other tests are",
    )
    alone = read_recording(recording_of(("B", RAMP, None)), settings)
    assert [c.test for c in alone.curves] == ["B"]
    assert alone.set_aside == ()
    assert len(alone.notes) == 1
    assert alone.notes[0] == "test B: never unloaded"

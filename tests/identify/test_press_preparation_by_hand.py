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


RAMP = np.arange(30.0)


@pytest.mark.parametrize(
    ("travel", "force", "zero"),  # whatever an untared cell reads at the start
    [(1, 1, 0.0), (1, -1, 0.0), (-1, 1, 0.0), (-1, -1, 0.0), (-1, 1, 60.0), (-1, 1, -14.6)],
)
def test_signs_make_force_and_travel_rise(travel, force, zero):
    found = prepared(travel * RAMP, zero + force * RAMP)
    assert found.travel_sign == travel
    assert found.travel_m == pytest.approx(1e-3 * RAMP, rel=1e-12)
    assert found.force_N.tolist() == (zero + RAMP).tolist()
    turned = [name for name, sign in (("force", force), ("travel", travel)) if sign < 0]
    said = [f"compression recorded as negative {name}, sign reversed" for name in turned]
    assert list(found.notes) == said


def test_a_cell_that_is_not_tared_needs_free_travel():
    assert prepared(RAMP, RAMP - 14.5).force_N[-1] == 14.5  # as much pull as push
    with pytest.raises(InputError, match="from -40 N to -11 N, and without travel before"):
        prepared(RAMP, RAMP - 40.0)


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


ERROR = 0.1 / math.sqrt(19.0)
"""Standard error of the mean of twenty samples that chatter by 0.1 N around it."""


@pytest.mark.parametrize(
    ("level", "chatter", "zero"),
    [
        ([-300.0] * 40, 0.0, -300.0),  # more than the 200 N of the test
        ([5.0] * 40, 0.0, 5.0),
        ([0.0] * 40, 0.0, 0.0),
        ([-3.0] * 20 + [-2.7] * 20, 0.0, -3.0),  # the first half, as the second may touch
        ([3.9 * ERROR] * 40, 0.1, 0.0),
        ([4.5 * ERROR] * 40, 0.1, 4.5 * ERROR),
        ([-4.5 * ERROR] * 40, 0.1, -4.5 * ERROR),
        # two times ten samples: standard errors of 0.1 / 3, four times their hypotenuse is 0.189
        ([5.0] * 10 + [5.18] * 10 + [5.0] * 20, 0.1, 5.09),
        ([5.0] * 10 + [5.2] * 10 + [5.0] * 20, 0.1, 5.0),
        # free travel ends where the force rises by half a hundredth of 200 N
        ([0.0] * 8 + [0.9] * 3, 0.0, 0.0),
        ([0.0] * 8 + [1.05] * 3, 0.0, None),
        ([100.0] * 8 + [100.9] * 3, 0.0, 100.0),
        ([100.0] * 8 + [101.05] * 3, 0.0, None),
        # or by six times the noise of 0.242 N, above the median of 0.1 N
        ([0.0] * 8 + [1.4, 1.6, 1.4], 0.1, 0.0),
        ([0.0] * 8 + [1.5, 1.7, 1.5], 0.1, None),
    ],
)
def test_zero_of_the_load_cell_before_contact(level, chatter, zero):
    """None without free travel; then 2 N per sample up to 200 N."""
    n = len(level)
    force = np.concatenate([level, level[0] + 2.0 * np.arange(1.0, 101.0)]) + 0.0
    force += zigzag(n + 100, chatter)
    found = prepared(np.arange(n + 100.0), force)
    assert found.free_travel == (zero is not None)
    assert force[-1] - found.force_N[-1] == pytest.approx(zero or 0.0, abs=1e-12)
    assert found.notes == ((f"zero of the load cell {zero:.3g} N subtracted",) if zero else ())


@pytest.mark.parametrize(("errors", "seen"), [(3.9, False), (4.1, True), (-4.1, True)])
def test_a_drift_is_the_force_after_the_release_beyond_four_standard_errors(errors, seen):
    """Chatter by 0.1 N: twenty samples before, as many after."""
    way = np.concatenate([np.arange(40.0), np.arange(40.0, 140.0), np.arange(139.0, 9.0, -1.0)])
    force = 2.0 * np.maximum(way - 40.0, 0.0) + zigzag(way.size, 0.1)
    free = way <= 29.0  # three quarters of the travel before contact
    after = np.flatnonzero(free)[np.flatnonzero(free) > 100]
    assert after.size == 20
    drift = errors * ERROR * math.sqrt(2.0)
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


def test_tests_that_are_not_used_are_reported_with_their_reason():
    """Thirty samples of free travel, up by one per sample, and back in tests A and C."""
    up = np.concatenate([np.zeros(30), np.arange(1.0, 101.0)])
    holes = np.concatenate([up, up[-2::-1]])
    holes[[10, 12]] = np.nan
    clock = np.arange(float(holes.size))
    unclear = clock.copy()
    unclear[7], unclear[50] = unclear[6], np.nan  # standing and unknown are no faults

    def found(**tests):
        columns = {
            "test": np.repeat(list(tests), [f.size for f, _ in tests.values()]),
            "force_N": np.concatenate([f for f, _ in tests.values()]),
            "time_s": np.concatenate([t[: f.size] for f, t in tests.values()]),
        }
        steps = np.concatenate([clock[: f.size] for f, _ in tests.values()])
        columns["displacement_mm"] = np.minimum(steps, 258.0 - steps)
        return read_recording(columns, StiffnessSettings(segment_length_m=0.04))

    mixed = found(A=(holes, unclear), B=(up, clock), C=(holes, clock))
    reason = "test B: never unloaded, while other tests are"
    assert [c.test for c in mixed.curves] == ["A", "C"]
    assert mixed.set_aside == (("B", reason),)
    assert (mixed.n_missing, mixed.n_spikes) == (4, 0)
    left_out = "tests A, C: 2 samples without displacement or force left out"
    assert mixed.notes == (left_out, f"set aside: {reason}")
    alone = found(B=(up, clock))
    assert [c.test for c in alone.curves] == ["B"]
    assert (alone.set_aside, alone.notes) == ((), ("test B: never unloaded",))

"""Channels of one run and what is set aside: counts by hand, both sides of every limit."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from beltid.identify.friction.channels import (
    Rotation,
    check_cells,
    missing_rows,
    read_channels,
)
from beltid.identify.friction.run import RunRecord, RunRejected

N, FIRST = 200, 50
ROTATION = Rotation(FIRST, FIRST, N, 0.2, False, 0.0)


def columns(seed=0):
    """At rest at 250 N for 50 samples, then at 350 and 150 N with white noise of 0.5 N."""
    rng = np.random.default_rng(seed)
    part = np.where(np.arange(N) < FIRST, 0.0, 100.0)
    return {
        "time_s": 0.05 * np.arange(N),
        "tension_tight_N": 250.0 + part + 0.5 * rng.normal(size=N),
        "tension_slack_N": 250.0 - part + 0.5 * rng.normal(size=N),
        "pulley_speed_rad_s": np.where(np.arange(N) < FIRST, 0.0, 0.2),
    }


def prepared(**changed):
    return read_channels(RunRecord(**{**columns(), **changed}))


def limit(fine, message):
    """Either side of a limit: nothing happens, or the run is rejected."""
    return nullcontext() if fine else pytest.raises(RunRejected, match=message)


def refused(message, **changed):
    with limit(False, message):
        prepared(**changed)


def test_a_clean_record_stays_as_it_is():
    found = prepared(temperature_degC=np.arange(float(N)))
    c = columns()
    assert np.array_equal(found.tensions.T, [c["tension_tight_N"], c["tension_slack_N"]])
    assert (found.n_spikes, found.n_missing, *found.steps) == (0, 0, 0.0, 0.0)
    assert found.usable.all()
    assert found.temperature[7] == 7.0


def test_gaps_spikes_and_missing_rows_are_counted_once_each():
    c = columns()
    tight, slack, t = c["tension_tight_N"], c["tension_slack_N"], c["time_s"]
    tight[[60, 61]], slack[[61, 70]] = np.nan, 0.0
    tight[100], slack[[100, 120]] = tight[100] + 40.0, slack[[100, 120]] - 30.0
    t[150] = np.nan
    found = prepared(**c, temperature_degC=np.arange(float(N)))
    assert found.n_spikes == 2  # samples 100 and 120
    # samples 60, 61 and 70; the row without a time, and the hole that it leaves in the time base
    assert found.n_missing == 3 + 1 + 1
    assert found.time_s.size == N - 1
    assert np.flatnonzero(~found.usable).tolist() == [60, 61, 70, 100, 120]
    assert found.temperature[150] == 151.0


def test_records_that_cannot_be_a_run():
    short = {name: values[:1] for name, values in columns().items()}
    refused("too short: 1 samples", **short)
    for lost, fine in ((100, True), (101, False)):
        t = columns()["time_s"]
        t[np.random.default_rng(0).permutation(N)[:lost]] = np.nan
        with limit(fine, "time_s is missing in 101 of 200 samples"):
            assert prepared(time_s=t).time_s.size == N - lost
    t = columns()["time_s"]
    t[80:] -= 1.0
    refused(r"goes back from 3.95 to 3 s at sample 81", time_s=t)
    t = columns()["time_s"]
    t[80] = t[79]
    assert prepared(time_s=t).time_s.size == N
    refused("time_s stands still at 2 s", time_s=np.full(N, 2.0))
    lone = {name: np.array([values[0], np.nan]) for name, values in columns().items()}
    refused("time_s is missing in 1 of 2", **lone)


@pytest.mark.parametrize("name", ["tension_tight_N", "tension_slack_N"])
def test_cells_that_are_missing_dead_or_not_positive(name):
    for lost, fine in ((60, True), (61, False)):  # three tenths
        for value, message in ((np.nan, "is missing in 30.5 %"), (-5.0, "is not positive in 30.5")):
            x = columns()[name]
            x[np.random.default_rng(0).permutation(N)[:lost]] = value
            with limit(fine, f"{name} {message}"):
                prepared(**{name: x})
    refused(f"{name} is dead: 250 N throughout", **{name: np.full(N, 250.0)})


def with_tensions(tight, slack):
    return replace(prepared(), tensions=np.column_stack([tight, slack]))


def checked(tight, slack, message=""):
    """The cells are in order, or the message says what is not."""
    found = prepared(tension_tight_N=tight, tension_slack_N=slack)
    with limit(not message, message):
        check_cells(found, FIRST, slice(FIRST, N), 250.0)


@pytest.mark.parametrize(("name", "sign"), [("tension_tight_N", 1.0), ("tension_slack_N", -1.0)])
def test_a_cell_at_one_extreme_for_more_than_a_twentyfifth_of_the_sliding_is_saturated(name, sign):
    for part, message in ((6, ""), (7, rf"{name} is saturated: 4.67 % of the")):  # of 150 samples
        c = columns()
        x = sign * c[name]
        order = FIRST + np.argsort(x[FIRST:])
        x[order[-part:]] = x[order[-part]]
        c[name] = sign * x
        checked(c["tension_tight_N"], c["tension_slack_N"], message)


def test_a_coarse_converter_is_not_saturated():
    c = columns(1)
    checked(np.round(c["tension_tight_N"]), np.round(c["tension_slack_N"]))


def test_rows_that_an_even_time_base_leaves_out():
    t = 0.1 * np.arange(100)
    assert missing_rows(t) == 0
    assert missing_rows(np.delete(t, [10, 40, 41, 42])) == 4
    assert missing_rows(np.delete(t, [0, 99])) == 0
    uneven = np.cumsum(np.random.default_rng(0).uniform(0.05, 0.2, 100))
    assert missing_rows(uneven) == 0
    assert missing_rows(np.array([0.0, 0.0, 0.0, 5.0])) == 0
    # a tenth of the steps may differ, no more
    for k, expected in ((9, 9), (11, 0)):
        assert missing_rows(np.delete(0.1 * np.arange(101 + k), 5 + 9 * np.arange(k))) == expected

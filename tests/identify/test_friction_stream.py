"""Runs reduced one after the other give what they give together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltid.bench.recording import read_recording
from beltid.identify.friction.reduction import (
    FrictionSettings,
    RunReduction,
    reduce_runs,
    reduce_stream,
)
from beltid.identify.friction.run import lone_marks, run_records

RIG = Path(__file__).parents[2] / "rigdata" / "5pk" / "rig.csv"
RADIUS_M = 0.05


@pytest.fixture(scope="module")
def recording() -> dict[str, np.ndarray]:
    columns = read_recording(RIG, "rig").columns
    labels = dict.fromkeys(columns["run"])
    chosen = np.isin(columns["run"], list(labels)[::24])
    return {name: values[chosen] for name, values in columns.items()}


def backwards(function: Any, items: Iterable[Any]) -> Iterator[Any]:
    """A mapper that does the calls in another order, as other processes do."""
    waiting = list(items)
    results = [function(item) for item in reversed(waiting)]
    yield from reversed(results)


def same(some: Iterable[RunReduction], others: Iterable[RunReduction]) -> bool:
    return [repr(astuple(r)) for r in some] == [repr(astuple(r)) for r in others]


def test_streamed_runs_are_those_of_the_whole_recording(recording: dict[str, np.ndarray]) -> None:
    """The zero points of the cells differ, which only all runs together tell."""
    columns = {**recording, "tension_tight_N": recording["tension_tight_N"] + 2.5}
    settings = FrictionSettings()
    together = reduce_runs(columns, RADIUS_M, settings)
    records = iter(run_records(columns, RADIUS_M))
    assert same(reduce_stream(records, RADIUS_M, settings, backwards), together)
    assert any(run.ok for run in together)


def test_a_run_that_is_set_aside_keeps_its_place(recording: dict[str, np.ndarray]) -> None:
    columns = {name: values.copy() for name, values in recording.items()}
    labels = list(dict.fromkeys(columns["run"]))
    columns["pulley_speed_rad_s"][columns["run"] == labels[1]] = 0.0
    settings = FrictionSettings()
    streamed = reduce_stream(run_records(columns, RADIUS_M), RADIUS_M, settings)
    assert [r.run for r in streamed] == labels
    assert "never turns" in streamed[1].status
    others = {name: values[columns["run"] != labels[1]] for name, values in columns.items()}
    without = reduce_runs(others, RADIUS_M, settings)
    assert same((streamed[0], *streamed[2:]), without)


def test_marks_of_an_overflow_in_the_speed_change_nothing(recording: dict[str, np.ndarray]) -> None:
    marked = {**recording, "pulley_speed_rad_s": recording["pulley_speed_rad_s"].copy()}
    marked["pulley_speed_rad_s"][[30, 31, 250]] = -9999.0, -9999.0, 9.9e37  # of the first run
    clean, found = (reduce_runs(columns, RADIUS_M) for columns in (recording, marked))
    assert [run.treatment.n_marks for run in found] == [3] + [0] * (len(found) - 1)
    assert [run.mu_sliding for run in found] == pytest.approx([r.mu_sliding for r in clean], 1e-4)


@pytest.mark.parametrize(
    ("speed", "expected"),
    [
        ([0.0] * 40 + [0.2] * 60, []),
        ([1e-4] * 40 + [9e9] + [1e-4] * 20 + [0.2] * 39, [40]),
        # it rests nearly all the time, and then turns for longer than a mark lasts
        ([1e-4] * 196 + [0.2] * 4, []),
        ([1e-4] * 197 + [0.2] * 3, [197, 198, 199]),
        ([1e-4] * 50 + [np.nan] + [0.2] * 149, []),
    ],
)
def test_a_mark_is_large_and_short(speed: list[float], expected: list[int]) -> None:
    assert lone_marks(np.array(speed)).tolist() == expected

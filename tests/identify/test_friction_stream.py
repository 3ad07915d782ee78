"""What one run of a recording does to the others."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest

from beltid.bench.recording import read_recording
from beltid.identify.friction.reduction import RunReduction, reduce_runs
from beltid.identify.friction.run import lone_marks

RIG = Path(__file__).parents[2] / "rigdata" / "5pk" / "rig.csv"
RADIUS_M = 0.05


@pytest.fixture(scope="module")
def recording() -> dict[str, np.ndarray]:
    columns = read_recording(RIG, "rig").columns
    labels = dict.fromkeys(columns["run"])
    chosen = np.isin(columns["run"], list(labels)[::24])
    return {name: values[chosen] for name, values in columns.items()}


def same(some: Iterable[RunReduction], others: Iterable[RunReduction]) -> bool:
    return [repr(astuple(r)) for r in some] == [repr(astuple(r)) for r in others]


def test_a_run_that_is_set_aside_keeps_its_place(recording: dict[str, np.ndarray]) -> None:
    columns = {name: values.copy() for name, values in recording.items()}
    labels = list(dict.fromkeys(columns["run"]))
    columns["pulley_speed_rad_s"][columns["run"] == labels[1]] = 0.0
    reduced = reduce_runs(columns, RADIUS_M)
    assert [r.run for r in reduced] == labels
    assert "never turns" in reduced[1].status
    others = {name: values[columns["run"] != labels[1]] for name, values in columns.items()}
    assert same((reduced[0], *reduced[2:]), reduce_runs(others, RADIUS_M))


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

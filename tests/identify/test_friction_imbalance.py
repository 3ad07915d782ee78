"""What a bench's cells show at rest, on synthetic campaigns with a known fault of the cells."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from virtual_rig import Recipe, record

from beltid.identify.friction.reduction import FrictionSettings, RunReduction, reduce_runs

TENSIONS = np.tile([60.0, 120.0, 200.0, 300.0, 450.0], 3)
MU = 0.8
Fault = Callable[[np.ndarray, np.ndarray, np.ndarray, np.random.Generator, float], None]
"""Spoils time, tight and slack cell of a run in place; knows the initial tension."""


@cache
def campaign(fault: Fault, mode: object = "auto") -> tuple[RunReduction, ...]:
    rng = np.random.default_rng(11)
    parts = []
    for k, tension in enumerate(TENSIONS):
        part = record(Recipe(initial=tension, noise=0.3, seed=k))
        fault(part["time_s"], part["tension_tight_N"], part["tension_slack_N"], rng, tension)
        parts.append(part)
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    n = parts[0]["time_s"].size
    columns["run"] = np.repeat(np.arange(TENSIONS.size).astype(float), n)
    columns["arc_deg"] = np.full(n * TENSIONS.size, 82.0)
    return reduce_runs(columns, 0.05, FrictionSettings(correct_imbalance=mode))  # type: ignore[arg-type]


def none(t, tight, slack, rng, tension) -> None:  # type: ignore[no-untyped-def]
    """Leave the run as it is."""


def common_zero(t, tight, slack, rng, tension) -> None:  # type: ignore[no-untyped-def]
    tight += 0.7
    slack -= 0.7


def wandering_zero(t, tight, slack, rng, tension) -> None:  # type: ignore[no-untyped-def]
    shift = rng.uniform(-2.0, 2.0)
    tight += shift
    slack -= shift


def gains(t, tight, slack, rng, tension) -> None:  # type: ignore[no-untyped-def]
    tight *= 1.006
    slack *= 0.994


def score(runs: tuple[RunReduction, ...]) -> tuple[float, float]:
    """Relative error and error over standard error, root mean square."""
    assert all(run.ok for run in runs)
    error = np.array([run.mu_sliding - MU for run in runs])
    z = error / [run.mu_sliding_se for run in runs]
    return float(np.sqrt(np.mean((error / MU) ** 2))), float(np.sqrt(np.mean(z**2)))


@pytest.mark.parametrize(
    ("fault", "word", "value"),
    [
        pytest.param(
            common_zero,
            r"the zero points of the cells differ by ([+-][\d.]+) N",
            1.4,
            marks=pytest.mark.long,
        ),
        (wandering_zero, r"wander by ([\d.]+) N", 4.0 / np.sqrt(3.0)),
        (gains, r"the gains of the cells differ by ([+-][\d.]+) %", 1.2),
    ],
)
def test_a_fault_that_the_runs_explain_is_taken_off(fault: Fault, word: str, value: float) -> None:
    runs = campaign(fault)
    corrected, z = score(runs)
    plain = np.array([run.mu_sliding for run in campaign(fault, mode=False)])
    as_recorded = float(np.sqrt(np.mean((plain / MU - 1.0) ** 2)))
    assert corrected < 0.1 * as_recorded
    assert z < 1.25
    told = [match for run in runs for note in run.notes if (match := re.search(word, note))]
    # a zero that is small against the tension of its run is not told there
    assert len(told) >= 0.5 * len(runs)
    # the scatter of 15 zeros is known to a fifth
    assert float(told[0][1]) == pytest.approx(value, rel=0.3 if fault is wandering_zero else 0.02)


def test_cells_that_agree_are_left_alone() -> None:
    as_recorded = campaign(none, mode=False)
    for recorded, run in zip(as_recorded, campaign(none), strict=True):
        assert abs(run.mu_sliding - recorded.mu_sliding) < 0.1 * run.mu_sliding_se
        assert run.notes == ()

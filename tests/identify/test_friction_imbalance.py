"""What a bench's cells show at rest, on synthetic campaigns with a known fault of the cells."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from typing import Literal

import numpy as np
import pytest
from virtual_rig import RADIUS_M, TIGHT_UP, Recipe, bench

from beltid.identify.friction.reduction import FrictionSettings, RunReduction, reduce_runs

MU = 0.8
TENSIONS = np.tile([60.0, 120.0, 200.0, 300.0, 450.0], 3)
Fault = Callable[[np.ndarray], np.ndarray]
"""Spoils readings of the tight and the slack cell, shape (2, 15 runs, samples)."""


def none(cells: np.ndarray) -> np.ndarray:
    return cells


def common_zero(cells: np.ndarray) -> np.ndarray:
    return cells + 0.7 * TIGHT_UP


def wandering_zero(cells: np.ndarray) -> np.ndarray:
    return cells + TIGHT_UP * np.random.default_rng(11).uniform(-2.0, 2.0, (15, 1))


def gains(cells: np.ndarray) -> np.ndarray:
    return cells * (1.0 + 0.006 * TIGHT_UP)


@cache
def campaign(fault: Fault, mode: Literal["auto"] | bool = "auto") -> tuple[RunReduction, ...]:
    parts = [bench(Recipe(initial=T, noise=0.3, seed=k), 1) for k, T in enumerate(TENSIONS)]
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    columns["run"] = np.repeat(np.arange(15.0), columns["run"].size // 15)
    names = ("tension_tight_N", "tension_slack_N")
    cells = fault(np.array([columns[name] for name in names]).reshape(2, 15, -1))
    columns |= dict(zip(names, cells.reshape(2, -1), strict=True))
    return reduce_runs(columns, RADIUS_M, FrictionSettings(correct_imbalance=mode))


@pytest.mark.parametrize(
    ("fault", "word", "value", "off"),
    [
        (common_zero, r"the zero points of the cells differ by ([+-][\d.]+) N", 1.4, 0.02),
        # the scatter of 15 zeros is known to a fifth
        (wandering_zero, r"wander by ([\d.]+) N", 4.0 / np.sqrt(3.0), 0.3),
        (gains, r"the gains of the cells differ by ([+-][\d.]+) %", 1.2, 0.02),
    ],
)
def test_a_fault_that_the_runs_explain_is_taken_off(
    fault: Fault, word: str, value: float, off: float
) -> None:
    runs = campaign(fault)
    assert all(run.ok for run in runs)
    error, plain = (
        np.array([run.mu_sliding for run in found]) - MU for found in (runs, campaign(fault, False))
    )
    assert np.linalg.norm(error) < 0.1 * np.linalg.norm(plain)
    z = error / [run.mu_sliding_se for run in runs]
    assert np.sqrt(np.mean(z**2)) < 1.25
    told = [match for run in runs for note in run.notes if (match := re.search(word, note))]
    # a zero that is small against the tension of its run is not told there
    assert len(told) >= 0.5 * len(runs)
    assert float(told[0][1]) == pytest.approx(value, rel=off)


def test_cells_that_agree_are_left_alone() -> None:
    for recorded, run in zip(campaign(none, False), campaign(none), strict=True):
        assert abs(run.mu_sliding - recorded.mu_sliding) < 0.1 * run.mu_sliding_se
        assert run.notes == ()

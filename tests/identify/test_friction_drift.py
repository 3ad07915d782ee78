"""Load cells and friction that drift while the belt slides: the standard error allows for it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from virtual_rig import Recipe, bench

from beltid.identify.friction.reduction import reduce_runs

RADIUS_M = 0.05
RUNS = 16
BASE = Recipe()
Columns = dict[str, np.ndarray]


def scores(recipe: Recipe, spoil: Callable[[Columns], None]) -> tuple[np.ndarray, np.ndarray]:
    """Errors of mu over their standard errors, and relative standard errors."""
    columns = bench(recipe, RUNS)
    spoil(columns)
    runs = [run for run in reduce_runs(columns, RADIUS_M) if run.ok]
    assert len(runs) == RUNS
    mu, se = np.array([(run.mu_sliding, run.mu_sliding_se) for run in runs]).T
    return (mu - recipe.mu) / se, se / recipe.mu


def tare(tight: float, slack: float) -> Callable[[Columns], None]:
    """Zeros of the cells that drift by so many N over the 6 s of a run."""

    def spoil(columns: Columns) -> None:
        columns["tension_tight_N"] += tight * columns["time_s"] / 6.0
        columns["tension_slack_N"] += slack * columns["time_s"] / 6.0

    return spoil


def second_ripple(period_s: float) -> Callable[[Columns], None]:
    """Another ripple, of 0.3 % and any phase."""

    def spoil(columns: Columns) -> None:
        phase = np.random.default_rng(7).uniform(0.0, 6.28, RUNS)[columns["run"].astype(int)]
        turned = np.maximum(columns["time_s"] - BASE.rest, 0.0)
        wave = 0.003 * np.sin(2.0 * np.pi * turned / period_s + phase) * (turned > 0.0)
        columns["tension_tight_N"] *= 1.0 + wave
        columns["tension_slack_N"] *= 1.0 + 0.75 * wave

    return spoil


@pytest.mark.parametrize(
    ("tight", "slack"),
    [
        (1, 0),
        pytest.param(0, -1, marks=pytest.mark.long),
        pytest.param(
            1,
            1,
            marks=[pytest.mark.xfail(reason="a rest of 1 s does not tell it"), pytest.mark.long],
        ),
        pytest.param(-1, -1, marks=pytest.mark.long),
        (1, -1),
    ],
)
def test_a_cell_that_drifts_by_one_newton_is_allowed_for(tight: float, slack: float) -> None:
    z, _ = scores(BASE, tare(tight, slack))
    assert np.mean(np.abs(z) < 1.96) > 0.9


@pytest.mark.parametrize("tight", [1, pytest.param(-1, marks=pytest.mark.long)])
def test_so_it_is_where_there_is_no_peak(tight: float) -> None:
    z, _ = scores(BASE.but(peak=0.0), tare(0.0, tight))
    assert np.mean(np.abs(z) < 1.96) > 0.9


@pytest.mark.parametrize(
    "period_s", [0.8, *(pytest.param(s, marks=pytest.mark.long) for s in (0.31, 2.1, 4.5, 7.0))]
)
def test_two_ripples_are_told_apart_or_allowed_for(period_s: float) -> None:
    z, _ = scores(BASE, second_ripple(period_s))
    assert np.mean(np.abs(z) < 1.96) > 0.85  # 16 runs: 0.95 less two standard deviations


@pytest.mark.parametrize(
    "period_s", [8.0, *(pytest.param(s, marks=pytest.mark.long) for s in (5.0, 12.0))]
)
def test_a_ripple_longer_than_the_sliding_phase_is_allowed_for(period_s: float) -> None:
    z, _ = scores(BASE.but(ripple_period=period_s), lambda columns: None)
    assert np.mean(np.abs(z) < 1.96) > 0.9


def test_without_a_drift_nothing_is_allowed_for() -> None:
    z, se = scores(BASE, lambda columns: None)
    assert np.sqrt(np.mean(z**2)) < 1.35
    assert np.max(se) < 0.001  # independent samples of 4.7 s alone give 0.00024

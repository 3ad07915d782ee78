"""Intervals hold and peaks meet the truth; `benchmarks/coverage.py` measures all benches."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from press_bench import read
from scipy.signal import lfilter
from virtual_rig import RADIUS_M, draw, reduce_runs

Array = np.ndarray
LONG = pytest.mark.long
ROOT = Path(__file__).parents[2]


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize(
    ("name", "n", "most"),
    [
        # one error that all runs share
        ("zero of the tight cell drifts by 1 N in a run", 16, 1.6),
        pytest.param("zero of the tight cell wanders 0.5 N in 10 s", 60, 1.25, marks=LONG),
        pytest.param("AR noise 0.2 s, 0.5 N", 240, 1.25, marks=LONG),
    ],
)
def test_intervals_are_as_wide_as_the_errors(name: str, n: int, most: float) -> None:
    drawn = draw(name, n)
    runs = reduce_runs(drawn.columns, RADIUS_M)
    kept = np.array([run.ok for run in runs])
    assert np.mean(kept) >= 0.9
    z = np.array([run.mu_sliding for run in runs]) - drawn.mu
    z = (z / [run.mu_sliding_se for run in runs])[kept]
    # 0.95 less two standard deviations of 16 runs
    assert np.mean(np.abs(z) < 1.96) > 0.85
    assert rms(z) <= most


def columns_of(
    t: Array, ratio: Array, noise: Array, tension: Array, arc: Array, speed: Array
) -> dict[str, Array]:
    """Recording of runs (n,) at times (m,) with ln(T_tight/T_slack) (n, m), whose sum stays."""
    n, m = ratio.shape
    slack = 2.0 * tension[:, None] / (1.0 + np.exp(ratio))
    return {
        "run": np.repeat([f"R{k:02d}" for k in range(n)], m),
        "time_s": np.tile(t, n),
        "tension_tight_N": (2.0 * tension[:, None] - slack + noise[0]).ravel(),
        "tension_slack_N": (slack + noise[1]).ravel(),
        "pulley_speed_rad_s": np.where(ratio > 0.0, speed[:, None] / RADIUS_M, 0.0).ravel(),
        "arc_deg": np.repeat(arc, m),
        "initial_tension_N": np.repeat(tension, m),
    }


def test_noise_that_is_slower_than_the_sliding_is_seen_at_rest() -> None:
    """Correlated over 0.1 s, it is a constant in a sliding of 0.06 s, a different one in each."""
    rng = np.random.default_rng(11)
    n, t = 36, np.arange(2060) / 1000.0
    tension, arc = rng.uniform(80.0, 300.0, n), rng.choice([60.0, 90.0, 140.0], n)
    build_up = 1.0 - np.exp(-np.maximum(t - 2.0, 0.0) / 2.5e-4)
    memory = np.exp(-1.0 / 100.0)
    steps = rng.normal(0.0, 0.3 * np.sqrt(1.0 - memory**2), (2, n, t.size + 1000))
    noise = lfilter([1.0], [1.0, -memory], steps)[..., 1000:]
    ratio = 0.3 * np.radians(arc)[:, None] * build_up
    runs = reduce_runs(columns_of(t, ratio, noise, tension, arc, np.full(n, 0.4)), RADIUS_M)
    z = np.array([(run.mu_sliding - 0.3) / run.mu_sliding_se for run in runs])
    assert all(run.ok for run in runs)
    assert np.mean(np.abs(z) < 1.96) > 0.85
    assert 0.6 <= rms(z) <= 1.25


BELTS = [pytest.param(belt, marks=LONG) for belt in ("4pk", "6pk")]


@pytest.mark.parametrize("belt", ["5pk", *BELTS])
def test_sticking_coefficient_meets_the_truth_at_every_speed_that_resolves_it(belt: str) -> None:
    runs = reduce_runs(read(ROOT / "rigdata" / belt / "rig.csv"), 0.05)
    truth = read(ROOT / "tests" / "truth" / belt / "truth.csv")
    error = np.array([run.mu_sticking for run in runs]) / truth["mu_stick"] - 1.0
    slow, seen = truth["omega"] <= 0.1, np.isfinite(error)
    assert np.all(seen[slow])
    assert rms(error[slow]) < 0.004
    assert np.max(np.abs(error[seen])) < 0.03
    assert [not run.mu_sticking_reason for run in runs] == seen.tolist()

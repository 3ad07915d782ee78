"""Slow noise is seen at rest, and peaks meet the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter
from virtual_rig import RADIUS_M, reduce_runs

Array = np.ndarray
LONG = pytest.mark.long
ROOT = Path(__file__).parents[2]


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


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
    slack = 2.0 * tension[:, None] / (1.0 + np.exp(ratio))
    columns = {
        "run": np.repeat([f"R{k:02d}" for k in range(n)], t.size),
        "time_s": np.tile(t, n),
        "tension_tight_N": (2.0 * tension[:, None] - slack + noise[0]).ravel(),
        "tension_slack_N": (slack + noise[1]).ravel(),
        "pulley_speed_rad_s": np.where(ratio > 0.0, 0.4 / RADIUS_M, 0.0).ravel(),
        "arc_deg": np.repeat(arc, t.size),
        "initial_tension_N": np.repeat(tension, t.size),
    }
    runs = reduce_runs(columns, RADIUS_M)
    z = np.array([(run.mu_sliding - 0.3) / run.mu_sliding_se for run in runs])
    assert all(run.ok for run in runs)
    assert np.mean(np.abs(z) < 1.96) > 0.85
    assert 0.6 <= rms(z) <= 1.25


BELTS = [pytest.param(belt, marks=LONG) for belt in ("4pk", "6pk")]


@pytest.mark.parametrize("belt", ["5pk", *BELTS])
def test_sticking_coefficient_meets_the_truth_at_every_speed_that_resolves_it(belt: str) -> None:
    recording = pd.read_csv(ROOT / "rigdata" / belt / "rig.csv", dtype={"run": str})
    truth = pd.read_csv(ROOT / "tests" / "truth" / belt / "truth.csv")
    runs = reduce_runs({name: recording[name].to_numpy() for name in recording}, 0.05)
    error = np.array([run.mu_sticking for run in runs]) / truth["mu_stick"].to_numpy() - 1.0
    slow, seen = truth["omega"].to_numpy() <= 0.1, np.isfinite(error)
    assert np.all(seen[slow])
    assert rms(error[slow]) < 0.004
    assert np.max(np.abs(error[seen])) < 0.03
    assert [not run.mu_sticking_reason for run in runs] == seen.tolist()

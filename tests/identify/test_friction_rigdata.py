"""The sticking peak against the truth of the virtual bench: three belts, 120 runs each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from press_bench import read
from virtual_rig import reduce_runs

ROOT = Path(__file__).parents[2]
BELTS = [pytest.param(belt, marks=pytest.mark.long) for belt in ("4pk", "6pk")]


@pytest.mark.parametrize("belt", ["5pk", *BELTS])
def test_sticking_coefficient_meets_the_truth_at_every_speed_that_resolves_it(belt: str) -> None:
    runs = reduce_runs(read(ROOT / "rigdata" / belt / "rig.csv"), 0.05)
    truth = read(ROOT / "tests" / "truth" / belt / "truth.csv")
    error = np.array([run.mu_sticking for run in runs]) / truth["mu_stick"] - 1.0
    slow, seen = truth["omega"] <= 0.1, np.isfinite(error)
    assert np.all(seen[slow])
    assert np.sqrt(np.mean(error[slow] ** 2)) < 0.004
    assert np.max(np.abs(error[seen])) < 0.03
    assert [not run.mu_sticking_reason for run in runs] == seen.tolist()

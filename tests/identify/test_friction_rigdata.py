"""The reduction against the truth of the virtual bench: three belts, 120 runs each."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from press_bench import read
from virtual_rig import reduce_runs

from beltid.identify.friction.reduction import RunReduction

ROOT = Path(__file__).parents[2]
BELTS = ("4pk", "5pk", "6pk")
QUICK_AND_LONG = [
    pytest.param(belt, marks=() if belt == "5pk" else pytest.mark.long) for belt in BELTS
]


@lru_cache
def recording(belt: str) -> dict[str, np.ndarray]:
    return read(ROOT / "rigdata" / belt / "rig.csv")


@lru_cache
def reduced(belt: str) -> tuple[RunReduction, ...]:
    return reduce_runs(recording(belt), 0.05)


@lru_cache
def truth(belt: str) -> dict[str, np.ndarray]:
    return read(ROOT / "tests" / "truth" / belt / "truth.csv")


def column(belt: str, name: str) -> np.ndarray:
    return np.array([getattr(run, name) for run in reduced(belt)])


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


@pytest.mark.parametrize("belt", QUICK_AND_LONG)
def test_sticking_coefficient_meets_the_truth_at_every_speed_that_resolves_it(belt: str) -> None:
    sticking, speed = column(belt, "mu_sticking"), truth(belt)["omega"]
    error = sticking / truth(belt)["mu_stick"] - 1.0
    slow = speed <= 0.1
    assert np.all(np.isfinite(error[slow]))
    assert rms(error[slow]) < 0.004
    seen = np.isfinite(error)
    assert np.max(np.abs(error[seen])) < 0.03
    reasons = column(belt, "mu_sticking_reason")
    assert np.all((reasons == "") == seen)


def test_known_faults_of_the_recording_are_counted() -> None:
    by_name = {run.run: run for run in reduced("5pk")}
    assert by_name["R097"].n_spikes == 3  # first sample, 3.4 s and 6.2 s
    gaps = recording("5pk")["run"][np.isnan(recording("5pk")["tension_slack_N"])]
    names, counts = np.unique(gaps.astype(str), return_counts=True)
    found = {run.run: run.n_missing for run in reduced("5pk") if run.n_missing}
    assert found == dict(zip(names.tolist(), counts.tolist(), strict=True))


@pytest.mark.long
def test_rows_of_a_run_need_not_be_together() -> None:
    table = recording("5pk")
    chosen = np.isin(table["run"], ["R001", "R050", "R111"])
    together = {name: values[chosen] for name, values in table.items()}
    order = np.argsort(together["time_s"], kind="stable")
    shuffled = {name: values[order] for name, values in together.items()}
    by_name = {run.run: run for run in reduce_runs(shuffled, 0.05)}
    for run in reduce_runs(together, 0.05):
        # repr: nan equals nan
        assert repr(by_name[run.run]) == repr(run)

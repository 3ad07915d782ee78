"""Known errors of the load cells: a distorted recording, corrected, is the undistorted one."""

from __future__ import annotations

import numpy as np
import pytest
from virtual_rig import Recipe, bench, reduce_runs

from beltid.identify.friction.reduction import RunReduction
from beltid.identify.friction.run import KnownCell, RigKind

KNOWN = RigKind(cells=(KnownCell(4.0, 1.03), KnownCell(-2.5, 0.98)))
SAME = ("mu_sliding", "mu_sliding_se", "tension_tight_N", "normal_force_N_m", "imbalance_N")


def distorted(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What cells with the known errors would have read."""
    tight = columns["tension_tight_N"] / 1.03 + 4.0
    slack = columns["tension_slack_N"] / 0.98 - 2.5
    return {**columns, "tension_tight_N": tight, "tension_slack_N": slack}


def tared(tight_N: float) -> RigKind:
    return RigKind(cells=(KnownCell(tare_N=tight_N), KnownCell()))


def numbers(runs: tuple[RunReduction, ...]) -> np.ndarray:
    return np.array([[getattr(run, name) for name in SAME] for run in runs])


def test_a_corrected_recording_gives_the_numbers_of_the_undistorted_one() -> None:
    columns = bench(Recipe(arc_deg=82.0), 4)
    true = reduce_runs(columns, 0.05)
    found = reduce_runs(distorted(columns), 0.05, kind=KNOWN)
    # the search for the sizes of the noise ends where they no longer matter
    np.testing.assert_allclose(numbers(found), numbers(true), rtol=1e-3, atol=1e-7)
    np.testing.assert_allclose(numbers(found)[:, 0], numbers(true)[:, 0], rtol=1e-6)


def test_what_a_calibration_leaves_is_still_seen_at_rest() -> None:
    columns = bench(Recipe(offset=3.0), 4)
    runs = reduce_runs(columns, 0.05, kind=tared(3.0))
    # +1.5 N on the tight and -1.5 N on the slack cell: no difference is left, but both read
    # 1.5 N too little, which no comparison of the cells can show
    assert all(abs(run.imbalance_N) < 0.6 for run in runs)
    assert np.mean([run.initial_tension_N for run in runs]) == pytest.approx(268.5, abs=0.1)
    left = reduce_runs(columns, 0.05, kind=tared(1.5))
    assert np.mean([run.imbalance_N for run in left]) == pytest.approx(1.5, abs=0.2)


def test_exchanged_columns_keep_their_cells() -> None:
    columns = bench(Recipe(), 3)
    swapped = {
        **columns,
        "tension_tight_N": columns["tension_slack_N"] - 4.0,
        "tension_slack_N": columns["tension_tight_N"],
    }
    found = reduce_runs(swapped, 0.05, kind=tared(-4.0))
    for run, true in zip(found, reduce_runs(columns, 0.05), strict=True):
        assert run.swapped
        assert run.mu_sliding == pytest.approx(true.mu_sliding, rel=1e-6)

"""Known errors of the load cells: a distorted recording, corrected, is the undistorted one."""

from __future__ import annotations

import io
from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest
from virtual_rig import Recipe, bench

import beltid
from beltid.identify.friction.kinds import KnownCell, KnownCells, RigKind
from beltid.identify.friction.reduction import RunReduction, reduce_runs
from beltid.identify.friction.rest import against_stated

KNOWN = RigKind(cells=KnownCells(KnownCell(4.0, 1.03), KnownCell(-2.5, 0.98)))
SAME = ("mu_sliding", "mu_sliding_se", "tension_tight_N", "normal_force_N_m", "imbalance_N")


def distorted(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What cells with the known errors would have read."""
    tight = columns["tension_tight_N"] / 1.03 + 4.0
    slack = columns["tension_slack_N"] / 0.98 - 2.5
    return {**columns, "tension_tight_N": tight, "tension_slack_N": slack}


def tared(tight_N: float) -> RigKind:
    return RigKind(cells=KnownCells(tight=KnownCell(tare_N=tight_N)))


def numbers(runs: tuple[RunReduction, ...]) -> np.ndarray:
    return np.array([[getattr(run, name) for name in SAME] for run in runs])


def test_a_corrected_recording_gives_the_numbers_of_the_undistorted_one() -> None:
    columns = bench(Recipe(arc_deg=82.0), 8)
    true = reduce_runs(columns, 0.05)
    found = reduce_runs(distorted(columns), 0.05, kind=KNOWN)
    # the search for the sizes of the noise ends where they no longer matter
    np.testing.assert_allclose(numbers(found), numbers(true), rtol=1e-3, atol=1e-7)
    np.testing.assert_allclose(numbers(found)[:, 0], numbers(true)[:, 0], rtol=1e-6)
    for run in found:
        assert "tight cell tare 4 N, gain 1.03;" in run.treatment.cells.note
    assert not any(run.treatment.cells.note for run in true)


def test_what_a_calibration_leaves_is_still_seen_at_rest() -> None:
    columns = bench(Recipe(offset=3.0), 8)
    runs = reduce_runs(columns, 0.05, kind=tared(3.0))
    # +1.5 N on the tight and -1.5 N on the slack cell: no difference is left, but both read
    # 1.5 N too little, which no comparison of the cells can show
    assert all(abs(run.imbalance_N) < 0.6 for run in runs)
    assert np.mean([run.initial_tension_N for run in runs]) == pytest.approx(268.5, abs=0.1)
    left = reduce_runs(columns, 0.05, kind=tared(1.5))
    assert np.mean([run.imbalance_N for run in left]) == pytest.approx(1.5, abs=0.2)


def test_exchanged_columns_keep_their_cells() -> None:
    columns = bench(Recipe(), 5)
    swapped = {
        **columns,
        "tension_tight_N": columns["tension_slack_N"] - 4.0,
        "tension_slack_N": columns["tension_tight_N"],
    }
    found = reduce_runs(swapped, 0.05, kind=tared(-4.0))
    for run, true in zip(found, reduce_runs(columns, 0.05), strict=True):
        assert run.swapped
        assert run.mu_sliding == pytest.approx(true.mu_sliding, rel=1e-6)


# --- tensions at rest against the stated ones ---

STATED = np.repeat([50.0, 100.0, 160.0, 220.0, 270.0, 310.0, 360.0, 411.0], 5)


def at_rest(offset: float = 0.0, factor: float = 1.0, seed: int = 0) -> np.ndarray:
    """Set to 1 % and 1 N, two runs by mistake to something else."""
    rng = np.random.default_rng(seed)
    measured = offset + factor * STATED * (1.0 + 0.01 * rng.normal(size=40)) + rng.normal(size=40)
    measured[[3, 30]] += 80.0
    return measured


def test_tensions_at_rest_are_as_stated_but_for_their_scatter() -> None:
    for seed in range(20):
        assert not against_stated(at_rest(seed=seed), STATED)
    assert not against_stated(at_rest(offset=3.0), STATED)
    assert not against_stated(at_rest(factor=0.95), STATED)
    assert not against_stated(at_rest(offset=30.0), np.full(40, np.nan))
    assert not against_stated(at_rest(offset=30.0)[:3], STATED[:3])


@pytest.mark.parametrize("levels", [(270, 411), (310, 411), (360, 411)])
def test_levels_set_with_a_scatter_of_their_own_are_no_tare(
    levels: tuple[int, ...], part_of_rig: Callable[..., str]
) -> None:
    """At 82 deg they are off by +3.1 (270 N), +0.6 (310), -0.6 (360) and -10.9 N (411 N)."""
    recording = pd.read_csv(io.StringIO(part_of_rig((82,), levels, (0.05, 0.1, 0.21))))
    assert set(beltid.fit_friction(recording).columns["status"]) == {"ok"}
    cells = ["tension_tight_N", "tension_slack_N"]
    with pytest.raises(beltid.InputError, match="tare_N"):
        beltid.fit_friction(recording.assign(**{c: recording[c] + 80.0 for c in cells}))


@pytest.mark.parametrize("offset", [30.0, 20.0, -15.0])
def test_cells_that_were_not_tared_are_recognised_by_their_offset(offset: float) -> None:
    said = against_stated(at_rest(offset=offset), STATED)
    assert "tension_tight_tare_N" in said
    assert float(said.split("rest are ")[1].split(" N")[0]) == pytest.approx(offset, abs=2.0)


def test_cells_in_another_unit_are_recognised_by_their_factor() -> None:
    said = against_stated(at_rest(factor=1.0 / 4.448), STATED)
    assert "units.rig" in said
    assert float(said.split("rest are ")[1].split(" ")[0]) == pytest.approx(0.2248, rel=0.02)

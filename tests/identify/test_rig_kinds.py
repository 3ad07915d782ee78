"""Benches of other kinds give what two cells give, where they tell the same.

The recordings are synthetic: the 120 runs of the 5PK rig, rewritten as another bench would have
recorded them. Torque, hub force and the tensions of a moving belt follow from both tensions sample
by sample, so the friction coefficient must be the same to rounding. A dead weight has no noise on
its side, so there the runs are compared without their noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from virtual_rig import reduce_runs

from beltid.errors import InputError
from beltid.identify.friction.reduction import RunReduction, reduce_plateaus
from beltid.identify.friction.run import KnownCell, RigKind, drag_of, run_records
from beltid.stages.friction import reduction_columns

R = 0.05
RIG = Path(__file__).parents[2] / "rigdata/5pk/rig.csv"
Columns = dict[str, Any]


def without(columns: Mapping[str, Any], *names: str) -> Columns:
    return {name: values for name, values in columns.items() if name not in names}


def by_torque(columns: Columns, span: str) -> Columns:
    """The same bench with a torque sensor, and a cell in one span."""
    torque = (columns["tension_tight_N"] - columns["tension_slack_N"]) * R
    other = {"tight": "slack", "slack": "tight"}[span]
    return {**without(columns, f"tension_{other}_N"), "torque_N_m": torque}


def by_hub(columns: Columns) -> Columns:
    """With a torque sensor and the force on the axis, as the length of the sum of both vectors."""
    tight, slack = columns["tension_tight_N"], columns["tension_slack_N"]
    beta = np.radians(columns["arc_deg"])
    hub = np.hypot(tight * np.cos(beta) - slack, tight * np.sin(beta))
    bare = without(columns, "tension_tight_N", "tension_slack_N")
    return {**bare, "torque_N_m": (tight - slack) * R, "hub_force_N": hub}


def running(columns: Columns, v_b: float, m: float) -> Columns:
    """On a belt that moves at v_b: its momentum adds to both tensions, the speed to the pulley's.

    Before it slides, the pulley's surface is as fast as the belt.
    """
    more = m * v_b**2
    return {
        **columns,
        "tension_tight_N": columns["tension_tight_N"] + more,
        "tension_slack_N": columns["tension_slack_N"] + more,
        "pulley_speed_rad_s": columns["pulley_speed_rad_s"] + v_b / R,
        "belt_speed_m_s": np.full(len(columns["time_s"]), v_b),
    }


def mu(runs: tuple[RunReduction, ...]) -> np.ndarray:
    assert all(run.ok for run in runs), [run.status for run in runs if not run.ok][:3]
    return np.array([run.mu_sliding for run in runs])


def se(runs: tuple[RunReduction, ...]) -> np.ndarray:
    return np.array([run.mu_sliding_se for run in runs])


@pytest.fixture(scope="module")
def rig() -> Columns:
    """Every eleventh run of the recording, runs of all speeds and arcs."""
    frame = pd.read_csv(RIG, dtype={"run": str})
    labels = list(dict.fromkeys(frame["run"]))
    some = frame[frame["run"].isin(labels[::11])]
    return {name: some[name].to_numpy() for name in some.columns}


@pytest.fixture(scope="module")
def two_cells(rig: Columns) -> tuple[RunReduction, ...]:
    return reduce_runs(rig, R)


MOVING = RigKind(running=True, mass_per_length_kg_m=0.1)


def by_weight(columns: Columns, span: str) -> Columns:
    """On a dead weight as heavy as the initial tension; the cell makes up the ratio."""
    weight = columns["initial_tension_N"].astype(float)
    ratio = columns["tension_tight_N"] / columns["tension_slack_N"]
    other, tension = ("slack", weight / ratio) if span == "tight" else ("tight", weight * ratio)
    bare = without(columns, "tension_tight_N", "tension_slack_N", "initial_tension_N")
    return {**bare, "weight_N": weight, f"tension_{other}_N": tension}


MOVING_HUB = RigKind("torque_hub", running=True)


@pytest.mark.parametrize(
    ("rewritten", "kind"),
    [
        (lambda c: by_torque(c, "tight"), RigKind("torque")),
        (lambda c: running(c, 20.0, 0.1), MOVING),
        # the force on the axis has no part of the momentum of the belt
        (
            lambda c: by_hub(running(c, 20.0, 0.0)),
            MOVING_HUB,
        ),
    ],
    ids=["torque", "running", "running hub"],
)
def test_what_two_cells_show_is_found_from_other_channels(rig, two_cells, rewritten, kind):
    runs = reduce_runs(rewritten(rig), R, kind)
    assert len(runs) == len(two_cells)
    assert np.abs(mu(runs) - mu(two_cells)).max() < 1e-6
    # the variances of the bench are sought until nothing changes by more than 1e-4 of them
    assert se(runs) == pytest.approx(se(two_cells), rel=1e-4)
    for name in ("initial_tension_N", "slip_speed_m_s", "normal_force_N_m", "tension_slack_N"):
        expected = [getattr(run, name) for run in two_cells]
        assert [getattr(run, name) for run in runs] == pytest.approx(expected, rel=1e-6)


def plateaus(runs: tuple[RunReduction, ...]) -> Columns:
    """A level at rest and one that slides, without noise, at the settings of some runs."""
    n, parts = 70, []
    turns = np.arange(n) >= 10
    for run in runs:
        half = 0.5 * run.mu_sliding * np.radians(run.arc_deg) * turns
        T = run.nominal_tension_N
        parts.append(
            {
                "run": np.repeat(run.run, n),
                "time_s": np.arange(n) * 5e-5 / run.slip_speed_m_s,
                "tension_tight_N": T * np.exp(half),
                "tension_slack_N": T * np.exp(-half),
                "pulley_speed_rad_s": np.where(turns, run.pulley_speed_rad_s, 0.0),
                "arc_deg": np.repeat(run.arc_deg, n),
                "initial_tension_N": np.repeat(T, n),
            }
        )
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def test_a_weight_beside_a_torque_gives_the_plateau_of_two_cells(two_cells):
    cells = plateaus(two_cells)
    weighed = by_weight(cells, "tight")
    torque = (weighed["weight_N"] - weighed["tension_slack_N"]) * R
    columns = {**without(weighed, "tension_slack_N"), "torque_N_m": torque}
    runs = reduce_runs(columns, R, RigKind("torque", weight_on="tight"))
    assert np.abs(mu(runs) - mu(reduce_runs(cells, R))).max() < 1e-6
    for run in runs:
        assert run.tension_tight_N == run.initial_tension_N == run.nominal_tension_N
    with pytest.raises(InputError, match=r"rig\.holds"):
        reduce_runs(columns, R, RigKind("torque", weight_stated=False))


def one_of(columns: Columns, n: int = 8) -> Columns:
    labels = list(dict.fromkeys(columns["run"]))[:n]
    rows = np.isin(columns["run"], labels)
    return {name: values[rows] for name, values in columns.items()}


def idle_run(drag_N_m: float, zero_N_m: float, speed: float = 0.21) -> Columns:
    turns = np.arange(100) >= 20
    return {
        "run": np.full(100, "idle"),
        "time_s": np.arange(100) * 0.02,
        "torque_N_m": np.where(turns, drag_N_m, 0.0) + zero_N_m,
        "pulley_speed_rad_s": np.where(turns, speed, 0.0),
        "arc_deg": np.full(100, 82.0),
        "initial_tension_N": np.full(100, 100.0),
        "idle": np.full(100, "true", dtype=object),
    }


def test_drag_and_zero_of_the_torque_are_taken_off_by_an_idle_run(rig, two_cells):
    part = one_of(rig)
    torque = by_torque(part, "tight")
    turns = np.abs(torque["pulley_speed_rad_s"]) > 0.02
    torque["torque_N_m"] = torque["torque_N_m"] + 0.12 * turns + 0.3
    idle = idle_run(0.12, 0.3)
    torque["idle"] = np.full(len(turns), None)
    idle["tension_tight_N"] = np.full(100, 5.0)
    whole = {name: np.concatenate([torque[name], values]) for name, values in idle.items()}
    runs = reduce_runs(whole, R, RigKind("torque"))
    assert [run.run for run in runs] == list(dict.fromkeys(part["run"]))
    assert mu(runs) == pytest.approx(mu(reduce_runs(part, R)), abs=1e-6)


def test_the_drag_is_that_of_the_nearest_idle_speed_and_none_at_rest():
    drag = drag_of([idle_run(0.2, 0.0, 1.0), idle_run(0.1, 0.0, 0.5)])
    assert drag is not None
    found = drag.at(np.array([0.0, 0.25, 0.75, 2.0]))
    assert found == pytest.approx([0.0, 0.1, 0.15, 0.2])
    assert drag_of([]) is None


def test_a_torque_of_a_pulley_that_turns_backwards_counts_in_its_sense(rig):
    part = one_of(rig)
    forwards = by_torque(part, "slack")
    backwards = {name: -forwards[name] for name in ("torque_N_m", "pulley_speed_rad_s")}
    runs = [reduce_runs(c, R, RigKind("torque")) for c in (forwards, forwards | backwards)]
    assert mu(runs[1]) == pytest.approx(mu(runs[0]), rel=1e-12)


def statuses(columns: Columns, kind: RigKind) -> set[str]:
    return {run.status for run in reduce_runs(columns, R, kind)}


def test_a_weight_on_the_other_span_is_reported(rig):
    wrong = by_weight(one_of(rig), "tight")
    wrong["tension_tight_N"] = wrong.pop("tension_slack_N")
    (status,) = statuses(wrong, RigKind("dead_weight", weight_on="slack"))
    assert "weight hangs on the tight span" in status


def test_a_torque_of_the_other_sign_is_reported(rig):
    wrong = by_torque(one_of(rig), "tight")
    wrong["torque_N_m"] = -wrong["torque_N_m"]
    (status,) = statuses(wrong, RigKind("torque"))
    assert 'columns: {rig: {torque_N_m: "-torque_N_m"}}' in status


def test_a_whole_turn_tells_nothing_by_the_hub_force_and_is_warned_of(rig):
    part = one_of(rig)
    part["arc_deg"] = np.full(len(part["run"]), 360.0)
    (status,) = statuses(by_hub(part), RigKind("torque_hub"))
    assert "missing in 100 %" in status
    notes = reduction_columns(reduce_runs(part, R))["notes"]
    assert all("turns touch" in note for note in notes)


def test_a_known_error_of_the_only_cell_is_in_both_tensions(rig):
    part = by_torque(one_of(rig), "slack")
    off = {**part, "tension_slack_N": part["tension_slack_N"] / 1.02 + 3.0}
    known = RigKind("torque", cells=(KnownCell(), KnownCell(tare_N=3.0, gain=1.02)))
    for one, other in zip(
        run_records(off, R, known), run_records(part, R, RigKind("torque")), strict=True
    ):
        for name in ("tension_tight_N", "tension_slack_N"):
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-12)


def test_drag_is_taken_off_a_table_that_states_the_sliding_speed():
    arc, slack = np.array([80.0, 120.0, np.nan]), np.array([60.0, 90.0, np.nan])
    torque = slack * np.expm1(0.5 * np.radians(arc)) * R + 0.12
    table = {
        "run": np.array(["a", "b", "idle"]),
        "idle": np.array([None, None, "true"]),
        "arc_deg": arc,
        "tension_slack_N": slack,
        "torque_N_m": np.append(torque[:2], 0.12),
        "slip_speed_m_s": np.full(3, 0.01),
    }
    runs = reduce_plateaus(table, R, RigKind("torque"))
    assert mu(runs) == pytest.approx([0.5, 0.5], rel=1e-12)
    assert [run.pulley_speed_rad_s for run in runs] == pytest.approx([0.2, 0.2], rel=1e-12)

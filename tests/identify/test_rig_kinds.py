"""Benches of other kinds give what two cells give, where they tell the same; or say why not.

Which kinds give the truth is in the corpus.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from golden.benches import R, Rig
from virtual_rig import reduce_runs

from beltid.errors import InputError
from beltid.identify.friction.reduction import RunReduction, reduce_plateaus
from beltid.identify.friction.run import KnownCell, RigKind, idle_torque, run_records
from beltid.stages.friction import reduction_columns

Columns = dict[str, Any]
CELLS = ("tension_tight_N", "tension_slack_N")
BESIDE = ("torque_N_m", "hub_force_N", "weight_N")


def without(columns: Mapping[str, Any], *names: str) -> Columns:
    return {name: values for name, values in columns.items() if name not in names}


def running(columns: Columns, v_b: float, m: float) -> Columns:
    """On a belt that moves at v_b: its momentum adds to both tensions, the speed to the pulley's.

    Before it slides, the pulley's surface is as fast as the belt.
    """
    more = {name: columns[name] + m * v_b**2 for name in CELLS}
    speed = columns["pulley_speed_rad_s"] + v_b / R
    belt = np.full(len(columns["time_s"]), v_b)
    return {**columns, **more, "pulley_speed_rad_s": speed, "belt_speed_m_s": belt}


def recording_of(rig: Rig) -> Columns:
    frame = rig.recording()
    return {name: frame[name].to_numpy() for name in frame}


def mu(runs: tuple[RunReduction, ...]) -> np.ndarray:
    assert all(run.ok for run in runs), [run.status for run in runs if not run.ok][:3]
    return np.array([run.mu_sliding for run in runs])


@pytest.fixture(scope="module")
def bench() -> Columns:
    """Three runs of a made-up bench, with every channel."""
    return recording_of(Rig(arcs_deg=(82.0,), speeds_rad_s=(0.84,)))


@pytest.fixture(scope="module")
def by_torque(bench: Columns) -> np.ndarray:
    """Coefficients of the bench by its torque and the cell of the slack span."""
    return mu(reduce_runs(without(bench, "tension_tight_N"), R, RigKind("torque")))


@pytest.mark.parametrize(
    ("rewritten", "kind"),
    [
        (lambda c: running(c, 20.0, 0.1), RigKind(running=True, mass_per_length_kg_m=0.1)),
        # the force on the axis has no part of the momentum of the belt
        (lambda c: without(running(c, 20.0, 0.0), *CELLS), RigKind("torque_hub", running=True)),
    ],
    ids=["running", "running hub"],
)
def test_a_running_belt_gives_what_one_at_rest_gives(bench, rewritten, kind):
    runs = reduce_runs(rewritten(bench), R, kind)
    two_cells = reduce_runs(without(bench, *BESIDE), R)
    assert np.all(np.abs(mu(runs) - mu(two_cells)) < [0.01 * run.mu_sliding_se for run in runs])
    for name in ("initial_tension_N", "slip_speed_m_s", "normal_force_N_m", "tension_slack_N"):
        expected = [getattr(run, name) for run in two_cells]
        assert [getattr(run, name) for run in runs] == pytest.approx(expected, rel=1e-6)


def test_few_runs_with_little_noise_have_a_mode():
    """Newton's steps meet a saddle there."""
    rig = Rig(tensions_N=(100.0, 411.0), speeds_rad_s=(0.05, 0.84))
    runs = reduce_runs(without(recording_of(rig), "tension_tight_N"), R, RigKind("torque"))
    assert mu(runs) == pytest.approx(rig.runs()["mu"].to_numpy(), rel=2e-3)


def test_a_weight_beside_a_torque_gives_what_it_gives_beside_a_cell():
    rig = recording_of(
        Rig("weight_tight", arcs_deg=(82.0,), tensions_N=(100.0, 411.0), speeds_rad_s=(0.84,))
    )
    # no noise in the weight: what the torque reads against it
    rig["torque_N_m"] = (rig["weight_N"] - rig["tension_slack_N"]) * R
    cell = reduce_runs(rig, R, RigKind("dead_weight"))
    columns = without(rig, *CELLS)
    runs = reduce_runs(columns, R, RigKind("torque", weight_on="tight"))
    assert np.abs(mu(runs) - mu(cell)).max() < 1e-6
    for run in runs:
        assert run.tension_tight_N == run.initial_tension_N == run.nominal_tension_N
    with pytest.raises(InputError, match=r"rig\.holds"):
        reduce_runs(columns, R, RigKind("torque", weight_stated=False))


def test_a_run_without_the_span_that_the_others_hold_is_set_aside(bench):
    columns, other = without(bench, *BESIDE[1:]), bench["run"] == bench["run"][0]
    columns[CELLS[0]] = np.where(other, columns[CELLS[0]], np.nan)
    columns[CELLS[1]] = np.where(other, np.nan, columns[CELLS[1]])
    first, *rest = reduce_runs(columns, R, RigKind("torque"))
    assert first.status == "column tension_slack_N is missing"
    assert all(run.ok and run.torque_with == "slack" for run in rest)


def idle_run(drag_N_m: float, zero_N_m: float, speed: float = 0.21) -> Columns:
    turns = np.arange(100) >= 20
    return {
        "run": np.full(100, "idle"),
        "time_s": np.arange(100) * 0.02,
        "torque_N_m": np.where(turns, drag_N_m, 0.0) + zero_N_m,
        "pulley_speed_rad_s": np.where(turns, speed, 0.0),
        "arc_deg": np.full(100, 82.0),
        "initial_tension_N": np.full(100, 100.0),
        "tension_slack_N": np.full(100, 5.0),
        "idle": np.full(100, "true", dtype=object),
    }


def test_drag_and_zero_of_the_torque_are_taken_off_by_an_idle_run(bench, by_torque):
    turns = bench["pulley_speed_rad_s"] > 0.02
    drawn = {**bench, "torque_N_m": bench["torque_N_m"] + 0.12 * turns + 0.3}
    idle = idle_run(0.12, 0.3)
    drawn["idle"] = np.full(len(turns), None)
    whole = {name: np.concatenate([drawn[name], values]) for name, values in idle.items()}
    runs = reduce_runs(whole, R, RigKind("torque"))
    assert [run.run for run in runs] == list(dict.fromkeys(bench["run"]))
    assert mu(runs) == pytest.approx(by_torque, abs=1e-6)


def test_the_drag_is_that_of_the_nearest_idle_speed_and_none_at_rest():
    speeds = np.array([0.0, 0.25, 0.75, 2.0])
    idle = [idle_run(0.2, 0.0, 1.0), idle_run(0.1, 0.0, 0.5)]
    assert idle_torque(idle, speeds) == pytest.approx([0.0, 0.1, 0.15, 0.2])
    assert idle_torque([], speeds) == pytest.approx(0.0)


def test_a_torque_of_a_pulley_that_turns_backwards_counts_in_its_sense(bench, by_torque):
    forwards = without(bench, "tension_tight_N")
    backwards = {name: -forwards[name] for name in ("torque_N_m", "pulley_speed_rad_s")}
    runs = reduce_runs(forwards | backwards, R, RigKind("torque"))
    assert mu(runs) == pytest.approx(by_torque, rel=1e-12)


@pytest.mark.parametrize(
    ("wrong", "kind", "said"),
    [
        (lambda c: {}, RigKind("dead_weight", weight_on="slack"), "weight hangs on the tight span"),
        (
            lambda c: {"torque_N_m": -c["torque_N_m"]},
            RigKind("torque"),
            'columns: {rig: {torque_N_m: "-torque_N_m"}}',
        ),
        (
            lambda c: {"arc_deg": np.full(len(c["run"]), 360.0)},
            RigKind("torque_hub"),
            "missing in 100 %",
        ),
    ],
    ids=["weight on the other span", "torque of the other sign", "a whole turn"],
)
def test_what_contradicts_the_config_or_tells_nothing_is_reported(bench, wrong, kind, said):
    columns = {**bench, **wrong(bench)}
    if kind.measures == "dead_weight":  # the cell of the tight span reads what the slack one has
        columns["tension_tight_N"] = columns["tension_slack_N"]
    if kind.measures == "torque":
        columns = without(columns, "tension_slack_N")
    assert all(said in run.status for run in reduce_runs(columns, R, kind))


def test_a_whole_turn_is_warned_of(bench):
    columns = {**without(bench, *BESIDE), "arc_deg": np.full(len(bench["run"]), 360.0)}
    notes = reduction_columns(reduce_runs(columns, R))["notes"]
    assert all("turns touch" in note for note in notes)


def test_a_known_error_of_the_only_cell_is_in_both_tensions(bench):
    off = {**without(bench, "tension_tight_N")}
    off["tension_slack_N"] = off["tension_slack_N"] / 1.02 + 3.0
    known = RigKind("torque", cells=(KnownCell(), KnownCell(tare_N=3.0, gain=1.02)))
    true = run_records(without(bench, "tension_tight_N"), R, RigKind("torque"))
    for one, other in zip(run_records(off, R, known), true, strict=True):
        np.testing.assert_allclose(one.tensions, other.tensions, rtol=1e-12)


def test_known_errors_of_both_cells_are_taken_off_and_stay_with_exchanged_columns(bench):
    true = without(bench, *BESIDE)
    tight, slack = (true[name] for name in CELLS)
    read = true | {CELLS[0]: tight / 1.03 + 4.0, CELLS[1]: slack / 0.98 - 2.5}
    cells = KnownCell(4.0, 1.03), KnownCell(-2.5, 0.98)
    swapped = true | dict(zip(CELLS, (read[CELLS[1]], read[CELLS[0]]), strict=True))
    expected = mu(reduce_runs(true, R))
    for columns, known, exchanged in ((read, cells, False), (swapped, cells[::-1], True)):
        runs = reduce_runs(columns, R, RigKind(cells=known))
        assert all(run.swapped == exchanged for run in runs)
        assert mu(runs) == pytest.approx(expected, rel=1e-6)


def test_slow_rows_of_a_table_lose_their_drag_too_and_each_in_its_sense():
    """A plateau of a fiftieth of the fastest speed turns as well."""
    n, slack = 4, np.full(4, 60.0)
    arc, way = np.full(n, 80.0), np.array([1.0, 1.0, -1.0, 1.0])
    torque = way * (slack * np.expm1(0.5 * np.radians(arc)) * R + 0.12)
    table = {
        "run": np.array(["fast", "slow", "back", "idle"]),
        "idle": np.array([None, None, None, "true"], dtype=object),
        "arc_deg": arc,
        "tension_slack_N": slack,
        "torque_N_m": np.append(torque[:3], 0.12),
        "pulley_speed_rad_s": way * np.array([1.0, 0.02, 1.0, 1.0]),
    }
    sliding = {"slip_speed_m_s": np.full(n, 0.01), "torque_N_m": np.abs(table["torque_N_m"])}
    stated = without(table, "pulley_speed_rad_s") | sliding
    for given in (table, stated):
        found = mu(reduce_plateaus(given, R, RigKind("torque")))
        assert found == pytest.approx([0.5] * 3, rel=1e-9)

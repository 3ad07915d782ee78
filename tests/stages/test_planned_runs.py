"""Which runs are simulated: those measured, each setting once, and what the config states."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest

from beltid.config import load_config
from beltid.errors import InputError
from beltid.plan.candidates import Settings
from beltid.stages.plan_inputs import rig_settings
from beltid.stages.planned_runs import (
    Picked,
    PlannedRun,
    differing_settings,
    measured_settings,
    planned_runs,
)

CONFIG = load_config(
    {
        "rig": {
            "arcs_deg": [82, 40],
            "initial_tensions_N": [100, 270.5],
            "pulley_speeds_rad_s": [0.1, 0.2],
        }
    }
)
OPEN = load_config({})


def friction(rows: list[tuple[float, float, float]]) -> dict[str, np.ndarray]:
    """A friction table with runs at arcs, tensions and speeds."""
    arc, tension, speed = np.array(rows, dtype=float).T
    return {
        "arc_deg": arc,
        "nominal_tension_N": tension,
        "pulley_speed_rad_s": speed,
        "status": np.full(arc.size, "ok", dtype=object),
    }


def settings(rig: dict[str, list[float]], table: dict[str, np.ndarray]) -> list[tuple[float, ...]]:
    """Settings of the runs that are simulated, in their order."""
    config = load_config({"rig": rig})
    return [
        (run.arc_deg, run.initial_tension_N, run.pulley_speed_rad_s)
        for run in planned_runs(config, Picked(), measured_settings(table, config))
    ]


def test_runs_are_all_settings_in_the_order_of_the_config() -> None:
    runs = planned_runs(CONFIG, Picked())
    assert [run.label for run in runs] == [f"S00{k}" for k in range(1, 9)]
    assert runs[0] == PlannedRun("S001", 82, 100, 0.1)
    assert runs[1].pulley_speed_rad_s == 0.2
    assert runs[2].initial_tension_N == 270.5
    assert runs[4].arc_deg == 40
    assert runs[0].point.beta == pytest.approx(math.radians(82))


def test_picked_runs_keep_their_labels() -> None:
    runs = planned_runs(CONFIG, Picked(arcs_deg=(40.0,), tensions_N=(270.5,)))
    assert [run.label for run in runs] == ["S007", "S008"]


def test_a_speed_is_picked_by_the_setting_that_a_motor_missed() -> None:
    measured = np.array([(40.0, 100.0, 0.2106), (40.0, 100.0, 0.1004)])
    runs = planned_runs(OPEN, Picked(speeds_rad_s=(0.21,)), measured)
    assert [run.pulley_speed_rad_s for run in runs] == [0.2106]


def test_all_wrong_picks_are_reported_at_once() -> None:
    with pytest.raises(InputError) as caught:
        planned_runs(CONFIG, Picked((41.0,), (265.0,), (0.1, 0.3)))
    assert caught.value.problems == (
        "--arc = 41, must be one of those of the campaign: 82, 40",
        "--tension = 265, must be one of those of the campaign: 100, 270.5",
        "--speed = 0.3, must be one of those of the campaign: 0.1, 0.2",
    )


def test_settings_come_from_the_recording_whose_motor_misses_its_speed() -> None:
    # 2 arcs x 2 tensions x 2 speeds, one of them never run; the pulley turns backwards in one run
    speeds = {0.1: [0.0995, 0.1, 0.1004, 0.1002], 0.4: [0.4, -0.396, 0.403]}
    pairs = list(product((35.0, 90.0), (120.0, 240.0)))
    rows = [(*pair, w) for pair, w in zip(pairs, speeds[0.1], strict=True)]
    rows += [(*pair, w) for pair, w in zip(pairs[:3], speeds[0.4], strict=True)]
    expected = [
        (arc, tension, w)  # by hand: medians 0.1001 ± 0.0004 and 0.4, as round as that allows
        for arc, tension in pairs
        for w in (0.1, 0.4)
        if (arc, tension, w) != (90.0, 240.0, 0.4)
    ]
    found = settings({}, friction(rows))
    assert [run[:2] for run in found] == [run[:2] for run in expected]
    assert [run[2] for run in found] == pytest.approx([run[2] for run in expected], rel=1e-12)


def test_repetitions_are_simulated_once_and_runs_set_aside_not_at_all() -> None:
    table = friction([(40, 100, 0.1), (40, 100, 0.1005), (40, 200, 0.1), (68, 100, 0.1)])
    table["status"][2] = "stick-slip"
    table["nominal_tension_N"][3] = np.nan  # nothing to compare it by
    assert settings({}, table) == [(40, 100, pytest.approx(0.1, rel=5e-3))]


def test_where_every_run_has_its_own_settings_each_is_simulated_at_its_own() -> None:
    rng = np.random.default_rng(5)
    rows = [
        (rng.choice([40.0, 68.0, 82.0]), *np.exp(rng.uniform(np.log([50, 0.05]), np.log([411, 1]))))
        for _ in range(120)
    ]
    assert set(settings({}, friction(rows))) == set(rows)


def test_a_stated_list_holds_above_what_was_measured() -> None:
    rows = list(product((40.0, 68.0), (100.0, 200.0), (0.1, 0.2)))
    # a part of what was measured
    assert settings({"arcs_deg": [68]}, friction(rows)) == [row for row in rows if row[0] == 68.0]
    # in the order in which they are stated, at what was measured where the motor missed it
    stated = settings({"pulley_speeds_rad_s": [0.2, 0.101]}, friction(rows))
    assert [run[2] for run in stated] == [0.2, 0.1] * 4
    # an arc that nobody measured, with all the others
    more = settings({"arcs_deg": [120, 40]}, friction(rows))
    assert more == list(product((120.0, 40.0), (100.0, 200.0), (0.1, 0.2)))


def test_runs_that_nobody_wrote_a_tension_down_for_are_simulated_at_stated_settings() -> None:
    """As those of a table that states coefficients and forces alone."""
    table = friction([(40, np.nan, 0.1), (80, np.nan, 0.2)])
    with pytest.raises(InputError, match="no usable run has an arc, a tension at rest"):
        settings({}, table)
    lists = {"arcs_deg": [40], "initial_tensions_N": [90], "pulley_speeds_rad_s": [0.3, 0.1]}
    assert settings(lists, table) == [(40, 90, 0.3), (40, 90, 0.1)]
    planned, (note,) = rig_settings(OPEN, table)
    assert planned == rig_settings(OPEN, None)[0]
    assert "assumed" in note


def test_both_lists_are_reported_where_they_differ() -> None:
    measured = measured_settings(
        friction(list(product((45.0, 90.0), (100.0, 200.0), (0.1, 0.2)))), OPEN
    )
    config = load_config({"rig": {"arcs_deg": [40, 68, 82], "initial_tensions_N": [100, 200.4]}})
    assert differing_settings(config, measured) == [
        "rig.arcs_deg: the config states 40, 68, 82 °, measured are 45, 90 °; the stated "
        "ones are simulated (without the key, the measured ones)"
    ]
    assert differing_settings(OPEN, measured) == []
    # a motor misses its speed by a percent; six are another setting
    faster = load_config({"rig": {"pulley_speeds_rad_s": [0.106]}})
    assert differing_settings(faster, np.array([(45.0, 100.0, 0.105)])) == []
    assert "0.106 rad/s" in differing_settings(faster, np.array([(45.0, 100.0, 0.1)]))[0]
    assert differing_settings(CONFIG, None) == []


def test_a_stated_arc_is_not_combined_with_thousands_of_settings() -> None:
    rng = np.random.default_rng(5)
    table = friction([(40.0, *rng.uniform((50.0, 0.05), (400.0, 0.9))) for _ in range(120)])
    with pytest.raises(InputError) as caught:
        settings({"arcs_deg": [40, 120]}, table)
    assert "the config states 40, 120 °, measured are 40 °" in caught.value.problems[0]
    assert "28,800 combinations" in caught.value.problems[1]


def test_a_plan_has_the_settings_of_the_runs_where_nobody_states_them() -> None:
    of_runs = friction(list(product([50.0, 75.0], [45.0, 130.0, 260.0], [0.2, 0.7])))
    settings, notes = rig_settings(OPEN, of_runs)
    assert settings == Settings((50.0, 75.0), (45.0, 130.0, 260.0), (0.2, 0.7))
    assert notes == ()
    stated = load_config({"rig": {"arcs_deg": [50, 110]}, "plan": {"tension_N": [60, 600]}})
    settings, notes = rig_settings(stated, of_runs)
    assert settings == Settings((50.0, 110.0), (60.0, 600.0), (0.2, 0.7))
    assert notes == ()
    # without runs the built-in lists, and it is said
    settings, (note,) = rig_settings(stated, None)
    assert settings.omegas == OPEN.rig.pulley_speeds_rad_s
    assert "pulley_speeds_rad_s: 0.05, 0.1, 0.21" in note
    assert "arcs_deg" not in note
    assert "tension" not in note


def test_of_runs_that_each_have_a_tension_of_their_own_a_plan_takes_a_few() -> None:
    tensions = np.geomspace(40.0, 400.0, 60)
    of_runs = friction([(90.0, tension, 0.3) for tension in tensions])
    settings, _ = rig_settings(OPEN, of_runs)
    assert len(settings.tensions) == 12
    assert (settings.tensions[0], settings.tensions[-1]) == (tensions[0], tensions[-1])

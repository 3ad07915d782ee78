"""What goes wrong with benches of each kind is said, by a table of plateaus."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from beltid import fit_friction
from beltid.cli.program import app
from beltid.errors import InputError

R, ARC = 0.045, np.radians([75.0, 150.0, 75.0, 150.0])
SLACK = np.array([40.0, 90.0, 160.0, 260.0])
TIGHT = SLACK * np.exp(0.5 * ARC)
BELT_SPEED = 8.0


def table(kind: str) -> pd.DataFrame:
    """Plateaus of a friction coefficient of 0.5, as a bench of a kind writes them."""
    hub = np.sqrt(TIGHT**2 + SLACK**2 - 2.0 * TIGHT * SLACK * np.cos(ARC))
    torque = (TIGHT - SLACK) * R
    channels: dict[str, dict[str, Any]] = {
        "two_cells": {"tension_tight_N": TIGHT, "tension_slack_N": SLACK},
        "dead_weight": {"weight_N": TIGHT, "tension_slack_N": SLACK},
        "torque": {"torque_N_m": torque, "tension_slack_N": SLACK},
        "torque_hub": {"torque_N_m": torque, "hub_force_N": hub},
    }
    channels["running"] = {**channels["two_cells"], "belt_speed_m_s": BELT_SPEED}
    turned = np.array([0.3, 0.9, 0.3, 0.9]) + (BELT_SPEED / R if kind == "running" else 0.0)
    common = {"arc_deg": np.degrees(ARC), "pulley_speed_rad_s": turned, "mu_se": 0.005}
    return pd.DataFrame({"run": ["A", "B", "C", "D"], **common, **channels[kind]})


def fit(frame: pd.DataFrame, kind: str, **rig: Any) -> Any:
    return fit_friction(frame, {"rig": {"kind": kind, "pulley_radius_m": R, **rig}}, table=True)


MISSING = {
    ("two_cells", "dead_weight"): "weight_N",
    ("two_cells", "torque"): "torque_N_m",
    ("two_cells", "torque_hub"): "hub_force_N",
    ("two_cells", "running"): "belt_speed_m_s",
    ("dead_weight", "two_cells"): "tension_tight_N",
    ("dead_weight", "torque"): "torque_N_m",
    ("dead_weight", "torque_hub"): "hub_force_N",
    ("dead_weight", "running"): "rig.kind: running needs the column tension_tight_N",
    ("torque", "two_cells"): "tension_tight_N",
    ("torque", "dead_weight"): "weight_N",
    ("torque", "torque_hub"): "hub_force_N",
    ("torque", "running"): "rig.kind: running needs the column tension_tight_N",
    ("torque_hub", "two_cells"): "tension_slack_N",
    ("torque_hub", "dead_weight"): "weight_N",
    ("torque_hub", "torque"): "tension_slack_N or weight_N is missing",
    ("torque_hub", "running"): "rig.kind: running needs the column tension_tight_N",
    ("running", "dead_weight"): "weight_N",
    ("running", "torque"): "torque_N_m",
    ("running", "torque_hub"): "hub_force_N",
    # nothing is missing: a column is there that another kind has
    ("running", "two_cells"): "rig.kind: running",
}


@pytest.mark.parametrize(("of", "stated"), MISSING)
def test_a_table_of_another_kind_is_refused_with_the_channel(of: str, stated: str) -> None:
    with pytest.raises(InputError) as error:
        fit(table(of), stated)
    assert any(MISSING[of, stated] in line for line in error.value.problems)


def test_a_belt_that_does_not_move_is_no_running_rig() -> None:
    found = fit(table("two_cells").assign(belt_speed_m_s=0.0), "two_cells").to_frame()
    assert found["mu_sliding"].to_numpy() == pytest.approx(0.5, rel=1e-12)


def test_a_pulley_that_goes_with_its_belt_does_not_slide() -> None:
    frame = table("running")
    frame.loc[1, "pulley_speed_rad_s"] = BELT_SPEED / R
    status = fit(frame, "running").to_frame()["status"]
    assert status[1] == "slip_speed_m_s = 0, must be > 0"
    assert (status == "ok").sum() == 3


def test_a_force_on_the_axis_that_cannot_be_says_so() -> None:
    frame = table("torque_hub")
    frame.loc[1, "arc_deg"] = 360.0  # both spans pull the same way: their sum is not in H
    frame.loc[2, "hub_force_N"] *= 0.1
    status = fit(frame, "torque_hub").to_frame()["status"]
    assert "360" in status[1]
    assert "hub_force_N" in status[1]
    assert "hub_force_N" in status[2]
    assert (status == "ok").sum() == 2


def test_a_weight_on_the_other_span_and_a_torque_of_the_other_sign_are_reported() -> None:
    weights = table("dead_weight")
    weights["weight_N"], weights["tension_slack_N"] = SLACK, TIGHT
    with pytest.raises(InputError, match="weight hangs on the slack span"):
        fit(weights, "dead_weight", holds="weight_tight")
    torques = table("torque")
    torques["torque_N_m"] *= -1.0
    with pytest.raises(InputError, match=r'columns: \{points: \{torque_N_m: "-torque_N_m"'):
        fit(torques, "torque")


def test_by_command_readings_near_the_resolution_are_named(tmp_path: Path) -> None:
    """r/sqrt(12) of 2 N beside 3 N of slack tension at 75°: 0.19/1.31 of mu = 0.5, some 29 %."""
    frame = table("dead_weight").drop(columns="mu_se")
    frame.loc[0, ["weight_N", "tension_slack_N"]] = 3.0 * np.exp(0.5 * ARC[0]), 3.0
    line = command(frame, tmp_path, "kind: dead_weight", "force_resolution_N: 2.0")
    assert "standard error of mu above 10 % in A:" in line


def test_by_command_a_table_without_standard_errors_is_asked_to_state_them(tmp_path: Path) -> None:
    err = command(table("two_cells").drop(columns="mu_se"), tmp_path)
    assert "no standard error is known: state mu_se in the table" in err


def command(frame: pd.DataFrame, folder: Path, *rig: str) -> str:
    """What `fit-friction` says of a table."""
    points, config = folder / "points.csv", folder / "bench.yaml"
    frame.to_csv(points, index=False)
    rig_text = ", ".join([f"pulley_radius_m: {R}", *rig])
    config.write_text(f"rig: {{{rig_text}}}\n")
    call = ["fit-friction", "--table", str(points), "-c", str(config)]
    ran = CliRunner().invoke(app, call, env={"COLUMNS": "300"})
    assert ran.exit_code == 0, ran.stderr
    return ran.stderr


def test_a_pulley_that_does_not_give_way_to_a_constant_force_is_reported():
    hub, stretch = "hub_force", "stretch"
    for share, holds, told in ((0.8, hub, True), (0.8, stretch, False), (1.0, hub, False)):
        rested = table("torque_hub").assign(initial_tension_N=0.5 * share * (TIGHT + SLACK))
        warnings = "\n".join(fit(rested, "torque_hub", holds=holds, span_length_m=10.0).warnings)
        assert ("1.25 times that at rest" in warnings) == told
        assert ("rig.holds: stretch" in warnings) == told

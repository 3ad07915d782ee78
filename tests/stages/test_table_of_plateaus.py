"""fit-friction of a table with a row per plateau, of conditions, and of a speed that falls."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from beltid import build_surface, fit_friction
from beltid.cli.program import app
from beltid.errors import InputError
from beltid.store.artifact import read_artifact

R = 0.05


def mu_of(force: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """A synthetic law."""
    return np.asarray(0.6 * (force / 2000.0) ** -0.1 * (1.0 + 0.1 * np.log(speed / 0.02)))


def plateaus(**columns: Any) -> pd.DataFrame:
    """Plateaus of two arcs, four tensions and three speeds, by Eq. (5) of the law above."""
    return pd.DataFrame(solved_plateaus()).assign(**columns)


@cache
def solved_plateaus() -> list[dict[str, float]]:
    rows = []
    for arc in (60.0, 120.0):
        for tension in (60.0, 110.0, 200.0, 300.0):
            for omega in (0.2, 0.4, 0.8):
                beta, mu = np.radians(arc), 0.5
                for _ in range(50):  # the force depends on mu
                    force = tension * (np.exp(mu * beta) - 1.0) / (R * mu * beta)
                    mu = float(mu_of(np.array(force), np.array(omega * R)))
                rows.append(
                    {
                        "arc_deg": arc,
                        "tension_slack_N": tension,
                        "tension_tight_N": tension * np.exp(mu * beta),
                        "pulley_speed_rad_s": omega,
                        "mu": mu,
                        "normal_force_N_m": force,
                    }
                )
    return rows


DIRECT = ["mu", "normal_force_N_m"]
TENSIONS = ["tension_tight_N", "tension_slack_N"]


def by_kind(kind: str) -> tuple[pd.DataFrame, dict[str, Any]]:
    """The table as another bench would have it, and what the config says of that bench."""
    table = plateaus()
    tight, slack, beta = (
        table["tension_tight_N"],
        table["tension_slack_N"],
        np.radians(table["arc_deg"]),
    )
    bare = table.drop(columns=[*TENSIONS, *DIRECT])
    torque = (tight - slack) * R
    if kind == "two_cells":
        return bare.assign(tension_tight_N=tight, tension_slack_N=slack), {}
    if kind == "dead_weight":
        return bare.assign(weight_N=slack, tension_tight_N=tight), {"holds": "weight_slack"}
    if kind == "torque":
        return bare.assign(torque_N_m=torque, tension_tight_N=tight), {}
    # the angle between spans of 0.10 m of a belt with 0.02 N m²
    angle = beta + 0.02 / (2.0 * R * 0.10) * (1.0 / tight + 1.0 / slack)
    hub = np.hypot(tight * np.cos(angle) - slack, tight * np.sin(angle))
    return bare.assign(torque_N_m=torque, hub_force_N=hub), {}


@pytest.mark.parametrize("kind", ["two_cells", "dead_weight", "torque", "torque_hub"])
def test_a_table_of_plateaus_gives_the_coefficients_that_made_it(kind):
    table, rig = by_kind(kind)
    found = fit_friction(table, {"rig": rig}).to_frame()
    truth = plateaus()
    assert found["run"].tolist() == [str(k) for k in range(1, 25)]
    assert found["mu_sliding"].to_numpy() == pytest.approx(truth["mu"].to_numpy(), rel=1e-9)
    force = truth["normal_force_N_m"].to_numpy()
    assert found["normal_force_N_m"].to_numpy() == pytest.approx(force, rel=1e-9)
    assert found["mu_sliding_se"].isna().all()


def test_a_table_that_states_coefficient_and_force_has_no_calibration_of_a_rig():
    table = plateaus(slip_speed_m_s=lambda t: t["pulley_speed_rad_s"] * R, mu_se=0.006)
    direct = table.drop(columns=[*TENSIONS, "pulley_speed_rad_s", "arc_deg"])
    found = fit_friction(direct).to_frame()
    assert found["mu_sliding_se"].tolist() == [0.006] * 24
    built = build_surface(found)
    assert float(built.result.surface.mu(2000.0, 0.02)) == pytest.approx(0.6, rel=0.01)
    names = {row["source"] for row in built.tables["budget"]}
    assert names == {"scatter of the runs", "combined"}


def test_the_resolution_stands_for_the_scatter_of_single_readings():
    table, rig = by_kind("dead_weight")
    settings = {**rig, "force_resolution_N": 0.5}
    found = fit_friction(table, {"rig": settings}).to_frame()
    # the weight is exact: d ln(T_tight) = r / sqrt(12) / T_tight
    se = 0.5 / np.sqrt(12.0) / table["tension_tight_N"] / np.radians(table["arc_deg"])
    assert found["mu_sliding_se"].to_numpy() == pytest.approx(se.to_numpy(), rel=1e-6)
    torque, _ = by_kind("torque")
    settings = {"force_resolution_N": 0.5}
    found = fit_friction(torque, {"rig": settings}).to_frame()
    truth = plateaus()
    # an error of the cell is in both tensions: d z = e (1/T_tight - 1/T_slack)
    both = 1.0 / truth["tension_slack_N"] - 1.0 / truth["tension_tight_N"]
    se = 0.5 / np.sqrt(12.0) * both / np.radians(truth["arc_deg"])
    assert found["mu_sliding_se"].to_numpy() == pytest.approx(se.to_numpy(), rel=1e-5)


def test_a_reading_of_nothing_is_set_aside_and_the_rest_is_used():
    table, _ = by_kind("two_cells")
    table.loc[3, "tension_slack_N"] = 0.0
    found = fit_friction(table).to_frame()
    assert found["status"][3] == "tension_slack_N = 0, must be > 0"
    assert (found["status"] == "ok").sum() == 23


def test_idle_rows_are_taken_off_the_torque_and_their_absence_is_warned_of():
    table, _ = by_kind("torque")
    truth = plateaus()["mu"].to_numpy()
    dragged = table.assign(torque_N_m=table["torque_N_m"] + 0.2, idle="false")
    idle = pd.DataFrame({"torque_N_m": [0.2], "pulley_speed_rad_s": [0.4], "idle": ["true"]})
    with_idle = fit_friction(pd.concat([dragged, idle]))
    assert with_idle.to_frame()["mu_sliding"].to_numpy() == pytest.approx(truth, rel=1e-9)
    assert not any("drag" in line for line in with_idle.warnings)
    assert any("0.2 N m" in line for line in with_idle.notes)
    without = fit_friction(dragged)
    assert np.all(without.to_frame()["mu_sliding"].to_numpy() > truth)
    assert any("drag of the bearings" in line for line in without.warnings)


def test_the_command_reads_a_table_of_other_names_and_units(tmp_path: Path):
    table, _ = by_kind("dead_weight")
    renamed = table.rename(columns={"arc_deg": "Umschlingung", "weight_N": "G"})
    renamed["G"] /= 1000.0
    renamed.to_excel(tmp_path / "points.xlsx", index=False)
    (tmp_path / "points.yaml").write_text(
        "rig: {holds: weight_slack, force_resolution_N: 0.5}\n"
        "columns: {rig: {arc_deg: Umschlingung, weight_N: G}}\n"
        "units: {rig: {weight_N: kN}}\nconditions: {surface: wet}\n"
    )
    call = ["fit-friction", str(tmp_path / "points.xlsx")]
    result = CliRunner().invoke(app, call)
    assert result.exit_code == 0, result.stderr
    friction = read_artifact(tmp_path / "friction.parquet", "friction")
    assert friction.columns["mu_sliding"] == pytest.approx(plateaus()["mu"].to_numpy(), rel=1e-9)
    assert set(friction.columns["condition"]) == {"wet"}
    result = CliRunner().invoke(app, ["build-surface", str(tmp_path / "friction.parquet")])
    assert result.exit_code == 0, result.stderr


def test_a_condition_that_no_run_has_and_a_back_are_said():
    table, _ = by_kind("two_cells")
    outcome = fit_friction(table.assign(condition="Dry", side="back"))
    assert any("back of the belt" in line for line in outcome.warnings)
    with pytest.raises(InputError, match="no run has the condition dusty; there are dry"):
        build_surface(outcome.to_frame(), condition="dusty")


def test_a_run_down_is_refused_for_a_table_of_plateaus():
    time = np.arange(0.0, 20.0, 0.02)
    half = 0.5 * 0.5 * np.radians(90.0)
    run_down = pd.DataFrame(
        {
            "run": "C1",
            "time_s": time,
            "tension_tight_N": 200.0 * np.exp(half) + 1e-3 * np.cos(time),
            "tension_slack_N": 200.0 * np.exp(-half) + 1e-3 * np.sin(time),
            "pulley_speed_rad_s": 0.9 - 0.04 * time,
            "arc_deg": 90.0,
            "initial_tension_N": 200.0,
        }
    )
    with pytest.raises(InputError, match=r"C1.*speed.*plateaus.*table"):
        fit_friction(run_down)


NO_OTHERS = {
    "cell_gain_rel": 0,
    "cell_hysteresis_rel": 0,
    "cell_offset_N": 0,
    "arc_deg": 0,
    "arc_setting_deg": 0,
    "pulley_radius_rel": 0,
    "pulley_speed_rel": 0,
}


@pytest.mark.parametrize(("kind", "share"), [("two_cells", 0.0), ("dead_weight", 1.0)])
def test_a_gain_of_the_cells_counts_with_a_dead_weight_only(kind, share):
    table, rig = by_kind(kind)
    config = {"rig": rig, "uncertainty": {"tension_gain_rel": 0.01, **NO_OTHERS}}
    found = fit_friction(table.assign(mu_se=0.0), config).to_frame()
    # both tensions of two cells grow alike; a weight stays, so that mu changes by ln(1.01) / beta
    expected = share * np.log(1.01) / np.radians(table["arc_deg"])
    assert found["mu_sliding_u"].to_numpy() == pytest.approx(expected.to_numpy(), abs=1e-12)

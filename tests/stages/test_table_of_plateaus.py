"""fit-friction of a table with a row per plateau, for benches of every kind."""

from typing import Any

import numpy as np
import pandas as pd
import pytest
from golden.benches import R, Rig

from beltid import NormalLaw, build_surface, fit_friction, refine_surface
from beltid.errors import InputError

BELT_SPEED = 8.0
DIRECT = ["mu", "normal_force_N_m"]
TENSIONS = ["tension_tight_N", "tension_slack_N"]
Parts = tuple[pd.DataFrame, dict[str, Any]]


def mu_of(force: float, speed: float) -> float:
    """A synthetic law."""
    return float(0.6 * (force / 2000.0) ** -0.1 * (1.0 + 0.1 * np.log(speed / 0.02)))


def plateaus() -> pd.DataFrame:
    """Plateaus of two arcs, four tensions and three speeds, by Eq. (5) of the law above."""
    tensions, speeds = (60.0, 110.0, 200.0, 300.0), (0.2, 0.4, 0.8)
    rig = Rig("weight_slack", (60.0, 120.0), tensions, speeds, mu=mu_of)
    return rig.runs().drop(columns=["run", "initial_tension_N"])


def by_kind(kind: str) -> Parts:
    """The table as another bench would have it, and what the config says of that bench."""
    table = plateaus()
    tight, slack, beta = table[TENSIONS[0]], table[TENSIONS[1]], np.radians(table["arc_deg"])
    bare, torque = table.drop(columns=[*TENSIONS, *DIRECT]), (tight - slack) * R
    if kind == "two_cells":
        return bare.assign(tension_tight_N=tight, tension_slack_N=slack), {}
    if kind == "running":
        cells, _ = by_kind("two_cells")
        turned = cells["pulley_speed_rad_s"] + BELT_SPEED / R
        return cells.assign(belt_speed_m_s=BELT_SPEED, pulley_speed_rad_s=turned), {}
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
    found, truth = fit_friction(table, {"rig": rig}).to_frame(), plateaus()
    assert found["run"].tolist() == [str(k) for k in range(1, 25)]
    assert found["mu_sliding"].to_numpy() == pytest.approx(truth["mu"].to_numpy(), rel=1e-9)
    force = truth["normal_force_N_m"].to_numpy()
    assert found["normal_force_N_m"].to_numpy() == pytest.approx(force, rel=1e-9)
    assert found["mu_sliding_se"].isna().all()


def test_a_running_belt_is_known_by_its_speed():
    table, _ = by_kind("running")
    turning = 0.1 * BELT_SPEED**2  # m v², m by default
    effective = (table["tension_tight_N"] - turning) / (table["tension_slack_N"] - turning)
    expected = np.log(effective) / np.radians(table["arc_deg"])
    table.loc[1, "pulley_speed_rad_s"] = BELT_SPEED / R  # goes with the belt
    found, slides = fit_friction(table).to_frame(), np.arange(24) != 1
    assert found["mu_sliding"][slides].to_numpy() == pytest.approx(expected[slides], rel=1e-12)
    assert "slip_speed_m_s = 0" in found["status"][1]
    assert (found["status"] == "ok").tolist() == slides.tolist()
    with pytest.raises(InputError, match="no simulated rig"):
        refine_surface(found, NormalLaw(6.5e7, 3.0e11))
    at_rest = fit_friction(by_kind("two_cells")[0].assign(belt_speed_m_s=0.0)).to_frame()
    assert at_rest["mu_sliding"].to_numpy() == pytest.approx(plateaus()["mu"], rel=1e-9)


def test_a_table_that_states_coefficient_and_force_has_no_calibration_of_a_rig():
    table = plateaus().assign(slip_speed_m_s=lambda t: t["pulley_speed_rad_s"] * R, mu_se=0.006)
    direct = table.drop(columns=[*TENSIONS, "pulley_speed_rad_s", "arc_deg"])
    found = fit_friction(direct).to_frame()
    assert found["mu_sliding_se"].tolist() == [0.006] * 24
    built = build_surface(found)
    assert float(built.result.surface.mu(2000.0, 0.02)) == pytest.approx(0.6, rel=0.01)
    names = {row["source"] for row in built.tables["budget"]}
    assert names == {"scatter of the runs", "combined"}


def test_the_resolution_stands_for_the_scatter_of_single_readings():
    tight, slack = (plateaus()[name] for name in TENSIONS)
    # d ln(T_tight/T_slack) by a step of r, uniform: the weight is exact; beside a torque the error
    # of the cell is in both tensions
    for kind, change in (("dead_weight", 1.0 / tight), ("torque", 1.0 / slack - 1.0 / tight)):
        table, rig = by_kind(kind)
        found = fit_friction(table, {"rig": {**rig, "force_resolution_N": 0.5}}).to_frame()
        se = 0.5 / np.sqrt(12.0) * change / np.radians(table["arc_deg"])
        assert found["mu_sliding_se"].to_numpy() == pytest.approx(se.to_numpy(), rel=1e-5)


def test_readings_that_cannot_be_are_set_aside_and_the_rest_is_used():
    table, _ = by_kind("two_cells")
    table.loc[3, "tension_slack_N"] = 0.0
    status = fit_friction(table).to_frame()["status"]
    assert status[3] == "tension_slack_N = 0 or missing, must be > 0"
    assert (status == "ok").sum() == 23
    table, _ = by_kind("torque_hub")
    table.loc[1, "arc_deg"] = 360.0  # both spans pull the same way: their sum is not in H
    table.loc[2, "hub_force_N"] *= 0.1
    status = fit_friction(table).to_frame()["status"]
    assert [k for k, line in enumerate(status) if "hub_force_N" in line] == [1, 2]


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


@pytest.mark.parametrize(
    ("share", "holds", "told"),
    [(0.8, "hub_force", True), (0.8, "stretch", False), (1.0, "hub_force", False)],
)
def test_a_pulley_that_does_not_give_way_to_a_constant_force_is_reported(share, holds, told):
    table, _ = by_kind("torque_hub")
    mean = 0.5 * plateaus()[TENSIONS].sum(axis=1)
    rested = table.assign(initial_tension_N=share * mean)
    warnings = fit_friction(rested, {"rig": {"holds": holds}}).warnings
    said = [line for line in warnings if "rig.holds: stretch" in line]
    assert ["1.25 times" in line for line in said] == [True] * told


def test_a_run_down_is_refused_for_a_table_of_plateaus():
    time, half = np.arange(0.0, 20.0, 0.02), 0.5 * 0.5 * np.radians(90.0)
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


@pytest.mark.parametrize(("kind", "share"), [("two_cells", 0.0), ("dead_weight", 1.0)])
def test_a_gain_of_the_cells_counts_with_a_dead_weight_only(kind, share):
    table, rig = by_kind(kind)
    others = "cell_gain_rel cell_hysteresis_rel cell_offset_N arc_deg arc_setting_deg "
    others += "pulley_radius_rel pulley_speed_rel"
    sizes = {**dict.fromkeys(others.split(), 0), "tension_gain_rel": 0.01}
    found = fit_friction(table.assign(mu_se=0.0), {"rig": rig, "uncertainty": sizes}).to_frame()
    # both tensions of two cells grow alike; a weight stays, so that mu changes by ln(1.01) / beta
    expected = share * np.log(1.01) / np.radians(table["arc_deg"])
    assert found["mu_sliding_u"].to_numpy() == pytest.approx(expected.to_numpy(), abs=1e-12)

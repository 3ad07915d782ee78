"""What goes wrong with benches of each kind is said, by a table of plateaus."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest

from beltid import NormalLaw, fit_friction, refine_surface
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


def fit(frame: pd.DataFrame, **rig: Any) -> Any:
    return fit_friction(frame, {"rig": {"pulley_radius_m": R, **rig}})


def test_a_running_belt_is_known_by_its_speed() -> None:
    found = fit(table("running")).to_frame()
    turning = 0.1 * BELT_SPEED**2  # m v², m by default
    expected = np.log((TIGHT - turning) / (SLACK - turning)) / ARC
    assert found["mu_sliding"].to_numpy() == pytest.approx(expected, rel=1e-12)


def test_a_belt_that_does_not_move_is_no_running_rig() -> None:
    found = fit(table("two_cells").assign(belt_speed_m_s=0.0)).to_frame()
    assert found["mu_sliding"].to_numpy() == pytest.approx(0.5, rel=1e-12)


def test_a_running_belt_is_not_simulated_from_its_frame_either() -> None:
    with pytest.raises(InputError, match="no simulated rig"):
        refine_surface(fit(table("running")).to_frame(), NormalLaw(6.5e7, 3.0e11))


def test_a_pulley_that_goes_with_its_belt_does_not_slide() -> None:
    frame = table("running")
    frame.loc[1, "pulley_speed_rad_s"] = BELT_SPEED / R
    status = fit(frame).to_frame()["status"]
    assert "slip_speed_m_s = 0" in status[1]
    assert (status == "ok").sum() == 3


def test_a_force_on_the_axis_that_cannot_be_says_so() -> None:
    frame = table("torque_hub")
    frame.loc[1, "arc_deg"] = 360.0  # both spans pull the same way: their sum is not in H
    frame.loc[2, "hub_force_N"] *= 0.1
    status = fit(frame).to_frame()["status"]
    assert ["hub_force_N" in line for line in status] == [False, True, True, False]
    assert (status == "ok").sum() == 2


def test_a_weight_on_the_other_span_and_a_torque_of_the_other_sign_are_reported() -> None:
    weights = table("dead_weight")
    weights["weight_N"], weights["tension_slack_N"] = SLACK, TIGHT
    with pytest.raises(InputError, match="slack span"):
        fit(weights, holds="weight_tight")
    torques = table("torque")
    torques["torque_N_m"] *= -1.0
    with pytest.raises(InputError, match=r'columns: \{points: \{torque_N_m: "-torque_N_m"'):
        fit(torques)


@pytest.mark.parametrize(
    ("share", "holds", "told"),
    [(0.8, "hub_force", True), (0.8, "stretch", False), (1.0, "hub_force", False)],
)
def test_a_pulley_that_does_not_give_way_to_a_constant_force_is_reported(
    share: float, holds: str, told: bool
) -> None:
    rested = table("torque_hub").assign(initial_tension_N=0.5 * share * (TIGHT + SLACK))
    warnings = fit(rested, holds=holds, span_length_m=10.0).warnings
    said = [line for line in warnings if "rig.holds: stretch" in line]
    assert ["1.25 times" in line for line in said] == [True] * told

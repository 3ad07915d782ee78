"""Which runs are simulated and refined from, and the recording of a run known by its limit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from beltid.config import load_config
from beltid.errors import InputError
from beltid.identify.friction.reduction import reduce_records
from beltid.identify.friction.run import run_records
from beltid.laws.penalty import NormalLaw
from beltid.stages.inputs import press_law
from beltid.stages.refine import prepared_campaign
from beltid.stages.rig import planned_runs, recording_columns
from beltid.tables import schemas

LAW = NormalLaw(6.5e7, 3.0256e11)
CONFIG = load_config(
    {
        "rig": {
            "arcs_deg": [82, 40],
            "initial_tensions_N": [100, 270.5],
            "pulley_speeds_rad_s": [0.1, 0.2],
        }
    }
)


@dataclass
class Limit:
    """A run of which only the sliding state is known."""

    tension_tight_N: float
    tension_slack_N: float
    recording: dict[str, Any] | None = None


def test_the_sliding_limit_survives_the_reduction_exactly() -> None:
    # ln(T_tight/T_slack) = mu beta with mu = 0.7: closed form of Eq. (6)
    runs = planned_runs(CONFIG)
    pairs = [(r, Limit(300.0, 300.0 / math.exp(0.7 * math.radians(r.arc_deg)))) for r in runs]
    columns = recording_columns(pairs, CONFIG)  # type: ignore[arg-type]
    assert tuple(columns) == schemas.table("simulated").names
    reduced = reduce_records(
        run_records(columns, CONFIG.rig.pulley_radius_m), CONFIG.rig.pulley_radius_m
    )
    assert [r.run for r in reduced] == [run.label for run in runs]
    for run, r in zip(runs, reduced, strict=True):
        assert r.status == "ok"
        # the model takes 2e-5 of a tension for noise
        assert r.mu_sliding == pytest.approx(0.7, rel=2e-5)
        assert r.initial_tension_N == pytest.approx(run.initial_tension_N, rel=1e-12)
        assert r.pulley_speed_rad_s == pytest.approx(run.pulley_speed_rad_s, rel=1e-12)
        assert math.isnan(r.mu_sticking)  # a limit has no build-up


def test_a_speed_of_two_runs_that_share_no_force_is_kept() -> None:
    config = load_config({})
    v = np.array([*np.repeat([0.0025, 0.0105], 4), 0.005, 0.005])
    f = np.array([*np.tile([1000.0, 2000.0, 4000.0, 8000.0], 2), 1100.0, 7000.0])
    columns = {
        "run": np.array([f"R{k}" for k in range(10)], dtype=object),
        "arc_deg": np.array([*np.full(8, 82.0), 68.0, 82.0]),
        "initial_tension_N": f * 0.05,
        "pulley_speed_rad_s": v / 0.05,
        "slip_speed_m_s": v,
        "normal_force_N_m": f,
        "mu_sliding": 0.9 * (f / 5000.0) ** -0.18,
        "mu_sliding_se": np.full(10, 0.003),
    }
    press = press_law(LAW, config)
    campaign, speeds, used, set_aside = prepared_campaign(columns, press, config, {})
    np.testing.assert_allclose(speeds, [0.0025, 0.005, 0.0105])
    assert used.size == campaign.measured.mu.size == 10
    assert set_aside == []


def test_runs_measured_with_a_torque_are_not_taken_for_those_of_two_cells() -> None:
    config = load_config({})
    columns = {"initial_tension_N": np.full(4, 100.0), "torque_with": np.full(4, "tight")}
    with pytest.raises(InputError, match="torque_with"):
        prepared_campaign(columns, press_law(LAW, config), config, {})

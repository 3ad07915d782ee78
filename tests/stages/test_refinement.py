"""What a surface is refined from."""

from __future__ import annotations

import numpy as np
import pytest

from beltid.config import load_config
from beltid.errors import InputError
from beltid.laws.penalty import NormalLaw
from beltid.stages.inputs import press_law
from beltid.stages.refinement import prepared_campaign


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
    press = press_law(NormalLaw(6.5e7, 3.0256e11), config)
    campaign, speeds, used, set_aside = prepared_campaign(columns, press, config, "table")
    np.testing.assert_allclose(speeds, [0.0025, 0.005, 0.0105])
    assert used.size == campaign.measured.mu.size == 10
    assert set_aside == []


def test_runs_measured_with_a_torque_are_not_taken_for_those_of_two_cells() -> None:
    config = load_config({})
    columns = {
        "initial_tension_N": np.full(4, 100.0),
        "torque_with": np.array(["tight"] * 4, dtype=object),
    }
    press = press_law(NormalLaw(6.5e7, 3.0256e11), config)
    with pytest.raises(InputError, match=r"must be rig\.kind: torque"):
        prepared_campaign(columns, press, config, "table")

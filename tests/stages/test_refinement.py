"""What a surface is refined from."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from beltid.config import load_config
from beltid.errors import InputError
from beltid.laws.penalty import NormalLaw
from beltid.stages.simulation import refine_surface
from beltid.stages.simulation.refinement import prepared_campaign
from beltid.stages.tables import press_law
from beltid.uncertainty.bending import FittedBending


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


def refined_with(found: FittedBending, bending: Any, monkeypatch: Any) -> Any:
    """Eight runs at two arcs refined, where the runs are said to ask for a stiffness."""
    monkeypatch.setattr(refine_surface, "fit_bending", lambda *_: found)
    f = np.tile([1000.0, 2000.0, 4000.0, 8000.0], 2)
    columns = {
        "run": np.array([f"R{k}" for k in range(8)], dtype=object),
        "arc_deg": np.repeat([68.0, 82.0], 4),
        "initial_tension_N": f * 0.05,
        "pulley_speed_rad_s": np.full(8, 0.21),
        "slip_speed_m_s": np.full(8, 0.0105),
        "normal_force_N_m": f,
        "mu_sliding": 0.9 * (f / 5000.0) ** -0.18,
        "mu_sliding_se": np.full(8, 0.003),
    }
    law = NormalLaw(6.5e7, 3.0256e11)
    return refine_surface.refine_surface(columns, law, {}, bending=bending)


def test_a_stiffness_that_the_runs_ask_for_is_warned_of_and_used_if_asked(monkeypatch: Any) -> None:
    found = FittedBending(0.03, 0.02, 12)
    used = refined_with(found, "use", monkeypatch)
    # stated: 0.02 within 5 %; ln 1.5 / sqrt(0.05² + 0.02²) = 7.53
    (warning,) = (line for line in used.warnings if "bending_stiffness" in line)
    assert "give 0.03 within 2 %: 7.5 standard uncertainties apart" in warning
    assert used.extra["bending"]["fitted_u_N_m2"] == pytest.approx(0.0006)
    only_shown = refined_with(found, "fit", monkeypatch)
    assert not np.array_equal(used.columns["mu"], only_shown.columns["mu"])
    of_EI = [s for s in used.result.uncertainty.sources if s.error == "bending_stiffness"]
    assert [(s.size, s.basis) for s in of_EI] == [(0.02, "fitted")]


def test_runs_that_hardly_tell_the_stiffness_say_so_and_accuse_nobody(monkeypatch: Any) -> None:
    shown = refined_with(FittedBending(0.005, 0.8, 12), "fit", monkeypatch)
    (warning,) = (line for line in shown.warnings if "bending" in line)
    assert "the runs hardly determine it" in warning


def test_an_unknown_word_is_no_stiffness_of_the_config(monkeypatch: Any) -> None:
    with pytest.raises(InputError, match="bending = used, must be one of stated, fit, use"):
        refined_with(FittedBending(0.03, 0.02, 12), "used", monkeypatch)

"""Friction that drifts over a campaign, told by the functions of the stages."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import beltid

N = 60
CONFIG = {"uncertainty": {"tension_gain_rel": 0.001}}


def plateaus(change: np.ndarray, temperature: np.ndarray | None = None) -> pd.DataFrame:
    """Plateaus of a bench in random order, ln mu changed by the place in the campaign."""
    rng = np.random.default_rng(11)
    tension = rng.choice([60.0, 120.0, 200.0, 300.0, 400.0], N)
    speed = rng.choice([0.1, 0.2, 0.4, 0.8], N)
    arc = np.radians(rng.choice([60.0, 90.0], N))
    mu = 0.9 * (tension / 200.0) ** -0.15 * (speed / 0.2) ** 0.06
    mu *= np.exp(change + 0.001 * rng.normal(size=N))
    frame = pd.DataFrame(
        {
            "run": np.arange(N),
            "arc_deg": np.degrees(arc),
            "initial_tension_N": tension,
            "tension_tight_N": tension * np.exp(mu * arc / 2.0),
            "tension_slack_N": tension * np.exp(-mu * arc / 2.0),
            "pulley_speed_rad_s": speed,
            "mu_se": 0.001 * mu,
        }
    )
    return frame if temperature is None else frame.assign(temperature_degC=temperature)


def test_fit_friction_tells_a_run_in_with_its_size():
    found = beltid.fit_friction(plateaus(0.05 * np.arange(N) / (N - 1)), CONFIG, table=True)
    (row,) = (row for row in found.extra["drift"] if row["cause"] == "order of the runs")
    assert row["clear"]
    assert row["change_percent"] == pytest.approx(50.0 / (N - 1), abs=0.05)
    assert any("drifts with the order of the runs" in line for line in found.warnings)


def test_fit_friction_tells_a_temperature_and_names_the_key():
    temperature = 20.0 + 15.0 * np.random.default_rng(2).random(N)
    found = beltid.fit_friction(plateaus(-0.002 * temperature, temperature), CONFIG, table=True)
    (line,) = found.warnings
    assert line.startswith("the friction drifts with the temperature: -2")
    assert "friction.correct_temperature" in line


def test_fit_friction_is_silent_where_nothing_drifts():
    found = beltid.fit_friction(plateaus(np.zeros(N)), CONFIG, table=True)
    assert not found.warnings
    assert not any(row["clear"] for row in found.extra["drift"])


def test_force_that_rises_with_the_order_is_no_drift():
    """The mean force of a run follows its own noise: all that tells the order from the force."""
    tension, arc = np.geomspace(50.0, 400.0, 24), np.radians(70.0)
    mu = 0.9 * (tension / 200.0) ** -0.15 * np.exp(0.002 * np.random.default_rng(0).normal(size=24))
    table = pd.DataFrame(
        {
            "run": np.arange(24),
            "arc_deg": 70.0,
            "initial_tension_N": tension,
            "tension_tight_N": tension * np.exp(0.5 * mu * arc),
            "tension_slack_N": tension * np.exp(-0.5 * mu * arc),
            "pulley_speed_rad_s": 0.1,
            "mu_se": 0.002 * mu,
        }
    )
    found = beltid.fit_friction(table, CONFIG, table=True)
    (row,) = found.extra["drift"]
    assert row["explained_percent"] > 99.9
    assert row["change_percent"] is None
    assert not row["clear"]
    assert not found.warnings
    assert any("order of the runs (100 %)" in note for note in found.notes)


def test_refine_surface_wants_temperatures_to_correct():
    config = {**CONFIG, "friction": {"correct_temperature": True}}
    friction = beltid.fit_friction(plateaus(np.zeros(N)), config, table=True)
    law = beltid.NormalLaw(k_linear_N_m2=6.5e7, k_quadratic_N_m3=3.0256e11)
    with pytest.raises(beltid.InputError, match="no run has a temperature"):
        beltid.refine_surface(friction, law, config)

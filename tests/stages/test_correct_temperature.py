"""The refined surface corrected to a temperature."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import beltid


def plateaus() -> pd.DataFrame:
    """Plateaus of a bench without a thermometer."""
    tension, speed = (grid.ravel() for grid in np.meshgrid([60.0, 120.0, 200.0], [0.1, 0.4]))
    arc, mu = np.radians(90.0), 0.9 * (tension / 200.0) ** -0.15
    return pd.DataFrame(
        {
            "run": np.arange(tension.size),
            "arc_deg": 90.0,
            "initial_tension_N": tension,
            "tension_tight_N": tension * np.exp(mu * arc / 2.0),
            "tension_slack_N": tension * np.exp(-mu * arc / 2.0),
            "pulley_speed_rad_s": speed,
            "mu_se": 0.001 * mu,
        }
    )


def test_refine_surface_wants_temperatures_to_correct():
    config = {"friction": {"correct_temperature": True}}
    friction = beltid.fit_friction(plateaus(), config, table=True)
    law = beltid.NormalLaw(k_linear_N_m2=6.5e7, k_quadratic_N_m3=3.0256e11)
    with pytest.raises(beltid.InputError, match="no run has a temperature"):
        beltid.refine_surface(friction, law, config)

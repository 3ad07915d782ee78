"""A torque beside a cell is held against the stiffness of the belt: nothing right is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest

import beltid

R = 0.05


def mu(frame: pd.DataFrame, config: dict[str, Any]) -> np.ndarray:
    found = beltid.fit_friction(frame, config).to_frame()
    assert set(found.status) == {"ok"}
    return found.mu_sliding.to_numpy()


@pytest.mark.parametrize(("span_m", "EA_N", "arc_deg"), [(0.03, 1e5, 25.0), (1.0, 2e4, 170.0)])
def test_belts_and_spans_of_any_stiffness_are_plausible(span_m, EA_N, arc_deg):
    config = {"belt": {"axial_stiffness_N": EA_N}, "rig": {"span_length_m": span_m}}
    law = beltid.NormalLaw(k_linear_N_m2=6.5e7, k_quadratic_N_m3=3.0256e11)
    settings = {"arc_deg": arc_deg, "initial_tension_N": 270.0, "pulley_speed_rad_s": 0.21}
    run = beltid.simulate_rig(config, 0.9, law, method="transient", **settings)
    torque = (run.recording.tension_tight_N - run.recording.tension_slack_N) * R
    frame = run.recording.drop(columns="tension_tight_N").assign(torque_N_m=torque)
    by_cells = mu(run.recording, config)
    np.testing.assert_allclose(mu(frame, config), by_cells, rtol=1e-3)

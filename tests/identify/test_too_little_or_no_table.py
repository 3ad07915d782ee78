"""Data that are too few, or no table: each step refuses with words, or says what it cannot know."""

from __future__ import annotations

from typing import Any

import numpy as np

from beltid.identify.friction.run import run_records
from beltid.identify.surface.surface import surface_from_columns

RIG = ("time_s", "tension_tight_N", "tension_slack_N", "pulley_speed_rad_s", "arc_deg")


def rig(run: Any, **others: Any) -> dict[str, Any]:
    """Columns of a rig recording, zero but for those given."""
    return {"run": np.asarray(run), **{name: np.zeros(len(run)) for name in RIG}, **others}


def test_a_surface_without_standard_errors_is_a_surface() -> None:
    force, speed = np.meshgrid([1e3, 2e3], [0.01, 0.02], indexing="ij")
    mu = np.array([[0.8, 0.9], [0.7, 0.75]])
    columns = {
        "arc_deg": np.full(4, np.nan),
        "normal_force_N_m": force.ravel(),
        "slip_speed_m_s": speed.ravel(),
        "mu": mu.ravel(),
    }
    surface = surface_from_columns(columns)
    np.testing.assert_array_equal(surface.mu_nodes, mu)
    assert surface.mu_se_nodes is None


def test_labels_of_runs_are_texts_whatever_they_were() -> None:
    labels = np.array([3.0, 2.5, "R1", float("nan")], dtype=object)
    found = [record.result.run for record in run_records(rig(labels), 0.05)]
    assert found == ["3", "2.5", "R1", ""]

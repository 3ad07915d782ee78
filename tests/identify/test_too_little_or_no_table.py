"""Data that are too few, or no table: each step refuses with words, or says what it cannot know."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from beltid.errors import InputError
from beltid.identify.friction.run import run_records
from beltid.identify.press.dissipation import estimate_dissipation
from beltid.identify.slip.slip import fit_slip
from beltid.identify.surface.surface import surface_from_columns

SLIP = ("initial_tension_N", "torque_N_m", "driver_speed_rad_s", "driven_speed_rad_s")
RIG = ("time_s", "tension_tight_N", "tension_slack_N", "pulley_speed_rad_s", "arc_deg")


def rig(run: Any, **others: Any) -> dict[str, Any]:
    """Columns of a rig recording, zero but for those given."""
    return {"run": np.asarray(run), **{name: np.zeros(len(run)) for name in RIG}, **others}


REFUSED = {
    "a column that is a matrix": (
        lambda: run_records(rig([1, 1, 1], time_s=np.zeros((3, 2))), 0.05),
        r"column time_s has shape \(3, 2\), must be one-dimensional",
    ),
    "speed-loss columns of two lengths": (
        lambda: fit_slip(
            {"run": np.zeros(4), **{n: np.zeros(5 if n == "torque_N_m" else 4) for n in SLIP}}, 0.05
        ),
        r"torque_N_m \(5,\), .*must be equally many",
    ),
    "no press curve": (
        lambda: estimate_dissipation([]),
        "no test was unloaded",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_table_is_refused_with_what_was_found(case: str) -> None:
    call, words = REFUSED[case]
    with pytest.raises(InputError, match=words):
        call()


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
    assert [record.run for record in run_records(rig(labels), 0.05)] == ["3", "2.5", "R1", ""]

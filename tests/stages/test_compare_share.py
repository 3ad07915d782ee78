"""A comparison of few runs is not a proof of the campaign."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest

import beltid


def campaign(n: int = 20) -> pd.DataFrame:
    tension = np.linspace(50.0, 400.0, n)
    return pd.DataFrame(
        {
            "run": [f"R{k:02d}" for k in range(n)],
            "arc_deg": np.full(n, 82.0),
            "nominal_tension_N": tension,
            "pulley_speed_rad_s": np.full(n, 0.21),
            "normal_force_N_m": tension / 0.05,
            "mu_sliding": np.full(n, 0.9),
            "status": np.full(n, "ok"),
        }
    )


def compared(simulated: int, broken: int = 0) -> Any:
    measured = campaign()
    measured.loc[measured.index[len(measured) - broken :], "status"] = "no plateau"
    return beltid.compare(measured, campaign().iloc[:simulated])


@pytest.mark.parametrize(
    ("simulated", "broken", "passed", "warned"),
    [
        (20, 0, True, False),
        (16, 0, True, False),
        (15, 0, True, True),
        (10, 0, True, True),
        (9, 0, False, True),
        (1, 0, False, True),
        (9, 2, True, True),  # half of the 18 that can be used
        (8, 2, False, True),
    ],
)
def test_fewer_than_half_of_the_usable_runs_are_no_proof(
    simulated: int, broken: int, passed: bool, warned: bool
) -> None:
    outcome = compared(simulated, broken)
    assert outcome.result.overall.largest == 0.0
    assert outcome.result.passed is passed
    assert outcome.extra["passed"] is passed
    told = [f"only {simulated} of {20 - broken} measured runs" in w for w in outcome.warnings]
    assert any(told) is warned

"""Channels in another unit than assumed contradict the cells: refused, with the line to write."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import beltid

LONG = pytest.mark.long
RIGDATA = Path(__file__).parents[2] / "rigdata"
R = 0.05
LBF_IN = 4.4482216152605 * 0.0254
WEIGHT = {"rig": {"holds": "weight_slack"}}


def runs(belt: str, every: int = 12, arcs: tuple[float, ...] = (82.0,)) -> pd.DataFrame:
    rig = pd.read_csv(RIGDATA / belt / "rig.csv")
    rig = rig[rig.arc_deg.isin(arcs)]
    return rig[rig.run.isin(rig.run.unique()[::every])]


def hung(span: str = "slack") -> pd.DataFrame:
    """The same friction with the nominal tension as a weight on one span."""
    rig = runs("5pk")
    other = "tight" if span == "slack" else "slack"
    ratio = rig[f"tension_{other}_N"] / rig[f"tension_{span}_N"]
    weight = rig.initial_tension_N.astype(float)
    columns = {"weight_N": weight, f"tension_{other}_N": weight * ratio}
    return rig.drop(columns=[f"tension_{span}_N", "initial_tension_N"]).assign(**columns)


def by_torque() -> pd.DataFrame:
    """The torque of the force difference, and the slack cell."""
    rig = runs("5pk")
    torque = (rig.tension_tight_N - rig.tension_slack_N) * R
    return rig.drop(columns="tension_tight_N").assign(torque_N_m=torque)


BENCHES = {
    "cells": (lambda: runs("5pk"), {}),
    "weight on the slack span": (hung, WEIGHT),
    "weight on the tight span": (lambda: hung("tight"), {}),
    "torque": (by_torque, {}),
}


def refused(frame: pd.DataFrame, config: dict[str, Any] | None = None) -> str:
    with pytest.raises(beltid.InputError) as caught:
        beltid.fit_friction(frame, config)
    return str(caught.value)


def mu(frame: pd.DataFrame, config: dict[str, Any] | None = None) -> np.ndarray:
    found = beltid.fit_friction(frame, config).to_frame()
    assert set(found.status) == {"ok"}
    return found.mu_sliding.to_numpy()


def with_unit(config: dict[str, Any], column: str, unit: Any) -> dict[str, Any]:
    return {**config, "units": {"rig": {column: unit}}}


@pytest.mark.parametrize(
    ("bench", "column", "factor", "unit"),
    [
        ("weight on the slack span", "weight_N", 9.80665, "kg"),
        pytest.param("weight on the tight span", "weight_N", 9.80665, "kg", marks=LONG),
        pytest.param("weight on the slack span", "tension_tight_N", 9.80665, "kg", marks=LONG),
        ("torque", "torque_N_m", LBF_IN, "lbf in"),
        ("cells", "pulley_speed_rad_s", np.pi / 30.0, "rpm"),
    ],
)
def test_another_unit_is_refused_until_it_is_stated(bench, column, factor, unit):
    make, config = BENCHES[bench]
    frame = make()
    truth = mu(frame, config)
    read = frame.assign(**{column: frame[column] / factor})
    found = refused(read, config)
    assert "run R" in found
    assert f"units: {{rig: {{{column}: {unit}}}}}" in found
    np.testing.assert_allclose(mu(read, with_unit(config, column, unit)), truth, rtol=1e-4)


@pytest.mark.parametrize(
    ("span_m", "EA_N", "arc_deg"), [(0.03, 1e5, 25.0), (0.1, 1e4, 170.0), (1.0, 2e4, 82.0)]
)
def test_belts_and_spans_of_any_stiffness_are_plausible(span_m, EA_N, arc_deg):
    config = {"belt": {"axial_stiffness_N": EA_N}, "rig": {"span_length_m": span_m}}
    law = beltid.NormalLaw(k_linear_N_m2=6.5e7, k_quadratic_N_m3=3.0256e11)
    settings = {"arc_deg": arc_deg, "initial_tension_N": 270.0, "pulley_speed_rad_s": 0.21}
    run = beltid.simulate_rig(config, 0.9, law, method="transient", **settings)
    torque = (run.recording.tension_tight_N - run.recording.tension_slack_N) * R
    frame = run.recording.drop(columns="tension_tight_N").assign(torque_N_m=torque)
    by_cells = mu(run.recording, config)
    np.testing.assert_allclose(mu(frame, config), by_cells, rtol=1e-3)

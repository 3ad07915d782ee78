"""Recordings of the simulated rig, which have no noise, through the reduction of the bench."""

from __future__ import annotations

from itertools import product

import numpy as np
import pandas as pd
import pytest

import beltid
from beltid.identify.friction.reduction import reduce_records
from beltid.identify.friction.run import run_records
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw

# two belts of the virtual bench, rigdata/README.md
BELTS = {
    "soft": (NormalLaw(5.6e7, 2.20e11), 0.8e5, 0.016, 0.08),
    "stiff": (NormalLaw(6.5e7, 3.0256e11), 1.0e5, 0.02, 0.10),
}
ARCS_DEG, TENSIONS_N = (40, 68, 82), (40, 130, 220, 340)
SPEEDS_RAD_S = (0.05, 0.21, 0.84)


def true_friction() -> FrictionSurface:
    f, v = np.geomspace(100.0, 3e4, 25), np.geomspace(2e-3, 0.05, 15)
    rate = np.log1p(v / 0.002) / np.log1p(0.01 / 0.002)
    return FrictionSurface(f, v, 1.05 * (f[:, None] / 5400.0) ** -0.2 * (1.0 + 0.5 * (rate - 1.0)))


@pytest.mark.parametrize("belt", ["soft", pytest.param("stiff", marks=pytest.mark.long)])
def test_the_level_of_every_run_is_that_on_which_it_settles(belt: str) -> None:
    law, EA, EI, mass = BELTS[belt]
    config = {
        "belt": {
            "axial_stiffness_N": EA,
            "bending_stiffness_N_m2": EI,
            "mass_per_length_kg_m": mass,
        }
    }
    surface, parts, settled = true_friction(), [], []
    for k, (arc, tension, speed) in enumerate(product(ARCS_DEG, TENSIONS_N, SPEEDS_RAD_S)):
        one = beltid.simulate_rig(
            config,
            surface,
            law,
            arc_deg=arc,
            initial_tension_N=tension,
            pulley_speed_rad_s=speed,
            method="transient",
        )
        parts.append(one.recording.assign(run=str(k)))
        last = one.recording.iloc[-1]
        settled.append(np.log(last.tension_tight_N / last.tension_slack_N) / np.radians(arc))
    columns = pd.concat(parts)
    runs = reduce_records(
        run_records({name: columns[name].to_numpy() for name in columns}, 0.05), 0.05
    )
    assert {run.status for run in runs} == {"ok"}
    off = np.array([run.mu_sliding for run in runs]) / settled - 1.0
    assert np.sqrt(np.mean(off**2)) < 6e-5
    assert np.abs(off).max() < 3e-4

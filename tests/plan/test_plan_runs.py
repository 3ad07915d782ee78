"""The plan as a Python function, from results."""

import math

import numpy as np
import pandas as pd
import pytest
from truth.bench import friction

import beltid

LAW = beltid.NormalLaw(k_linear_N_m2=6.5e7, k_quadratic_N_m3=3.0256e11)
CONFIG = {
    "rig": {
        "arcs_deg": [40, 82],
        "initial_tensions_N": [50, 411],
        "pulley_speeds_rad_s": [0.1, 0.42],
    }
}


def measured() -> pd.DataFrame:
    """Every third run of the 5PK bench of the truth at two of its speeds."""
    return pd.DataFrame(friction(0.003)).iloc[::3]


def test_from_results_it_goes_on_from_their_uncertainty():
    runs = measured()
    known = beltid.refine_surface(runs, LAW, CONFIG)
    planned = beltid.plan_runs(known, LAW, CONFIG, friction=runs, runs=4, goal_u=0.0)
    # what the surface states, over forces and speeds of the candidates
    target, surface = planned.result.target, known.result.surface
    u = surface.mu_u(target.normal_force, target.slip_speed)
    mu = surface.mu(target.normal_force, target.slip_speed)
    stated = math.sqrt(float(target.weight @ np.square(u / mu)))
    assert planned.result.plan.before == pytest.approx(stated, rel=0.05)
    # 16 runs of one bench one way: the gains of its cells remain, runs the other way tell them
    frame = planned.to_frame()
    assert (frame["pulley_speed_rad_s"] < 0.0).any()
    assert planned.result.plan.after < planned.result.plan.before


def test_what_a_plan_cannot_go_on_from_is_refused():
    grid = beltid.FrictionSurface([1000.0, 2000.0], [0.01], [[1.0], [0.9]])
    with pytest.raises(beltid.InputError, match="must be the result of refine_surface"):
        beltid.plan_runs(grid, LAW, CONFIG)
    with pytest.raises(beltid.InputError, match="goal-u = 2, must be in"):
        beltid.plan_runs(config=CONFIG, goal_u=2.0)

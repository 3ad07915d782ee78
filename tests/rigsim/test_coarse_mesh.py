"""Runs on ten elements: every path of the simulation, also where its kernels are not compiled.

Ten elements are too few for the digits of the other tests, but balance and Coulomb's law hold on
any mesh, and the plateau in time is the steady solution of the same mesh.
"""

from __future__ import annotations

import numpy as np
import pytest
from rig_bench import LAW_5PK, at, bench, sensitivity_of, start

from beltid.laws.friction_surface import FrictionSurface
from beltid.params import Contact
from beltid.rigsim.rig import RunResult, SimulationSettings, campaign, simulate

COARSE = 10
STEADY = SimulationSettings("steady", COARSE)
FALLING = FrictionSurface(
    [500.0, 4000.0, 12000.0], [0.005, 0.01, 0.02], np.outer([1.0, 0.8, 0.7], [1.0, 0.99, 0.98])
)
RISING = FrictionSurface(
    [500.0, 4000.0, 12000.0], [0.005, 0.01, 0.02], np.outer([1.0, 0.8, 0.7], [0.9, 1.0, 1.1])
)


@pytest.mark.parametrize("supports", ["pinned", "clamped"])
def test_a_constant_coefficient_comes_back(supports: str) -> None:
    # no bending to speak of: Euler-Eytelwein, whatever the mesh
    run = simulate(bench(0.0005, supports=supports, mu=0.5), at(), STEADY)
    assert run.mu == pytest.approx(0.5, rel=0.03)
    assert run.tension_tight_N > 270.0 > run.tension_slack_N


@pytest.mark.parametrize(("solver", "surface"), [("newton", RISING), ("lemke", FALLING)])
def test_the_plateau_in_time_is_the_steady_one(solver: str, surface: FrictionSurface) -> None:
    rig = bench(law=LAW_5PK, mu=surface, contact=Contact(sticking_ratio=1.1))
    still = simulate(rig, at(), STEADY)
    chosen = SimulationSettings(elements=COARSE, steps=52, friction_solver=solver)  # type: ignore[arg-type]
    run = simulate(rig, at(), chosen)
    assert run.mu == pytest.approx(still.mu, rel=2e-3)
    assert run.record.slip_m <= 1e-13
    assert run.record.cone <= 1e-9


def test_the_contact_at_a_time_and_the_sensitivity_are_given() -> None:
    rig = bench(law=LAW_5PK, mu=FALLING)
    looked_at = SimulationSettings(elements=COARSE, steps=52, profile_times_s=(0.001, 0.05))
    assert len(simulate(rig, at(), looked_at).snapshots) == 2
    found = sensitivity_of(rig, at(), COARSE)
    # more friction anywhere pulls the tight side and slackens the other
    assert found.tension_tight_N.sum() > 0.0 > found.tension_slack_N.sum()


def test_a_campaign_gives_the_runs_in_their_places() -> None:
    points = [at(40), at(82), at(82, 1e-3)]
    ended = dict(campaign(bench(law=LAW_5PK), points, STEADY, 2))
    assert sorted(ended) == [0, 1, 2]
    assert isinstance(ended[0], RunResult)
    assert isinstance(ended[1], RunResult)
    assert ended[1].tension_tight_N > ended[0].tension_tight_N
    assert not isinstance(ended[2], RunResult)


def test_turning_back_slides_the_other_way() -> None:
    march = start(bench(), at(), elements=COARSE)
    assert march.go(1e-3, 0.21, 40) == 40
    ahead = march.T_A[-1] - march.T_B[-1]
    assert march.go(1e-3, -0.21, 60, profiles=True) == 60
    assert march.T_A[-1] - march.T_B[-1] == pytest.approx(-ahead, rel=0.05)

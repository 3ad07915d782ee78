"""What is not known of simulated runs: against runs simulated anew with the error put in."""

import math
from dataclasses import replace

import numpy as np
import pytest
from virtual_bench import BELT, LAW, RIG, TRUE_SURFACE, assumed

from beltid.identify.friction.run import TWO_CELLS
from beltid.laws.friction_surface import FrictionSurface
from beltid.params import Contact, OperatingPoint
from beltid.rig.model import Bench
from beltid.rig.runs import SimulationSettings, simulate
from beltid.uncertainty.measured import PressLaw
from beltid.uncertainty.simulated import (
    Campaign,
    RunsUncertainty,
    simulated_runs,
    simulated_uncertainty,
)
from beltid.uncertainty.sources import RIG as RIG_, StandardUncertainties, stated_sources

POINTS = [
    OperatingPoint(math.radians(arc), T_0, omega)
    for arc, T_0, omega in ((40.0, 220.0, 0.1), (82.0, 130.0, 0.1), (82.0, 320.0, 0.42))
]
ARC = np.array([0, 1, 1], dtype=np.intp)
SHARE, OWN = 0.02, 0.015
GIVEN = assumed({"arc": math.radians(0.2), "tension_gain": 0.002})


def scaled(by: float) -> FrictionSurface:
    mu = by * TRUE_SURFACE.mu_nodes
    return FrictionSurface(TRUE_SURFACE.normal_force_N_m, TRUE_SURFACE.slip_speed_m_s, mu, OWN * mu)


def bench(surface: FrictionSurface) -> Bench:
    return Bench(BELT, RIG, Contact(), LAW, surface)


def doubt(surface: FrictionSurface, given: StandardUncertainties = GIVEN) -> RunsUncertainty:
    press = PressLaw(LAW, np.zeros((2, 2)), 1.2e-4, 0.04)
    of = bench(surface)
    exact = [simulate(of, point, SimulationSettings("steady", 40)) for point in POINTS]
    tensions = np.array([(run.tension_tight_N, run.tension_slack_N) for run in exact]).T
    campaign = Campaign(simulated_runs(of, POINTS, ARC, TWO_CELLS, tensions), of, press)
    return simulated_uncertainty(campaign, stated_sources(given, (RIG_,), 2), elements=40)


def log_mu(surface: FrictionSurface, point: OperatingPoint) -> float:
    return math.log(simulate(bench(surface), point, SimulationSettings("steady", 40)).mu)


@pytest.fixture(scope="module")
def plain() -> RunsUncertainty:
    return doubt(scaled(1.0))


@pytest.fixture(scope="module")
def by_sensitivity() -> np.ndarray:
    """Change of ln mu of the runs by ln of a factor on the whole surface, from new runs."""
    changes = [log_mu(scaled(1.01), p) - log_mu(scaled(1.0), p) for p in POINTS]
    return np.array(changes) / math.log(1.01)


def test_an_error_of_the_surface_acts_as_on_runs_simulated_anew(
    plain: RunsUncertainty, by_sensitivity: np.ndarray
) -> None:
    # the first source scales all nodes together; one more column is scatter
    nodes = np.ones(TRUE_SURFACE.mu_nodes.shape)
    names = [source.error for source in stated_sources(GIVEN, (RIG_,), 2)]
    factor = np.stack([SHARE * nodes, 0.0 * nodes, OWN * nodes], axis=-1)
    found = doubt(scaled(1.0).with_covariance(factor, names[:2]))
    change = found.simulated - plain.simulated
    np.testing.assert_allclose(change[:, 0], SHARE * by_sensitivity, rtol=0.02)
    np.testing.assert_allclose(change[:, 1:], 0.0, atol=1e-12)
    np.testing.assert_allclose(found.difference - plain.difference, change, atol=1e-12)
    np.testing.assert_allclose(found.scatter, OWN * by_sensitivity, rtol=0.02)
    np.testing.assert_allclose(found.mu, plain.mu, rtol=1e-12)
    simulated = [log_mu(scaled(1.0), point) for point in POINTS]
    np.testing.assert_allclose(np.log(plain.mu), simulated, atol=1e-9)
    # without a covariance the standard errors add up
    np.testing.assert_allclose(plain.scatter, OWN * by_sensitivity, rtol=0.05)


def test_slopes_by_the_settings_are_those_of_runs_simulated_anew(plain: RunsUncertainty) -> None:
    surface, step = scaled(1.0), 1e-3
    for i, point in enumerate(POINTS):
        for k, name in enumerate(("T_0", "omega")):
            up, down = (
                log_mu(surface, replace(point, **{name: getattr(point, name) * (1 + s)}))
                for s in (step, -step)
            )
            assert plain.by_setting[i, k] == pytest.approx((up - down) / (2 * step), abs=2e-3)

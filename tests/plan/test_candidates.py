"""Candidates of the rig as rows of the linear model."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, Rig
from beltid.plan.candidates import (
    Candidates,
    NoiseLaw,
    Settings,
    in_both_directions,
    noise_law,
    simulate_candidates,
)
from beltid.rig.model import Bench
from beltid.rig.runs import SimulationSettings, simulate
from beltid.uncertainty.measured import PressLaw
from beltid.uncertainty.sources import ARC, Source

LAW = NormalLaw(6.5e7, 3.0256e11)
SETTINGS = Settings((40.0, 82.0), (60.0, 300.0), (0.05, 0.42))
SURFACE = FrictionSurface(
    np.geomspace(200.0, 20000.0, 12),
    [0.0025, 0.021],
    0.9 * (np.geomspace(200.0, 20000.0, 12)[:, None] / 5400.0) ** -0.18 * np.array([0.8, 1.1]),
)
BENCH = Bench(Belt(1.0e5, 0.02, 0.10), Rig(0.05, 0.10), Contact(), LAW, SURFACE)


@pytest.fixture(scope="module")
def candidates() -> Candidates:
    press = PressLaw(LAW, np.zeros((2, 2)), 1.2e-4, 0.04)
    return simulate_candidates(BENCH, press, SETTINGS, (82.0,), SURFACE)


def source(error: str, size: float, place: int = 0) -> Source:
    return Source(error, error, place, size, "", 1.0, "stated")


def simulated_mu(bench: Bench) -> np.ndarray:
    settings = SimulationSettings("steady", elements=240)  # two meshes differ less than EI matters
    return np.array([simulate(bench, point, settings).mu for point in SETTINGS.points()])


def test_arcs_that_were_measured_keep_their_numbers(candidates):
    # 40° is new: it comes after the one that is known
    assert candidates.measured.arc.tolist() == [1, 1, 1, 1, 0, 0, 0, 0]


def test_a_bending_stiffness_that_is_larger_shows_as_the_difference_of_two_simulations(candidates):
    rows = candidates.rows([source("bending_stiffness", 0.05)], NoiseLaw(), {})
    stiffer = replace(BENCH, belt=BENCH.belt._replace(EI=1.05 * BENCH.belt.EI))
    change = np.log(simulated_mu(stiffer) / simulated_mu(BENCH))
    # measured less simulated: the simulated coefficient falls out with the other sign
    # (the derivative of a coarse mesh scatters where few contact points touch)
    assert np.linalg.norm(rows.S[:, 0] + change) < 0.1 * np.linalg.norm(change)
    assert np.abs(change).max() > 2e-3


def test_an_arc_that_is_larger_lowers_what_was_measured_on_it_alone(candidates):
    rows = candidates.rows([source("arc_setting", 0.01, place=0)], NoiseLaw(), {})
    assert np.all(rows.S[:4] == 0.0)  # of the arc of 82°, the last four
    # Eq. (6) falls by d beta / beta; what the simulated coefficient does is small against it
    np.testing.assert_allclose(rows.S[4:, 0], -0.01 / math.radians(82.0), rtol=0.2)


def test_an_effect_of_an_arc_and_a_tail_are_columns_of_their_runs(candidates):
    sources = [source(ARC, 0.003, place=1), source("shared_tail", 1.0)]
    rows = candidates.rows(sources, NoiseLaw(), {"shared_tail": 0.002})
    np.testing.assert_allclose(rows.S[:4, 0], 0.003 * candidates.J.sum(axis=1)[:4], rtol=5e-3)
    assert np.all(rows.S[4:, 0] == 0.0)
    np.testing.assert_allclose(rows.S[:, 1], 0.002, rtol=5e-3)


def test_a_gain_of_a_cell_changes_its_sign_with_the_direction_and_nothing_else_does(candidates):
    sources = [source("cell_gain", 0.002, 0), source("cell_gain", 0.002, 1), source("arc", 0.01)]
    rows = in_both_directions(candidates.rows(sources, NoiseLaw(), {}), sources)
    forward, back = np.split(rows.S, 2)
    np.testing.assert_allclose(back[:, :2], forward[:, [1, 0]])
    # Eq. (6): ln(T_tight / T_slack); the tension at rest, which both move, counts little
    np.testing.assert_allclose(forward[:, 0], -forward[:, 1], rtol=0.25)
    np.testing.assert_array_equal(back[:, 2], forward[:, 2])
    np.testing.assert_array_equal(*np.split(rows.J, 2))


def test_the_noise_law_of_runs_is_found_again(candidates):
    runs = candidates.measured
    by_tension = 0.2 * np.hypot(1.0 / runs.tight, 1.0 / runs.slack)
    noise = np.hypot(0.004, by_tension / np.log(runs.tight / runs.slack))
    found = noise_law(replace(runs, mu_se=runs.mu * noise), scale=1.5)
    assert found.friction == pytest.approx(0.004, rel=1e-6)
    assert found.tension == pytest.approx(0.2, rel=1e-6)
    # the fit of the surface adds 0.02 % for the simulated coefficient
    expected = 1.5**2 * (noise**2 + 2.0e-4**2)
    np.testing.assert_allclose(found.variance(runs), expected, rtol=1e-6)

"""Candidates as rows of the linear model, and the surface before any run."""

from dataclasses import replace

import numpy as np
import pytest

from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, Rig
from beltid.plan.candidates import (
    knowledge_at,
    noise_law,
    prior_covariance,
    settings_of_rig,
    simulate_candidates,
    usual_surface,
)
from beltid.plan.design import RunRows
from beltid.refine.posterior import Curves
from beltid.rig.model import Bench
from beltid.uncertainty.measured import Measured, PressLaw
from beltid.uncertainty.sources import ARC, Source, SurfaceUncertainty

LAW = NormalLaw(6.5e7, 3.0256e11)
POINTS = settings_of_rig((40.0, 82.0), (60.0, 300.0), (0.05, 0.42))
SURFACE = FrictionSurface(
    np.geomspace(200.0, 20000.0, 12),
    [0.0025, 0.021],
    0.9 * (np.geomspace(200.0, 20000.0, 12)[:, None] / 5400.0) ** -0.18 * np.array([0.8, 1.1]),
)
BENCH = Bench(Belt(1.0e5, 0.02, 0.10), Rig(0.05, 0.10), Contact(), LAW, SURFACE)


def source(error: str, size: float, place: int = 0) -> Source:
    return Source(error, error, place, size, "", 1.0, "stated")


SOURCES = (
    source(ARC, 0.003, place=1),
    source("shared_tail", 1.0),
    source("cell_gain", 0.002, 0),
    source("cell_gain", 0.002, 1),
    source("arc", 0.01),
)


@pytest.fixture(scope="module")
def candidates() -> tuple[RunRows, Measured]:
    press = PressLaw(LAW, np.zeros((2, 2)), 1.2e-4, 0.04)
    exact = SURFACE.with_covariance(np.zeros((12, 2, 0)))
    known = SurfaceUncertainty(exact, (), np.array([82.0]))
    tail = {"shared_tail": 0.002}
    rows, runs, _ = simulate_candidates(BENCH, press, POINTS, known, SOURCES, columns=tail)
    return rows, runs


def test_an_effect_of_an_arc_and_a_tail_are_columns_of_their_runs(candidates):
    rows, _ = candidates
    assert rows.arc.tolist() == [1, 1, 1, 1, 0, 0, 0, 0]  # 40° is new: after 82°, which is known
    np.testing.assert_allclose(rows.S[:4, 0], 0.003 * rows.J.sum(axis=1)[:4], rtol=5e-3)
    assert np.all(rows.S[4:, 0] == 0.0)
    np.testing.assert_allclose(rows.S[:, 1], 0.002, rtol=5e-3)


def test_a_gain_of_a_cell_changes_its_sign_with_the_direction_and_nothing_else_does(candidates):
    rows = candidates[0].in_both_directions(SOURCES)
    forward, back = np.split(rows.S, 2)
    np.testing.assert_allclose(back[:, 2:4], forward[:, [3, 2]])
    # Eq. (6): ln(T_tight / T_slack); the tension at rest, which both move, counts little
    np.testing.assert_allclose(forward[:, 2], -forward[:, 3], rtol=0.25)
    others = [0, 1, 4]
    np.testing.assert_array_equal(back[:, others], forward[:, others])
    np.testing.assert_array_equal(*np.split(rows.J, 2))


def test_the_noise_law_of_runs_is_found_again(candidates):
    _, runs = candidates
    by_tension = 0.2 * np.hypot(1.0 / runs.tight, 1.0 / runs.slack)
    noise = np.hypot(0.004, by_tension / np.log(runs.tight / runs.slack))
    found = noise_law(replace(runs, mu_se=runs.mu * noise), scale=1.5)
    assert found.friction == pytest.approx(0.004, rel=1e-6)
    assert found.tension == pytest.approx(0.2, rel=1e-6)
    # the fit of the surface adds 0.02 % for the simulated coefficient
    expected = 1.5**2 * (noise**2 + 2.0e-4**2)
    np.testing.assert_allclose(found.variance(runs), expected, rtol=1e-6)


# --- the surface before any run, and between what was measured ---

FORCES = np.linspace(np.log(400.0), np.log(12000.0), 8)
SPEEDS = np.log([0.0025, 0.01, 0.04])
WIDER = Curves(np.append(FORCES, FORCES[-1] + 0.5), np.log([0.001, *np.exp(SPEEDS)]))
NODES = np.add.outer(np.arange(8), 9 * np.arange(1, 4)).ravel()


def test_the_prior_holds_a_surface_no_finer_than_its_roughness() -> None:
    covariance = prior_covariance(Curves(FORCES, SPEEDS))
    # of a level known at the middle speed, a factor 4 in speed away is left what slope and bend say
    level = np.kron(np.eye(3), np.full((1, 8), 1.0 / 8.0))
    of_levels = level @ covariance @ level.T
    left = of_levels[2, 2] - of_levels[2, 1] ** 2 / of_levels[1, 1]
    assert 0.15 * np.log(4.0) < np.sqrt(left) < 0.15 * np.log(4.0) + 0.1 * np.log(4.0) ** 1.5


def known(changes: np.ndarray, scatter: np.ndarray) -> SurfaceUncertainty:
    factor = np.concatenate([changes, scatter], axis=-1)
    surface = usual_surface(FORCES, SPEEDS).with_covariance(factor)
    return SurfaceUncertainty(surface, SOURCES[: changes.shape[-1]], np.zeros(0))


def test_the_nodes_of_a_measured_surface_keep_their_covariance() -> None:
    rng = np.random.default_rng(2)
    shared, scatter = rng.normal(size=(8, 3, 2)), 0.01 * rng.normal(size=(8, 3, 24))
    # an error more, which new runs alone have
    found, factor = knowledge_at(WIDER, known(shared, scatter), 3), scatter.reshape(24, -1)
    np.testing.assert_allclose(found.scatter[np.ix_(NODES, NODES)], factor @ factor.T, atol=1e-8)
    changes = np.column_stack([shared.reshape(24, 2), np.zeros(24)])
    np.testing.assert_allclose(found.changes[NODES], changes, atol=1e-8)


def test_between_the_nodes_the_surface_is_that_of_a_joint_gaussian() -> None:
    # nodes known without error: what is left of the others is their conditional covariance
    found = knowledge_at(WIDER, known(np.ones((8, 3, 1)), np.zeros((8, 3, 1))), 1)
    joint = np.linalg.inv(prior_covariance(WIDER))
    new = np.setdiff1d(np.arange(36), NODES)
    left = np.linalg.inv(joint[np.ix_(new, new)])
    np.testing.assert_allclose(found.scatter[np.ix_(new, new)], left, rtol=1e-5, atol=1e-7)
    # an error that lifts all nodes lifts what follows from them
    assert np.all((found.changes > 0.6) & (found.changes < 1.1))

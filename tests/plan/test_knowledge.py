"""The surface before any run, and between what was measured."""

from __future__ import annotations

import numpy as np
import pytest

from beltid.laws.friction_surface import FrictionSurface
from beltid.plan.knowledge import (
    LEVEL_WIDTH,
    knots_for,
    knowledge_at,
    prior_covariance,
    speeds_for,
    usual_surface,
)
from beltid.refine.posterior import Curves
from beltid.uncertainty.sources import SurfaceUncertainty

FORCES = np.linspace(np.log(400.0), np.log(12000.0), 8)
SPEEDS = np.log([0.0025, 0.01, 0.04])
WIDER = Curves(np.append(FORCES, FORCES[-1] + 0.5), np.log([0.001, *np.exp(SPEEDS)]))
NODES = np.add.outer(np.arange(8), 9 * np.arange(1, 4)).ravel()


def test_the_prior_holds_a_surface_of_any_usual_level_and_no_finer_than_its_roughness() -> None:
    covariance = prior_covariance(Curves(FORCES, SPEEDS))
    deviation = np.sqrt(np.diag(covariance)).reshape(3, 8)
    middle = deviation[1, 3:5]
    assert np.all((middle > LEVEL_WIDTH) & (middle < 1.2 * LEVEL_WIDTH))
    # away from the middle the slopes count
    assert deviation[0, 0] > deviation[1, 3]
    assert deviation[2, 7] > deviation[1, 3]
    # of a level known at the middle speed, a factor 4 in speed away is left what slope and bend say
    level = np.kron(np.eye(3), np.full((1, 8), 1.0 / 8.0))
    of_levels = level @ covariance @ level.T
    left = of_levels[2, 2] - of_levels[2, 1] ** 2 / of_levels[1, 1]
    assert 0.15 * np.log(4.0) < np.sqrt(left) < 0.15 * np.log(4.0) + 0.1 * np.log(4.0) ** 1.5


def known(changes: np.ndarray, scatter: np.ndarray) -> SurfaceUncertainty:
    surface = usual_surface(FORCES, SPEEDS)
    return SurfaceUncertainty(surface, (), changes, scatter, np.zeros(0))


def test_the_nodes_of_a_measured_surface_keep_their_covariance() -> None:
    rng = np.random.default_rng(2)
    of = known(rng.normal(size=(8, 3, 2)), 0.01 * rng.normal(size=(8, 3, 24)))
    found = knowledge_at(WIDER, of, 3)  # an error more, which new runs alone have
    factor = of.scatter.reshape(24, -1)
    np.testing.assert_allclose(found.scatter[np.ix_(NODES, NODES)], factor @ factor.T, atol=1e-8)
    changes = np.column_stack([of.changes.reshape(24, 2), np.zeros(24)])
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


def test_knots_and_speeds_of_a_measured_surface_stay() -> None:
    surface = FrictionSurface(np.exp(FORCES), np.exp(SPEEDS), np.ones((8, 3)))
    gap = FORCES[1] - FORCES[0]
    knots = knots_for(float(np.exp(FORCES[0] - 1.9 * gap)), 12100.0, surface, 12)
    np.testing.assert_allclose(knots[2:], FORCES)
    np.testing.assert_allclose(np.diff(knots), gap)
    speeds = speeds_for(np.array([0.0026, 0.001, 0.04]), surface)
    np.testing.assert_allclose(speeds, [0.001, *np.exp(SPEEDS)])
    expected = np.log(100.0) + np.log(10.0) * np.arange(5) / 4
    assert knots_for(100.0, 1000.0, None, 5) == pytest.approx(expected)

"""The mixed model of a campaign: against generalised least squares and draws of itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from beltid.mixed import Size
from beltid.refine.curves import Curves
from beltid.refine.effects import BEFORE, Effect
from beltid.refine.posterior import CURVE, DIFFERENCE, NOISE, SCATTER, STATED_ERRORS, LinearRuns
from beltid.uncertainty.sources import ARC, ORDER

N, FORCES = 60, np.log(np.geomspace(300.0, 15000.0, 8))
CURVES = Curves(FORCES, np.log([0.0025, 0.01, 0.04]))
SE = 0.002
SIZES = {CURVE: 0.04, DIFFERENCE: 0.01, NOISE: 1.0, SCATTER: 0.001}


def runs(seed: int = 1, arcs: int = 3, stated: int = 0) -> LinearRuns:
    """Runs at random forces and speeds, arcs in turn; no data yet."""
    rng = np.random.default_rng(seed)
    rows = np.zeros((N, 3, 8))
    rows[np.arange(N), rng.integers(0, 3, N)] = CURVES.basis(rng.uniform(FORCES[0], FORCES[-1], N))
    parts = CURVES.coordinates()
    ends = np.cumsum([0, *(Z.shape[1] for Z in parts.values())]).tolist()
    places = {part: slice(*ends[i : i + 2]) for i, part in enumerate(parts)}
    arc = np.eye(arcs)[np.arange(N) % arcs]
    return LinearRuns(
        y=np.zeros(N),
        X=rows.reshape(N, -1) @ np.hstack(list(parts.values())) / SE,
        parts=places,
        response=np.ones(N) / SE,
        effects=(Effect(ARC, arc / SE, BEFORE[ARC]),),
        stated=0.003 * arc[:, :stated] / SE,
    )


def with_data(model: LinearRuns, seed: int, arcs: np.ndarray | float = 0.0) -> tuple:
    """Draw a surface, effects of arcs and noise; return data and coordinates."""
    rng = np.random.default_rng(seed)
    h = np.sqrt(model.prior_variance(SIZES)) * rng.standard_normal(model.X.shape[1])
    shift = model.effects[0].columns @ np.broadcast_to(arcs, model.effects[0].columns.shape[1])
    noise = np.sqrt(model.variance(SIZES)) * rng.standard_normal(N)
    return replace(model, y=model.X @ h + shift + noise), h


def test_the_estimate_without_stated_errors_is_that_of_generalised_least_squares() -> None:
    sizes = {**SIZES, ARC: 0.01}
    model, _ = with_data(runs(), 2, np.array([0.01, -0.01, 0.0]))
    Z = sizes[ARC] * model.effects[0].columns
    V = np.diag(model.variance(sizes)) + Z @ Z.T
    prior = model.prior_variance(sizes)
    P = np.diag(np.divide(1.0, prior, out=np.zeros(prior.size), where=prior > 0.0))
    inverse = np.linalg.inv(model.X.T @ np.linalg.solve(V, model.X) + P)
    expected = inverse @ model.X.T @ np.linalg.solve(V, model.y)
    found = model.solve(sizes)
    np.testing.assert_allclose(found.coordinates, expected, atol=1e-8)
    by_effects = found.gain @ Z
    np.testing.assert_allclose(found.covariance + by_effects @ by_effects.T, inverse, atol=1e-9)


def test_the_sizes_are_found() -> None:
    found = []
    for seed in range(6):
        arcs = np.random.default_rng(50 + seed).normal(size=3)
        model, _ = with_data(runs(seed), seed, 0.02 * arcs / np.std(arcs))
        sizes = model.choose({})
        found.append([sizes[CURVE], np.sqrt(model.variance(sizes)[0]), sizes[ARC]])
    curve, noise, arc = np.exp(np.mean(np.log(found), axis=0))
    assert curve == pytest.approx(0.04, rel=0.3)
    assert noise == pytest.approx(
        np.hypot(1.0, 0.5), rel=0.15
    )  # and scatter: either may replace the other
    assert 0.015 < arc < 0.04  # the posterior mean of the square is above the mode


def test_intervals_of_surface_and_arcs_hold_the_truth() -> None:
    errors, apart = [], []
    B = np.hstack(list(CURVES.coordinates().values()))
    for seed in range(25):
        arcs = 0.01 * np.random.default_rng(90 + seed).normal(size=3)
        model, h = with_data(runs(seed), seed, arcs)
        sizes = model.choose({})
        found = model.solve(sizes)
        by_arcs = found.gain @ (sizes[ARC] * model.effects[0].columns)
        C = B @ (found.covariance + by_arcs @ by_arcs.T) @ B.T
        errors.append(B @ (found.coordinates - h) / np.sqrt(np.diag(C)))
        w = np.array([1.0, -1.0, 0.0])
        apart.append(w @ (found.effects - arcs) / np.sqrt(w @ found.effects_covariance @ w))
    assert 0.88 < np.mean(np.abs(errors) < 1.96) < 0.995
    assert 0.6 < np.sqrt(np.mean(np.square(apart))) < 1.5


def test_a_stated_error_of_the_arcs_is_not_counted_once_more_as_their_effect() -> None:
    """Arcs set wrongly as stated: the effect stays small, the surface does not follow them."""
    stated = runs(stated=3)
    model, _ = with_data(stated, 4, np.array([0.004, -0.003, 0.001]))
    sizes = model.choose({})
    without = replace(model, stated=stated.stated[:, :0]).choose({})
    assert sizes[ARC] < 0.7 * without[ARC]
    assert sizes[STATED_ERRORS] > 0.3
    quiet, _ = with_data(stated, 4)
    assert quiet.choose({})[STATED_ERRORS] < 0.5  # the runs clear the bench
    # nor is it evidence for an effect
    assert model.log_evidence_for([ARC]) < np.log(20.0)


def test_a_stated_error_is_found_beside_its_statement() -> None:
    column = np.linspace(-1.0, 1.0, N)[:, None] * 0.003 / SE
    model = replace(runs(), stated=column, effects=())
    data = replace(with_data(runs(), 5)[0], stated=column, effects=())
    data = replace(data, y=data.y + 1.5 * column[:, 0])
    mean, sd = data.stated_errors({**SIZES, STATED_ERRORS: 0.7})
    assert mean[0] == pytest.approx(1.5, abs=3.0 * sd[0])
    assert 0.0 < sd[0] < 0.5
    assert model.stated_errors({**SIZES, STATED_ERRORS: 0.7})[0] == pytest.approx(0.0, abs=1e-12)


def test_an_effect_that_another_one_can_replace_has_no_evidence() -> None:
    """A campaign sorted by arcs: arcs or order."""
    model = runs(arcs=2)
    arc = np.repeat(np.eye(2), N // 2, axis=0)
    order = np.linspace(-0.5, 0.5, N)[:, None]
    sorted_ = (Effect(ARC, arc / SE, BEFORE[ARC]), Effect(ORDER, order / SE, BEFORE[ORDER]))
    data, _ = with_data(replace(model, effects=sorted_[:1]), 6, np.array([0.0, 0.02]))
    data = replace(data, effects=sorted_)
    assert data.log_evidence_for([ARC, ORDER]) > np.log(20.0)
    at_random = np.random.default_rng(1).permutation(N)
    mixed = replace(data, effects=(sorted_[0], replace(sorted_[1], columns=order[at_random] / SE)))
    assert mixed.log_evidence_for([ARC]) > data.log_evidence_for([ARC]) + 3.0
    assert mixed.log_evidence_for([ORDER]) < 1.0


def test_the_share_a_free_surface_explains_is_a_multiple_correlation() -> None:
    model = runs()
    z = np.random.default_rng(3).normal(size=(N, 1))
    free = {CURVE: 100.0, DIFFERENCE: 100.0, NOISE: 1.0, SCATTER: 1e-9}
    rest = z[:, 0] - model.X @ np.linalg.lstsq(model.X, z[:, 0], rcond=None)[0]
    centred = z[:, 0] - z.mean()
    expected = 1.0 - rest @ rest / (centred @ centred)
    assert model.explained(z, free)[0] == pytest.approx(expected, abs=1e-3)


def test_a_few_runs_that_fit_by_chance_are_not_called_exact() -> None:
    model, h = with_data(runs(), 8)
    assert replace(model, y=model.X @ h).choose({})[NOISE] == 0.5
    assert BEFORE[ARC] == Size(3.0e-3, 1.5, largest=0.3)

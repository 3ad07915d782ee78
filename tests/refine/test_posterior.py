"""The mixed model of a campaign: against generalised least squares and draws of itself."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

import beltid.refine.posterior as refined
from beltid.refine.posterior import CURVE, DIFFERENCE, NOISE, SCATTER, SHARED_ERRORS
from beltid.uncertainty.sources import ARC, ORDER

N, FORCES = 60, np.log(np.geomspace(300.0, 15000.0, 8))
CURVES = refined.Curves(FORCES, np.log([0.0025, 0.01, 0.04]))
SE = 0.002
SIZES = {CURVE: 0.04, DIFFERENCE: 0.01, NOISE: 1.0, SCATTER: 0.001}
B = CURVES.B


def runs(seed: int = 1) -> refined.LinearRuns:
    """Runs at random forces and speeds, arcs in turn; no data yet."""
    rng = np.random.default_rng(seed)
    rows = np.zeros((N, 3, 8))
    rows[np.arange(N), rng.integers(0, 3, N)] = CURVES.basis(rng.uniform(FORCES[0], FORCES[-1], N))
    arc = np.eye(3)[np.arange(N) % 3]
    return refined.LinearRuns(
        y=np.zeros(N),
        parts={name: rows.reshape(N, -1) @ Z for name, Z in CURVES.parts.items()},
        errors=np.full(N, SE),
        response=np.ones(N),
        effects={ARC: arc},
    )


def with_data(
    model: refined.LinearRuns, seed: int, arcs: np.ndarray | float = 0.0
) -> tuple[refined.LinearRuns, np.ndarray]:
    """Draw a surface, effects of arcs and noise; return data and coordinates."""
    rng = np.random.default_rng(seed)
    precision = model.precision(SIZES)
    sd = np.divide(1.0, np.sqrt(precision), out=np.zeros(precision.size), where=precision > 0.0)
    h = sd * rng.standard_normal(precision.size)
    (columns,) = model.effects.values()
    noise = np.sqrt(model.variance(SIZES)) * rng.standard_normal(N)
    y = model.X @ h + columns @ np.broadcast_to(arcs, columns.shape[1]) + noise
    return replace(model, y=y), h


def test_the_estimate_is_that_of_generalised_least_squares() -> None:
    sizes = {**SIZES, ARC: 0.01}
    model, _ = with_data(runs(), 2, np.array([0.01, -0.01, 0.0]))
    Z = sizes[ARC] * model.effects[ARC]
    V = np.diag(model.variance(sizes)) + Z @ Z.T
    P = np.diag(model.precision(sizes))
    inverse = np.linalg.inv(model.X.T @ np.linalg.solve(V, model.X) + P)
    found, q = model.model().at(sizes), len(P)
    expected = inverse @ model.X.T @ np.linalg.solve(V, model.y)
    np.testing.assert_allclose(found.mean[:q], expected, atol=1e-8)
    np.testing.assert_allclose(found.covariance[:q, :q], inverse, atol=1e-12)
    np.testing.assert_allclose(model.gain(found)[:q] @ model.y, expected, atol=1e-8)


def test_a_common_error_passes_whole_whatever_the_noise() -> None:
    model, _ = with_data(runs(), 2)
    for noise in (0.1, 1.0, 10.0):
        found = model.model().at({**SIZES, NOISE: noise, ARC: 1e-9})
        level = B @ model.gain(found)[: len(B)] @ model.response
        np.testing.assert_allclose(level, 1.0, rtol=1e-6)


def test_the_misfit_is_least_at_the_estimate_whatever_the_effects_take() -> None:
    """It falls along every step to it, so that a search by it cannot turn in a circle."""
    model, sizes = with_data(runs(), 2, np.array([0.03, -0.01, 0.0]))[0], {**SIZES, ARC: 0.01}
    found, q = model.model().at(sizes), model.X.shape[1]
    h, precision = found.mean[:q], np.linalg.inv(found.covariance[:q, :q])
    least = model.misfit(model.y - model.X @ h, h, sizes)
    for step in 0.01 * np.random.default_rng(5).normal(size=(3, q)):
        more = model.misfit(model.y - model.X @ (h + step), h + step, sizes) - least
        assert more == pytest.approx(step @ precision @ step, rel=1e-6)


def test_an_error_that_runs_share_is_found_beside_its_statement() -> None:
    column = np.linspace(-1.0, 1.0, N)[:, None] * 0.003
    data = replace(with_data(runs(), 5)[0], shared=column, effects={})
    data = replace(data, y=data.y + 1.5 * column[:, 0])
    mean, covariance = data.model().at(SIZES).of(SHARED_ERRORS)
    assert mean[0] == pytest.approx(1.5, abs=3.0 * np.sqrt(covariance[0, 0]))
    assert covariance[0, 0] < 0.25


def test_an_effect_that_a_shared_error_can_replace_has_no_evidence() -> None:
    model = runs()
    model = replace(model, shared=0.003 * model.effects[ARC])
    wrong, _ = with_data(model, 4, np.array([0.004, -0.003, 0.001]))
    assert wrong.log_evidence_for(ARC) < np.log(20.0)


def test_the_share_a_free_surface_explains_is_a_multiple_correlation() -> None:
    model = runs()
    z = np.random.default_rng(3).normal(size=N)
    free = {CURVE: 100.0, DIFFERENCE: 100.0, NOISE: 1.0, SCATTER: 1e-9}
    rest = z - model.X @ np.linalg.lstsq(model.X, z, rcond=None)[0]
    centred = z - z.mean()
    expected = 1.0 - rest @ rest / (centred @ centred)
    assert model.explained(z, free) == pytest.approx(expected, abs=1e-3)


def test_a_few_runs_that_fit_by_chance_are_not_called_exact() -> None:
    model, h = with_data(runs(), 8)
    assert replace(model, y=model.X @ h).choose({}).sizes[NOISE] == 0.5


def test_the_size_of_an_effect_is_the_interval_of_its_number() -> None:
    order = 0.05 * np.linspace(-0.5, 0.5, N)[:, None]  # the prior counts as much as the runs
    model = with_data(replace(runs(), effects={ORDER: order}), 3, np.array([0.02]))[0]
    found = model.choose({})
    (m,), ((v,),) = model.model().at({**found.sizes, ORDER: 1e3}).of(ORDER)  # by the runs alone
    s, prior = np.geomspace(1e-5, 0.3, 2000), refined.PRIORS[ORDER]
    density = norm.pdf(m, scale=np.sqrt(v + s**2))
    density = density * norm.pdf(np.log(s / prior.median), scale=prior.width)
    within = density @ (2.0 * norm.cdf(found.sizes[ORDER] / s) - 1.0) / density.sum()
    assert within == pytest.approx(0.6827, abs=4e-3)  # to its grid of sizes


# --- splines and their smooth coordinates ---

KNOTS = np.log(np.geomspace(300.0, 15000.0, 12))
SPEEDS = np.log([0.0025, 0.005, 0.0105, 0.042])
SPLINES = refined.Curves(KNOTS, SPEEDS)


def squares(curves: refined.Curves, values: np.ndarray) -> dict[str, float]:
    """h' h of each part of given values at the knots."""
    h, parts = np.linalg.solve(curves.B, values), curves.parts
    ends = np.cumsum([Z.shape[1] for Z in parts.values()])[:-1]
    return {part: float(x @ x) for part, x in zip(parts, np.split(h, ends), strict=True)}


def test_a_power_law_is_reproduced_between_the_knots_and_held_beyond() -> None:
    at = np.log([200.0, 300.0, 777.0, 15000.0, 40000.0])
    expected = 0.3 - 0.18 * np.clip(at, KNOTS[0], KNOTS[-1])
    np.testing.assert_allclose(SPLINES.basis(at) @ (0.3 - 0.18 * KNOTS), expected, rtol=1e-12)


def test_a_curve_that_speeds_share_costs_its_integral() -> None:
    # a natural spline through sin(pi u) on a fine grid: integral of (pi² sin(pi u))² = pi⁴/2
    u = np.linspace(0.0, 1.0, 120)
    found = squares(refined.Curves(u, SPEEDS[:1]), np.sin(np.pi * u))
    assert found["curve"] == pytest.approx(np.pi**4 / 2, rel=1e-3)
    assert "difference" not in found


def test_slopes_that_differ_cost_their_integral() -> None:
    # slopes 0, 1, 0, 0 in ln f less their mean: 1/gap over the two gaps beside it, times the range;
    # levels of the speeds and a slope of all are free
    tilted = np.arange(4.0)[:, None] - 0.1 * KNOTS
    tilted[1] += KNOTS
    gaps = np.diff(SPEEDS)
    expected = (1.0 / gaps[0] + 1.0 / gaps[1]) * (KNOTS[-1] - KNOTS[0])
    found = squares(SPLINES, tilted.ravel())
    assert found["difference"] == pytest.approx(expected, rel=1e-9)
    assert found["curve"] == pytest.approx(0.0, abs=1e-9)

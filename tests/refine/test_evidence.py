"""The choice of smoothness, against direct Gaussian computations and data of known noise."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from beltid.refine.curves import Curves
from beltid.refine.effects import ARC, BEFORE
from beltid.refine.evidence import (
    LinearModel,
    Smoothness,
    Solution,
    choose_smoothness,
    log_evidence_for,
    log_posterior,
)


def _model(rng: np.random.Generator, noise: float, wiggle: float) -> tuple[LinearModel, np.ndarray]:
    curves = Curves(np.linspace(0.0, 3.0, 10), np.array([0.0, 1.0]))
    truth = np.concatenate([np.sin(wiggle * curves.log_force), np.sin(wiggle * curves.log_force)])
    J = np.zeros((80, 20))
    at = rng.uniform(0.0, 3.0, 80)
    for i, u in enumerate(at):
        j = i % 2
        J[i, 10 * j : 10 * j + 10] = curves.basis(np.array([u]))[0]
    y = J @ truth + noise * rng.normal(size=80)
    return LinearModel(J, y, curves.bending(), curves.difference(), np.zeros(80)), truth


def test_evidence_ratio_is_that_of_the_marginal_gaussians():
    # a full-rank prior makes the marginal likelihood a plain Gaussian density
    rng = np.random.default_rng(3)
    J, y = rng.normal(size=(6, 3)), rng.normal(size=6)
    B = rng.normal(size=(3, 3))
    Z, X, response = rng.normal(size=(6, 2)), rng.normal(size=(6, 1)), rng.normal(size=6)
    before = ((-5.0, 1.0),)
    model = LinearModel(J, y, B @ B.T + np.eye(3), np.eye(3), response, (Z,), before, X)
    values = []
    for s in (
        Smoothness(0.7, 0.4, 1.3, 0.9, (0.6,), 1.0),
        Smoothness(2.0, 3.0, 0.8, 0.0, (0.0,), 0.3),
    ):
        prior = np.linalg.inv(s.bending * model.bending + s.difference * model.difference)
        V = s.noise_scale**2 * np.eye(6) + s.effects[0] ** 2 * Z @ Z.T + s.stated**2 * X @ X.T
        V += np.diag(np.square(s.scatter * response))
        direct = multivariate_normal(np.zeros(6), J @ prior @ J.T + V)
        values.append(model.log_evidence(s)[0] - direct.logpdf(y))
    assert values[0] == pytest.approx(values[1], abs=1e-7)


def _with_effects() -> tuple[LinearModel, np.ndarray]:
    """A model with an effect and stated errors, and ln of some hyperparameters."""
    rng = np.random.default_rng(0)
    curves = Curves(np.linspace(0.0, 3.0, 6), np.array([0.0, 1.0]))
    model = LinearModel(
        J=rng.normal(size=(40, 12)),
        y=2.0 * rng.normal(size=40),
        bending=curves.bending(),
        difference=curves.difference(),
        response=300.0 * rng.normal(size=40),
        effects=(100.0 * rng.normal(size=(40, 3)),),
        before=((-5.0, 1.0),),
        stated=rng.normal(size=(40, 2)),
    )
    return model, np.log([1.3, 20.0, 30.0, 0.004, 0.01, 0.6])


def _smoothness(x: np.ndarray) -> Smoothness:
    scale, bending, difference, scatter, effect, stated = np.exp(x).tolist()
    return Smoothness(bending, difference, scale, scatter, (effect,), stated)


def test_slope_of_the_evidence_is_its_difference_quotient():
    model, x = _with_effects()
    _, slope = model.log_evidence(_smoothness(x))
    for k, step in enumerate(1e-5 * np.eye(x.size)):
        up, down = (model.log_evidence(_smoothness(at))[0] for at in (x + step, x - step))
        assert slope[k] == pytest.approx((up - down) / 2e-5, rel=1e-6)


def test_the_posterior_is_the_evidence_times_log_normal_priors():
    """Medians 1, e^5, e^7, 0.3 %, the effect's own, and 1 for the stated errors."""
    model, x = _with_effects()
    before = norm([0.0, 5.0, 7.0, math.log(0.003), -5.0, 0.0], [0.5, 1.5, 2.0, 1.5, 1.0, 1.0])
    other = x + np.array([0.2, -0.3, 0.4, -0.5, 0.6, -0.7])
    expected = [
        model.log_evidence(_smoothness(at))[0] + before.logpdf(at).sum() for at in (x, other)
    ]
    found = [log_posterior(model, _smoothness(at)) for at in (x, other)]
    assert found[1] - found[0] == pytest.approx(expected[1] - expected[0], abs=1e-9)


def test_an_effect_that_another_one_can_replace_has_no_evidence():
    rng = np.random.default_rng(2)
    model, _ = _with_effects()
    Z = 1000.0 * rng.normal(size=(40, 1))
    data = rng.normal(size=40) + 0.02 * Z[:, 0]
    alone = replace(model, y=data, effects=(Z,), before=((-5.0, 1.0),))
    twice = replace(alone, effects=(Z, Z), before=((-5.0, 1.0),) * 2)
    start = Smoothness(10.0, 10.0, 1.0)
    found = choose_smoothness(twice, start)
    assert log_evidence_for(alone, choose_smoothness(alone, start), [0]) > 20.0
    assert abs(log_evidence_for(twice, found, [0])) < 1.0
    assert log_evidence_for(twice, found, [0, 1]) > 20.0


def test_the_share_a_free_surface_explains_is_a_multiple_correlation():
    model, x = _with_effects()
    free = _smoothness(np.concatenate([x[:1], [-20.0, -20.0], x[3:]]))
    Z = np.column_stack([model.effects[0], model.J @ np.arange(12.0)])
    # weighted least squares: what is left over what there was beside the level
    root = np.sqrt(model.variance(free))[:, None]
    whole, J = Z / root, model.J / root
    level = J.sum(axis=1, keepdims=True)
    whole = whole - level @ np.linalg.lstsq(level, whole, rcond=None)[0]
    left = whole - J @ np.linalg.lstsq(J, whole, rcond=None)[0]
    expected = 1.0 - np.sum(left**2, axis=0) / np.sum(whole**2, axis=0)
    assert expected[-1] == pytest.approx(1.0)
    np.testing.assert_allclose(model.explained_by_surface(free, Z), expected, rtol=1e-4)
    # a stiff surface explains less
    assert np.all(model.explained_by_surface(_smoothness(x), Z) < expected)


def test_evidence_over_the_size_of_one_effect_is_that_of_the_whole_model():
    model, x = _with_effects()
    sizes = np.array([0.0, 0.001, 0.02, 0.3])
    quick = model.log_evidence_by_size(_smoothness(x), 0, sizes)
    chosen = [replace(_smoothness(x), effects=(size,)) for size in sizes]
    whole = np.array([model.log_evidence(one)[0] for one in chosen])
    np.testing.assert_allclose(quick - quick[0], whole - whole[0], rtol=1e-6)


@pytest.mark.parametrize("noise", [0.7, 1.0, 3.0])
def test_noise_is_found(noise):
    found = []
    for seed in range(12):
        model, _ = _model(np.random.default_rng(seed), noise, wiggle=0.4)
        found.append(choose_smoothness(model, Smoothness(1.0, 1.0, 1.0)).noise_scale)
    # 80 data, about six parameters: the mean of twelve estimates scatters by 2.5 %
    assert np.mean(found) == pytest.approx(noise, rel=0.08)


def test_rough_data_get_more_parameters_than_smooth_ones():
    counts = []
    for wiggle in (0.3, 4.0):
        model, _ = _model(np.random.default_rng(1), 0.02, wiggle)
        # the standard error that is stated is that of the data
        model = replace(model, J=model.J / 0.02, y=model.y / 0.02)
        chosen = choose_smoothness(model, Smoothness(1.0, 1.0, 1.0))
        counts.append(model.effective_parameters(chosen))
    assert counts[1] > counts[0] + 3.0


def test_errors_of_the_solution_cover_the_truth():
    inside = []
    for seed in range(40):
        model, truth = _model(np.random.default_rng(100 + seed), 1.0, wiggle=1.0)
        # in the size of ln mu: it bends by 0.1 per (ln f)², known to a tenth
        model, truth = replace(model, J=10.0 * model.J), 0.1 * truth
        chosen = choose_smoothness(model, Smoothness(1.0, 1.0, 1.0))
        found = model.solve(chosen)
        size = 1.96 * np.sqrt(np.diag(found.covariance))
        inside.append(np.abs(found.parameters - truth) < size)
    assert 0.90 <= np.mean(inside) <= 0.995


def test_curvature_that_the_noise_hides_is_not_ruled_out():
    # the forces and noise of a campaign: ln mu bends by 0.05 per (ln f)², too little to be seen in
    # most draws; without a prior of the smoothness three quarters of the intervals held the truth
    curves = Curves(np.linspace(6.0, 9.6, 12), np.array([0.0]))
    truth = 0.025 * np.square(curves.log_force - 7.8)
    inside = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        J = curves.basis(rng.uniform(6.8, 9.0, 24)) / 0.005
        y = J @ truth + rng.normal(size=24)
        model = LinearModel(J, y, curves.bending(), curves.difference(), np.zeros(24))
        found = model.solve(choose_smoothness(model, Smoothness(1.0, 1.0, 1.0)))
        size = 1.96 * np.sqrt(np.diag(found.covariance))
        inside.append((np.abs(found.parameters - truth) < size)[3:10])
    assert 0.90 <= np.mean(inside) <= 0.99


def test_effects_of_arcs_are_solved_for_and_merit_is_that_of_the_marginal_gaussian():
    # eliminated by hand: V = s² + s_a² Z Z', p = (J'V⁻¹J + P)⁻¹ J'V⁻¹y, u = s_a² Z'V⁻¹(y - Jp)
    rng = np.random.default_rng(8)
    J, y, Z = rng.normal(size=(9, 3)), rng.normal(size=9), rng.normal(size=(9, 2))
    response = rng.normal(size=9)
    model = LinearModel(J, y, 2.0 * np.eye(3), np.eye(3), response, (Z,), ((-5.0, 1.0),))
    chosen = Smoothness(0.7, 0.4, 1.3, 0.5, (0.6,))
    noise = np.diag(1.3**2 + np.square(0.5 * response))
    P, W = 1.8 * np.eye(3), np.linalg.inv(noise + 0.6**2 * Z @ Z.T)
    covariance = np.linalg.inv(J.T @ W @ J + P)
    found = model.solve(chosen)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-7)
    np.testing.assert_allclose(found.gain, covariance @ J.T @ W, rtol=1e-7)
    p = covariance @ J.T @ W @ y
    np.testing.assert_allclose(found.parameters, p, rtol=1e-7)
    np.testing.assert_allclose(found.effects, 0.6**2 * Z.T @ W @ (y - J @ p), rtol=1e-7)
    np.testing.assert_allclose(found.effects_gain @ y, found.effects, rtol=1e-9)
    np.testing.assert_allclose(
        model.residual(found), y - J @ p - Z @ found.effects, rtol=1e-7, atol=1e-12
    )
    # what of the effects is left unknown: s_a² less what the runs show of it, the surface unknown
    Q = W - W @ J @ covariance @ J.T @ W
    left = 0.36 * np.eye(2) - 0.36**2 * Z.T @ Q @ Z
    np.testing.assert_allclose(found.effects_covariance, left, rtol=1e-7)
    r = rng.normal(size=9)
    of_noise = r @ np.linalg.solve(noise, r)
    assert model.misfit(r, p, chosen) == pytest.approx(of_noise + p @ P @ p, rel=1e-10)


@pytest.mark.parametrize("share", [1.0, 0.3])
def test_the_surface_follows_the_effects_that_stated_errors_do_not_explain(share):
    # effects: generalised least squares with the stated errors marginalised; then the surface from
    # what they leave; its covariance from 40,000 drawn campaigns of the same priors, that of the
    # numbers with the errors as large as stated, however little of them the runs show
    rng = np.random.default_rng(9)
    J, Z, X = rng.normal(size=(9, 3)), rng.normal(size=(9, 2)), 3.0 * rng.normal(size=(9, 1))
    y, s_u, P = rng.normal(size=9), 0.6, 1.8 * np.eye(3)
    model = LinearModel(
        J, y, 2.0 * np.eye(3), np.eye(3), np.zeros(9), (Z,), ((-5.0, 1.0),), stated=X
    )
    chosen = Smoothness(0.7, 0.4, 1.3, 0.0, (s_u,), stated=share)
    found = model.solve_surface(chosen)
    V = 1.69 * np.eye(9) + s_u**2 * Z @ Z.T + share**2 * X @ X.T + J @ np.linalg.inv(P) @ J.T
    of_effects = s_u**2 * Z.T @ np.linalg.inv(V)
    np.testing.assert_allclose(found.effects, of_effects @ y, rtol=1e-7)
    alone = np.linalg.solve(J.T @ J / 1.69 + P, J.T / 1.69)
    np.testing.assert_allclose(found.gain, alone @ (np.eye(9) - Z @ of_effects), rtol=1e-7)
    np.testing.assert_allclose(found.gain @ J, np.eye(3) - found.pull @ P, atol=1e-8)
    p = rng.normal(size=(40_000, 3)) @ np.linalg.cholesky(np.linalg.inv(P)).T
    u, e = s_u * rng.normal(size=(40_000, 2)), rng.normal(size=(40_000, 1))
    drawn = p @ J.T + u @ Z.T + 1.3 * rng.normal(size=(40_000, 9))
    scatter = np.cov((drawn @ found.gain.T - p).T)
    np.testing.assert_allclose(np.diag(found.covariance), np.diag(scatter), rtol=0.03)
    all_drawn, numbers = drawn + e @ X.T, np.column_stack([u, e])
    missed = np.cov((all_drawn @ model.solve(chosen).effects_gain.T - numbers).T)
    for one in (found.effects_covariance, model.solve(chosen).effects_covariance):
        np.testing.assert_allclose(np.diag(one), np.diag(missed)[: len(one)], rtol=0.04)
    by_effects = np.trace(of_effects @ Z) + np.trace(found.gain @ J)
    assert model.effective_parameters(chosen) == pytest.approx(by_effects, rel=1e-7)


@pytest.mark.parametrize("spread", [0.002, pytest.param(0.03, marks=pytest.mark.long)])
def test_differences_of_arcs_are_found_and_their_mean_stays_unknown(spread):
    # level of the surface: the mean of a few effects is never seen; with four arcs in each of many
    # campaigns its error has the standard deviation spread / 2
    curves = Curves(np.linspace(6.0, 9.0, 6), np.array([0.0]))
    inside, size = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        arc = np.arange(80) % 4
        effect = spread * rng.normal(size=4)
        J = curves.basis(rng.uniform(6.2, 8.8, 80)) / 0.003
        Z = np.eye(4)[arc] / 0.003
        y = J @ np.full(6, 0.2) + Z @ effect + rng.normal(size=80)
        before = (BEFORE[ARC],)
        nothing = np.zeros(80)
        model = LinearModel(J, y, curves.bending(), curves.difference(), nothing, (Z,), before)
        chosen = choose_smoothness(model, Smoothness(1.0, 0.0, 1.0))
        found = model.solve(chosen)
        error = found.parameters - 0.2
        inside.append(np.abs(error) < 1.96 * np.sqrt(np.diag(found.covariance)))
        size.append(chosen.effects[0])
        between = (found.effects - found.effects.mean()) - (effect - effect.mean())
        assert np.abs(between).max() < 4.0 * 0.003 / np.sqrt(20.0)
    assert 0.88 <= np.mean(inside) <= 0.99
    # three degrees of freedom: the mean of s_a² is up to 3 / (3 - 2) times what the arcs show
    assert 0.8 * spread < np.median(size) < 1.8 * spread


def _arcs_set_wrongly(seed: int, sigma: float) -> LinearModel:
    """A level of 0.2 seen at four arcs, each with an error of a stated size and no effect else."""
    rng = np.random.default_rng(seed)
    curves = Curves(np.linspace(6.0, 9.0, 6), np.array([0.0]))
    arc = np.eye(4)[np.arange(80) % 4]
    J = curves.basis(rng.uniform(6.2, 8.8, 80))
    y = J @ np.full(6, 0.2) + sigma * arc @ rng.normal(size=4) + 0.003 * rng.normal(size=80)
    Z, roughness = arc / 0.003, (curves.bending(), curves.difference())
    return LinearModel(
        J / 0.003, y / 0.003, *roughness, np.zeros(80), (Z,), (BEFORE[ARC],), sigma * Z
    )


@pytest.mark.long
def test_a_stated_error_of_the_arcs_is_not_counted_once_more_as_their_effect():
    # the mean of the four errors is never seen: the level has the standard deviation sigma / 2;
    # counted twice, as stated and as an effect of the same size, it would be sqrt(2) of that
    sigma, twice = 0.01, math.sqrt(2.0) * 0.01 / 2.0
    z, stated_u, blind_u, sizes = [], [], [], []
    for seed in range(30):
        whole = _arcs_set_wrongly(seed, sigma)
        chosen = choose_smoothness(whole, Smoothness(1.0, 0.0, 1.0))
        blind = replace(whole, stated=None)
        of_blind = choose_smoothness(blind, Smoothness(1.0, 0.0, 1.0))
        (level, u), (_, u_blind) = (
            _level(whole, found)
            for found in (whole.solve_surface(chosen), blind.solve_surface(of_blind))
        )
        z.append((level - 0.2) / u)
        stated_u.append(u)
        blind_u.append(u_blind)
        sizes.append(chosen.effects[0])
    # below sigma the errors hide any effect: what the prior allows there is left, and no more
    assert np.median(sizes) < sigma
    assert 0.95 * sigma / 2.0 < min(stated_u)
    assert np.median(stated_u) < twice < np.median(blind_u)
    assert np.mean(np.abs(z) < 1.96) >= 0.90


def _thirty_errors(errors: np.ndarray, seed: int) -> LinearModel:
    """The four arcs with errors of 1 % among 34, each far larger as stated than the noise."""
    rng, sigma, noise = np.random.default_rng(seed), 0.01, 0.001
    curves = Curves(np.linspace(6.0, 9.0, 6), np.array([0.0]))
    arc, others = np.eye(4)[np.arange(120) % 4], rng.normal(size=(120, 30))
    J, X = curves.basis(rng.uniform(6.2, 8.8, 120)), sigma * np.column_stack([arc, others])
    y = J @ np.full(6, 0.2) + X @ errors + noise * rng.normal(size=120)
    roughness = curves.bending(), curves.difference()
    Z, before = (arc / noise,), (BEFORE[ARC],)
    return LinearModel(J / noise, y / noise, *roughness, np.zeros(120), Z, before, X / noise)


@pytest.mark.parametrize(("there", "found"), [(0.1, 0.1), (0.5, 0.5), (3.0, 1.0)])
def test_the_share_of_the_stated_errors_that_is_there_is_found_but_none_beyond(there, found):
    # 34 errors tell their size within a factor of 1 ± 12 %
    errors = there * np.random.default_rng(1).normal(size=34)
    model = _thirty_errors(errors, 2)
    share = choose_smoothness(model, Smoothness(1.0, 0.0, 1.0)).stated
    expected = min(found, float(np.sqrt(np.mean(errors**2))))
    assert share == pytest.approx(expected, rel=0.25)


def test_an_error_within_its_statement_is_no_effect_even_where_no_other_error_is_there():
    errors = np.concatenate([[1.0, -1.5, 0.5, 1.2], np.zeros(30)])
    model = _thirty_errors(errors, 3)
    found = choose_smoothness(model, Smoothness(1.0, 0.0, 1.0))
    assert found.stated < 0.5
    assert log_evidence_for(model, found, [0]) < 1.0
    number = model.solve(found).effects[:4]
    u = np.sqrt(np.diag(model.solve(found).effects_covariance)[:4])
    assert np.all(np.abs(number - number.mean()) < 2.0 * u)


def _level(whole: LinearModel, found: Solution) -> tuple[float, float]:
    """The level of the surface and its uncertainty by scatter, effects and the stated errors."""
    mean = np.full(6, 1 / 6)
    stated = found.gain @ whole.stated
    variance = mean @ (found.covariance + stated @ stated.T) @ mean
    return float(mean @ found.parameters), float(np.sqrt(variance))

"""Linear uncertainties of both surfaces: against new fits, dimensions, truth, and Monte Carlo."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from repetitions import repetition
from virtual_bench import GIVEN, SMALL, read_campaign

from beltid.errors import ConvergenceError
from beltid.identify.surface.average import average
from beltid.identify.surface.curves import Points, build_curves
from beltid.uncertainty.monte_carlo import (
    gathered,
    linear_check,
    prepare,
    refined_again,
    replicates,
)
from beltid.uncertainty.published import (
    changes_at_nodes,
    published_changes,
    published_curves,
    published_grid,
    scatter_factor,
)
from beltid.uncertainty.refined import (
    INPUTS,
    Refined,
    changes_and_scatter,
    parameter_changes,
    refined_campaign,
)
from beltid.uncertainty.sources import Errors, all_sources, rig_sources


@pytest.fixture(scope="module")
def nominal():
    campaign = read_campaign(SMALL, np.random.default_rng(4))
    sources = all_sources(GIVEN, len(SMALL.arcs_deg), law_scatter=False)
    found = refined_campaign(campaign, SMALL.speeds, sources)
    linear = (found.sources, found.slopes)
    return prepare(found.campaign, found.refined, SMALL.speeds, linear)


def test_slopes_obey_the_dimensions(nominal):
    # scaled forces (T0, EI, EA and both stiffnesses) with a surface scaled along the force change
    # nothing; neither do scaled lengths
    slope = dict(zip(INPUTS, nominal.slopes.T, strict=True))
    curves, refined = nominal.refined.curves, nominal.refined
    step = 1e-5
    basis = (curves.basis(curves.log_force + step) - curves.basis(curves.log_force - step)) / (
        2 * step
    )
    inner = np.ones(curves.log_force.size)
    inner[[0, -1]] = 2.0  # one-sided there: the nearest value holds beyond
    slopes = (inner[:, None] * basis) @ refined.parameters.reshape(curves.log_speed.size, -1).T
    shift = -refined.J @ slopes.T.ravel()
    forces = slope["initial tension"] + slope["EI"] + slope["EA"]
    forces = forces + slope["k_linear"] + slope["k_quadratic"] + shift
    lengths = slope["radius"] + slope["span"] + 2.0 * slope["EI"]
    lengths = lengths - 2.0 * slope["k_linear"] - 3.0 * slope["k_quadratic"] - shift
    assert np.max(np.abs(forces)) < 0.02
    assert np.max(np.abs(lengths)) < 0.03


def test_the_refined_surface_follows_an_error_as_a_new_solution_does(nominal):
    # knots and smoothness as they are, the rig laid on and simulated anew until it converges
    campaign, refined = nominal.campaign, nominal.refined
    nothing = np.zeros(campaign.measured.mu.size), np.zeros(refined.parameters.size)
    for source in nominal.sources:
        change = parameter_changes(campaign, refined, [source], nominal.slopes)[:, 0]
        errors = Errors.single(source)
        again = refined_again(nominal, campaign.corrected(errors), errors, nothing)
        found, expected = (refined.J @ x for x in (again - refined.parameters, change))
        np.testing.assert_allclose(found, expected, atol=0.1 * np.abs(expected).max() + 1e-5)


def test_the_published_surface_follows_an_error_as_the_procedure_does(nominal):
    measured, grid = nominal.campaign.measured, nominal.published
    sources = rig_sources(GIVEN, 2)
    changes = published_changes(measured, grid, sources)
    both = changes[..., [s.error == "tension_gain" for s in sources]][..., 0]
    # a gain of both cells moves the forces alone: mu changes by the slope along the force
    by_f, _ = grid.to_surface().gradient(grid.normal_force_N_m[:, None], grid.slip_speed_m_s)
    expected = -by_f * grid.normal_force_N_m[:, None] / grid.mu * GIVEN.tension_gain
    np.testing.assert_allclose(both, expected, atol=1e-5)
    other = published_grid(measured.corrected(Errors.single(sources[0])))
    np.testing.assert_allclose(changes_at_nodes(grid, other), both, atol=1e-12)


def test_scatter_of_the_published_surface_has_the_standard_errors_of_its_nodes(nominal):
    grid = nominal.published
    curves = published_curves(nominal.campaign.measured)
    factor = scatter_factor(curves, grid)
    np.testing.assert_allclose(np.sqrt(np.sum(factor**2, axis=-1)), grid.mu_se / grid.mu, rtol=1e-6)


def test_runs_without_scatter_have_no_factor_and_a_single_run_has_its_own_error(nominal):
    measured = nominal.campaign.measured
    sure = replace(measured, mu_se=0.0 * measured.mu)
    curves, grid = published_curves(sure), published_grid(sure)
    assert scatter_factor(curves, grid, arcs=False).shape == (*grid.mu.shape, 0)
    # one arc and one tension: the error of a node is that of its run
    second = SMALL.tensions_N[1]
    kept = (measured.arc == 0) & (second == measured.T_0)
    names = ("arc", "beta", "T_0", "omega", "tight", "slack", "mu", "mu_se")
    one = replace(measured, **{name: getattr(measured, name)[kept] for name in names})
    curves, grid = published_curves(one), published_grid(one)
    factor = scatter_factor(curves, grid, arcs=False)
    np.testing.assert_allclose(np.sqrt(np.sum(factor**2, axis=-1)), SMALL.noise, rtol=1e-6)


def test_scatter_at_a_speed_is_that_of_its_own_runs_where_another_speed_is_left_out():
    v = np.repeat([0.01, 0.02, 0.04], [4, 1, 4])
    f = np.array([1e3, 2e3, 3e3, 4e3, 2e3, 1e3, 2e3, 3e3, 4e3])
    curves = build_curves(Points(np.full(9, 40.0), f, v, np.ones(9), 0.01 * v / v[-1]))
    grid, notes = average(curves, errors_known=True)
    assert "speed 0.02 m/s left out" in notes[0]
    factor = scatter_factor(curves, grid, arcs=False)
    assert np.sum(factor**2, axis=2) == pytest.approx((grid.mu_se / grid.mu) ** 2, rel=1e-9)


def test_a_replicate_that_does_not_converge_says_so(nominal, monkeypatch):
    monkeypatch.setattr("beltid.uncertainty.monte_carlo.MOST_ITERATIONS", 1)
    monkeypatch.setattr("beltid.uncertainty.monte_carlo.TOLERANCE", 0.0)
    nothing = np.zeros(nominal.campaign.measured.mu.size), np.zeros(nominal.refined.parameters.size)
    with pytest.raises(ConvergenceError, match="did not converge in 1 iterations"):
        refined_again(nominal, nominal.campaign, Errors(), nothing)


def test_without_sources_nothing_is_shared(nominal):
    found = parameter_changes(nominal.campaign, nominal.refined, [], nominal.slopes)
    assert found.shape == (nominal.refined.parameters.size, 0)


def test_errors_of_several_places_may_come_in_any_order():
    sources = rig_sources(GIVEN, 3)
    errors = Errors.drawn(sources[::-1], np.ones(len(sources)))
    assert [errors.at("arc_setting", k) for k in range(3)] == [GIVEN.arc_setting] * 3
    assert errors.at("arc_setting", 3) == 0.0


def test_replicates_depend_on_seed_and_number_only(nominal):
    together = replicates(nominal, 11, range(2))
    apart = gathered([replicates(nominal, 11, [k]) for k in range(2)])
    np.testing.assert_array_equal(together.refined, apart.refined)
    np.testing.assert_array_equal(together.published, apart.published)
    other = replicates(nominal, 12, [0])
    assert np.any(other.refined[0] != together.refined[0])


def test_monte_carlo_agrees_where_the_errors_are_small(nominal):
    draws = 30
    found = replicates(nominal, 1, range(draws))
    assert not found.failed
    whole = Refined(nominal.refined, nominal.campaign, nominal.sources, nominal.slopes)
    parts = changes_and_scatter(whole)
    linear = np.sqrt(sum(np.sum(part**2, axis=-1) for part in parts))
    check = linear_check(found.refined.reshape(draws, -1), linear.ravel())
    # 30 draws give a standard deviation to 13 %; nodes move together
    assert np.sqrt(np.mean(check.found**2)) == pytest.approx(np.sqrt(np.mean(linear**2)), rel=0.25)
    assert not check.too_far.any()


def test_a_check_finds_what_is_not_linear():
    z = np.random.default_rng(0).standard_normal(500)
    draws = np.stack([0.01 * z, 0.013 * z, np.expm1(0.6 * z) * 0.01, 0.0 * z], axis=1)
    check = linear_check(draws, np.array([0.01, 0.01, 0.006, 0.0]))
    assert check.too_far.tolist() == [False, True, True, False]
    assert check.lopsided.tolist() == [False, False, True, False]
    row = check.row("all", np.ones(4, dtype=bool))
    assert row["linear_fails"] == 2
    assert row["largest_asymmetry"] > 2.0
    assert check.row("none", np.zeros(4, dtype=bool)) == {
        "group": "none",
        "values": 0,
        "linear_fails": 0,
    }


@pytest.mark.long
def test_intervals_of_the_refined_surface_hold_the_truth():
    # 10 campaigns, errors of the bench drawn anew for each; benchmarks/coverage.py draws many
    found = [repetition(replace(SMALL, noise=0.002), 50 + seed) for seed in range(10)]
    z = np.array([r.error / r.combined for r in found])
    assert 0.88 <= np.mean(np.abs(z) < 1.96) <= 1.0
    assert 0.6 < np.sqrt(np.mean(z**2)) < 1.35
    # the scatter alone, as if many runs averaged the bench's errors away, does not hold it
    alone = np.array([r.error / r.scatter for r in found])
    assert np.mean(np.abs(alone) < 1.96) < 0.8

"""Linear uncertainties of both surfaces: against new fits, dimensions and truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from virtual_bench import GIVEN, NO_ERRORS, SMALL, read_campaign, repetition

from beltid.identify.surface.average import average
from beltid.identify.surface.curves import Points, build_curves
from beltid.refine.inverse import refine_surface
from beltid.uncertainty.published import (
    changes_at_nodes,
    published_changes,
    published_curves,
    published_grid,
    scatter_factor,
)
from beltid.uncertainty.rig_runs import INPUTS, RigRuns, mesh_of
from beltid.uncertainty.sources import Errors, all_sources, reduction_sources, rig_sources


@pytest.fixture(scope="module")
def nominal():
    campaign = read_campaign(SMALL, np.random.default_rng(4))
    sources = all_sources(GIVEN, len(SMALL.arcs_deg), law_scatter=False)
    return refine_surface(campaign, SMALL.speeds, sources)


def test_slopes_obey_the_dimensions(nominal):
    # scaled forces (T0, EI, EA and both stiffnesses) with a surface scaled along the force change
    # nothing; neither do scaled lengths
    slope = dict(zip(INPUTS, nominal.slopes.T, strict=True))
    curves, refined = nominal.curves, nominal
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


def solved_again(nominal, campaign):
    """Chord steps with knots and smoothness as they are; the rig is laid on anew."""
    refined = nominal

    def difference(of, parameters):
        points = of.measured.points
        rig = RigRuns(of.bench, points, SMALL.speeds, mesh_of(of.bench, points, 1.0))
        simulated = rig.log_mu(refined.curves.surfaces(parameters), refined.speed_slope)
        return np.log(of.measured.mu) - simulated

    start = difference(nominal.campaign, refined.parameters)
    moved = np.zeros(refined.parameters.size)
    for _ in range(8):
        change = difference(campaign, refined.parameters + moved) - start
        # stationary: the data pull as the roughness holds, gain (change + J moved) = moved
        step = refined.gain @ (change + refined.J @ moved) - moved
        moved = moved + step
        if np.abs(refined.J @ step).max() < 2e-4:
            return moved
    raise AssertionError("no convergence")


def test_the_refined_surface_follows_an_error_as_a_new_solution_does(nominal):
    for source, change in zip(nominal.sources, nominal.changes.T, strict=True):
        again = solved_again(nominal, nominal.campaign.corrected(Errors.single(source)))
        found, expected = nominal.J @ again, nominal.J @ change
        np.testing.assert_allclose(found, expected, atol=0.1 * np.abs(expected).max() + 1e-5)


def test_a_surface_follows_a_common_error_exactly_whatever_the_noise():
    campaign = read_campaign(replace(SMALL, given=NO_ERRORS), np.random.default_rng(2))
    response = refine_surface(campaign, SMALL.speeds).response
    for times in (1.0, 0.1):  # of the stated standard errors
        measured = replace(campaign.measured, mu_se=times * campaign.measured.mu_se)
        # a factor of 0.5 % on the surface
        measured = measured.with_columns("shared_cells", 0.005 * response[:, None])
        sources = reduction_sources(measured.columns)
        found = refine_surface(replace(campaign, measured=measured), SMALL.speeds, sources)
        np.testing.assert_allclose(found.uncertainty.changes[..., 0], 0.005, rtol=0.02)


def test_the_published_surface_follows_an_error_as_the_procedure_does(nominal):
    measured = nominal.campaign.measured
    grid = published_grid(measured)
    sources = rig_sources(GIVEN, 2)
    changes = published_changes(measured, grid, sources)
    both = changes[..., [s.error == "tension_gain" for s in sources]][..., 0]
    # a gain of both cells moves the forces alone: mu changes by the slope along the force
    by_f, _ = grid.to_surface().gradient(grid.normal_force_N_m[:, None], grid.slip_speed_m_s)
    expected = -by_f * grid.normal_force_N_m[:, None] / grid.mu * GIVEN["tension_gain"]
    np.testing.assert_allclose(both, expected, atol=1e-5)
    other = published_grid(measured.corrected(Errors.single(sources[0])))
    np.testing.assert_allclose(changes_at_nodes(grid, other), both, atol=1e-12)


def test_scatter_of_the_published_surface_has_the_standard_errors_of_its_nodes(nominal):
    measured = nominal.campaign.measured
    grid, curves = published_grid(measured), published_curves(measured)
    factor = scatter_factor(curves, grid)
    np.testing.assert_allclose(np.sqrt(np.sum(factor**2, axis=-1)), grid.mu_se / grid.mu, rtol=1e-6)


def test_a_single_run_has_its_own_error(nominal):
    measured = nominal.campaign.measured
    # one arc and one tension: the error of a node is that of its run
    second = SMALL.tensions_N[1]
    kept = (measured.arc == 0) & (second == measured.T_0)
    names = ("arc", "beta", "T_0", "omega", "tight", "slack", "mu", "mu_se")
    one = replace(measured, **{name: getattr(measured, name)[kept] for name in names})
    curves, grid = published_curves(one), published_grid(one)
    factor = scatter_factor(curves, grid)
    np.testing.assert_allclose(np.sqrt(np.sum(factor**2, axis=-1)), SMALL.noise, rtol=1e-6)


def test_scatter_at_a_speed_is_that_of_its_own_runs_where_another_speed_is_left_out():
    v = np.repeat([0.01, 0.02, 0.04], [4, 1, 4])
    f = np.array([1e3, 2e3, 3e3, 4e3, 2e3, 1e3, 2e3, 3e3, 4e3])
    curves = build_curves(Points(np.full(9, 40.0), f, v, np.ones(9), 0.01 * v / v[-1]))
    grid, notes = average(curves, errors_known=True)
    assert "speed 0.02 m/s left out" in notes[0]
    factor = scatter_factor(curves, grid)
    assert np.sum(factor**2, axis=2) == pytest.approx((grid.mu_se / grid.mu) ** 2, rel=1e-9)


def test_between_nodes_a_surface_is_no_better_known_than_its_neighbours(nominal):
    measured = nominal.campaign.measured
    grid = published_grid(measured)
    surface = grid.to_surface().with_covariance(scatter_factor(published_curves(measured), grid))
    f, v = (np.sqrt(x[1:] * x[:-1]) for x in (grid.normal_force_N_m, grid.slip_speed_m_s))
    relative = surface.mu_u(f[:, None], v) / surface.mu(f[:, None], v)
    nodes = grid.mu_se / grid.mu
    least = np.minimum(np.minimum(nodes[1:, 1:], nodes[:-1, 1:]), nodes[1:, :-1])
    assert np.all(relative >= np.minimum(least, nodes[:-1, :-1]) * (1.0 - 1e-12))
    at_nodes = surface.mu_u(grid.normal_force_N_m[:, None], grid.slip_speed_m_s)
    np.testing.assert_allclose(at_nodes, grid.mu_se, rtol=1e-6)


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


@pytest.mark.long
def test_a_common_error_is_covered_and_its_scatter_alone_does_not():
    design = replace(SMALL, given=NO_ERRORS, noise=0.001, shared=0.01)
    found = [repetition(design, 200 + seed) for seed in range(12)]
    z = np.array([r.error / r.combined for r in found])
    assert 0.88 <= np.mean(np.abs(z) < 1.96) <= 1.0
    assert 0.6 < np.sqrt(np.mean(z**2)) < 1.3
    alone = np.array([r.error / r.scatter for r in found])
    assert np.mean(np.abs(alone) < 1.96) < 0.5

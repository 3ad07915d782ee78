"""Linear uncertainties of both surfaces: against new fits, dimensions and truth."""

from dataclasses import replace

import numpy as np
import pytest
from virtual_bench import GIVEN, SMALL, read_campaign

from beltid.refine.inverse import Problem
from beltid.uncertainty.measured import changes_at_nodes, published_grid, published_uncertainty
from beltid.uncertainty.simulated import INPUTS, MESH, RigRuns, residual_changes
from beltid.uncertainty.sources import SURFACE, Errors, stated_sources

SOURCES = stated_sources(GIVEN, SURFACE, len(SMALL.settings[0]))


@pytest.fixture(scope="module")
def campaign():
    return read_campaign(SMALL, np.random.default_rng(4))


@pytest.fixture(scope="module")
def slopes(campaign):
    """Derivatives of the runs by knots, inputs and speed, about the published surface."""
    rig = RigRuns(campaign, SMALL.speeds, MESH)
    start = Problem(rig, campaign.bench.surface, campaign.measured, None)
    surfaces = start.curves.surfaces(start.curves.B @ start.at)
    at = surfaces, SMALL.speeds, start.done.speed_slope
    return start, surfaces, *residual_changes(campaign, SOURCES, *at)


def test_slopes_obey_the_dimensions(slopes):
    # scaled forces (T0, EI, EA and both stiffnesses) with a surface scaled along the force change
    # nothing; neither do scaled lengths
    start, _, _, by_input = slopes
    curves = start.curves
    slope, step = dict(zip(INPUTS, by_input.T, strict=True)), 1e-5
    basis = curves.basis(curves.log_force + step) - curves.basis(curves.log_force - step)
    inner = np.ones(curves.log_force.size)
    inner[[0, -1]] = 2.0  # one-sided there: the nearest value holds beyond
    values = (curves.B @ start.at).reshape(SMALL.speeds.size, -1)
    along = (inner[:, None] * basis / (2 * step)) @ values.T
    shift = -start.done.J @ along.T.ravel()
    forces = slope["initial tension"] + slope["EI"] + slope["EA"]
    forces = forces + slope["k_linear"] + slope["k_quadratic"] + shift
    lengths = slope["radius"] + slope["span"] + 2.0 * slope["EI"]
    lengths = lengths - 2.0 * slope["k_linear"] - 3.0 * slope["k_quadratic"] - shift
    assert np.max(np.abs(forces)) < 0.02
    assert np.max(np.abs(lengths)) < 0.03


def test_an_error_changes_the_runs_as_the_bench_simulated_anew_does(campaign, slopes):
    start, surfaces, expected, _ = slopes

    def difference(errors):
        after = campaign.measured.corrected(errors)
        of = replace(campaign, measured=after)
        rig = RigRuns(of, SMALL.speeds, 1.0, campaign.inputs(after, errors))
        return np.log(after.mu) - rig.log_mu(surfaces, start.done.speed_slope)

    before = difference(Errors())
    for source, change in zip(SOURCES, expected.T, strict=True):
        found = difference(Errors({source.key: source.size})) - before
        np.testing.assert_allclose(found, change, atol=0.2 * np.abs(change).max() + 1e-5)


def test_the_published_surface_follows_an_error_as_the_procedure_does(campaign):
    measured = campaign.measured
    grid = published_grid(measured)
    found = published_uncertainty(measured, grid, GIVEN)
    sources, changes = found.sources, found.factor[..., : len(found.sources)]
    both = changes[..., [s.error == "tension_gain" for s in sources]][..., 0]
    # a gain of both cells moves the forces alone: mu changes by the slope along the force
    by_f, _ = grid.to_surface().gradient(grid.normal_force_N_m[:, None], grid.slip_speed_m_s)
    expected = -by_f * grid.normal_force_N_m[:, None] / grid.mu * GIVEN["tension_gain"][0]
    np.testing.assert_allclose(both, expected, atol=1e-5)
    other = published_grid(measured.corrected(Errors({sources[0].key: sources[0].size})))
    np.testing.assert_allclose(changes_at_nodes(grid, other), both, atol=1e-12)

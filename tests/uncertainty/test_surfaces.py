"""Linear uncertainties of both surfaces: against new fits, dimensions and truth."""

from dataclasses import replace

import numpy as np
import pytest
from virtual_bench import GIVEN, SMALL, read_campaign

from beltid.refine.inverse import refine_surface, sweep
from beltid.uncertainty.measured import changes_at_nodes, published_grid, published_uncertainty
from beltid.uncertainty.simulated import INPUTS, MESH, RigRuns, residual_changes
from beltid.uncertainty.sources import SURFACE, Errors, stated_sources


@pytest.fixture(scope="module")
def nominal():
    campaign = read_campaign(SMALL, np.random.default_rng(4))
    sources = stated_sources(GIVEN, SURFACE, len(SMALL.settings[0]))
    return refine_surface(campaign, SMALL.speeds, sources)


def stated(nominal):
    return [source for source, *_ in nominal.stated_errors]


@pytest.fixture(scope="module")
def slopes(nominal):
    """Derivatives of the runs by knots, inputs and speed, about the refined surface."""
    campaign, speeds = nominal.campaign, SMALL.speeds
    rig = RigRuns(campaign, speeds, MESH)
    done = sweep(rig, nominal.curves, nominal.parameters)
    surfaces = nominal.curves.surfaces(nominal.parameters)
    at = surfaces, speeds, done.speed_slope
    return done, surfaces, *residual_changes(campaign, stated(nominal), *at)


def test_slopes_obey_the_dimensions(nominal, slopes):
    # scaled forces (T0, EI, EA and both stiffnesses) with a surface scaled along the force change
    # nothing; neither do scaled lengths
    done, _, _, by_input = slopes
    curves = nominal.curves
    slope, step = dict(zip(INPUTS, by_input.T, strict=True)), 1e-5
    basis = curves.basis(curves.log_force + step) - curves.basis(curves.log_force - step)
    inner = np.ones(curves.log_force.size)
    inner[[0, -1]] = 2.0  # one-sided there: the nearest value holds beyond
    along = (inner[:, None] * basis / (2 * step)) @ nominal.parameters.reshape(
        SMALL.speeds.size, -1
    ).T
    shift = -done.J @ along.T.ravel()
    forces = slope["initial tension"] + slope["EI"] + slope["EA"]
    forces = forces + slope["k_linear"] + slope["k_quadratic"] + shift
    lengths = slope["radius"] + slope["span"] + 2.0 * slope["EI"]
    lengths = lengths - 2.0 * slope["k_linear"] - 3.0 * slope["k_quadratic"] - shift
    assert np.max(np.abs(forces)) < 0.02
    assert np.max(np.abs(lengths)) < 0.03


def test_an_error_changes_the_runs_as_the_bench_simulated_anew_does(nominal, slopes):
    done, surfaces, expected, _ = slopes

    def difference(errors):
        campaign = nominal.campaign
        after = campaign.measured.corrected(errors)
        of = replace(campaign, measured=after)
        rig = RigRuns(of, SMALL.speeds, 1.0, campaign.inputs(after, errors))
        return np.log(after.mu) - rig.log_mu(surfaces, done.speed_slope)

    before = difference(Errors())
    for source, change in zip(stated(nominal), expected.T, strict=True):
        found = difference(Errors.single(source)) - before
        np.testing.assert_allclose(found, change, atol=0.2 * np.abs(change).max() + 1e-5)


def test_the_published_surface_follows_an_error_as_the_procedure_does(nominal):
    measured = nominal.campaign.measured
    grid = published_grid(measured)
    found = published_uncertainty(measured, grid, GIVEN)
    sources, changes = found.sources, found.factor[..., : len(found.sources)]
    both = changes[..., [s.error == "tension_gain" for s in sources]][..., 0]
    # a gain of both cells moves the forces alone: mu changes by the slope along the force
    by_f, _ = grid.to_surface().gradient(grid.normal_force_N_m[:, None], grid.slip_speed_m_s)
    expected = -by_f * grid.normal_force_N_m[:, None] / grid.mu * GIVEN["tension_gain"][0]
    np.testing.assert_allclose(both, expected, atol=1e-5)
    other = published_grid(measured.corrected(Errors.single(sources[0])))
    np.testing.assert_allclose(changes_at_nodes(grid, other), both, atol=1e-12)

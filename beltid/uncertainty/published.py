"""Sensitivity of the published surface to every error: repeat the procedure.

The procedure is a chain of formulas and splines without iteration, so it is repeated with each
error corrected. Its nodes lie where the runs are and move with them; a change is taken at the moved
node and shifted back to the force and speed of the nominal node along the slope of the surface.

The scatter of the runs acts on a node through the weights of the splines along the force, followed
by the mean over the arcs. The rest of a node's standard error is the spread between arcs: an error
common to all nodes, because the same arcs are averaged at each.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from beltid.identify.surface.average import SurfaceGrid, average
from beltid.identify.surface.curves import Curve, CurveSet, Points, build_curves
from beltid.uncertainty.budget import factor_of
from beltid.uncertainty.measured import Measured
from beltid.uncertainty.sources import Errors, Source, changes_by

Array = NDArray[np.float64]


def published_curves(measured: Measured) -> CurveSet:
    """Build the curves of each arc and speed of a campaign."""
    points = Points(
        arc_deg=np.degrees(measured.beta),
        f=measured.normal_force,
        v=measured.slip_speed,
        mu=measured.mu,
        se=measured.mu_se,
    )
    return build_curves(points)


def published_grid(measured: Measured) -> SurfaceGrid:
    """Build the averaged surface of a campaign by the published procedure."""
    return average(published_curves(measured), errors_known=True)[0]


def changes_at_nodes(nominal: SurfaceGrid, other: SurfaceGrid) -> Array:
    """Return the change of ln mu at the nominal nodes (nf, nv), other minus nominal."""
    surface = nominal.to_surface()
    f, v = nominal.normal_force_N_m[:, None], nominal.slip_speed_m_s[None, :]
    if other.mu.shape != nominal.mu.shape:  # nodes were added or removed
        return np.asarray(np.log(other.to_surface().mu(f, v) / nominal.mu))
    by_f, by_v = surface.gradient(f, v)
    f_step = np.log(other.normal_force_N_m / nominal.normal_force_N_m)[:, None]
    v_step = np.log(other.slip_speed_m_s / nominal.slip_speed_m_s)[None, :]
    along = (by_f * f * f_step + by_v * v * v_step) / nominal.mu
    return np.asarray(np.log(other.mu / nominal.mu) - along)


def published_changes(measured: Measured, nominal: SurfaceGrid, sources: Sequence[Source]) -> Array:
    """Compute the change of ln mu at the nodes by one u of each source, (nf, nv, K)."""

    def repeated(errors: Errors) -> Array:
        return changes_at_nodes(nominal, published_grid(measured.corrected(errors)))

    return changes_by(sources, repeated)


def scatter_factor(curves: CurveSet, grid: SurfaceGrid) -> Array:
    """Compute a factor (nf, nv, r) of the covariance of ln mu by scatter of runs and of arcs.

    The diagonal of the covariance equals the squared standard errors of the nodes; an
    unknown standard error counts as zero.
    """
    nf, nv = grid.mu.shape
    relative = np.where(np.isfinite(grid.mu_se), grid.mu_se, 0.0) / grid.mu
    # the grid may lack speeds of the curves
    at = np.abs(np.subtract.outer(grid.slip_speed_m_s, curves.speeds)).argmin(axis=1)
    covariance, excess = np.zeros((nf, nv, nf, nv)), np.zeros((nf, nv))
    for k, speed in enumerate(at):
        by_runs = _run_covariance(curves.by_speed[speed], grid.normal_force_N_m)
        from_runs = np.sqrt(np.diag(by_runs))
        # the sum may exceed the standard error of extrapolated or constant nodes: scale it down
        shrink = np.minimum(1.0, relative[:, k] / np.where(from_runs > 0.0, from_runs, 1.0))
        covariance[:, k, :, k] = by_runs * np.outer(shrink, shrink)
        excess[:, k] = np.sqrt(np.maximum(relative[:, k] ** 2 - (from_runs * shrink) ** 2, 0.0))
    flat = covariance.reshape(nf * nv, nf * nv) + np.outer(excess, excess)
    if not np.any(flat):
        return np.zeros((nf, nv, 0))
    return factor_of(flat).reshape(nf, nv, -1)


def _run_covariance(curves: Sequence[Curve], force: Array) -> Array:
    """Return the covariance of ln mu, mean over arcs at one speed (nf, nf), by scatter of runs."""
    total = np.zeros((force.size, force.size))
    for curve in curves:
        weights = curve.weights(force)
        total += (weights * np.square(curve.se / curve.mu)) @ weights.T / len(curves) ** 2
    return total

"""How the surface of the published procedure follows every error: the procedure once more.

The procedure is a chain of formulas and splines without iteration, so that it is repeated with
each error put right. Its nodes lie where the runs are and move with them; a change is taken at a
node and brought back to the node's own force and speed along the slope of the surface.

The scatter of the runs reaches a node by the weights of the splines along the force, the mean over
the arcs follows. What the standard error of a node holds beyond that is the spread between arcs: an
error that nodes have in common, as the same arcs are averaged at all of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from beltid.identify.surface.average import SurfaceGrid, average
from beltid.identify.surface.curves import CurveSet, Points, build_curves
from beltid.identify.surface.surface import SurfaceSettings
from beltid.uncertainty.measured import Measured
from beltid.uncertainty.refined import factor_of
from beltid.uncertainty.sources import Errors, Source

Array = NDArray[np.float64]


def published_curves(measured: Measured) -> CurveSet:
    """Curves of each arc and speed of a campaign."""
    points = Points(
        arc_deg=np.degrees(measured.beta),
        f=measured.normal_force,
        v=measured.slip_speed,
        mu=measured.mu,
        se=measured.mu_se,
    )
    return build_curves(points)


def published_grid(measured: Measured, settings: SurfaceSettings) -> SurfaceGrid:
    """Averaged surface of a campaign by the published procedure."""
    curves = published_curves(measured)
    return average(curves, settings.force_nodes, errors_known=True)[0]


def changes_at_nodes(nominal: SurfaceGrid, other: SurfaceGrid) -> Array:
    """Change of ln mu at the nodes of the nominal surface (nf, nv), other less nominal."""
    surface = nominal.to_surface()
    f, v = nominal.normal_force_N_m[:, None], nominal.slip_speed_m_s[None, :]
    if other.mu.shape != nominal.mu.shape:  # nodes came or went
        moved = other.to_surface().mu(f, v)
        return np.asarray(np.log(moved / nominal.mu))
    by_f, by_v = surface.gradient(f, v)
    f_step = np.log(other.normal_force_N_m / nominal.normal_force_N_m)[:, None]
    v_step = np.log(other.slip_speed_m_s / nominal.slip_speed_m_s)[None, :]
    along = (by_f * f * f_step + by_v * v * v_step) / nominal.mu
    return np.asarray(np.log(other.mu / nominal.mu) - along)


def published_changes(
    measured: Measured, nominal: SurfaceGrid, sources: Sequence[Source], settings: SurfaceSettings
) -> Array:
    """Change of ln mu at the nodes by one standard uncertainty of each source, (nf, nv, K)."""
    columns = [
        changes_at_nodes(
            nominal, published_grid(measured.corrected(Errors.single(source)), settings)
        )
        for source in sources
    ]
    return np.stack(columns, axis=-1) if columns else np.zeros((*nominal.mu.shape, 0))


def scatter_factor(curves: CurveSet, grid: SurfaceGrid, *, arcs: bool = True) -> Array:
    """Factor (nf, nv, r) of the covariance of ln mu by the scatter of runs, and of arcs.

    With arcs its diagonal is that of the standard errors of the nodes; an unknown standard error
    counts as none.
    """
    nf, nv = grid.mu.shape
    relative = np.where(np.isfinite(grid.mu_se), grid.mu_se, 0.0) / grid.mu
    by_speed = [_of_runs(curves, grid.normal_force_N_m, k) for k in range(nv)]
    covariance = np.zeros((nf, nv, nf, nv))
    excess = np.zeros((nf, nv))
    for k, of_runs in enumerate(by_speed):
        known = np.sqrt(np.diag(of_runs))
        # carried on or held nodes may be surer by this sum than their standard error says
        shrink = np.minimum(1.0, relative[:, k] / np.where(known > 0.0, known, 1.0))
        covariance[:, k, :, k] = of_runs * np.outer(shrink, shrink)
        excess[:, k] = np.sqrt(np.maximum(relative[:, k] ** 2 - (known * shrink) ** 2, 0.0))
    flat = covariance.reshape(nf * nv, nf * nv) + arcs * np.outer(excess, excess)
    if not np.any(flat):
        return np.zeros((nf, nv, 0))
    return factor_of(flat).reshape(nf, nv, -1)


def _of_runs(curves: CurveSet, force: Array, speed: int) -> Array:
    """Covariance of ln mu of the mean over arcs at one speed (nf, nf) by the scatter of runs."""
    mine = [c for c in curves.curves if c.speed == speed]
    total = np.zeros((force.size, force.size))
    for curve in mine:
        share = np.square(curve.se / curve.mu)
        if curve.f.size == 1:
            weights = np.ones((force.size, 1))
        else:
            nodes = np.log(curve.f)
            held = np.clip(np.log(force), nodes[0], nodes[-1])
            weights = CubicSpline(nodes, np.eye(nodes.size), bc_type="natural")(held)
        total += (weights * share) @ weights.T / len(mine) ** 2
    return total

"""Sensitivity of the published surface to every error: repeat the procedure.

The procedure is a chain of formulas and splines without iteration, so it is repeated with each
error corrected. Its nodes lie where the runs are and move with them; a change is taken at the moved
node and shifted back to the force and speed of the nominal node along the slope of the surface.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from beltid.identify.surface.average import SurfaceGrid
from beltid.identify.surface.curves import Points
from beltid.identify.surface.surface import grid_through
from beltid.uncertainty.measured import Measured
from beltid.uncertainty.sources import Errors, Source, changes_by

Array = NDArray[np.float64]


def published_grid(measured: Measured) -> SurfaceGrid:
    """Build the averaged surface of a campaign by the published procedure."""
    points = Points(
        arc_deg=np.degrees(measured.beta),
        f=measured.normal_force,
        v=measured.slip_speed,
        mu=measured.mu,
        se=measured.mu_se,
    )
    return grid_through(points)[0]


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

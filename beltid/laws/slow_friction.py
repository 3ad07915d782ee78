"""Friction below the slowest measured speed: half of the trend in ln v goes on, (D14).

A belt drive mostly slides more slowly than the rig, at speeds where no bench has measured friction.
There are two limits: mu keeps its value at the slowest speed (share 0), or it continues with its
trend there (share 1). Half of the trend is the mean if the truth is equally likely anywhere between
them, and their difference over sqrt(12) the standard uncertainty. The surface itself stays as it
is: it never extrapolates, a drive does.
"""

from __future__ import annotations

import numpy as np

from beltid.laws.bicubic import SurfaceTables, hermite_patches
from beltid.laws.friction_surface import FrictionSurface

HALF_TREND = 0.5
REST = 0.01  # ratio to the slowest speed below which the trend fades: friction at rest is finite
STEEPEST = 0.5  # slope of ln mu over ln v that counts as a trend; steeper ones are scatter
PLACES = np.array([0.0, 0.01, 0.03, 0.08, 0.2, 0.45, 1.0])  # of patches, over the slowest speed


def continued(surface: FrictionSurface, share: float = HALF_TREND) -> SurfaceTables:
    """Continue a surface below its slowest speed, (D14); one with one speed, or from 0, stays.

    ``mu = mu_1 [(v/v_1 + REST)/(1 + REST)]^(share p)`` with ``p = d ln mu/d ln v`` at the slowest
    speed ``v_1``: positive, monotonic, and smooth down to rest. ``share`` is 0 to 1 [-].
    """
    tables, f, v = surface.tables(), surface.normal_force_N_m, surface.slip_speed_m_s
    if v.size == 1 or v[0] == 0.0:
        return tables
    by_f, by_v = surface.gradient(f, v[0])
    mu, mu_x = surface.mu_nodes[:, 0], by_f * (tables.f_ref + f)
    p = share * np.clip(v[0] * by_v / mu, -STEEPEST, STEEPEST)
    x, nodes = tables.x_nodes, np.stack([mu, mu_x, p])[..., None]
    if f.size == 1:  # as in bicubic.bounded_patches
        x, nodes = np.array([0.0, 1.0]), np.repeat(np.nan_to_num(nodes), 2, axis=1)
    mu, mu_x, p = nodes
    p_x = np.gradient(p, x, axis=0)
    log, log_y = np.log((PLACES + REST) / (1.0 + REST)), (PLACES + 1.0) / (PLACES + REST)
    y, z = np.log1p(PLACES), mu * np.exp(p * log)
    z_x = (mu_x / mu + p_x * log) * z
    slower = hermite_patches(x, y, z, z_x, p * log_y * z, log_y * (p_x * z + p * z_x))
    y_nodes = np.concatenate([y[:-1], tables.y_nodes])
    C = np.concatenate([slower, tables.C], axis=1)
    # read-only like those of the surface, for which the kernels are compiled
    y_nodes.flags.writeable = C.flags.writeable = False
    return tables._replace(y_nodes=y_nodes, C=C)

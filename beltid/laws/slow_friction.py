"""Friction slower than it was measured: a surface that goes on below its slowest speed, (D14).

A belt drive slides more slowly than the rig, for the most part. What friction does there no bench
has said. There are two limits: it stays what it is at the slowest speed, or it goes on with the
trend that it has there. A drive takes a stated share of the trend; half of it is the mean of a
truth that may, with equal right, lie anywhere between both limits. What was measured stays as it
is, and so does its range.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from beltid.laws.bicubic import hermite_patches
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.surface_tables import SurfaceTables

NEAREST: Final = 0.0
"""Share of the trend with which the nearest measured value holds."""
HALF_TREND: Final = 0.5
WHOLE_TREND: Final = 1.0
REST: Final = 0.01
"""Speed over the slowest one below which the trend fades out: friction at rest is finite."""
STEEPEST: Final = 0.5
"""Largest slope of ln mu over ln v that is taken for a trend and not for scatter of the nodes."""
PLACES: Final = np.array([0.0, 0.01, 0.03, 0.08, 0.2, 0.45, 1.0])
"""Speeds over the slowest one between which the continuation is a bicubic patch."""


def uncertainty_over_spread(share: float) -> float:
    """Standard uncertainty of what a share of the trend gives, over the spread of both limits.

    Root mean square deviation from a truth that is uniform between them: 1/sqrt(12) with half of
    the trend, 1/sqrt(3) at either limit.
    """
    return math.sqrt(1.0 / 12.0 + (HALF_TREND - share) ** 2)


def continued(surface: FrictionSurface, share: float) -> SurfaceTables:
    """Tables of a surface that goes on below its slowest speed, (D14).

    Parameters
    ----------
    surface : FrictionSurface
        As measured.
    share : float
        Share of the trend with which it goes on [-], 0 to 1.

    Returns
    -------
    SurfaceTables
        Those of the surface itself where nothing is slower (one speed, or a slowest speed of 0) and
        with a share of 0, for which the nearest measured value holds.

    Notes
    -----
    ``mu = mu_1 [(v/v_1 + REST)/(1 + REST)]^(share p)`` with ``p = d ln mu/d ln v`` at the slowest
    speed ``v_1``: positive, monotonic, and smooth down to rest.
    """
    tables, v = surface.tables(), surface.slip_speed_m_s
    if share == NEAREST or v.size == 1 or v[0] == 0.0:
        return tables
    x, C = tables.x_nodes, tables.C
    if x.size == 1:  # as in bicubic.patches
        x = np.array([0.0, 1.0])
    # value and slopes at the nodes along the slowest speed, where y = ln 2 and dy/d(ln v) = 1/2
    edge = C[:, 0, :, :2]
    last = np.stack([edge[-1].sum(axis=0), np.arange(4.0) @ edge[-1]])
    nodes = np.concatenate([edge[:, :2], last[None]])
    per_x = 1.0 / np.append(np.diff(x), x[-1] - x[-2])[:, None]
    per_log = 0.5 / (tables.y_nodes[1] - tables.y_nodes[0])
    mu, mu_x = nodes[:, :1, 0], nodes[:, 1:, 0] * per_x
    slope, slope_x = nodes[:, :1, 1] * per_log, nodes[:, 1:, 1] * per_log * per_x
    p, p_x = slope / mu, (slope_x - slope * mu_x / mu) / mu
    p_x = np.where(np.abs(p) < STEEPEST, share * p_x, 0.0)
    p = share * np.clip(p, -STEEPEST, STEEPEST)

    log = np.log((PLACES + REST) / (1.0 + REST))
    log_y = (PLACES + 1.0) / (PLACES + REST)  # as v/v_1 = exp(y) - 1
    z = mu * np.exp(p * log)
    z_x = (mu_x / mu + p_x * log) * z
    z_y = p * log_y * z
    z_xy = log_y * (p_x * z + p * z_x)
    y = np.array([math.log1p(place) for place in PLACES])
    slower = hermite_patches(x, y, z, z_x, z_y, z_xy)
    y_nodes, C = np.concatenate([y[:-1], tables.y_nodes]), np.concatenate([slower, C], axis=1)
    # as those of the surface: kernels are compiled for arrays that nobody can write to
    y_nodes.flags.writeable = C.flags.writeable = False
    return tables._replace(y_nodes=y_nodes, C=C)

"""Friction below the slowest measured speed: a continued friction surface, (D14).

A belt drive mostly slides more slowly than the rig, at speeds where no bench has measured friction.
There are two limits: mu keeps its value at the slowest speed, or it continues with its trend there.
A drive uses a stated share of the trend; half of the trend is the mean if the truth is equally
likely anywhere between the two limits. The measured part and its range do not change.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from beltid.laws.bicubic import hermite_patches
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.surface_tables import SurfaceTables

NEAREST: Final = 0.0
"""Share of the trend that keeps the nearest measured value."""
HALF_TREND: Final = 0.5
WHOLE_TREND: Final = 1.0
REST: Final = 0.01
"""Ratio to the slowest speed below which the trend fades out: friction at rest is finite."""
STEEPEST: Final = 0.5
"""Largest slope of ln mu over ln v that counts as a trend; steeper ones are scatter."""
PLACES: Final = np.array([0.0, 0.01, 0.03, 0.08, 0.2, 0.45, 1.0])
"""Ratios to the slowest speed between which the continuation consists of bicubic patches."""


def uncertainty_over_spread(share: float) -> float:
    """Compute the standard uncertainty at a share of the trend over the spread of both limits.

    Root mean square deviation from a truth that is uniform between the limits: 1/sqrt(12) with half
    of the trend, 1/sqrt(3) at either limit.
    """
    return math.sqrt(1.0 / 12.0 + (HALF_TREND - share) ** 2)


def continued(surface: FrictionSurface, share: float) -> SurfaceTables:
    """Continue a surface below its slowest speed, (D14).

    Parameters
    ----------
    surface : FrictionSurface
        The measured surface.
    share : float
        Share of the trend used in the continuation [-], 0 to 1.

    Returns
    -------
    SurfaceTables
        The tables of the surface itself if it has one speed, if its slowest speed is 0, or if the
        share is 0, which keeps the nearest measured value.

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
    # read-only like those of the surface, for which the kernels are compiled
    y_nodes.flags.writeable = C.flags.writeable = False
    return tables._replace(y_nodes=y_nodes, C=C)

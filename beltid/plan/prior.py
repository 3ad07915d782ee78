"""Prior of the surface: before any run, and between and beyond measured nodes.

ln mu at the knots is Gaussian with the roughness of the refined surface (:mod:`beltid.refine`,
bending over the force, difference between speeds). The roughness leaves a level at each speed and a
common slope over the force free; these have a separate broad prior:

    P = a Q_bending + b Q_difference + N' K^-1 N,                                            (P5)

where N gives the mean of each speed's curve and the mean slope, and K is their covariance: a level
common to all speeds, a slope over ln v, a bend over ln v (an integrated Wiener process), a slope
over ln f.

If a surface was measured, additional knots follow from its nodes by the same prior: given the nodes
they are Gaussian with the mean -P_nn^-1 P_no p_o and the covariance P_nn^-1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from beltid.laws.friction_surface import FrictionSurface
from beltid.plan.design import Knowledge
from beltid.refine.curves import Curves
from beltid.refine.effects import ARC, BEFORE
from beltid.refine.evidence import Smoothness
from beltid.uncertainty.budget import SurfaceUncertainty

Array = NDArray[np.float64]

USUAL = Smoothness(bending=float(np.exp(5.0)), difference=float(np.exp(7.0)), noise_scale=1.0)
"""Smoothness of an unknown surface, from which the refined surface also starts."""
USUAL_ARCS = float(np.exp(BEFORE[ARC][0]))
"""Standard deviation of ln mu between arcs, from the same start."""
LEVEL = 1.0
"""mu of a dry ribbed belt at the middle of the knots [-]: 0.7 to 1.5 is typical."""
LEVEL_WIDTH = 0.38
"""Standard deviation of ln mu at that point: half of ln(1.5 / 0.7)."""
FORCE_SLOPE, FORCE_SLOPE_WIDTH = -0.15, 0.15
"""d ln mu / d ln f_N and its standard deviation."""
SPEED_SLOPE, SPEED_SLOPE_WIDTH = 0.1, 0.15
"""d ln mu / d ln v and its standard deviation."""
SPEED_BEND = 0.1
"""Standard deviation of the change of d ln mu / d ln v over one unit of ln v."""
SAME_SPEED = 0.1
"""Largest distance in ln v at which a run belongs to a speed of the surface."""


def usual_surface(log_force: Array, log_speed: Array) -> FrictionSurface:
    """Return the mean of the prior, with which runs are simulated before any measurement."""
    x = log_force - log_force.mean()
    z = log_speed - log_speed.mean()
    log_mu = np.log(LEVEL) + FORCE_SLOPE * x[:, None] + SPEED_SLOPE * z
    return FrictionSurface(np.exp(log_force), np.exp(log_speed), np.exp(log_mu))


def prior_precision(curves: Curves, smoothness: Smoothness = USUAL) -> Array:
    """Return the inverse covariance of the knot values before any run (size, size), (P5)."""
    k, m = curves.log_force.size, curves.log_speed.size
    rough = smoothness.bending * curves.bending()
    if m > 1:
        rough = rough + smoothness.difference * curves.difference()
    z = curves.log_speed - curves.log_speed.mean()
    early, late = np.minimum.outer(z, z) - z[0], np.maximum.outer(z, z) - z[0]
    bend = np.square(early) * (3.0 * late - early) / 6.0
    level = LEVEL_WIDTH**2 + SPEED_SLOPE_WIDTH**2 * np.outer(z, z) + SPEED_BEND**2 * bend
    slope = np.zeros(k)
    slope[[0, -1]] = np.array([-1.0, 1.0]) / np.ptp(curves.log_force)
    means = np.kron(np.eye(m), np.full((1, k), 1.0 / k))
    slopes = np.tile(slope, (1, m)) / m
    levels = means.T @ np.linalg.solve(level, means)
    return np.asarray(rough + levels + slopes.T @ slopes / FORCE_SLOPE_WIDTH**2)


def knots_for(low: float, high: float, measured: FrictionSurface | None, count: int) -> Array:
    """Place knots in ln f from a lowest to a highest force [N/m].

    The knots of a measured surface stay; further ones extend it at the spacing of its end nodes.
    """
    if measured is None:
        return np.linspace(np.log(low), np.log(high), count)
    nodes = np.log(measured.normal_force_N_m)
    first, last = nodes[1] - nodes[0], nodes[-1] - nodes[-2]
    below = max(round((nodes[0] - np.log(low)) / first), 0)
    above = max(round((np.log(high) - nodes[-1]) / last), 0)
    return np.concatenate(
        [
            nodes[0] - first * np.arange(below, 0, -1),
            nodes,
            nodes[-1] + last * np.arange(1, above + 1),
        ]
    )


def speeds_for(wanted: Array, measured: FrictionSurface | None) -> Array:
    """Return the speeds [m/s] of a plan: those of a measured surface and the new ones."""
    wanted = np.unique(wanted)
    if measured is None:
        return wanted
    existing = measured.slip_speed_m_s
    distance = np.abs(np.log(wanted[:, None] / existing)).min(axis=1)
    return np.union1d(existing, wanted[distance > SAME_SPEED])


def knowledge_at(
    curves: Curves,
    measured: SurfaceUncertainty | None,
    n_errors: int,
    smoothness: Smoothness = USUAL,
) -> Knowledge:
    """Return the knowledge of ln mu at the knots of a plan, before its runs.

    Parameters
    ----------
    curves : Curves
        Knots and speeds of the plan; the nodes of the measured surface are among them.
    measured : SurfaceUncertainty or None
        The measured surface; None before any run.
    n_errors : int
        Number of shared errors, those of the measured surface first; the others do not affect it.
    smoothness : Smoothness
        Roughness weights away from the measured nodes.
    """
    precision = prior_precision(curves, smoothness)
    size = precision.shape[0]
    if measured is None:
        return Knowledge(np.asarray(np.linalg.inv(precision), float), np.zeros((size, n_errors)))
    old = _places(curves, measured.surface)
    new = np.setdiff1d(np.arange(size), old)
    follows = np.zeros((size, old.size))
    follows[old, np.arange(old.size)] = 1.0
    unknown = np.zeros((size, size))
    if new.size:
        own = precision[np.ix_(new, new)]
        follows[new] = -np.linalg.solve(own, precision[np.ix_(new, old)])
        unknown[np.ix_(new, new)] = np.linalg.inv(own)
    factor = follows @ _speed_by_speed(measured.scatter)
    scatter = np.asarray(factor @ factor.T + unknown, dtype=float)
    changes = np.zeros((size, n_errors))
    changes[:, : measured.changes.shape[-1]] = follows @ _speed_by_speed(measured.changes)
    return Knowledge(scatter, changes)


def _speed_by_speed(nodes: Array) -> Array:
    """Reorder values at nodes (nf, nv, r) as the parameters (nv nf, r)."""
    nf, nv, r = nodes.shape
    return nodes.transpose(1, 0, 2).reshape(nv * nf, r)


def _places(curves: Curves, surface: FrictionSurface) -> NDArray[np.intp]:
    """Return the indices of the parameters that are nodes of a surface, speed by speed."""
    of_force = np.searchsorted(curves.log_force, np.log(surface.normal_force_N_m) - 1.0e-9)
    of_speed = np.searchsorted(curves.log_speed, np.log(surface.slip_speed_m_s) - 1.0e-9)
    return np.add.outer(of_speed * curves.log_force.size, of_force).ravel()

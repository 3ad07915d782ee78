"""Knowledge before the next runs: a prior of the surface, or the measured one, and shared errors.

Before any run, ln mu at the knots is Gaussian with the roughness of the refined surface
(:mod:`beltid.refine.posterior`) at its usual sizes; the levels and the slope that roughness leaves
free have a broad prior,

    Sigma = s_c² B_c B_c' + s_d² B_d B_d' + K 1 1' + 0.15² x x',                             (P5)

where K, the covariance of the levels of the speeds, has a level common to all, a slope over ln v,
and a bend over ln v (an integrated Wiener process), and x = ln f_N less its mean.

If a surface was measured, additional knots follow from its nodes by the same prior: given the nodes
they are Gaussian with the mean Sigma_no Sigma_oo^-1 p_o and the covariance that this leaves. A
surface stores its sources of error as stated when it was fitted. New runs are subject to these and
to sources that the surface does not have: another arc setting, an error that was not stated then.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from beltid.laws.friction_surface import FrictionSurface
from beltid.plan.design import Knowledge
from beltid.refine.curves import SPEED_BEND, Curves
from beltid.refine.posterior import BEFORE, CURVE, DIFFERENCE, PRIORS
from beltid.uncertainty.budget import SurfaceUncertainty
from beltid.uncertainty.measured import numbered_arcs
from beltid.uncertainty.sources import (
    ARC,
    FITTED,
    Source,
    StandardUncertainties,
    all_sources,
    effect_sources,
    with_rig_sources,
)

Array = NDArray[np.float64]

LEVEL: Final = 1.0
"""mu of a dry ribbed belt at the middle of the knots [-]: 0.7 to 1.5 is typical."""
LEVEL_WIDTH: Final = 0.38
"""Standard deviation of ln mu at that point: half of ln(1.5 / 0.7)."""
FORCE_SLOPE, FORCE_SLOPE_WIDTH = -0.15, 0.15
"""d ln mu / d ln f_N and its standard deviation."""
SPEED_SLOPE, SPEED_SLOPE_WIDTH = 0.1, 0.15
"""d ln mu / d ln v and its standard deviation."""
SAME_SPEED: Final = 0.1
"""Largest distance in ln v at which a run belongs to a speed of the surface."""


@dataclass(frozen=True, slots=True)
class KnownSurface(SurfaceUncertainty):
    """A measured surface with its stored uncertainty."""

    noise_scale: float = 1.0  # scatter of its runs over their standard errors [-]

    def stated_otherwise(self, stated: StandardUncertainties, law_scatter: bool) -> list[str]:
        """List the sources whose size was different when the surface was fitted."""
        now = all_sources(stated, len(self.arcs_deg), law_scatter)
        sizes = {(source.error, source.place): source.size for source in now}
        stated_then = (s for s in self.sources if s.basis != FITTED)
        changed = (s.name for s in stated_then if sizes.get((s.error, s.place), s.size) != s.size)
        return list(dict.fromkeys(changed))


def sources_of_plan(
    known: KnownSurface | None,
    stated: StandardUncertainties,
    arcs_deg: Sequence[float],
    law_scatter: bool,
) -> tuple[Source, ...]:
    """List the shared errors of a surface, then the additional ones of its candidates.

    Parameters
    ----------
    known : KnownSurface or None
        The surface; None before any run.
    stated : StandardUncertainties
        Stated uncertainties of the bench.
    arcs_deg : sequence of float
        Arc settings of the candidates [deg].
    law_scatter : bool
        Whether the covariance of the contact law is known.
    """
    stored = () if known is None else tuple(known.sources)
    _, arcs = numbered_arcs(arcs_deg, () if known is None else known.arcs_deg)
    size = next((source.size for source in stored if source.error == ARC), BEFORE[ARC].median)
    every = all_sources(stated, len(arcs), law_scatter)
    return with_rig_sources(stored, (*every, *effect_sources(ARC, size, len(arcs))))


def usual_surface(log_force: Array, log_speed: Array) -> FrictionSurface:
    """Return the mean of the prior, with which runs are simulated before any measurement."""
    x = log_force - log_force.mean()
    z = log_speed - log_speed.mean()
    log_mu = np.log(LEVEL) + FORCE_SLOPE * x[:, None] + SPEED_SLOPE * z
    return FrictionSurface(np.exp(log_force), np.exp(log_speed), np.exp(log_mu))


def prior_covariance(curves: Curves) -> Array:
    """Return the covariance of the knot values before any run (size, size), (P5)."""
    k, m = curves.log_force.size, curves.log_speed.size
    parts = curves.coordinates()
    z = curves.log_speed - curves.log_speed.mean()
    early, late = np.minimum.outer(z, z) - z[0], np.maximum.outer(z, z) - z[0]
    bend = np.square(early) * (3.0 * late - early) / 6.0
    level = LEVEL_WIDTH**2 + SPEED_SLOPE_WIDTH**2 * np.outer(z, z) + SPEED_BEND**2 * bend
    x = np.tile(curves.log_force - curves.log_force.mean(), m)
    covariance = np.kron(level, np.ones((k, k))) + FORCE_SLOPE_WIDTH**2 * np.outer(x, x)
    for part in (CURVE, DIFFERENCE):
        covariance = covariance + PRIORS[part].median ** 2 * parts[part] @ parts[part].T
    return np.asarray(covariance)


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
    lower = nodes[0] - first * np.arange(below, 0, -1)
    return np.concatenate([lower, nodes, nodes[-1] + last * np.arange(1, above + 1)])


def speeds_for(wanted: Array, measured: FrictionSurface | None) -> Array:
    """Return the speeds [m/s] of a plan: those of a measured surface and the new ones."""
    wanted = np.unique(wanted)
    if measured is None:
        return wanted
    existing = measured.slip_speed_m_s
    distance = np.abs(np.log(wanted[:, None] / existing)).min(axis=1)
    return np.union1d(existing, wanted[distance > SAME_SPEED])


def knowledge_at(curves: Curves, measured: SurfaceUncertainty | None, n_errors: int) -> Knowledge:
    """Return the knowledge of ln mu at the knots of a plan, before its runs.

    Parameters
    ----------
    curves : Curves
        Knots and speeds of the plan; the nodes of the measured surface are among them.
    measured : SurfaceUncertainty or None
        The measured surface; None before any run.
    n_errors : int
        Number of shared errors, those of the measured surface first; the others do not affect it.
    """
    prior = prior_covariance(curves)
    changes = np.zeros((prior.shape[0], n_errors))
    if measured is None:
        return Knowledge(prior, changes)
    nf, nv, n_known = measured.changes.shape
    of_force = np.searchsorted(curves.log_force, np.log(measured.surface.normal_force_N_m) - 1.0e-9)
    of_speed = np.searchsorted(curves.log_speed, np.log(measured.surface.slip_speed_m_s) - 1.0e-9)
    nodes = np.add.outer(of_force, of_speed * curves.log_force.size).ravel()
    follows = np.linalg.solve(prior[np.ix_(nodes, nodes)], prior[nodes]).T
    factor = follows @ measured.scatter.reshape(nf * nv, -1)
    changes[:, :n_known] = follows @ measured.changes.reshape(nf * nv, -1)
    return Knowledge(factor @ factor.T + prior - follows @ prior[nodes], changes)

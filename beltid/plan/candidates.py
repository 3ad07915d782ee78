"""What is known of the surface before a plan, and the settings of the rig as rows of its model.

Before any run, ln mu at the knots is Gaussian, (P5) of the theory page: as rough as refined
surfaces usually are, with a broad prior of level and slopes. Additional knots of a measured surface
follow from its nodes by the same prior. The noise of a run is

    v = s² [ s_r² + s_T² (1/T_tight² + 1/T_slack²) / (mu beta)² + s_m² ],                    (P6)

by the friction from run to run, the tensions in Eq. (6), and the error of the simulation.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from beltid.errors import InputError
from beltid.identify.friction.run import TWO_CELLS, RigKind
from beltid.laws.friction_surface import FrictionSurface
from beltid.params import OperatingPoint
from beltid.plan.design import SAME_SPEED, Knowledge, RunRows
from beltid.refine.inverse import KNOTS, MODEL_ERROR, acting_forces, sweep
from beltid.refine.posterior import CURVE, DIFFERENCE, PRIORS, SPEED_BEND, Curves
from beltid.rig.model import Bench
from beltid.uncertainty.measured import Measured, PressLaw, numbered_arcs
from beltid.uncertainty.simulated import MESH, Campaign, RigRuns, residual_changes, simulated_runs
from beltid.uncertainty.sources import (
    ARC,
    SURFACE,
    Array,
    Source,
    StandardUncertainties,
    SurfaceUncertainty,
    effect_sources,
    stated_sources,
    with_sources,
)

LEVEL, LEVEL_WIDTH = 1.0, 0.38
"""mu of a dry ribbed belt at the middle of the knots, 0.7 to 1.5; standard deviation of ln mu."""
FORCE_SLOPE, FORCE_SLOPE_WIDTH = -0.15, 0.15  # d ln mu / d ln f_N and its standard deviation
SPEED_SLOPE, SPEED_SLOPE_WIDTH = 0.1, 0.15  # d ln mu / d ln v and its standard deviation


def sources_of_plan(
    known: SurfaceUncertainty | None,
    stated: StandardUncertainties,
    arcs_deg: Sequence[float],
) -> tuple[Source, ...]:
    """List the shared errors of a known surface, then the additional ones of arcs [deg]."""
    stored, known_arcs = ((), ()) if known is None else (known.sources, known.arcs_deg)
    _, arcs = numbered_arcs(arcs_deg, known_arcs)
    size = next((source.size for source in stored if source.error == ARC), PRIORS[ARC].median)
    every = stated_sources(stated, SURFACE, len(arcs))
    return with_sources(stored, (*every, *effect_sources(ARC, size, len(arcs))))


def usual_surface(log_force: Array, log_speed: Array) -> FrictionSurface:
    """Return the mean of the prior, with which runs are simulated before any measurement."""
    x, z = log_force - log_force.mean(), log_speed - log_speed.mean()
    log_mu = np.log(LEVEL) + FORCE_SLOPE * x[:, None] + SPEED_SLOPE * z
    return FrictionSurface(np.exp(log_force), np.exp(log_speed), np.exp(log_mu))


def prior_covariance(curves: Curves) -> Array:
    """Return the covariance of the knot values before any run (size, size), (P5)."""
    k, m = curves.log_force.size, curves.log_speed.size
    z = curves.log_speed - curves.log_speed.mean()
    early, late = np.minimum.outer(z, z) - z[0], np.maximum.outer(z, z) - z[0]
    bend = np.square(early) * (3.0 * late - early) / 6.0
    level = LEVEL_WIDTH**2 + SPEED_SLOPE_WIDTH**2 * np.outer(z, z) + SPEED_BEND**2 * bend
    x = np.tile(curves.log_force - curves.log_force.mean(), m)
    covariance = np.kron(level, np.ones((k, k))) + FORCE_SLOPE_WIDTH**2 * np.outer(x, x)
    for part in (CURVE, DIFFERENCE):
        columns = curves.parts.get(part, np.zeros((k * m, 0)))
        covariance = covariance + PRIORS[part].median ** 2 * columns @ columns.T
    return np.asarray(covariance)


def knowledge_at(curves: Curves, measured: SurfaceUncertainty | None, n_errors: int) -> Knowledge:
    """Return the knowledge of ln mu at the knots of a plan, before its runs.

    The nodes of the measured surface, if there is one, are among the knots, and its shared errors
    are the first of all `n_errors`; the others do not affect it.
    """
    prior = prior_covariance(curves)
    changes = np.zeros((prior.shape[0], n_errors))
    if measured is None:
        return Knowledge(prior, changes)
    of_force = np.searchsorted(curves.log_force, np.log(measured.surface.normal_force_N_m) - 1.0e-9)
    of_speed = np.searchsorted(curves.log_speed, np.log(measured.surface.slip_speed_m_s) - 1.0e-9)
    nodes = np.add.outer(of_force, of_speed * curves.log_force.size).ravel()
    follows = np.linalg.solve(prior[np.ix_(nodes, nodes)], prior[nodes]).T
    factor = follows @ measured.factor.reshape(nodes.size, -1)
    known, scatter = np.split(factor, [len(measured.sources)], axis=1)
    changes[:, : known.shape[1]] = known
    return Knowledge(scatter @ scatter.T + prior - follows @ prior[nodes], changes)


@dataclass(frozen=True, slots=True)
class NoiseLaw:
    """Noise of a run, (P6)."""

    friction: float = 3.0e-3  # standard deviation s_r of ln mu from run to run [-]
    tension: float = 0.1  # standard deviation s_T of the tensions of a run [N]
    scale: float = 1.0  # factor s from the fit of the surface [-]

    def variance(self, measured: Measured) -> Array:
        """Return the variance of ln mu of each run (n,)."""
        by_tension = self.tension**2 * _tension_share(measured)
        return np.asarray(self.scale**2 * (self.friction**2 + by_tension + MODEL_ERROR**2))


USUAL_NOISE = NoiseLaw()


def noise_law(measured: Measured, scale: float = 1.0) -> NoiseLaw:
    """Fit (P6) to the squared standard errors of reduced runs, in relative misfits."""
    squares = np.square(measured.mu_se / measured.mu)
    known = squares > 0.0
    if not known.any():
        raise InputError(
            "the runs have no standard errors, so their noise is unknown; state mu_se or "
            "rig.force_resolution_N when they are reduced, or plan without them"
        )
    terms = np.column_stack([np.ones(squares.size), _tension_share(measured)])[known]
    variances, _ = nnls(terms / squares[known, None], np.ones(len(terms)))
    friction, tension = np.sqrt(variances).tolist()
    return NoiseLaw(friction, tension, scale)


def _tension_share(measured: Measured) -> Array:
    """Return the variance of ln mu per unit variance of both tensions [1/N²]."""
    squares = 1.0 / np.square(measured.tight) + 1.0 / np.square(measured.slack)
    return np.asarray(squares / np.square(measured.mu * measured.beta))


def settings_of_rig(
    arcs_deg: Sequence[float], tensions: Sequence[float], omegas: Sequence[float]
) -> list[OperatingPoint]:
    """List every combination of arcs [deg], tensions [N], speeds [rad/s]; the last varies most."""
    every = itertools.product(arcs_deg, tensions, omegas)
    return [OperatingPoint(math.radians(arc), T_0, omega) for arc, T_0, omega in every]


def simulate_candidates(
    bench: Bench,
    press: PressLaw,
    points: Sequence[OperatingPoint],
    known: SurfaceUncertainty | None,
    sources: Sequence[Source],
    noise: NoiseLaw = USUAL_NOISE,
    columns: Mapping[str, float] | None = None,
    kind: RigKind = TWO_CELLS,
) -> tuple[RunRows, Measured, Curves]:
    """Simulate each setting once with the present surface, and differentiate it.

    Before any run (`known` None) that is the mean of the prior; the surface of the bench is not
    used. `columns` holds the change of ln mu per unit of each reduction error, by key. Returned are
    the rows of the linear model, the simulated runs, and the knots of the parameters. Raises
    `ConvergenceError` if a setting has no sliding state.
    """
    surface, known_arcs = (None, ()) if known is None else (known.surface, known.arcs_deg)
    arc = numbered_arcs([math.degrees(point.beta) for point in points], known_arcs)[0]
    campaign = Campaign(simulated_runs(bench, points, arc, kind), bench, press)
    wanted = campaign.measured.slip_speed
    existing = np.zeros(0) if surface is None else surface.slip_speed_m_s
    distance = np.abs(np.log(np.divide.outer(wanted, existing))).min(axis=1, initial=np.inf)
    speeds = np.union1d(existing, wanted[distance > SAME_SPEED])
    rig = RigRuns(campaign, speeds, MESH)
    force = campaign.measured.T_0 / bench.rig.R
    rough = np.log([0.2 * force.min(), 2.0 * force.max()])
    _, low, high = acting_forces(rig, surface or usual_surface(rough, np.log(speeds)))
    curves = Curves(knots_for(low, high, surface, KNOTS), np.log(speeds))
    present = surface or usual_surface(curves.log_force, curves.log_speed)
    log_mu = np.log(present.mu(np.exp(curves.log_force), speeds[:, None])).ravel()
    done, surfaces = sweep(rig, curves, log_mu), curves.surfaces(log_mu)
    runs = simulated_runs(bench, points, arc, kind, done.tensions)
    shared = {key: np.full((arc.size, 1), value) for key, value in (columns or {}).items()}
    shared[ARC] = done.J.sum(axis=1)[:, None] * np.eye(int(arc.max()) + 1)[arc]
    campaign = replace(campaign, measured=replace(runs, columns=shared))
    S, _ = residual_changes(campaign, sources, surfaces, speeds, done.speed_slope)
    return RunRows(done.J, S, noise.variance(runs), arc), runs, curves


def knots_for(low: float, high: float, measured: FrictionSurface | None, count: int) -> Array:
    """Place knots in ln f between two forces [N/m], or extend those of a measured surface."""
    if measured is None:
        return np.linspace(np.log(low), np.log(high), count)
    nodes = np.log(measured.normal_force_N_m)
    first, last = nodes[1] - nodes[0], nodes[-1] - nodes[-2]
    below = np.arange(round((nodes[0] - np.log(low)) / first), 0, -1)
    above = np.arange(1, round((np.log(high) - nodes[-1]) / last) + 1)
    return np.concatenate([nodes[0] - first * below, nodes, nodes[-1] + last * above])

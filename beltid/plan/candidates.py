"""Simulate each rig setting once with the present surface, and differentiate it.

The rows J, S of the linear model are computed as for the refined surface: J from the
sensitivities of the simulated rig, S as the change of measured less simulated ln mu by each
shared error (:mod:`beltid.uncertainty.refined`). The noise of a run is

    v = s² [ s_r² + s_T² (1/T_tight² + 1/T_slack²) / (mu beta)² + s_m² ],                    (P6)

the scatter of the friction from run to run, the scatter of the tensions in Eq. (6), and the error
of the simulated coefficient that the surface fit allows for.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from beltid.errors import InputError
from beltid.identify.friction.kinds import TWO_CELLS, RigKind
from beltid.laws.capstan import friction_coefficient
from beltid.laws.friction_surface import FrictionSurface
from beltid.params import OperatingPoint
from beltid.plan.design import RunRows
from beltid.plan.prior import knots_for, speeds_for, usual_surface
from beltid.refine.curves import Curves
from beltid.refine.effects import arc_effect
from beltid.refine.inverse import KNOTS, MODEL_ERROR
from beltid.refine.rig_runs import (
    MeasuredRun,
    RigRuns,
    acting_forces,
    mesh_of,
    surfaces_of,
    sweep_with_slopes,
)
from beltid.rig.model import Bench
from beltid.uncertainty.campaign import Campaign
from beltid.uncertainty.measured import Measured, numbered_arcs
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.refined import MESH, changes_of_residuals, simulated_slopes
from beltid.uncertainty.sources import Source

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class NoiseLaw:
    """Noise of a run, (P6).

    Attributes
    ----------
    friction : float
        Standard deviation s_r of ln mu from run to run [-].
    tension : float
        Standard deviation s_T of the tensions of a run [N].
    scale : float
        Factor s from the fit of the surface [-].
    """

    friction: float = 3.0e-3
    tension: float = 0.1
    scale: float = 1.0

    def variance(self, measured: Measured) -> Array:
        """Return the variance of ln mu of each run (n,)."""
        by_tension = np.square(self.tension) * _tension_share(measured)
        return np.asarray(self.scale**2 * (self.friction**2 + by_tension + MODEL_ERROR**2))


def noise_law(measured: Measured, scale: float = 1.0) -> NoiseLaw:
    """Fit (P6) to the squared standard errors of reduced runs.

    The misfits are relative to the squares, so that noisy runs do not dominate the fit.

    Raises
    ------
    InputError
        If no run has a standard error.
    """
    squares = np.square(measured.mu_se / measured.mu)
    has_error = squares > 0.0
    if not has_error.any():
        raise InputError(
            "the runs have no standard errors, so their noise is unknown; state mu_se or "
            "rig.force_resolution_N when they are reduced, or plan without them"
        )
    terms = np.column_stack([np.ones(squares.size), _tension_share(measured)])
    scaled = terms[has_error] / squares[has_error, None]
    variances, _ = nnls(scaled, np.ones(scaled.shape[0]))
    return NoiseLaw(float(np.sqrt(variances[0])), float(np.sqrt(variances[1])), scale)


def _tension_share(measured: Measured) -> Array:
    """Return the variance of ln mu per unit variance of both tensions [1/N²]."""
    squares = 1.0 / np.square(measured.tight) + 1.0 / np.square(measured.slack)
    return np.asarray(squares / np.square(measured.mu * measured.beta))


@dataclass(frozen=True, slots=True)
class Settings:
    """Available settings of the rig.

    Attributes
    ----------
    arcs_deg : tuple of float
        Contact arcs [deg].
    tensions : tuple of float
        Initial tensions [N].
    omegas : tuple of float
        Speeds of the pulley [rad/s].
    """

    arcs_deg: tuple[float, ...]
    tensions: tuple[float, ...]
    omegas: tuple[float, ...]

    def combined(self) -> list[tuple[float, float, float]]:
        """List arc [deg], tension and speed of every combination; the speed varies fastest."""
        return list(itertools.product(self.arcs_deg, self.tensions, self.omegas))

    def points(self) -> list[OperatingPoint]:
        """List the combinations as operating points in SI units."""
        return [OperatingPoint(math.radians(arc), T_0, w) for arc, T_0, w in self.combined()]


@dataclass(frozen=True, slots=True)
class Candidates:
    """Candidate runs, simulated with the present surface.

    Attributes
    ----------
    campaign : Campaign
        The runs with their simulated tensions, and the bench.
    curves : Curves
        Knots and speeds of the surface.
    J, response, speed_slope : ndarray, shape (n, size), (n,), (n,)
        Derivatives of ln mu with respect to the parameters, ln of a factor on the surface, ln v.
    slopes : ndarray, shape (n, 8)
        Derivatives with respect to the inputs of the simulated rig.
    """

    campaign: Campaign
    curves: Curves
    J: Array
    response: Array
    speed_slope: Array
    slopes: Array

    @property
    def measured(self) -> Measured:
        """Simulated runs."""
        return self.campaign.measured

    def rows(
        self, sources: Sequence[Source], noise: NoiseLaw, columns: Mapping[str, float]
    ) -> RunRows:
        """Build the rows of the linear model.

        Parameters
        ----------
        sources : sequence of Source
            The shared errors, in the order of the columns of S. One that does not affect new runs
            has zeros.
        noise : NoiseLaw
            Noise of a run.
        columns : mapping of str to float
            Change of ln mu per unit of each reduction error, by the key of its source.
        """
        n = self.J.shape[0]
        shared = {key: np.full((n, 1), value) for key, value in columns.items()}
        measured = replace(self.measured, columns=shared)
        measured = measured.with_effects([arc_effect(measured.arc)], self.response)
        campaign = replace(self.campaign, measured=measured)
        S = changes_of_residuals(campaign, sources, self.slopes, self.speed_slope)
        return RunRows(self.J, S, noise.variance(measured), measured.arc)


def simulate_candidates(
    bench: Bench,
    press: PressLaw,
    settings: Settings,
    known_arcs_deg: Sequence[float],
    measured: FrictionSurface | None,
    kind: RigKind = TWO_CELLS,
) -> Candidates:
    """Simulate each setting once with the present surface, and differentiate it.

    Parameters
    ----------
    bench : Bench
        Belt and rig; its surface is not used.
    press : PressLaw
        The contact law and the data it was fitted to.
    settings : Settings
        Available settings of the rig.
    known_arcs_deg : sequence of float
        Arc settings of the measured surface, numbered as in its sources [deg].
    measured : FrictionSurface or None
        The present surface; None before any run, which takes the mean of the prior.
    kind : RigKind
        What the rig measures, and so which errors its tensions can have.

    Raises
    ------
    ConvergenceError
        If a setting has no sliding state.
    """
    points = settings.points()
    surface_speed = np.array([omega * bench.rig.R for omega in settings.omegas])
    speeds = speeds_for(surface_speed, measured)
    arcs, _ = numbered_arcs([math.degrees(point.beta) for point in points], known_arcs_deg)
    runs = [MeasuredRun(point, 1.0, 0.0, int(k)) for point, k in zip(points, arcs, strict=True)]
    at = speeds[np.argmin(np.abs(np.log(surface_speed[:, None] / speeds)), axis=1)]
    rig = RigRuns(bench, runs, np.unique(at), mesh_of(bench, runs, MESH))
    force = np.array([point.T_0 for point in points]) / bench.rig.R
    rough = np.log([0.2 * force.min(), 2.0 * force.max()])
    start = usual_surface(rough, np.log(speeds)) if measured is None else measured
    acting = acting_forces(rig, start)
    log_force = knots_for(float(acting[:, 1].min()), float(acting[:, 2].max()), measured, KNOTS)
    curves = Curves(log_force, np.log(speeds))
    present = usual_surface(log_force, curves.log_speed) if measured is None else measured
    log_mu = np.log(present.mu(np.exp(log_force), speeds[:, None])).ravel()
    rig = RigRuns(bench, runs, speeds, mesh_of(bench, runs, MESH))
    sweep = sweep_with_slopes(rig, curves, log_mu)
    surfaces = surfaces_of(curves, log_mu)
    tight, slack = np.array([(state.T_A, state.T_B) for _, state in rig.slide(surfaces)]).T
    beta = np.array([point.beta for point in points])
    mu = friction_coefficient(tight, slack, beta)
    simulated = Measured(
        R=bench.rig.R,
        arc=arcs,
        beta=beta,
        T_0=np.array([point.T_0 for point in points]),
        omega=np.array([point.omega for point in points]),
        tight=tight,
        slack=slack,
        mu=mu,
        mu_se=np.zeros(mu.size),
        kind=kind,
        given_force=bench.rig.given_force,
    )
    campaign = Campaign(simulated, bench, press)
    slopes = simulated_slopes(campaign, surfaces, speeds, sweep.speed_slope)
    return Candidates(campaign, curves, sweep.J, sweep.response, sweep.speed_slope, slopes)

"""Refine a friction surface: find mu(f_N, v) with which the simulated rig gives what was measured.

The published procedure gives each measured coefficient the mean force of Eq. (8), which ignores
bending: peaks of the force where the belt enters and leaves the pulley. Here the rig is simulated
(its sliding limit, with sensitivities), and the surface is solved for by Gauss–Newton so that Eq.
(6), applied to the simulated tensions, gives each measured coefficient. The shape of the surface is
free; its smoothness is chosen by the data (:mod:`beltid.refine.evidence`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.errors import BeltidError, ConvergenceError, InputError
from beltid.laws.capstan import friction_coefficient
from beltid.laws.friction_surface import FrictionSurface
from beltid.params import OperatingPoint
from beltid.refine.curves import Curves
from beltid.refine.evidence import SMALLEST_SCALE, LinearModel, Smoothness, choose_smoothness
from beltid.rigsim.model import Bench, RigModel
from beltid.rigsim.path import element_count
from beltid.rigsim.sensitivity import tension_sensitivity
from beltid.rigsim.steady import StaticState, lay_on, slide

Array = NDArray[np.float64]

KNOTS = 12
FINE_NODES = 48  # of the surface that is simulated, between the knots
FINER_MESH = 1.5  # elements over the default: the mesh must not add a bias of its own
FORCE_SHARE = 0.005  # of the friction that acts below the lowest knot
MODEL_ERROR = 5.0e-4  # relative error of a simulated coefficient, added to the measured one
MOST_ITERATIONS = 15
TOLERANCE = 1.0e-5  # change of ln mu at which the iteration ends
LARGEST_CHANGE = 0.5  # of ln mu in one iteration
CHOICES = 6  # iterations in which weights and smoothness are chosen anew
OUTLIER = 3.5  # misfit in standard errors beyond which a run loses weight


@dataclass(frozen=True, slots=True)
class MeasuredRun:
    """One reduced run of the bench.

    Attributes
    ----------
    point : OperatingPoint
        Arc, measured initial tension, measured speed.
    mu, mu_se : float
        Sliding coefficient by Eq. (6) and its standard error [-].
    """

    point: OperatingPoint
    mu: float
    mu_se: float


@dataclass(frozen=True, slots=True)
class Sweep:
    """All runs simulated with one surface.

    Attributes
    ----------
    log_mu : ndarray, shape (n,)
        ln of the simulated coefficients.
    J : ndarray, shape (n, size)
        Derivatives of ``log_mu`` with respect to the parameters.
    """

    log_mu: Array
    J: Array


@dataclass(frozen=True, slots=True)
class RefinedSurface:
    """Solution of the inverse problem.

    Attributes
    ----------
    surface : FrictionSurface
        The surface with the standard errors of its nodes.
    curves : Curves
        Splines behind it.
    parameters, covariance : ndarray, shape (size,), (size, size)
        ln mu at the knots and its covariance.
    smoothness : Smoothness
        What the data chose.
    effective_parameters : float
        Number of parameters that the data determine.
    iterations : int
        Gauss–Newton iterations.
    misfit_before, misfit_after : ndarray, shape (n,)
        Simulated over measured coefficient less one, with the start and with the refined surface.
    weight : ndarray, shape (n,)
        Weight of the runs in the fit, 1 but for those far off [-].
    force_range : ndarray, shape (m, 2)
        Range of the line force that acted in the contact at each speed [N/m].
    """

    surface: FrictionSurface
    curves: Curves
    parameters: Array
    covariance: Array
    smoothness: Smoothness
    effective_parameters: float
    iterations: int
    misfit_before: Array
    misfit_after: Array
    weight: Array
    force_range: Array


class _Rig:
    """The runs, laid on once: they are simulated with many surfaces."""

    def __init__(self, bench: Bench, runs: Sequence[MeasuredRun], speeds: Array) -> None:
        self.beta = np.array([run.point.beta for run in runs])
        self.speeds = speeds
        v = np.array([run.point.omega * bench.rig.R for run in runs])
        self.label = np.argmin(np.abs(np.log(v[:, None] / speeds)), axis=1)
        self.off_speed = np.log(v / speeds[self.label])
        self.models: list[RigModel] = []
        self.laid: list[StaticState] = []
        for k, run in enumerate(runs):
            point = run.point
            n = element_count(bench.belt, bench.rig, bench.law, point.beta, point.T_0)
            at_speed = OperatingPoint(point.beta, point.T_0, speeds[self.label[k]] / bench.rig.R)
            model = bench.model(at_speed, 2 * round(0.5 * FINER_MESH * n))
            self.models.append(model)
            self.laid.append(lay_on(model))

    def slide(self, surfaces: Sequence[FrictionSurface]) -> list[tuple[RigModel, StaticState]]:
        """Sliding state of every run, with the surface of its speed."""
        states = []
        for k, model in enumerate(self.models):
            of_run = model.with_surface(surfaces[self.label[k]])
            states.append((of_run, slide(of_run, self.laid[k])))
        return states


def _surfaces(curves: Curves, parameters: Array) -> list[FrictionSurface]:
    """The surface of each speed, finely tabulated: mu is a spline in the logarithm only."""
    log_force = np.linspace(curves.log_force[0], curves.log_force[-1], FINE_NODES)
    log_mu = curves.basis(log_force) @ parameters.reshape(curves.log_speed.size, -1).T
    return [
        FrictionSurface(np.exp(log_force), [float(np.exp(v))], np.exp(column)[:, None])
        for v, column in zip(curves.log_speed, log_mu.T, strict=True)
    ]


def _sweep(rig: _Rig, curves: Curves, parameters: Array) -> Sweep:
    surfaces = _surfaces(curves, parameters)
    k = curves.log_force.size
    log_mu = np.empty(len(rig.models))
    J = np.zeros((len(rig.models), curves.size))
    # runs off the speed of their group by a little: along the slope between the speeds
    by_speed = np.zeros((1, k))
    if curves.log_speed.size > 1:
        values = parameters.reshape(-1, k)
        by_speed = np.asarray(np.gradient(values, curves.log_speed, axis=0), dtype=float)
    for i, (model, state) in enumerate(rig.slide(surfaces)):
        beta = rig.beta[i]
        mu = float(friction_coefficient(state.T_A, state.T_B, beta))
        s = tension_sensitivity(model, state)
        per_mu = (s.tension_tight_N / state.T_A - s.tension_slack_N / state.T_B) / (beta * mu)
        j = rig.label[i]
        basis = curves.basis(np.log(s.normal_force_N_m))
        row = (per_mu * surfaces[j].mu(s.normal_force_N_m, np.exp(curves.log_speed[j]))) @ basis
        J[i, j * k : (j + 1) * k] = row
        log_mu[i] = np.log(mu)
        log_mu[i] += rig.off_speed[i] * float(row @ by_speed[j])
    return Sweep(log_mu, J)


def _acting_forces(rig: _Rig, start: FrictionSurface) -> Array:
    """Range of the line force at each speed (m, 2): from a small share of the load to the peaks."""
    acting: list[list[tuple[float, float]]] = [[] for _ in rig.speeds]
    by_speed = [start] * rig.speeds.size
    for i, (_, state) in enumerate(rig.slide(by_speed)):
        points = state.points
        touching = points.F_N > 0.0
        f, load = points.f_look[touching].ravel(), points.F_look[touching].ravel()
        order = np.argsort(f)
        share = np.cumsum(load[order]) / load.sum()
        acting[rig.label[i]].append(
            (float(np.interp(FORCE_SHARE, share, f[order])), float(f.max()))
        )
    ranges = []
    for pairs in acting:
        low, high = np.array(pairs).T
        ranges.append((low.min(), high.max()))
    return np.array(ranges)


def refine_surface(
    bench: Bench, runs: Sequence[MeasuredRun], speeds: Array, nodes: int = 12
) -> RefinedSurface:
    """Find the surface with which the simulated rig gives every measured coefficient.

    Parameters
    ----------
    bench : Bench
        Belt, rig, normal law, and the surface to start from (that of the published procedure).
    runs : sequence of MeasuredRun
        The measured runs, all arcs together.
    speeds : ndarray, shape (m,)
        Speed settings [m/s], increasing; each run belongs to the nearest one.
    nodes : int
        Force nodes of the surface that comes out.

    Raises
    ------
    InputError
        If there are too few runs.
    ConvergenceError
        If a run cannot be simulated, or the iteration does not converge.
    """
    if len(runs) < 4:
        raise InputError(f"{len(runs)} runs to refine a surface from, at least 4 are needed")
    rig = _Rig(bench, runs, np.asarray(speeds, dtype=float))
    empty = [f"{v:g} m/s" for j, v in enumerate(rig.speeds) if not np.any(rig.label == j)]
    if empty:
        raise InputError(f"no run at the speeds {', '.join(empty)}")
    acting = _acting_forces(rig, bench.surface)
    low, high = float(acting[:, 0].min()), float(acting[:, 1].max())
    curves = Curves(np.linspace(np.log(low), np.log(high), KNOTS), np.log(rig.speeds))
    grid_f, grid_v = np.exp(curves.log_force), rig.speeds
    start = np.log(bench.surface.mu(grid_f[None, :], grid_v[:, None])).ravel()
    measured = np.log([run.mu for run in runs])
    errors = np.hypot([run.mu_se / run.mu for run in runs], MODEL_ERROR)
    fit = _gauss_newton(rig, curves, start, measured, errors)
    _, covariance = fit.model.solve(fit.smoothness)
    after = _sweep(rig, curves, fit.parameters).log_mu
    return RefinedSurface(
        surface=_tabulated(curves, fit.parameters, covariance, nodes),
        curves=curves,
        parameters=fit.parameters,
        covariance=covariance,
        smoothness=fit.smoothness,
        effective_parameters=fit.model.effective_parameters(fit.smoothness),
        iterations=fit.iterations,
        misfit_before=np.expm1(fit.log_mu_before - measured),
        misfit_after=np.expm1(after - measured),
        weight=fit.weight,
        force_range=acting,
    )


@dataclass(frozen=True, slots=True)
class _Fit:
    parameters: Array
    model: LinearModel
    smoothness: Smoothness
    weight: Array
    log_mu_before: Array
    iterations: int


def _gauss_newton(rig: _Rig, curves: Curves, start: Array, measured: Array, errors: Array) -> _Fit:
    """Iterate; weights and smoothness are chosen anew until the surface has settled."""
    bending, difference = curves.bending(), curves.difference()
    smoothness = Smoothness(bending=10.0, difference=10.0, noise_scale=1.0)
    parameters, weight = start, np.ones(measured.size)
    log_mu_before, change = None, np.inf
    for iteration in range(1, MOST_ITERATIONS + 1):
        try:
            sweep = _sweep(rig, curves, parameters)
        except BeltidError as error:
            raise ConvergenceError(
                [f"refined surface, iteration {iteration}: {line}" for line in error.problems],
                iterations=iteration,
                residual=float(change),
            ) from error
        if log_mu_before is None:
            log_mu_before = sweep.log_mu
        y = measured - sweep.log_mu + sweep.J @ parameters
        scale = np.sqrt(weight) / errors
        model = LinearModel(sweep.J * scale[:, None], y * scale, bending, difference)
        if iteration <= CHOICES:
            smoothness = choose_smoothness(model, smoothness)
        solution, _ = model.solve(smoothness)
        if iteration <= CHOICES:
            weight = _weights((y - sweep.J @ solution) / errors)
        step = np.clip(solution - parameters, -LARGEST_CHANGE, LARGEST_CHANGE)
        parameters = parameters + step
        # what the data see of the step: knots that carry no load may drift
        change = float(np.max(np.abs(sweep.J @ step)))
        if change <= TOLERANCE:
            return _Fit(parameters, model, smoothness, weight, log_mu_before, iteration)
    raise ConvergenceError(
        f"refined surface: no convergence in {MOST_ITERATIONS} iterations (last change of mu "
        f"{100 * change:.2g} %)",
        iterations=MOST_ITERATIONS,
        residual=change,
    )


def _weights(misfit: Array) -> Array:
    """Weights that fall for runs far off, judged by the median misfit: few cannot hide in it."""
    scale = max(1.4826 * float(np.median(np.abs(misfit))), SMALLEST_SCALE)
    return np.square(OUTLIER / np.maximum(np.abs(misfit) / scale, OUTLIER))


def _tabulated(curves: Curves, parameters: Array, covariance: Array, nodes: int) -> FrictionSurface:
    """The curves on a grid of force nodes and speeds, with standard errors."""
    log_force = np.linspace(curves.log_force[0], curves.log_force[-1], nodes)
    basis = curves.basis(log_force)
    k = curves.log_force.size
    mu = np.exp(basis @ parameters.reshape(-1, k).T)
    se = np.empty_like(mu)
    for j in range(curves.log_speed.size):
        block = covariance[j * k : (j + 1) * k, j * k : (j + 1) * k]
        se[:, j] = mu[:, j] * np.sqrt(np.einsum("nk,kl,nl->n", basis, block, basis))
    return FrictionSurface(np.exp(log_force), np.exp(curves.log_speed), mu, se)

"""Refine a friction surface: find mu(f_N, v) for which the simulated rig matches the measurements.

The published procedure assigns each measured coefficient to the mean force of Eq. (8). This ignores
bending, which causes force peaks where the belt enters and leaves the pulley. Here the rig is
simulated (its sliding limit, with sensitivities), and Gauss–Newton finds the surface for which
Eq. (6), applied to the simulated tensions, gives each measured coefficient. The shape of the
surface is free. The data determine its smoothness (:mod:`beltid.refine.evidence`) and the other
effects on friction (:mod:`beltid.refine.effects`).

Errors that runs share have stated standard uncertainties. The data determine how much of them is
there, and the size of the effects beyond them: an incorrectly set arc counts once, as the stated
error. The surface itself is not corrected for the errors estimated from the runs: a bench without
them would lose accuracy, since such an error and a model error leave similar traces. It is
corrected only for the effects, in the size that the stated errors leave to them.
:mod:`beltid.uncertainty.refined` propagates the errors.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.errors import BeltidError, ConvergenceError, InputError, percent
from beltid.laws.friction_surface import FrictionSurface
from beltid.refine.curves import Curves
from beltid.refine.effects import Effect, EstimatedEffect, campaign_effects
from beltid.refine.evidence import (
    SMALLEST_SCALE,
    LinearModel,
    Smoothness,
    Solution,
    choose_smoothness,
    log_evidence_for,
)
from beltid.refine.rig_runs import (
    MeasuredRun,
    RigRuns,
    Sweep,
    acting_forces,
    mesh_of,
    sweep_with_slopes,
)
from beltid.rig.model import Bench

__all__ = ["MeasuredRun", "RefinedSurface", "refine_surface"]

Array = NDArray[np.float64]

KNOTS = 12  # over the range of the surface, and its nodes over the force
FINER_MESH = 1.5  # number of elements over the default, so that the mesh adds no bias
MODEL_ERROR = 2.0e-4
"""Relative error of a simulated coefficient, added to the measured one.

A mesh four times finer changes the coefficient by 0.002 to 0.02 %, and an independent model differs
by 0.007 %. A larger value would shift weight from quiet runs to noisy ones, and the common noise
scale would come out too small."""
MOST_ITERATIONS = 40
TOLERANCE = 1.0e-5  # change of ln mu at which the iteration ends
NEARLY = (
    1.0e-4  # change of ln mu up to which a result that is still changing is used, with a warning
)
LARGEST_CHANGE = 0.5  # largest change of ln mu of a run in one iteration
CHOICES = 6  # number of iterations that choose weights and smoothness again
DECREASE = 1.0e-4  # required decrease of the misfit over that of its tangent (Armijo)
HALVINGS = 7  # halvings of a step before it is given up
NOTHING = 0.1  # misfit left to gain that is negligible: a third of a standard error
OUTLIER = 3.5  # misfit in standard errors beyond which a run loses weight


@dataclass(frozen=True, slots=True)
class RefinedSurface:
    """Solution of the inverse problem.

    Attributes
    ----------
    surface : FrictionSurface
        The surface with the standard errors of its nodes.
    curves : Curves
        The splines from which the surface was tabulated.
    parameters, covariance : ndarray, shape (size,), (size, size)
        ln mu at the knots and its covariance.
    smoothness : Smoothness
        Hyperparameters chosen by the data.
    effective_parameters : float
        Number of parameters that the data determine.
    iterations : int
        Gauss–Newton iterations.
    still_changing : float
        Last change of ln mu of a run if the iteration did not converge, at most `NEARLY`; else 0.
    misfit_before, misfit_after : ndarray, shape (n,)
        Simulated over measured coefficient minus one, with the initial and with the refined
        surface.
    weight : ndarray, shape (n,)
        Weight of the runs in the fit [-]: 1, less for outliers.
    errors : ndarray, shape (n,)
        Standard errors of ln mu of the runs as used in the fit, including noise scale, run-to-run
        scatter and weight.
    noise_scale : float
        Scatter of the runs about the surface and the effects in units of their stated standard
        errors, root mean square [-].
    J, gain : ndarray, shape (n, size), (size, n)
        Derivatives of ln mu of the runs with respect to the parameters, and of the parameters with
        respect to ln mu of the runs.
    speed_slope : ndarray, shape (n,)
        Derivative of the simulated ln mu with respect to ln v of the run.
    effects : tuple of EstimatedEffect
        Effects on the friction apart from the surface. The part of an effect that the surface can
        represent, too, cannot be identified; the covariance of both includes it.
    effects_covariance : ndarray, shape (K, K)
        Covariance of the numbers of all effects, in order, including the uncertainty due to the
        stated errors.
    stated : ndarray, shape (K,)
        The errors that runs share as estimated from the runs, in units of their stated standard
        uncertainties; the surface is not corrected for them. Empty if no error was stated.
    model : LinearModel
        The model, linearised about the solution, for which the hyperparameters were chosen.
    """

    surface: FrictionSurface
    curves: Curves
    parameters: Array
    covariance: Array
    smoothness: Smoothness
    effective_parameters: float
    iterations: int
    still_changing: float
    misfit_before: Array
    misfit_after: Array
    weight: Array
    errors: Array
    noise_scale: float
    J: Array
    gain: Array
    speed_slope: Array
    effects: tuple[EstimatedEffect, ...]
    effects_covariance: Array
    stated: Array
    model: LinearModel

    def convergence_warnings(self) -> tuple[str, ...]:
        """Return a sentence if the iteration did not converge."""
        if not self.still_changing:
            return ()
        return (
            f"no convergence in {self.iterations} iterations: last change of mu "
            f"{percent(100 * self.still_changing)}, must be at most {percent(100 * TOLERANCE)}",
        )

    def effect(self, key: str) -> EstimatedEffect | None:
        """Look up an effect by its key; None if the runs cannot show it."""
        return next((entry for entry in self.effects if entry.effect.key == key), None)

    def log_evidence_for(self, *keys: str) -> float:
        """Compute the log probability ratio of the runs with and without some effects.

        It is near zero or below if the surface, other effects and stated errors explain as much.
        """
        chosen = [k for k, entry in enumerate(self.effects) if entry.effect.key in keys]
        return log_evidence_for(self.model, self.smoothness, chosen)

    @property
    def columns_of_effects(self) -> dict[str, Array]:
        """Change of ln mu of the runs per unit of each number of an effect, (n, K_e), by key."""
        return {entry.effect.key: entry.effect.columns for entry in self.effects}

    @property
    def response(self) -> Array:
        """Derivative of ln mu of the runs (n,) with respect to ln of a factor on the surface."""
        return np.asarray(self.J.sum(axis=1))


def refine_surface(
    bench: Bench,
    runs: Sequence[MeasuredRun],
    speeds: Array,
    *,
    stated: Array | None = None,
    reference_degC: float | None = None,
) -> RefinedSurface:
    """Find the surface for which the simulated rig gives every measured coefficient.

    Parameters
    ----------
    bench : Bench
        Belt, rig, normal law, and the initial surface (from the published procedure).
    runs : sequence of MeasuredRun
        The measured runs at all arcs.
    speeds : ndarray, shape (m,)
        Speed settings [m/s], increasing; each run belongs to the nearest one.
    stated : ndarray, shape (n, K), optional
        Change of measured minus simulated ln mu of each run for one standard uncertainty of each
        error that runs share. The effects are what these errors do not explain.
    reference_degC : float, optional
        Temperature to which the surface is corrected [°C]; by default that of the runs.

    Raises
    ------
    InputError
        If there are too few runs.
    ConvergenceError
        If a run cannot be simulated, or the iteration does not converge.
    """
    if len(runs) < 4:
        raise InputError(f"{len(runs)} runs to refine a surface from, at least 4 are needed")
    rig = RigRuns(bench, runs, np.asarray(speeds, dtype=float), mesh_of(bench, runs, FINER_MESH))
    empty = [f"{v:g} m/s" for j, v in enumerate(rig.speeds) if not np.any(rig.label == j)]
    if empty:
        raise InputError(f"no run at the speeds {', '.join(empty)}")
    acting = acting_forces(rig, bench.surface)
    lowest, low = acting[:, :2].min(axis=0)
    high = acting[:, 2].max()
    curves = Curves(_knots(*np.log([lowest, low, high])), np.log(rig.speeds))
    forces = np.geomspace(low, high, KNOTS)
    grid_f, grid_v = np.exp(curves.log_force), rig.speeds
    start = np.log(bench.surface.mu(grid_f[None, :], grid_v[:, None])).ravel()
    measured = np.log([run.mu for run in runs])
    errors = np.hypot([run.mu_se / run.mu for run in runs], MODEL_ERROR)
    effects = campaign_effects(
        np.array([run.arc for run in runs]),
        np.array([run.order for run in runs]),
        np.array([run.temperature_degC for run in runs]),
        reference_degC,
    )
    shared = np.zeros((len(runs), 0)) if stated is None else stated
    problem = _Problem(rig, curves, measured, errors, effects, shared)
    fit = _gauss_newton(problem, start)
    last = sweep_with_slopes(rig, curves, fit.parameters)
    variance = fit.model.variance(fit.smoothness)
    solution = fit.model.solve_surface(fit.smoothness)
    return RefinedSurface(
        surface=_tabulated(curves, fit.parameters, solution.covariance, forces),
        curves=curves,
        parameters=fit.parameters,
        covariance=solution.covariance,
        smoothness=fit.smoothness,
        effective_parameters=fit.model.effective_parameters(fit.smoothness),
        iterations=fit.iterations,
        still_changing=fit.still_changing,
        misfit_before=np.expm1(fit.log_mu_before - measured),
        misfit_after=np.expm1(last.log_mu - measured),
        weight=fit.weight,
        errors=errors * np.sqrt(variance / fit.weight),
        noise_scale=float(np.sqrt(np.mean(variance))),
        J=last.J,
        gain=solution.gain * (np.sqrt(fit.weight) / errors),
        speed_slope=last.speed_slope,
        effects=_estimated(effects, fit.model, fit.smoothness, solution),
        effects_covariance=solution.effects_covariance,
        stated=fit.model.solve(fit.smoothness).effects[fit.model.effects_count :],
        model=fit.model,
    )


def _estimated(
    effects: Sequence[Effect], model: LinearModel, smoothness: Smoothness, solution: Solution
) -> tuple[EstimatedEffect, ...]:
    """Divide the numbers of all effects and their covariance among the effects."""
    estimates, first = [], 0
    parts = zip(effects, smoothness.effects, model.effects, strict=True)
    for effect, size, columns in parts:
        own = slice(first, first + effect.columns.shape[1])
        covariance = solution.effects_covariance[own, own]
        explained = model.explained_by_surface(smoothness, columns)
        estimates.append(
            EstimatedEffect(effect, size, solution.effects[own], covariance, explained)
        )
        first = own.stop
    return tuple(estimates)


@dataclass(frozen=True, slots=True)
class _Problem:
    """The runs on the simulated rig and their measured values, arrays (n,)."""

    rig: RigRuns
    curves: Curves
    log_mu: Array
    errors: Array
    effects: tuple[Effect, ...]
    stated: Array

    def linearised(
        self, sweep: Sweep, parameters: Array, weight: Array, response: Array
    ) -> LinearModel:
        """Linearise the data over their standard errors about simulated runs, all errors unknown.

        `response` (n,) is the sensitivity to effects and scatter. It changes only when the
        hyperparameters are chosen again.
        """
        scale = np.sqrt(weight) / self.errors
        return LinearModel(
            J=sweep.J * scale[:, None],
            y=(self.log_mu - sweep.log_mu + sweep.J @ parameters) * scale,
            bending=self.curves.bending(),
            difference=self.curves.difference(),
            response=response / self.errors,
            effects=[effect.columns * (scale * response)[:, None] for effect in self.effects],
            before=[effect.before for effect in self.effects],
            stated=self.stated * scale[:, None],
        )


@dataclass(frozen=True, slots=True)
class _Fit:
    """End of the iteration: parameters after the last step, model and weights used for it."""

    parameters: Array
    model: LinearModel
    smoothness: Smoothness
    weight: Array
    log_mu_before: Array
    iterations: int
    still_changing: float = 0.0


def _gauss_newton(problem: _Problem, start: Array) -> _Fit:
    """Iterate with damping; choose weights and hyperparameters again a few times, then freeze them.

    Each step decreases the penalised misfit with the weights and hyperparameters from which it was
    computed, so that the iteration cannot cycle. They are chosen again only if the linear model was
    just valid for a whole step, or if the misfit decreases no further.
    """
    chosen = Smoothness(bending=10.0, difference=10.0, noise_scale=1.0)
    parameters, weight = start, np.ones(problem.log_mu.size)
    residual = np.zeros(problem.log_mu.size)  # in standard errors
    share, change, choices, iteration = 1.0, np.inf, 0, 0
    try:
        sweep = sweep_with_slopes(problem.rig, problem.curves, parameters)
        log_mu_before, response = sweep.log_mu, sweep.response
        for iteration in range(1, MOST_ITERATIONS + 1):
            fresh = choices < CHOICES and share in (0.0, 1.0)
            if fresh:
                weight, response, choices = _weights(residual), sweep.response, choices + 1
            model = problem.linearised(sweep, parameters, weight, response)
            if fresh:
                chosen = choose_smoothness(model, chosen)
            surface = model.solve_surface(chosen)
            scale = np.sqrt(weight) / problem.errors
            residual = model.residual(model.solve(chosen))
            residual = residual / np.sqrt(weight * model.variance(chosen))
            step = surface.parameters - parameters
            # effect of the step on the data: knots that carry no load may drift
            change = float(np.max(np.abs(sweep.J @ step)))
            merit = _Merit(problem, model, chosen, model.shifts(surface), scale)
            share, ended = 0.0, change <= TOLERANCE
            if not ended:
                share, sweep = merit.descend(parameters, step, sweep)
                parameters = parameters + share * step
                ended = share == 0.0 and merit.along(step) <= NOTHING
            if ended and (fresh or choices == CHOICES):
                return _Fit(parameters, model, chosen, weight, log_mu_before, iteration)
            if share == 0.0 and choices == CHOICES:
                break
    except BeltidError as error:
        raise ConvergenceError(
            [f"refined surface, iteration {iteration}: {line}" for line in error.problems],
            iterations=iteration,
            residual=change,
        ) from error
    if change <= NEARLY:
        return _Fit(parameters, model, chosen, weight, log_mu_before, iteration, change)
    raise ConvergenceError(
        f"refined surface: no convergence in {iteration} iterations (last change of mu "
        f"{100 * change:.2g} %)",
        iterations=iteration,
        residual=change,
    )


@dataclass(frozen=True, slots=True)
class _Merit:
    """The penalised misfit of simulated runs with fixed effects, weights and hyperparameters."""

    problem: _Problem
    model: LinearModel
    smoothness: Smoothness
    shifts: Array
    scale: Array

    def at(self, sweep: Sweep, parameters: Array) -> float:
        """Compute the misfit of runs simulated with given parameters."""
        residual = (self.problem.log_mu - sweep.log_mu) * self.scale - self.shifts
        return self.model.misfit(residual, parameters, self.smoothness)

    def along(self, step: Array) -> float:
        """Compute the decrease of the misfit of the linear model by a Gauss-Newton step.

        It is the square of the step in standard errors of the solution.
        """
        return self.model.misfit(self.model.J @ step, step, self.smoothness)

    def descend(self, parameters: Array, step: Array, sweep: Sweep) -> tuple[float, Sweep]:
        """Find the largest share of a step, 1, 1/2, ..., with enough decrease, and its runs.

        Raises
        ------
        BeltidError
            If the runs cannot be simulated with the shortest share.
        """
        initial, required = self.at(sweep, parameters), 2.0 * DECREASE * self.along(step)
        share = min(1.0, LARGEST_CHANGE / float(np.max(np.abs(sweep.J @ step))))
        for last in np.arange(HALVINGS) == HALVINGS - 1:
            trial = parameters + share * step
            try:
                trial_sweep = sweep_with_slopes(self.problem.rig, self.problem.curves, trial)
            except BeltidError:
                if last:
                    raise
            else:
                if self.at(trial_sweep, trial) <= initial - share * required:
                    return share, trial_sweep
            share *= 0.5
        return 0.0, sweep


def _weights(misfit: Array) -> Array:
    """Compute weights that are smaller for outliers, judged by the median misfit."""
    scale = max(1.4826 * float(np.median(np.abs(misfit))), SMALLEST_SCALE)
    return np.square(OUTLIER / np.maximum(np.abs(misfit) / scale, OUTLIER))


def _knots(lowest: float, low: float, high: float) -> Array:
    """Place knots in ln f: as many as nodes over the surface, and more down to the lowest force.

    With fewer knots than nodes, the covariance of the nodes would be singular.
    """
    inside, gap = np.linspace(low, high, KNOTS, retstep=True)
    below = low - gap * np.arange(math.ceil((low - lowest) / gap), 0, -1)
    return np.concatenate([below, inside])


def _tabulated(
    curves: Curves, parameters: Array, covariance: Array, forces: Array
) -> FrictionSurface:
    """Tabulate the curves on a grid of forces (nf,) [N/m] and speeds, with standard errors."""
    basis = curves.basis(np.log(forces))
    shape = curves.log_speed.size, curves.log_force.size
    mu = np.exp(basis @ parameters.reshape(shape).T)
    variance = np.einsum("nk,jkjl,nl->nj", basis, covariance.reshape(shape * 2), basis)
    return FrictionSurface(forces, np.exp(curves.log_speed), mu, mu * np.sqrt(variance))

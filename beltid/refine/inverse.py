"""Refine a friction surface: find mu(f_N, v) with which the simulated rig gives what was measured.

The published procedure gives each measured coefficient the mean force of Eq. (8), which ignores
bending: peaks of the force where the belt enters and leaves the pulley. Here the rig is simulated
(its sliding limit, with sensitivities), and the surface is solved for by Gauss–Newton so that Eq.
(6), applied to the simulated tensions, gives each measured coefficient. The shape of the surface is
free; its smoothness is chosen by the data (:mod:`beltid.refine.evidence`), and so is what shifts
the friction beside it (:mod:`beltid.refine.effects`).

Errors that runs share have stated standard uncertainties. The data say how large the effects are
that those errors do not explain: what an arc set wrongly does to the runs at that arc is counted
once, as the stated error. The surface itself does not follow what the runs say of the errors: a
bench without them would lose accuracy, as the traces of such an error and of a model error are
alike. It follows the effects alone, in the size that the stated errors leave them;
:mod:`beltid.uncertainty.refined` has what errors do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.errors import BeltidError, ConvergenceError, InputError
from beltid.laws.friction_surface import FrictionSurface
from beltid.refine.curves import Curves
from beltid.refine.effects import STATED, Effect, FoundEffect, campaign_effects
from beltid.refine.evidence import (
    SMALLEST_SCALE,
    LinearModel,
    Smoothness,
    choose_smoothness,
    log_evidence_for,
    log_posterior,
)
from beltid.refine.rig_runs import (
    MeasuredRun,
    RigRuns,
    Sweep,
    acting_forces,
    mesh_of,
    sweep_with_slopes,
)
from beltid.rigsim.model import Bench

__all__ = ["MeasuredRun", "RefinedSurface", "refine_surface"]

Array = NDArray[np.float64]

KNOTS = 12  # over the range of the surface
FINER_MESH = 1.5  # elements over the default: the mesh must not add a bias of its own
MODEL_ERROR = 2.0e-4
"""Relative error of a simulated coefficient, added to the measured one.

A mesh four times finer changes it by 0.002 to 0.02 %, and an independent model is 0.007 % off. More
than that would take weight from quiet runs and give it to noisy ones: the noise scale, which is
common to all, then comes out too small."""
MOST_ITERATIONS = 40
TOLERANCE = 1.0e-5  # change of ln mu at which the iteration ends
LARGEST_CHANGE = 0.5  # of ln mu of a run in one iteration
CHOICES = 6  # iterations in which weights and smoothness are chosen anew
DECREASE = 1.0e-4  # of the misfit, over that of its tangent, that a step must bring (Armijo)
HALVINGS = 7  # of a step until it counts as no step at all
NOTHING = 0.1  # of the misfit left to gain, a third of a standard error, where no share goes down
OUTLIER = 3.5  # misfit in standard errors beyond which a run loses weight


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
    errors : ndarray, shape (n,)
        Standard errors of ln mu of the runs as the fit took them: noise scale, scatter from run to
        run and weight are in.
    noise_scale : float
        How many times their stated standard errors the runs scatter about the surface and the
        effects beside it, root mean square [-].
    J, gain : ndarray, shape (n, size), (size, n)
        Derivatives of ln mu of the runs by the parameters, and of the parameters by ln mu of the
        runs: how the solution follows its data.
    speed_slope : ndarray, shape (n,)
        Derivative of the simulated ln mu by ln v of the run.
    pull : ndarray, shape (size, size)
        Derivatives of the parameters by a force on them: ``gain J = 1 - pull roughness``.
    roughness : ndarray, shape (size, size)
        Quadratic form that was added to the misfit.
    effects : tuple of FoundEffect
        What shifts the friction beside the surface. What a whole effect has in common with the
        surface is not seen; it is in the covariance of both.
    effects_covariance : ndarray, shape (K, K)
        Covariance of the numbers of all effects, in their order; what stated errors leave open of
        them is in it.
    stated : FoundEffect or None
        The errors that runs share as the runs show them, in units of their stated standard
        uncertainties; the surface does not follow these values. None where no error was stated.
    model : LinearModel
        The linear model about the solution by which the hyperparameters were chosen.
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
    errors: Array
    noise_scale: float
    J: Array
    gain: Array
    speed_slope: Array
    pull: Array
    roughness: Array
    effects: tuple[FoundEffect, ...]
    effects_covariance: Array
    stated: FoundEffect | None
    model: LinearModel

    def effect(self, key: str) -> FoundEffect | None:
        """One of the effects; None if the runs cannot show it."""
        return next((found for found in self.effects if found.effect.key == key), None)

    @property
    def log_evidence(self) -> float:
        """Logarithm of the probability of the data given the bench, up to a constant.

        Surface and effects are integrated out, the hyperparameters are at their best. The constant
        is the same for all benches.
        """
        # a weight below 1 is a run of a larger variance
        weights = 0.5 * float(np.log(self.weight).sum())
        return log_posterior(self.model, self.smoothness) + weights

    def log_evidence_for(self, *keys: str) -> float:
        """Logarithm of how much more probable the runs are with some effects than without them.

        Near zero or below where the surface, other effects and stated errors explain as much.
        """
        mine = [k for k, found in enumerate(self.effects) if found.effect.key in keys]
        return log_evidence_for(self.model, self.smoothness, mine)

    @property
    def columns_of_effects(self) -> dict[str, Array]:
        """What each number of an effect does to ln mu of the friction of the runs, (n, K_e)."""
        return {found.effect.key: found.effect.columns for found in self.effects}

    @property
    def response(self) -> Array:
        """Derivative of ln mu of the runs (n,) by ln of a factor on the whole surface."""
        return np.asarray(self.J.sum(axis=1))


def refine_surface(
    bench: Bench,
    runs: Sequence[MeasuredRun],
    speeds: Array,
    nodes: int = 12,
    *,
    stated: Array | None = None,
    reference_degC: float | None = None,
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
    stated : ndarray, shape (n, K), optional
        Change of measured less simulated ln mu of each run by one standard uncertainty of each
        error that runs share. The effects are what they do not explain.
    reference_degC : float, optional
        Temperature to which the surface is corrected [°C]; by default it is that of the runs.

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
    forces = np.geomspace(low, high, nodes)
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
    shared = Effect(STATED, np.zeros((len(runs), 0)) if stated is None else stated)
    problem = _Problem(rig, curves, measured, errors, effects, shared)
    fit = _gauss_newton(problem, start)
    last = sweep_with_slopes(rig, curves, fit.parameters)
    variance = fit.model.variance(fit.smoothness)
    solution = fit.model.solve_surface(fit.smoothness)
    found = _found((*effects, shared), fit.model, fit.smoothness)
    return RefinedSurface(
        surface=_tabulated(curves, fit.parameters, solution.covariance, forces),
        curves=curves,
        parameters=fit.parameters,
        covariance=solution.covariance,
        smoothness=fit.smoothness,
        effective_parameters=fit.model.effective_parameters(fit.smoothness),
        iterations=fit.iterations,
        misfit_before=np.expm1(fit.log_mu_before - measured),
        misfit_after=np.expm1(last.log_mu - measured),
        weight=fit.weight,
        force_range=acting[:, 1:],
        errors=errors * np.sqrt(variance / fit.weight),
        noise_scale=float(np.sqrt(np.mean(variance))),
        J=last.J,
        gain=solution.gain * (np.sqrt(fit.weight) / errors),
        speed_slope=last.speed_slope,
        pull=solution.pull,
        roughness=fit.model.roughness(fit.smoothness),
        effects=found[:-1],
        effects_covariance=solution.effects_covariance,
        stated=None if stated is None else found[-1],
        model=fit.model,
    )


def _found(
    effects: Sequence[Effect], model: LinearModel, smoothness: Smoothness
) -> tuple[FoundEffect, ...]:
    """The numbers of each effect, with the surface and all others unknown."""
    solution, found, first = model.solve(smoothness), [], 0
    parts = zip(effects, smoothness.effects, model.effects, strict=True)
    for effect, size, columns in parts:
        mine = slice(first, first + effect.columns.shape[1])
        covariance = solution.effects_covariance[mine, mine]
        explained = model.explained_by_surface(smoothness, columns)
        found.append(FoundEffect(effect, size, solution.effects[mine], covariance, explained))
        first = mine.stop
    return tuple(found)


@dataclass(frozen=True, slots=True)
class _Problem:
    """The runs on the simulated rig, and what was measured of them, arrays (n,)."""

    rig: RigRuns
    curves: Curves
    log_mu: Array
    errors: Array
    effects: tuple[Effect, ...]
    stated: Effect

    def linearised(
        self, sweep: Sweep, parameters: Array, weight: Array, response: Array
    ) -> LinearModel:
        """The data over their standard errors, linear about simulated runs, all errors unknown.

        `response` (n,) is what effects and scatter act by; it rests with the hyperparameters.
        """
        scale = np.sqrt(weight) / self.errors
        return LinearModel(
            J=sweep.J * scale[:, None],
            y=(self.log_mu - sweep.log_mu + sweep.J @ parameters) * scale,
            bending=self.curves.bending(),
            difference=self.curves.difference(),
            response=response / self.errors,
            effects=[
                *(effect.columns * (scale * response)[:, None] for effect in self.effects),
                self.stated.columns * scale[:, None],
            ],
            before=[effect.before for effect in (*self.effects, self.stated)],
        )


@dataclass(frozen=True, slots=True)
class _Fit:
    """Where the iteration ended: the last step is in, model and weights are those behind it."""

    parameters: Array
    model: LinearModel
    smoothness: Smoothness
    weight: Array
    log_mu_before: Array
    iterations: int


def _gauss_newton(problem: _Problem, start: Array) -> _Fit:
    """Damped iteration; weights and hyperparameters are chosen anew a few times, then they rest.

    Each step goes down the penalised misfit with the weights and hyperparameters that made it, so
    that the iteration cannot go in circles. They are chosen anew only where the linear model that
    they are chosen by has just held for a whole step, or at the end of the way down.
    """
    chosen = Smoothness(bending=10.0, difference=10.0, noise_scale=1.0)
    parameters, weight, left = start, np.ones(problem.log_mu.size), np.zeros(problem.log_mu.size)
    share, change, choices, iteration = 1.0, np.inf, 0, 0
    try:
        sweep = sweep_with_slopes(problem.rig, problem.curves, parameters)
        log_mu_before, response = sweep.log_mu, sweep.response
        for iteration in range(1, MOST_ITERATIONS + 1):
            fresh = choices < CHOICES and share in (0.0, 1.0)
            if fresh:
                weight, response, choices = _weights(left), sweep.response, choices + 1
            model = problem.linearised(sweep, parameters, weight, response)
            if fresh:
                chosen = choose_smoothness(model, chosen)
            surface = model.solve_surface(chosen)
            scale = np.sqrt(weight) / problem.errors
            left = model.residual(model.solve(chosen)) / np.sqrt(weight * model.variance(chosen))
            step = surface.parameters - parameters
            # what the data see of the step: knots that carry no load may drift
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
    raise ConvergenceError(
        f"refined surface: no convergence in {iteration} iterations (last change of mu "
        f"{100 * change:.2g} %)",
        iterations=iteration,
        residual=change,
    )


@dataclass(frozen=True, slots=True)
class _Merit:
    """The penalised misfit of simulated runs; effects, weights, hyperparameters are frozen."""

    problem: _Problem
    model: LinearModel
    smoothness: Smoothness
    shifts: Array
    scale: Array

    def at(self, sweep: Sweep, parameters: Array) -> float:
        """Misfit of runs simulated with some parameters."""
        left = (self.problem.log_mu - sweep.log_mu) * self.scale - self.shifts
        return self.model.misfit(left, parameters, self.smoothness)

    def along(self, step: Array) -> float:
        """What a Gauss-Newton step would take off the misfit of the linear model.

        It is the square of the step in standard errors of the solution.
        """
        return self.model.misfit(self.model.J @ step, step, self.smoothness)

    def descend(self, parameters: Array, step: Array, sweep: Sweep) -> tuple[float, Sweep]:
        """The longest share of a step, 1, 1/2, ..., that goes down far enough, and the runs there.

        Raises
        ------
        BeltidError
            If the runs cannot be simulated with the shortest share.
        """
        before, wanted = self.at(sweep, parameters), 2.0 * DECREASE * self.along(step)
        share = min(1.0, LARGEST_CHANGE / float(np.max(np.abs(sweep.J @ step))))
        for last in np.arange(HALVINGS) == HALVINGS - 1:
            moved = parameters + share * step
            try:
                found = sweep_with_slopes(self.problem.rig, self.problem.curves, moved)
            except BeltidError:
                if last:
                    raise
            else:
                if self.at(found, moved) <= before - share * wanted:
                    return share, found
            share *= 0.5
        return 0.0, sweep


def _weights(misfit: Array) -> Array:
    """Weights that fall for runs far off, judged by the median misfit: few cannot hide in it."""
    scale = max(1.4826 * float(np.median(np.abs(misfit))), SMALLEST_SCALE)
    return np.square(OUTLIER / np.maximum(np.abs(misfit) / scale, OUTLIER))


def _knots(lowest: float, low: float, high: float) -> Array:
    """Knots in ln f: as many as nodes over the range of the surface, and on to the lowest force.

    Where there are fewer knots than nodes the covariance of the nodes is singular.
    """
    inside, gap = np.linspace(low, high, KNOTS, retstep=True)
    below = low - gap * np.arange(math.ceil((low - lowest) / gap), 0, -1)
    return np.concatenate([below, inside])


def _tabulated(
    curves: Curves, parameters: Array, covariance: Array, forces: Array
) -> FrictionSurface:
    """The curves on a grid of forces (nf,) [N/m] and speeds, with standard errors."""
    basis = curves.basis(np.log(forces))
    k = curves.log_force.size
    mu = np.exp(basis @ parameters.reshape(-1, k).T)
    se = np.empty_like(mu)
    for j in range(curves.log_speed.size):
        block = covariance[j * k : (j + 1) * k, j * k : (j + 1) * k]
        se[:, j] = mu[:, j] * np.sqrt(np.einsum("nk,kl,nl->n", basis, block, basis))
    return FrictionSurface(forces, np.exp(curves.log_speed), mu, se)

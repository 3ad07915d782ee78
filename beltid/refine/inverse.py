"""Refine a friction surface: find mu(f_N, v) for which the simulated rig matches the measurements.

The published procedure assigns each measured coefficient to the mean force of Eq. (8), which has no
peaks by bending where the belt enters and leaves the pulley. Here the rig is simulated (its sliding
limit, with sensitivities), and Gauss–Newton finds the surface for which Eq. (6), applied to the
simulated tensions, gives each measured coefficient. The data determine its smoothness and the other
effects on friction (:mod:`beltid.refine.posterior`).

An error e of the bench changes the surface by G de, with the gain G of the solution (implicit
differentiation of least squares) and the change de of measured minus simulated ln mu: without a new
fit. The bending stiffness counts with the error that the runs leave to it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from beltid.errors import BeltidError, ConvergenceError, InputError, percent
from beltid.identify.agreement import FEWEST_RUNS
from beltid.laws.friction_surface import FrictionSurface
from beltid.mixed import Posterior
from beltid.refine.posterior import (
    SCATTER,
    SHARED_ERRORS,
    Curves,
    Effect,
    EstimatedEffect,
    LinearRuns,
    Sizes,
    campaign_effects,
)
from beltid.uncertainty.measured import Measured
from beltid.uncertainty.rig_runs import Campaign, RigRuns, input_slopes, residual_changes
from beltid.uncertainty.sources import (
    ARC,
    COURSE,
    FITTED,
    ORDER,
    TEMPERATURE,
    Source,
    SurfaceUncertainty,
    effect_sources,
    factor_of,
)

Array = NDArray[np.float64]

KNOTS: Final = 12  # over the range of the surface, and its nodes over the force
MESHES: Final = (1.5, 3.0)
"""Numbers of elements over the default, so that the mesh adds no bias; the second where the first
does not converge: contact points that come and go make the misfit of very quiet runs rough."""
MODEL_ERROR: Final = 2.0e-4
"""Relative error of a simulated coefficient: a mesh four times finer changes it by 0.002 to 0.02 %,
an independent model differs by 0.007 %."""
SHARES: Final = (5.0e-4, 5.0e-3)
"""Shares of a run's normal load that act below the lowest knot, where the nearest value applies (a
share of 0.5 % made the surface 0.02 to 0.04 % too high), and below the range of the surface."""
MOST_ITERATIONS: Final = 40
TOLERANCE: Final = 1.0e-5  # change of ln mu at which the iteration ends
NEARLY: Final = 1.0e-4  # change of ln mu up to which a result is used with a warning
LARGEST_CHANGE: Final = 0.5  # largest change of ln mu of a run in one iteration
CHOICES: Final = 6  # number of iterations that choose weights and sizes again
DECREASE: Final = 1.0e-4  # required decrease of the misfit over that of its tangent (Armijo)
HALVINGS: Final = 7  # halvings of a step before it is given up
NOTHING: Final = 0.1  # misfit left to gain that is negligible: a third of a standard error
OUTLIER: Final = 3.5  # misfit in standard errors beyond which a run loses weight
LEAST_SCALE: Final = 0.5  # of the median misfit, by which outliers are judged


@dataclass(frozen=True, slots=True)
class RefinedSurface:
    """Solution of the inverse problem."""

    surface: FrictionSurface  # with the standard errors of its nodes by scatter and effects
    curves: Curves  # the splines from which the surface was tabulated
    parameters: Array  # ln mu at the knots, speed by speed, (size,)
    campaign: Campaign  # its runs, with the effects that they show
    stated: tuple[Source, ...]  # errors that runs share, as stated
    sources: tuple[Source, ...]
    """The same, less what the runs show of the bending stiffness; then the effects."""
    changes: Array  # change of the parameters by one standard uncertainty of each source, (size, K)
    scatter: Array  # covariance by scatter from run to run and what is smoothed away, (size, size)
    runs: LinearRuns  # the runs, linearised about the solution, with the errors that they share
    fit: Fit  # end of the iteration, whose posterior is the estimate of surface and effects
    told: Posterior  # what the runs say of the errors that they share as well
    iterations: int  # Gauss–Newton iterations
    misfit_before: Array  # simulated over measured mu minus one, with the initial surface, (n,)
    misfit_after: Array  # with the refined one
    effects: tuple[EstimatedEffect, ...]  # effects on the friction apart from the surface
    effects_covariance: Array  # of all their numbers, by noise and errors that runs share, (K', K')

    @property
    def sizes(self) -> Sizes:
        """Sizes that the data chose: of noise, scatter, curve, difference, effects."""
        return self.fit.posterior.sizes

    @property
    def noise_scale(self) -> float:
        """Scatter of the runs about surface and effects in stated standard errors (RMS) [-]."""
        ratio = self.runs.variance(self.sizes) / np.square(self.runs.errors)
        return float(np.sqrt(np.mean(ratio)))

    @property
    def effective_parameters(self) -> float:
        """Number of parameters that the data determine."""
        X = self.fit.posterior.model.X[:, 0]
        return float(np.sum(self.runs.gain(self.fit.posterior) * X.T))

    @property
    def uncertainty(self) -> SurfaceUncertainty:
        """Covariance of ln mu at the nodes by its causes."""
        forces = self.surface.normal_force_N_m
        return SurfaceUncertainty(
            surface=self.surface,
            sources=self.sources,
            changes=self.curves.at_nodes(forces, self.changes),
            scatter=self.curves.at_nodes(forces, factor_of(self.scatter)),
            arcs_deg=self.campaign.measured.arcs_deg,
            degrees_of_freedom=max(self.fit.weight.size - self.effective_parameters, 1.0),
        )

    def stated_errors(self) -> tuple[Array, Array]:
        """Return mean and standard deviation of each stated error by the runs (K'').

        Both are in stated standard uncertainties.
        """
        if not self.stated:
            return np.zeros(0), np.zeros(0)
        mean, covariance = self.told.of(SHARED_ERRORS)
        return mean, np.sqrt(np.diag(covariance))

    def convergence_warnings(self) -> tuple[str, ...]:
        """Return a sentence for each iteration that did not converge."""
        sizes = "the search for the sizes of noise and effects did not end: the errors may be wrong"
        changing = (
            f"no convergence in {self.iterations} iterations: last change of mu "
            f"{percent(100 * self.fit.still_changing)}, must be at most {percent(100 * TOLERANCE)}"
        )
        happened = {sizes: not self.fit.posterior.converged, changing: self.fit.still_changing > 0}
        return tuple(line for line, is_so in happened.items() if is_so)

    def effect(self, key: str) -> EstimatedEffect | None:
        """Look up an effect by its key; None if the runs cannot show it."""
        return next((entry for entry in self.effects if entry.effect.key == key), None)


def refine_surface(
    campaign: Campaign,
    speeds: Array,
    sources: Sequence[Source] = (),
    reference_degC: float | None = None,
) -> RefinedSurface:
    """Find the surface for which the simulated rig gives every measured coefficient.

    Parameters
    ----------
    campaign : Campaign
        Runs at all arcs, and bench with the initial surface (from the published procedure).
    speeds : ndarray, shape (m,)
        Speed settings [m/s], increasing; each run belongs to the nearest one.
    sources : sequence of Source
        Errors that runs share.
    reference_degC : float, optional
        Temperature to which the surface is corrected [°C]; by default that of the runs.

    Raises
    ------
    InputError
        If there are too few runs.
    ConvergenceError
        If a run cannot be simulated, or the iteration does not converge.
    """
    measured, n = campaign.measured, campaign.measured.mu.size
    if n < FEWEST_RUNS:
        raise InputError(f"{n} runs to refine a surface from, at least {FEWEST_RUNS} are needed")
    effects = campaign_effects(measured, reference_degC)
    try:
        problem, first, fit = _solved(campaign, speeds, effects, MESHES[0])
    except ConvergenceError:
        problem, first, fit = _solved(campaign, speeds, effects, MESHES[1])
    B, posterior, q = problem.B, fit.posterior, len(problem.B)
    parameters, changes = B @ fit.coordinates, np.zeros((n, 0))
    if sources:
        by_speed, surfaces = fit.sweep.speed_slope, problem.curves.surfaces(parameters)
        slopes = input_slopes(campaign, surfaces, problem.rig.speeds, by_speed)
        changes = residual_changes(campaign, sources, slopes, by_speed)
    runs = replace(fit.runs, shared=-changes)
    told = runs.model().at(posterior.sizes)
    left = _left_by_the_runs(sources, told)
    changes = changes * [share for _, share in left]
    gain = runs.gain(posterior)
    estimated, shifted, by_effect = [], measured, [np.zeros((n, 0))]
    added: list[Source] = []
    for effect, of_runs in zip(effects, (e.columns for e in runs.effects), strict=True):
        values, size = posterior.of(effect.key)[0], posterior.sizes[effect.key]
        weight = np.square(values) * np.mean(np.square(effect.columns), axis=0)
        share = runs.explained(of_runs, posterior.sizes)
        explained = float(np.average(share, weights=weight if np.any(weight) else None))
        estimated.append(EstimatedEffect(effect, values, explained))
        shifted = replace(shifted, columns={**shifted.columns, effect.key: of_runs})
        added += effect_sources(effect.key, size, values.size)
        by_effect.append(size * of_runs)
    by_source = B @ gain[:q] @ np.hstack([changes, *by_effect])
    smoothed = np.eye(q) - gain[:q] @ runs.X
    scatter = gain[:q] * runs.variance(posterior.sizes) @ gain[:q].T
    scatter = scatter + smoothed * runs.prior_variance(posterior.sizes) @ smoothed.T
    scatter = B @ scatter @ B.T
    of_effects = by_source[:, len(sources) :]
    by_errors = gain[q:] @ changes
    return RefinedSurface(
        surface=problem.tabulated(parameters, scatter + of_effects @ of_effects.T),
        curves=problem.curves,
        parameters=parameters,
        campaign=replace(campaign, measured=shifted),
        stated=tuple(sources),
        sources=(*(source for source, _ in left), *added),
        changes=by_source,
        scatter=scatter,
        runs=runs,
        fit=fit,
        told=told,
        iterations=first.iterations + fit.iterations,
        misfit_before=np.expm1(first.log_mu_before - problem.log_mu),
        misfit_after=np.expm1(fit.sweep.log_mu - problem.log_mu),
        effects=tuple(estimated),
        effects_covariance=posterior.covariance[q:, q:] + by_errors @ by_errors.T,
    )


def _solved(
    campaign: Campaign, speeds: Array, effects: tuple[Effect, ...], finer: float
) -> tuple[Problem, Fit, Fit]:
    """Solve on a mesh, twice: the second time with the knots where forces act with the first."""
    measured, bench = campaign.measured, campaign.bench
    rig = RigRuns(campaign, speeds, finer)
    empty = [f"{v:g} m/s" for j, v in enumerate(rig.speeds) if not np.any(rig.label == j)]
    if empty:
        raise InputError(f"no run at the speeds {', '.join(empty)}")
    problem = Problem.of(rig, bench.surface, measured, effects)
    first = problem.solved(bench.surface)
    start = problem.tabulated(problem.B @ first.coordinates)
    problem = Problem.of(rig, start, measured, effects)
    return problem, first, problem.solved(start)


def _left_by_the_runs(sources: Sequence[Source], told: Posterior) -> list[tuple[Source, float]]:
    """Return each source with the share of its standard uncertainty that the runs leave to it."""
    left = []
    for k, source in enumerate(sources):
        share = 1.0
        if source.error == "bending_stiffness":
            mean, covariance = told.of(SHARED_ERRORS)
            share = min(1.0, math.hypot(mean[k], math.sqrt(covariance[k, k])))
            source = replace(source, size=share * source.size, basis=FITTED)
        left.append((source, share))
    return left


@dataclass(frozen=True, slots=True)
class Sweep:
    """All runs simulated with one surface."""

    tight: Array  # tensions [N], (n,)
    slack: Array
    log_mu: Array  # logarithms of the coefficients at the speed of each run, (n,)
    J: Array  # derivatives of ``log_mu`` with respect to the parameters, (n, size)
    speed_slope: Array  # derivative of ``log_mu`` with respect to ln v of the run, (n,)


def sweep(rig: RigRuns, curves: Curves, parameters: Array) -> Sweep:
    """Simulate every run with the surface of its speed and compute the derivatives."""
    n, k = rig.label.size, curves.log_force.size
    J, speed_slope = np.zeros((n, parameters.size)), np.zeros(n)
    # small deviations from the speed of the group are corrected by the slope between the speeds
    by_speed = np.zeros((curves.log_speed.size, k))
    if curves.log_speed.size > 1:
        gradient = np.gradient(curves.by_speed(parameters), curves.log_speed, axis=0)
        by_speed = np.asarray(gradient, dtype=float)
    runs = rig.slide(curves.surfaces(parameters))
    for i, run in enumerate(runs):
        j = int(rig.label[i])
        row = run.weight @ curves.basis(np.log(run.force))
        J[i, j * k : (j + 1) * k] = row
        speed_slope[i] = float(row @ by_speed[j])
    tight, slack, mu = np.array([(run.tight, run.slack, run.mu) for run in runs]).T
    return Sweep(tight, slack, np.log(mu) + rig.off_speed * speed_slope, J, speed_slope)


def acting_forces(rig: RigRuns, start: FrictionSurface) -> Array:
    """Return line forces at each speed (m, 3) [N/m]: limits of both :data:`SHARES`, and peak."""
    acting = np.empty((rig.label.size, 3))
    for i, run in enumerate(rig.slide([start] * rig.speeds.size)):
        order = np.argsort(run.force)
        share = np.cumsum(run.load[order])
        acting[i, :2] = np.interp(SHARES, share / share[-1], run.force[order])
        acting[i, 2] = run.force.max()
    by_speed = [acting[rig.label == j] for j in range(rig.speeds.size)]
    return np.array([[*of.min(axis=0)[:2], of[:, 2].max()] for of in by_speed])


@dataclass(frozen=True, slots=True)
class Fit:
    """End of the iteration: coordinates after the last step, model and weights used for it."""

    coordinates: Array
    sweep: Sweep
    runs: LinearRuns
    posterior: Posterior
    weight: Array  # of the runs: 1, less for outliers, (n,)
    log_mu_before: Array
    iterations: int
    still_changing: float = 0.0
    """Last change of ln mu of a run without convergence, at most `NEARLY`; else 0."""


@dataclass(frozen=True, slots=True)
class Problem:
    """The runs on the simulated rig and their measured values, arrays (n,).

    `B` are the parameters per unit of each coordinate (size, size), `parts` the place of each part
    of the surface among the coordinates, `forces` the nodes of the surface.
    """

    rig: RigRuns
    curves: Curves
    B: Array
    parts: Mapping[str, slice]
    forces: Array
    log_mu: Array
    errors: Array
    effects: tuple[Effect, ...]

    @classmethod
    def of(
        cls, rig: RigRuns, start: FrictionSurface, measured: Measured, effects: tuple[Effect, ...]
    ) -> Self:
        """Place knots and nodes where forces act with a surface."""
        acting = acting_forces(rig, start)
        lowest, low, high = acting[:, 0].min(), acting[:, 1].min(), acting[:, 2].max()
        # as many knots as nodes over the surface, and more down to the lowest force
        bottom, first, last = np.log([lowest, low, high]).tolist()
        inside, gap = np.linspace(first, last, KNOTS, retstep=True)
        below = first - gap * np.arange(math.ceil((first - bottom) / gap), 0, -1)
        curves = Curves(np.concatenate([below, inside]), np.log(rig.speeds))
        columns = {name: Z for name, Z in curves.coordinates().items() if Z.shape[1]}
        ends = np.cumsum([0, *(Z.shape[1] for Z in columns.values())]).tolist()
        places = zip(columns, ends, ends[1:], strict=False)
        return cls(
            rig=rig,
            curves=curves,
            B=np.hstack(list(columns.values())),
            parts={name: slice(a, b) for name, a, b in places},
            forces=np.geomspace(low, high, KNOTS),
            log_mu=np.log(measured.mu),
            errors=np.hypot(measured.mu_se / measured.mu, MODEL_ERROR),
            effects=effects,
        )

    def tabulated(self, parameters: Array, covariance: Array | None = None) -> FrictionSurface:
        """Tabulate the curves at the nodes, with standard errors if the covariance is known."""
        mu, se = np.exp(self.curves.at_nodes(self.forces, parameters[:, None])[..., 0]), None
        if covariance is not None:
            factor = self.curves.at_nodes(self.forces, factor_of(covariance))
            se = mu * np.sqrt(np.sum(np.square(factor), axis=-1))
        return FrictionSurface(self.forces, self.rig.speeds, mu, se)

    def linearised(self, done: Sweep, at: Array, weight: Array, response: Array) -> LinearRuns:
        """Linearise the data about simulated runs.

        `response` (n,) is the sensitivity to effects and scatter. It changes only when the sizes
        are chosen again.
        """
        X = done.J @ self.B
        effects = (
            replace(effect, columns=effect.columns * response[:, None]) for effect in self.effects
        )
        y, errors = self.log_mu - done.log_mu + X @ at, self.errors / np.sqrt(weight)
        return LinearRuns(y, X, self.parts, errors, response, tuple(effects))

    def solved(self, start: FrictionSurface) -> Fit:
        """Iterate with damping; choose weights and sizes again a few times, then freeze them.

        Each step decreases the penalised misfit with its weights and sizes. They are chosen again
        only if the linear model was just valid for a whole step, or if the misfit decreases no
        further.
        """
        log_mu = np.log(start.mu(np.exp(self.curves.log_force), self.rig.speeds[:, None]))
        at = np.asarray(np.linalg.solve(self.B, log_mu.ravel()), dtype=float)
        weight, residual = np.ones(self.log_mu.size), np.zeros(self.log_mu.size)
        sizes: dict[str, float] = {}
        converged, share, change, choices, iteration = True, 1.0, np.inf, 0, 0
        try:
            done = sweep(self.rig, self.curves, self.B @ at)
            before, response = done.log_mu, done.J.sum(axis=1)
            for iteration in range(1, MOST_ITERATIONS + 1):
                fresh = choices < CHOICES and share in (0.0, 1.0)
                if fresh:
                    weight, response = _weights(residual), done.J.sum(axis=1)
                    choices += 1
                runs = self.linearised(done, at, weight, response)
                posterior = runs.choose(sizes) if fresh else runs.model().at(sizes)
                converged = posterior.converged if fresh else converged
                sizes, posterior = posterior.sizes, replace(posterior, converged=converged)
                residual = posterior.residual[:, 0] / np.sqrt(weight * runs.variance(sizes))
                step = posterior.mean[: at.size] - at
                # effect of the step on the data: knots that carry no load may drift
                change = float(np.max(np.abs(runs.X @ step)))
                share, ended = 0.0, change <= TOLERANCE
                if not ended:
                    share, at, done = self._descend(at, step, done, runs, sizes)
                    gain = runs.misfit(runs.X @ step, step, sizes)
                    ended = share == 0.0 and gain <= NOTHING
                if ended and (fresh or choices == CHOICES):
                    return Fit(at, done, runs, posterior, weight, before, iteration)
                if share == 0.0 and choices == CHOICES:
                    break
        except BeltidError as error:
            raise ConvergenceError(
                [f"refined surface, iteration {iteration}: {line}" for line in error.problems],
            ) from error
        if change <= NEARLY:
            return Fit(at, done, runs, posterior, weight, before, iteration, change)
        raise ConvergenceError(
            f"refined surface: no convergence in {iteration} iterations (last change of mu "
            f"{100 * change:.2g} %)",
        )

    def _descend(
        self, at: Array, step: Array, done: Sweep, runs: LinearRuns, sizes: Sizes
    ) -> tuple[float, Array, Sweep]:
        """Take the largest share of a step, 1, 1/2, ..., with enough decrease; zero if none has."""

        def merit(simulated: Sweep, coordinates: Array) -> float:
            return runs.misfit(self.log_mu - simulated.log_mu, coordinates, sizes)

        initial = merit(done, at)
        required = 2.0 * DECREASE * runs.misfit(runs.X @ step, step, sizes)
        share = min(1.0, LARGEST_CHANGE / float(np.max(np.abs(runs.X @ step))))
        for last in np.arange(HALVINGS) == HALVINGS - 1:
            trial = at + share * step
            try:
                simulated = sweep(self.rig, self.curves, self.B @ trial)
            except BeltidError:
                if last:
                    raise
            else:
                if merit(simulated, trial) <= initial - share * required:
                    return share, trial, simulated
            share *= 0.5
        return 0.0, at, done


def _weights(misfit: Array) -> Array:
    """Compute weights that are smaller for outliers, judged by the median misfit."""
    scale = max(1.4826 * float(np.median(np.abs(misfit))), LEAST_SCALE)
    return np.asarray(np.square(OUTLIER / np.maximum(np.abs(misfit) / scale, OUTLIER)))


TOGETHER: Final = "together"
CLEAR: Final = 3.0  # standard errors beyond which an effect is significant
CONFOUNDED: Final = 0.9  # share explained by force and speed: variance inflated tenfold
LEAST_EVIDENCE: Final = math.log(20.0)
"""Least log evidence of a clear effect: the runs are 20 times as probable with it as without."""


@dataclass(frozen=True, slots=True)
class ShownEffect:
    """An effect of the campaign and its size for the reader."""

    key: str
    """Key of the effect; "scatter" for the friction from run to run, "together" for the change over
    the campaign by run order and temperature if the runs cannot separate the two."""
    size: float
    """Change of ln mu: between the arcs that differ most clearly; from the first run to the last;
    by 10 K; beside the steady change (root mean square); or the standard deviation of scatter."""
    uncertainty: float  # standard uncertainty of the size; nan for the scatter
    arcs_deg: tuple[float, ...] = ()  # with the lower and the higher friction, of an arc effect
    explained: float = math.nan  # share that force and speed of the runs explain; nan for arcs
    log_evidence: float = math.inf  # for the effect, where others may replace it; if it is large

    @property
    def is_confounded(self) -> bool:
        """Whether the runs cannot separate it from the surface."""
        return self.explained > CONFOUNDED

    @property
    def is_large(self) -> bool:
        """Whether it far exceeds its uncertainty and the error of the simulated rig.

        An effect that force and speed explain may as well belong to the surface.
        """
        least = CLEAR * math.hypot(self.uncertainty, MODEL_ERROR)
        return abs(self.size) > least and not self.is_confounded

    @property
    def is_clear(self) -> bool:
        """Whether it is large and nothing else explains the runs equally well."""
        return self.is_large and self.log_evidence > LEAST_EVIDENCE


def contradictions(found: RefinedSurface) -> dict[str, float]:
    """Return errors that contradict their stated size: name -> standard uncertainties."""
    sizes = np.abs(found.stated_errors()[0]).tolist()
    rising = sorted(zip(sizes, found.stated, strict=True), key=lambda pair: pair[0])
    return {source.name: size for size, source in rising if size > CLEAR}


def shown_effects(found: RefinedSurface) -> tuple[ShownEffect, ...]:
    """Return the effects that the runs can show, in a fixed order."""
    values = np.concatenate([np.zeros(0), *(entry.values for entry in found.effects)])
    ends = np.cumsum([0, *(entry.values.size for entry in found.effects)]).tolist()
    columns = {entry.effect.key: entry.effect.columns for entry in found.effects}
    places = zip(columns, ends, ends[1:], strict=False)
    rows = {key: np.eye(values.size)[a:b] for key, a, b in places}

    def change(weights: Array) -> tuple[float, float]:
        """Return a weighted sum of the numbers and its standard uncertainty."""
        w = np.ravel(weights)
        return float(w @ values), float(np.sqrt(w @ found.effects_covariance @ w))

    def weighed(effect: ShownEffect) -> ShownEffect:
        """Add the share that the surface explains and, if it is large, the evidence for it."""
        keys = (ORDER, COURSE, TEMPERATURE) if effect.key == TOGETHER else (effect.key,)
        entry = found.effect(keys[0])
        if entry is not None and effect.key != ARC:
            effect = replace(effect, explained=entry.explained)
        if effect.is_large:  # this takes a search
            effect = replace(effect, log_evidence=found.runs.log_evidence_for(keys))
        return effect

    shown = []
    if ARC in rows:
        arcs_deg, pairs = found.campaign.measured.arcs_deg.tolist(), []
        for low, high in itertools.permutations(range(len(arcs_deg)), 2):
            size = change(rows[ARC][high] - rows[ARC][low])
            pairs.append(ShownEffect(ARC, *size, (arcs_deg[low], arcs_deg[high])))
        shown.append(weighed(max(pairs, key=lambda pair: pair.size / pair.uncertainty)))
    shown += [weighed(ShownEffect(k, *change(rows[k]))) for k in (ORDER, TEMPERATURE) if k in rows]
    if COURSE in rows:
        of_runs = columns[COURSE] @ rows[COURSE]
        size = np.sqrt(np.mean(np.square(of_runs @ values)))
        variance = np.mean(np.einsum("nk,kl,nl->n", of_runs, found.effects_covariance, of_runs))
        shown.append(weighed(ShownEffect(COURSE, float(size), float(np.sqrt(variance)))))
    if ORDER in rows and TEMPERATURE in rows:
        # add the effect of the temperature's linear trend over the campaign
        trend = np.polyfit(columns[ORDER][:, 0], columns[TEMPERATURE][:, 0], 1)[0]
        both = weighed(ShownEffect(TOGETHER, *change(rows[ORDER] + trend * rows[TEMPERATURE])))
        if both.is_clear and not any(e.is_clear for e in shown if e.key != ARC):
            shown.append(both)
    return (*shown, ShownEffect(SCATTER, found.sizes[SCATTER], math.nan))

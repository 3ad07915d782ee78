"""Refine a friction surface: find mu(f_N, v) for which the simulated rig matches the measurements.

The published procedure assigns each measured coefficient to the mean force of Eq. (8), which has no
peaks by bending where the belt enters and leaves the pulley. Here Gauss–Newton finds the surface
for which Eq. (6), applied to the tensions of the simulated rig, gives each measured coefficient.

An error e of the bench changes the surface by G de, with the gain G of the solution (implicit
differentiation of least squares) and the change de of measured minus simulated ln mu: without a new
fit. The bending stiffness counts with the error that the runs leave to it.
"""

import itertools
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np

from beltid.errors import ConvergenceError, NumericsError, percent
from beltid.laws.friction_surface import FrictionSurface
from beltid.mixed import Array, Posterior
from beltid.refine.posterior import (
    IF_CORRECTED,
    PRIORS,
    SCATTER,
    SHARED_ERRORS,
    Curves,
    LinearRuns,
    campaign_effects,
)
from beltid.uncertainty.measured import Measured
from beltid.uncertainty.simulated import Campaign, RigRuns, look_ups, residual_changes
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

KNOTS = 12  # over the range of the surface, and its nodes over the force
MESH = 1.5  # number of elements over the default, so that the mesh adds no bias
MODEL_ERROR = 2.0e-4
"""Relative error of a simulated coefficient: a mesh four times finer changes it by 0.002 to 0.02 %,
an independent model differs by 0.007 %."""
SHARES = (5.0e-4, 5.0e-3)
"""Shares of a run's normal load that act below the lowest knot, where the nearest value applies (a
share of 0.5 % made the surface 0.02 to 0.04 % too high), and below the range of the surface."""
MOST_ITERATIONS, CHOICES = 40, 6  # and how many of them choose weights and sizes again
TOLERANCE, NEARLY = 1.0e-5, 1.0e-4  # change of ln mu at the end; used with a warning
LARGEST_CHANGE = 0.5  # largest change of ln mu of a run in one iteration
DECREASE, HALVINGS = 1.0e-4, 7
"""Decrease of the misfit over that of its tangent that a step needs (Armijo), or it is halved."""
NOTHING = 0.1  # misfit left to gain that is negligible: a third of a standard error
OUTLIER, LEAST_SCALE = 3.5, 0.5
"""Misfit over the median one beyond which a run loses weight; least median, in standard errors."""


@dataclass(frozen=True, slots=True)
class RefinedSurface:
    """Solution of the inverse problem."""

    surface: FrictionSurface
    """With its covariance, and the standard errors of its nodes by scatter and effects."""
    uncertainty: SurfaceUncertainty
    """The covariance by causes; the bending stiffness with what the runs leave of its error."""
    campaign: Campaign
    stated_errors: tuple[tuple[Source, float, float], ...]
    """Each error that runs share as stated, and what the runs say of it: mean and standard
    deviation in standard uncertainties."""
    runs: LinearRuns  # the runs, linearised about the solution, with the errors that they share
    posterior: Posterior  # estimate of surface and effects
    covariance: Array  # of surface and effects, by noise and errors that runs share, (k, k)
    weight: Array  # of the runs: 1, less for outliers, (n,)
    misfit_before: Array  # simulated over measured mu minus one, with the initial surface, (n,)
    misfit_after: Array  # with the refined one
    iterations: int  # Gauss–Newton iterations
    noise_scale: float
    """Scatter of the runs about surface and effects in stated standard errors (RMS) [-]."""
    effective_parameters: float  # number of parameters that the data determine
    warnings: tuple[str, ...]  # a sentence for each iteration that did not converge


def refine_surface(
    campaign: Campaign,
    speeds: Array,
    sources: Sequence[Source] = (),
    reference_degC: float | None = None,
) -> RefinedSurface:
    """Find the surface for which the simulated rig gives every measured coefficient.

    The campaign has runs at all arcs and a bench with the initial surface (from the published
    procedure); each run belongs to the nearest of the `speeds` [m/s], increasing, of which each has
    runs. `sources` are the errors that runs share, `reference_degC` the temperature to which the
    surface is corrected; by default that of the runs. Raises `ConvergenceError` if a run cannot be
    simulated, or if the iteration does not converge.
    """
    measured, rig = campaign.measured, RigRuns(campaign, speeds, MESH)
    first = Problem(rig, campaign.bench.surface, measured, reference_degC).solved()
    # with the knots where forces act with the first solution
    fit = Problem(rig, first.tabulated(), measured, reference_degC).solved()
    curves, posterior, q, left = fit.curves, fit.posterior, fit.at.size, list(sources)
    at = curves.surfaces(curves.B @ fit.at), rig.speeds, fit.done.speed_slope
    changes, _ = residual_changes(campaign, sources, *at)
    runs = replace(fit.runs, shared=-changes)
    mean, covariance = runs.model().at(posterior.sizes).of(SHARED_ERRORS)
    deviation = np.sqrt(np.diag(covariance)).tolist()
    told = tuple(zip(sources, mean.tolist(), deviation, strict=True))
    for k, (source, error, sd) in enumerate(told):
        if source.error == "bending_stiffness":  # with what the runs leave of its error
            share = min(1.0, math.hypot(error, sd))
            left[k] = replace(source, size=share * source.size, basis=FITTED)
            changes[:, k] *= share
    gain = runs.gain(posterior)
    for key, Z in runs.effects.items():
        left += effect_sources(key, posterior.sizes[key], Z.shape[1])
    by_effects = (posterior.sizes[key] * Z for key, Z in runs.effects.items())
    shared = gain[:q] @ np.hstack([changes, *by_effects])
    of_effects = shared[:, len(sources) :]
    own = posterior.covariance[:q, :q] - of_effects @ of_effects.T
    by_errors = gain @ changes
    noise_scale = np.sqrt(np.mean(runs.variance(posterior.sizes) / np.square(runs.errors)))
    warnings, iterations = list[str](), first.iterations + fit.iterations
    if not posterior.converged:
        warnings.append(
            "the search for the sizes of noise and effects did not end: the errors may be wrong"
        )
    if fit.still_changing > 0.0:
        warnings.append(
            f"no convergence in {iterations} iterations: last change of mu "
            f"{percent(100 * fit.still_changing)}, must be at most {percent(100 * TOLERANCE)}"
        )
    scatter = factor_of(curves.B @ own @ curves.B.T)
    factor = curves.at_nodes(fit.forces, np.hstack([curves.B @ shared, scatter]))
    mu, relative = fit.tabulated().mu_nodes, np.linalg.norm(factor[..., len(sources) :], axis=-1)
    names = [source.name for source in left]
    surface = FrictionSurface(fit.forces, rig.speeds, mu, mu * relative, factor, names)
    return RefinedSurface(
        surface=surface,
        uncertainty=SurfaceUncertainty(surface, left, measured.arcs_deg),
        campaign=campaign,
        stated_errors=told,
        runs=runs,
        posterior=posterior,
        covariance=posterior.covariance + by_errors @ by_errors.T,
        weight=fit.weight,
        misfit_before=first.misfit_before,
        misfit_after=np.expm1(fit.done.log_mu - fit.log_mu),
        iterations=iterations,
        noise_scale=float(noise_scale),
        effective_parameters=float(np.sum(gain * posterior.model.X[:, 0].T)),
        warnings=tuple(warnings),
    )


class Sweep(NamedTuple):
    """All runs simulated with one surface."""

    tensions: Array  # tight and slack [N], (2, n)
    log_mu: Array  # logarithms of the coefficients at the speed of each run, (n,)
    J: Array  # derivatives of ``log_mu`` with respect to the parameters, (n, size)
    speed_slope: Array  # derivative of ``log_mu`` with respect to ln v of the run, (n,)


def sweep(rig: RigRuns, curves: Curves, parameters: Array) -> Sweep:
    """Simulate every run with the surface of its speed and compute the derivatives."""
    n, m, k = rig.label.size, curves.log_speed.size, curves.log_force.size
    surfaces, J = curves.surfaces(parameters), np.zeros((n, m, k))
    runs = rig.slide(surfaces)
    for i, (run, speed) in enumerate(zip(runs, rig.label.tolist(), strict=True)):
        force, weight = look_ups(run, surfaces[speed])
        J[i, speed] = weight @ curves.basis(np.log(force))
    # small deviations from the speed of the group are corrected by the slope between the speeds
    of_speeds = parameters.reshape(m, k)
    by_speed = np.gradient(of_speeds, curves.log_speed, axis=0) if m > 1 else 0.0 * of_speeds
    speed_slope = np.sum(J * by_speed, axis=(1, 2))
    tight, slack, mu = np.array([(r.tension_tight_N, r.tension_slack_N, r.mu) for r in runs]).T
    log_mu = np.log(mu) + rig.off_speed * speed_slope
    return Sweep(np.array([tight, slack]), log_mu, J.reshape(n, m * k), speed_slope)


def acting_forces(rig: RigRuns, start: FrictionSurface) -> tuple[float, float, float]:
    """Return line forces [N/m]: the lowest limits of both :data:`SHARES`, and the peak."""
    acting = []
    for run in rig.slide([start] * rig.speeds.size):
        points = np.sort(run.sliding.now[run.sliding.touching], order="f_N")
        share, force = np.cumsum(points["F_N"]), points["f_N"]
        acting.append([*np.interp(SHARES, share / share[-1], force), force[-1]])
    lowest, low, peak = np.array(acting).T
    return float(lowest.min()), float(low.min()), float(peak.max())


class Problem:
    """The runs on the simulated rig and their measured values; knots where forces act.

    When :meth:`solved`: the coordinates `at`, the runs `done` with them, the last linear model
    `runs` with its `posterior` and the `weight` of each run (1, less for outliers), the number of
    `iterations`, and `still_changing`, the last change of ln mu without convergence, else 0.
    """

    def __init__(
        self, rig: RigRuns, start: FrictionSurface, measured: Measured, reference_degC: float | None
    ) -> None:
        lowest, low, high = acting_forces(rig, start)
        # as many knots as nodes over the surface, and more down to the lowest force
        inside, gap = np.linspace(np.log(low), np.log(high), KNOTS, retstep=True)
        below = inside[0] - gap * np.arange(math.ceil((inside[0] - np.log(lowest)) / gap), 0, -1)
        self.rig, self.effects = rig, campaign_effects(measured, reference_degC)
        self.priors = PRIORS if reference_degC is None else {**PRIORS, **IF_CORRECTED}
        self.curves = Curves(np.concatenate([below, inside]), np.log(rig.speeds))
        self.forces = np.geomspace(low, high, KNOTS)  # nodes of the surface
        self.log_mu = np.log(measured.mu)
        self.errors = np.hypot(measured.mu_se / measured.mu, MODEL_ERROR)
        log_mu = np.log(start.mu(np.exp(self.curves.log_force), rig.speeds[:, None]))
        self.at = np.asarray(np.linalg.solve(self.curves.B, log_mu.ravel()), dtype=float)
        self.done = sweep(rig, self.curves, self.curves.B @ self.at)
        self.misfit_before = np.expm1(self.done.log_mu - self.log_mu)

    def tabulated(self) -> FrictionSurface:
        """Tabulate the curves at the nodes."""
        log_mu = self.curves.at_nodes(self.forces, self.curves.B @ self.at)[..., 0]
        return FrictionSurface(self.forces, self.rig.speeds, np.exp(log_mu))

    def linearised(self, weight: Array, response: Array) -> LinearRuns:
        """Linearise the data about the simulated runs; `response` (n,) is theirs to effects."""
        effects = {key: Z * response[:, None] for key, Z in self.effects.items()}
        y = self.log_mu - self.done.log_mu + self.done.J @ (self.curves.B @ self.at)
        parts = {name: self.done.J @ columns for name, columns in self.curves.parts.items()}
        errors = self.errors / np.sqrt(weight)
        return LinearRuns(y, parts, errors, response, effects, self.priors)

    def solved(self) -> Self:
        """Iterate with damping; choose weights and sizes again a few times, then freeze them."""
        residual, sizes = np.zeros(self.log_mu.size), dict[str, float]()
        for iteration in range(1, MOST_ITERATIONS + 1):
            if chosen := iteration <= CHOICES:
                # outliers, judged by the median misfit, lose weight
                scale = max(1.4826 * float(np.median(np.abs(residual))), LEAST_SCALE)
                self.weight = np.square(OUTLIER / np.maximum(np.abs(residual) / scale, OUTLIER))
                response = self.done.J.sum(axis=1)
            runs = self.linearised(self.weight, response)
            if chosen:
                posterior = runs.choose(sizes)
            else:
                posterior = runs.model().at(sizes, posterior.converged)
            sizes = posterior.sizes
            residual = posterior.residual[:, 0] / np.sqrt(self.weight * runs.variance(sizes))
            share, change, gain = self._descend(runs, posterior)
            settled = share == 0.0 and gain <= NOTHING
            if settled or (share == 0.0 and iteration >= CHOICES):
                break
        if not settled and change > NEARLY:
            raise ConvergenceError(
                f"refined surface: no convergence in {iteration} iterations (last change of mu "
                f"{100 * change:.2g} %)",
            )
        self.runs, self.posterior, self.iterations = runs, posterior, iteration
        self.still_changing = 0.0 if settled else change
        return self

    def _descend(self, runs: LinearRuns, posterior: Posterior) -> tuple[float, float, float]:
        """Halve a step until the misfit falls enough: its share, largest change and decrease."""
        at, sizes = self.at, posterior.sizes
        step = posterior.mean[: at.size] - at
        # of the runs: knots that carry no load may drift
        change = float(np.max(np.abs(runs.X @ step)))
        if change <= TOLERANCE:
            return 0.0, change, 0.0
        gain = runs.misfit(runs.X @ step, step, sizes)
        initial = runs.misfit(self.log_mu - self.done.log_mu, at, sizes)
        shares = min(1.0, LARGEST_CHANGE / change) * 0.5 ** np.arange(HALVINGS)
        for share, trial in zip(shares.tolist(), at + shares[:, None] * step, strict=True):
            with suppress(NumericsError):  # no sliding state so far away
                simulated = sweep(self.rig, self.curves, self.curves.B @ trial)
                misfit = runs.misfit(self.log_mu - simulated.log_mu, trial, sizes)
                if misfit <= initial - share * 2.0 * DECREASE * gain:
                    self.at, self.done = trial, simulated
                    return share, change, gain
        return 0.0, change, gain


CLEAR = 3.0  # standard errors beyond which an effect is significant
CONFOUNDED = 0.9  # share explained by force and speed: variance inflated tenfold
LEAST_EVIDENCE = math.log(20.0)
"""Least log evidence of a clear effect: the runs are 20 times as probable with it as without."""


class ShownEffect(NamedTuple):
    """An effect of the campaign and its size for the reader."""

    key: str  # of the effect; "scatter" for the friction from run to run
    size: float
    """Change of ln mu: between the arcs that differ most clearly; from the first run to the last;
    by 10 K; beside the steady change (root mean square); or the standard deviation of scatter."""
    uncertainty: float  # standard uncertainty of the size; nan for the scatter
    arcs_deg: tuple[float, ...] = ()  # with the lower and the higher friction, of an arc effect
    explained: float = math.nan
    """Share that force and speed of the runs explain, nan for arcs; above :data:`CONFOUNDED` the
    runs cannot separate it from the surface."""
    is_large: bool = False  # whether it far exceeds its uncertainty, and no surface explains it
    is_clear: bool = False  # whether, besides, no other effect explains the runs equally well


def contradictions(found: RefinedSurface) -> dict[str, float]:
    """Return errors that contradict their stated size: name -> standard uncertainties."""
    rising = sorted((abs(error), source.name) for source, error, _ in found.stated_errors)
    return {name: size for size, name in rising if size > CLEAR}


def shown_effects(found: RefinedSurface) -> tuple[ShownEffect, ...]:
    """Return the effects that the runs can show, in a fixed order."""
    columns = {key: Z / found.runs.response[:, None] for key, Z in found.runs.effects.items()}
    mean, C, arcs_deg = found.posterior.mean, found.covariance, found.uncertainty.arcs_deg
    unit = {key: np.eye(mean.size)[found.posterior.model.places[key]] for key in columns}
    rows, arcs = dict[str, Array](), ()  # sums of the numbers whose root mean square is the size
    if ARC in unit:
        pairs = np.array(list(itertools.permutations(range(len(arcs_deg)), 2)))
        apart = unit[ARC][pairs[:, 1]] - unit[ARC][pairs[:, 0]]
        clearest = np.argmax(apart @ mean / np.sqrt(np.einsum("nk,kl,nl->n", apart, C, apart)))
        rows[ARC], arcs = apart[clearest][None], tuple(arcs_deg[pairs[clearest]].tolist())
    rows |= {key: unit[key] for key in (ORDER, TEMPERATURE) if key in unit}
    rows |= {COURSE: columns[COURSE] @ unit[COURSE]} if COURSE in unit else {}
    effects = list[ShownEffect]()
    for key, of in rows.items():
        sizes, u = of @ mean, math.sqrt(np.mean(np.einsum("nk,kl,nl->n", of, C, of)))
        size = float(sizes[0]) if sizes.size == 1 else float(np.sqrt(np.mean(np.square(sizes))))
        change = found.runs.response * (columns[key] @ found.posterior.of(key)[0])
        explained = math.nan if key == ARC else found.runs.explained(change, found.posterior.sizes)
        large = abs(size) > CLEAR * math.hypot(u, MODEL_ERROR) and not explained > CONFOUNDED
        clear = large and found.runs.log_evidence_for(key) > LEAST_EVIDENCE  # takes a search
        of_arcs = arcs if key == ARC else ()
        effects.append(ShownEffect(key, size, u, of_arcs, explained, large, clear))
    return (*effects, ShownEffect(SCATTER, found.posterior.sizes[SCATTER], math.nan))

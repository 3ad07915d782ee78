"""How the refined surface follows every error: implicit differentiation of its least squares.

The surface minimises ``|W (ln mu_measured - ln mu_simulated(p, x))|² + p' P p`` over its parameters
p; x are the inputs of the simulated rig. With the gain G of the solution (:attr:`gain`), which
holds the inverse of the normal matrix, an error e of a source changes it by

    dp/de = G (d ln mu_measured/de - sum_x d ln mu_simulated/dx dx/de),

without any new fit. The derivatives by x come from the rig simulated once more for each input.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from beltid.identify.friction.drift_check import CLEAR, CONFOUNDED
from beltid.laws.friction_surface import FrictionSurface
from beltid.refine.effects import ARC, COURSE, ORDER, TEMPERATURE
from beltid.refine.inverse import MODEL_ERROR, RefinedSurface, refine_surface
from beltid.refine.rig_runs import RigRuns, mesh_of, surfaces_of
from beltid.uncertainty.campaign import Campaign
from beltid.uncertainty.sources import EFFECT_SOURCES, Errors, Source, effect_sources

Array = NDArray[np.float64]

STEP = 2.0e-3
"""Relative step of the differences; their error is of its order, a fraction of a percent.

Of the bending stiffness, whose slopes are small (0.02), it is a tenth: contact points come into
touch within the step.
"""
MESH = 1.0
"""Elements over the default: a difference needs no finer mesh."""
INPUTS = ("arc", "initial tension", "radius", "span", "EI", "EA", "k_linear", "k_quadratic")


def log_inputs(campaign: Campaign) -> Array:
    """Logarithms of the inputs of the simulated rig (n, 8), in the order of :data:`INPUTS`."""
    bench, measured = campaign.bench, campaign.measured
    k = np.array([bench.law.k_linear_N_m2, bench.law.k_quadratic_N_m3])
    shared = [bench.rig.R, bench.rig.span, bench.belt.EI, bench.belt.EA, *np.where(k > 0, k, 1.0)]
    columns = [measured.beta, measured.T_0, *(np.full(measured.mu.size, x) for x in shared)]
    return np.log(np.column_stack(columns))


@dataclass(frozen=True, slots=True)
class Refined:
    """A refined surface and all that its uncertainty is made of.

    Attributes
    ----------
    refined : RefinedSurface
        The solution of the inverse problem.
    campaign : Campaign
        Its runs, with the effects that they show.
    sources : tuple of Source
        Errors that runs share, and those effects.
    slopes : ndarray, shape (n, 8)
        Derivatives of the simulated ln mu of each run by the ln of each input.
    """

    refined: RefinedSurface
    campaign: Campaign
    sources: tuple[Source, ...]
    slopes: Array

    def contradictions(self) -> dict[str, float]:
        """Errors that the runs put beyond what is known of them: name -> standard uncertainties."""
        errors = self.refined.stated
        found: dict[str, float] = {}
        if errors is not None:
            for source, size in zip(self.sources, np.abs(errors.values).tolist(), strict=False):
                if size > CLEAR:
                    found[source.name] = max(size, found.get(source.name, 0.0))
        return found


def refined_campaign(
    campaign: Campaign,
    speeds: Array,
    sources: Sequence[Source],
    reference_degC: float | None = None,
) -> Refined:
    """Refine the surface of a campaign, with all that its uncertainty is made of.

    Parameters
    ----------
    campaign : Campaign
        Runs and bench.
    speeds : ndarray, shape (m,)
        Speeds of the surface [m/s].
    sources : sequence of Source
        Errors that runs share.
    reference_degC : float, optional
        Temperature to which the surface is corrected [°C]; by default it is that of the runs.

    Raises
    ------
    InputError, ConvergenceError
        As :func:`beltid.refine.inverse.refine_surface`.
    """
    runs = campaign.runs
    first = refine_surface(campaign.bench, runs, speeds, reference_degC=reference_degC)
    slopes = refined_slopes(campaign, first, speeds)
    # again from there, with the errors that the effects must not explain once more
    near = replace(campaign.bench, surface=first.surface)
    changes = changes_of_residuals(campaign, sources, slopes, first.speed_slope)
    refined = refine_surface(near, runs, speeds, stated=-changes, reference_degC=reference_degC)
    refined = replace(refined, misfit_before=first.misfit_before)
    effects = [found.effect for found in refined.effects]
    measured = campaign.measured.with_effects(effects, refined.response)
    shown = (
        effect_sources(found.effect.key, found.size, found.values.size) for found in refined.effects
    )
    return Refined(
        refined=refined,
        campaign=replace(campaign, measured=measured),
        sources=(*sources, *itertools.chain.from_iterable(shown)),
        slopes=slopes,
    )


def refined_slopes(campaign: Campaign, refined: RefinedSurface, speeds: Array) -> Array:
    """Derivatives of the simulated ln mu of each run by the ln of each input, shape (n, 8)."""
    surfaces = surfaces_of(refined.curves, refined.parameters)
    return simulated_slopes(campaign, surfaces, speeds, refined.speed_slope)


def simulated_slopes(
    campaign: Campaign, surfaces: Sequence[FrictionSurface], speeds: Array, speed_slope: Array
) -> Array:
    """The same with any surface for each speed, and the slope by ln v of each run (n,)."""
    elements = mesh_of(campaign.bench, campaign.runs, MESH)

    def log_mu(of: Campaign) -> Array:
        rig = RigRuns(of.bench, of.runs, speeds, elements)
        return rig.log_mu(surfaces, speed_slope)

    base = log_mu(campaign)
    columns = [log_mu(_stepped(campaign, name)) - base for name in INPUTS]
    return np.asarray(np.column_stack(columns) / np.log1p(STEP))


def _stepped(campaign: Campaign, name: str) -> Campaign:
    """The campaign with one input a step larger; the sliding speeds stay."""
    up = {n: 1.0 + STEP * (n == name) for n in INPUTS}
    bench, measured = campaign.bench, campaign.measured
    belt, rig, law = bench.belt, bench.rig, bench.law
    k = law.k_linear_N_m2 * up["k_linear"], law.k_quadratic_N_m3 * up["k_quadratic"]
    R = rig.R * up["radius"]
    return replace(
        campaign,
        bench=replace(
            bench,
            belt=replace(belt, EA=belt.EA * up["EA"], EI=belt.EI * up["EI"]),
            rig=replace(rig, R=R, span=rig.span * up["span"]),
            law=replace(law, k_linear_N_m2=k[0], k_quadratic_N_m3=k[1]),
        ),
        measured=replace(
            measured,
            R=R,
            omega=measured.omega / up["radius"],
            beta=measured.beta * up["arc"],
            T_0=measured.T_0 * up["initial tension"],
        ),
    )


def residual_change(campaign: Campaign, errors: Errors, slopes: Array, speed_slope: Array) -> Array:
    """Change of ln mu_measured - ln mu_simulated of each run (n,) with errors put right."""
    corrected = campaign.corrected(errors)
    before, after = campaign.measured, corrected.measured
    inputs = log_inputs(corrected) - log_inputs(campaign)
    simulated = np.einsum("ni,ni->n", slopes, inputs)
    simulated += speed_slope * np.log(after.slip_speed / before.slip_speed)
    return np.asarray(np.log(after.mu / before.mu) - simulated)


def parameter_changes(
    campaign: Campaign, refined: RefinedSurface, sources: Sequence[Source], slopes: Array
) -> Array:
    """Change of the parameters by one standard uncertainty of each source, shape (size, K)."""
    changes = changes_of_residuals(campaign, sources, slopes, refined.speed_slope)
    return np.asarray(refined.gain @ changes)


def changes_of_residuals(
    campaign: Campaign, sources: Sequence[Source], slopes: Array, speed_slope: Array
) -> Array:
    """Change of measured less simulated ln mu by each source put right, shape (n, K)."""
    changes = [residual_change(campaign, Errors.single(s), slopes, speed_slope) for s in sources]
    return np.column_stack([np.zeros((campaign.measured.mu.size, 0)), *changes])


def changes_and_scatter(found: Refined) -> tuple[Array, Array]:
    """What the covariance of ln mu at the nodes is made of, two factors (nf, nv, K), (nf, nv, r).

    The first holds the change by one standard uncertainty of each source, the second the scatter of
    the runs. The effects of the campaign are sources too, and unknowns of the solution, so that its
    covariance holds them: they are taken out of it here.
    """
    refined = found.refined
    changes = parameter_changes(found.campaign, refined, found.sources, found.slopes)
    of_effects = changes[:, [source.error in EFFECT_SOURCES for source in found.sources]]
    scatter = factor_of(refined.covariance - of_effects @ of_effects.T)
    return on_nodes(refined, changes), on_nodes(refined, scatter)


def on_nodes(refined: RefinedSurface, vectors: Array) -> Array:
    """Vectors of parameters (size, K) as changes of ln mu at the nodes, shape (nf, nv, K)."""
    curves = refined.curves
    basis = curves.basis(np.log(refined.surface.normal_force_N_m))
    by_speed = vectors.reshape(curves.log_speed.size, curves.log_force.size, -1)
    return np.asarray(np.einsum("fk,vks->fvs", basis, by_speed))


def factor_of(covariance: Array) -> Array:
    """Matrix S (n, r) with S S' a covariance (n, n); directions of no weight are left out."""
    values, vectors = np.linalg.eigh(covariance)
    kept = values > 1e-10 * values[-1]
    factor = vectors[:, kept] * np.sqrt(values[kept])
    # the sign of an eigenvector is chance: the same everywhere
    largest = np.argmax(np.abs(factor), axis=0)
    signs = np.sign(factor[largest, np.arange(factor.shape[1])])
    return np.ascontiguousarray((factor * signs)[:, ::-1])


TOGETHER, SCATTER = "together", "scatter"
LEAST_EVIDENCE = math.log(20.0)
"""Of an effect that is called clear: the runs are twenty times as probable with it as without."""


@dataclass(frozen=True, slots=True)
class ShownEffect:
    """An effect in the size in which a person reads it.

    Attributes
    ----------
    key : str
        Which one; "scatter" for the friction from run to run, "together" for what run order and
        temperature change over the campaign where it cannot be told which of them does.
    size : float
        Change of ln mu: between the arcs that differ most clearly, from the first run to the last,
        by 10 K, at the most beside the steady change (root mean square); standard deviation of the
        scatter.
    uncertainty : float
        Standard uncertainty of that; nan for the scatter.
    arcs_deg : tuple of float
        The arcs that lie lower and higher [deg]; empty for other effects.
    explained : float
        Share of the order, its course or the temperature that force and speed of the runs explain
        [-]; nan for others.
    log_evidence : float
        Logarithm of how much more probable the runs are with it than without, other effects and
        stated errors in its place; infinite where its size does not make it worth asking.
    """

    key: str
    size: float
    uncertainty: float
    arcs_deg: tuple[float, ...] = ()
    explained: float = math.nan
    log_evidence: float = math.inf

    @property
    def is_confounded(self) -> bool:
        """Whether the runs cannot tell it from the surface."""
        return self.explained > CONFOUNDED

    @property
    def is_large(self) -> bool:
        """Whether it is far more than its uncertainty, and than the error of the simulated rig.

        That error is alike in runs that are alike: it looks like an effect. What force and speed
        explain may as well be the surface.
        """
        least = CLEAR * math.hypot(self.uncertainty, MODEL_ERROR)
        return abs(self.size) > least and not self.is_confounded

    @property
    def is_clear(self) -> bool:
        """Whether it is large, and nothing else explains the runs as well."""
        return self.is_large and self.log_evidence > LEAST_EVIDENCE


def shown_effects(found: Refined) -> tuple[ShownEffect, ...]:
    """The effects that the runs can show, in a fixed order."""

    def weighed(shown: ShownEffect) -> ShownEffect:
        """With the evidence for it, which takes a search, if its size makes that worth while."""
        if not shown.is_large:
            return shown
        keys = (ORDER, COURSE, TEMPERATURE) if shown.key == TOGETHER else (shown.key,)
        return replace(shown, log_evidence=found.refined.log_evidence_for(*keys))

    seen = _Seen(found.refined)
    order, warm = seen.rows(ORDER), seen.rows(TEMPERATURE)
    shown = [
        weighed(ShownEffect(key, *seen.change(rows), explained=seen.explained(key)))
        for key, rows in ((ORDER, order), (TEMPERATURE, warm))
        if rows is not None
    ]
    course = seen.rows(COURSE)
    if course is not None:
        size, uncertainty = seen.root_mean_square(COURSE, course)
        of_course = ShownEffect(COURSE, size, uncertainty, explained=seen.explained(COURSE))
        shown.append(weighed(of_course))
    if order is not None and warm is not None:
        # what a straight line through the temperatures adds to the change over the campaign
        columns = found.refined.columns_of_effects
        x, T = (columns[key][:, 0] for key in (ORDER, TEMPERATURE))
        change = seen.change(order + np.polyfit(x, T, 1)[0] * warm)
        together = weighed(ShownEffect(TOGETHER, *change, explained=seen.explained(ORDER)))
        if together.is_clear and not any(one.is_clear for one in shown):
            shown.append(together)
    arcs = seen.rows(ARC)
    if arcs is not None:
        difference = _arc_difference(seen, arcs, found.campaign.measured.arcs_deg)
        shown.insert(0, weighed(difference))
    return (*shown, ShownEffect(SCATTER, found.refined.smoothness.scatter, float("nan")))


def _arc_difference(seen: _Seen, arcs: Array, arcs_deg: Array) -> ShownEffect:
    """The difference between two arcs that is the clearest."""
    pairs = []
    for low, high in itertools.permutations(range(len(arcs)), 2):
        between = tuple(arcs_deg[[low, high]].tolist())
        pairs.append(ShownEffect(ARC, *seen.change(arcs[high] - arcs[low]), between))
    return max(pairs, key=lambda pair: pair.size / pair.uncertainty)


@dataclass(frozen=True, slots=True)
class _Seen:
    """The numbers of all effects (K,) with their covariance (K, K), stated errors included."""

    refined: RefinedSurface

    @property
    def values(self) -> Array:
        """The numbers in the order of the effects."""
        return np.concatenate([np.zeros(0), *(one.values for one in self.refined.effects)])

    @property
    def covariance(self) -> Array:
        """Their covariance."""
        return self.refined.effects_covariance

    def rows(self, key: str) -> Array | None:
        """Weights (K_e, K) that pick the numbers of an effect; None if the runs cannot show it."""
        before = itertools.takewhile(lambda one: one.effect.key != key, self.refined.effects)
        first, effect = sum(one.values.size for one in before), self.refined.effect(key)
        if effect is None:
            return None
        return np.eye(self.values.size)[first : first + effect.values.size]

    def change(self, weights: Array) -> tuple[float, float]:
        """Weighted sum of the numbers and its standard uncertainty."""
        w = np.ravel(weights)
        return float(w @ self.values), float(np.sqrt(w @ self.covariance @ w))

    def explained(self, key: str) -> float:
        """Share of an effect that the surface explains, its numbers by their mean squares."""
        found = self.refined.effect(key)
        assert found is not None
        weight = np.square(found.values) * np.mean(np.square(found.effect.columns), axis=0)
        return float(np.average(found.explained, weights=weight if np.any(weight) else None))

    def root_mean_square(self, key: str, rows: Array) -> tuple[float, float]:
        """Root mean square of an effect over the runs, and that of its standard uncertainty."""
        of_runs = self.refined.columns_of_effects[key] @ rows
        variance = np.einsum("nk,kl,nl->n", of_runs, self.covariance, of_runs)
        mean_square = np.mean(np.square(of_runs @ self.values))
        return float(np.sqrt(mean_square)), float(np.sqrt(np.mean(variance)))

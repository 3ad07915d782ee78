"""Sensitivity of the refined surface to every error: implicit differentiation of least squares.

The surface minimises ``|W (ln mu_measured - ln mu_simulated(p, x))|² + p' P p`` over its parameters
p; x are the inputs of the simulated rig. With the gain G of the solution (:attr:`gain`), which
contains the inverse of the normal matrix, an error e of a source changes p by

    dp/de = G (d ln mu_measured/de - sum_x d ln mu_simulated/dx dx/de),

without a new fit. The derivatives by x come from one more simulation of the rig for each input.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from beltid.laws.friction_surface import FrictionSurface
from beltid.refine.effects import ARC, CLEAR, CONFOUNDED, COURSE, ORDER, TEMPERATURE
from beltid.refine.inverse import MODEL_ERROR, RefinedSurface, refine_surface
from beltid.refine.rig_runs import RigRuns, mesh_of, surfaces_of
from beltid.uncertainty.campaign import Campaign
from beltid.uncertainty.sources import EFFECT_SOURCES, Errors, Source, effect_sources

Array = NDArray[np.float64]

STEP = 2.0e-3
"""Relative step of the differences; their error is of its order, a fraction of a percent.

"""
MESH = 2.0
"""Ratio of elements to the default: where contact points come and go, derivatives scatter more than
values, those by bending stiffness (0.03) at the smallest tensions by a tenth."""
INPUTS = ("arc", "initial tension", "radius", "span", "EI", "EA", "k_linear", "k_quadratic")


def log_inputs(campaign: Campaign) -> Array:
    """Return the ln of the inputs of the simulated rig (n, 8), in the order of :data:`INPUTS`."""
    bench, measured = campaign.bench, campaign.measured
    k = np.array([bench.law.k_linear_N_m2, bench.law.k_quadratic_N_m3])
    shared = [bench.rig.R, bench.rig.span, bench.belt.EI, bench.belt.EA, *np.where(k > 0, k, 1.0)]
    columns = [measured.beta, measured.T_0, *(np.full(measured.mu.size, x) for x in shared)]
    return np.log(np.column_stack(columns))


@dataclass(frozen=True, slots=True)
class Refined:
    """A refined surface and everything that its uncertainty needs.

    Attributes
    ----------
    refined : RefinedSurface
        The solution of the inverse problem.
    campaign : Campaign
        Its runs, with the effects that they show.
    sources : tuple of Source
        Errors that runs share, and the effects.
    slopes : ndarray, shape (n, 8)
        Derivatives of the simulated ln mu of each run by the ln of each input.
    """

    refined: RefinedSurface
    campaign: Campaign
    sources: tuple[Source, ...]
    slopes: Array

    def contradictions(self) -> dict[str, float]:
        """Return errors that contradict their stated size: name -> standard uncertainties."""
        sizes: dict[str, float] = {}
        for source, size in zip(self.sources, np.abs(self.refined.stated).tolist(), strict=False):
            if size > CLEAR:
                sizes[source.name] = max(size, sizes.get(source.name, 0.0))
        return sizes


def refined_campaign(
    campaign: Campaign,
    speeds: Array,
    sources: Sequence[Source],
    reference_degC: float | None = None,
) -> Refined:
    """Refine the surface of a campaign, with everything that its uncertainty needs.

    Parameters
    ----------
    campaign : Campaign
        Runs and bench.
    speeds : ndarray, shape (m,)
        Speeds of the surface [m/s].
    sources : sequence of Source
        Errors that runs share.
    reference_degC : float, optional
        Temperature to which the surface is corrected [°C]; by default that of the runs.

    Raises
    ------
    InputError, ConvergenceError
        As :func:`beltid.refine.inverse.refine_surface`.
    """
    runs = campaign.runs
    first = refine_surface(campaign.bench, runs, speeds, reference_degC=reference_degC)
    slopes = refined_slopes(campaign, first, speeds)
    # refine again with the stated errors, so that the effects do not explain them too
    near = replace(campaign.bench, surface=first.surface)
    changes = changes_of_residuals(campaign, sources, slopes, first.speed_slope)
    refined = refine_surface(near, runs, speeds, stated=-changes, reference_degC=reference_degC)
    refined = replace(refined, misfit_before=first.misfit_before)
    effects = [fitted.effect for fitted in refined.effects]
    measured = campaign.measured.with_effects(effects, refined.response)
    added = (effect_sources(e.effect.key, e.size, e.values.size) for e in refined.effects)
    return Refined(
        refined=refined,
        campaign=replace(campaign, measured=measured),
        sources=(*sources, *itertools.chain.from_iterable(added)),
        slopes=slopes,
    )


def refined_slopes(campaign: Campaign, refined: RefinedSurface, speeds: Array) -> Array:
    """Compute derivatives of the simulated ln mu of each run by the ln of each input (n, 8)."""
    surfaces = surfaces_of(refined.curves, refined.parameters)
    return simulated_slopes(campaign, surfaces, speeds, refined.speed_slope)


def simulated_slopes(
    campaign: Campaign, surfaces: Sequence[FrictionSurface], speeds: Array, speed_slope: Array
) -> Array:
    """Compute the same for any surface at each speed, with the slope by ln v of each run (n,)."""
    rig = RigRuns(
        campaign.bench, campaign.runs, speeds, mesh_of(campaign.bench, campaign.runs, MESH)
    )

    def log_mu(other: Campaign) -> Array:
        # on the same mesh: the noise of another one is larger than the difference
        return RigRuns(other.bench, other.runs, speeds, rig.models).log_mu(surfaces, speed_slope)

    base = rig.log_mu(surfaces, speed_slope)
    columns = [log_mu(_stepped(campaign, name)) - base for name in INPUTS]
    return np.asarray(np.column_stack(columns) / np.log1p(STEP))


def _stepped(campaign: Campaign, name: str) -> Campaign:
    """Return the campaign with one input a step larger and unchanged sliding speeds."""
    factor = {n: 1.0 + STEP * (n == name) for n in INPUTS}
    bench, measured = campaign.bench, campaign.measured
    belt, rig, law = bench.belt, bench.rig, bench.law
    k = law.k_linear_N_m2 * factor["k_linear"], law.k_quadratic_N_m3 * factor["k_quadratic"]
    R = rig.R * factor["radius"]
    return replace(
        campaign,
        bench=replace(
            bench,
            belt=replace(belt, EA=belt.EA * factor["EA"], EI=belt.EI * factor["EI"]),
            rig=replace(rig, R=R, span=rig.span * factor["span"]),
            law=replace(law, k_linear_N_m2=k[0], k_quadratic_N_m3=k[1]),
        ),
        measured=replace(
            measured,
            R=R,
            omega=measured.omega / factor["radius"],
            beta=measured.beta * factor["arc"],
            T_0=measured.T_0 * factor["initial tension"],
        ),
    )


def residual_change(campaign: Campaign, errors: Errors, slopes: Array, speed_slope: Array) -> Array:
    """Compute the change of ln mu_measured - ln mu_simulated (n,) when errors are corrected."""
    corrected = campaign.corrected(errors)
    before, after = campaign.measured, corrected.measured
    inputs = log_inputs(corrected) - log_inputs(campaign)
    simulated = np.einsum("ni,ni->n", slopes, inputs)
    simulated += speed_slope * np.log(after.slip_speed / before.slip_speed)
    return np.asarray(np.log(after.mu / before.mu) - simulated)


def parameter_changes(
    campaign: Campaign, refined: RefinedSurface, sources: Sequence[Source], slopes: Array
) -> Array:
    """Compute the change of the parameters by one u of each source, shape (size, K)."""
    changes = changes_of_residuals(campaign, sources, slopes, refined.speed_slope)
    return np.asarray(refined.gain @ changes)


def changes_of_residuals(
    campaign: Campaign, sources: Sequence[Source], slopes: Array, speed_slope: Array
) -> Array:
    """Compute the change of measured minus simulated ln mu by correcting each source (n, K)."""
    changes = [residual_change(campaign, Errors.single(s), slopes, speed_slope) for s in sources]
    return np.column_stack([np.zeros((campaign.measured.mu.size, 0)), *changes])


def changes_and_scatter(found: Refined) -> tuple[Array, Array]:
    """Return the two factors of the covariance of ln mu at the nodes, (nf, nv, K), (nf, nv, r).

    The first contains the change by one standard uncertainty of each source, the second the scatter
    of the runs. The effects of the campaign are sources and also unknowns of the solution, whose
    covariance contains them; they are subtracted from it here.
    """
    refined = found.refined
    changes = parameter_changes(found.campaign, refined, found.sources, found.slopes)
    effect_changes = changes[:, [source.error in EFFECT_SOURCES for source in found.sources]]
    scatter = factor_of(refined.covariance - effect_changes @ effect_changes.T)
    return on_nodes(refined, changes), on_nodes(refined, scatter)


def on_nodes(refined: RefinedSurface, vectors: Array) -> Array:
    """Convert parameter vectors (size, K) to changes of ln mu at the nodes (nf, nv, K)."""
    curves = refined.curves
    basis = curves.basis(np.log(refined.surface.normal_force_N_m))
    by_speed = vectors.reshape(curves.log_speed.size, curves.log_force.size, -1)
    return np.asarray(np.einsum("fk,vks->fvs", basis, by_speed))


def factor_of(covariance: Array) -> Array:
    """Factor a covariance (n, n) as S S' with S (n, r); omit directions without variance."""
    values, vectors = np.linalg.eigh(covariance)
    kept = values > 1e-10 * values[-1]
    factor = vectors[:, kept] * np.sqrt(values[kept])
    # the sign of an eigenvector is arbitrary: fix it, so that all machines agree
    largest = np.argmax(np.abs(factor), axis=0)
    signs = np.sign(factor[largest, np.arange(factor.shape[1])])
    return np.ascontiguousarray((factor * signs)[:, ::-1])


TOGETHER, SCATTER = "together", "scatter"
LEAST_EVIDENCE = math.log(20.0)
"""Least log evidence of a clear effect: the runs are 20 times as probable with it as without."""


@dataclass(frozen=True, slots=True)
class ShownEffect:
    """An effect of the campaign and its size for the reader.

    Attributes
    ----------
    key : str
        Key of the effect; "scatter" for the friction from run to run, "together" for the change
        over the campaign by run order and temperature if the runs cannot separate the two.
    size : float
        Change of ln mu: between the arcs that differ most clearly; from the first run to the last;
        by 10 K; in addition to the steady change (root mean square); or the standard deviation of
        the scatter.
    uncertainty : float
        Standard uncertainty of the size; nan for the scatter.
    arcs_deg : tuple of float
        The arcs with the lower and the higher friction [deg]; empty for other effects.
    explained : float
        Share of the order, its course or the temperature that force and speed of the runs explain
        [-]; nan for others.
    log_evidence : float
        Logarithm of how much more probable the runs are with the effect than without it, when other
        effects and stated errors may replace it; infinite if its size is too small to compute it.
    """

    key: str
    size: float
    uncertainty: float
    arcs_deg: tuple[float, ...] = ()
    explained: float = math.nan
    log_evidence: float = math.inf

    @property
    def is_confounded(self) -> bool:
        """Whether the runs cannot separate it from the surface."""
        return self.explained > CONFOUNDED

    @property
    def is_large(self) -> bool:
        """Whether it far exceeds its uncertainty and the error of the simulated rig.

        That error is similar in similar runs, so it looks like an effect. An effect that force and
        speed explain may as well belong to the surface.
        """
        least = CLEAR * math.hypot(self.uncertainty, MODEL_ERROR)
        return abs(self.size) > least and not self.is_confounded

    @property
    def is_clear(self) -> bool:
        """Whether it is large and nothing else explains the runs equally well."""
        return self.is_large and self.log_evidence > LEAST_EVIDENCE


def shown_effects(found: Refined) -> tuple[ShownEffect, ...]:
    """Return the effects that the runs can show, in a fixed order."""

    def weighed(effect: ShownEffect) -> ShownEffect:
        """Add the evidence for an effect, if it is large; this takes a search."""
        if not effect.is_large:
            return effect
        keys = (ORDER, COURSE, TEMPERATURE) if effect.key == TOGETHER else (effect.key,)
        return replace(effect, log_evidence=found.refined.log_evidence_for(*keys))

    effects = _EffectEstimates(found.refined)
    order, temperature = effects.rows(ORDER), effects.rows(TEMPERATURE)
    shown = [
        weighed(ShownEffect(key, *effects.change(rows), explained=effects.explained(key)))
        for key, rows in ((ORDER, order), (TEMPERATURE, temperature))
        if rows is not None
    ]
    course = effects.rows(COURSE)
    if course is not None:
        size, uncertainty = effects.root_mean_square(COURSE, course)
        course_effect = ShownEffect(COURSE, size, uncertainty, explained=effects.explained(COURSE))
        shown.append(weighed(course_effect))
    if order is not None and temperature is not None:
        # add the effect of the temperature's linear trend over the campaign
        columns = found.refined.columns_of_effects
        x, T = (columns[key][:, 0] for key in (ORDER, TEMPERATURE))
        change = effects.change(order + np.polyfit(x, T, 1)[0] * temperature)
        together = weighed(ShownEffect(TOGETHER, *change, explained=effects.explained(ORDER)))
        if together.is_clear and not any(effect.is_clear for effect in shown):
            shown.append(together)
    arcs = effects.rows(ARC)
    if arcs is not None:
        difference = _arc_difference(effects, arcs, found.campaign.measured.arcs_deg)
        shown.insert(0, weighed(difference))
    return (*shown, ShownEffect(SCATTER, found.refined.smoothness.scatter, float("nan")))


def _arc_difference(effects: _EffectEstimates, arcs: Array, arcs_deg: Array) -> ShownEffect:
    """Return the clearest difference between two arcs."""
    pairs = []
    for low, high in itertools.permutations(range(len(arcs)), 2):
        between = tuple(arcs_deg[[low, high]].tolist())
        pairs.append(ShownEffect(ARC, *effects.change(arcs[high] - arcs[low]), between))
    return max(pairs, key=lambda pair: pair.size / pair.uncertainty)


@dataclass(frozen=True, slots=True)
class _EffectEstimates:
    """Estimates of all effects (K,) with their covariance (K, K), including stated errors."""

    refined: RefinedSurface

    @property
    def values(self) -> Array:
        """Estimates in the order of the effects."""
        return np.concatenate([np.zeros(0), *(e.values for e in self.refined.effects)])

    @property
    def covariance(self) -> Array:
        """Covariance of the estimates."""
        return self.refined.effects_covariance

    def rows(self, key: str) -> Array | None:
        """Return weights (K_e, K) that select one effect; None if the runs cannot show it."""
        before = itertools.takewhile(lambda e: e.effect.key != key, self.refined.effects)
        first, effect = sum(e.values.size for e in before), self.refined.effect(key)
        if effect is None:
            return None
        return np.eye(self.values.size)[first : first + effect.values.size]

    def change(self, weights: Array) -> tuple[float, float]:
        """Return a weighted sum of the estimates and its standard uncertainty."""
        w = np.ravel(weights)
        return float(w @ self.values), float(np.sqrt(w @ self.covariance @ w))

    def explained(self, key: str) -> float:
        """Return the share of an effect that the surface explains, weighted by mean squares."""
        fitted = self.refined.effect(key)
        assert fitted is not None
        weight = np.square(fitted.values) * np.mean(np.square(fitted.effect.columns), axis=0)
        return float(np.average(fitted.explained, weights=weight if np.any(weight) else None))

    def root_mean_square(self, key: str, rows: Array) -> tuple[float, float]:
        """Return the root mean squares of an effect over the runs and of its uncertainty."""
        of_runs = self.refined.columns_of_effects[key] @ rows
        variance = np.einsum("nk,kl,nl->n", of_runs, self.covariance, of_runs)
        mean_square = np.mean(np.square(of_runs @ self.values))
        return float(np.sqrt(mean_square)), float(np.sqrt(np.mean(variance)))

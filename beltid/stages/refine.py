"""The surface with which the simulated rig gives the measured tensions: the inverse problem."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from beltid.config import Config
from beltid.errors import percent
from beltid.refine.inverse import RefinedSurface, refine_surface
from beltid.refine.posterior import SCATTER
from beltid.refine.shown import TOGETHER, ShownEffect, contradictions, shown_effects
from beltid.stage import Outcome
from beltid.stages.campaign import guided_weight
from beltid.stages.columns import finite_or_none, in_percent
from beltid.stages.inputs import friction_columns, press_law
from beltid.stages.refinement import (
    NEEDED,
    prepared_campaign,
    reference_temperature,
    shared_sources,
    speed_labels,
)
from beltid.stages.surface import friction_formulas, said_of_surface
from beltid.stages.uncertainties import confounded_note
from beltid.stages.workers import Workers
from beltid.uncertainty.budget import SurfaceUncertainty
from beltid.uncertainty.sources import ARC, COURSE, ORDER, TEMPERATURE

MOST_NOISE: Final = 3.0
EFFECT_WORDS: Final = {
    ARC: "difference between arcs",
    ORDER: "steady change over the campaign",
    COURSE: "other change over the campaign, root mean square",
    TEMPERATURE: "temperature, per 10 K",
    TOGETHER: "order or temperature, over the campaign",
    SCATTER: "scatter from run to run",
}


@dataclass(frozen=True, slots=True)
class Refinement:
    """A refined surface with the runs that it was made from.

    Attributes
    ----------
    refined : RefinedSurface
        The solution of the inverse problem.
    runs : tuple of str
        Labels of the runs used.
    arcs_deg : ndarray
        Their arcs [deg].
    uncertainty : SurfaceUncertainty
        Uncertainty of the surface by source.
    effects : tuple of ShownEffect
        Effects in the runs that the surface does not describe.
    contradictions : mapping of str to float
        Errors that the runs contradict: name -> size in standard uncertainties.
    """

    refined: RefinedSurface
    runs: tuple[str, ...]
    arcs_deg: np.ndarray
    uncertainty: SurfaceUncertainty
    effects: tuple[ShownEffect, ...] = ()
    contradictions: Mapping[str, float] = field(default_factory=dict)

    @property
    def surface(self) -> Any:
        """The refined surface with its covariance."""
        names = [source.name for source in self.uncertainty.sources]
        return self.refined.surface.with_covariance(self.uncertainty.factor, names)

    def outliers(self) -> tuple[str, ...]:
        """Return a sentence for each run that lost its weight."""
        weight = self.refined.weight
        return tuple(
            f"run {self.runs[k]}: far from the other runs, weight {weight[k]:.2g}"
            for k in np.flatnonzero(weight < 0.5)
        )

    def disagreement(self) -> tuple[str, ...]:
        """Return a sentence for each effect in the runs that no surface explains."""
        lines = [sentence(effect) for effect in self.effects if effect.is_clear]
        scale = self.refined.noise_scale
        if scale > MOST_NOISE:
            lines.append(
                f"the runs scatter {scale:.2g} times as much as their standard errors say, at most "
                f"{MOST_NOISE:g} is usual: something other than order and temperature changed from "
                "run to run; the uncertainty of the surface includes it as scatter"
            )
        lines += [
            f"{EFFECT_WORDS[found.effect.key]}: larger than such an effect can be expected to be "
            f"(standard deviation {percent(100 * found.largest_usual)}); the simulated rig may not "
            "describe this bench"
            for found in self.refined.effects
            if found.is_unusual
        ]
        lines += [
            f"{name}: the runs require an error of {size:.2g} standard uncertainties; the stated "
            "uncertainty is wrong, or the simulated rig does not describe this bench"
            for name, size in self.contradictions.items()
        ]
        return tuple(lines)

    def misfit_table(self) -> list[dict[str, Any]]:
        """Return the misfit of the simulated coefficients before and after, also per arc [%]."""
        before, after = self.refined.misfit_before, self.refined.misfit_after
        groups = [(f"arc {arc:g}°", self.arcs_deg == arc) for arc in np.unique(self.arcs_deg)]
        return [
            {
                "group": name,
                "runs": int(np.count_nonzero(rows)),
                "rms_before_percent": _rms_percent(before[rows]),
                "mean_before_percent": 100.0 * float(np.mean(before[rows])),
                "rms_after_percent": _rms_percent(after[rows]),
                "mean_after_percent": 100.0 * float(np.mean(after[rows])),
            }
            for name, rows in [("all runs", np.ones(before.size, dtype=bool)), *groups]
        ]

    def arc_spread(self, misfit: np.ndarray) -> float | None:
        """Return the standard deviation of the arcs' mean misfits [-]; None for a single arc."""
        means = [float(np.mean(misfit[self.arcs_deg == arc])) for arc in np.unique(self.arcs_deg)]
        return float(np.std(means, ddof=1)) if len(means) > 1 else None


def _rms_percent(values: np.ndarray) -> float:
    return 100.0 * float(np.sqrt(np.mean(np.square(values))))


def sentence(effect: ShownEffect) -> str:
    """Describe a clear effect in a sentence."""
    digits = max(0, 1 - math.floor(math.log10(100.0 * effect.uncertainty)))
    size = f"{100 * effect.size:+.{digits}f} ± {100 * effect.uncertainty:.{digits}f} %"
    if effect.key == ARC:
        lower, higher = effect.arcs_deg
        return (
            f"arcs differ: the runs at {higher:.4g}° lie {100 * effect.size:.2g} % above those at "
            f"{lower:.4g}° on one surface, where scatter and stated uncertainties explain "
            f"{100 * effect.uncertainty:.2g} %: a wear track, or a wrong arc or load cell; the "
            "difference is included in the uncertainty of the surface"
        )
    return {
        ORDER: f"the friction changes over the campaign by {size} from the first run to the last "
        "(run-in, wear); the surface holds for its middle",
        COURSE: f"the friction changes over the campaign by {size} (root mean square) in addition "
        "to a steady change; the surface holds for its mean",
        TEMPERATURE: f"the friction changes with the temperature of the runs, {size} per 10 K; the "
        "surface holds for their mean, or for friction.reference_temperature_degC with "
        "friction.correct_temperature: true",
        TOGETHER: f"the friction changes over the campaign by {size} from the first run to the "
        "last, with the order of the runs or with their temperature, which rises together with it",
    }[effect.key]


def refined(
    friction: Any,
    law: Any,
    config: Config,
    chosen: Mapping[str, str | None],
    workers: Workers | None,
) -> Outcome[Refinement]:
    """Refine the surface of the usable runs of one condition, in a worker."""
    press = press_law(law, config)
    columns = friction_columns(friction, NEEDED)
    name = str(getattr(friction, "path", "friction table"))
    campaign, speeds, used, set_aside = prepared_campaign(columns, press, config, name, chosen)
    reference, measured = reference_temperature(config, campaign), campaign.measured
    solution = (workers or Workers()).call(
        refine_surface, campaign, speeds, shared_sources(campaign, config), reference
    )
    result = Refinement(
        solution,
        tuple(str(columns["run"][i]) for i in used),
        columns["arc_deg"][used],
        solution.uncertainty,
        shown_effects(solution),
        contradictions(solution),
    )
    found, uncertainty = result.refined, result.uncertainty
    formulas, notes = friction_formulas(found.surface, uncertainty.factor)
    ranges = measured.normal_force, measured.slip_speed
    facts, budget = said_of_surface(found.surface, columns, used, ranges, uncertainty)
    return Outcome(
        _table(result, speeds[speed_labels(columns, used, speeds)]),
        result,
        facts={
            "runs": len(result.runs),
            "iterations": found.iterations,
            "noise_over_stated_errors": found.noise_scale,
            "effective_parameters": found.effective_parameters,
            "arc_to_arc_spread_before_percent": in_percent(result.arc_spread(found.misfit_before)),
            "arc_to_arc_spread_after_percent": in_percent(result.arc_spread(found.misfit_after)),
            "method": "refined",
            "reference_temperature_degC": reference,
            **facts,
        },
        tables={
            "misfit": result.misfit_table(),
            "budget": budget,
            "effects": _effect_rows(result.effects),
            "friction_formulas": formulas,
        },
        validity=dict(found.surface.validity),
        set_aside=set_aside,
        notes=(
            "the surface covers all forces within the contacts of the runs, peaks included; beyond "
            "the mean forces of the runs it is inferred from them",
            *confounded_note(
                {EFFECT_WORDS[e.key]: e.explained for e in result.effects if e.is_confounded}
            ),
            *_unclear_effects(result.effects),
            *bending_stiffness_shown(found),
            *guided_weight(config, measured.points),
            *notes,
        ),
        warnings=(*found.convergence_warnings(), *result.disagreement(), *result.outliers()),
    )


def _effect_rows(effects: Sequence[ShownEffect]) -> list[dict[str, Any]]:
    """Return the effects as they are shown and stored, in percent of mu."""
    return [
        {
            "effect": EFFECT_WORDS[effect.key],
            "size_percent": 100.0 * effect.size,
            "standard_uncertainty_percent": finite_or_none(100.0 * effect.uncertainty),
            "clear": effect.is_clear,
            "explained_percent": finite_or_none(100.0 * effect.explained),
        }
        for effect in effects
    ]


def _unclear_effects(effects: Sequence[ShownEffect]) -> tuple[str, ...]:
    """Return a note on large effects that the runs do not identify clearly."""
    large = [
        EFFECT_WORDS[effect.key] for effect in effects if effect.is_large and not effect.is_clear
    ]
    if not large:
        return ()
    return (
        f"{', '.join(large)}: large, but other effects or stated errors explain the runs nearly as "
        "well: the runs do not show which it is, and it is not claimed; make the runs in random "
        "order",
    )


def bending_stiffness_shown(found: RefinedSurface) -> tuple[str, ...]:
    """Return a note with EI as stated and as the runs show it; empty if it is stated as exact."""
    EI = found.campaign.bench.belt.EI
    for source in found.sources:
        if source.error == "bending_stiffness":
            error, sd = found.stated_errors()[source.name]
            return (
                f"bending stiffness: {EI:.4g} N m² ± {100 * source.size:.2g} % ({source.basis}); "
                f"with the runs it would be {EI * (1 + source.size * error):.4g} N m² ± "
                f"{100 * source.size * sd:.2g} %; the surface was found with the first value",
            )
    return ()


def _table(result: Refinement, run_speed: np.ndarray) -> dict[str, np.ndarray]:
    """Return the rows of the surface table: the common surface of all arcs."""
    surface = result.refined.surface
    forces, speeds = surface.normal_force_N_m, surface.slip_speed_m_s
    arcs = [np.unique(result.arcs_deg[run_speed == v]).size for v in speeds]
    errors = surface.mu_se_nodes
    assert errors is not None
    return {
        "arc_deg": np.full(forces.size * speeds.size, np.nan),
        "normal_force_N_m": np.repeat(forces, speeds.size),
        "slip_speed_m_s": np.tile(speeds, forces.size),
        "mu": surface.mu_nodes.ravel(),
        "mu_se": errors.ravel(),
        "n_arcs": np.tile(np.array(arcs), forces.size),
        "mu_spread": np.full(forces.size * speeds.size, np.nan),
        **result.uncertainty.columns(forces.size * speeds.size),
    }

"""beltid refine-surface: find the surface that gives the measured tensions on the simulated rig."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.artifacts.metadata_models import SurfaceMetadata
from beltid.config import Config, ConfigSource, load_config
from beltid.errors import counted, percent
from beltid.laws.penalty import NormalLaw
from beltid.refine.inverse import RefinedSurface
from beltid.refine.inverse import refine_surface as refine
from beltid.refine.posterior import SCATTER
from beltid.refine.shown import TOGETHER, ShownEffect, contradictions, shown_effects
from beltid.report.summary import Summary
from beltid.stages.build_artifact import Build, Built
from beltid.stages.identification.alternatives import friction_formulas, friction_law_rows
from beltid.stages.identification.conditions import stated_of
from beltid.stages.outcome import Outcome, finite_or_none, in_percent, span
from beltid.stages.reporter import Options
from beltid.stages.simulation.campaign import guided_weight
from beltid.stages.simulation.refinement import (
    NEEDED,
    USES,
    prepared_campaign,
    reference_temperature,
    shared_sources,
    speed_labels,
)
from beltid.stages.tables import press_law, surface_of, table_columns
from beltid.stages.uncertainties import budget_table, confounded_note
from beltid.uncertainty.budget import QUANTITY, SurfaceUncertainty
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.rig_runs import Campaign
from beltid.uncertainty.sources import ARC, COURSE, ORDER, TEMPERATURE

KIND: Final = "surface"
METHOD: Final = "refined"
MOST_NOISE: Final = 3.0
EFFECTS: Final = (
    "friction changes not in the surface, in percent of mu; share that force and speed explain"
)
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


def run(
    config: ConfigSource,
    inputs: Mapping[str, Path],
    out: Path,
    options: Options,
    condition: str | None = None,
    side: str | None = None,
) -> Summary:
    """Refine the surface of a friction table with a stiffness, write it, summarise it.

    `condition` and `side` select the runs that are used.
    """
    chosen = {name: word for name, word in (("condition", condition), ("side", side)) if word}
    build = Build(KIND, config, USES, inputs, out, options, choices=chosen)
    built = build.up_to_date()
    if built is None:
        friction = build.read("friction")
        law = press_law(inputs["stiffness"], config.config)
        options.reporter.report(
            f"{friction.path}: {counted(len(friction.columns['run']), 'run')}, inverse solution"
        )
        name = str(friction.path)
        built = build.write(_outcome(friction.columns, law, config.config, name, chosen, options))
    return summarise(built)


def refine_surface(
    friction: Any,
    law: NormalLaw | Outcome[Any],
    config: Config | Mapping[str, Any] | str | Path | None = None,
    *,
    condition: str | None = None,
    side: str | None = None,
) -> Outcome[Refinement]:
    """Find the friction surface for which the simulated rig gives the measured tension ratios.

    Parameters
    ----------
    friction : Outcome of fit_friction, DataFrame, pyarrow Table or mapping
        A row per reduced run.
    law : NormalLaw or Outcome of fit_stiffness
        Normal contact law of the belt; a result also provides its scatter.
    config : Config, dict, path or None
        Belt and rig; None is the built-in 5PK rig.
    condition, side : str, optional
        Use only runs on this surface (dry, wet, dusty), or of this side of the belt (rib, back).

    Returns
    -------
    Outcome
        ``.to_frame()`` has a row per node; ``.result.surface`` is the refined `FrictionSurface`,
        ``.result.misfit_table()`` the misfit before and after.

    Raises
    ------
    InputError
        If there are too few runs.
    ConvergenceError
        If a run cannot be simulated or the iteration does not converge.
    """
    chosen, model = {"condition": condition, "side": side}, load_config(config)
    press = press_law(law, model)
    columns = table_columns(friction, "friction", NEEDED)
    outcome = _outcome(columns, press, model, "friction table", chosen, Options())
    return outcome.with_origin(model, friction, law)


def _outcome(
    columns: Mapping[str, np.ndarray],
    press: PressLaw,
    config: Config,
    name: str,
    chosen: Mapping[str, str | None],
    options: Options,
) -> Outcome[Refinement]:
    campaign, speeds, used, set_aside = prepared_campaign(columns, press, config, name, chosen)
    labels = tuple(str(columns["run"][i]) for i in used)
    arcs_deg = columns["arc_deg"][used]
    result = _refined(campaign, speeds, config, labels, arcs_deg, options)
    surface = result.refined.surface
    formulas = friction_formulas(surface, result.uncertainty.factor)
    return Outcome(
        kind=KIND,
        columns=_table(result, speeds[speed_labels(columns, used, speeds)]),
        result=result,
        validity=dict(surface.validity),
        set_aside=set_aside,
        extra={
            **stated_of(columns, used),
            **_figures(result, campaign, config),
            **formulas.extra,
        },
        notes=(
            "beyond the measured mean forces of the runs the surface is inferred: its range is "
            "that of the forces within their contact, including peaks",
            *confounded_note(
                {EFFECT_WORDS[e.key]: e.explained for e in result.effects if e.is_confounded}
            ),
            *_unclear_effects(result.effects),
            *bending_stiffness_shown(result.refined),
            *guided_weight(config, campaign.measured.points),
            *formulas.notes,
        ),
        warnings=(
            *result.refined.convergence_warnings(),
            *result.disagreement(),
            *result.outliers(),
        ),
    )


def _refined(
    campaign: Campaign,
    speeds: np.ndarray,
    config: Config,
    labels: tuple[str, ...],
    arcs_deg: np.ndarray,
    options: Options,
) -> Refinement:
    """Refine the surface of a campaign, in a worker."""
    sources = shared_sources(campaign, config)
    reference = reference_temperature(config, campaign)
    found = options.workers.call(refine, campaign, speeds, sources, reference)
    shown = shown_effects(found)
    return Refinement(found, labels, arcs_deg, found.uncertainty, shown, contradictions(found))


def _figures(result: Refinement, campaign: Campaign, config: Config) -> dict[str, Any]:
    """Return the metadata of a refinement for its artifact."""
    refined, measured = result.refined, campaign.measured
    force, slip = measured.normal_force, measured.slip_speed
    return {
        "method": METHOD,
        "degree": refined.surface.degree,
        "n_points": len(result.runs),
        "rms_arc_spread": result.arc_spread(refined.misfit_after),
        "max_arc_spread": None,
        "misfit": result.misfit_table(),
        "arc_spread_before": result.arc_spread(refined.misfit_before),
        "iterations": refined.iterations,
        "noise_scale": refined.noise_scale,
        "effective_parameters": refined.effective_parameters,
        "measured": {"normal_force_N_m": span(force), "slip_speed_m_s": span(slip)},
        "effects": _effect_rows(result.effects),
        "reference_temperature_degC": reference_temperature(config, campaign),
        **result.uncertainty.extra((float(force.min()), float(force.max()))),
    }


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
                f"bending stiffness: stated {EI:.4g} N m² ± {100 * source.size:.2g} % "
                f"({source.basis}), together with the runs {EI * (1 + source.size * error):.4g} "
                f"N m² ± {100 * source.size * sd:.2g} %; the surface holds for the stated one",
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


def summarise(built: Built) -> Summary:
    """Summarise a refined surface."""
    metadata: SurfaceMetadata = built.artifact.metadata
    validity = metadata.validity
    surface = surface_of(built.artifact)
    return built.summary(
        "refine-surface",
        "simulated less measured friction coefficient: published surface, then refined",
        facts={
            "runs": metadata.n_points,
            "iterations": metadata.iterations,
            "noise_over_stated_errors": metadata.noise_scale,
            "effective_parameters": metadata.effective_parameters,
            "arc_to_arc_spread_before_percent": in_percent(metadata.arc_spread_before),
            "arc_to_arc_spread_after_percent": in_percent(metadata.rms_arc_spread),
            "force_nodes": surface.normal_force_N_m.size,
            "speed_nodes": surface.slip_speed_m_s.size,
            "measured_force_N_m": metadata.measured.get("normal_force_N_m"),
            "valid_force_N_m": validity.get("normal_force_N_m"),
            "valid_speed_m_s": validity.get("slip_speed_m_s"),
            "budget": metadata.budget,
            "effects": list(metadata.effects),
        },
        extra_tables={
            "standard uncertainty of the refined surface, in percent of mu": budget_table(
                metadata.budget, QUANTITY
            ),
            EFFECTS: [dict(row) for row in metadata.effects],
        },
        table=[dict(row) for row in metadata.misfit],
        details={"friction formulas": friction_law_rows(metadata.figures)},
    )

"""beltid refine-surface: the surface with which the simulated rig gives the measured tensions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.artifacts.artifact import read_artifact
from beltid.artifacts.metadata_models import SurfaceMetadata
from beltid.config import Config, ConfigSource, load_config
from beltid.identify.surface.surface import SurfaceSettings
from beltid.laws.penalty import NormalLaw
from beltid.laws.uncertain_surface import UncertainSurface
from beltid.refine.inverse import RefinedSurface
from beltid.refine.inverse import refine_surface as refine
from beltid.report.summary import Summary
from beltid.stages.alternatives import friction_formulas, friction_law_rows
from beltid.stages.build_artifact import Build, Built
from beltid.stages.campaign import checked_law
from beltid.stages.outcome import Outcome, span
from beltid.stages.refinement import (
    CHECKED,
    KEYS,
    NEEDED,
    Draws,
    check_table,
    drawn,
    prepared_campaign,
    refined_uncertainty,
    speed_labels,
)
from beltid.stages.reporter import Options
from beltid.stages.tables import law_of, surface_of, table_columns
from beltid.stages.uncertainties import (
    budget_table,
    press_law,
)
from beltid.stages.workers import Workers
from beltid.uncertainty.linear_check import MonteCarlo, check_of
from beltid.uncertainty.monte_carlo import prepare
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.refined import (
    ArcDifference,
    arc_difference,
    refined_slopes,
)
from beltid.uncertainty.surface import QUANTITY, SurfaceUncertainty

KIND: Final = "surface"
METHOD: Final = "refined"
FIGURES: Final = (
    "n_points",
    "iterations",
    "noise_scale",
    "effective_parameters",
    "arc_spread_before",
    "rms_arc_spread",
    "budget",
    "misfit",
    "measured",
)
MOST_NOISE: Final = 3.0
MISFIT_COLUMNS: Final = (
    "group",
    "runs",
    "rms_before_percent",
    "mean_before_percent",
    "rms_after_percent",
    "mean_after_percent",
)


@dataclass(frozen=True, slots=True)
class Refinement:
    """A refined surface with the runs it was made from.

    Attributes
    ----------
    refined : RefinedSurface
        The solution of the inverse problem.
    runs : tuple of str
        Labels of the runs used.
    arcs_deg : ndarray
        Their arcs [deg].
    uncertainty : SurfaceUncertainty
        What is not known of the surface, by its causes.
    arc_difference : ArcDifference, optional
        The clearest difference between two arcs; None for a single one.
    check : MonteCarlo, optional
        The Monte Carlo check of that.
    """

    refined: RefinedSurface
    runs: tuple[str, ...]
    arcs_deg: np.ndarray
    uncertainty: SurfaceUncertainty
    arc_difference: ArcDifference | None = None
    check: MonteCarlo | None = None

    @property
    def surface(self) -> Any:
        """The refined surface with its covariance, an `UncertainSurface`."""
        members = None
        if self.check is not None:
            shape = self.refined.surface.mu_nodes.shape
            members = self.check.members().T.reshape(-1, *shape)
        names = [source.name for source in self.uncertainty.sources]
        return UncertainSurface(self.refined.surface, self.uncertainty.factor, names, members)

    def outliers(self) -> tuple[str, ...]:
        """Runs that lost their weight, each with a sentence."""
        weight = self.refined.weight
        return tuple(
            f"run {self.runs[k]}: far from what the others say, weight {weight[k]:.2g}"
            for k in np.flatnonzero(weight < 0.5)
        )

    def disagreement(self) -> tuple[str, ...]:
        """What of the runs no surface explains, each with a sentence."""
        lines, apart, scale = [], self.arc_difference, self.refined.smoothness.noise_scale
        if apart is not None and apart.is_real:
            lines.append(
                f"arcs differ: the runs at {apart.higher_deg:.4g}° lie {100 * apart.size:.2g} % "
                f"above those at {apart.lower_deg:.4g}° on one surface, where scatter and stated "
                f"uncertainties explain {100 * apart.explained:.2g} %: a wear track, an arc or a "
                "load cell that is wrong; the difference is in the uncertainty of the surface"
            )
        if scale > MOST_NOISE:
            lines.append(
                f"the runs scatter {scale:.2g} times as much as their standard errors say, at most "
                f"{MOST_NOISE:g} is usual: something changed from run to run (run-in, temperature, "
                "wear), which the uncertainty of the surface does not hold"
            )
        return tuple(lines)

    def misfit_table(self) -> list[dict[str, Any]]:
        """Misfit of the simulated coefficients before and after, per arc and in all [%]."""
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

    def arc_spread_percent(self, misfit: np.ndarray) -> float | None:
        """Standard deviation of the arcs' mean misfits [%]; None for a single arc."""
        means = [float(np.mean(misfit[self.arcs_deg == arc])) for arc in np.unique(self.arcs_deg)]
        return 100.0 * float(np.std(means, ddof=1)) if len(means) > 1 else None


def _rms_percent(values: np.ndarray) -> float:
    return 100.0 * float(np.sqrt(np.mean(np.square(values))))


def run(
    config: ConfigSource,
    inputs: Mapping[str, Path],
    out: Path,
    options: Options,
    bootstrap: int = 0,
    seed: int = 0,
) -> Summary:
    """Refine the surface of a friction table with a stiffness, write it, sum it up.

    `bootstrap` draws check the uncertainty; 0 leaves the check out.
    """
    draws = Draws(bootstrap, seed, options.reporter, options.workers or Workers())
    build = Build(KIND, config, KEYS, inputs, out, options, draws.choices, FIGURES)
    built = build.up_to_date()
    if built is None:
        friction = read_artifact(inputs["friction"], "friction")
        stiffness = read_artifact(inputs["stiffness"], "stiffness")
        law = press_law(law_of(stiffness), config.config, stiffness)
        options.reporter.report(
            f"{friction.path}: {len(friction.columns['run'])} runs, inverse solution"
        )
        outcome = _outcome(friction.columns, law, config.config, str(friction.path), draws)
        built = build.write(outcome)
    return summarise(built)


def refine_surface(
    friction: Any,
    law: NormalLaw | Outcome[Any],
    config: Config | Mapping[str, Any] | str | Path | None = None,
    *,
    bootstrap: int = 0,
    seed: int = 0,
) -> Outcome[Refinement]:
    """Find the friction surface with which the simulated rig gives the measured tension ratios.

    Parameters
    ----------
    friction : Outcome of fit_friction, DataFrame, pyarrow Table or mapping
        A row per reduced run.
    law : NormalLaw or Outcome of fit_stiffness
        Normal contact law of the belt; the result brings its scatter along.
    config : Config, dict, path or None
        Belt and rig; None is the built-in 5PK rig.
    bootstrap : int
        Draws of the Monte Carlo check of the uncertainty; 0 leaves it out.
    seed : int
        Of the draws.

    Returns
    -------
    Outcome
        ``.to_frame()`` has a row per node; ``.result.surface`` is the refined `FrictionSurface`,
        ``.result.misfit_table()`` the misfit before and after.

    Raises
    ------
    InputError
        If the runs do not suffice.
    ConvergenceError
        If a run cannot be simulated or the iteration does not converge.
    """
    known = checked_law(law)
    model = load_config(config)
    columns = table_columns(friction, "friction", NEEDED)
    press = press_law(known, model, law if isinstance(law, Outcome) else None)
    return _outcome(columns, press, model, "friction table", Draws(bootstrap, seed))


def _outcome(
    columns: Mapping[str, np.ndarray], press: PressLaw, config: Config, name: str, draws: Draws
) -> Outcome[Refinement]:
    campaign, speeds, used, set_aside = prepared_campaign(columns, press, config, name)
    refined = draws.workers.call(refine, campaign.bench, campaign.runs, speeds)
    labels = tuple(str(columns["run"][i]) for i in used)
    slopes = draws.workers.call(refined_slopes, campaign, refined, speeds)
    campaign = replace(campaign, measured=campaign.measured.with_arc_effects(refined.response))
    uncertainty = refined_uncertainty(campaign, refined, slopes, config)
    settings = SurfaceSettings(force_nodes=config.surface.force_nodes)
    check = None
    if draws.count:
        nominal = prepare(campaign, refined, speeds, settings, (uncertainty.sources, slopes))
        found = drawn(nominal, draws)
        check = check_of(nominal, found, uncertainty.factor, uncertainty.sources)
    apart = arc_difference(campaign.measured, refined, uncertainty.sources)
    result = Refinement(refined, labels, columns["arc_deg"][used], uncertainty, apart, check)
    beside = friction_formulas(refined.surface, uncertainty.factor)
    force, slip = campaign.measured.normal_force, campaign.measured.slip_speed
    return Outcome(
        kind=KIND,
        columns=_table(result, speeds[speed_labels(columns, used, speeds)]),
        result=result,
        validity=dict(refined.surface.validity),
        set_aside=set_aside,
        extra={
            "method": METHOD,
            "degree": refined.surface.degree,
            "n_points": len(labels),
            "rms_arc_spread": _share(result.arc_spread_percent(refined.misfit_after)),
            "max_arc_spread": None,
            "misfit": result.misfit_table(),
            "arc_spread_before": _share(result.arc_spread_percent(refined.misfit_before)),
            "iterations": refined.iterations,
            "noise_scale": refined.smoothness.noise_scale,
            "effective_parameters": refined.effective_parameters,
            "measured": {"normal_force_N_m": span(force), "slip_speed_m_s": span(slip)},
            **uncertainty.extra((float(force.min()), float(force.max()))),
            **(check.extra(draws.seed) if check else {}),
            **beside.extra,
        },
        notes=(
            "beyond the measured mean forces of the runs the surface is inferred: its range is "
            "that of the forces that acted within their contact, peaks included",
            *([check.note()] if check else []),
            *beside.notes,
        ),
        warnings=(
            *result.disagreement(),
            *result.outliers(),
            *(check.warnings() if check else ()),
        ),
    )


def _share(percent: float | None) -> float | None:
    return None if percent is None else percent / 100.0


def _table(result: Refinement, run_speed: np.ndarray) -> dict[str, np.ndarray]:
    """Rows of the surface table: the surface that all arcs have in common."""
    surface = result.refined.surface
    forces, speeds = surface.normal_force_N_m, surface.slip_speed_m_s
    arcs = [np.unique(result.arcs_deg[run_speed == v]).size for v in speeds]
    errors = surface.mu_se_nodes
    assert errors is not None
    members = {} if result.check is None else {"mu_members": result.check.members()}
    return {
        "arc_deg": np.full(forces.size * speeds.size, np.nan),
        "normal_force_N_m": np.repeat(forces, speeds.size),
        "slip_speed_m_s": np.tile(speeds, forces.size),
        "mu": surface.mu_nodes.ravel(),
        "mu_se": errors.ravel(),
        "n_arcs": np.tile(np.array(arcs), forces.size),
        "mu_spread": np.full(forces.size * speeds.size, np.nan),
        **result.uncertainty.columns(forces.size * speeds.size),
        **members,
    }


def summarise(built: Built) -> Summary:
    """Sum up a refined surface."""
    metadata: SurfaceMetadata = built.artifact.metadata
    validity = metadata.validity
    surface = surface_of(built.artifact)
    check = metadata.monte_carlo
    places = check["linear_fails_at"] if check else []
    return Summary(
        stage="refine-surface",
        title="simulated less measured friction coefficient: published surface, then refined",
        out=built.artifact.path,
        facts={
            "runs": metadata.n_points,
            "iterations": metadata.iterations,
            "noise_over_stated_errors": metadata.noise_scale,
            "effective_parameters": metadata.effective_parameters,
            "arc_to_arc_spread_before_percent": _percent(metadata.arc_spread_before),
            "arc_to_arc_spread_after_percent": _percent(metadata.rms_arc_spread),
            "force_nodes": surface.normal_force_N_m.size,
            "speed_nodes": surface.slip_speed_m_s.size,
            "measured_force_N_m": metadata.measured.get("normal_force_N_m"),
            "valid_force_N_m": validity.get("normal_force_N_m"),
            "valid_speed_m_s": validity.get("slip_speed_m_s"),
            "budget": metadata.budget,
            **({"draws": check["replicates"], "seed": check["seed"]} if check else {}),
            **({"linear_fails_at": places} if places else {}),
        },
        beside={
            "standard uncertainty of the refined surface, in percent of mu": budget_table(
                metadata.budget, QUANTITY
            ),
            **({CHECKED: check_table(check["table"])} if check else {}),
        },
        table=[{name: row[name] for name in MISFIT_COLUMNS} for row in metadata.misfit],
        notes=built.notes,
        warnings=built.warnings,
        up_to_date=built.up_to_date,
        origin=built.origin,
        details={"friction formulas": friction_law_rows(metadata.figures)},
    )


def _percent(share: float | None) -> float | None:
    return None if share is None else 100.0 * share

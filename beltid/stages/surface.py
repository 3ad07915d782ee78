"""From friction coefficients of the runs to mu(f_N, v): as published (section 2.2), and refined.

The refined surface is the one with which the simulated rig gives the measured tensions: the
solution of the inverse problem.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from beltid.config import Config
from beltid.errors import BeltidError, InputError, counted, percent
from beltid.identify.estimators import settings_of
from beltid.identify.surface.laws import fit_friction_laws
from beltid.identify.surface.surface import SurfaceResult, build_surface
from beltid.laws.friction_surface import FrictionSurface
from beltid.params import Rig
from beltid.refine.inverse import (
    CONFOUNDED,
    RefinedSurface,
    ShownEffect,
    contradictions,
    refine_surface,
    shown_effects,
)
from beltid.refine.posterior import SCATTER
from beltid.rig.model import Bench
from beltid.stage import Outcome
from beltid.stages.friction import rig_kind
from beltid.stages.inputs import (
    Columns,
    at,
    friction_columns,
    ok_rows,
    press_law,
    span,
    standard_uncertainties,
)
from beltid.stages.rig import guided_weight, refuse_running
from beltid.stages.workers import Workers
from beltid.tables.schemas import CONDITIONS
from beltid.uncertainty.measured import (
    PressLaw,
    measured_runs,
    own_errors,
    published_uncertainty,
    valid_rows,
)
from beltid.uncertainty.simulated import Campaign
from beltid.uncertainty.sources import (
    ARC,
    COURSE,
    ORDER,
    SURFACE,
    TEMPERATURE,
    SurfaceUncertainty,
    reduction_sources,
    stated_sources,
)

NO_ARC_DEG = 90.0  # of coefficients that a table states without an arc: a single group
MEASURED = ("arc_deg", "normal_force_N_m", "slip_speed_m_s", "mu_sliding")
NEEDED = (*MEASURED, "run", "initial_tension_N", "pulley_speed_rad_s", "mu_sliding_se")
REASONS = 3  # number of reasons for unusable runs that are reported, most frequent first
SPEED_GAP = 0.1  # in ln v: a run further than this from every speed gets its own speed
SETTING_GAP = 0.03  # relative gap between two settings of the speed
MOST_NOISE = 3.0
REMEDY = "Measure in random order"
EFFECTS = {
    ARC: ("difference between arcs", "a wear track, or a wrong arc or load cell"),
    ORDER: ("steady change over the campaign", "run-in or wear; the surface holds for its middle"),
    COURSE: ("other change over the campaign, root mean square", "the surface holds for its mean"),
    TEMPERATURE: (
        "temperature, per 10 K",
        "the surface holds for the mean of the runs, unless friction.correct_temperature: true",
    ),
    SCATTER: ("scatter from run to run", ""),
}
"""Effect in the runs -> its name, and what it may be or what it means for the surface."""


def published(
    friction: Any, config: Config, chosen: Mapping[str, str | None]
) -> Outcome[SurfaceResult]:
    """Build the surface of every arc and their average from the usable runs of one condition."""
    columns = friction_columns(friction, MEASURED)
    with at(friction):
        n, good = len(columns["arc_deg"]), np.flatnonzero(ok_rows(columns))
        if good.size == 0:
            raise InputError(f"none of its {n} runs has the status ok, at least one is needed")
        good = rows_of_one(columns, good, chosen)
        direct = not np.isfinite(columns["arc_deg"][good]).any()
        if direct:
            columns = {**columns, "arc_deg": np.full(n, NO_ARC_DEG)}
        result = published_from(columns, good)
    rig, used = config.rig_params(), valid_rows(columns, good)
    uncertainty = published_uncertainty(
        measured_runs(columns, used, rig.R, rig_kind(config), rig.given_force),
        result.average,
        {} if direct else standard_uncertainties(config),
    )
    ranges = columns["normal_force_N_m"][used], np.abs(columns["slip_speed_m_s"][used])
    facts, tables, notes = said_of_surface(result.surface, columns, good, ranges, uncertainty)
    table, spread = result.to_columns(), result.rms_arc_spread
    arc_deg = table["arc_deg"]
    return Outcome(
        {**table, **uncertainty.columns(arc_deg.size)},
        result,
        facts={
            "points": result.n_points,
            "arcs_deg": np.unique(arc_deg[np.isfinite(arc_deg)]).tolist(),
            "arc_to_arc_spread_rms_percent": None if spread is None else 100.0 * spread,
            "method": "published",
            **facts,
        },
        tables=tables,
        validity=result.surface.validity,
        set_aside=[{"point": line} for line in result.set_aside],
        notes=(*result.notes, *notes),
        warnings=tuple(f"set aside: {line}" for line in result.set_aside),
    )


def published_from(columns: Columns, rows: np.ndarray) -> SurfaceResult:
    """Build the surface of some runs."""
    arcs, force, speed, mu = (columns[name][rows] for name in MEASURED)
    return build_surface(arcs, force, speed, mu, own_errors(columns)[rows])


def rows_of_one(columns: Columns, rows: np.ndarray, chosen: Mapping[str, str | None]) -> np.ndarray:
    """Select the rows that were measured on the chosen surface and side of the belt."""
    for column in CONDITIONS:
        labels = columns.get(column, np.full(len(columns["mu_sliding"]), None))[rows]
        counts = Counter("not stated" if label is None else str(label) for label in labels)
        there = ", ".join(f"{label} ({counted(n, 'run')})" for label, n in sorted(counts.items()))
        if (wanted := chosen.get(column)) is not None:
            rows = rows[labels == wanted]
            if not rows.size:
                raise InputError(f"no run has the {column} {wanted}; there are {there}")
        elif len(counts) > 1:
            raise InputError(f"runs of different {column}: {there}; choose one with --{column}")
    return rows


def said_of_surface(
    surface: FrictionSurface,
    columns: Columns,
    rows: np.ndarray,
    ranges: tuple[np.ndarray, np.ndarray],
    uncertainty: SurfaceUncertainty,
) -> tuple[dict[str, Any], dict[str, Any], tuple[str, ...]]:
    """Return facts, tables and notes of any surface; `ranges`: forces and speeds of the runs."""
    stated = {
        name: str(columns[name][rows[0]])
        for name in CONDITIONS
        if name in columns and columns[name][rows[0]] is not None
    }
    force, speed = map(span, ranges)
    assert force is not None
    extra = uncertainty.extra(force)
    formulas, notes = _friction_formulas(surface, uncertainty.factor)
    facts = {
        "degree": surface.degree,
        "force_nodes": surface.normal_force_N_m.size,
        "speed_nodes": surface.slip_speed_m_s.size,
        "valid_force_N_m": surface.validity["normal_force_N_m"],
        "valid_speed_m_s": surface.validity["slip_speed_m_s"],
        "measured_force_N_m": force,
        "measured": {"normal_force_N_m": force, "slip_speed_m_s": speed},
        "uncertainty": extra["uncertainty"],
        **({"conditions": stated} if stated else {}),
    }
    return facts, {"budget": extra["budget"], "friction_formulas": formulas}, notes


def _friction_formulas(
    surface: FrictionSurface, factor: np.ndarray
) -> tuple[list[dict[str, Any]], tuple[str, ...]]:
    """Fit parametric friction laws to the nodes, `factor` (nf, nv, r): rows of a table, notes."""
    grid = np.meshgrid(surface.normal_force_N_m, surface.slip_speed_m_s, indexing="ij")
    force, speed, mu = (values.ravel() for values in (*grid, surface.mu_nodes))
    try:
        laws = fit_friction_laws(force, speed, mu, factor.reshape(mu.size, -1))
    except BeltidError as error:
        return [], (f"No friction formula for the surface: {error}",)
    return [
        {
            "law": fit.law,
            "parameters": ", ".join(map(_parameter, fit.parameters)),
            "rms_misfit_percent": 100.0 * fit.rms_misfit,
            "worst_misfit_percent": 100.0 * fit.worst_misfit,
            "criterion": fit.criterion,
            "formula": fit.formula,
        }
        for fit in laws.fits
    ], (laws.verdict, *laws.notes)


def _parameter(p: Any) -> str:
    """Format a parameter with its error; an unknown one is "?"."""
    unit = f" {p.unit}" if p.unit not in ("", "-") else ""
    error = f"{p.se:.2g}" if p.se is not None and np.isfinite(p.se) else "?"
    return f"{p.name} = {p.value:.5g} ± {error}{unit}"


@dataclass(frozen=True, slots=True)
class Refinement:
    """A refined surface with the runs that it was made from."""

    refined: RefinedSurface  # the solution of the inverse problem
    runs: tuple[str, ...]
    arcs_deg: np.ndarray  # arcs of these runs [deg]
    effects: tuple[ShownEffect, ...] = ()  # effects in the runs that the surface does not describe

    @property
    def surface(self) -> FrictionSurface:
        """The refined surface with its covariance."""
        return self.refined.surface

    def misfit_table(self) -> list[dict[str, Any]]:
        """Return the misfit of the simulated coefficients before and after, also per arc [%]."""
        before, after = self.refined.misfit_before, self.refined.misfit_after
        groups = {f"arc {arc:g}°": self.arcs_deg == arc for arc in np.unique(self.arcs_deg)}
        return [
            {
                "group": name,
                "runs": int(np.count_nonzero(of)),
                "rms_before_percent": 100.0 * float(np.sqrt(np.mean(before[of] ** 2))),
                "mean_before_percent": 100.0 * float(np.mean(before[of])),
                "rms_after_percent": 100.0 * float(np.sqrt(np.mean(after[of] ** 2))),
                "mean_after_percent": 100.0 * float(np.mean(after[of])),
            }
            for name, of in {"all runs": np.full(self.arcs_deg.size, True), **groups}.items()
        ]

    def arc_spread(self, misfit: np.ndarray) -> float:
        """Return the standard deviation of the arcs' mean misfits [-]; nan for a single arc."""
        means = [np.mean(misfit[self.arcs_deg == arc]) for arc in np.unique(self.arcs_deg)]
        return float(np.std(means, ddof=1)) if len(means) > 1 else math.nan


def refined(
    friction: Any,
    law: Any,
    config: Config,
    chosen: Mapping[str, str | None],
    workers: Workers | None,
) -> Outcome[Refinement]:
    """Refine the surface of the usable runs of one condition, in a worker."""
    press, columns = press_law(law, config), friction_columns(friction, NEEDED)
    with at(friction):
        campaign, speeds, used, set_aside = prepared_campaign(columns, press, config, chosen)
    reference, measured = reference_temperature(config, campaign), campaign.measured
    stated = stated_sources(
        standard_uncertainties(config), SURFACE, n_arcs=int(measured.arc.max()) + 1
    )
    call = (campaign, speeds, (*stated, *reduction_sources(measured.columns)), reference)
    (found,) = (workers or Workers()).run(refine_surface, [call])
    runs, arcs = tuple(str(columns["run"][i]) for i in used), columns["arc_deg"][used]
    result = Refinement(found, runs, arcs, shown_effects(found))
    ranges = measured.normal_force, measured.slip_speed
    facts, tables, notes = said_of_surface(found.surface, columns, used, ranges, found.uncertainty)
    return Outcome(
        _table(result, columns["slip_speed_m_s"][used]),
        result,
        facts={
            "runs": len(runs),
            "iterations": found.iterations,
            "noise_over_stated_errors": found.noise_scale,
            "effective_parameters": found.effective_parameters,
            "arc_to_arc_spread_before_percent": 100.0 * result.arc_spread(found.misfit_before),
            "arc_to_arc_spread_after_percent": 100.0 * result.arc_spread(found.misfit_after),
            "method": "refined",
            "reference_temperature_degC": reference,
            **facts,
        },
        tables={
            "misfit": result.misfit_table(),
            "effects": [
                {
                    "effect": EFFECTS[effect.key][0],
                    "size_percent": 100.0 * effect.size,
                    "standard_uncertainty_percent": 100.0 * effect.uncertainty,
                    "clear": effect.is_clear,
                    "explained_percent": 100.0 * effect.explained,
                }
                for effect in result.effects
            ],
            **tables,
        },
        validity=found.surface.validity,
        set_aside=set_aside,
        notes=(
            *_unclear(result.effects),
            *_bending_stiffness(found),
            *guided_weight(config, measured.beta, measured.T_0),
            *notes,
        ),
        warnings=(*found.warnings, *_disagreement(result)),
    )


def prepared_campaign(
    columns: Columns, press: PressLaw, config: Config, chosen: Mapping[str, str | None]
) -> tuple[Campaign, np.ndarray, np.ndarray, list[dict[str, Any]]]:
    """Return the campaign with its initial surface, speeds, rows, and the runs set aside."""
    rig = rig_of_runs(columns, config)
    good, set_aside = usable_runs(columns, rig)
    good = rows_of_one(columns, good, chosen)
    if good.size < 4:
        reasons = Counter(row["why"] for row in set_aside).most_common(REASONS)
        why = "".join(f"; {counted(n, 'run')}: {text}" for text, n in reasons)
        raise InputError(f"{counted(good.size, 'run')} can be used, at least 4 are needed{why}")
    start = published_from(columns, good).surface
    campaign = Campaign(
        measured_runs(columns, good, rig.R, rig_kind(config), rig.given_force),
        Bench(config.belt_params(), rig, config.contact_params(), press.law, start),
        press,
    )
    # the speeds that are published, and those that are left out there
    published, v = start.slip_speed_m_s, np.abs(columns["slip_speed_m_s"][good])
    far = v[np.abs(np.log(v[:, None] / published)).min(axis=1) > SPEED_GAP]
    label = settings_of(far, SETTING_GAP)
    speeds = np.union1d(published, [far[label == k].mean() for k in np.unique(label)])
    return campaign, speeds, good, set_aside


def rig_of_runs(columns: Columns, config: Config) -> Rig:
    """Return the rig of the runs; without tensions at rest their sum while sliding is given."""
    if "torque_with" in columns and config.rig.kind != "torque":
        raise InputError(
            "column torque_with: the tensions were measured with a torque, and the table does not "
            "say of which rig; pass the result of fit_friction, its DataFrame or its file"
        )
    refuse_running(config)
    rig = config.rig_params()
    known = np.isfinite(np.asarray(columns["initial_tension_N"], dtype=float)).any()
    return replace(rig, given_force="hub") if rig.given_force == "none" and not known else rig


def usable_runs(columns: Columns, rig: Rig) -> tuple[np.ndarray, list[dict[str, Any]]]:
    """Return the usable rows, and the others with the reason."""
    status = columns.get("status", np.full(len(columns["run"]), "ok", dtype=object))
    why = np.where(status == "ok", "", status).astype(object)
    for key in (*MEASURED, "initial_tension_N") if rig.given_force == "none" else MEASURED:
        value = np.asarray(columns[key], dtype=float)
        why[(why == "") & np.isnan(value)] = f"{key} is not known"
        for i in np.flatnonzero((why == "") & ~((value > 0.0) & (value < math.inf))):
            why[i] = f"{key} = {value[i]:g}, must be > 0"
    return np.flatnonzero(why == ""), [
        {"run": str(columns["run"][i]), "why": str(why[i])} for i in np.flatnonzero(why != "")
    ]


def reference_temperature(config: Config, campaign: Campaign) -> float | None:
    """Return the temperature to which the surface is corrected [°C]; None without correction."""
    if not config.friction.correct_temperature:
        return None
    temperature = campaign.measured.temperature_degC
    if temperature is None or not np.isfinite(temperature).any():
        raise InputError("friction.correct_temperature: true, but no run has a temperature_degC")
    stated = config.friction.reference_temperature_degC
    return float(np.nanmean(temperature)) if stated is None else stated


def _table(result: Refinement, run_speed: np.ndarray) -> dict[str, np.ndarray]:
    """Return the rows of the surface table: the common surface of all arcs."""
    surface = result.refined.surface
    forces, speeds, n = surface.normal_force_N_m, surface.slip_speed_m_s, surface.mu_nodes.size
    nearest = np.argmin(np.abs(np.log(run_speed[:, None] / speeds)), axis=1)
    n_arcs = [np.unique(result.arcs_deg[nearest == k]).size for k in range(speeds.size)]
    assert surface.mu_se_nodes is not None
    return {
        "arc_deg": np.full(n, np.nan),
        "normal_force_N_m": np.repeat(forces, speeds.size),
        "slip_speed_m_s": np.tile(speeds, forces.size),
        "mu": surface.mu_nodes.ravel(),
        "mu_se": surface.mu_se_nodes.ravel(),
        "n_arcs": np.tile(np.array(n_arcs), forces.size),
        "mu_spread": np.full(n, np.nan),
        **result.refined.uncertainty.columns(n),
    }


def _disagreement(result: Refinement) -> Iterator[str]:
    """Yield what no surface explains: effects, scatter, errors larger than stated, outliers."""
    found, scale = result.refined, result.refined.noise_scale
    for effect in result.effects:
        if effect.is_clear:
            what, meaning = EFFECTS[effect.key]
            of = " at {1:.4g}° above {0:.4g}°".format(*effect.arcs_deg) if effect.arcs_deg else ""
            size, u = 100.0 * effect.size, 100.0 * effect.uncertainty
            digits = max(0, 1 - math.floor(math.log10(u)))
            change = f"{size:+.{digits}f} ± {u:.{digits}f} %"
            yield f"friction changes by {change}{of} ({what}): {meaning}"
    if scale > MOST_NOISE:
        most = f"at most {MOST_NOISE:g} is usual: the uncertainty of the surface includes it"
        yield f"the runs scatter {scale:.2g} times as much as their standard errors say, {most}"
    for name, size in contradictions(found).items():
        yield f"{name}: the runs require {size:.2g} standard uncertainties: wrong, or another rig"
    for k in np.flatnonzero(found.weight < 0.5):
        yield f"run {result.runs[k]}: far from the other runs, weight {found.weight[k]:.2g}"


def _unclear(effects: tuple[ShownEffect, ...]) -> Iterator[str]:
    """Yield notes on effects that the runs cannot tell from the surface, or from others."""
    confounded = [effect for effect in effects if effect.explained > CONFOUNDED]
    hidden = [f"{EFFECTS[e.key][0]} ({percent(100 * e.explained)})" for e in confounded]
    if hidden:
        yield f"cannot be told from the force and the speed: {', '.join(hidden)}. {REMEDY}"
    if large := [EFFECTS[e.key][0] for e in effects if e.is_large and not e.is_clear]:
        yield f"{', '.join(large)}: large, but others explain the runs nearly as well. {REMEDY}"


def _bending_stiffness(found: RefinedSurface) -> Iterator[str]:
    """Yield a note with EI as stated and as the runs show it; none if it is stated as exact."""
    EI = found.campaign.bench.belt.EI
    for source, error, sd in found.stated_errors:
        if source.error == "bending_stiffness":
            stated = f"{EI:.4g} N m² ± {100 * source.size:.2g} % ({source.basis})"
            shown = f"{EI * (1 + source.size * error):.4g} N m² ± {100 * source.size * sd:.2g} %"
            yield f"bending stiffness: {stated}; with the runs it would be {shown}"

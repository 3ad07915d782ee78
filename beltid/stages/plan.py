"""The next runs of the friction rig, or the advice to stop."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from beltid.config import Config
from beltid.errors import ConvergenceError, InputError, counted
from beltid.laws.penalty import NormalLaw
from beltid.notes import log
from beltid.params import OperatingPoint
from beltid.plan.candidates import (
    NoiseLaw,
    knowledge_at,
    noise_law,
    settings_of_rig,
    simulate_candidates,
    sources_of_plan,
)
from beltid.plan.design import Plan, Target, choose_plan, schedule, surface_target
from beltid.stage import Outcome
from beltid.stages.friction import rig_kind
from beltid.stages.inputs import (
    Columns,
    friction_columns,
    friction_of,
    ok_rows,
    press_law,
    shown,
    standard_uncertainties,
    surface_from,
)
from beltid.stages.rig import KEYS, bench_of, measured_settings, setting_lists
from beltid.stages.surface import NEEDED
from beltid.store.artifact import Artifact, combined_origin
from beltid.uncertainty.measured import Measured, measured_runs, valid_rows
from beltid.uncertainty.sources import EFFECT_SOURCES, FITTED, Source, SurfaceUncertainty

USUAL_LAW = NormalLaw(6.5e7, 3.0256e11)  # of the paper's 5PK belt, before any measurement
MOST_SETTINGS = 12  # arcs, tensions or speeds of the candidates of a plan
MOST_STATEMENTS = 6


@dataclass(frozen=True, slots=True)
class PlannedRuns:
    """The next runs of a rig."""

    plan: Plan  # gain of the runs, remaining uncertainty, and whether to stop
    target: Target  # where the surface has to be known


def planned(
    surface: Any, law: Any, config: Config, friction: Any, runs: int, goal_u: float
) -> Outcome[PlannedRuns]:
    """Plan from what is known: the surface, the law, the noise of reduced runs."""
    problems = []
    if runs < 1:
        problems.append(f"--runs = {runs}, must be >= 1")
    if not 0.0 <= goal_u < 1.0:
        problems.append(f"--goal-u = {goal_u:g}, must be in [0, 1)")
    if problems:
        raise InputError(problems)
    noise_of = set_by = None if friction is None else friction_columns(friction, NEEDED)
    if set_by is None and isinstance(surface, Artifact) and (beside := friction_of(surface)):
        set_by = beside.columns
    points, assumed = _settings(config, set_by)
    known = None if surface is None else _known_surface(surface)
    press, stated = press_law(law or USUAL_LAW, config), standard_uncertainties(config)
    sources = sources_of_plan(known, stated, [float(np.degrees(p.beta)) for p in points])
    scale = getattr(surface, "facts", {}).get("noise_over_stated_errors") or 1.0
    noise, columns = _noise(noise_of, scale, config)
    log.info("%d candidates, simulated with the present surface", len(points))
    bench, kind = bench_of(config, 1.0, press.law), rig_kind(config)
    try:
        rows, measured, curves = simulate_candidates(
            bench, press, points, known, sources, noise, columns, kind
        )
    except ConvergenceError as error:
        raise ConvergenceError(
            error.at(
                "a setting of plan: (without it of rig:) cannot be simulated, must be left out"
            )
        ) from error
    target = surface_target(
        curves,
        *((float(x.min()), float(x.max())) for x in (measured.normal_force, measured.slip_speed)),
    )
    plan = choose_plan(
        knowledge_at(curves, known, len(sources)),
        rows,
        target,
        sources,
        runs,
        goal_u,
        can_reverse=kind.measures == "two_cells",  # each span has a cell
    )
    origins = [item.origin for item in (surface, law, friction) if hasattr(item, "origin")]
    based_on = (combined_origin(origins) or "unknown") if origins else "usual values"
    session = _session(plan, points, measured, config, based_on)
    arcs, clock = session["arc_deg"], session["start_minutes"]
    notes = [f"settings of the rig, not stated, assumed: {'; '.join(assumed)}"] if assumed else []
    if law is None:
        notes.append("no data: contact law of the paper's 5PK belt")
    if known is None:
        notes.append("no data: mu from 0.7 to 1.5 with usual slopes over force and speed")
    elif other := known.stated_otherwise(stated):
        notes.append(f"used as stated when the surface was made: {', '.join(other)}")
    if noise_of is None:
        size = f"{100.0 * noise.friction:g} % of mu and {noise.tension:g} N"
        notes.append(f"assumed noise of a run: {size}; --from friction.parquet states it")
    if (session["pulley_speed_rad_s"] < 0.0).any():
        notes.append("runs with a negative speed tell the gain of the load cells from friction")
    return Outcome(
        session,
        PlannedRuns(plan, target),
        facts={
            "candidates": measured.mu.size,
            "runs": arcs.size,
            "arc_changes": max(np.unique(arcs).size - 1, 0),
            "session_minutes": clock[-1] + config.plan.minutes_per_run if clock.size else 0.0,
            "uncertainty_before_percent": 100.0 * plan.before,
            "uncertainty_after_percent": 100.0 * plan.after,
            "goal_percent": 100.0 * goal_u,
            "shared_by_all_runs_percent": 100.0 * plan.shared,
            "stop": plan.stop,
        },
        tables={
            "regions": plan.regions,
            "statements": [
                {
                    "source": statement.source.name,
                    "known": statement.source.basis,
                    "uncertainty": _size(statement.source),
                    "contribution_percent": 100.0 * statement.contribution,
                    "surface_then_percent": 100.0 * statement.halved,
                }
                for statement in plan.statements[:MOST_STATEMENTS]
            ],
        },
        notes=tuple(notes),
        verdict=_verdict(plan, goal_u),
    )


def _settings(config: Config, friction: Columns | None) -> tuple[list[OperatingPoint], list[str]]:
    """Return the possible settings of the rig, and those that are assumed, in words."""
    measured = None
    if friction is not None and all(name in friction for name in KEYS):
        found = measured_settings(friction, config)
        measured = found if found.size else None
    stated = config.plan.arcs_deg, config.plan.tension_N, config.plan.speed_rad_s
    fallbacks = [_thinned(values) for values in setting_lists(config, measured)]
    assumed = [
        f"{key}: {', '.join(f'{value:g}' for value in values)}"
        for key, of_plan, values in zip(KEYS.values(), stated, fallbacks, strict=True)
        if not of_plan and measured is None and key not in config.rig.model_fields_set
    ]
    lists = (tuple(of or values) for of, values in zip(stated, fallbacks, strict=True))
    return settings_of_rig(*lists), assumed


def _thinned(values: Sequence[float]) -> list[float]:
    """Thin a long list of settings, as when each run has its own value; keep both ends."""
    ordered = sorted(values)
    indices = np.linspace(0, len(ordered) - 1, min(len(ordered), MOST_SETTINGS)).round().astype(int)
    return [ordered[k] for k in indices]


def _known_surface(surface: Any) -> SurfaceUncertainty:
    if not isinstance(surface, (Artifact, Outcome)) or surface.kind != "surface":
        raise InputError(
            f"surface = {shown(surface)}, must be the result of refine_surface or build_surface, "
            "which has a covariance"
        )
    found, stored = surface_from(surface), surface.facts.get("uncertainty")
    if found.factor is None or stored is None:
        raise InputError(f"{getattr(surface, 'path', 'surface')}: has no covariance")
    return SurfaceUncertainty(
        surface=found,
        sources=tuple(Source(**row) for row in stored["sources"]),
        arcs_deg=np.asarray(stored["arcs_deg"], dtype=float),
    )


def _noise(
    friction: Columns | None, scale: float, config: Config
) -> tuple[NoiseLaw, dict[str, float]]:
    """Return the noise of a run, and the change of ln mu of a run by errors of the reduction."""
    if friction is None:
        return NoiseLaw(scale=scale), {}
    ok, rig = valid_rows(friction, np.flatnonzero(ok_rows(friction))), config.rig_params()
    runs = measured_runs(friction, ok, rig.R, rig_kind(config), rig.given_force)
    return noise_law(runs, scale), {k: float(np.mean(change)) for k, change in runs.columns.items()}


def _session(
    plan: Plan, points: Sequence[OperatingPoint], measured: Measured, config: Config, based_on: str
) -> dict[str, np.ndarray]:
    """Return the columns of the plan, with a row per run in the order of the session."""
    ways = [(p.beta, p.T_0, way * p.omega) for way in (1.0, -1.0) for p in points]
    session = schedule(
        plan.chosen, ways, config.plan.minutes_per_run, config.plan.minutes_per_arc_change
    )
    runs = [scheduled.run for scheduled in session]
    like = np.array(runs, dtype=int) % measured.mu.size
    arcs, tensions, speeds = np.array([ways[run] for run in runs]).reshape(-1, 3).T
    return {
        "order": np.arange(1, len(runs) + 1),
        "arc_deg": np.array([round(float(np.degrees(arc)), 9) for arc in arcs]),
        "initial_tension_N": tensions,
        "pulley_speed_rad_s": speeds,
        "repeat": np.array([scheduled.repeat for scheduled in session]),
        "repeats": np.array([scheduled.repeats for scheduled in session]),
        "start_minutes": np.array([scheduled.start_minutes for scheduled in session]),
        "gain_percent": np.array([100.0 * max(plan.gains[run], 0.0) for run in runs]),
        "slip_speed_m_s": measured.slip_speed[like],
        "normal_force_N_m": measured.normal_force[like],
        "based_on": np.array([based_on] * len(runs)),
        "needed_for": np.array([plan.needed.get(run, "") for run in runs]),
    }


def _size(source: Source) -> str:
    """Format the standard uncertainty of a source; one known only from the data has no figure."""
    by_data = source.basis == FITTED and source.error not in EFFECT_SOURCES
    return "by the data" if by_data else f"{source.shown:.3g} {source.unit}"


def _verdict(plan: Plan, goal_u: float) -> str:
    before, after, goal = 100.0 * plan.before, 100.0 * plan.after, 100.0 * goal_u
    text = f"stop: {100.0 * plan.shared:.0f} % of the variance of mu is shared by all runs"
    if best := plan.best_statement:
        text += (
            f"; halving the uncertainty of {best.source.name} would help most and give "
            f"{100.0 * best.halved:.2g} % in place of {before:.2g} %"
        )
    return {
        None: f"{counted(len(plan.chosen), 'run')}: uncertainty of mu {before:.3g} % -> "
        f"{after:.2g} %, goal {goal:g} % {'reached' if after <= goal else 'not reached'}",
        "goal reached": f"stop: goal reached: uncertainty of mu {before:.2g} % <= {goal:g} %",
        "runs do not help": "stop: further runs hardly lower the uncertainty of mu, "
        f"{before:.2g} %",
    }.get(plan.stop, text)

"""beltid plan: the next runs of the friction rig, or the word stop."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from beltid.artifacts.artifact import Artifact, read_artifact
from beltid.artifacts.file_bytes import write_bytes
from beltid.artifacts.metadata_models import SurfaceMetadata
from beltid.config import Config, ConfigSource, load_config
from beltid.drive.results import Simulator
from beltid.errors import ArgumentTypeError, InputError, Problem, counted
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.laws.uncertain_surface import UncertainSurface
from beltid.params import OperatingPoint
from beltid.plan.advice import Plan, choose_plan
from beltid.plan.candidates import (
    Candidates,
    NoiseLaw,
    Settings,
    noise_law,
    simulate_candidates,
)
from beltid.plan.present import KnownSurface, sources_of_plan
from beltid.plan.prior import MeasuredSurface, knowledge_at, usual_surface
from beltid.plan.session import ScheduledRun, schedule
from beltid.plan.target import Target, drive_target, surface_target
from beltid.report.drawing import saved
from beltid.report.figures.plan import runs_and_uncertainty
from beltid.report.summary import Summary, combined_origin
from beltid.rigsim.model import Bench
from beltid.stages.build_artifact import already_exists
from beltid.stages.drive.drive_of_config import drive_of, points_of_config
from beltid.stages.identification.reduction import rig_kind
from beltid.stages.outcome import Outcome
from beltid.stages.reporter import Options
from beltid.stages.simulation.planned_runs import at_rest, rig_settings
from beltid.stages.simulation.refinement import NEEDED
from beltid.stages.tables import (
    checked_law,
    friction_of,
    law_of,
    shown,
    surface_from,
    surface_of,
    table_columns,
)
from beltid.stages.uncertainties import press_law, standard_uncertainties
from beltid.uncertainty.measured import measured_runs, valid_rows
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.simulated import sources_of
from beltid.uncertainty.sources import FITTED, Source

if TYPE_CHECKING:
    import pandas as pd

TARGETS: Final = ("surface", "drive")
USUAL_LAW: Final = NormalLaw(6.5e7, 3.0256e11)
"""Contact law of the paper's 5PK belt, Eq. (3): for a plan before any measurement."""
MOST_BELOW: Final = 0.3
"""Share of a drive's friction below the speeds of all candidates above which there is a warning."""


@dataclass(frozen=True, slots=True)
class PlanOptions(Options):
    """Options of a plan.

    Attributes
    ----------
    runs : int
        Runs to plan at most.
    target : {"surface", "drive"}
        Where the surface has to be known.
    goal_u : float
        Standard uncertainty of mu that is good enough, as a share.
    """

    runs: int = 12
    target: str = "surface"
    goal_u: float = 0.01


@dataclass(frozen=True, slots=True)
class Present:
    """What is known before the next runs.

    Attributes
    ----------
    surface : MeasuredSurface or None
        The surface; None before any run.
    arcs_deg : tuple of float
        Its arc settings [deg].
    sources : tuple of Source
        The shared errors of its changes.
    press : PressLaw
        The contact law.
    noise : NoiseLaw
        Noise of a run.
    columns : dict of str to float
        What the errors of the reduction change in ln mu of a run.
    notes : tuple of str
        What was assumed.
    """

    surface: MeasuredSurface | None
    arcs_deg: tuple[float, ...]
    sources: tuple[Source, ...]
    press: PressLaw
    noise: NoiseLaw
    columns: dict[str, float]
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class PlannedRuns:
    """The next runs of a rig, in the order of the session.

    Attributes
    ----------
    plan : Plan
        What the runs bring, what remains after them, and whether to stop.
    target : Target
        Where the surface is to be known.
    candidates : Candidates
        The settings that the runs were chosen from.
    rows : list of dict
        A row per run: settings, repetition, minutes, gain.
    notes, warnings : tuple of str
        What was assumed, and what the user should look into.
    """

    plan: Plan
    target: Target
    candidates: Candidates
    rows: list[dict[str, Any]]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    def to_frame(self) -> pd.DataFrame:
        """The runs as a table, a row per run, with the columns of plan.csv."""
        import pandas as pd

        return pd.DataFrame(self.rows, columns=list(COLUMNS))


def run(
    config: ConfigSource, inputs: Mapping[str, Path], out: Path, options: PlanOptions
) -> Summary:
    """Plan the next runs, write table and figure, sum up.

    With ``surface`` and ``stiffness`` among the inputs it goes on from them, with ``friction`` by
    the noise of those runs; without any it starts from what is usual for such a belt.
    """
    figure = out.with_suffix(".png")
    _check_files(options, out, figure)
    artifacts = {role: read_artifact(path, role) for role, path in inputs.items()}
    origin = combined_origin([artifact.metadata.origin for artifact in artifacts.values()])
    press = known = friction = None
    if "stiffness" in artifacts:
        stiffness = artifacts["stiffness"]
        press = press_law(law_of(stiffness), config.config, stiffness)
    if "surface" in artifacts:
        known = _known_surface(artifacts["surface"])
    if "friction" in artifacts:
        friction = artifacts["friction"].columns
    based_on = origin if artifacts else "usual values"
    made_at = friction
    if made_at is None and "surface" in artifacts:
        made_from = friction_of(artifacts["surface"], inputs["surface"].parent)
        made_at = None if made_from is None else made_from.columns
    settings, notes = rig_settings(config.config, made_at)
    present = _present(known, press, friction, settings, config.config)
    found = _planned(present, settings, config.config, options, based_on or "unknown")
    plan, rows = found.plan, found.rows
    write_bytes(out, _csv(rows))
    measured = found.candidates.measured
    picture = runs_and_uncertainty(measured, found.target, plan, origin == "synthetic")
    write_bytes(figure, saved(picture, "png"))
    minutes = rows[-1]["start_minutes"] + config.config.plan.minutes_per_run if rows else 0.0
    return Summary(
        stage="plan",
        title="the next runs of the friction rig",
        out=out,
        facts={
            "candidates": measured.mu.size,
            "target": options.target,
            "runs": len(rows),
            "arc_changes": max(len({row["arc_deg"] for row in rows}) - 1, 0),
            "session_minutes": minutes,
            "uncertainty_before_percent": 100.0 * plan.before,
            "uncertainty_after_percent": 100.0 * plan.after,
            "goal_percent": 100.0 * options.goal_u,
            "shared_by_all_runs_percent": 100.0 * plan.shared,
            "stop": plan.stop,
            "figure": str(figure),
        },
        table=rows,
        shown=SHOWN,
        beside={
            "standard uncertainty by region, in percent of mu": _region_rows(plan),
            "if it were known twice as well": _statement_rows(plan),
        },
        notes=(*notes, *found.notes),
        warnings=found.warnings,
        verdict=_verdict(plan, options),
        origin=origin,
    )


def plan_runs(
    surface: Outcome[Any] | None = None,
    law: NormalLaw | Outcome[Any] | None = None,
    config: Config | Mapping[str, Any] | str | Path | None = None,
    *,
    friction: Any = None,
    runs: int = 12,
    target: str = "surface",
    goal_u: float = 0.01,
) -> PlannedRuns:
    """Plan the next runs of the friction rig.

    Parameters
    ----------
    surface : Outcome of refine_surface or build_surface, optional
        What is known; without it the plan starts from what is usual for such a belt.
    law : NormalLaw or Outcome of fit_stiffness, optional
        Normal contact law; without it that of the paper's 5PK belt.
    config : Config, dict, path or None
        Belt, rig, and under ``plan:`` what the rig can be set to.
    friction : Outcome of fit_friction, DataFrame, pyarrow Table or mapping, optional
        Reduced runs: new ones have their noise.
    runs : int
        Runs to plan at most; fewer where they reach the goal, none where they do not help.
    target : {"surface", "drive"}
        Where the surface has to be known.
    goal_u : float
        Standard uncertainty of mu that is good enough, as a share [-].

    Returns
    -------
    PlannedRuns
        ``.to_frame()`` has a row per run in the order of the session; ``.plan`` says what they
        bring and whether to stop.

    Raises
    ------
    InputError
        If an argument is out of range, or the surface has no covariance.
    """
    options = PlanOptions(runs=runs, target=target, goal_u=goal_u)
    if problems := _problems(options):
        raise InputError(problems)
    model = load_config(config)
    known = press = columns = None
    if surface is not None:
        known = _known_result(surface)
    if law is not None:
        press = press_law(checked_law(law), model, law if isinstance(law, Outcome) else None)
    if friction is not None:
        columns = table_columns(friction, "friction", NEEDED)
    based_on = "unknown" if surface is not None else "usual values"
    settings, notes = rig_settings(model, columns)
    present = _present(known, press, columns, settings, model)
    found = _planned(present, settings, model, options, based_on)
    return replace(found, notes=(*notes, *found.notes))


def _known_surface(artifact: Artifact) -> KnownSurface:
    """The surface of an artifact."""
    metadata: SurfaceMetadata = artifact.metadata
    surface = surface_of(artifact)
    if metadata.uncertainty is None:
        raise InputError(f"{artifact.path}: has no covariance; build it again")
    return _known(surface, metadata.uncertainty, metadata.noise_scale, str(artifact.path))


def _known_result(surface: Any) -> KnownSurface:
    """The surface of a result."""
    if not isinstance(surface, Outcome) or surface.kind != "surface":
        raise ArgumentTypeError(
            f"surface = {shown(surface)}, must be the result of refine_surface or build_surface: "
            "the plan needs its covariance by its causes"
        )
    extra = surface.extra
    return _known(surface_from(surface), extra["uncertainty"], extra.get("noise_scale"), "surface")


def _known(
    surface: FrictionSurface, stored: Mapping[str, Any], noise_scale: float | None, name: str
) -> KnownSurface:
    if not isinstance(surface, UncertainSurface) or surface.factor is None:
        raise InputError(f"{name}: has no covariance; build it again")
    return KnownSurface(
        surface=surface,
        factor=surface.factor,
        arcs_deg=tuple(float(arc) for arc in stored["arcs_deg"]),
        sources=sources_of(stored["sources"]),
        noise_scale=noise_scale or 1.0,
    )


def _planned(
    present: Present, settings: Settings, config: Config, options: PlanOptions, based_on: str
) -> PlannedRuns:
    """The plan from what is known, and what is assumed in place of the rest."""
    points = settings.points()
    options.reporter.report(f"{len(points)} candidates, simulated with the present surface")
    candidates = simulate_candidates(
        _bench(config, present.press.law),
        present.press,
        at_rest(settings, config),
        present.arcs_deg,
        None if present.surface is None else present.surface.surface,
        rig_kind(config),
    )
    target, warnings = _target(config, candidates, present, options.target)
    lines = candidates.rows(present.sources, present.noise, present.columns)
    before = knowledge_at(candidates.curves, present.surface, len(present.sources))
    plan = choose_plan(before, lines, target, present.sources, options.runs, options.goal_u)
    session = schedule(
        plan.chosen,
        [(point.beta, point.T_0, point.omega) for point in points],
        config.plan.minutes_per_run,
        config.plan.minutes_per_arc_change,
    )
    rows = _rows(session, plan, points, candidates, based_on)
    return PlannedRuns(plan, target, candidates, rows, present.notes, warnings)


def _problems(options: PlanOptions) -> list[str | Problem]:
    """Options out of range."""
    problems: list[str | Problem] = []
    if options.runs < 1:
        problems.append(f"--runs = {options.runs}, must be >= 1")
    if options.target not in TARGETS:
        problems.append(f"--target = {options.target}, must be one of {', '.join(TARGETS)}")
    if not 0.0 <= options.goal_u < 1.0:
        problems.append(f"--goal-u = {options.goal_u:g}, must be in [0, 1)")
    return problems


def _check_files(options: PlanOptions, out: Path, figure: Path) -> None:
    """Refuse options out of range, and files that would be replaced unasked."""
    problems = _problems(options)
    if out.exists() and not _is_plan(out):
        text = (
            f"{out}: is a file that `beltid plan` did not write, never replaced; name another --out"
        )
        problems.append(Problem(text, "not-replaced"))
    elif not options.force:
        problems += [already_exists(path) for path in (out, figure) if path.exists()]
    if problems:
        raise InputError(problems)


def _present(
    known: KnownSurface | None,
    press: PressLaw | None,
    friction: Mapping[str, np.ndarray] | None,
    settings: Settings,
    config: Config,
) -> Present:
    """What is known, None before any measurement, and what is assumed in its place."""
    notes: list[str] = []
    if press is None:
        press = press_law(USUAL_LAW, config)
        notes.append("no data: contact law of the paper's 5PK belt")
    stated = standard_uncertainties(config)
    sources = sources_of_plan(known, stated, settings.arcs_deg, press.has_scatter)
    if known is None:
        notes.append("no data: mu from 0.7 to 1.5 with usual slopes over force and speed")
    elif other := known.stated_otherwise(stated, press.has_scatter):
        notes.append(
            f"stated otherwise when the surface was made: {', '.join(other)}; what was stated then "
            "is taken"
        )
    scale = 1.0 if known is None else known.noise_scale
    noise, columns = NoiseLaw(scale=scale), {}
    if friction is not None:
        status = friction.get("status", np.full(len(friction["mu_sliding"]), "ok", dtype=object))
        ok = valid_rows(friction, np.flatnonzero(status == "ok"))
        rig = config.rig_params()
        runs = measured_runs(friction, ok, rig.R, rig_kind(config), rig.given_force)
        noise = noise_law(runs, scale)
        columns = {key: float(np.mean(change)) for key, change in runs.columns.items()}
    else:
        notes.append(
            f"noise of a run: {100.0 * noise.friction:g} % of mu and {noise.tension:g} N of the "
            "tensions; --from friction.parquet takes that of its runs"
        )
    surface = None if known is None else known.measured(len(sources))
    arcs = () if known is None else known.arcs_deg
    return Present(surface, arcs, sources, press, noise, columns, tuple(notes))


def _bench(config: Config, law: NormalLaw) -> Bench:
    belt, rig, contact = config.belt_params(), config.rig_params(), config.contact_params()
    return Bench(belt, rig, contact, law, FrictionSurface.constant(1.0))


def _target(
    config: Config, candidates: Candidates, present: Present, name: str
) -> tuple[Target, tuple[str, ...]]:
    """Where the surface has to be known, with what the user should look into."""
    curves, runs = candidates.curves, candidates.measured
    force, speed = runs.normal_force, runs.slip_speed
    if name == "surface":
        ranges = [(float(x.min()), float(x.max())) for x in (force, speed)]
        return surface_target(curves, ranges[0], ranges[1]), ()
    surface = (
        usual_surface(curves.log_force, curves.log_speed)
        if present.surface is None
        else present.surface.surface
    )
    simulator = Simulator(drive_of(config, surface, present.press.law))
    results = [simulator.solve(asked.point) for asked in points_of_config(config)]
    target = drive_target(curves, results)
    below = float(target.weight[target.slip_speed < speed.min() * (1.0 - 1e-9)].sum())
    if below <= MOST_BELOW:
        return target, ()
    return target, (
        f"{100.0 * below:.0f} % of the friction of the drive acts at speeds below the slowest "
        f"candidate, {speed.min():.3g} m/s; it counts there: add slower ones to plan.speed_rad_s",
    )


SHOWN: Final = (
    "order",
    "arc_deg",
    "initial_tension_N",
    "pulley_speed_rad_s",
    "repeat",
    "repeats",
    "start_minutes",
    "gain_percent",
    "needed_for",
)


def _rows(
    session: Sequence[ScheduledRun],
    plan: Plan,
    points: Sequence[OperatingPoint],
    candidates: Candidates,
    based_on: str,
) -> list[dict[str, Any]]:
    """A row per run in the order of the session.

    A run that the plan has to have, for its arc or as a repetition, may gain nothing by itself.
    """
    runs = candidates.measured
    gains = dict(zip(plan.chosen, plan.gains, strict=True))
    return [
        {
            "order": place,
            "arc_deg": round(float(np.degrees(points[one.run].beta)), 9),
            "initial_tension_N": points[one.run].T_0,
            "pulley_speed_rad_s": points[one.run].omega,
            "repeat": one.repeat,
            "repeats": one.repeats,
            "start_minutes": one.start_minutes,
            "slip_speed_m_s": float(runs.slip_speed[one.run]),
            "normal_force_N_m": float(runs.normal_force[one.run]),
            "gain_percent": 100.0 * max(gains[one.run], 0.0),
            "based_on": based_on,
            "needed_for": plan.needed.get(one.run, ""),
        }
        for place, one in enumerate(session, start=1)
    ]


COLUMNS: Final = (*SHOWN[:-1], "slip_speed_m_s", "normal_force_N_m", "based_on", "needed_for")
HEADER: Final = (",".join(COLUMNS) + "\n").encode()
KNOWN_BY: Final = (",".join(COLUMNS[:-1])).encode()


def _is_plan(path: Path) -> bool:
    """Whether a file is a table of runs that this command wrote."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(KNOWN_BY)) == KNOWN_BY


def _csv(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """The table for the operator of the bench."""
    text = io.StringIO()
    for row in rows:
        cells = [f"{v:.6g}" if isinstance(v := row[name], float) else str(v) for name in COLUMNS]
        text.write(",".join(cells) + "\n")
    return HEADER + text.getvalue().encode()


def _region_rows(plan: Plan) -> list[dict[str, Any]]:
    return [
        {
            "force_range_N_m": region.force,
            "speed_range_m_s": region.speed,
            "before_percent": 100.0 * region.before,
            "after_percent": 100.0 * region.after,
        }
        for region in plan.regions
    ]


MOST_STATEMENTS: Final = 6


def _statement_rows(plan: Plan) -> list[dict[str, Any]]:
    """Shared errors that would help most, and the uncertainty of the surface with each halved."""
    return [
        {
            "source": one.source.name,
            "known": one.source.basis,
            "uncertainty": ""
            if one.source.basis == FITTED
            else f"{one.source.shown:.3g} {one.source.unit}",
            "contribution_percent": 100.0 * one.contribution,
            "surface_then_percent": 100.0 * one.halved,
        }
        for one in plan.statements[:MOST_STATEMENTS]
    ]


def _verdict(plan: Plan, options: PlanOptions) -> str:
    """Go on or stop, and why."""
    before, after = 100.0 * plan.before, 100.0 * plan.after
    goal = 100.0 * options.goal_u
    if plan.stop is None:
        reached = "reached" if after <= goal else "not reached"
        count = counted(len(plan.chosen), "run")
        return (
            f"{count}: uncertainty of mu {before:.3g} % -> {after:.2g} %, goal {goal:g} % {reached}"
        )
    if plan.stop == "goal reached":
        return f"stop: goal reached: uncertainty of mu {before:.2g} % <= {goal:g} %"
    if plan.stop == "runs do not help":
        return f"stop: further runs hardly lower the uncertainty of mu, {before:.2g} %"
    best = plan.best_statement
    text = (
        f"stop: {100.0 * plan.shared:.0f} % of the variance of mu is shared by all runs, further "
        f"ones hardly lower its uncertainty, {before:.2g} %"
    )
    if best is None:
        return text
    return (
        f"{text}; most would help: {best.source.name}, known twice as well it is "
        f"{100.0 * best.halved:.2g} %"
    )

"""beltid plan: the next runs of the friction rig, or the word stop."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.artifacts.artifact import Artifact, read_artifact
from beltid.artifacts.file_bytes import write_bytes
from beltid.artifacts.metadata_models import SurfaceMetadata
from beltid.config import Config, ConfigSource
from beltid.drive.results import Simulator
from beltid.errors import InputError, Problem
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.plan.advice import Plan, plan_runs
from beltid.plan.candidates import (
    Candidates,
    NoiseLaw,
    Settings,
    noise_law,
    simulate_candidates,
)
from beltid.plan.prior import USUAL_ARCS, MeasuredSurface, knowledge_at, usual_surface
from beltid.plan.session import ScheduledRun, schedule
from beltid.plan.target import Target, drive_target, surface_target
from beltid.refine.effects import ARC
from beltid.report.drawing import saved
from beltid.report.figures.plan import runs_and_uncertainty
from beltid.report.summary import Summary
from beltid.rigsim.model import Bench
from beltid.stages.build_artifact import already_exists, combined_origin
from beltid.stages.drive_of_config import drive_of, points_of_config
from beltid.stages.reduction import rig_kind
from beltid.stages.reporter import Options
from beltid.stages.tables import law_of, surface_of
from beltid.stages.uncertainties import press_law, standard_uncertainties
from beltid.uncertainty.measured import measured_runs, valid_rows
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.sources import FITTED, Source, all_sources, effect_sources

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


def run(
    config: ConfigSource, inputs: Mapping[str, Path], out: Path, options: PlanOptions
) -> Summary:
    """Plan the next runs, write table and figure, sum up.

    With ``surface`` and ``stiffness`` among the inputs it goes on from them, with ``friction`` by
    the noise of those runs; without any it starts from what is usual for such a belt.
    """
    figure = out.with_suffix(".png")
    _check(options, out, figure)
    artifacts = {role: read_artifact(path, role) for role, path in inputs.items()}
    origin = combined_origin([artifact.metadata.origin for artifact in artifacts.values()])
    present = _present(artifacts, config.config)
    settings = rig_settings(config.config)
    count = len(settings.points())
    options.reporter.report(f"{count} candidates, simulated with the present surface")
    measured = None if present.surface is None else present.surface.surface
    candidates = simulate_candidates(
        _bench(config.config, present.press.law),
        present.press,
        settings,
        present.arcs_deg,
        measured,
    )
    target, warnings = _target(config.config, candidates, present, options.target)
    plan = _plan(candidates, present, config.config, target, options)
    section = config.config.plan
    points = settings.points()
    session = schedule(
        plan.chosen,
        [(point.beta, point.T_0, point.omega) for point in points],
        section.minutes_per_run,
        section.minutes_per_arc_change,
    )
    rows = _rows(session, plan, candidates, origin if artifacts else "usual values")
    write_bytes(out, _csv(rows))
    picture = runs_and_uncertainty(candidates.measured, target, plan, origin == "synthetic")
    write_bytes(figure, saved(picture, "png"))
    minutes = session[-1].start_minutes + section.minutes_per_run if session else 0.0
    return Summary(
        stage="plan",
        title="the next runs of the friction rig",
        out=out,
        facts={
            "candidates": count,
            "target": options.target,
            "runs": len(session),
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
        notes=present.notes,
        warnings=warnings,
        verdict=_verdict(plan, options),
        origin=origin,
    )


def _check(options: PlanOptions, out: Path, figure: Path) -> None:
    """Refuse options out of range, and files that would be replaced unasked."""
    problems: list[str | Problem] = []
    if options.runs < 1:
        problems.append(f"--runs = {options.runs}, must be >= 1")
    if options.target not in TARGETS:
        problems.append(f"--target = {options.target}, must be one of {', '.join(TARGETS)}")
    if not 0.0 <= options.goal_u < 1.0:
        problems.append(f"--goal-u = {options.goal_u:g}, must be in [0, 1)")
    if out.exists() and not _is_plan(out):
        text = (
            f"{out}: is a file that `beltid plan` did not write, never replaced; name another --out"
        )
        problems.append(Problem(text, "not-replaced"))
    elif not options.force:
        problems += [already_exists(path) for path in (out, figure) if path.exists()]
    if problems:
        raise InputError(problems)


def _present(artifacts: Mapping[str, Artifact], config: Config) -> Present:
    """What the artifacts say, and what is assumed in their place."""
    notes: list[str] = []
    surface: MeasuredSurface | None = None
    arcs: tuple[float, ...] = ()
    stored: tuple[Source, ...] = ()
    scale = 1.0
    if "stiffness" in artifacts:
        stiffness = artifacts["stiffness"]
        press = press_law(law_of(stiffness), config, stiffness)
    else:
        press = press_law(USUAL_LAW, config)
        notes.append("no data: contact law of the paper's 5PK belt")
    if "surface" not in artifacts:
        notes.append("no data: mu from 0.7 to 1.5 with usual slopes over force and speed")
    else:
        artifact = artifacts["surface"]
        metadata: SurfaceMetadata = artifact.metadata
        known = surface_of(artifact)
        if metadata.uncertainty is None or known.factor is None:
            raise InputError(f"{artifact.path}: has no covariance; build it again")
        arcs = tuple(metadata.uncertainty["arcs_deg"])
        stored = tuple(Source(**source) for source in metadata.uncertainty["sources"])
        k = len(stored)
        surface = MeasuredSurface(known, known.factor[..., :k], known.factor[..., k:])
        scale = metadata.noise_scale or 1.0
    sources = _joined(stored, config, arcs, press.has_scatter)
    if len(sources) > len(stored) and surface is not None:
        new = np.zeros((*surface.changes.shape[:2], len(sources) - len(stored)))
        surface = MeasuredSurface(
            surface.surface, np.concatenate([surface.changes, new], axis=-1), surface.scatter
        )
    now = all_sources(standard_uncertainties(config), len(arcs), press.has_scatter)
    sizes = {(source.error, source.place): source.size for source in now}
    other = [one.name for one in stored if sizes.get((one.error, one.place), one.size) != one.size]
    if other:
        notes.append(
            f"stated otherwise when the surface was made: {', '.join(dict.fromkeys(other))}; what "
            "was stated then is taken"
        )
    noise, columns = NoiseLaw(scale=scale), {}
    if "friction" in artifacts:
        table = artifacts["friction"].columns
        ok = valid_rows(table, np.flatnonzero(table["status"] == "ok"))
        rig = config.rig_params()
        runs = measured_runs(table, ok, rig.R, rig_kind(config), rig.given_force)
        noise = noise_law(runs, scale)
        columns = {key: float(np.mean(change)) for key, change in runs.columns.items()}
    else:
        notes.append(
            f"noise of a run: {100.0 * noise.friction:g} % of mu and {noise.tension:g} N of the "
            "tensions; --from friction.parquet takes that of its runs"
        )
    return Present(surface, arcs, sources, press, noise, columns, tuple(notes))


def _joined(
    stored: tuple[Source, ...], config: Config, arcs_deg: tuple[float, ...], law_scatter: bool
) -> tuple[Source, ...]:
    """The shared errors of a surface, then those that its candidates have beside them."""
    arcs = list(arcs_deg)
    wanted = rig_settings(config).arcs_deg
    arcs += [arc for arc in wanted if not np.isclose(arc, arcs, rtol=1e-3).any()]
    size = next((s.size for s in stored if s.error == ARC), USUAL_ARCS)
    every = (
        *all_sources(standard_uncertainties(config), len(arcs), law_scatter),
        *effect_sources(ARC, size, len(arcs)),
    )
    known = {(source.error, source.place) for source in stored}
    return (*stored, *(s for s in every if (s.error, s.place) not in known))


def rig_settings(config: Config) -> Settings:
    """What the rig can be set to: the section plan, else the rig."""
    plan, rig = config.plan, config.rig
    return Settings(
        plan.arcs_deg or rig.arcs_deg,
        plan.tension_N or rig.initial_tensions_N,
        plan.speed_rad_s or rig.pulley_speeds_rad_s,
    )


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


def _plan(
    candidates: Candidates,
    present: Present,
    config: Config,
    target: Target,
    options: PlanOptions,
) -> Plan:
    rows = candidates.rows(present.sources, present.noise, present.columns)
    before = knowledge_at(candidates.curves, present.surface, len(present.sources))
    return plan_runs(before, rows, target, present.sources, options.runs, options.goal_u)


SHOWN: Final = (
    "order",
    "arc_deg",
    "initial_tension_N",
    "pulley_speed_rad_s",
    "repeat",
    "repeats",
    "start_minutes",
    "gain_percent",
)


def _rows(
    session: Sequence[ScheduledRun], plan: Plan, candidates: Candidates, based_on: str | None
) -> list[dict[str, Any]]:
    """A row per run in the order of the session."""
    runs = candidates.measured
    gains = dict(zip(plan.chosen, plan.gains, strict=True))
    return [
        {
            "order": place,
            "arc_deg": round(float(np.degrees(runs.beta[one.run])), 9),
            "initial_tension_N": float(runs.T_0[one.run]),
            "pulley_speed_rad_s": float(runs.omega[one.run]),
            "repeat": one.repeat,
            "repeats": one.repeats,
            "start_minutes": one.start_minutes,
            "slip_speed_m_s": float(runs.slip_speed[one.run]),
            "normal_force_N_m": float(runs.normal_force[one.run]),
            "gain_percent": 100.0 * gains[one.run],
            "based_on": based_on or "unknown",
        }
        for place, one in enumerate(session, start=1)
    ]


COLUMNS: Final = (*SHOWN, "slip_speed_m_s", "normal_force_N_m", "based_on")


HEADER: Final = (",".join(COLUMNS) + "\n").encode()


def _is_plan(path: Path) -> bool:
    """Whether a file is a table of runs that this command wrote."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(HEADER)) == HEADER


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
        count = "1 run" if len(plan.chosen) == 1 else f"{len(plan.chosen)} runs"
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

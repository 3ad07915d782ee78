"""beltid plan: plan the next runs of the friction rig, or advise to stop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from beltid.artifacts.artifact import read_artifact
from beltid.artifacts.file_bytes import write_bytes
from beltid.artifacts.together import refuse_misfits
from beltid.config import Config, ConfigSource, load_config
from beltid.errors import ConvergenceError, InputError
from beltid.laws.penalty import NormalLaw
from beltid.plan.advice import Plan, choose_plan
from beltid.plan.candidates import Candidates, Settings, simulate_candidates
from beltid.plan.knowledge import knowledge_at
from beltid.plan.session import schedule
from beltid.plan.target import Target, surface_target
from beltid.report.summary import Summary, combined_origin
from beltid.stages.build_artifact import already_exists, of_other_bench
from beltid.stages.identification.reduction import rig_kind
from beltid.stages.outcome import Outcome
from beltid.stages.reporter import Options
from beltid.stages.simulation.campaign import bench_of
from beltid.stages.simulation.plan_inputs import (
    Present,
    known_of_artifact,
    known_of_result,
    present_knowledge,
    rig_settings,
)
from beltid.stages.simulation.plan_tables import (
    COLUMNS,
    SHOWN,
    csv_bytes,
    is_plan,
    region_rows,
    session_rows,
    statement_rows,
    verdict,
)
from beltid.stages.simulation.refinement import NEEDED
from beltid.stages.tables import friction_of, press_law, table_columns

if TYPE_CHECKING:
    import pandas as pd

TABLE: Final = ".csv"
REVERSED: Final = (
    "a negative speed turns the pulley the other way: runs in both directions tell the gain of the "
    "load cells from friction"
)
CANDIDATES: Final = "{} candidates, simulated with the present surface"


@dataclass(frozen=True, slots=True)
class Wanted:
    """Goal of a plan.

    Attributes
    ----------
    runs : int
        Maximum number of runs to plan.
    goal_u : float
        Sufficient relative standard uncertainty of mu [-].
    """

    runs: int
    goal_u: float

    def __post_init__(self) -> None:
        problems = []
        if self.runs < 1:
            problems.append(f"--runs = {self.runs}, must be >= 1")
        if not 0.0 <= self.goal_u < 1.0:
            problems.append(f"--goal-u = {self.goal_u:g}, must be in [0, 1)")
        if problems:
            raise InputError(problems)


@dataclass(frozen=True, slots=True)
class PlannedRuns:
    """The next runs of a rig, in the order of the session.

    Attributes
    ----------
    plan : Plan
        Gain of the runs, remaining uncertainty, and whether to stop.
    target : Target
        Where the surface has to be known.
    candidates : Candidates
        The settings that the runs were chosen from.
    rows : list of dict
        A row per run: settings, repetition, minutes, gain.
    notes : tuple of str
        Assumptions.
    """

    plan: Plan
    target: Target
    candidates: Candidates
    rows: list[dict[str, Any]]
    notes: tuple[str, ...]

    def to_frame(self) -> pd.DataFrame:
        """Return the runs as a table with the columns of plan.csv, a row per run."""
        import pandas as pd

        return pd.DataFrame(self.rows, columns=list(COLUMNS))


def run(
    config: ConfigSource,
    inputs: Mapping[str, Path],
    out: Path,
    options: Options,
    *,
    runs: int = 12,
    goal_u: float = 0.01,
) -> Summary:
    """Plan the next runs, write their table, summarise.

    The plan starts from ``surface`` and ``stiffness`` if they are among the inputs, and takes the
    noise from ``friction``; without inputs it starts from usual values for such a belt.

    Parameters
    ----------
    config, inputs, out, options
        As for every stage.
    runs : int
        Maximum number of runs to plan.
    goal_u : float
        Sufficient relative standard uncertainty of mu [-].
    """
    wanted, model = Wanted(runs, goal_u), config.config
    _check_out(out, force=options.force)
    artifacts = {role: read_artifact(path, role) for role, path in inputs.items()}
    hosts = dict(artifacts)
    guests = [hosts.pop("friction")] if "friction" in hosts else []
    refuse_misfits(hosts.values(), guests)
    origin = combined_origin([artifact.metadata.origin for artifact in artifacts.values()])
    other_bench = [line for a in artifacts.values() for line in of_other_bench(a, config)]
    press = known = surface_runs = None
    noise_runs = artifacts.get("friction")
    if "stiffness" in artifacts:
        stiffness = artifacts["stiffness"]
        press = press_law(stiffness, model)
    if "surface" in artifacts:
        known = known_of_artifact(artifacts["surface"])
        surface_runs = friction_of(artifacts["surface"], inputs["surface"].parent)
    setting_runs = noise_runs or surface_runs
    friction = None if noise_runs is None else noise_runs.columns
    settings, notes = rig_settings(model, None if setting_runs is None else setting_runs.columns)
    present = present_knowledge(known, press, friction, settings, model)
    based_on = (origin or "unknown") if artifacts else "usual values"
    options.reporter.report(CANDIDATES.format(len(settings.points())))
    planned = _planned(present, settings, model, wanted, based_on)
    write_bytes(out, csv_bytes(planned.rows))
    return Summary(
        stage="plan",
        title="the next runs of the friction rig",
        out=out,
        facts=_facts(planned, wanted, model),
        table=planned.rows,
        shown=SHOWN,
        extra_tables={
            "standard uncertainty by region, in percent of mu": region_rows(planned.plan),
            "if it were known twice as well": statement_rows(planned.plan),
        },
        notes=(*notes, *planned.notes),
        warnings=tuple(other_bench),
        verdict=verdict(planned.plan, goal_u),
        origin=origin,
    )


def _facts(planned: PlannedRuns, wanted: Wanted, config: Config) -> dict[str, Any]:
    """Return the key figures of a plan; the session ends with its last run."""
    plan, rows = planned.plan, planned.rows
    minutes = rows[-1]["start_minutes"] + config.plan.minutes_per_run if rows else 0.0
    return {
        "candidates": planned.candidates.measured.mu.size,
        "runs": len(rows),
        "arc_changes": max(len({row["arc_deg"] for row in rows}) - 1, 0),
        "session_minutes": minutes,
        "uncertainty_before_percent": 100.0 * plan.before,
        "uncertainty_after_percent": 100.0 * plan.after,
        "goal_percent": 100.0 * wanted.goal_u,
        "shared_by_all_runs_percent": 100.0 * plan.shared,
        "stop": plan.stop,
    }


def plan_runs(
    surface: Outcome[Any] | None = None,
    law: NormalLaw | Outcome[Any] | None = None,
    config: Config | Mapping[str, Any] | str | Path | None = None,
    *,
    friction: Any = None,
    runs: int = 12,
    goal_u: float = 0.01,
) -> PlannedRuns:
    """Plan the next runs of the friction rig.

    Parameters
    ----------
    surface : Outcome of refine_surface or build_surface, optional
        The known surface; without it the plan starts from usual values for such a belt.
    law : NormalLaw or Outcome of fit_stiffness, optional
        Normal contact law; by default that of the paper's 5PK belt.
    config : Config, dict, path or None
        Belt, rig, and under ``plan:`` the possible settings of the rig.
    friction : Outcome of fit_friction, DataFrame, pyarrow Table or mapping, optional
        Reduced runs, whose noise the planned runs are assumed to have.
    runs : int
        Maximum number of runs to plan; fewer if they reach the goal, none if they do not help.
    goal_u : float
        Sufficient relative standard uncertainty of mu [-].

    Returns
    -------
    PlannedRuns
        ``.to_frame()`` has a row per run in the order of the session; ``.plan`` has their gain and
        whether to stop.

    Raises
    ------
    InputError
        If an argument is out of range, or the surface has no covariance.
    """
    wanted, model = Wanted(runs, goal_u), load_config(config)
    known = press = columns = None
    if surface is not None:
        known = known_of_result(surface)
    if law is not None:
        press = press_law(law, model)
    if friction is not None:
        columns = table_columns(friction, "friction", NEEDED)
    based_on = "unknown" if surface is not None else "usual values"
    settings, notes = rig_settings(model, columns)
    present = present_knowledge(known, press, columns, settings, model)
    planned = _planned(present, settings, model, wanted, based_on)
    return replace(planned, notes=(*notes, *planned.notes))


def _planned(
    present: Present, settings: Settings, config: Config, wanted: Wanted, based_on: str
) -> PlannedRuns:
    """Make the plan from the present knowledge and its assumptions."""
    points = settings.points()
    try:
        candidates = simulate_candidates(
            bench_of(config, 1.0, present.press.law),
            present.press,
            settings,
            present.arcs_deg,
            None if present.surface is None else present.surface.surface,
            rig_kind(config),
        )
    except ConvergenceError as error:
        where = "a setting of plan: (without it of rig:) cannot be simulated, must be left out"
        raise ConvergenceError(error.at(where)) from error
    ranges = [
        (float(x.min()), float(x.max()))
        for x in (candidates.measured.normal_force, candidates.measured.slip_speed)
    ]
    target = surface_target(candidates.curves, ranges[0], ranges[1])
    lines = candidates.rows(present.sources, present.noise, present.columns)
    before = knowledge_at(candidates.curves, present.surface, len(present.sources))
    plan = choose_plan(
        before,
        lines,
        target,
        present.sources,
        wanted.runs,
        wanted.goal_u,
        candidates.can_reverse,
    )
    ways = [(p.beta, p.T_0, way * p.omega) for way in (1.0, -1.0) for p in points]
    session = schedule(
        plan.chosen,
        ways,
        config.plan.minutes_per_run,
        config.plan.minutes_per_arc_change,
    )
    rows = session_rows(session, plan, ways, candidates.measured, based_on)
    notes = present.notes
    if any(row["pulley_speed_rad_s"] < 0.0 for row in rows):
        notes = (*notes, REVERSED)
    return PlannedRuns(plan, target, candidates, rows, notes)


def _check_out(out: Path, *, force: bool) -> None:
    """Refuse an output name that is not a table, and an existing file without --force."""
    if out.suffix.lower() != TABLE:
        raise InputError(f"{out}: the table of a plan ends in {TABLE}; name such a file with --out")
    if out.exists() and not is_plan(out):
        text = (
            f"{out}: is a file that `beltid plan` did not write, never replaced; name another --out"
        )
        raise InputError(text)
    if out.exists() and not force:
        raise InputError(already_exists(out))

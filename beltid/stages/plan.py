"""The next runs of the friction rig, or the advice to stop."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from beltid.config import Config
from beltid.errors import ConvergenceError, InputError
from beltid.notes import log
from beltid.plan.advice import Plan, choose_plan
from beltid.plan.candidates import Candidates, Settings, simulate_candidates
from beltid.plan.knowledge import knowledge_at
from beltid.plan.session import schedule
from beltid.plan.target import Target, surface_target
from beltid.stage import Outcome
from beltid.stages.campaign import bench_of
from beltid.stages.inputs import friction_columns, friction_of, press_law
from beltid.stages.plan_inputs import Present, known_surface, present_knowledge, rig_settings
from beltid.stages.plan_tables import (
    COLUMNS,
    csv_bytes,
    is_plan,
    region_rows,
    session_rows,
    statement_rows,
    verdict,
)
from beltid.stages.reduction import rig_kind
from beltid.stages.refinement import NEEDED
from beltid.store.artifact import Artifact, combined_origin
from beltid.store.place import anyone_s

if TYPE_CHECKING:
    import pandas as pd

REVERSED: Final = (
    "a negative speed turns the pulley the other way: runs in both directions tell the gain of the "
    "load cells from friction"
)
CANDIDATES: Final = "%d candidates, simulated with the present surface"


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


def planned(
    surface: Any, law: Any, config: Config, friction: Any, runs: int, goal_u: float
) -> Outcome[PlannedRuns]:
    """Plan from what is known: the surface, the law, the noise of reduced runs.

    The settings of the rig are those of these runs, else of those that the surface was made from.
    """
    wanted = Wanted(runs, goal_u)
    noise = None if friction is None else friction_columns(friction, NEEDED)
    set_by = noise
    if set_by is None and isinstance(surface, Artifact):
        beside = friction_of(surface, surface.path.parent)
        set_by = None if beside is None else beside.columns
    settings, notes = rig_settings(config, set_by)
    known = None if surface is None else known_surface(surface)
    press = None if law is None else press_law(law, config)
    present = present_knowledge(known, press, noise, settings, config)
    log.info(CANDIDATES, len(settings.points()))
    origins = [item.origin for item in (surface, law, friction) if hasattr(item, "origin")]
    based_on = (combined_origin(origins) or "unknown") if origins else "usual values"
    found = _planned(present, settings, config, wanted, based_on)
    found = replace(found, notes=(*notes, *found.notes))
    return Outcome(
        {name: np.array([row[name] for row in found.rows]) for name in COLUMNS},
        found,
        facts=_facts(found, wanted, config),
        tables={"regions": region_rows(found.plan), "statements": statement_rows(found.plan)},
        notes=found.notes,
        verdict=verdict(found.plan, goal_u),
    )


def written(outcome: Outcome[PlannedRuns]) -> bytes:
    """Return the table for the operator of the bench as CSV."""
    return csv_bytes(outcome.result.rows)


def whose(path: Path) -> str:
    """Say what an existing file is; a table that is no plan may be a recording and must stay."""
    if is_plan(path):
        return anyone_s(path)
    raise InputError(f"{path}: is a file that `beltid plan` did not write, never replaced; name "
                     "another --out")  # fmt: skip


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


def _planned(
    present: Present, settings: Settings, config: Config, wanted: Wanted, based_on: str
) -> PlannedRuns:
    """Make the plan from the present knowledge and its assumptions."""
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
    sources, reverse = present.sources, candidates.can_reverse
    plan = choose_plan(before, lines, target, sources, wanted.runs, wanted.goal_u, reverse)
    ways = [(p.beta, p.T_0, way * p.omega) for way in (1.0, -1.0) for p in settings.points()]
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

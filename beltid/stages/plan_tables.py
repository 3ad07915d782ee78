"""Output tables of a plan: the runs for the operator of the bench, regions, statements."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.errors import counted
from beltid.plan.advice import Plan
from beltid.plan.session import ScheduledRun
from beltid.uncertainty.measured import Measured
from beltid.uncertainty.sources import EFFECT_SOURCES, FITTED, Source

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
COLUMNS: Final = (*SHOWN[:-1], "slip_speed_m_s", "normal_force_N_m", "based_on", "needed_for")
HEADER: Final = (",".join(COLUMNS) + "\n").encode()
KNOWN_BY: Final = (",".join(COLUMNS[:-1])).encode()
MOST_STATEMENTS: Final = 6


def session_rows(
    session: Sequence[ScheduledRun],
    plan: Plan,
    settings: Sequence[tuple[float, float, float]],
    runs: Measured,
    based_on: str,
) -> list[dict[str, Any]]:
    """Return a row per run in the order of the session; `settings` has arc, tension and speed.

    A run that the plan requires, for its arc or as a repetition, may have no gain of its own.
    """
    gains = dict(zip(plan.chosen, plan.gains, strict=True))
    return [
        {
            "order": order,
            "arc_deg": round(float(np.degrees(settings[scheduled.run][0])), 9),
            "initial_tension_N": settings[scheduled.run][1],
            "pulley_speed_rad_s": settings[scheduled.run][2],
            "repeat": scheduled.repeat,
            "repeats": scheduled.repeats,
            "start_minutes": scheduled.start_minutes,
            "slip_speed_m_s": float(runs.slip_speed[scheduled.run % runs.mu.size]),
            "normal_force_N_m": float(runs.normal_force[scheduled.run % runs.mu.size]),
            "gain_percent": 100.0 * max(gains[scheduled.run], 0.0),
            "based_on": based_on,
            "needed_for": plan.needed.get(scheduled.run, ""),
        }
        for order, scheduled in enumerate(session, start=1)
    ]


def is_plan(path: Path) -> bool:
    """Return whether a file is a table of runs written by this command."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(KNOWN_BY)) == KNOWN_BY


def csv_bytes(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """Return the table for the operator of the bench as CSV."""
    text = io.StringIO()
    for row in rows:
        cells = [f"{v:.6g}" if isinstance(v := row[name], float) else str(v) for name in COLUMNS]
        text.write(",".join(cells) + "\n")
    return HEADER + text.getvalue().encode()


def region_rows(plan: Plan) -> list[dict[str, Any]]:
    """Return a row per region of the target: uncertainty of the surface before and after."""
    return [
        {
            "force_range_N_m": region.force,
            "speed_range_m_s": region.speed,
            "before_percent": 100.0 * region.before,
            "after_percent": 100.0 * region.after,
        }
        for region in plan.regions
    ]


def statement_rows(plan: Plan) -> list[dict[str, Any]]:
    """Return the most influential shared errors, and the uncertainty with each of them halved."""
    return [
        {
            "source": statement.source.name,
            "known": statement.source.basis,
            "uncertainty": _size(statement.source),
            "contribution_percent": 100.0 * statement.contribution,
            "surface_then_percent": 100.0 * statement.halved,
        }
        for statement in plan.statements[:MOST_STATEMENTS]
    ]


def _size(source: Source) -> str:
    """Format the standard uncertainty of a source; one known only from the data has no figure.

    The scatter of the press and the shared errors of the reduction are known by their contribution
    only: they are directions of a covariance, not errors of a quantity with a unit.
    """
    if source.basis == FITTED and source.error not in EFFECT_SOURCES:
        return "by the data"
    return f"{source.shown:.3g} {source.unit}"


def verdict(plan: Plan, goal_u: float) -> str:
    """State whether to continue or to stop, and why."""
    before, after = 100.0 * plan.before, 100.0 * plan.after
    goal = 100.0 * goal_u
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
        f"{text}; halving the uncertainty of {best.source.name} would help most and give "
        f"{100.0 * best.halved:.2g} %"
    )

"""Outcome of the belts of a batch, and the summary table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from beltid.errors import EXIT_BATCH_FAILED, EXIT_DONE, BeltidError, percent
from beltid.report.results import LEFT_OUT
from beltid.report.summary import Summary
from beltid.store.artifact import combined_origin

DONE: Final = "done"
UP_TO_DATE: Final = "up to date"
FAILED: Final = "failed"
NOT_RUN: Final = "not run"
OUT_OF_TOLERANCE: Final = "out of tolerance"
OVERRIDDEN_BY: Final = {"compare": "compare refined"}
"""Comparison that may be out of tolerance -> comparison whose success overrides it."""
SKIPPED: Final = "no recording"
TOO_FEW_SETTINGS: Final = "too few settings"
"""State of the hold-out comparison if the bench has a single arc: no other arc to predict from."""
HELD_OUT: Final = "cross-validate"


@dataclass(slots=True)
class BeltRun:
    """Outcome of the chain of one belt.

    Attributes
    ----------
    belt : str
        Name of the belt.
    states : dict
        Name of a stage -> its state, in the order of the chain.
    lacking : tuple of str
        Kinds of recordings that the chain can use but the config does not name.
    summaries : dict
        Name of a stage -> its summary, if it has run.
    troubles : dict
        Name of a stage -> its exit status and problems, if any.
    """

    belt: str
    states: dict[str, str]
    lacking: tuple[str, ...] = ()
    summaries: dict[str, Summary] = field(default_factory=dict)
    troubles: dict[str, tuple[int, tuple[str, ...]]] = field(default_factory=dict)

    @property
    def exit_status(self) -> int:
        """Exit status of the first stage of the chain that failed.

        The refined surface is the result: if it is within tolerance, the published one, whose bias
        is known, need not be.
        """
        failures = (n for n in self.states if n in self.troubles and not self._is_overridden(n))
        return next((self.troubles[name][0] for name in failures), EXIT_DONE)

    def _is_overridden(self, name: str) -> bool:
        return self.states[name] == OUT_OF_TOLERANCE and self.states.get(
            OVERRIDDEN_BY.get(name, "")
        ) in (DONE, UP_TO_DATE)

    def failed(self, name: str, error: BeltidError) -> None:
        """Record that a stage failed."""
        self.states[name] = FAILED
        self.troubles[name] = (error.exit_status, error.problems)

    @property
    def failures(self) -> tuple[str, ...]:
        """The stages that failed, each with its exit status and its first problem."""
        return tuple(
            f"{name} failed (exit status {self.troubles[name][0]}): {self.troubles[name][1][0]}"
            for name, state in self.states.items()
            if state == FAILED
        )

    @property
    def problems(self) -> list[str]:
        """Problems of all stages, in the order of the chain."""
        return [
            f"{name}: {line}"
            for name in self.states
            if name in self.troubles
            for line in self.troubles[name][1]
        ]

    @property
    def origin(self) -> str | None:
        """Origin of the data: "synthetic" if any are, "measured" if all are."""
        return combined_origin([summary.origin for summary in self.summaries.values()])

    @property
    def up_to_date(self) -> bool:
        """True if nothing had to be done."""
        idle = (UP_TO_DATE, SKIPPED, TOO_FEW_SETTINGS)
        return all(state in idle for state in self._final_states())

    def _final_states(self) -> list[str]:
        return [
            UP_TO_DATE if name in self.summaries and self.summaries[name].up_to_date else state
            for name, state in self.states.items()
        ]


def batch_summary(belts: Sequence[BeltRun], folder: Path) -> Summary:
    """Summarize a batch: one line per belt, and the verdict."""
    failed = [belt for belt in belts if belt.exit_status != EXIT_DONE]
    status = EXIT_DONE
    if failed:
        status = failed[0].exit_status if len(belts) == 1 else EXIT_BATCH_FAILED
    origins = {belt.origin for belt in belts}
    mixed = len(origins) > 1
    predicted = [line for belt in belts if (line := prediction(belt))]
    nothing_done = all(belt.up_to_date for belt in belts)
    if failed:
        names = ", ".join(belt.belt for belt in failed)
        verdict = f"{len(failed)} of {len(belts)} belts failed: {names}"
    else:
        verdict = "everything is up to date, nothing was done" if nothing_done else "all belts done"
    return Summary(
        stage="run",
        title="from the recordings to the comparison",
        out=folder,
        facts={"belts": len(belts), "belts_failed": len(failed)},
        table=[_row(belt) for belt in belts],
        shown=_shown_columns(belts, mixed),
        verdict="\n".join([*predicted, verdict]),
        exit_status=status,
        up_to_date=nothing_done,
        origin=None if mixed else next(iter(origins), None),
    )


def prediction(belt: BeltRun) -> str:
    """State in a sentence how well left-out runs were predicted; "" if none were."""
    summary = belt.summaries.get(HELD_OUT)
    if summary is None:
        return ""
    facts = summary.facts
    rms, over_u = facts["groups"][0]["rms_percent"], facts["rms_over_u_validation"]
    units = "" if over_u is None else f", {over_u:.2g} standard uncertainties"
    return (
        f"{belt.belt}: runs of {LEFT_OUT[facts['hold_out']]} that was left out are predicted to "
        f"{percent(rms)} RMS{units}"
    )


def _shown_columns(belts: Sequence[BeltRun], mixed: bool) -> tuple[str, ...]:
    """Select the columns to display: belt, results, status.

    Columns that are empty for all belts appear only in the JSON output.
    """
    rows = [_short_row(belt) for belt in belts]
    first, *rest = dict.fromkeys(name for row in rows for name in row) if rows else ("belt",)
    rest = [name for name in rest if any(row[name] is not None for row in rows)]
    return (first, *rest, *(["origin"] if mixed else []))


def _row(belt: BeltRun) -> dict[str, Any]:
    return {
        **_short_row(belt),
        "origin": belt.origin,
        "exit_status": belt.exit_status,
        "stages": dict(belt.states),
        "problems": list(belt.problems),
        **{
            stage.replace("-", "_").replace(" ", "_"): summary.as_json()["facts"]
            for stage in belt.states
            if (summary := belt.summaries.get(stage))
        },
    }


def _short_row(belt: BeltRun) -> dict[str, Any]:
    """Summarize a belt in one line: law, friction, agreement, status."""
    stiffness = belt.summaries.get("fit-stiffness")
    friction = belt.summaries.get("fit-friction")
    compared, refined, predicted = (
        summary.facts["groups"][0] if (summary := belt.summaries.get(name)) else {}
        for name in ("compare", "compare refined", HELD_OUT)
    )
    return {
        "belt": belt.belt,
        "k_linear_N_m2": stiffness.facts["k_linear_N_m2"] if stiffness else None,
        "k_quadratic_N_m3": stiffness.facts["k_quadratic_N_m3"] if stiffness else None,
        "runs": friction.facts["runs"] if friction else None,
        "rms_percent": compared.get("rms_percent"),
        "largest_percent": compared.get("largest_percent"),
        "refined_rms_percent": refined.get("rms_percent"),
        "refined_largest_percent": refined.get("largest_percent"),
        "predicted_rms_percent": predicted.get("rms_percent"),
        "status": UP_TO_DATE if belt.up_to_date else _outcome(belt),
    }


def _outcome(belt: BeltRun) -> str:
    """Describe the outcome: done, or what went wrong."""
    outcome = [
        f"{name} {state}"
        for name, state in belt.states.items()
        if state in (FAILED, OUT_OF_TOLERANCE)
    ]
    if belt.exit_status == EXIT_DONE:
        missing = " or ".join(belt.lacking)
        outcome.insert(0, f"{DONE}, without {missing}" if missing else DONE)
    return ", ".join(outcome)

"""What became of the belts of a batch, and the table of all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from beltid.errors import EXIT_BATCH_FAILED, EXIT_DONE, BeltidError, percent
from beltid.report.summary import Summary
from beltid.store.artifact import combined_origin

DONE: Final = "done"
UP_TO_DATE: Final = "up to date"
TO_BE_MADE: Final = "to be made"
FAILED: Final = "failed"
WRONG: Final = "cannot be made"
NOT_RUN: Final = "not run"
OUT_OF_TOLERANCE: Final = "out of tolerance"
SKIPPED: Final = "no recording"
TOO_FEW_SETTINGS: Final = "too few settings"
"""State of the cross-validation if the bench has a single arc: no other arc to predict from."""
HELD_OUT: Final = "cross-validate"
REPORT: Final = "report"
OVERRIDDEN_BY: Final = {"compare": "compare refined"}
"""Comparison that may be out of tolerance -> comparison whose success overrides it: the bias of the
published surface is known, the refined surface is the result."""
COLUMNS: Final = (
    ("k_linear_N_m2", "fit-stiffness", "k_linear_N_m2"),
    ("k_quadratic_N_m3", "fit-stiffness", "k_quadratic_N_m3"),
    ("runs", "fit-friction", "runs"),
    ("rms_percent", "compare", "rms_percent"),
    ("largest_percent", "compare", "largest_percent"),
    ("refined_rms_percent", "compare refined", "rms_percent"),
    ("refined_largest_percent", "compare refined", "largest_percent"),
    ("predicted_rms_percent", HELD_OUT, "rms_percent"),
)
"""Columns of the table: name, step, fact; those of a comparison are over all its runs."""


@dataclass(slots=True)
class Belt:
    """What became of the chain of a belt.

    Attributes
    ----------
    name : str
        Name of the belt.
    states : dict
        Name of a step -> its state, in the order of the chain.
    lacking : tuple of str
        Kinds of recordings that the chain can use but the config does not name.
    facts : dict
        Name of a step that was run or is up to date -> its facts.
    troubles : dict
        Name of a step -> its exit status and problems, if any.
    origins : list
        Origins of the results.
    made : list of str
        Names of the files that exist, recordings among them.
    new : bool
        Whether anything was computed.
    """

    name: str
    states: dict[str, str] = field(default_factory=dict)
    lacking: tuple[str, ...] = ()
    facts: dict[str, dict[str, Any]] = field(default_factory=dict)
    troubles: dict[str, tuple[int, tuple[str, ...]]] = field(default_factory=dict)
    origins: list[str | None] = field(default_factory=list)
    made: list[str] = field(default_factory=list)
    new: bool = False

    def failed(self, name: str, error: BeltidError) -> None:
        """Record that a step failed."""
        self.states[name] = FAILED
        self.troubles[name] = (error.exit_status, error.problems)

    def few_settings(self, name: str) -> None:
        """Record that a step cannot be run with so few settings of the bench."""
        self.states[name] = TOO_FEW_SETTINGS

    @property
    def exit_status(self) -> int:
        """Exit status of the first step that failed, unless another one overrides it."""
        for name, state in self.states.items():
            by = self.states.get(OVERRIDDEN_BY.get(name, ""))
            if state == OUT_OF_TOLERANCE and by in (DONE, UP_TO_DATE):
                continue
            if name in self.troubles:
                return self.troubles[name][0]
        return EXIT_DONE

    @property
    def failures(self) -> tuple[str, ...]:
        """The steps that failed, each with its exit status and its first problem."""
        return tuple(
            f"{name} failed (exit status {self.troubles[name][0]}): {self.troubles[name][1][0]}"
            for name, state in self.states.items()
            if state == FAILED
        )

    @property
    def origin(self) -> str | None:
        """Origin of the data: "synthetic" if any are, "measured" if all are."""
        return combined_origin(self.origins)

    @property
    def status(self) -> str:
        """What became of it in a few words."""
        if not self.new and FAILED not in self.states.values():
            return UP_TO_DATE
        wrong = (FAILED, OUT_OF_TOLERANCE)
        words = [f"{name} {state}" for name, state in self.states.items() if state in wrong]
        if self.exit_status == EXIT_DONE:
            missing = " or ".join(self.lacking)
            words.insert(0, f"{DONE}, without {missing}" if missing else DONE)
        return ", ".join(words)

    def short_row(self) -> dict[str, Any]:
        """Return the law, friction, agreement and status in one row."""
        row: dict[str, Any] = {"belt": self.name}
        for column, step, fact in COLUMNS:
            facts = self.facts.get(step, {})
            row[column] = (facts["groups"][0] if "groups" in facts else facts).get(fact)
        return {**row, "status": self.status}

    def row(self) -> dict[str, Any]:
        """Return everything that is known of the belt."""
        return {
            **self.short_row(),
            "origin": self.origin,
            "exit_status": self.exit_status,
            "stages": dict(self.states),
            "problems": [
                f"{name}: {line}"
                for name in self.states
                for line in self.troubles.get(name, (0, ()))[1]
            ],
            **{
                name.replace("-", "_").replace(" ", "_"): facts
                for name, facts in self.facts.items()
            },
        }

    def prediction(self) -> list[str]:
        """State in a sentence how well left-out runs were predicted, if they were."""
        facts = self.facts.get(HELD_OUT)
        if facts is None:
            return []
        rms, over_u = facts["groups"][0]["rms_percent"], facts["rms_over_u_validation"]
        units = "" if over_u is None else f", {over_u:.2g} standard uncertainties"
        left_out = (
            f"runs of {'an arc' if facts['hold_out'] == 'arc' else 'a speed'} that was left out"
        )
        return [f"{self.name}: {left_out} are predicted to {percent(rms)} RMS{units}"]


def batch_summary(belts: Sequence[Belt], folder: Path) -> Summary:
    """Summarize a batch: one line per belt, and the verdict."""
    failed = [belt for belt in belts if belt.exit_status != EXIT_DONE]
    status = EXIT_BATCH_FAILED if failed else EXIT_DONE
    if failed and len(belts) == 1:
        status = failed[0].exit_status
    origins = {belt.origin for belt in belts}
    up_to_date = all(belt.status == UP_TO_DATE for belt in belts)
    verdict = "everything is up to date, nothing was done" if up_to_date else "all belts done"
    if failed:
        names = ", ".join(belt.name for belt in failed)
        verdict = f"{len(failed)} of {len(belts)} belts failed: {names}"
    rows = [belt.short_row() for belt in belts]
    # a column that is empty for all belts appears only for programs
    shown = [name for name in rows[0] if any(row[name] is not None for row in rows)]
    return Summary(
        stage="run",
        title="from the recordings to the comparison",
        out=folder,
        facts={"belts": len(belts), "belts_failed": len(failed)},
        table=[belt.row() for belt in belts],
        shown=(*shown, *(["origin"] if len(origins) > 1 else [])),
        verdict="\n".join([*(line for belt in belts for line in belt.prediction()), verdict]),
        exit_status=status,
        up_to_date=up_to_date,
        origin=origins.pop() if len(origins) == 1 else None,
    )

"""What became of the belts of a batch, and the table that tells it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from beltid.errors import EXIT_BATCH_FAILED, EXIT_DONE
from beltid.report.summary import Summary

DONE: Final = "done"
UP_TO_DATE: Final = "up to date"
FAILED: Final = "failed"
NOT_RUN: Final = "not run"
OUT_OF_TOLERANCE: Final = "out of tolerance"
SKIPPED: Final = "no recording"


@dataclass(slots=True)
class BeltRun:
    """What became of the chain of one belt.

    Attributes
    ----------
    belt : str
        Name of the belt, and of its case in a sweep.
    states : dict
        Name of a stage -> what became of it, in the order of the chain.
    summaries : dict
        Name of a stage -> its summary, if it got that far.
    troubles : dict
        Name of a stage -> its exit status and what went wrong, if something did.
    """

    belt: str
    states: dict[str, str]
    summaries: dict[str, Summary] = field(default_factory=dict)
    troubles: dict[str, tuple[int, tuple[str, ...]]] = field(default_factory=dict)

    @property
    def exit_status(self) -> int:
        """Exit status of the first stage of the chain that failed."""
        return next((self.troubles[name][0] for name in self.states if name in self.troubles), 0)

    @property
    def problems(self) -> list[str]:
        """What went wrong, in the order of the chain."""
        return [
            f"{name}: {line}"
            for name in self.states
            if name in self.troubles
            for line in self.troubles[name][1]
        ]

    @property
    def origin(self) -> str | None:
        """Where the data come from: "synthetic" if any of them are, "measured" if all are."""
        origins = {summary.origin for summary in self.summaries.values()}
        if "synthetic" in origins:
            return "synthetic"
        return "measured" if origins == {"measured"} else None

    @property
    def up_to_date(self) -> bool:
        """Whether nothing had to be done."""
        return all(state in (UP_TO_DATE, SKIPPED) for state in self._settled())

    def _settled(self) -> list[str]:
        return [
            UP_TO_DATE if name in self.summaries and self.summaries[name].up_to_date else state
            for name, state in self.states.items()
        ]


def batch_summary(belts: Sequence[BeltRun], folder: Path) -> Summary:
    """Sum up a batch: a line per belt, and how it ended."""
    failed = [belt for belt in belts if belt.exit_status != EXIT_DONE]
    status = EXIT_DONE
    if failed:
        status = failed[0].exit_status if len(belts) == 1 else EXIT_BATCH_FAILED
    origins = {belt.origin for belt in belts}
    mixed = len(origins) > 1
    nothing_done = all(belt.up_to_date for belt in belts)
    if failed:
        verdict = f"{len(failed)} of {len(belts)} belts failed: " + ", ".join(
            belt.belt for belt in failed
        )
    else:
        verdict = "everything is up to date, nothing was done" if nothing_done else "all belts done"
    return Summary(
        stage="run",
        title="from the recordings to the comparison",
        out=folder,
        facts={"belts": len(belts), "belts_failed": len(failed)},
        table=[_row(belt) for belt in belts],
        shown=(*_short_row(belts[0]), *(["origin"] if mixed else [])) if belts else (),
        verdict=verdict,
        exit_status=status,
        up_to_date=nothing_done,
        origin=None if mixed else next(iter(origins), None),
    )


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
    """The belt in a line: the law, the friction, the agreement, what became of it."""
    stiffness = belt.summaries.get("fit-stiffness")
    friction = belt.summaries.get("fit-friction")
    compared, refined = (
        summary.facts["groups"][0] if (summary := belt.summaries.get(name)) else {}
        for name in ("compare", "compare refined")
    )
    unsettled = [
        f"{name} {state}"
        for name, state in belt.states.items()
        if state in (FAILED, OUT_OF_TOLERANCE)
    ]
    return {
        "belt": belt.belt,
        "k_linear_N_m2": stiffness.facts["k_linear_N_m2"] if stiffness else None,
        "k_quadratic_N_m3": stiffness.facts["k_quadratic_N_m3"] if stiffness else None,
        "runs": friction.facts["runs"] if friction else None,
        "rms_percent": compared.get("rms_percent"),
        "largest_percent": compared.get("largest_percent"),
        "refined_rms_percent": refined.get("rms_percent"),
        "refined_largest_percent": refined.get("largest_percent"),
        "status": ", ".join(unsettled) or (UP_TO_DATE if belt.up_to_date else DONE),
    }

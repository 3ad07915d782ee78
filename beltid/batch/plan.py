"""Dry run of a batch: list what it would do."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from beltid.batch.belts import NOT_RUN, SKIPPED, UP_TO_DATE
from beltid.batch.chain import chain_of
from beltid.batch.folders import refuse_links_out
from beltid.batch.steps import Call, Step, within_reach
from beltid.config import ConfigSource
from beltid.errors import EXIT_DONE, BeltidError
from beltid.report.summary import Summary

TO_BE_MADE: Final = "to be made"
WRONG: Final = "cannot be made"


def plan_batch(sources: Sequence[ConfigSource], folder: Path, *, force: bool = False) -> Summary:
    """List the steps that a batch would carry out, without writing anything.

    Parameters
    ----------
    sources : sequence of ConfigSource
        One config per belt.
    folder : Path
        Results folder.
    force : bool
        Whether the batch would compute everything again.
    """
    refuse_links_out(folder, [source.name for source in sources])
    rows: list[dict[str, Any]] = []
    warnings: list[str] = []
    status = EXIT_DONE
    for source in sources:
        for row, error in _plan_steps(source, folder / source.name, force=force):
            rows.append(row)
            if error is not None:
                status = status or error.exit_status
                warnings += [f"{source.name}: {row['step']}: {line}" for line in error.problems]
    count = sum(row["state"] == TO_BE_MADE for row in rows)
    return Summary(
        stage="run --dry-run",
        title="what would be done; nothing was done",
        facts={"belts": len(sources), "steps": len(rows), "steps_to_be_made": count},
        table=rows,
        shown=("belt", "step", "state"),
        warnings=tuple(warnings),
        exit_status=status,
    )


def _plan_steps(
    source: ConfigSource, folder: Path, *, force: bool
) -> Iterator[tuple[dict[str, Any], BeltidError | None]]:
    """Yield the row of each step of a belt, and its error if any."""
    files = source.config.data.files
    stale: set[str] = set()
    steps = chain_of(source)
    possible = within_reach(steps, files)
    for step in steps:
        out = step.place(folder)
        state, error = NOT_RUN, None
        if not step.ready(files):
            state = NOT_RUN if step.name in possible else SKIPPED
        elif force or stale & set(step.needs.values()):
            state = TO_BE_MADE
        else:
            state, error = _state(step, step.call(source, files, folder))
        if state in (UP_TO_DATE, TO_BE_MADE):
            files[step.makes] = out
        if state == TO_BE_MADE:
            stale.add(step.makes)
        yield {"belt": source.name, "step": step.name, "artifact": str(out), "state": state}, error


def _state(step: Step, call: Call) -> tuple[str, BeltidError | None]:
    """Let a step check whether its artifact is up to date."""
    try:
        _, existing = step.stage.look(*call)
    except BeltidError as error:
        return WRONG, error
    return (TO_BE_MADE if existing is None else UP_TO_DATE), None

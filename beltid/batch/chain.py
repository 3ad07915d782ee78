"""The chain of one belt after the other: what is made from what, in which order."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from beltid.batch.belts import (
    DONE,
    FAILED,
    NOT_RUN,
    OUT_OF_TOLERANCE,
    SKIPPED,
    UP_TO_DATE,
    BeltRun,
    batch_summary,
)
from beltid.config import ConfigSource
from beltid.errors import EXIT_DONE, EXIT_OUT_OF_TOLERANCE, BeltidError
from beltid.report.summary import Summary
from beltid.stages import (
    build_surface,
    compare,
    fit_friction,
    fit_slip,
    fit_stiffness,
    refine_surface,
    simulate_rig,
)
from beltid.stages.simulate_rig import SimulateOptions
from beltid.stages.talk import Named, Options, Talk

StageRun = Callable[[ConfigSource, Mapping[str, Path], Path, Options], Summary]


def _same(*roles: str) -> dict[str, str]:
    """Inputs that are named like their roles."""
    return {role: role for role in roles}


@dataclass(frozen=True, slots=True)
class Step:
    """One stage of the chain.

    Attributes
    ----------
    name : str
        Name of its command, and what it works on if the chain has it twice.
    makes : str
        Name of its artifact.
    needs : dict
        Recordings and artifacts it is made from, by their role in the stage.
    run : callable
        The stage.
    optional : bool
        Whether a belt may do without it if its recording is not there.
    """

    name: str
    makes: str
    needs: Mapping[str, str]
    run: StageRun
    optional: bool = False


CHAIN: Final = (
    Step("fit-stiffness", "stiffness", _same("press"), fit_stiffness.run),
    Step("fit-slip", "slip", _same("speedloss"), fit_slip.run, optional=True),
    Step("fit-friction", "friction", _same("rig"), fit_friction.run),
    Step("build-surface", "surface", _same("friction"), build_surface.run),
    Step("refine-surface", "surface_refined", _same("friction", "stiffness"), refine_surface.run),
    Step("simulate-rig", "simulated", _same("surface", "stiffness"), simulate_rig.run),
    Step("compare", "compare", _same("friction", "simulated"), compare.run),
    Step(
        "simulate-rig refined",
        "simulated_refined",
        {"surface": "surface_refined", "stiffness": "stiffness"},
        simulate_rig.run,
    ),
    Step(
        "compare refined",
        "compare_refined",
        {"friction": "friction", "simulated": "simulated_refined"},
        compare.run,
    ),
)
"""The published procedure, and the surface refined by the inverse solution: both are proven."""


@dataclass(frozen=True, slots=True)
class BatchOptions(Options):
    """Options of a batch.

    Attributes
    ----------
    jobs : int or None
        Runs simulated at the same time; None for one per core.
    """

    jobs: int | None = None


def run_batch(sources: Sequence[ConfigSource], folder: Path, options: BatchOptions) -> Summary:
    """Run the chain of every belt and sum it up.

    Parameters
    ----------
    sources : sequence of ConfigSource
        One config per belt.
    folder : Path
        Folder of the results; each belt has a folder in it.
    options : BatchOptions
        Force, listener, jobs.
    """
    belts = [_run_belt(source, folder / source.config.belt.name, options) for source in sources]
    return batch_summary(belts, folder)


def _run_belt(source: ConfigSource, folder: Path, options: BatchOptions) -> BeltRun:
    belt = BeltRun(source.config.belt.name)
    talk = Named(belt.belt, options.talk)
    data = source.config.data
    kind_of_data = ", synthetic data" if data.origin == "synthetic" else ""
    talk.say(f"config {source.origin}{kind_of_data}, results in {folder}")
    files = data.files
    chosen = SimulateOptions(force=options.force, talk=talk, jobs=options.jobs)
    for step in CHAIN:
        missing = [name for name in step.needs.values() if name not in files]
        if missing:
            belt.states[step.name] = SKIPPED if step.optional else NOT_RUN
            continue
        out = folder / f"{step.makes}.parquet"
        start = time.monotonic()
        try:
            inputs = {role: files[name] for role, name in step.needs.items()}
            summary = step.run(source, inputs, out, chosen)
        except BeltidError as error:
            _failed(belt, step, error, talk)
            continue
        files[step.makes] = out
        _finished(belt, step, summary, talk, time.monotonic() - start)
    return belt


def _failed(belt: BeltRun, step: Step, error: BeltidError, talk: Talk) -> None:
    belt.states[step.name] = FAILED
    belt.exit_status = belt.exit_status or error.exit_status
    for line in error.problems:
        belt.problems.append(f"{step.name}: {line}")
        talk.error(f"{step.name}: {line}")


def _finished(belt: BeltRun, step: Step, summary: Summary, talk: Talk, elapsed_s: float) -> None:
    belt.summaries[step.name] = summary
    if summary.exit_status == EXIT_DONE:
        belt.states[step.name] = UP_TO_DATE if summary.up_to_date else DONE
    elif summary.exit_status == EXIT_OUT_OF_TOLERANCE:
        belt.states[step.name] = OUT_OF_TOLERANCE
    else:
        belt.states[step.name] = FAILED
    belt.exit_status = belt.exit_status or summary.exit_status
    spent = "" if summary.up_to_date else f", {elapsed_s:.1f} s"
    talk.say(f"{step.name}: {belt.states[step.name]}{spent}")
    for note in summary.notes:
        talk.detail(f"{step.name}: {note}")
    for warning in summary.warnings:
        talk.warn(f"{step.name}: {warning}")
    if summary.exit_status != EXIT_DONE:
        belt.problems += [f"{step.name}: {line}" for line in (summary.verdict, *summary.warnings)]
    if summary.verdict:
        talk.say(f"{step.name}: {summary.verdict}")

"""One step of a chain: what it is made from, and who carries it out."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from beltid.config import ConfigSource
from beltid.errors import BeltidWarning
from beltid.report.summary import Summary
from beltid.stages.build_artifact import Stale
from beltid.stages.reporter import Reporter
from beltid.stages.simulation.simulate_rig import SimulateOptions
from beltid.stages.workers import Workers

StageRun = Callable[[ConfigSource, Mapping[str, Path], Path, SimulateOptions], Summary]
Heard = list[tuple[str, str]]


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
    spreads : bool
        Whether the stage gives its heavy calls to the workers itself; else one of them gets it
        whole.
    section : str
        Section of the config that must be stated for the step to be part of the chain; "" for none.
    """

    name: str
    makes: str
    needs: Mapping[str, str]
    run: StageRun
    spreads: bool = False
    section: str = ""


def within_reach(steps: Sequence[Step], recordings: Collection[str]) -> set[str]:
    """Names of the steps that can be carried out with some kinds of recordings."""
    there, found = set(recordings), set()
    for step in steps:
        if there.issuperset(step.needs.values()):
            there.add(step.makes)
            found.add(step.name)
    return found


@dataclass(frozen=True, slots=True)
class Task:
    """A step to be carried out for a belt.

    Attributes
    ----------
    step : Step
        The step.
    source : ConfigSource
        The config of the belt.
    inputs : dict
        Files by their role in the stage.
    out : Path
        The artifact.
    """

    step: Step
    source: ConfigSource
    inputs: Mapping[str, Path]
    out: Path


def run_task(task: Task, workers: Workers, reporter: Reporter, *, force: bool) -> Summary:
    """Carry out a step: look whether it is up to date, else make it, or have it made.

    Raises
    ------
    BeltidError
        What the stage raises.
    """
    step, place = task.step, (task.source, task.inputs, task.out)
    if workers.jobs == 1:
        return step.run(*place, SimulateOptions(force=force, reporter=reporter, jobs=1))
    if step.spreads or not workers.share_files:
        return step.run(*place, SimulateOptions(force=force, reporter=reporter, workers=workers))
    if not force:
        try:
            return step.run(*place, SimulateOptions(reporter=reporter, peek=True))
        except Stale:
            pass
    summary, heard = workers.call(run_in_worker, step.run, *place, force)
    for how, text in heard:
        getattr(reporter, how)(text)
    return summary


def run_in_worker(
    run: StageRun,
    source: ConfigSource,
    inputs: Mapping[str, Path],
    out: Path,
    force: bool,
    *,
    peek: bool = False,
) -> tuple[Summary, Heard]:
    """Carry out a stage in a worker: its summary, and what it reported."""
    reporter = _Noted()
    with warnings.catch_warnings():
        warnings.showwarning = reporter.note_warning
        options = SimulateOptions(force=force, reporter=reporter, jobs=1, peek=peek)
        summary = run(source, inputs, out, options)
    return summary, reporter.heard


class _Noted(Reporter):
    """Keeps what is reported, to be reported where the user is."""

    def __init__(self) -> None:
        self.heard: Heard = []

    def report(self, text: str) -> None:
        """Keep what is going on."""
        self.heard.append(("report", text))

    def detail(self, text: str) -> None:
        """Keep a detail."""
        self.heard.append(("detail", text))

    def warn(self, text: str) -> None:
        """Keep what the user should look into."""
        self.heard.append(("warn", text))

    def error(self, text: str) -> None:
        """Keep what went wrong."""
        self.heard.append(("error", text))

    def note_warning(
        self, message: Warning | str, category: type[Warning], *rest: object, **more: object
    ) -> None:
        """Keep a warning of Python without its place in the code."""
        ours = issubclass(category, BeltidWarning)
        self.heard.append(
            ("warn", str(message)) if ours else ("detail", f"{category.__name__}: {message}")
        )

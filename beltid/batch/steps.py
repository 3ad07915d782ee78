"""One step of a chain: what it is made from, and who carries it out."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from beltid.config import ConfigSource
from beltid.report.summary import Summary
from beltid.stages.build_artifact import Stale
from beltid.stages.reporter import KeepingReporter, Level, Options, Reporter
from beltid.stages.workers import Workers

StageRun = Callable[[ConfigSource, Mapping[str, Path], Path, Options], Summary]
Call = tuple[ConfigSource, Mapping[str, Path], Path]
"""What a stage is called with: the config, its inputs by their role, the place of its result."""


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
    page : bool
        Whether it makes a page for people in the place of an artifact.
    """

    name: str
    makes: str
    needs: Mapping[str, str]
    run: StageRun
    spreads: bool = False
    section: str = ""
    page: bool = False

    def ready(self, files: Collection[str]) -> bool:
        """Whether all that it is made from is there."""
        return all(name in files for name in self.needs.values())

    def call(self, source: ConfigSource, files: Mapping[str, Path], folder: Path) -> Call:
        """What it is called with for a belt whose results go to a folder."""
        inputs = {role: files[name] for role, name in self.needs.items()}
        return source, inputs, self.place(folder)

    def place(self, folder: Path) -> Path:
        """Where its result goes in the folder of a belt."""
        return folder / f"{self.makes}.{'html' if self.page else 'parquet'}"


def within_reach(steps: Sequence[Step], recordings: Collection[str]) -> set[str]:
    """Names of the steps that can be carried out with some kinds of recordings."""
    there, found = set(recordings), set()
    for step in steps:
        if step.ready(there):
            there.add(step.makes)
            found.add(step.name)
    return found


def run_step(
    step: Step, call: Call, workers: Workers, reporter: Reporter, *, force: bool
) -> Summary:
    """Carry out a step: look whether it is up to date, else make it, or have it made.

    Raises
    ------
    BeltidError
        What the stage raises.
    """
    if step.spreads or workers.jobs == 1 or not workers.share_files:
        return step.run(*call, Options(force=force, reporter=reporter, workers=workers))
    if not force:
        try:
            return step.run(*call, Options(reporter=reporter, peek=True))
        except Stale:
            pass
    summary, lines = workers.call(run_in_worker, step.run, *call, force)
    for level, text in lines:
        reporter.line(level, text)
    return summary


def run_in_worker(
    run: StageRun, source: ConfigSource, inputs: Mapping[str, Path], out: Path, force: bool
) -> tuple[Summary, list[tuple[Level, str]]]:
    """Carry out a stage in a worker: its summary, and what it reported."""
    reporter = KeepingReporter()
    with reporter.python_warnings():
        options = Options(force=force, reporter=reporter)
        summary = run(source, inputs, out, options)
    return summary, reporter.lines

"""One step of a chain: its inputs, and how it is run."""

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
"""Arguments of a stage: config, inputs by role, path of the result."""


@dataclass(frozen=True, slots=True)
class Step:
    """One stage of the chain.

    Attributes
    ----------
    name : str
        Name of its command, with a suffix if the chain has it twice.
    makes : str
        Name of its artifact.
    needs : dict
        Recordings and artifacts that it reads, by their role in the stage.
    run : callable
        The stage.
    spreads : bool
        Whether the stage distributes its heavy calls to the workers; otherwise one worker runs the
        whole stage.
    section : str
        Config section that must be stated for the step to be part of the chain; "" for none.
    page : bool
        Whether it writes a report page instead of an artifact.
    """

    name: str
    makes: str
    needs: Mapping[str, str]
    run: StageRun
    spreads: bool = False
    section: str = ""
    page: bool = False

    def ready(self, files: Collection[str]) -> bool:
        """Return whether all inputs exist."""
        return all(name in files for name in self.needs.values())

    def call(self, source: ConfigSource, files: Mapping[str, Path], folder: Path) -> Call:
        """Return the arguments of the stage for a belt with this results folder.

        The inputs of a page are all files.
        """
        inputs = files if self.page else {role: files[name] for role, name in self.needs.items()}
        return source, inputs, self.place(folder)

    def place(self, folder: Path) -> Path:
        """Return the path of its result in the folder of a belt."""
        return folder / f"{self.makes}.{'html' if self.page else 'parquet'}"


def within_reach(steps: Sequence[Step], recordings: Collection[str]) -> set[str]:
    """Return the names of the steps that can run with the given kinds of recordings."""
    available, names = set(recordings), set()
    for step in steps:
        if step.ready(available):
            available.add(step.makes)
            names.add(step.name)
    return names


def run_step(
    step: Step, call: Call, workers: Workers, reporter: Reporter, *, force: bool
) -> Summary:
    """Run a step, here or in a worker, unless its result is up to date.

    Raises
    ------
    BeltidError
        If the stage raises it.
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
    """Run a stage in a worker; return its summary and its messages."""
    reporter = KeepingReporter()
    with reporter.python_warnings():
        options = Options(force=force, reporter=reporter)
        summary = run(source, inputs, out, options)
    return summary, reporter.lines

"""One step of a chain: its inputs, and how it is run."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from beltid.config import ConfigSource
from beltid.notes import Kept, heard_by, log, python_warnings
from beltid.report.summary import Summary
from beltid.report.view import summary_of
from beltid.stage import STAGES, Stage
from beltid.stages import steps  # noqa: F401  (registers the stages)
from beltid.stages.workers import Workers

Call = tuple[ConfigSource, Mapping[str, Path], Path]
"""Arguments of a stage: config, inputs by parameter, path of the result."""


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
        Parameter of the stage -> recording or artifact that it reads.
    spreads : bool
        Whether the stage distributes its heavy calls to the workers; otherwise one worker runs the
        whole stage.
    section : str
        Config section that must be stated for the step to be part of the chain; "" for none.
    """

    name: str
    makes: str
    needs: Mapping[str, str]
    spreads: bool = False
    section: str = ""

    @property
    def stage(self) -> Stage:
        """The stage."""
        return STAGES[self.name.partition(" ")[0]]

    def ready(self, files: Collection[str]) -> bool:
        """Return whether all inputs exist."""
        return all(name in files for name in self.needs.values())

    def call(self, source: ConfigSource, files: Mapping[str, Path], folder: Path) -> Call:
        """Return the arguments of the stage for a belt with this results folder."""
        inputs = {role: files[name] for role, name in self.needs.items()}
        return source, inputs, self.place(folder)

    def place(self, folder: Path) -> Path:
        """Return the path of its result in the folder of a belt."""
        return folder / f"{self.makes}.parquet"


def within_reach(chain: Sequence[Step], recordings: Collection[str]) -> set[str]:
    """Return the names of the steps that can run with the given kinds of recordings."""
    available, names = set(recordings), set()
    for step in chain:
        if step.ready(available):
            available.add(step.makes)
            names.add(step.name)
    return names


def run_step(step: Step, call: Call, workers: Workers, *, force: bool) -> Summary:
    """Run a step, here or in a worker, unless its result is up to date.

    Raises
    ------
    BeltidError
        If the stage raises it.
    """
    stage = step.stage
    if step.spreads or workers.jobs == 1 or not workers.share_files:
        built = stage.run(*call, force=force, workers=workers)
        return summary_of(built.artifact, up_to_date=built.up_to_date, fails_with=stage.fails_with)
    _, existing = stage.look(*call, force=force)
    if existing is not None:
        return summary_of(existing, up_to_date=True, fails_with=stage.fails_with)
    summary, lines = workers.call(run_in_worker, stage.name, *call, force)
    for level, text in lines:
        log.log(level, "%s", text)
    return summary


def run_in_worker(
    name: str, source: ConfigSource, inputs: Mapping[str, Path], out: Path, force: bool
) -> tuple[Summary, list[tuple[int, str]]]:
    """Run a stage in a worker; return its summary and its messages."""
    stage, kept = STAGES[name], Kept()
    with heard_by(kept), python_warnings():
        built = stage.run(source, inputs, out, force=force)
    return summary_of(built.artifact, fails_with=stage.fails_with), kept.lines

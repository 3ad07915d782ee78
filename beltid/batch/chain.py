"""The chain of a belt: the method as a table of steps, and what became of each."""

import logging
import time
import traceback
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from beltid import stages
from beltid.config import Config, ConfigSource
from beltid.errors import EXIT_BUG, EXIT_DONE, EXIT_OUT_OF_TOLERANCE, BeltidError, TooFewSettings
from beltid.notes import log, prefixed
from beltid.report.results import summary_of
from beltid.report.summary import Summary
from beltid.stage import Stage
from beltid.stages.about import WITHOUT, lacking
from beltid.stages.page_mark import NAME, OnPage, keep_curves, mark_to_write
from beltid.stages.steps import STAGES
from beltid.stages.workers import Workers

DONE = "done"
UP_TO_DATE = "up to date"
TO_BE_MADE = "to be made"
FAILED = "failed"
WRONG = "cannot be made"
NO_RECORDING = "no recording"
OUT_OF_TOLERANCE = "out of tolerance"
REPORT = "report"


@dataclass(frozen=True, slots=True)
class Step:
    """One step of the chain: its stage, with a suffix if the chain has it twice, and its file.

    `needs` says for each parameter of the stage which recording, or file of an earlier step, it is;
    `section`, which section of the config must be stated ("": none).
    """

    name: str
    makes: str
    needs: Mapping[str, str]
    section: str = ""

    @property
    def stage(self) -> Stage:
        """The stage."""
        return STAGES[self.name.partition(" ")[0]]

    def inputs(self, files: Mapping[str, Path]) -> dict[str, Path]:
        """Return its inputs by parameter."""
        return {role: files[name] for role, name in self.needs.items()}


PRESS, STIFFNESS, FRICTION = {"frame": "press"}, {"law": "stiffness"}, {"friction": "friction"}
PUBLISHED, REFINED = {"surface": "surface"}, {"surface": "surface_refined"}
CHAIN = (
    Step("fit-stiffness", "stiffness", PRESS),
    Step("fit-slip", "slip", {"frame": "speedloss"}),
    Step("fit-friction", "friction", {"frame": "rig"}),
    Step("build-surface", "surface", FRICTION),
    Step("refine-surface", "surface_refined", FRICTION | STIFFNESS),
    Step("simulate-rig", "simulated", PUBLISHED | STIFFNESS | FRICTION),
    Step("compare", "compare", FRICTION | {"simulated": "simulated"}),
    Step("simulate-rig refined", "simulated_refined", REFINED | STIFFNESS | FRICTION),
    Step("compare refined", "compare_refined", FRICTION | {"simulated": "simulated_refined"}),
    Step("cross-validate", "crossvalidation", FRICTION | STIFFNESS),
    Step("simulate-drive", "drive", REFINED | STIFFNESS | {"slip": "slip"}, "drive"),
    Step("compare-drive", "compare_drive", {"slip": "slip", "drive": "drive"}, "drive"),
)
"""The published procedure and the refined surface, both compared with the bench; prediction of runs
left out; and the drive of the speed-loss recording, if the config states one."""

OF_RUNNING_BELT = ("fit-stiffness", "fit-slip", "fit-friction", "build-surface")
"""Steps that need no simulated rig; a running belt has none."""


@dataclass(slots=True)
class Belt:
    """What became of the chain of a belt; its steps by name, in the order of the chain."""

    name: str
    states: dict[str, str] = field(default_factory=dict)
    lacking: tuple[str, ...] = ()  # recordings that the chain can use but the config does not name
    facts: dict[str, dict[str, Any]] = field(default_factory=dict)  # of the steps with a result
    troubles: dict[str, tuple[int, tuple[str, ...]]] = field(default_factory=dict)  # of the steps
    origins: list[str | None] = field(default_factory=list)
    made: list[str] = field(default_factory=list)  # files that exist, recordings among them
    new: bool = False  # whether anything was computed
    page: OnPage | None = None  # what its report shows, if there is one

    def failed(self, name: str, error: Exception) -> None:
        """Record and log that a step failed; a bug, with its traceback, costs only this step."""
        problems = getattr(error, "problems", (f"{type(error).__name__}: {error}",))
        if not isinstance(error, BeltidError):
            log.error("%s", "".join(traceback.format_exception(error)).rstrip())
        self.states[name] = FAILED
        self.troubles[name] = (getattr(error, "exit_status", EXIT_BUG), problems)
        _say(logging.ERROR, name, problems)

    def has(self, name: str, said: Summary, spent_s: float) -> None:
        """Record and log what a step has made, or found up to date."""
        state, self.facts[name] = UP_TO_DATE if said.up_to_date else DONE, said.facts
        if said.exit_status:
            state = OUT_OF_TOLERANCE if said.exit_status == EXIT_OUT_OF_TOLERANCE else FAILED
            self.troubles[name] = (said.exit_status, (said.verdict, *said.warnings))
        self.states[name] = state
        self.origins.append(said.origin)
        self.new |= not said.up_to_date
        log.info("%s: %s%s", name, state, "" if said.up_to_date else f", {spent_s:.1f} s")
        _say(logging.DEBUG, name, said.notes)
        _say(logging.WARNING, name, said.warnings)
        _say(logging.INFO, name, [said.verdict])

    @property
    def exit_status(self) -> int:
        """Exit status of the first step that failed; a refined comparison overrides the other."""
        for name, (status, _) in self.troubles.items():
            by = self.states.get("compare refined") if name == "compare" else None  # the result
            if self.states[name] != OUT_OF_TOLERANCE or by not in (DONE, UP_TO_DATE):
                return status
        return EXIT_DONE


def chain_of(config: Config) -> Iterator[tuple[Step, str]]:
    """Yield the steps of a chain, each with its state before the first: some lack a recording."""
    available, stated = set(config.data.files), {"", *config.model_fields_set}
    for step in CHAIN:
        if step.name == "cross-validate" and config.cross_validate.by == "none":
            continue
        if step.section in stated and available.issuperset(step.needs.values()):
            available.add(step.makes)
            yield step, "not run"
        elif step.section in stated:
            yield step, NO_RECORDING


def look_at_belt(
    source: ConfigSource, folder: Path, *, force: bool = False
) -> Iterator[tuple[str, Path, str, BeltidError | None]]:
    """Yield each step's name, file, state and error, if the chain began now; compute nothing."""
    files, stale = dict(source.config.data.files), set[str]()
    for step, state in chain_of(source.config):
        out, needs, error = folder / f"{step.makes}.parquet", set(step.needs.values()), None
        if needs <= files.keys():
            state = TO_BE_MADE
            if not force and stale.isdisjoint(needs):
                try:
                    if step.stage.look(source, step.inputs(files), out)[-1] is not None:
                        state = UP_TO_DATE
                except BeltidError as found:
                    state, error = WRONG, found
            if state != WRONG:
                files[step.makes] = out
            if state == TO_BE_MADE:
                stale.add(step.makes)
        yield step.name, out, state, error


def run_belt(source: ConfigSource, folder: Path, workers: Workers, *, force: bool = False) -> Belt:
    """Run the chain of a belt; a step that fails does not stop those that do not need it."""
    belt, files = Belt(source.name), dict(source.config.data.files)
    belt.lacking = tuple(lacking(source.config))
    with prefixed(f"{source.name}: "):
        synthetic = ", synthetic data" if source.config.data.origin == "synthetic" else ""
        log.info("config %s%s, results in %s", source.origin, synthetic, folder)
        for kind in belt.lacking:
            log.warning(WITHOUT[kind])
        for step, belt.states[step.name] in chain_of(source.config):
            is_running = "rig_running" in belt.facts.get("fit-friction", {})
            if is_running and step.name not in OF_RUNNING_BELT:
                belt.states[step.name] = "not simulated"
            elif files.keys() >= set(step.needs.values()):
                out, start = folder / f"{step.makes}.parquet", time.monotonic()
                try:
                    made, kept = step.stage.run(
                        source, step.inputs(files), out, force=force, workers=workers
                    )
                    belt.has(step.name, summary_of(made, up_to_date=kept), time.monotonic() - start)
                    files[step.makes] = out
                except TooFewSettings as error:
                    belt.states[step.name] = "too few settings"
                    _say(logging.WARNING, step.name, error.problems)
                except Exception as error:
                    belt.failed(step.name, error)
        if "not simulated" in belt.states.values():
            log.info(stages.rig.NOT_SIMULATED)
    # what lacks a recording is hidden as such, whoever writes the page
    lack = (step.makes for step in CHAIN if belt.states.get(step.name) == NO_RECORDING)
    belt.made = sorted({*files, *lack})
    return belt


def add_page(belt: Belt, source: ConfigSource, folder: Path, *, force: bool = False) -> None:
    """Write the report of a belt that has results; not to be called from several threads."""
    if not belt.facts:
        return
    failures = tuple(
        f"{name} failed (exit status {status}): {problems[0]}"
        for name, (status, problems) in belt.troubles.items()
        if belt.states[name] == FAILED
    )
    shown, out = OnPage(folder, source.config.data.files, belt.made, failures), folder / NAME
    with prefixed(f"{source.name}: "):
        keep_curves(source, folder, force=force)
        try:
            state = UP_TO_DATE
            if mark := mark_to_write([shown], out, force=force):
                page = stages.report_belt.write_page([shown], out, mark)
                state, belt.new = DONE, True
                _say(logging.WARNING, REPORT, page.warnings)
                _say(logging.INFO, REPORT, [page.verdict])
        except Exception as error:  # matplotlib may have no folder to write to
            belt.failed(REPORT, BeltidError(f"{error}") if isinstance(error, OSError) else error)
            return
        belt.states[REPORT], belt.page = state, shown
        log.info("%s: %s, %s", REPORT, state, out)


def _say(level: int, name: str, lines: Sequence[str]) -> None:
    for line in filter(None, lines):
        log.log(level, "%s: %s", name, line)

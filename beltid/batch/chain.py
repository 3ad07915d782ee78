"""The chain of a belt: the method as a table of steps, each with its inputs."""

from __future__ import annotations

import logging
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import beltid.stages.steps  # noqa: F401  makes the stages known
from beltid.batch.belts import (
    DONE,
    FAILED,
    HELD_OUT,
    NOT_RUN,
    OUT_OF_TOLERANCE,
    REPORT,
    SKIPPED,
    TO_BE_MADE,
    UP_TO_DATE,
    WRONG,
    Belt,
)
from beltid.config import Config, ConfigSource
from beltid.errors import EXIT_OUT_OF_TOLERANCE, BeltidError, TooFewSettings
from beltid.notes import Prefix, log, prefixed
from beltid.report.view import summary_of
from beltid.stage import STAGES, Stage
from beltid.stages.named_recordings import WITHOUT, lacking
from beltid.stages.page_mark import NAME, OnPage, keep_curves, made_from, up_to_date
from beltid.stages.workers import Workers
from beltid.store.disk import remove_stale


@dataclass(frozen=True, slots=True)
class Step:
    """One step of the chain.

    Attributes
    ----------
    name : str
        Name of its stage, with a suffix if the chain has it twice.
    makes : str
        Name of its file.
    needs : dict
        Parameter of the stage -> recording or file of an earlier step.
    section : str
        Section of the config that must be stated for the step; "" for none.
    """

    name: str
    makes: str
    needs: Mapping[str, str]
    section: str = ""

    @property
    def stage(self) -> Stage:
        """The stage."""
        return STAGES[self.name.partition(" ")[0]]

    def ready(self, files: Collection[str]) -> bool:
        """Return whether all inputs exist."""
        return all(name in files for name in self.needs.values())

    def inputs(self, files: Mapping[str, Path]) -> dict[str, Path]:
        """Return its inputs by parameter."""
        return {role: files[name] for role, name in self.needs.items()}


PRESS, STIFFNESS, FRICTION = {"frame": "press"}, {"law": "stiffness"}, {"friction": "friction"}
PUBLISHED, REFINED = {"surface": "surface"}, {"surface": "surface_refined"}
CHAIN: Final = (
    Step("fit-stiffness", "stiffness", PRESS),
    Step("fit-slip", "slip", {"frame": "speedloss"}),
    Step("fit-friction", "friction", {"frame": "rig"}),
    Step("build-surface", "surface", FRICTION),
    Step("refine-surface", "surface_refined", FRICTION | STIFFNESS),
    Step("simulate-rig", "simulated", PUBLISHED | STIFFNESS | FRICTION),
    Step("compare", "compare", FRICTION | {"simulated": "simulated"}),
    Step("simulate-rig refined", "simulated_refined", REFINED | STIFFNESS | FRICTION),
    Step("compare refined", "compare_refined", FRICTION | {"simulated": "simulated_refined"}),
    Step(HELD_OUT, "crossvalidation", FRICTION | STIFFNESS),
    Step("simulate-drive", "drive", REFINED | STIFFNESS | {"slip": "slip"}, "drive"),
    Step("compare-drive", "compare_drive", {"slip": "slip", "drive": "drive"}, "drive"),
)
"""The published procedure and the surface refined by the inverse solution, both compared with the
bench; prediction of left-out runs by a surface refined from the others; and the drive of the
speed-loss recording, if the config states one."""

OF_RUNNING_BELT: Final = ("fit-stiffness", "fit-slip", "fit-friction", "build-surface")
"""Steps that need no simulated rig; a running belt has none."""


def chain_of(config: Config) -> list[Step]:
    """Return the steps of a chain."""
    if config.rig.kind == "running":
        return [step for step in CHAIN if step.name in OF_RUNNING_BELT]
    chain = [s for s in CHAIN if not s.section or s.section in config.model_fields_set]
    return [s for s in chain if s.name != HELD_OUT or config.cross_validate.by != "none"]


def states_at_first(chain: Sequence[Step], recordings: Collection[str]) -> dict[str, str]:
    """Return the state of every step before the first: some lack a recording."""
    available, states = set(recordings), {}
    for step in chain:
        states[step.name] = NOT_RUN if step.ready(available) else SKIPPED
        available |= {step.makes} if step.ready(available) else set()
    return states


def look_at_belt(
    source: ConfigSource, folder: Path, *, force: bool = False
) -> Iterator[tuple[str, Path, str, BeltidError | None]]:
    """Yield each step's name, file, state and error, if the chain began now; compute nothing."""
    chain, files = chain_of(source.config), dict(source.config.data.files)
    states, stale = states_at_first(chain, files), set[str]()
    for step in chain:
        out, state, error = folder / f"{step.makes}.parquet", states[step.name], None
        if step.ready(files):
            state = TO_BE_MADE
            if not force and stale.isdisjoint(step.needs.values()):
                try:
                    _, existing = step.stage.look(source, step.inputs(files), out)
                    state = TO_BE_MADE if existing is None else UP_TO_DATE
                except BeltidError as found:
                    state, error = WRONG, found
            if state != WRONG:
                files[step.makes] = out
            if state == TO_BE_MADE:
                stale.add(step.makes)
        yield step.name, out, state, error


def run_belt(source: ConfigSource, folder: Path, workers: Workers, *, force: bool = False) -> Belt:
    """Run the chain of a belt; a step that fails does not stop those that do not need it.

    Parameters
    ----------
    source : ConfigSource
        The config.
    folder : Path
        Results folder of the belt.
    workers : Workers
        Run the heavy calls.
    force : bool
        Whether to compute again what is up to date.
    """
    chain, files = chain_of(source.config), dict(source.config.data.files)
    belt = Belt(source.name, states_at_first(chain, files), tuple(lacking(source.config)))
    remove_stale(folder)
    with prefixed(Prefix(f"{source.name}: ")):
        _announce(belt, source, folder)
        for step in chain:
            if step.ready(files):
                out = folder / f"{step.makes}.parquet"
                try:
                    _run_step(belt, step, source, step.inputs(files), out, workers, force=force)
                    files[step.makes] = out
                except TooFewSettings as error:
                    belt.few_settings(step.name)
                    _say(logging.WARNING, step.name, error.problems)
                except BeltidError as error:
                    belt.failed(step.name, error)
                    _say(logging.ERROR, step.name, error.problems)
    belt.made = sorted(files)
    return belt


def add_page(belt: Belt, source: ConfigSource, folder: Path, *, force: bool = False) -> None:
    """Write the report of a belt that has results; not to be called from several threads."""
    if not belt.facts:
        return
    shown, out = OnPage(folder, source.config, belt.made, belt.failures), folder / NAME
    with prefixed(Prefix(f"{source.name}: ")):
        keep_curves(source, folder, force=force)
        try:
            state = UP_TO_DATE
            if not up_to_date(out, made_from(shown), force=force):
                from beltid.stages.report_belt import of_belt

                page, state, belt.new = of_belt(shown, out, force=force), DONE, True
                _say(logging.WARNING, REPORT, page.warnings)
                _say(logging.INFO, REPORT, [page.verdict] if page.verdict else [])
        except BeltidError as error:
            belt.failed(REPORT, error)
            _say(logging.ERROR, REPORT, error.problems)
            return
        belt.states[REPORT] = state
        log.info("%s: %s, %s", REPORT, state, out)


def _announce(belt: Belt, source: ConfigSource, folder: Path) -> None:
    synthetic = ", synthetic data" if source.config.data.origin == "synthetic" else ""
    log.info("config %s%s, results in %s", source.origin, synthetic, folder)
    if source.config.rig.kind == "running":
        from beltid.stages.planned_runs import NOT_SIMULATED

        log.info(NOT_SIMULATED)
    for kind in belt.lacking:
        log.warning(WITHOUT[kind])


def _run_step(
    belt: Belt,
    step: Step,
    source: ConfigSource,
    inputs: Mapping[str, Path],
    out: Path,
    workers: Workers,
    *,
    force: bool,
) -> None:
    start = time.monotonic()
    built = step.stage.run(source, inputs, out, force=force, workers=workers)
    summary = summary_of(
        built.artifact, up_to_date=built.up_to_date, fails_with=step.stage.fails_with
    )
    state = UP_TO_DATE if built.up_to_date else DONE
    if summary.exit_status:
        state = OUT_OF_TOLERANCE if summary.exit_status == EXIT_OUT_OF_TOLERANCE else FAILED
        belt.troubles[step.name] = (summary.exit_status, (summary.verdict, *summary.warnings))
    belt.states[step.name] = state
    belt.facts[step.name] = summary.facts
    belt.origins.append(summary.origin)
    belt.new |= not built.up_to_date
    spent = "" if built.up_to_date else f", {time.monotonic() - start:.1f} s"
    log.info("%s: %s%s", step.name, state, spent)
    _say(logging.DEBUG, step.name, summary.notes)
    _say(logging.WARNING, step.name, summary.warnings)
    _say(logging.INFO, step.name, [summary.verdict] if summary.verdict else [])


def _say(level: int, name: str, lines: Sequence[str]) -> None:
    for line in lines:
        log.log(level, "%s: %s", name, line)

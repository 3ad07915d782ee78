"""Schedule the chains of all belts in parallel; a step starts when its inputs exist."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any

from beltid.batch.belts import (
    DONE,
    FAILED,
    NOT_RUN,
    OUT_OF_TOLERANCE,
    SKIPPED,
    TOO_FEW_SETTINGS,
    UP_TO_DATE,
    BeltRun,
)
from beltid.batch.steps import Step, run_step, within_reach
from beltid.config import ConfigSource
from beltid.errors import EXIT_DONE, EXIT_OUT_OF_TOLERANCE, BeltidError, TooFewSettings
from beltid.notes import Prefix, log, prefixed
from beltid.report.summary import Summary
from beltid.stages.named_recordings import WITHOUT, lacking
from beltid.stages.planned_runs import NOT_SIMULATED
from beltid.stages.workers import LOOK_UP_S, Workers

STEPS_AHEAD = 2  # steps in progress per worker: while some read and write, others compute
MOST_STEPS = 64  # limit for a large cluster: a campaign alone is a few dozen calls


class Chain:
    """The chain of one belt: waiting steps and the outcome of the others.

    Parameters
    ----------
    source : ConfigSource
        The config of the belt.
    folder : Path
        Results folder of the belt.
    steps : sequence of Step
        Steps of the chain.
    """

    def __init__(self, source: ConfigSource, folder: Path, steps: Sequence[Step]) -> None:
        self.source, self.folder = source, folder
        self.prefix = Prefix(f"{source.name}: ")
        self.files = source.config.data.files
        self.waiting = list(steps)
        possible = within_reach(steps, self.files)
        self.run = BeltRun(
            source.name,
            {step.name: NOT_RUN if step.name in possible else SKIPPED for step in steps},
            tuple(lacking(source.config)),
        )
        self._announced = False

    def next_step(self) -> Step | None:
        """Remove and return the first waiting step whose inputs exist; None if there is none."""
        for step in self.waiting:
            if step.ready(self.files):
                self.waiting.remove(step)
                self._announce()
                return step
        return None

    def _announce(self) -> None:
        if not self._announced:
            self._announced = True
            synthetic = self.source.config.data.origin == "synthetic"
            kind_of_data = ", synthetic data" if synthetic else ""
            origin = self.source.origin
            with prefixed(self.prefix):
                log.info("config %s%s, results in %s", origin, kind_of_data, self.folder)
                if self.source.config.rig.kind == "running":
                    log.info(NOT_SIMULATED)
                for kind in self.run.lacking:
                    log.warning(WITHOUT[kind])

    def failed(self, step: Step, error: BeltidError) -> None:
        """Record that a step failed; steps that need it are not run."""
        level = logging.ERROR
        if isinstance(error, TooFewSettings):
            level = logging.WARNING
            self.run.states[step.name] = TOO_FEW_SETTINGS
        else:
            self.run.failed(step.name, error)
        with prefixed(self.prefix):
            for line in error.problems:
                log.log(level, "%s: %s", step.name, line)

    def finished(self, step: Step, summary: Summary, elapsed_s: float) -> None:
        """Record that a step finished."""
        name = step.name
        self.files[step.makes] = step.place(self.folder)
        self.run.summaries[name] = summary
        if summary.exit_status == EXIT_DONE:
            state = UP_TO_DATE if summary.up_to_date else DONE
        else:
            state = OUT_OF_TOLERANCE if summary.exit_status == EXIT_OUT_OF_TOLERANCE else FAILED
            lines = (summary.verdict, *summary.warnings)
            self.run.troubles[name] = (summary.exit_status, lines)
        self.run.states[name] = state
        spent = "" if summary.up_to_date else f", {elapsed_s:.1f} s"
        with prefixed(self.prefix):
            log.info("%s: %s%s", name, state, spent)
            for note in summary.notes:
                log.debug("%s: %s", name, note)
            for warning in summary.warnings:
                log.warning("%s: %s", name, warning)
            if summary.verdict:
                log.info("%s: %s", name, summary.verdict)


def run_chains(chains: Sequence[Chain], workers: Workers, *, force: bool = False) -> None:
    """Run chains until nothing more can be done.

    Parameters
    ----------
    chains : sequence of Chain
        The chains; earlier ones have priority.
    workers : Workers
        Workers that compute.
    force : bool
        Whether to recompute results that are up to date.
    """
    alone = workers.jobs == 1
    most = 1 if alone else min(STEPS_AHEAD * workers.jobs, MOST_STEPS)
    running: dict[Future[Summary], tuple[Chain, Step, float]] = {}
    threads: Executor = _InlineExecutor() if alone else ThreadPoolExecutor(most)
    try:
        while True:
            for chain in chains:
                while len(running) < most and (step := chain.next_step()) is not None:
                    start = time.monotonic()
                    call = step.call(chain.source, chain.files, chain.folder)
                    future = threads.submit(
                        _prefixed_step, chain.prefix, step, call, workers, force=force
                    )
                    running[future] = (chain, step, start)
            if not running:
                return
            # wake up regularly to handle signals that the system delivers to another thread
            for future in wait(running, LOOK_UP_S, FIRST_COMPLETED).done:
                chain, step, start = running.pop(future)
                try:
                    chain.finished(step, future.result(), time.monotonic() - start)
                except BeltidError as error:
                    chain.failed(step, error)
    finally:
        if running:  # an interrupt or a bug
            workers.stop()
        threads.shutdown(wait=True, cancel_futures=True)


def _prefixed_step(prefix: Prefix, *call: Any, force: bool) -> Summary:
    with prefixed(prefix):
        return run_step(*call, force=force)


class _InlineExecutor(Executor):
    """Executor that runs calls immediately in this thread, where an interrupt reaches them."""

    def submit(
        self, function: Callable[..., Any], /, *arguments: Any, **options: Any
    ) -> Future[Any]:
        """Run a call; a BeltidError is stored in the future."""
        future: Future[Any] = Future()
        try:
            future.set_result(function(*arguments, **options))
        except BeltidError as error:
            future.set_exception(error)
        return future

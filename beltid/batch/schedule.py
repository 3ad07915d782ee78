"""Which step comes next: the chains of all belts side by side, each step when its inputs stand."""

from __future__ import annotations

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
from beltid.report.summary import Summary
from beltid.stages.reporter import Level, NamedReporter, Reporter
from beltid.stages.setup.named_recordings import WITHOUT, lacking
from beltid.stages.workers import LOOK_UP_S, Workers

STEPS_AHEAD = 2  # steps under way for each worker: while some read and write, others compute
MOST_STEPS = 64  # of a large cluster: a campaign alone is a few dozen calls


class Chain:
    """The chain of one belt: which of its steps can start, what became of the others.

    Parameters
    ----------
    source : ConfigSource
        The config of the belt, or of one case of a sweep.
    folder : Path
        Folder of its results.
    steps : sequence of Step
        The chain.
    reporter : Reporter
        Hears what is going on.
    """

    def __init__(
        self, source: ConfigSource, folder: Path, steps: Sequence[Step], reporter: Reporter
    ) -> None:
        self.source, self.folder = source, folder
        self.reporter = NamedReporter(source.name, reporter)
        self.files = source.config.data.files
        self.waiting = list(steps)
        possible = within_reach(steps, self.files)
        self.run = BeltRun(
            source.config.belt.name,
            source.case,
            source.swept,
            {step.name: NOT_RUN if step.name in possible else SKIPPED for step in steps},
            tuple(lacking(source.config)),
        )
        self._announced = False

    def next_step(self) -> Step | None:
        """The first step whose inputs stand; None if there is none by now."""
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
            self.reporter.report(f"config {origin}{kind_of_data}, results in {self.folder}")
            for kind in self.run.lacking:
                self.reporter.warn(WITHOUT[kind])

    def failed(self, step: Step, error: BeltidError) -> None:
        """Note that a step failed; what needs it is not run."""
        level: Level = "error"
        if isinstance(error, TooFewSettings):
            level = "warn"
            self.run.states[step.name] = TOO_FEW_SETTINGS
        else:
            self.run.failed(step.name, error)
        for line in error.problems:
            self.reporter.line(level, f"{step.name}: {line}")

    def finished(self, step: Step, summary: Summary, elapsed_s: float) -> None:
        """Note that a step finished."""
        name, reporter = step.name, self.reporter
        out = self.files[step.makes] = step.place(self.folder)
        self.run.summaries[name] = summary
        if summary.exit_status == EXIT_DONE:
            state = UP_TO_DATE if summary.up_to_date else DONE
        else:
            state = OUT_OF_TOLERANCE if summary.exit_status == EXIT_OUT_OF_TOLERANCE else FAILED
            lines = (summary.verdict, *summary.warnings)
            self.run.troubles[name] = (summary.exit_status, lines)
        self.run.states[name] = state
        if step.page:
            reporter.report(f"{name}: {state}, {out}")
            return
        spent = "" if summary.up_to_date else f", {elapsed_s:.1f} s"
        reporter.report(f"{name}: {state}{spent}")
        for note in summary.notes:
            reporter.detail(f"{name}: {note}")
        for warning in summary.warnings:
            reporter.warn(f"{name}: {warning}")
        if summary.verdict:
            reporter.report(f"{name}: {summary.verdict}")


def run_chains(
    chains: Sequence[Chain], workers: Workers, *, force: bool = False, fail_fast: bool = False
) -> None:
    """Run chains until nothing more can be done.

    Parameters
    ----------
    chains : sequence of Chain
        The chains, the first one first where not all can go on at once.
    workers : Workers
        Who computes.
    force : bool
        Whether to make again what is up to date.
    fail_fast : bool
        Whether the first step that fails ends it all.
    """
    alone = workers.jobs == 1
    most = 1 if alone else min(STEPS_AHEAD * workers.jobs, MOST_STEPS)
    under_way: dict[Future[Summary], tuple[Chain, Step, float]] = {}
    threads: Executor = _Here() if alone else ThreadPoolExecutor(most)
    try:
        while True:
            for chain in chains:
                while len(under_way) < most and (step := chain.next_step()) is not None:
                    start = time.monotonic()
                    call = step.call(chain.source, chain.files, chain.folder)
                    future = threads.submit(
                        run_step, step, call, workers, chain.reporter, force=force
                    )
                    under_way[future] = (chain, step, start)
            if not under_way:
                return
            # a signal that the system gives to another thread is heard when this one wakes up
            for future in wait(under_way, LOOK_UP_S, FIRST_COMPLETED).done:
                chain, step, start = under_way.pop(future)
                try:
                    chain.finished(step, future.result(), time.monotonic() - start)
                except BeltidError as error:
                    chain.failed(step, error)
                if fail_fast and chain.run.exit_status != EXIT_DONE:
                    return
    finally:
        if under_way:  # the first failure ends it
            workers.stop()
        threads.shutdown(wait=True, cancel_futures=True)


class _Here(Executor):
    """Calls carried out at once, where an interrupt reaches them."""

    def submit(
        self, function: Callable[..., Any], /, *arguments: Any, **options: Any
    ) -> Future[Any]:
        """Carry out a call; what went wrong for a reason is kept for the one who asks."""
        future: Future[Any] = Future()
        try:
            future.set_result(function(*arguments, **options))
        except BeltidError as error:
            future.set_exception(error)
        return future

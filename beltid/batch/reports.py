"""The reports at the end of a batch: a page for every belt, and one that compares them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from beltid.batch.belts import DONE, FAILED, UP_TO_DATE, BeltRun
from beltid.batch.schedule import Chain
from beltid.batch.steps import Heard, run_in_worker
from beltid.config import ConfigSource
from beltid.errors import BeltidError
from beltid.report.summary import Summary
from beltid.stages.build_artifact import Stale
from beltid.stages.reporter import Options
from beltid.stages.workers import Workers

STEP: Final = "report"


def write_reports(
    chains: Sequence[Chain], folder: Path | None, options: Options, workers: Workers
) -> None:
    """Write the reports of belts that have results; cases of a sweep have a table instead.

    Parameters
    ----------
    chains : sequence of Chain
        The chains, ended.
    folder : Path or None
        Folder of the results of the batch; None for a part of one, which compares nothing.
    options : Options
        Force and reporter.
    workers : Workers
        Who draws the pages of several belts.
    """
    from beltid.stages.results import report_belt

    wanted = [chain for chain in chains if chain.run.summaries and not chain.run.case]
    for chain, made, heard in _made(wanted, workers, force=options.force):
        for how, text in heard:
            getattr(chain.reporter, how)(text)
        if isinstance(made, BeltidError):
            _failed(chain.run, made)
            for line in made.problems:
                chain.reporter.error(f"{STEP}: {line}")
        else:
            _finished(chain.run, made)
            chain.reporter.report(f"{STEP}: {chain.run.states[STEP]}, {made.out}")
    reported = [chain for chain in wanted if chain.run.states[STEP] != FAILED]
    if not reported or folder is None:
        return
    belts = [chain.folder for chain in reported]
    mine = {chain.folder for chain in chains}
    belts += [path for path in report_belt.reported_in(folder) if path not in mine]
    if len(belts) > 1:
        page = folder / report_belt.NAME
        try:
            report_belt.of_belts(sorted(belts), page, options)
        except BeltidError as error:
            for line in error.problems:
                options.reporter.error(f"{STEP}: {line}")
            _failed(reported[-1].run, error)
            return
        options.reporter.report(f"{STEP}: the belts side by side: {page}")


def _made(
    chains: Sequence[Chain], workers: Workers, *, force: bool
) -> Iterator[tuple[Chain, Summary | BeltidError, Heard]]:
    """Pages of belts as they are made: the summary, or what went wrong, and what was said."""
    stale = list(chains)
    if not force:
        for chain in chains:
            try:
                made, heard = _page(chain.source, chain.folder, force=False, peek=True)
            except Stale:
                continue
            stale.remove(chain)
            yield chain, made, heard
    # a single page is made here: it would only wait for a worker to import what draws
    here = len(stale) == 1 or not workers.share_files
    calls = [(chain.source, chain.folder, force) for chain in stale]
    missing = dict(enumerate(stale))
    try:
        for index, (made, heard) in (Workers() if here else workers).as_ended(_page, calls):
            yield missing.pop(index), made, heard
    except BeltidError as error:  # the workers were lost again and again
        for chain in missing.values():
            yield chain, error, []


def _page(
    source: ConfigSource, folder: Path, force: bool, peek: bool = False
) -> tuple[Summary | BeltidError, Heard]:
    from beltid.stages.results import report_belt

    try:
        page = folder / report_belt.NAME
        return run_in_worker(report_belt.of_chain, source, {}, page, force, peek=peek)
    except BeltidError as error:
        return error, []


def _finished(run: BeltRun, summary: Summary) -> None:
    run.summaries[STEP] = summary
    run.states[STEP] = UP_TO_DATE if summary.up_to_date else DONE


def _failed(run: BeltRun, error: BeltidError) -> None:
    run.states[STEP] = FAILED
    run.troubles[STEP] = (error.exit_status, tuple(error.problems))

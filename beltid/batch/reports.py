"""The reports at the end of a batch: a page for every belt, and one that compares them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from beltid.batch.belts import DONE, FAILED, UP_TO_DATE, BeltRun
from beltid.batch.schedule import Chain
from beltid.errors import BeltidError
from beltid.report.summary import Summary
from beltid.stages.talk import Options

STEP = "report"


def write_reports(chains: Sequence[Chain], folder: Path | None, options: Options) -> None:
    """Write the reports of belts that have results; cases of a sweep have a table instead.

    Parameters
    ----------
    chains : sequence of Chain
        The chains, ended.
    folder : Path or None
        Folder of the results of the batch; None for a part of one, which compares nothing.
    options : Options
        Force and listener.
    """
    from beltid.stages import report_belt

    reported = []
    for chain in chains:
        if chain.run.case or not chain.run.summaries:
            continue
        named = Options(force=options.force, talk=chain.talk)
        try:
            report_belt.keep_curves(chain.source, chain.folder, named)
            summary = report_belt.of_belt(chain.folder, chain.folder / report_belt.NAME, named)
        except BeltidError as error:
            _failed(chain.run, error)
            for line in error.problems:
                chain.talk.error(f"{STEP}: {line}")
            continue
        _finished(chain.run, summary)
        chain.talk.say(f"{STEP}: {chain.run.states[STEP]}, {summary.out}")
        reported.append(chain)
    if len(reported) > 1 and folder is not None:
        page = folder / report_belt.NAME
        try:
            report_belt.of_belts([chain.folder for chain in reported], page, options)
        except BeltidError as error:
            for line in error.problems:
                options.talk.error(f"{STEP}: {line}")
            _failed(reported[-1].run, error)
            return
        options.talk.say(f"{STEP}: the belts side by side: {page}")


def _finished(run: BeltRun, summary: Summary) -> None:
    run.summaries[STEP] = summary
    run.states[STEP] = UP_TO_DATE if summary.up_to_date else DONE


def _failed(run: BeltRun, error: BeltidError) -> None:
    run.states[STEP] = FAILED
    run.troubles[STEP] = (error.exit_status, tuple(error.problems))

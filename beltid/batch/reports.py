"""The reports at the end of a batch: a page for every belt, and one that compares them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from beltid.batch.belts import FAILED
from beltid.batch.schedule import Chain, run_chains
from beltid.batch.steps import Step
from beltid.config import ConfigSource
from beltid.errors import BeltidError
from beltid.report.summary import Summary
from beltid.stages.reporter import Options
from beltid.stages.workers import Workers


def _page(source: ConfigSource, inputs: Mapping[str, Path], out: Path, options: Options) -> Summary:
    from beltid.stages.results import report_belt  # what draws is slow to import

    return report_belt.of_chain(source, inputs, out, options)


REPORT: Final = Step("report", "report", {}, _page, page=True)
"""The last step of a chain, whatever became of the others."""


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
    for chain in wanted:
        chain.waiting = [REPORT]
    # a single page is made here: it would only wait for a worker to import what draws; and what
    # draws is not made for several threads of one process
    elsewhere = len(wanted) > 1 and workers.share_files
    run_chains(wanted, workers if elsewhere else Workers(), force=options.force)
    reported = [chain for chain in wanted if chain.run.states[REPORT.name] != FAILED]
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
                options.reporter.error(f"{REPORT.name}: {line}")
            reported[-1].run.failed(REPORT.name, error)
            return
        options.reporter.report(f"{REPORT.name}: the belts side by side: {page}")

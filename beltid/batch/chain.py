"""The chain of a belt: steps and their inputs; batches of chains, and their report pages."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from beltid.batch.belts import DONE, FAILED, HELD_OUT, UP_TO_DATE, batch_summary
from beltid.batch.folders import alone_in, refuse_links_out
from beltid.batch.schedule import Chain, run_chains
from beltid.batch.steps import Step
from beltid.config import ConfigSource
from beltid.errors import BeltidError
from beltid.notes import Kept, heard_by, log, prefixed
from beltid.report.results import BeltResults
from beltid.report.summary import Summary
from beltid.stages.workers import Workers
from beltid.store.disk import remove_stale

PRESS, STIFFNESS, FRICTION = {"frame": "press"}, {"law": "stiffness"}, {"friction": "friction"}
PUBLISHED, REFINED = {"surface": "surface"}, {"surface": "surface_refined"}
CHAIN: Final = (
    Step("fit-stiffness", "stiffness", PRESS),
    Step("fit-slip", "slip", {"frame": "speedloss"}),
    Step("fit-friction", "friction", {"frame": "rig"}),
    Step("build-surface", "surface", FRICTION),
    Step("refine-surface", "surface_refined", FRICTION | STIFFNESS),
    Step("simulate-rig", "simulated", PUBLISHED | STIFFNESS | FRICTION, spreads=True),
    Step("compare", "compare", FRICTION | {"simulated": "simulated"}),
    Step("simulate-rig refined", "simulated_refined", REFINED | STIFFNESS | FRICTION, spreads=True),
    Step("compare refined", "compare_refined", FRICTION | {"simulated": "simulated_refined"}),
    Step(HELD_OUT, "crossvalidation", FRICTION | STIFFNESS, spreads=True),
    Step("simulate-drive", "drive", REFINED | STIFFNESS | {"slip": "slip"}, section="drive"),
    Step("compare-drive", "compare_drive", {"slip": "slip", "drive": "drive"}, section="drive"),
)
"""Steps of the chain: the published procedure and the surface refined by the inverse solution, both
compared with the bench; prediction of left-out runs by a surface refined from the others; and the
drive of the speed-loss recording, if the config states one."""

OF_RUNNING_BELT: Final = ("fit-stiffness", "fit-slip", "fit-friction", "build-surface")
"""Steps that need no simulated rig; a running belt has none."""
REPORT: Final = "report"


def chain_of(source: ConfigSource) -> tuple[Step, ...]:
    """Return the steps of a chain."""
    if source.config.rig.kind == "running":
        return tuple(step for step in CHAIN if step.name in OF_RUNNING_BELT)
    stated = source.config.model_fields_set
    chain = tuple(step for step in CHAIN if not step.section or step.section in stated)
    if source.config.cross_validate.by == "none":
        chain = tuple(step for step in chain if step.name != HELD_OUT)
    return chain


def run_batch(
    sources: Sequence[ConfigSource],
    folder: Path,
    workers: Workers,
    *,
    force: bool = False,
    report: bool = True,
) -> Summary:
    """Run the chain of every belt and summarize the batch.

    Parameters
    ----------
    sources : sequence of ConfigSource
        One config per belt.
    folder : Path
        Results folder; each belt has a folder in it.
    workers : Workers
        Workers that compute.
    force, report : bool
        Whether to compute results again that are up to date, and to write the reports at the end.

    Raises
    ------
    InputError
        If a link leads out of the results folder.
    """
    refuse_links_out(folder, [source.name for source in sources])
    chains = [Chain(source, folder / source.name, chain_of(source)) for source in sources]
    folders = [chain.folder for chain in chains]
    with alone_in(folders):
        try:
            run_chains(chains, workers, force=force)
            runs = [chain.run for chain in chains]
            if report:
                write_reports(chains, folder, workers, force=force)
        except BaseException:
            workers.stop()
            for belt_folder in folders:  # temporary files of killed workers
                remove_stale(belt_folder)
            raise
        finally:
            workers.close()
    return batch_summary(runs, folder)


def write_reports(
    chains: Sequence[Chain], folder: Path, workers: Workers, *, force: bool = False
) -> None:
    """Write the reports of belts that have results, and the page that compares them."""
    from beltid.stages import report_belt
    from beltid.stages.belt_results import config_of, gather

    wanted = [chain for chain in chains if chain.run.summaries]
    # a single page is drawn here: a worker would first have to import the plotting libraries
    here = len(wanted) == 1 or not workers.share_files
    calls = [(c.source, sorted(c.files), c.folder, c.run.failures, force) for c in wanted]
    pages = _drawn_here(wanted, calls) if here else workers.as_ended(page_in_worker, calls)
    reported = []
    for index, (state, error, lines) in pages:
        chain = wanted[index]
        chain.run.states[REPORT] = state
        with prefixed(chain.prefix):
            for level, text in lines:
                log.log(level, "%s", text)
            if error is not None:
                chain.run.failed(REPORT, error)
                for line in error.problems:
                    log.error("%s: %s", REPORT, line)
                continue
            log.info("%s: %s, %s", REPORT, state, chain.folder / report_belt.NAME)
        reported.append(chain)
    if not reported:
        return
    belts: dict[Path, BeltResults] = {}
    in_batch = {chain.folder for chain in chains}
    for path in report_belt.reported_in(folder):
        if path not in in_batch:
            try:
                belts[path] = gather(path, config_of(path))
            except BeltidError as error:
                log.warning("%s: not compared: %s", path, error.problems[0])
    if len(belts) + len(reported) > 1:
        page = folder / report_belt.NAME
        try:
            for chain in reported:
                config = config_of(chain.folder)
                belts[chain.folder] = gather(chain.folder, config, chain.files, chain.run.failures)
            report_belt.of_belts(dict(sorted(belts.items())), page, force=force)
        except BeltidError as error:
            for line in error.problems:
                log.error("%s: %s", REPORT, line)
            reported[-1].run.failed(REPORT, error)
            return
        log.info("%s: comparison of the belts: %s", REPORT, page)


Lines = list[tuple[int, str]]
Page = tuple[str, BeltidError | None, Lines]
"""State of a page, its error if any, its messages."""


def _drawn_here(chains: Sequence[Chain], calls: Sequence[Any]) -> Iterator[tuple[int, Page]]:
    for index, (chain, call) in enumerate(zip(chains, calls, strict=True)):
        with prefixed(chain.prefix):
            page = _page(*call)
        yield index, page


def page_in_worker(*call: Any) -> Page:
    """Write the page of a belt in a worker, and keep the messages."""
    kept = Kept()
    with heard_by(kept):
        state, error, lines = _page(*call)
    return state, error, [*kept.lines, *lines]


def _page(
    source: ConfigSource, made: list[str], folder: Path, failures: tuple[str, ...], force: bool
) -> Page:
    from beltid.stages import report_belt  # plotting is slow to import

    try:
        summary = report_belt.of_chain(source, made, folder, failures, force=force)
    except BeltidError as error:
        return FAILED, error, []
    lines = [(logging.WARNING, f"{REPORT}: {line}") for line in summary.warnings]
    if summary.verdict:
        lines.append((logging.INFO, f"{REPORT}: {summary.verdict}"))
    return UP_TO_DATE if summary.up_to_date else DONE, None, lines

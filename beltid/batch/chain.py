"""The chain of a belt: steps and their inputs; batches of chains, and their report pages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

from beltid.store.disk import remove_stale
from beltid.batch.belts import FAILED, HELD_OUT, batch_summary
from beltid.batch.folders import alone_in, refuse_links_out
from beltid.batch.schedule import Chain, run_chains
from beltid.batch.steps import Step
from beltid.config import ConfigSource
from beltid.errors import BeltidError
from beltid.report.results import BeltResults
from beltid.report.summary import Summary
from beltid.stages.drive import compare_drive, simulate_drive
from beltid.stages.identification import build_surface, fit_friction, fit_slip, fit_stiffness
from beltid.stages.reporter import Options
from beltid.stages.simulation import compare, refine_surface, simulate_rig
from beltid.stages.workers import Workers


def _same(*roles: str) -> dict[str, str]:
    """Map inputs whose names equal their roles."""
    return {role: role for role in roles}


CHAIN: Final = (
    Step("fit-stiffness", "stiffness", _same("press"), fit_stiffness.run),
    Step("fit-slip", "slip", _same("speedloss"), fit_slip.run),
    Step("fit-friction", "friction", _same("rig"), fit_friction.run),
    Step("build-surface", "surface", _same("friction"), build_surface.run),
    Step("refine-surface", "surface_refined", _same("friction", "stiffness"), refine_surface.run),
    Step(
        "simulate-rig",
        "simulated",
        _same("surface", "stiffness", "friction"),
        simulate_rig.run,
        spreads=True,
    ),
    Step("compare", "compare", _same("friction", "simulated"), compare.run),
    Step(
        "simulate-rig refined",
        "simulated_refined",
        {"surface": "surface_refined", "stiffness": "stiffness", "friction": "friction"},
        simulate_rig.run,
        spreads=True,
    ),
    Step(
        "compare refined",
        "compare_refined",
        {"friction": "friction", "simulated": "simulated_refined"},
        compare.run,
    ),
    Step(
        HELD_OUT,
        "compare_hold_out",
        _same("friction", "stiffness"),
        compare.run,
        spreads=True,
    ),
    Step(
        "simulate-drive",
        "drive",
        {"surface": "surface_refined", "stiffness": "stiffness", "slip": "slip"},
        simulate_drive.run,
        section="drive",
    ),
    Step(
        "compare-drive",
        "compare_drive",
        _same("slip", "drive"),
        compare_drive.run,
        section="drive",
    ),
)
"""Steps of the chain: the published procedure and the surface refined by the inverse solution, both
compared with the bench; prediction of left-out runs by a surface refined from the others; and the
drive of the speed-loss recording, if the config states one."""

OF_RUNNING_BELT: Final = ("fit-stiffness", "fit-slip", "fit-friction", "build-surface")
"""Steps that need no simulated rig; a running belt has none."""


def _page(
    source: ConfigSource,
    inputs: Mapping[str, Path],
    out: Path,
    options: Options,
    failures: tuple[str, ...] = (),
) -> Summary:
    from beltid.stages.results import report_belt  # plotting is slow to import

    return report_belt.of_chain(source, inputs, out, options, failures)


REPORT: Final = Step("report", "report", {}, _page, page=True)
"""Last step of a chain, which runs even if others failed."""


@dataclass(frozen=True, slots=True)
class BatchOptions(Options):
    """Options of a batch.

    Attributes
    ----------
    report : bool
        Whether to write the reports at the end.
    """

    report: bool = True


def chain_of(source: ConfigSource) -> tuple[Step, ...]:
    """Return the steps of a chain."""
    if source.config.rig.kind == "running":
        return tuple(step for step in CHAIN if step.name in OF_RUNNING_BELT)
    stated = source.config.model_fields_set
    chain = tuple(step for step in CHAIN if not step.section or step.section in stated)
    if source.config.compare.hold_out == "none":
        chain = tuple(step for step in chain if step.name != HELD_OUT)
    return chain


def run_batch(sources: Sequence[ConfigSource], folder: Path, options: BatchOptions) -> Summary:
    """Run the chain of every belt and summarize the batch.

    Parameters
    ----------
    sources : sequence of ConfigSource
        One config per belt.
    folder : Path
        Results folder; each belt has a folder in it.
    options : BatchOptions
        Force, reporter, workers.

    Raises
    ------
    InputError
        If a link leads out of the results folder.
    """
    refuse_links_out(folder, [source.name for source in sources])
    chains = []
    for source in sources:
        chain = chain_of(source)
        chains.append(Chain(source, folder / source.name, chain, options.reporter))
    folders = [chain.folder for chain in chains]
    with alone_in(folders, options.reporter):
        workers = options.workers
        try:
            run_chains(chains, workers, force=options.force)
            runs = [chain.run for chain in chains]
            if options.report:
                write_reports(chains, folder, options, workers)
        except BaseException:
            workers.stop()
            for belt_folder in folders:  # temporary files of killed workers
                remove_stale(belt_folder)
            raise
        finally:
            workers.close()
    return batch_summary(runs, folder)


def write_reports(
    chains: Sequence[Chain], folder: Path, options: Options, workers: Workers
) -> None:
    """Write the reports of belts that have results.

    Parameters
    ----------
    chains : sequence of Chain
        The finished chains.
    folder : Path
        Results folder of the batch.
    options : Options
        Force and reporter.
    workers : Workers
        Workers that draw the pages of several belts.
    """
    from beltid.stages.results import report_belt
    from beltid.stages.results.belt_results import config_of, gather

    wanted = [chain for chain in chains if chain.run.summaries]
    for chain in wanted:
        chain.waiting = [replace(REPORT, run=partial(_page, failures=chain.run.failures))]
    # a single page is drawn here: a worker would first have to import the plotting libraries,
    # which are not safe for several threads of one process
    in_workers = len(wanted) > 1 and workers.share_files
    run_chains(wanted, workers if in_workers else Workers(), force=options.force)
    reported = [chain for chain in wanted if chain.run.states[REPORT.name] != FAILED]
    if not reported:
        return
    belts: dict[Path, BeltResults] = {}
    in_batch = {chain.folder for chain in chains}
    for path in report_belt.reported_in(folder):
        if path not in in_batch:
            try:
                belts[path] = gather(path, config_of(path))
            except BeltidError as error:
                options.reporter.warn(f"{path}: not compared: {error.problems[0]}")
    if len(belts) + len(reported) > 1:
        page = folder / report_belt.NAME
        try:
            for chain in reported:
                config = config_of(chain.folder)
                belts[chain.folder] = gather(chain.folder, config, chain.files, chain.run.failures)
            report_belt.of_belts(dict(sorted(belts.items())), page, options)
        except BeltidError as error:
            for line in error.problems:
                options.reporter.error(f"{REPORT.name}: {line}")
            reported[-1].run.failed(REPORT.name, error)
            return
        options.reporter.report(f"{REPORT.name}: comparison of the belts: {page}")

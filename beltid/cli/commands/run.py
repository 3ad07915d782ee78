"""Run the whole chain for one or several belts."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from beltid.cli.execute import finish
from beltid.cli.program import Common, command

if TYPE_CHECKING:
    from beltid.config import ConfigSource
    from beltid.report.summary import Summary
    from beltid.stages.reporter import Options
    from beltid.stages.workers import Workers


SCHEDULER_VARIABLE: Final = "DASK_SCHEDULER_ADDRESS"
Configs = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="CONFIG",
        help="Configs, one per belt. Each names its recordings under data: press, rig and "
        "speedloss; without press or rig only part of the chain runs. Default: the config of "
        "--config, else the one that the environment variable BELTID_CONFIG names.",
    ),
]
Jobs = Annotated[
    int | None,
    typer.Option(
        "--jobs", "-j", min=1, help="Worker processes of all belts. Default: one per core."
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Scheduler of a Dask cluster that runs the simulations, such as tcp://host:8786. "
        "Default: the one that the environment variable DASK_SCHEDULER_ADDRESS names, unless "
        "--jobs is given; else this machine.",
    ),
]
DryRun = Annotated[
    bool, typer.Option("--dry-run", "-n", help="List what would be done, and do nothing.")
]
NoReport = Annotated[bool, typer.Option("--no-report", help="Write no report.html at the end.")]
RunsDir = typer.Option(
    "--out",
    "-o",
    metavar="FOLDER",
    help="Folder of the results, one folder per belt in it. Default: runs",
)


@command("run", out=RunsDir)
def run(
    configs: Configs = None,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    dry_run: DryRun = False,
    no_report: NoReport = False,
    *,
    common: Common,
) -> None:
    """Run the whole chain for one or several belts: from the recordings to the report.

    Identifies stiffness, sliding speeds and friction, builds the published and the refined
    surface, simulates the rig with both, and compares. Results go to runs/<belt>/. Results that
    are up to date are kept, so a second run does nothing. A belt that fails does not stop the
    others. The report is runs/<belt>/report.html, for several belts also runs/report.html.

    Example: beltid run configs/4pk.yaml configs/5pk.yaml
    """
    folder = common.out or Path("runs")

    def work(common_options: Options) -> Summary:
        reporter = common_options.reporter
        from beltid.batch.sources import config_sources

        address = scheduler_address(scheduler, jobs)
        if address and scheduler is None:
            reporter.report(f"cluster {address}, named by ${SCHEDULER_VARIABLE}")
        sources = config_sources(configs or [], common.config)
        if dry_run:
            from beltid.batch.chain import BatchOptions
            from beltid.batch.plan import plan_batch

            dry_options = BatchOptions(force=common.force)
            return plan_batch(sources, folder, dry_options)
        first_time = any(not (folder / source.name).is_dir() for source in sources)
        has_work = first_time or common.force
        if has_work and not address:
            from beltid.rig.compiler import COMPILING, compile_ahead

            if compile_ahead(packages_with_kernels(sources)):
                reporter.report(COMPILING)
        workers = workers_of(address, jobs, at_once=has_work)
        from beltid.batch.chain import BatchOptions, run_batch

        reporter.detail(f"workers: {workers.about}")
        options = BatchOptions(
            force=common.force,
            reporter=reporter,
            workers=workers,
            report=not no_report,
        )
        return run_batch(sources, folder, options)

    kept = f"finished results are in {folder}; the same command continues from there"
    finish(work, common, kept=kept)


def packages_with_kernels(sources: Sequence[ConfigSource]) -> list[str]:
    """Return the packages whose kernels the belts need if everything is recomputed."""
    configs = [source.config for source in sources]
    simulated = [config for config in configs if {"press", "rig"} <= set(config.data.files)]
    driven = [
        config
        for config in simulated
        if "drive" in config.model_fields_set and "speedloss" in config.data.files
    ]
    return [*(["rig"] if simulated else []), *(["drive"] if driven else [])]


def scheduler_address(stated: str | None, jobs: int | None) -> str:
    """Return the address of the Dask scheduler, "" for this machine."""
    from beltid.errors import InputError

    if stated is None:
        return "" if jobs is not None else os.environ.get(SCHEDULER_VARIABLE, "")
    if jobs is not None:
        raise InputError("--jobs applies to this machine, --scheduler to a cluster: give only one")
    return stated


def workers_of(address: str, jobs: int | None, *, at_once: bool) -> Workers:
    """Create the workers; with `at_once`, start those of this machine immediately."""
    if address:
        from beltid.batch.cluster import ClusterWorkers

        return ClusterWorkers(address)
    from beltid.batch.local import local_workers

    workers = local_workers(jobs)
    if at_once:
        workers.prepare()
    return workers

"""Run the whole chain for one or several belts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from beltid.cli.execute import finish
from beltid.cli.inputs import Bootstrap, Seed
from beltid.cli.program import Common, command

if TYPE_CHECKING:
    from beltid.config import ConfigSource
    from beltid.report.summary import Summary
    from beltid.stages.reporter import Options
    from beltid.stages.workers import Workers


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
FailFast = Annotated[
    bool, typer.Option("--fail-fast", help="Stop all belts when the first one fails.")
]
PartOf = Annotated[
    str | None,
    typer.Option(
        metavar="I/N",
        help="Run only every N-th belt or case from the I-th on, such as 2/4, for the jobs of an "
        "array. A last run without it finds everything up to date and writes the summary.",
    ),
]
Executor = Annotated[
    str,
    typer.Option(
        metavar="local|dask",
        help="Where simulations run: on this machine, or on an existing Dask cluster.",
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Scheduler of the cluster, such as tcp://host:8786. Default: the one that the "
        "environment variable DASK_SCHEDULER_ADDRESS names.",
    ),
]
SchedulerFile = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="File in which the scheduler wrote its address."),
]
DryRun = Annotated[
    bool, typer.Option("--dry-run", "-n", help="List what would be done, and do nothing.")
]
NoReport = Annotated[bool, typer.Option("--no-report", help="Write no report.html at the end.")]
RunsDir = typer.Option(
    "--out",
    "-o",
    "--runs-dir",
    metavar="FOLDER",
    help="Folder of the results, one folder per belt in it. Default: runs",
)


@command("run", out=RunsDir)
def run(
    configs: Configs = None,
    bootstrap: Bootstrap = 0,
    seed: Seed = 0,
    jobs: Jobs = None,
    fail_fast: FailFast = False,
    shard: PartOf = None,
    executor: Executor = "local",
    scheduler: Scheduler = None,
    scheduler_file: SchedulerFile = None,
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

    A config with a section sweep, such as sweep: {belt.bending_stiffness_N_m2: [0.01, 0.02]}, is
    run for all combinations: runs/<belt>/<case>/, with one table, runs/<belt>/sweep.csv.

    Example: beltid run configs/4pk.yaml configs/5pk.yaml
    """
    folder = common.out or Path("runs")
    where = Where(executor, scheduler, scheduler_file, jobs)

    def work(common_options: Options) -> Summary:
        reporter = common_options.reporter
        from beltid.batch.sources import Shard, config_sources

        part = None if shard is None else Shard.parse(shard)
        where.check()
        sources = config_sources(configs or [], common.config)
        chosen = sources if part is None else part.of(sources)
        if dry_run:
            from beltid.batch.chain import BatchOptions
            from beltid.batch.plan import plan_batch

            dry_options = BatchOptions(force=common.force, bootstrap=bootstrap, seed=seed)
            return plan_batch(chosen, folder, dry_options)
        first_time = any(not (folder / source.name).is_dir() for source in chosen)
        has_work = first_time or common.force
        if has_work and executor == "local":
            from beltid.rigsim.kernel_cache import COMPILING, compile_ahead

            if compile_ahead(packages_with_kernels(chosen)):
                reporter.report(COMPILING)
        workers = where.workers(at_once=has_work)
        from beltid.batch.chain import BatchOptions, run_batch

        reporter.detail(f"workers: {workers.about}")
        if part is not None:
            reporter.report(f"part {part.number} of {part.count}: {len(chosen)} of {len(sources)}")
        options = BatchOptions(
            force=common.force,
            reporter=reporter,
            workers=workers,
            fail_fast=fail_fast,
            bootstrap=bootstrap,
            seed=seed,
            whole=part is None,
            report=not no_report,
        )
        return run_batch(chosen, folder, options)

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
    return [*(["rigsim"] if simulated else []), *(["drive"] if driven else [])]


@dataclass(frozen=True, slots=True)
class Where:
    """Options that state where the work is done."""

    executor: str
    scheduler: str | None
    scheduler_file: Path | None
    jobs: int | None

    def check(self) -> None:
        """Raise an InputError if the options contradict each other."""
        from beltid.errors import InputError

        problems = []
        if self.executor not in ("local", "dask"):
            problems.append(f"--executor = {self.executor}, must be local or dask")
        cluster = {"--scheduler": self.scheduler, "--scheduler-file": self.scheduler_file}
        given = [name for name, value in cluster.items() if value is not None]
        if self.executor == "local":
            problems += [f"{name}: needs --executor dask" for name in given]
        elif self.jobs is not None:
            problems.append("--jobs: applies to this machine only; a cluster sets its own workers")
        if len(given) > 1:
            problems.append("--scheduler, --scheduler-file: only one of them can be given")
        if problems:
            raise InputError(problems)

    def workers(self, *, at_once: bool) -> Workers:
        """Create the workers; with `at_once`, start those of this machine immediately."""
        if self.executor == "dask":
            from beltid.batch.cluster import ClusterWorkers

            return ClusterWorkers(self.scheduler, self.scheduler_file)
        from beltid.batch.local import local_workers

        workers = local_workers(self.jobs)
        if at_once:
            workers.prepare()
        return workers

"""The commands that are no steps: parse arguments, call, print, exit. No science."""

from __future__ import annotations

import os
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from beltid.cli.execute import NOTHING, finish, print_text
from beltid.cli.program import FIRST, SETTINGS, Common, app, command
from beltid.cli.steps import FILES

if TYPE_CHECKING:
    from beltid.report.summary import Summary

SCHEDULER_VARIABLE: Final = "DASK_SCHEDULER_ADDRESS"
TARGET_NAMES: Final = (
    *("json", "exudyn", "python", "c", "fortran"),
    *("adams", "modelica", "matlab", "csv", "all"),
)


def _out(metavar: str, text: str) -> typer.models.OptionInfo:
    option: typer.models.OptionInfo = typer.Option("--out", "-o", metavar=metavar, help=text)
    return option


@command("inspect", short=FIRST["inspect"])
def inspect(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE", help=f"Recordings of any bench ({FILES})."),
    ],
    kind: Annotated[
        str | None,
        typer.Option(
            metavar="press|rig|speedloss",
            help="Kind of recording. Default: inferred from the names of the channels.",
        ),
    ] = None,
    *,
    common: Common,
) -> None:
    """Show how a file is read: format, channels, units, rates, runs, gaps.

    Prints for every channel the column that it becomes, or may become, the runs, and a section for
    the config that states all this. If something is ambiguous, it prints the config
    lines that resolve it, and the status is 2. Nothing is written.

    Example: beltid inspect export.txt
    """
    from beltid.config import find_config
    from beltid.config.layout import KINDS
    from beltid.errors import InputError
    from beltid.notes import log
    from beltid.stages import inspect_file

    def work() -> Summary:
        if kind is not None and kind not in KINDS:
            raise InputError(f"--kind {kind}, must be " + ", ".join(KINDS))
        source = find_config(files[0], common.config)
        log.info("config: %s", source.origin)
        return inspect_file.run(source, files, kind)

    finish(work, common)


@command(
    "init",
    short=FIRST["init"],
    out=_out("FILE", "The file. Default: <NAME>.yaml in the current folder."),
)
def init(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the belt, such as 6pk.")],
    files: Annotated[
        list[Path] | None,
        typer.Argument(metavar="FILE", help=f"Recordings of the belt, one per bench ({FILES})."),
    ] = None,
    *,
    common: Common,
) -> None:
    """Write the config of a new belt, with the meaning, unit and range of every key.

    What the recordings state is written: which bench each is of; contact arcs, tensions and speeds
    of the rig. Type and ribs follow from a name such as 6pk. All other keys are comments with
    their defaults. An existing file is overwritten only with --force.

    Example: beltid init 6pk press.csv rig.csv
    """
    from beltid.stages import new_config

    finish(
        lambda: new_config.run(name, files or [], common.out, force=common.force),
        common,
        kept="no config was written",
    )


@command(
    "run",
    short=FIRST["run"],
    out=_out("FOLDER", "Folder of the results, one folder per belt in it. Default: runs"),
)
def run(
    configs: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="CONFIG",
            help="Configs, one per belt. Each names its recordings under data: press, rig and "
            "speedloss; without press or rig only part of the chain runs. Default: the config of "
            "--config, else the one that the environment variable BELTID_CONFIG names.",
        ),
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs", "-j", min=1, help="Worker processes of all belts. Default: one per core."
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Scheduler of a Dask cluster that runs the simulations, such as tcp://host:8786. "
            "Default: the one that the environment variable DASK_SCHEDULER_ADDRESS names, unless "
            "--jobs is given; else this machine.",
        ),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", "-n", help="List what would be done, and do nothing.")
    ] = False,
    no_report: Annotated[
        bool, typer.Option("--no-report", help="Write no report.html at the end.")
    ] = False,
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

    def work() -> Summary:
        from beltid.batch.sources import config_sources
        from beltid.notes import log

        address = _scheduler_address(scheduler, jobs)
        if address and scheduler is None:
            log.info("cluster %s, named by $%s", address, SCHEDULER_VARIABLE)
        sources = config_sources(configs or [], common.config)
        if dry_run:
            from beltid.batch.run import plan_batch

            return plan_batch(sources, folder, force=common.force)
        from beltid.batch.run import run_batch

        return run_batch(
            sources,
            folder,
            jobs=jobs,
            scheduler=address,
            force=common.force,
            report=not no_report,
        )

    kept = f"finished results are in {folder}; the same command continues from there"
    finish(work, common, kept=kept)


def _scheduler_address(stated: str | None, jobs: int | None) -> str:
    """Return the address of the Dask scheduler, "" for this machine."""
    from beltid.errors import InputError

    if stated is None:
        return "" if jobs is not None else os.environ.get(SCHEDULER_VARIABLE, "")
    if jobs is not None:
        raise InputError("--jobs applies to this machine, --scheduler to a cluster: give only one")
    return stated


@command(
    "report",
    short=FIRST["report"],
    out=_out(
        "FILE",
        "Page to write. Default: report.html in the folder of a belt, for several belts in the "
        "folder above.",
    ),
)
def report(
    folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="FOLDER", help="Folders of the results of `beltid run`, one per belt."
        ),
    ],
    *,
    common: Common,
) -> None:
    """Write the report of a belt, one page: verdict, figures, tables, provenance.

    The page needs no network and no other file. It lists what is missing in the folder. `beltid
    run` writes it at the end. For several folders: a report in each of them, and one page in the
    folder above that compares the belts.

    The curves of the press and the runs over time need the recordings once: `beltid run` stores
    what the figures need in the folder. Otherwise name the config of the belt with --config.

    Example: beltid report runs/4pk runs/5pk
    """
    from beltid.stages import report_belt

    finish(
        lambda: report_belt.run(folders, common.out, common.config, force=common.force),
        common,
        kept="finished reports are kept",
    )


@command(
    "show",
    short=FIRST["show"],
    out=_out("FILE", "Table to write (.csv), or figure (.svg, .png, .pdf). Default: the terminal."),
)
def show(
    artifact: Annotated[
        Path,
        typer.Argument(
            metavar="ARTIFACT", help="A .parquet file that beltid wrote, or a law file (.json)."
        ),
    ],
    figure: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Which figure --out writes, if there are several."),
    ] = None,
    *,
    common: Common,
) -> None:
    """Show any artifact: what it says, its kind, origin, range of validity, hashes.

    With --out it writes the whole table as CSV, for a spreadsheet, or a figure, for a paper or a
    slide. --verbose prints every row, the settings, and what was set aside and why.

    Example: beltid show runs/5pk/friction.parquet -o friction.csv

    Example: beltid show runs/5pk/surface_refined.parquet -o map.pdf --figure map-surface_refined
    """
    from beltid.stages import show as stage

    finish(
        lambda: stage.run(artifact, common.out, figure, force=common.force), common, kept=NOTHING
    )


class SurfaceChoice(StrEnum):
    """Friction surface to export."""

    refined = "refined"
    published = "published"


def _complete(incomplete: str) -> list[str]:
    return [name for name in TARGET_NAMES if name.startswith(incomplete)]


@command(
    "export",
    short=FIRST["export"],
    out=_out("FOLDER", "Folder of the files. Default: export/ in the folder of the law."),
)
def export(
    target: Annotated[
        str | None,
        typer.Argument(
            metavar="TARGET",
            help=f"{', '.join(TARGET_NAMES[:-1])}, or all. Without it, the targets are listed.",
            autocompletion=_complete,
        ),
    ] = None,
    source: Annotated[
        Path | None,
        typer.Argument(
            metavar="LAW",
            help="Results of a belt (a folder with stiffness.parquet and a surface), or a law "
            "file <belt>.beltlaw.json.",
        ),
    ] = None,
    surface: Annotated[
        SurfaceChoice | None,
        typer.Option(help="Friction surface. Default: the refined one, if it exists."),
    ] = None,
    normal_force: Annotated[
        float | None,
        typer.Option(
            metavar="N/m",
            help="Line force at which a linear stiffness and a constant mu are exact, for "
            "targets that support no more. Default: the middle of the range of mu.",
        ),
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(
            metavar="m/s",
            help="Sliding speed at which a constant mu is exact. Default: the middle.",
        ),
    ] = None,
    *,
    common: Common,
) -> None:
    """Write the contact law of a belt for multibody programs.

    Normal stiffness, friction over normal force and sliding speed, range of validity, origin. What
    a program cannot represent is replaced by an approximation; the file states its deviation from
    the law over the range of mu. An existing file with different content is replaced only with
    --force.

    \b
    Example: beltid export exudyn runs/5pk
             beltid export exudyn runs/5pk --normal-force 5000 --speed 0.02
             beltid export all runs/5pk -o laws/5pk
    """  # noqa: D301
    from beltid.stages import export_law

    finish(
        lambda: export_law.run(
            target,
            source,
            common.config,
            common.out,
            force=common.force,
            surface=surface.value if surface else None,
            normal_force_N_m=normal_force,
            slip_speed_m_s=speed,
        ),
        common,
        kept="files already written are complete",
    )


config_app = typer.Typer(
    name="config",
    help="Show the values that a config states or that are in effect, or check configs.",
    short_help=FIRST["config"],
    rich_markup_mode=None,
    no_args_is_help=True,
    context_settings=SETTINGS,
)
app.add_typer(config_app)


@command("show", of=config_app, short="the values that are stated, or all in effect")
def config_show(
    file: Annotated[
        Path | None,
        typer.Argument(
            metavar="FILE", help="Input whose config is searched for, as in every command."
        ),
    ] = None,
    complete: Annotated[
        bool, typer.Option("--all", help="Show all values in effect, defaults too.")
    ] = False,
    *,
    common: Common,
) -> None:
    """Print the values that the config states, as YAML with the range of every key.

    The config is that of --config, else the one that a command would find for FILE, else the
    built-in 5PK rig. With --all, the defaults of all other keys too.

    Example: beltid config show rig.csv --all
    """
    from beltid.config import config_text, find_config
    from beltid.notes import log
    from beltid.stages.about import config_values

    if common.json:
        finish(lambda: config_values(find_config(file, common.config), complete=complete), common)

    def text() -> str:
        source = find_config(file, common.config)
        log.info("config: %s", source.origin)
        return config_text(source.config, complete=complete)

    print_text(text, common, (".yaml", ".yml"))


@command("check", of=config_app, short="all problems in configs")
def config_check(
    configs: Annotated[list[Path], typer.Argument(metavar="CONFIG", help="Configs to check.")],
    *,
    common: Common,
) -> None:
    """Check configs as run does: keys, values, recordings that are missing or empty.

    Reports all problems at once, with file, line and column. Exit status 2 if there are any.
    A recording that cannot be read as the config states is a warning.

    Example: beltid config check configs/5pk.yaml
    """
    from beltid.stages.about import check_configs

    finish(lambda: check_configs(configs), common)

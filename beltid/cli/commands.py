"""The commands that are no steps: each returns what one function of the rooms below says.

Their docstrings are their help, with the meaning of each argument and option.
"""

import os
from pathlib import Path
from typing import Literal

from beltid import stages
from beltid.cli.execute import Common
from beltid.cli.program import FIRST, app, command, config_of, plain_typer
from beltid.errors import InputError
from beltid.notes import log
from beltid.report.summary import Summary


@command("inspect", kept=None)
def inspect(
    files: list[Path], *, kind: Literal["press", "rig", "speedloss"] | None = None, common: Common
) -> Summary:
    """Show how a file is read: format, channels, units, rates, runs, gaps.

    Prints for every channel the column that it becomes, the runs, and a section for the config that
    states all this. If something is ambiguous, the status is 2. Nothing is written.

    Parameters
    ----------
    files : FILE
        Recordings of any bench (CSV, Zwick, LabVIEW .lvm, TDMS, MDF, MATLAB, Excel, Parquet; or a
        folder, a pattern in quotes or a zip file with a file per run).
    kind : {"press", "rig", "speedloss"}
        Kind of recording. Default: inferred from the names of the channels.

    Examples
    --------
    beltid inspect export.txt
    """
    return stages.inspect_file.run(config_of(files[0], common), files, kind)


@command(
    "init",
    out="FILE: The file. Default: <NAME>.yaml in the current folder.",
    kept="no config was written",
)
def init(name: str, files: list[Path] | None = None, *, common: Common) -> Summary:
    """Write the config of a new belt, with the meaning, unit and range of every key.

    What the recordings state is written: which bench each is of; contact arcs, tensions and speeds
    of the rig. Type and ribs follow from a name such as 6pk. All other keys are comments.

    Parameters
    ----------
    name : NAME
        Name of the belt, such as 6pk.
    files : FILE
        Recordings of the belt, one per bench, of any format that `beltid inspect` reads.

    Examples
    --------
    beltid init 6pk press.csv rig.csv
    """
    return stages.inspect_file.new_config(name, files or [], common.out, force=common.force)


@command(
    "run",
    out="FOLDER: Folder of the results, one folder per belt in it. Default: runs",
    kept="finished results are in {out}; the same command continues from there",
)
def run(
    configs: list[Path] | None = None,
    *,
    jobs: int | None = None,
    scheduler: str | None = None,
    dry_run: bool = False,
    no_report: bool = False,
    common: Common,
) -> Summary:
    """Run the whole chain for one or several belts: from the recordings to the report.

    Results go to runs/<belt>/; those that are up to date are kept, so a second run does nothing. A
    belt that fails does not stop the others. The report is runs/<belt>/report.html, for several
    belts also runs/report.html.

    Parameters
    ----------
    configs : CONFIG
        Configs, one per belt. Each names its recordings under data: press, rig and speedloss;
        without press or rig only part of the chain runs. Default: the config of --config, else the
        one that the environment variable BELTID_CONFIG names.
    jobs : int
        Worker processes of all belts. Default: one per core.
    scheduler : ADDRESS
        Scheduler of a Dask cluster that runs the simulations, such as tcp://host:8786. Default: the
        one that the environment variable DASK_SCHEDULER_ADDRESS names, unless --jobs is given; else
        this machine.
    dry_run : bool
        List what would be done, and do nothing.
    no_report : bool
        Write no report.html at the end.

    Examples
    --------
    beltid run configs/4pk.yaml configs/5pk.yaml
    """
    from beltid.batch.run import config_sources, plan_batch, run_batch

    if scheduler is not None and jobs is not None:
        raise InputError("--jobs is for this machine, --scheduler for a cluster: give only one")
    named = os.environ.get("DASK_SCHEDULER_ADDRESS", "")
    if named and scheduler is None and jobs is None:
        scheduler = named
        log.info("cluster %s, named by $DASK_SCHEDULER_ADDRESS", scheduler)
    sources, folder = config_sources(configs or [], common.config), common.out or Path("runs")
    if dry_run:
        return plan_batch(sources, folder, force=common.force)
    return run_batch(
        sources,
        folder,
        jobs=jobs,
        scheduler=scheduler or "",
        force=common.force,
        report=not no_report,
    )


@command(
    "report",
    out="FILE: Page to write. Default: report.html in the folder of a belt, for several belts in "
    "the folder above.",
    kept="finished reports are kept",
)
def report(folders: list[Path], *, common: Common) -> Summary:
    """Write the report of a belt, one page: verdict, figures, tables, provenance.

    The page needs no network and no other file; `beltid run` writes it at the end. For several
    folders: a report in each of them, and one page in the folder above that compares the belts. The
    curves of recordings are those that `beltid run` stored, else name the config with --config.

    Parameters
    ----------
    folders : FOLDER
        Folders of the results of `beltid run`, one per belt.

    Examples
    --------
    beltid report runs/4pk runs/5pk
    """
    return stages.report_belt.run(folders, common.out, common.config, force=common.force)


@command(
    "show",
    out="FILE: Table to write (.csv), or figure (.svg, .png, .pdf). Default: the terminal.",
)
def show(artifact: Path, *, figure: str | None = None, common: Common) -> Summary:
    """Show any artifact: what it says, its kind, origin, range of validity, hashes.

    With --out it writes the whole table as CSV, for a spreadsheet, or a figure, for a paper or a
    slide. --verbose prints every row, the settings, and what was set aside and why.

    Parameters
    ----------
    artifact : ARTIFACT
        A .parquet file that beltid wrote.
    figure : NAME
        Which figure --out writes, if there are several.

    Examples
    --------
    beltid show runs/5pk/friction.parquet -o friction.csv
    beltid show runs/5pk/surface_refined.parquet -o map.pdf --figure map-surface_refined
    """
    return stages.about.shown(artifact, common.out, figure, force=common.force)


@command(
    "export",
    out="FOLDER: Folder of the files. Default: export/ in the folder of the law.",
    kept="files already written are complete",
)
def export(
    target: str | None = None,
    source: Path | None = None,
    *,
    surface: Literal["refined", "published"] | None = None,
    normal_force: float | None = None,
    speed: float | None = None,
    common: Common,
) -> Summary:
    """Write the contact law of a belt for multibody programs.

    Normal stiffness, friction over normal force and sliding speed, range of validity, origin. What
    a program cannot represent is replaced by an approximation; the file states its deviation from
    the law over the range of mu.

    Parameters
    ----------
    target : TARGET
        json, exudyn, python, c, fortran, adams, modelica, matlab, csv, or all. Without it, the
        targets are listed.
    source : LAW
        Results of a belt (a folder with stiffness.parquet and a surface), or a law file
        <belt>.beltlaw.json.
    surface : {"refined", "published"}
        Friction surface. Default: the refined one, if it exists.
    normal_force : N/m
        Line force at which a linear stiffness and a constant mu are exact, for targets that support
        no more. Default: the middle of the range of mu.
    speed : m/s
        Sliding speed at which a constant mu is exact. Default: the middle.

    Examples
    --------
    beltid export exudyn runs/5pk
    beltid export exudyn runs/5pk --normal-force 5000 --speed 0.02
    beltid export all runs/5pk -o laws/5pk
    """
    asked = target, source, common.config, common.out, surface, (normal_force, speed)
    return stages.export_law.run(*asked, force=common.force)


config_app = plain_typer(
    name="config",
    help="Show the values that a config states or that are in effect, or check configs.",
    short_help=FIRST["config"],
)
app.add_typer(config_app)


@command("show", of=config_app, short="the values that are stated, or all in effect", kept=None)
def config_show(file: Path | None = None, *, all: bool = False, common: Common) -> Summary | str:
    """Print the values that the config states, as YAML with the range of every key.

    The config is that of --config, else the one that a command would find for FILE, else the
    built-in 5PK rig. With --all, the defaults of all other keys too.

    Parameters
    ----------
    file : FILE
        Input whose config is searched for, as in every command.
    all : bool
        Show all values in effect, defaults too.

    Examples
    --------
    beltid config show rig.csv --all
    """
    from beltid.config import config_text

    if common.json:
        return stages.about.config_values(config_of(file, common), complete=all)
    return config_text(config_of(file, common).config, complete=all)


@command("check", of=config_app, short="all problems in configs", kept=None)
def config_check(configs: list[Path], *, common: Common) -> Summary:
    """Check configs as run does: keys, values, recordings that are missing or empty.

    Reports all problems at once, with file, line and column. Exit status 2 if there are any.

    Parameters
    ----------
    configs : CONFIG
        Configs to check.

    Examples
    --------
    beltid config check configs/5pk.yaml
    """
    return stages.about.check_configs(configs)

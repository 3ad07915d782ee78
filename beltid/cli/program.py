"""The program: the list of its commands, the options of every command, the entry point."""

from __future__ import annotations

import functools
import inspect
import sys
from collections.abc import Callable
from dataclasses import dataclass, fields
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Final, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_group

from beltid._version import __version__
from beltid.cli.process import (
    hear_signals,
    one_thread_each,
    prepare_streams,
)
from beltid.errors import EXIT_INPUT, printable

FOLDER_GONE: Final = (
    "the working folder no longer exists: "
    "change to another one, or name all files by absolute paths"
)
MAIN_HELP = """\
Identify the contact parameters between a V-ribbed belt and a pulley.

From bench recordings to a friction law that is proven on a simulated copy of the bench
(method of Cepon, Manin and Boltezar, 2010):

\b
  press.csv ------ fit-stiffness --> stiffness.parquet ----------------+
  speedloss.csv -- fit-slip -------> slip.parquet                      |
  rig.csv -------- fit-friction ---> friction.parquet                  |
  friction.parquet build-surface --> surface.parquet                   |
  friction.parquet ----------------- refine-surface, with stiffness <--+
                                     --> surface_refined.parquet       v
  surface.parquet or surface_refined.parquet, stiffness.parquet
                   simulate-rig ---> simulated.parquet
  friction.parquet, simulated.parquet
                   compare --------> compare.parquet
  surface_refined.parquet, stiffness.parquet, slip.parquet
                   simulate-drive -> drive.parquet, compare-drive
  surface_refined.parquet, stiffness.parquet, or no data yet
                   plan -----------> plan.csv: the next runs of the rig

`beltid run CONFIG.yaml` runs the whole chain, and the drive if the config has one. Results go to
stdout, messages and progress to stderr.
"""

EXIT_STATUSES = """\
\b
Exit status:
  0    done
  1    a bug in beltid, with a traceback
  2    wrong call, config or input; the message says what to correct
  3    numerical failure: no convergence, or no admissible law
  4    compare, compare-drive: the difference is out of tolerance
  5    run: some of several belts failed
  130  interrupted (Ctrl-C)
  143  terminated by the system (129: terminal closed)
"""


COMMANDS: Final = {
    "init": ("init", "write a commented config for a new belt"),
    "inspect": ("inspect", "FILE -> how it is read, and a config section"),
    "fit-stiffness": ("fit", "PRESS.csv -> stiffness.parquet: the normal contact law"),
    "fit-slip": ("fit", "SPEEDLOSS.csv -> slip.parquet: sliding speeds in service"),
    "fit-friction": ("fit", "RIG.csv -> friction.parquet: a friction coefficient per run"),
    "build-surface": ("surface", "friction -> surface.parquet: friction over force and speed"),
    "refine-surface": (
        "surface",
        "friction, stiffness -> surface_refined.parquet: free of bias",
    ),
    "simulate-rig": ("proof", "surface, stiffness -> simulated.parquet: the simulated rig"),
    "compare": ("proof", "friction, simulated -> compare.parquet: do they agree?"),
    "simulate-drive": ("drive", "surface, stiffness -> drive.parquet: a belt drive"),
    "compare-drive": ("drive", "slip, drive -> compare_drive.parquet: do they agree?"),
    "plan": ("plan", "surface, stiffness -> plan.csv: the next runs, or stop"),
    "run": ("run", "CONFIG.yaml -> runs/<belt>/: the whole chain"),
    "report": ("report", "runs/<belt> -> report.html: figures, verdict"),
    "show": ("report", "what an artifact is: a table, or a figure in a file"),
    "export": ("export", "runs/<belt> -> contact law for multibody codes"),
    "config": ("about", "show or check a config"),
}
"""Commands in the order of the work: command -> its module and its line in the help."""


def show_version(context: typer.Context, wanted: bool) -> None:
    """Print the version and exit, if requested; with --verbose, those of all libraries too."""
    if not wanted:
        return
    typer.echo(f"beltid {__version__}")
    if context.params["verbose"]:
        from beltid.cli.execute import finish
        from beltid.stages.setup.about import program

        finish(lambda options: program(), Common(verbose=True))
    raise typer.Exit


Version = Annotated[
    bool,
    typer.Option(
        "--version",
        callback=show_version,
        help="Show the version and exit; with -v, those of all libraries, and the environment.",
    ),
]


@dataclass(frozen=True, slots=True)
class Common:
    """Options of every command, in the order of the help."""

    config: Annotated[
        Path | None,
        typer.Option(
            "--config",
            "-c",
            metavar="YAML",
            help="Config of belt, benches and settings. Default: the one that the environment "
            "variable BELTID_CONFIG names, else <name of the input>.yaml or beltid.yaml next to "
            "the input or in a folder above it, else the built-in 5PK rig of the paper.",
        ),
    ] = None
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="File to write. Default: next to the input, as named above.",
        ),
    ] = None
    json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object instead of a table.")
    ] = False
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Print warnings and errors only.")
    ] = False
    verbose: Annotated[
        bool,
        # eager: --version, wherever it stands, must know it
        typer.Option("--verbose", "-v", is_eager=True, help="Print all rows and details."),
    ] = False
    force: Annotated[
        bool,
        typer.Option(
            "--force",
            "-f",
            help="Compute again even if the result is up to date, and replace another .parquet "
            "file at --out. Inputs, recordings and files that are no artifacts are never replaced.",
        ),
    ] = False


class InOrder(TyperGroup):
    """Command group in the order of the work that imports a module when its command is called.

    Importing and building all commands would take half of the time of the help.
    """

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the commands in the order of the help."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command by name; if there is none, load all for a suggestion and return None."""
        if cmd_name not in self.commands:
            wanted = [COMMANDS[cmd_name]] if cmd_name in COMMANDS else COMMANDS.values()
            for module, _ in wanted:
                import_module(f"beltid.cli.commands.{module}")
            self.commands = get_group(app).commands
        return self.commands.get(cmd_name)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the list of commands from `COMMANDS`."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, short) for name, (_, short) in COMMANDS.items()])


class PlainCommand(TyperCommand):
    """Command whose help avoids the braces and type names of typer."""

    def get_help(self, ctx: Any) -> str:
        """Return the help of the command."""
        text: str = super().get_help(ctx)
        return text.replace("<list[Path]>", "<path>      ")

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the arguments without braces, which look like alternatives."""
        return [
            piece.replace("{", "").replace("}", "") for piece in super().collect_usage_pieces(ctx)
        ]


app = typer.Typer(
    cls=InOrder,
    name="beltid",
    help=MAIN_HELP,
    epilog=EXIT_STATUSES,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    no_args_is_help=True,
    context_settings={"help_option_names": ["--help", "-h"], "max_content_width": 100},
)


def command(
    name: str, *, of: typer.Typer = app, short: str = "", out: Any = None
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register a function as a command; the common options are its argument ``common``.

    Parameters
    ----------
    name : str
        Name of the command: one of `COMMANDS`, or a subcommand of one of them.
    of : Typer
        Parent command; by default the program.
    short : str
        Line in the help of the parent; by default the one in `COMMANDS`.
    out : typer.Option, optional
        Option that replaces the usual ``--out``.
    """

    def registered(function: Callable[..., None]) -> Callable[..., None]:
        with_options = _with_common_options(function, out)
        add = of.command(name, cls=PlainCommand, short_help=short or COMMANDS[name][1])
        add(with_options)
        return with_options

    return registered


def _with_common_options(function: Callable[..., None], out: Any) -> Callable[..., None]:
    hints = get_type_hints(function, include_extras=True)
    own = [
        parameter.replace(annotation=hints[parameter.name])
        for parameter in inspect.signature(function).parameters.values()
        if parameter.name != "common"
    ]
    common = get_type_hints(Common, include_extras=True)
    if out is not None:
        common["out"] = Annotated[Path | None, out]
    keyword = inspect.Parameter.KEYWORD_ONLY
    shared = [
        inspect.Parameter(field.name, keyword, default=field.default, annotation=common[field.name])
        for field in fields(Common)
    ]
    version = inspect.Parameter("version", keyword, default=False, annotation=Version)

    @functools.wraps(function)
    def wrapper(*args: Any, **values: Any) -> None:
        values.pop("version", None)
        chosen = {field.name: values.pop(field.name) for field in fields(Common)}
        if chosen["out"] == Path("-"):
            raise typer.BadParameter("- is not stdout, name a file", param_hint="--out")
        function(*args, common=Common(**chosen), **values)

    parameters = [*own, *shared, version]
    wrapper.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    wrapper.__annotations__ = {p.name: p.annotation for p in parameters}
    return wrapper


@app.callback()
def _top(
    version: Version = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", is_eager=True, help="With --version: everything.")
    ] = False,
) -> None:
    if verbose:
        raise typer.BadParameter("-v stands after the command, or beside --version")


def main() -> None:
    """Entry point of the command line."""
    one_thread_each()
    prepare_streams()
    hear_signals()
    try:
        app()
    except OSError as error:
        if error.filename is None:
            if not _is_folder_gone():
                raise
            typer.echo(f"error: {FOLDER_GONE}", err=True)
        else:  # such as a file name that is too long, before the work starts
            typer.echo(f"error: {printable(f'{error.filename}: {error.strerror}')}", err=True)
        sys.exit(EXIT_INPUT)


def _is_folder_gone() -> bool:
    """Return whether the working folder was deleted: relative paths lead nowhere."""
    try:
        Path.cwd()
    except FileNotFoundError:
        return True
    return False

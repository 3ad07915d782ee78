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
from beltid.cli.process import hear_signals, one_thread_each, prepare_streams
from beltid.errors import EXIT_INPUT, printable

FOLDER_GONE: Final = (
    "the working folder no longer exists: "
    "change to another one, or name all files by absolute paths"
)
MAIN_HELP = """\
Identify the contact parameters between a V-ribbed belt and a pulley.

From bench recordings to a friction law that is proven on a simulated copy of the bench (method of
Cepon, Manin and Boltezar, 2010). `beltid run CONFIG.yaml` goes through all steps, and through the
drive if the config has one. Results go to stdout, messages and progress to stderr.
"""
STATUSES: Final = (
    ("0", "done"),
    ("1", "a bug in beltid, with a traceback"),
    ("2", "wrong call, config or input; the message says what to correct"),
    ("3", "numerical failure: no convergence, or no admissible law"),
    ("4", "compare, cross-validate, compare-drive: the difference is out of tolerance"),
    ("5", "run: some of several belts failed"),
    ("130", "interrupted (Ctrl-C); 143: terminated by the system; 129: terminal closed"),
)
FIRST: Final = {
    "inspect": "FILE -> how it is read, and a config section",
    "init": "write a commented config for a new belt",
    "run": "CONFIG.yaml -> runs/<belt>/: all steps",
    "report": "runs/<belt> -> report.html: figures, verdict",
    "show": "what an artifact is: a table, or a figure in a file",
    "export": "runs/<belt> -> contact law for multibody codes",
    "config": "show or check a config",
}
"""Commands that are no steps, in the order of the help."""
SEE: Final = "Options of every command (-c, -o, -f, -q, -v, --json): beltid --help"


def show_version(context: typer.Context, wanted: bool) -> None:
    """Print the version and exit, if requested; with --verbose, those of all libraries too."""
    if not wanted:
        return
    typer.echo(f"beltid {__version__}")
    if context.params["verbose"]:
        from beltid.cli.execute import finish
        from beltid.stages.about import program

        finish(program, Common(verbose=True))
    raise typer.Exit


def _option(*names: str, text: str, **about: Any) -> Any:
    return typer.Option(*names, help=text, hidden=True, **about)


VERSION: Final = "Show the version and exit; with -v, those of all libraries, and the environment."
Version = Annotated[bool, typer.Option("--version", callback=show_version, help=VERSION)]
HiddenVersion = Annotated[bool, _option("--version", text=VERSION, callback=show_version)]


@dataclass(frozen=True, slots=True)
class Common:
    """Options of every command, in the order of the help."""

    config: Annotated[
        Path | None,
        _option(
            *("--config", "-c"),
            metavar="YAML",
            text="Config of belt, benches and settings. Default: the one that the environment "
            "variable BELTID_CONFIG names, else <name of the input>.yaml or beltid.yaml next to "
            "the input or in a folder above it, else the built-in 5PK rig of the paper.",
        ),
    ] = None
    out: Annotated[
        Path | None,
        _option(
            *("--out", "-o"),
            metavar="FILE",
            text="File to write. Default: next to the input, as named in the help.",
        ),
    ] = None
    json: Annotated[bool, _option("--json", text="Print one JSON object instead of a table.")] = (
        False
    )
    quiet: Annotated[bool, _option("--quiet", "-q", text="Print warnings and errors only.")] = False
    verbose: Annotated[
        bool,
        # eager: --version, wherever it stands, must know it
        _option("--verbose", "-v", is_eager=True, text="Print all rows and details."),
    ] = False
    force: Annotated[
        bool,
        _option(
            *("--force", "-f"),
            text="Compute again even if the result is up to date, and replace another file at "
            "--out. Inputs and recordings are never replaced.",
        ),
    ] = False


class InOrder(TyperGroup):
    """Command group that makes a command when it is called: making all takes half of the help."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the commands in the order of the help."""
        return [*FIRST, *_steps()]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command by name; if there is none, load all for a suggestion and return None."""
        if cmd_name not in self.commands:
            names = [cmd_name] if cmd_name in self.list_commands(ctx) else self.list_commands(ctx)
            for name in names:
                if name in FIRST:
                    import_module("beltid.cli.commands")
                else:
                    import_module("beltid.cli.steps").add(_steps()[name])
            self.commands = get_group(app).commands
        return self.commands.get(cmd_name)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands: first what a new user needs, then the steps of the method."""
        from beltid.cli.steps import short_of

        with formatter.section("Commands"):
            formatter.write_dl(list(FIRST.items()))
        with formatter.section("Steps"):
            formatter.write_dl([(name, short_of(step)) for name, step in _steps().items()])
        with formatter.section("Options of every command"):
            formatter.write_dl([*_common_help(), ("-h, --help", "Show the help of a command.")])
        with formatter.section("Exit status"):
            formatter.write_dl(list(STATUSES))


def _steps() -> dict[str, Any]:
    """Return the steps of the method that are commands, in their order."""
    import_module("beltid.stages.steps")
    from beltid.stage import STAGES

    return {name: step for name, step in STAGES.items() if step.is_command}


def _common_help() -> list[tuple[str, str]]:
    rows = []
    for hint in get_type_hints(Common, include_extras=True).values():
        option = hint.__metadata__[0]
        names = ", ".join(sorted((option.default, *option.param_decls), key=len))
        rows.append((f"{names} {option.metavar or ''}".strip(), option.help))
    return rows


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


SETTINGS: Final = {"help_option_names": ["--help", "-h"], "max_content_width": 100}
app = typer.Typer(
    cls=InOrder,
    name="beltid",
    help=MAIN_HELP,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    no_args_is_help=True,
    context_settings=SETTINGS,
)


def command(
    name: str, *, of: typer.Typer = app, short: str = "", out: Any = None
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register a function as a command; the common options are its argument ``common``."""

    def registered(function: Callable[..., None]) -> Callable[..., None]:
        with_options = _with_common_options(function, out)
        of.command(name, cls=PlainCommand, short_help=short, epilog=SEE)(with_options)
        return with_options

    return registered


def _with_common_options(function: Callable[..., None], out: Any) -> Callable[..., None]:
    signature = inspect.signature(function, eval_str=True)
    own = [p for p in signature.parameters.values() if p.name != "common"]
    common = get_type_hints(Common, include_extras=True)
    if out is not None:
        common["out"] = Annotated[Path | None, out]
    keyword = inspect.Parameter.KEYWORD_ONLY
    version = inspect.Parameter("version", keyword, default=False, annotation=HiddenVersion)
    shared = [
        inspect.Parameter(field.name, keyword, default=field.default, annotation=common[field.name])
        for field in fields(Common)
    ]

    @functools.wraps(function)
    def wrapper(*args: Any, **values: Any) -> None:
        values.pop("version")
        chosen = {field.name: values.pop(field.name) for field in fields(Common)}
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

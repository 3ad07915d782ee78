"""The program: its commands, made from functions and their docstrings, and the entry point."""

from __future__ import annotations

import functools
import inspect
import re
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_group

from beltid._version import __version__
from beltid.cli.process import hear_signals, one_thread_each, prepare_streams
from beltid.errors import EXIT_INPUT, printable

MAIN_HELP: Final = """\
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
SHORT: Final = {
    "jobs": "-j",
    "dry_run": "-n",
    "config": "-c",
    "out": "-o",
    "quiet": "-q",
    "verbose": "-v",
    "force": "-f",
}
"""Short names of options."""
KEYWORD: Final = inspect.Parameter.KEYWORD_ONLY


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


VERSION: Final = "Show the version and exit; with -v, those of all libraries."
Version = Annotated[bool, typer.Option("--version", callback=show_version, help=VERSION)]


@dataclass(frozen=True, slots=True)
class Common:
    """Options of every command, in the order of the help.

    Parameters
    ----------
    config : YAML
        Config of belt, benches and settings. Default: the one that the environment variable
        BELTID_CONFIG names, else <name of the input>.yaml or beltid.yaml next to the input or in a
        folder above it, else the built-in 5PK rig of the paper.
    out : FILE
        File to write. Default: next to the input, as named in the help.
    json : bool
        Print one JSON object instead of a table.
    quiet : bool
        Print warnings and errors only.
    verbose : bool
        Print all rows and details.
    force : bool
        Compute again even if the result is up to date, and replace another file at --out. Inputs
        and recordings are never replaced.
    """

    config: Path | None = None
    out: Path | None = None
    json: bool = False
    quiet: bool = False
    verbose: bool = False
    force: bool = False


class InOrder(TyperGroup):
    """Command group that makes a command when it is called: making all takes half of the help."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the commands in the order of the help."""
        return [*FIRST, *_steps()]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command by name; if there is none, load all for a suggestion and return None."""
        if cmd_name not in self.commands:
            known = self.list_commands(ctx)
            for name in [cmd_name] if cmd_name in known else known:
                if name in FIRST:
                    import_module("beltid.cli.commands")
                else:
                    import_module("beltid.cli.steps").add(_steps()[name])
            self.commands = get_group(app).commands
        return self.commands.get(cmd_name)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands: first what a new user needs, then the steps of the method."""
        from beltid.cli.steps import short_of

        common = [
            (f"{', '.join(_names(name))} {_metavar(kind) or ''}".rstrip(), text)
            for name, (kind, text) in _common().items()
        ]
        for title, rows in (
            ("Commands", FIRST.items()),
            ("Steps", [(name, short_of(step)) for name, step in _steps().items()]),
            ("Options of every command", [*common, ("-h, --help", "Show the help of a command.")]),
            ("Exit status", STATUSES),
        ):
            with formatter.section(title):
                formatter.write_dl(list(rows))


def _steps() -> dict[str, Any]:
    """Return the steps of the method that are commands, in their order."""
    import_module("beltid.stages.steps")
    from beltid.stage import STAGES

    return {name: step for name, step in STAGES.items() if step.is_command}


class PlainCommand(TyperCommand):
    """Command whose help avoids the braces and type names of typer."""

    def get_help(self, ctx: Any) -> str:
        """Return the help of the command."""
        text: str = super().get_help(ctx)
        return text.replace("<list[Path]>", "<path>      ")

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the arguments without braces, which look like alternatives."""
        return [re.sub("[{}]", "", piece) for piece in super().collect_usage_pieces(ctx)]


def plain_typer(**about: Any) -> typer.Typer:
    """Create a group of commands without colours and boxes."""
    settings = {"help_option_names": ["--help", "-h"], "max_content_width": 100}
    about |= {"rich_markup_mode": None, "no_args_is_help": True, "context_settings": settings}
    return typer.Typer(**about)


app = plain_typer(cls=InOrder, name="beltid", help=MAIN_HELP, pretty_exceptions_enable=False)


def command(
    name: str, *, of: typer.Typer = app, short: str = "", out: str = ""
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Make a command of a function: arguments and options by its signature and docstring.

    ``out`` says what --out is, as ``FILE: The file.``, if not what it is in all commands.
    """

    def made(function: Callable[..., None]) -> Callable[..., None]:
        text, told, example = sections(inspect.getdoc(function) or "")
        signature = inspect.signature(function, eval_str=True).parameters.values()
        parameters = [parameter(p, *told[p.name]) for p in signature if p.name != "common"]
        text = f"{text}\n\n{example}"
        return register(name, function, parameters, text, of=of, short=short, out=out)

    return made


def register(
    name: str,
    function: Callable[..., None],
    parameters: Iterable[inspect.Parameter],
    text: str,
    *,
    of: typer.Typer = app,
    short: str = "",
    out: str = "",
) -> Callable[..., None]:
    """Register a function as a command with a help text; its ``common`` are the common options."""
    told, shared = _common(), list[inspect.Parameter]()
    for p in inspect.signature(Common, eval_str=True).parameters.values():
        # eager: --version, wherever it stands, must know it
        about: dict[str, Any] = {"hidden": True, "is_eager": p.name == "verbose"}
        if p.name == "out" and out:
            kind, _, meaning = out.partition(": ")
            told["out"], about = (kind, meaning), {}
        shared.append(parameter(p.replace(kind=KEYWORD), *told[p.name], **about))
    hidden = typer.Option("--version", callback=show_version, help=VERSION, hidden=True)
    version = inspect.Parameter(
        "version", KEYWORD, default=False, annotation=Annotated[bool, hidden]
    )
    names = [p.name for p in shared]

    @functools.wraps(function)
    def called(*args: Any, version: bool, **values: Any) -> None:
        common = Common(**{name: values.pop(name) for name in names})
        function(*args, common=common, **values)

    signature = inspect.Signature([*parameters, *shared, version])
    called.__signature__ = signature  # type: ignore[attr-defined]
    called.__annotations__ = {p.name: p.annotation for p in signature.parameters.values()}
    called.__doc__ = text
    of.command(name, cls=PlainCommand, short_help=short, epilog=SEE)(called)
    return called


def parameter(p: inspect.Parameter, kind: str, text: str, **about: Any) -> inspect.Parameter:
    """Return a parameter as an argument, or as an option if it is a keyword."""
    annotation = type(p.default) if p.annotation is p.empty else p.annotation
    about |= {"help": text, "metavar": _metavar(kind)}
    if p.kind is not KEYWORD:
        return p.replace(annotation=Annotated[annotation, typer.Argument(**about)])
    about["show_default"] = p.default not in (None, False)
    if p.name == "jobs" or annotation is int:
        about["min"] = 1
    option = typer.Option(*reversed(_names(p.name)), **about)
    return p.replace(annotation=Annotated[annotation, option])


def _names(name: str) -> list[str]:
    return [*filter(None, [SHORT.get(name)]), f"--{name.replace('_', '-')}"]


def _metavar(kind: str) -> str | None:
    """Return the choices of a docstring, or its type if that is a name in capitals or a unit."""
    of_type = kind if re.fullmatch(r"[A-Z]+|\S+/\S+", kind) else None
    return "|".join(re.findall(r'"([^"]+)"', kind)) or of_type


def _common() -> dict[str, tuple[str, str]]:
    return sections(inspect.getdoc(Common) or "")[1]


def sections(doc: str) -> tuple[str, dict[str, tuple[str, str]], str]:
    """Split a numpydoc text: what it says, its parameters with type and meaning, its examples."""
    parts = re.split(r"^(\w+)\n-{4,}\n", doc, flags=re.M)
    found = dict(zip(parts[1::2], parts[2::2], strict=True))
    pattern = r"^(\w+) : (.*)\n((?:    .*\n?)+)"
    told = re.findall(pattern, found.get("Parameters", ""), flags=re.M)
    lines = found.get("Examples", "").strip().splitlines()
    example = "\n".join(f"{' ' * 9 if i else 'Example: '}{line}" for i, line in enumerate(lines))
    return (
        parts[0].strip(),
        {name: (kind, " ".join(text.split())) for name, kind, text in told},
        f"\b\n{example}" if len(lines) > 1 else example,
    )


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
    except OSError as error:  # such as a file name that is too long, before the work starts
        try:
            Path.cwd()
            if error.filename is None:
                raise
            problem = printable(f"{error.filename}: {error.strerror}")
        except FileNotFoundError:
            problem = "the working folder no longer exists: change to another one"
        typer.echo(f"error: {problem}", err=True)
        sys.exit(EXIT_INPUT)

"""The program: its commands, made from functions and their docstrings, and the entry point."""

import inspect
import re
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, get_origin

import typer
from typer.core import TyperGroup
from typer.main import get_group

from beltid._version import __version__
from beltid.cli.execute import Common, finish, hear_signals, one_thread_each, prepare_streams
from beltid.errors import EXIT_INPUT, printable
from beltid.notes import log
from beltid.stages.steps import STAGES

MAIN_HELP = """\
Identify the contact parameters between a V-ribbed belt and a pulley.

From bench recordings to a friction law that is proven on a simulated copy of the bench (method of
Cepon, Manin and Boltezar, 2010). `beltid run CONFIG.yaml` goes through all steps, and through the
drive if the config has one. Results go to stdout, messages and progress to stderr.
"""
STATUSES = {
    "0": "done",
    "1": "a bug in beltid, with a traceback",
    "2": "wrong call, config or input; the message says what to correct",
    "3": "numerical failure: no convergence, or no admissible law",
    "4": "compare, cross-validate, compare-drive: the difference is out of tolerance",
    "5": "run: some of several belts failed",
    "130": "interrupted (Ctrl-C); 143: terminated by the system; 129: terminal closed",
}
FIRST = {
    "inspect": "FILE -> how it is read, and a config section",
    "init": "write a commented config for a new belt",
    "run": "CONFIG.yaml -> runs/<belt>/: all steps",
    "report": "runs/<belt> -> report.html: figures, verdict",
    "show": "what an artifact is: a table, or a figure in a file",
    "export": "runs/<belt> -> contact law for multibody codes",
    "config": "show or check a config",
}
"""Commands that are no steps, in the order of the help."""
SHORT = {
    "jobs": "-j",
    "dry_run": "-n",
    "config": "-c",
    "out": "-o",
    "quiet": "-q",
    "verbose": "-v",
    "force": "-f",
}
"""Short names of options."""
FILES = (
    "CSV, Zwick, LabVIEW .lvm, TDMS, MDF, MATLAB, Excel, Parquet; or a folder, a pattern in quotes "
    "or a zip file with a file per run"
)
KEYWORD = inspect.Parameter.KEYWORD_ONLY


def config_of(file: Path | None, common: Common) -> Any:
    """Return the config of a file, and tell which it is."""
    from beltid.config import find_config

    source = find_config(file, common.config)
    log.info("config: %s", source.origin)
    return source


class InOrder(TyperGroup):
    """Command group that makes a command when it is called: making all takes half of the help."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Show the version if it is asked for, before or after a command."""
        if "--version" in args:
            typer.echo(f"beltid {__version__}")
            if {"-v", "--verbose"} & set(args):
                from beltid.stages.about import program

                finish(program, Common(verbose=True), None)
            raise typer.Exit
        return super().parse_args(ctx, args)

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
                    add_step(_steps()[name])
            self.commands = get_group(app).commands
        return self.commands.get(cmd_name)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands: first what a new user needs, then the steps of the method."""
        common = {
            f"{', '.join(_names(name))} {_metavar(kind) or ''}".rstrip(): text
            for name, (kind, text) in _common().items()
        }
        for title, rows in {
            "Commands": FIRST,
            "Steps": {name: _short(step) for name, step in _steps().items()},
            "Options of every command": common | {"-h, --help": "Show the help of a command."},
            "Exit status": STATUSES,
        }.items():
            with formatter.section(title):
                formatter.write_dl(list(rows.items()))


def _steps() -> dict[str, Any]:
    """Return the steps of the method that are commands, in their order."""
    return {name: step for name, step in STAGES.items() if step.is_command}


def plain_typer(**about: Any) -> typer.Typer:
    """Create a group of commands without colours and boxes."""
    return typer.Typer(
        rich_markup_mode=None,
        no_args_is_help=True,
        context_settings={"help_option_names": ["--help", "-h"], "max_content_width": 100},
        **about,
    )


app = plain_typer(cls=InOrder, name="beltid", help=MAIN_HELP, pretty_exceptions_enable=False)


def command(
    name: str,
    *,
    of: typer.Typer = app,
    short: str = "",
    out: str = "",
    kept: str | None = "nothing was written",
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Make a command of a function: arguments and options by its signature and docstring.

    The function returns a summary or a text; its ``common`` are the common options. `out` says what
    --out is, as ``FILE: The file.``, if not what it is in all commands; `kept` what an interrupt
    leaves, None: no file is written.
    """

    def made(function: Callable[..., Any]) -> Callable[..., Any]:
        text, told, example = sections(inspect.getdoc(function) or "")
        common = _common() | ({"out": tuple(out.split(": ", 1))} if out else {})
        parameters = [
            parameter(p, *told.get(p.name, ("", "")))
            for p in inspect.signature(function, eval_str=True).parameters.values()
            if p.name != "common"
        ]
        parameters += [
            parameter(p.replace(kind=KEYWORD), *common[p.name], hidden=p.name != "out" or not out)
            for p in inspect.signature(Common, eval_str=True).parameters.values()
        ]

        def called(*args: Any, **values: Any) -> None:
            given = Common(**{name: values.pop(name) for name in common})
            finish(
                lambda: function(*args, common=given, **values),
                given,
                kept and kept.format(out=given.out or "runs"),
            )

        called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        called.__annotations__ = {p.name: p.annotation for p in parameters}
        called.__doc__ = f"{text}\n\n{example}"
        of.command(
            name,
            short_help=short,
            epilog="Options of every command (-c, -o, -f, -q, -v, --json): beltid --help",
        )(called)
        return function

    return made


def _kind(stage: Any, role: str) -> str:
    """Return the kind of an input as the help names it: of several, the first."""
    kind = stage.reads[role]
    return kind if isinstance(kind, str) else kind[0]


def add_step(stage: Any) -> None:
    """Add the command of a step to the program."""
    text, told, example = sections(inspect.getdoc(stage.compute) or "")
    hints = inspect.signature(stage.compute, eval_str=True).parameters
    parameters = []
    for name, p in stage.signature.parameters.items():
        if name in stage.reads:
            kind = _kind(stage, name)
            given: Any = typer.Argument(metavar=kind.upper(), help=_about(kind))
            if p.kind is KEYWORD:
                given = typer.Option("--from", metavar=kind.upper(), help=told[name][1])
            of = Path if p.default is p.empty else Path | None
            parameters.append(p.replace(kind=KEYWORD, annotation=Annotated[of, given]))
    parameters += [parameter(hints[p.name], *told[p.name]) for p in stage.options]

    def step(*, common: Common, **given: Any) -> Any:
        from beltid.bench.files import folder_of
        from beltid.report.results import summary_of

        files = {role: path for role in stage.reads if (path := given.pop(role)) is not None}
        first = next(iter(files.values()), None)
        out = common.out or (folder_of(first) if first else Path()) / stage.file_name(given)
        made, kept = stage.run(config_of(first, common), files, out, force=common.force, **given)
        return summary_of(made, up_to_date=kept)

    step.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    step.__doc__ = f"{text}\n\nWrites {stage.file_name()}.\n\n{example}"
    command(stage.name)(step)


def _short(stage: Any) -> str:
    """Return the line of a step in the list of commands: what it reads and writes."""
    parameters = stage.signature.parameters
    needed = [_kind(stage, n).upper() for n in stage.reads if parameters[n].kind is not KEYWORD]
    return f"{', '.join(needed)} -> {stage.file_name()}"


def _about(kind: str) -> str:
    from beltid.tables import schemas

    by = schemas.table(kind).command
    if kind in schemas.RECORDINGS:
        return f"Recording of {by} ({FILES}); beltid inspect FILE shows how it is read."
    name = f"{kind}.parquet of {by.removeprefix('beltid ')}"
    return f"{name}, or surface_refined.parquet." if kind == "surface" else f"{name}."


def parameter(p: inspect.Parameter, kind: str, text: str, **about: Any) -> inspect.Parameter:
    """Return a parameter as an argument, or as an option if it is a keyword; or as it is told."""
    if get_origin(p.annotation) is Annotated:
        return p
    about |= {"help": text, "metavar": _metavar(kind)}
    if p.kind is not KEYWORD:
        return p.replace(annotation=Annotated[p.annotation, typer.Argument(**about)])
    about |= {"show_default": p.default not in (None, False)}
    about |= {"min": 1} if p.name == "jobs" or p.annotation is int else {}
    option = typer.Option(*reversed(_names(p.name)), **about)
    return p.replace(annotation=Annotated[p.annotation, option])


def _names(name: str) -> list[str]:
    return [*filter(None, [SHORT.get(name)]), f"--{name.replace('_', '-')}"]


def _metavar(kind: str) -> str | None:
    """Return the choices of a docstring, or its type if that is a name in capitals or a unit."""
    if choices := re.findall(r'"([^"]+)"', kind):
        return "|".join(choices)
    return kind if re.fullmatch(r"[A-Z]+|\S+/\S+", kind) else None


def _common() -> dict[str, tuple[str, str]]:
    return sections(inspect.getdoc(Common) or "")[1]


def sections(doc: str) -> tuple[str, dict[str, tuple[str, str]], str]:
    """Split a numpydoc text: what it says, its parameters with type and meaning, its examples."""
    text, *parts = re.split(r"^(\w+)\n-{4,}\n", doc, flags=re.M)
    found = dict(zip(parts[::2], parts[1::2], strict=True))
    told = re.findall(r"^(\w+) : (.*)\n((?:    .*\n?)+)", found.get("Parameters", ""), flags=re.M)
    example = "\n         ".join(found.get("Examples", "").split("\n")).strip()
    mark = "\b\n" if "\n" in example else ""
    return (
        text.strip(),
        {name: (kind, " ".join(meaning.split())) for name, kind, meaning in told},
        example and f"{mark}Example: {example}",
    )


@app.callback()
def _top(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Show the version and exit; with -v, those of all libraries."
        ),
    ] = False,
) -> None:
    """Declare for the help what the group does."""


def main() -> None:
    """Entry point of the command line."""
    one_thread_each()
    prepare_streams()
    hear_signals()
    try:
        app()
    except OSError as error:  # such as a file name that is too long, or no working folder
        typer.echo(f"error: {printable(str(error))}", err=True)
        sys.exit(EXIT_INPUT)

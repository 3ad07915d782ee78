"""Options that every command has, added to its signature in one place."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from beltid._version import __version__


@dataclass(frozen=True, slots=True)
class Common:
    """What the common options say."""

    config: Path | None = None
    out: Path | None = None
    json: bool = False
    quiet: bool = False
    verbose: bool = False
    force: bool = False


def show_version(wanted: bool) -> None:
    """Print the version and exit, if that is wanted."""
    if wanted:
        typer.echo(f"beltid {__version__}")
        raise typer.Exit


Version = Annotated[
    bool,
    typer.Option(
        "--version", callback=show_version, is_eager=True, help="Show the version and exit."
    ),
]


@dataclass(frozen=True, slots=True)
class _Hints:
    """Annotations of the common options, in the order of the help."""

    config: Annotated[
        Path | None,
        typer.Option(
            "--config",
            "-c",
            metavar="YAML",
            help="Config of belt, benches and settings. Default: the one that the environment "
            "variable BELTID_CONFIG names, else <name of the input>.yaml or beltid.yaml beside the "
            "input or in a folder above it, else the built-in 5PK rig of the paper.",
        ),
    ]
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="File to write, - for stdout. Default: beside the input, as named above.",
        ),
    ]
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")]
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Say nothing but warnings and errors.")
    ]
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Print every row, say every detail.")
    ]
    force: Annotated[
        bool,
        typer.Option(
            "--force",
            "-f",
            help="Compute again even if the result is up to date, and replace another .parquet "
            "file at --out. Inputs, recordings and files that are no artifacts are never replaced.",
        ),
    ]


def with_common_options(
    command: Callable[..., None] | None = None,
    *,
    out_help: str = "",
    out_names: tuple[str, ...] = (),
    out_metavar: str = "FOLDER",
) -> Callable[..., Any]:
    """Give a command the common options; it receives them as its argument ``common``.

    Parameters
    ----------
    command : callable
        A command with a keyword argument ``common`` of type `Common`.
    out_help : str
        Help of ``--out`` where it is not the usual one.
    out_names : tuple of str
        Further names of ``--out``.
    out_metavar : str
        What ``--out`` takes, with a help of its own.
    """
    if command is None:
        return functools.partial(
            with_common_options,
            out_help=out_help,
            out_names=out_names,
            out_metavar=out_metavar,
        )
    hints = get_type_hints(command, include_extras=True)
    own = [
        parameter.replace(annotation=hints[parameter.name])
        for parameter in inspect.signature(command).parameters.values()
        if parameter.name != "common"
    ]
    common = get_type_hints(_Hints, include_extras=True)
    if out_help:
        common["out"] = Annotated[
            Path | None,
            typer.Option("--out", "-o", *out_names, metavar=out_metavar, help=out_help),
        ]
    keyword = inspect.Parameter.KEYWORD_ONLY
    shared = [
        inspect.Parameter(field.name, keyword, default=field.default, annotation=common[field.name])
        for field in fields(Common)
    ]
    version = inspect.Parameter("version", keyword, default=False, annotation=Version)

    @functools.wraps(command)
    def wrapper(*args: Any, **values: Any) -> None:
        values.pop("version", None)
        chosen = {field.name: values.pop(field.name) for field in fields(Common)}
        command(*args, common=Common(**chosen), **values)

    parameters = [*own, *shared, version]
    wrapper.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    wrapper.__annotations__ = {p.name: p.annotation for p in parameters}
    return wrapper

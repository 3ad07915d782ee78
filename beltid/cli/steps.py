"""A command from a step: arguments and options by its signature, the help by its docstring."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from beltid.cli.program import Common, command
from beltid.stage import RECORDINGS, Stage

FILES: Final = (
    "CSV, Zwick, LabVIEW .lvm, TDMS, MDF, MATLAB, Excel, Parquet; or a folder, a pattern in quotes "
    "or a zip file with a file per run"
)
BENCHES: Final = {
    "press": "the compression press",
    "speedloss": "the speed-loss bench",
    "rig": "the friction rig",
}
SHORT: Final = {"jobs": ("-j",)}
UNITS: Final = {"": "text", "deg": "°", "degC": "°C"}
OTHERWISE: Final = """
    Other names or units of columns: state them in the config under columns: and units:. Exports of
    testing machines and measuring programs are read as they are, known names and units are
    recognised: beltid inspect FILE shows how.
"""


def kind_of(stage: Stage, role: str) -> str:
    """Return the kind of an input as the help names it: of several, the first."""
    kind = stage.reads[role]
    if callable(kind):
        return kind(**{p.name: p.default for p in stage.options})
    return kind if isinstance(kind, str) else kind[0]


def add(stage: Stage) -> None:
    """Add the command of a step to the program."""
    text, told, example = sections(inspect.getdoc(stage.compute) or "")
    keyword, parameters = inspect.Parameter.KEYWORD_ONLY, list[inspect.Parameter]()
    for name, p in stage.signature.parameters.items():
        if name not in stage.reads:
            continue
        kind, optional = kind_of(stage, name), p.default is not p.empty
        metavar = kind.upper()
        if p.kind is keyword:
            given: Any = typer.Option("--from", metavar=metavar, help=told[name][1])
        else:
            shown = f"[{metavar}]" if optional else metavar
            given = typer.Argument(metavar=shown, help=_about(kind))
        of: Any = Annotated[Path | None, given] if optional else Annotated[Path, given]
        default = {"default": None} if optional else {}
        parameters.append(inspect.Parameter(name, keyword, annotation=of, **default))
    parameters += [_option(stage, p, *told[p.name]) for p in stage.options]

    def run(*, common: Common, **given: Any) -> None:
        _run(stage, given, common)

    run.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [*parameters, inspect.Parameter("common", keyword, annotation=Common)]
    )
    run.__annotations__ = {p.name: p.annotation for p in parameters}
    name = stage.file_name({p.name: p.default for p in stage.options})
    columns = "".join(_columns(kind_of(stage, role)) for role in stage.reads)
    run.__doc__ = f"{text}\n\nWrites {name}.\n\n{columns}Example: {example}\n"
    command(stage.name, short=short_of(stage))(run)


def short_of(stage: Stage) -> str:
    """Return the line of a step in the list of commands: what it reads and writes."""
    needed = [
        kind_of(stage, name).upper()
        for name, p in stage.signature.parameters.items()
        if name in stage.reads and p.kind is not p.KEYWORD_ONLY
    ]
    name = stage.file_name({p.name: p.default for p in stage.options})
    return f"{', '.join(needed)} -> {name}"


def _run(stage: Stage, given: dict[str, Any], common: Common) -> None:
    from beltid.bench.files import folder_of
    from beltid.cli.execute import finish
    from beltid.config import find_config
    from beltid.notes import log
    from beltid.report.summary import Summary
    from beltid.report.view import summary_of

    files = {role: given.pop(role) for role in stage.reads}
    files = {role: path for role, path in files.items() if path is not None}
    first = next(iter(files.values()), None)
    folder = Path() if first is None else folder_of(first)
    out = common.out or folder / stage.file_name(given)

    def work() -> Summary:
        source = find_config(first, common.config)
        log.info("config: %s", source.origin)
        built = stage.run(source, files, out, force=common.force, **given)
        return summary_of(built.artifact, up_to_date=built.up_to_date, fails_with=stage.fails_with)

    finish(work, common, f"{out} was not written" + (" again" if out.exists() else ""))


def _option(stage: Stage, p: inspect.Parameter, of: str, text: str) -> inspect.Parameter:
    """Return the option of a keyword; its choices or its type stand in the docstring."""
    hints = inspect.signature(stage.compute, eval_str=True).parameters
    annotation = hints[p.name].annotation
    if annotation is p.empty:
        annotation = type(p.default)
    choices = "|".join(re.findall(r'"([^"]+)"', of))
    name = f"--{p.name.replace('_', '-')}"
    about: dict[str, Any] = {"help": text, "show_default": p.default not in (None, False)}
    if choices:
        about["metavar"] = choices
    if p.name == "jobs" or annotation is int:
        about["min"] = 1
    option = typer.Option(name, *SHORT.get(p.name, ()), **about)
    return p.replace(annotation=Annotated[annotation, option])


def _about(kind: str) -> str:
    from beltid.tables import schemas

    if kind in BENCHES:
        return f"Recording of {BENCHES[kind]} ({FILES})."
    name = f"{kind}.parquet of {schemas.table(kind).command.removeprefix('beltid ')}"
    return f"{name}, or surface_refined.parquet." if kind == "surface" else f"{name}."


def _columns(kind: str) -> str:
    """Return the columns of a recording for the help."""
    from beltid.tables import schemas

    if kind not in RECORDINGS:
        return ""
    rows = [
        f"  {column.name:<20} {UNITS.get(column.unit, column.unit):<6} {column.meaning}"
        f"{'' if column.required else '; may be missing'}\n"
        for column in schemas.table(kind).columns
    ]
    head = "\b\nColumns of the CSV (others are ignored):\n"
    return f"{head}{''.join(rows)}{inspect.cleandoc(OTHERWISE)}\n\n"


def sections(doc: str) -> tuple[str, dict[str, tuple[str, str]], str]:
    """Split a numpydoc text: what it says, its parameters with type and meaning, its example."""
    parts = re.split(r"^(\w+)\n-{4,}\n", doc, flags=re.M)
    found = dict(zip(parts[1::2], parts[2::2], strict=True))
    told = dict(_parameters(found.get("Parameters", "")))
    return parts[0].strip(), told, " ".join(found.get("Examples", "").split())


def _parameters(text: str) -> Iterator[tuple[str, tuple[str, str]]]:
    for match in re.finditer(r"^(\w+) : (.*)\n((?:    .*\n?)+)", text, flags=re.M):
        yield match[1], (match[2], " ".join(match[3].split()))

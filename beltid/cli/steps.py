"""A command from a step: arguments and options by its signature, the help by its docstring."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from beltid.cli.program import KEYWORD, Common, parameter, register, sections
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
UNITS: Final = {"": "text", "deg": "°", "degC": "°C"}
OTHERWISE: Final = """
Other names or units of columns: state them in the config under columns: and units:. Exports of
testing machines and measuring programs are read as they are, known names and units are recognised:
beltid inspect FILE shows how.
"""


def kind_of(stage: Stage, role: str) -> str:
    """Return the kind of an input as the help names it: of several, the first."""
    kind = stage.reads[role]
    return kind if isinstance(kind, str) else kind[0]


def add(stage: Stage) -> None:
    """Add the command of a step to the program."""
    text, told, example = sections(inspect.getdoc(stage.compute) or "")
    hints = inspect.signature(stage.compute, eval_str=True).parameters
    parameters = []
    for name, p in stage.signature.parameters.items():
        if name in stage.reads:
            kind = kind_of(stage, name)
            given: Any = typer.Argument(metavar=kind.upper(), help=_about(kind))
            if p.kind is KEYWORD:
                given = typer.Option("--from", metavar=kind.upper(), help=told[name][1])
            of = Path if p.default is p.empty else Path | None
            parameters.append(p.replace(kind=KEYWORD, annotation=Annotated[of, given]))
    parameters += [parameter(hints[p.name], *told[p.name]) for p in stage.options]
    columns = "".join(_columns(kind_of(stage, role)) for role in stage.reads)
    text = f"{text}\n\nWrites {_file(stage)}.\n\n{columns}{example}\n"

    def run(*, common: Common, **given: Any) -> None:
        _run(stage, given, common)

    register(stage.name, run, parameters, text, short=short_of(stage))


def short_of(stage: Stage) -> str:
    """Return the line of a step in the list of commands: what it reads and writes."""
    needed = [
        kind_of(stage, name).upper()
        for name, p in stage.signature.parameters.items()
        if name in stage.reads and p.kind is not KEYWORD
    ]
    return f"{', '.join(needed)} -> {_file(stage)}"


def _file(stage: Stage) -> str:
    return stage.file_name({p.name: p.default for p in stage.options})


def _run(stage: Stage, given: dict[str, Any], common: Common) -> None:
    from beltid.bench.files import folder_of
    from beltid.cli.execute import finish
    from beltid.config import find_config
    from beltid.notes import log
    from beltid.report.summary import Summary
    from beltid.report.view import summary_of

    files = {role: path for role in stage.reads if (path := given.pop(role)) is not None}
    first = next(iter(files.values()), None)
    folder = Path() if first is None else folder_of(first)
    out = common.out or folder / stage.file_name(given)

    def work() -> Summary:
        source = find_config(first, common.config)
        log.info("config: %s", source.origin)
        built = stage.run(source, files, out, force=common.force, **given)
        return summary_of(built.artifact, up_to_date=built.up_to_date, fails_with=stage.fails_with)

    finish(work, common, f"{out} was not written" + (" again" if out.exists() else ""))


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
    return f"\b\nColumns of the CSV (others are ignored):\n{''.join(rows)}{OTHERWISE}\n"

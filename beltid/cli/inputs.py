"""Arguments and options that several commands share, and recordings in their help."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Final, TypeVar

import typer

from beltid.tables import schemas


def _input(what: str, metavar: str) -> typer.models.ArgumentInfo:
    argument: typer.models.ArgumentInfo = typer.Argument(metavar=metavar, help=what)
    return argument


FILES = (
    "CSV, Zwick, LabVIEW .lvm, TDMS, MDF, MATLAB, Excel, Parquet; or a folder, a pattern in quotes "
    "or a zip file with a file per run"
)
Press = Annotated[Path, _input(f"Recording of the compression press ({FILES}).", "PRESS")]
SpeedLoss = Annotated[Path, _input(f"Recording of the speed-loss bench ({FILES}).", "SPEEDLOSS")]
Rig = Annotated[Path, _input(f"Recording of the friction rig ({FILES}).", "RIG")]
OptionalRig = Annotated[Path | None, _input(f"Recording of the friction rig ({FILES}).", "[RIG]")]
Points = Annotated[
    Path | None,
    typer.Option(
        "--table", metavar="POINTS", help="Table with one row per plateau, instead of RIG."
    ),
]
Condition = Annotated[
    str | None,
    typer.Option("--condition", metavar="dry|wet|dusty", help="Only runs on this surface."),
]
Side = Annotated[
    str | None,
    typer.Option("--side", metavar="rib|back", help="Only runs of this side of the belt."),
]
Friction = Annotated[Path, _input("friction.parquet of fit-friction.", "FRICTION")]
Surface = Annotated[
    Path, _input("surface.parquet of build-surface or surface_refined.parquet.", "SURFACE")
]
Stiffness = Annotated[Path, _input("stiffness.parquet of fit-stiffness.", "STIFFNESS")]
Slip = Annotated[Path, _input("slip.parquet of fit-slip.", "SLIP")]
DriveTable = Annotated[
    Path, _input("drive.parquet of simulate-drive --from the same slip.parquet.", "DRIVE")
]
Simulated = Annotated[
    Path,
    _input(
        "simulated.parquet of simulate-rig. A recording with the columns of rig.csv is reduced in "
        "the same way, to compare two benches, or a bench and another program.",
        "SIMULATED",
    ),
]
Jobs = Annotated[
    int | None,
    typer.Option(
        "--jobs", "-j", min=1, help="Runs simulated at the same time. Default: one per core."
    ),
]


Command = TypeVar("Command", bound=Callable[..., None])

MARK: Final = "    (columns)\n"
"""Placeholder in the docstring of a command for the columns of its recording."""
UNITS: Final = {"": "text", "deg": "°", "degC": "°C"}

OTHERWISE: Final = """
    Other names or units of columns: state them in the config, such as
    columns: {{{kind}: {{{name}}}}}, units: {{{kind}: {{{unit}}}}}.
    Exports of testing machines and measuring programs are read as they are, known names and units
    are recognised: beltid inspect FILE shows how. Separator, decimal sign and encoding are
    detected, or stated under dialect:.
"""


def reads_recording(kind: str, *, name: str, unit: str) -> Callable[[Command], Command]:
    """Insert the columns of a recording into the help of a command.

    Parameters
    ----------
    kind : str
        Kind of recording.
    name, unit : str
        Examples of a column with another name, and with another unit.
    """

    def described(command: Command) -> Command:
        rows = [
            f"      {column.name:<20} {UNITS.get(column.unit, column.unit):<6} {column.meaning}"
            f"{'' if column.required else '; may be missing'}\n"
            for column in schemas.table(kind).columns
        ]
        text = "    \b\n    Columns of the CSV (others are ignored):\n" + "".join(rows)
        text += OTHERWISE.format(kind=kind, name=name, unit=unit)
        command.__doc__ = (command.__doc__ or "").replace(MARK, text)
        return command

    return described

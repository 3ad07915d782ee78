"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


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
        "the same way: so two benches, or a bench and another program, can be compared.",
        "SIMULATED",
    ),
]
Jobs = Annotated[
    int | None,
    typer.Option(
        "--jobs", "-j", min=1, help="Runs simulated at the same time. Default: one per core."
    ),
]
Bootstrap = Annotated[
    int,
    typer.Option(
        "--bootstrap",
        min=0,
        metavar="N",
        help="Check the uncertainty of the refined surface by N Monte Carlo draws of all errors, "
        "and keep the ensemble; 500 are usual. Default: 0, no check.",
    ),
]
Seed = Annotated[
    int, typer.Option("--seed", min=0, metavar="S", help="Seed of the draws. Default: 0.")
]

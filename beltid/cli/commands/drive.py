"""Belt drive: predict it and compare it with the speed-loss bench."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from beltid.cli.execute import execute
from beltid.cli.inputs import DriveTable, Slip, Stiffness, Surface
from beltid.cli.program import Common, command


@command("simulate-drive")
def simulate_drive(
    surface: Surface,
    stiffness: Stiffness,
    slip: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="SLIP",
            help="slip.parquet of fit-slip: predict the operating points of that recording instead "
            "of those of the config.",
        ),
    ] = None,
    *,
    common: Common,
) -> None:
    """Predict a belt drive: speed loss, belt tensions, hub forces, reserve against slip.

    The section drive: of the config describes the drive; the contact is that of the identified
    laws. The belt is an extensible string with mass on the elastic bed of its ribs, or a rod with
    bending stiffness. Every speed loss is split into creep, seating and slip and has an
    uncertainty. Writes drive.parquet, one row per operating point and pulley.

    Example: beltid simulate-drive surface_refined.parquet stiffness.parquet --from slip.parquet
    """
    from beltid.stages.drive import simulate_drive as stage

    inputs = {"surface": surface, "stiffness": stiffness, "slip": slip}
    execute(stage.run, inputs, "drive.parquet", common)


@command("compare-drive")
def compare_drive(slip: Slip, drive: DriveTable, *, common: Common) -> None:
    """Compare predicted and measured speed losses; exit 0 or 4.

    Nothing is fitted to this recording: it is an independent test of the identified laws, and
    shows which of creep, seating and slip it can resolve. Points below a fifth of the largest
    torque are not judged. Default tolerance: RMS 10 %; change it under compare_drive: in the
    config. Writes compare_drive.parquet.

    Example: beltid compare-drive slip.parquet drive.parquet
    """
    from beltid.stages.drive import compare_drive as stage

    inputs = {"slip": slip, "drive": drive}
    execute(stage.run, inputs, "compare_drive.parquet", common)

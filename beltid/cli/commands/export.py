"""Export the contact law to other programs."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from beltid.cli.execute import finish
from beltid.cli.program import Common, command

TARGET_NAMES = (
    "json",
    "exudyn",
    "python",
    "c",
    "fortran",
    "adams",
    "modelica",
    "matlab",
    "csv",
    "all",
)


class SurfaceChoice(StrEnum):
    """Friction surface to export."""

    refined = "refined"
    published = "published"


def _complete(incomplete: str) -> list[str]:
    return [name for name in TARGET_NAMES if name.startswith(incomplete)]


@command(
    "export",
    out=typer.Option(
        "--out",
        "-o",
        metavar="FOLDER",
        help="Folder of the files. Default: export/ in the folder of the law.",
    ),
)
def export(
    target: Annotated[
        str | None,
        typer.Argument(
            metavar="TARGET",
            help="json, exudyn, python, c, fortran, adams, modelica, matlab, csv, or all. "
            "Without it, the targets are listed.",
            autocompletion=_complete,
        ),
    ] = None,
    source: Annotated[
        Path | None,
        typer.Argument(
            metavar="LAW",
            help="Results of a belt (a folder with stiffness.parquet and a surface), or a law "
            "file <belt>.beltlaw.json.",
        ),
    ] = None,
    surface: Annotated[
        SurfaceChoice | None,
        typer.Option(help="Friction surface. Default: the refined one, if it exists."),
    ] = None,
    normal_force: Annotated[
        float | None,
        typer.Option(
            metavar="N/m",
            help="Line force at which a linear stiffness and a constant mu are exact, for "
            "targets that support no more. Default: the middle of the range of mu.",
        ),
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(
            metavar="m/s",
            help="Sliding speed at which a constant mu is exact. Default: the middle.",
        ),
    ] = None,
    *,
    common: Common,
) -> None:
    """Write the contact law of a belt for multibody programs.

    Normal stiffness, friction over normal force and sliding speed, range of validity, origin. What
    a program cannot represent is replaced by an approximation; the file states its deviation from
    the law over the range of mu. An existing file with different content is replaced only with
    --force.

    \b
    Example: beltid export exudyn runs/5pk
             beltid export exudyn runs/5pk --normal-force 5000 --speed 0.02
             beltid export all runs/5pk -o laws/5pk
    """  # noqa: D301
    from beltid.stages.results import export_law as stage

    finish(
        lambda options: stage.run(
            target,
            source,
            common.config,
            common.out,
            options,
            surface=surface.value if surface else None,
            normal_force_N_m=normal_force,
            slip_speed_m_s=speed,
        ),
        common,
        kept="files already written are complete",
    )

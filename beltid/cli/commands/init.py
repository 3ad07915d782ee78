"""Write the config of a new belt from its recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from beltid.cli.execute import finish
from beltid.cli.inputs import FILES
from beltid.cli.program import Common, command


@command(
    "init",
    out=typer.Option(
        "--out",
        "-o",
        metavar="FILE",
        help="The file. Default: <NAME>.yaml in the current folder.",
    ),
)
def init(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the belt, such as 6pk.")],
    files: Annotated[
        list[Path] | None,
        typer.Argument(metavar="FILE", help=f"Recordings of the belt, one per bench ({FILES})."),
    ] = None,
    *,
    common: Common,
) -> None:
    """Write the config of a new belt, with the meaning, unit and range of every key.

    What the recordings state is written: which bench each is of; contact arcs, tensions and speeds
    of the rig. Type and ribs follow from a name such as 6pk. All other keys are comments with
    their defaults. An existing file is overwritten only with --force.

    Example: beltid init 6pk press.csv rig.csv
    """
    from beltid.stages.setup import new_config as stage

    finish(
        lambda options: stage.run(name, files or [], common.out, options),
        common,
        kept="no config was written",
    )

"""Plan what to measure next on the friction rig."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from beltid.cli.execute import execute
from beltid.cli.program import Common, command


@command("plan")
def plan(
    surface: Annotated[
        Path | None,
        typer.Argument(
            metavar="[SURFACE]",
            help="surface_refined.parquet of refine-surface; leave out if there are no data yet.",
        ),
    ] = None,
    stiffness: Annotated[
        Path | None,
        typer.Argument(metavar="[STIFFNESS]", help="stiffness.parquet of fit-stiffness."),
    ] = None,
    runs: Annotated[
        int, typer.Option("--runs", min=1, metavar="N", help="Runs to plan at most. Default: 12.")
    ] = 12,
    goal_u: Annotated[
        float,
        typer.Option(
            "--goal-u",
            metavar="U",
            help="Relative standard uncertainty of the friction coefficient that is sufficient. "
            "Default: 0.01.",
        ),
    ] = 0.01,
    friction: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="FRICTION",
            help="friction.parquet of fit-friction: new runs are assumed as noisy as its runs.",
        ),
    ] = None,
    *,
    common: Common,
) -> None:
    """Plan the next runs of the friction rig, or report that no more are needed.

    Selects, from the settings under plan: in the config, the runs that minimise the uncertainty
    of the refined surface, averaged over all their forces and speeds. Errors that all runs share
    (load cells, arcs, radius, bending stiffness) are taken from uncertainty: in the config. Prints
    the uncertainty of each region before and after. Prints stop if the goal is reached or further
    runs do not help; then it names the shared error whose reduction would help most. Without
    SURFACE and STIFFNESS it starts from values typical of such a belt. Writes plan.csv, one row per
    run in the order of the session.

    Example: beltid plan surface_refined.parquet stiffness.parquet --from friction.parquet
    """
    from beltid.stages.simulation import plan as stage

    if (surface is None) != (stiffness is None) or (surface is None and friction is not None):
        raise typer.BadParameter("SURFACE and STIFFNESS go together, --from goes with them")
    inputs = {"surface": surface, "stiffness": stiffness, "friction": friction}
    run = partial(stage.run, runs=runs, goal_u=goal_u)
    execute(run, inputs, "plan.csv", common)

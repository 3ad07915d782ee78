"""What to measure next on the friction rig."""

from __future__ import annotations

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
            help="surface_refined.parquet of refine-surface; none: no data yet.",
        ),
    ] = None,
    stiffness: Annotated[
        Path | None,
        typer.Argument(metavar="[STIFFNESS]", help="stiffness.parquet of fit-stiffness."),
    ] = None,
    runs: Annotated[
        int, typer.Option("--runs", min=1, metavar="N", help="Runs to plan at most. Default: 12.")
    ] = 12,
    target: Annotated[
        str,
        typer.Option(
            "--target",
            metavar="surface|drive",
            help="Where friction has to be known: over all forces and speeds of the candidates, or "
            "where the drive of the config rubs. Default: surface.",
        ),
    ] = "surface",
    goal_u: Annotated[
        float,
        typer.Option(
            "--goal-u",
            metavar="U",
            help="Standard uncertainty of the friction coefficient that is good enough, as a "
            "share. Default: 0.01.",
        ),
    ] = 0.01,
    friction: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="FRICTION",
            help="friction.parquet of fit-friction: the noise of new runs is that of its runs.",
        ),
    ] = None,
    *,
    common: Common,
) -> None:
    """Plan the next runs of the friction rig, or say stop.

    Of all settings under plan: in the config those are chosen after which the refined surface is
    least uncertain, on average over the target. What all runs share (load cells, arcs, radius,
    bending stiffness) counts as it is stated under uncertainty:. Says how uncertain each region
    is before and after, and stops where the goal is reached or further runs do not help: then
    with the statement that would. Without SURFACE and STIFFNESS it starts from what is usual for
    such a belt. Writes plan.csv, a row per run in the order of the session, and plan.png.

    Example: beltid plan surface_refined.parquet stiffness.parquet --from friction.parquet
    """
    from beltid.stages.simulation import plan as stage

    if (surface is None) != (stiffness is None) or (surface is None and friction is not None):
        raise typer.BadParameter("SURFACE and STIFFNESS go together, --from goes with them")
    inputs = {"surface": surface, "stiffness": stiffness, "friction": friction}
    options = stage.PlanOptions(runs=runs, target=target, goal_u=goal_u)
    execute(stage.run, inputs, "plan.csv", common, options)

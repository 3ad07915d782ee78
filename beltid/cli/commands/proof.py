"""Validation: simulate the rig and compare it with the bench."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from beltid.cli.execute import execute
from beltid.cli.inputs import Friction, Jobs, Simulated, Stiffness, Surface
from beltid.cli.program import Common, command


@command("simulate-rig")
def simulate_rig(
    surface: Surface,
    stiffness: Stiffness,
    friction: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="FRICTION",
            help="friction.parquet whose runs are repeated. Default: the one next to SURFACE that "
            "it was made from, else all combinations of the settings under rig: of the config.",
        ),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(
            metavar="transient|steady",
            help="transient: stick, build-up and sliding over time. steady: the sliding limit "
            "only, faster. Default: as the config says, else transient.",
        ),
    ] = None,
    arc: Annotated[
        list[float] | None,
        typer.Option(
            metavar="DEG",
            help="Only runs with this contact arc, one of those measured; may be repeated.",
        ),
    ] = None,
    tension: Annotated[
        list[float] | None,
        typer.Option(
            metavar="N",
            help="Only runs with this initial tension, one of those measured; may be repeated.",
        ),
    ] = None,
    speed: Annotated[
        list[float] | None,
        typer.Option(
            metavar="RAD/S",
            help="Only runs with this pulley speed, one of those measured; may be repeated.",
        ),
    ] = None,
    jobs: Jobs = None,
    *,
    common: Common,
) -> None:
    """Simulate the runs of the friction rig with the identified contact laws.

    A flexible belt (ANCF beam elements) is laid on the pulley and tightened, and the pulley turns:
    stick, slip and full sliding. All measured runs are simulated, each setting once, or the
    selected ones; lists under rig: of the config take precedence over what was measured.
    Writes simulated.parquet with the columns of a bench recording; runs selected by --arc,
    --tension or --speed go to simulated_part.parquet and never replace the whole campaign.

    Example: beltid simulate-rig surface.parquet stiffness.parquet --arc 82
    """
    from beltid.stages.simulation import simulate_rig as stage
    from beltid.stages.simulation.planned_runs import Picked
    from beltid.stages.workers import available_cores

    run = partial(
        stage.run,
        picked=Picked(tuple(arc or ()), tuple(tension or ()), tuple(speed or ())),
        method=method,
        jobs=jobs or available_cores(),
    )
    name = "simulated_part.parquet" if arc or tension or speed else "simulated.parquet"
    inputs = {"surface": surface, "stiffness": stiffness, "friction": friction}
    execute(run, inputs, name, common)


@command("compare")
def compare(
    friction: Friction,
    simulated: Simulated,
    hold_out: Annotated[
        str | None,
        typer.Option(
            metavar="arc|speed",
            help="Predict instead: each arc (or inner speed) is left out once, the surface is "
            "refined from the other runs, and the runs left out are predicted. The second file is "
            "then stiffness.parquet.",
        ),
    ] = None,
    *,
    common: Common,
) -> None:
    """Compare simulated and measured friction coefficients; exit 0 or 4.

    The simulated recording goes through the same reduction as the measured one. Prints differences
    per arc, averaged over arcs, and for low, middle and high normal force. Runs are matched by
    arc, tension and speed.

    Default tolerances: RMS 6 %, mean magnitude 5 %, largest 20 %; change them under compare: in
    the config. Exit 4 also if fewer than half of the usable measured runs have a simulated partner.
    Writes compare.parquet; with --hold-out compare_hold_out.parquet.

    Example: beltid compare friction.parquet simulated.parquet

    Example: beltid compare friction.parquet stiffness.parquet --hold-out arc
    """
    from beltid.stages.simulation import compare as stage

    second = "stiffness" if hold_out else "simulated"
    name = "compare_hold_out.parquet" if hold_out else "compare.parquet"
    run = partial(stage.run, hold_out=hold_out)
    execute(run, {"friction": friction, second: simulated}, name, common)

"""Friction surfaces: as published, and corrected for the bias of bending."""

from __future__ import annotations

from functools import partial

from beltid.cli.execute import execute
from beltid.cli.inputs import Condition, Friction, Side, Stiffness
from beltid.cli.program import Common, command


@command("build-surface")
def build_surface(
    friction: Friction,
    condition: Condition = None,
    side: Side = None,
    *,
    common: Common,
) -> None:
    """Build the friction surface: the coefficient over normal force and sliding speed.

    One surface per contact arc and their average, as bicubic splines through the measured
    values; outside the measured range the nearest measured value is used. Runs with different
    surface conditions (dry, wet, dusty) or belt sides are never combined: select with
    --condition and --side. Writes surface.parquet.

    Example: beltid build-surface friction.parquet
    """
    from beltid.stages.identification import build_surface as stage

    run = partial(stage.run, condition=condition, side=side)
    execute(run, {"friction": friction}, "surface.parquet", common)


@command("refine-surface")
def refine_surface(
    friction: Friction,
    stiffness: Stiffness,
    condition: Condition = None,
    side: Side = None,
    *,
    common: Common,
) -> None:
    """Find the friction surface with which the simulated rig reproduces the measured tensions.

    The published procedure assigns each coefficient to the mean force on the arc and neglects that
    a stiff belt presses harder where it enters and leaves the pulley. Here the surface is the
    solution of an inverse problem over all arcs; the data determine its smoothness. Prints the
    remaining difference between simulated and measured coefficients and an uncertainty budget;
    state the uncertainties of your benches under uncertainty: in the config. Writes
    surface_refined.parquet.

    Example: beltid refine-surface friction.parquet stiffness.parquet
    """
    from beltid.stages.simulation import refine_surface as stage

    run = partial(stage.run, condition=condition, side=side)
    inputs = {"friction": friction, "stiffness": stiffness}
    execute(run, inputs, "surface_refined.parquet", common)

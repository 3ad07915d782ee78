"""Fit commands: from a bench recording to a law or a friction coefficient per run."""

from __future__ import annotations

import typer

from beltid.cli.execute import execute
from beltid.cli.inputs import OptionalRig, Points, Press, SpeedLoss, reads_recording
from beltid.cli.program import Common, command


@command("fit-stiffness")
@reads_recording("press", name="force_N: Load", unit="force_N: kN")
def fit_stiffness(press: Press, *, common: Common) -> None:
    """Identify the contact stiffness between ribs and grooves from a compression press.

    The normal force per metre of belt is k_linear * penetration + k_quadratic * penetration².
    Contact point, machine compliance, load cycles and hysteresis are taken into account; a
    statistical test shows whether temperature matters. Writes stiffness.parquet.

    The config states the length of belt under the press (press.segment_length_cm, default 4) and
    the compliance of the press (press.machine_compliance_mm_N, default 0): both scale the law,
    so state your own.

    (columns)

    Example: beltid fit-stiffness press.csv
    """
    from beltid.stages.identification import fit_stiffness as stage

    execute(stage.run, {"press": press}, "stiffness.parquet", common)


@command("fit-slip")
@reads_recording("speedloss", name="torque_N_m: M", unit="torque_N_m: N mm")
def fit_slip(speedloss: SpeedLoss, *, common: Common) -> None:
    """Identify the sliding speeds in service from the speed loss of a two-pulley drive.

    They show at which pulley speeds to run the friction rig for this belt. The sliding speed
    is the speed loss times rig.pulley_radius_m of the config, default 0.05. Writes slip.parquet.

    (columns)

    Example: beltid fit-slip speedloss.csv
    """
    from beltid.stages.identification import fit_slip as stage

    execute(stage.run, {"speedloss": speedloss}, "slip.parquet", common)


@command("fit-friction")
@reads_recording("rig", name="arc_deg: wrap", unit="pulley_speed_rad_s: rpm")
def fit_friction(rig: OptionalRig = None, *, table: Points = None, common: Common) -> None:
    """Find the friction coefficient of every run of the friction rig.

    Each run gives the sliding coefficient (Euler-Eytelwein, over the steady plateau) with its
    standard error, the sticking peak, the sliding speed and the normal force per length. Every
    coefficient depends on the stated contact arc. A run that cannot be used is set aside, and
    the reason is given. Writes friction.parquet.

    Sliding speed and normal force need the radius of the belt's centreline on the pulley: 0.05 m
    unless the config states rig.pulley_radius_m, for recordings of any bench.

    rig.kind of the config states what the rig measures: two_cells (the default), dead_weight,
    torque, torque_hub, or running for a belt that moves.

    (columns)

    With --table, the file has one row per plateau instead of samples over time: arc_deg, the
    forces or torque of rig.kind, pulley_speed_rad_s or slip_speed_m_s, and if known run, mu_se,
    temperature_degC, initial_tension_N, condition, side; or mu and normal_force_N_m themselves.

    Example: beltid fit-friction rig.csv
    """
    from beltid.stages.identification import fit_friction as stage

    if (rig is None) == (table is None):
        raise typer.BadParameter("give a recording, or a table by --table")
    inputs = {"rig": rig} if table is None else {"points": table}
    execute(stage.run, inputs, "friction.parquet", common)

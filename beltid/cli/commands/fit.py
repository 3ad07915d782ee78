"""The fit commands: from a bench recording to a law or a friction coefficient per run."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from beltid.cli.execute import execute
from beltid.cli.inputs import OptionalRig, Points, Press, Rig, SpeedLoss, reads_recording
from beltid.cli.program import Common, command


@command("fit-stiffness")
@reads_recording("press", name="force_N: Load", unit="force_N: kN")
def fit_stiffness(press: Press, *, common: Common) -> None:
    """Find how stiff the contact of ribs and grooves is, from a compression press.

    The normal force per metre of belt is k_linear * penetration + k_quadratic * penetration².
    Contact point, machine compliance, load cycles and hysteresis are taken care of; a test tells
    whether temperature matters. Writes stiffness.parquet.

    The config tells the length of belt under the press (press.segment_length_cm, default 4) and
    the travel that the press itself takes up (press.machine_compliance_mm_N, default 0): both
    scale the law, so state your own.

    (columns)

    Example: beltid fit-stiffness press.csv
    """
    from beltid.stages.identification import fit_stiffness as stage

    execute(stage.run, {"press": press}, "stiffness.parquet", common)


@command("fit-slip")
@reads_recording("speedloss", name="torque_N_m: M", unit="torque_N_m: N mm")
def fit_slip(speedloss: SpeedLoss, *, common: Common) -> None:
    """Find the sliding speeds in service, from the speed loss of a two-pulley drive.

    They tell at which pulley speeds the friction rig has to run for this belt. The sliding speed
    is the speed loss times rig.pulley_radius_m of the config, default 0.05. Writes slip.parquet.

    (columns)

    Example: beltid fit-slip speedloss.csv
    """
    from beltid.stages.identification import fit_slip as stage

    execute(stage.run, {"speedloss": speedloss}, "slip.parquet", common)


@command("fit-shear")
@reads_recording("rig", name="arc_deg: wrap", unit="pulley_speed_rad_s: rpm")
def fit_shear(
    rig: Rig,
    stiffness: Annotated[
        Path | None,
        typer.Option(
            "--stiffness",
            metavar="STIFFNESS",
            help="stiffness.parquet of fit-stiffness: the normal law of this belt, in place of a "
            "usual one that is known to 40 %.",
        ),
    ] = None,
    *,
    common: Common,
) -> None:
    """Find how stiff the ribs are in shear along the belt, from the runs of the friction rig.

    Before the belt slides, the tensions part in proportion to the travel of the pulley: the slope
    tells how far belt, ribs and bench give way. Runs at two contact arcs or more tell the ribs from
    the bench. A run is used if it has eight samples before 30 % of the difference of the tensions
    on the plateau, so only slow runs or fast sampling qualify; otherwise it is said which sampling
    rate would do. Ribs that are too stiff to be seen get a lower bound and no value. Writes
    shear.parquet.

    The config tells axial and bending stiffness of the belt (belt.axial_stiffness_N, default
    100000; belt.bending_stiffness_N_m2, default 0.02) and rig.pulley_radius_m, default 0.05.

    (columns)

    Example: beltid fit-shear rig.csv
    """
    from beltid.stages.identification import fit_shear as stage

    execute(stage.run, {"rig": rig, "stiffness": stiffness}, "shear.parquet", common)


@command("fit-friction")
@reads_recording("rig", name="arc_deg: wrap", unit="pulley_speed_rad_s: rpm")
def fit_friction(rig: OptionalRig = None, *, table: Points = None, common: Common) -> None:
    """Find the friction coefficient of every run of the friction rig.

    Each run gives the sliding coefficient (Euler-Eytelwein, over the steady plateau) with its
    standard error, the sticking peak, the sliding speed and the normal force per length. Every
    coefficient depends on the contact arc that is stated. A run that cannot be used is set aside
    with its reason. Writes friction.parquet.

    Sliding speed and normal force need the radius of the belt's centreline on the pulley: 0.05 m
    unless a config says rig.pulley_radius_m, whatever bench the file is from.

    What the rig measures is rig.kind of the config: two_cells (the default), dead_weight, torque,
    torque_hub, or running for a belt that moves.

    (columns)

    With --table, the file has a row per plateau in place of samples over the time: arc_deg, the
    forces or torque of rig.kind, pulley_speed_rad_s or slip_speed_m_s, and if known run, mu_se,
    temperature_degC, initial_tension_N, condition, side; or mu and normal_force_N_m themselves.

    A CSV file or Parquet files of more than 64 MB (unpacked) are read run by run, so that they need
    not fit into the memory: the rows of a run must stand together.

    Example: beltid fit-friction rig.csv
    """
    if table is not None and rig is None:
        from beltid.stages.identification import fit_friction as stage

        execute(stage.run, {"points": table}, "friction.parquet", common)
        return
    if rig is None or table is not None:
        raise typer.BadParameter("it takes a recording, or a table by --table")
    from beltid.bench.recording import is_big

    with ExitStack() as stack:
        workers = None
        if is_big(rig):
            from beltid.batch.local import local_workers

            workers = stack.enter_context(
                local_workers(None, ("beltid.stages.identification.reduction",))
            )
            workers.prepare()
        from beltid.stages.identification import (
            fit_friction as stage,  # while the workers import, too
        )
        from beltid.stages.reporter import Options

        execute(stage.run, {"rig": rig}, "friction.parquet", common, Options(workers=workers))

"""The fit commands: from a bench recording to a law or a friction coefficient per run."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

from beltid.cli.common import Common, with_common_options
from beltid.cli.execute import execute
from beltid.cli.inputs import Press, Rig, SpeedLoss
from beltid.cli.pool import workers_until
from beltid.cli.program import PlainCommand, app

if TYPE_CHECKING:
    from beltid.cli.talk import TerminalTalk
    from beltid.stages.talk import Options


@app.command(
    "fit-stiffness",
    cls=PlainCommand,
    short_help="PRESS.csv -> stiffness.parquet: the normal contact law",
)
@with_common_options
def fit_stiffness(press: Press, *, common: Common) -> None:
    r"""Find how stiff the contact of ribs and grooves is, from a compression press.

    The normal force per metre of belt is k_linear * penetration + k_quadratic * penetration².
    Contact point, machine compliance, load cycles and hysteresis are taken care of; a test tells
    whether temperature matters. Writes stiffness.parquet.

    The config tells the length of belt under the press (press.segment_length_cm, default 4) and
    the travel that the press itself takes up (press.machine_compliance_mm_N, default 0): both
    scale the law, so state your own.

    \b
    Columns of the CSV (more are ignored):
      test                 text   label of the test
      temperature_degC     °C     may be missing
      time_s               s      from the start of the test
      displacement_mm      mm     travel of the crosshead, growing towards the plate
      force_N              N      force of the press, positive in compression

    Columns of other names or units: say so in the config, such as
    columns: {press: {force_N: Load}}, units: {press: {force_N: kN}}.
    Exports of testing machines and measuring programs are read as they are, known names and units
    are recognised: beltid inspect FILE tells how. Separator, decimal sign and encoding are found
    out, or stated under dialect:.

    Example: beltid fit-stiffness press.csv
    """
    from beltid.stages import fit_stiffness as stage

    execute(stage.run, {"press": press}, "stiffness.parquet", common)


@app.command(
    "fit-slip",
    cls=PlainCommand,
    short_help="SPEEDLOSS.csv -> slip.parquet: sliding speeds in service",
)
@with_common_options
def fit_slip(speedloss: SpeedLoss, *, common: Common) -> None:
    r"""Find the sliding speeds in service, from the speed loss of a two-pulley drive.

    They tell at which pulley speeds the friction rig has to run for this belt. The sliding speed
    is the speed loss times rig.pulley_radius_m of the config, default 0.05. Writes slip.parquet.

    \b
    Columns of the CSV (more are ignored):
      run                  text   label of the operating point
      time_s               s      from the start of the run
      initial_tension_N    N      tension of the belt at rest
      torque_N_m           N m    torque of the driven pulley
      driver_speed_rad_s   rad/s  speed of the driver pulley
      driven_speed_rad_s   rad/s  speed of the driven pulley

    Columns of other names or units: say so in the config, such as
    columns: {speedloss: {torque_N_m: M}}, units: {speedloss: {torque_N_m: N mm}}.
    Exports of testing machines and measuring programs are read as they are, known names and units
    are recognised: beltid inspect FILE tells how. Separator, decimal sign and encoding are found
    out, or stated under dialect:.

    Example: beltid fit-slip speedloss.csv
    """
    from beltid.stages import fit_slip as stage

    execute(stage.run, {"speedloss": speedloss}, "slip.parquet", common)


@app.command(
    "fit-friction",
    cls=PlainCommand,
    short_help="RIG.csv -> friction.parquet: a friction coefficient per run",
)
@with_common_options
def fit_friction(rig: Rig, *, common: Common) -> None:
    r"""Find the friction coefficient of every run of the friction rig.

    Each run gives the sliding coefficient (Euler-Eytelwein, over the steady plateau) with its
    standard error, the sticking peak, the sliding speed and the normal force per length. A run
    that cannot be used is set aside with its reason. Writes friction.parquet.

    Sliding speed and normal force need the radius of the belt's centreline on the pulley: 0.05 m
    unless a config says rig.pulley_radius_m, whatever bench the file is from.

    \b
    Columns of the CSV (more are ignored):
      run                  text   label of the run
      time_s               s      from the start of the run
      tension_tight_N      N      load cell of the tight span
      tension_slack_N      N      load cell of the slack span
      pulley_speed_rad_s   rad/s  0 before the pulley turns
      temperature_degC     °C     may be missing
      arc_deg              °      contact arc of the run: every coefficient depends on it
      initial_tension_N    N      tension before the pulley turns, as it was set

    Columns of other names or units: say so in the config, such as
    columns: {rig: {arc_deg: wrap}}, units: {rig: {pulley_speed_rad_s: rpm}}.
    Exports of testing machines and measuring programs are read as they are, known names and units
    are recognised: beltid inspect FILE tells how. Separator, decimal sign and encoding are found
    out, or stated under dialect:.

    A file of more than 64 MB is read run by run, so that it need not fit into the memory: the rows
    of a run must stand together. So is a folder with Parquet files in folders.

    Example: beltid fit-friction rig.csv
    """
    from beltid.stages import fit_friction as stage

    with ExitStack() as stack:

        def options(talk: TerminalTalk) -> Options:
            from beltid.stages.talk import Options
            from beltid.store.big_recordings import is_big

            workers = workers_until(stack) if is_big(rig) else None
            return Options(force=common.force, talk=talk, workers=workers)

        execute(stage.run, {"rig": rig}, "friction.parquet", common, options)

"""The commands: parse, call a stage, print, exit. No science, no files."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from beltid.cli.common import Common, Version, with_common_options
from beltid.cli.execute import execute, finish
from beltid.cli.signals import Stopped, hear_signals
from beltid.cli.streams import is_of_help, mute, prepare_streams, told
from beltid.errors import EXIT_INPUT

if TYPE_CHECKING:
    from beltid.cli.talk import TerminalTalk
    from beltid.report.summary import Summary
    from beltid.stages.talk import Options

MAIN_HELP = """\
Identify the contact parameters between a V-ribbed belt and a pulley.

From bench recordings to a friction law that is proven on a simulated copy of the bench
(method of Cepon, Manin and Boltezar, 2010):

\b
  press.csv ------ fit-stiffness --> stiffness.parquet ----------------+
  speedloss.csv -- fit-slip -------> slip.parquet                      |
  rig.csv -------- fit-friction ---> friction.parquet                  |
  friction.parquet build-surface --> surface.parquet                   |
  friction.parquet ----------------- refine-surface, with stiffness <--+
                                     --> surface_refined.parquet       v
  surface.parquet or surface_refined.parquet, stiffness.parquet
                   simulate-rig ---> simulated.parquet
  friction.parquet, simulated.parquet
                   compare --------> compare.parquet

`beltid run CONFIG.yaml` does all of it. Results go to stdout, talk and progress to stderr.
"""

EXIT_STATUSES = """\
\b
Exit status:
  0    done
  1    a bug in beltid, with a traceback
  2    the call, the config or an input is wrong; what to mend is said
  3    the numerics failed: no convergence, or no admissible law
  4    compare: the difference is out of tolerance
  5    run: some of several belts failed
  130  interrupted (Ctrl-C)
  143  terminated by the system (129: the terminal hung up)
"""


class PlainCommand(TyperCommand):
    """A command whose help is for somebody who does not know the shell's braces."""

    def get_help(self, ctx: Any) -> str:
        """Help of the command."""
        text: str = super().get_help(ctx)
        return text.replace("<list[Path]>", "<path>      ")

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Names of the arguments without the braces, which look like alternatives."""
        return [piece.strip("{}") for piece in super().collect_usage_pieces(ctx)]


app = typer.Typer(
    name="beltid",
    help=MAIN_HELP,
    epilog=EXIT_STATUSES,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    no_args_is_help=True,
    context_settings={"help_option_names": ["--help", "-h"], "max_content_width": 100},
)


@app.callback()
def _top(version: Version = False) -> None:
    pass


def _input(what: str, metavar: str) -> typer.models.ArgumentInfo:
    argument: typer.models.ArgumentInfo = typer.Argument(metavar=metavar, help=what)
    return argument


Press = Annotated[Path, _input("Recording of the compression press (CSV).", "PRESS")]
SpeedLoss = Annotated[Path, _input("Recording of the speed-loss bench (CSV).", "SPEEDLOSS")]
Rig = Annotated[Path, _input("Recording of the friction rig (CSV or Parquet).", "RIG")]
Friction = Annotated[Path, _input("friction.parquet of fit-friction.", "FRICTION")]
Surface = Annotated[
    Path, _input("surface.parquet of build-surface or surface_refined.parquet.", "SURFACE")
]
Stiffness = Annotated[Path, _input("stiffness.parquet of fit-stiffness.", "STIFFNESS")]
Simulated = Annotated[
    Path,
    _input(
        "simulated.parquet of simulate-rig. A recording with the columns of rig.csv is reduced in "
        "the same way: so two benches, or a bench and another program, can be compared.",
        "SIMULATED",
    ),
]
Jobs = Annotated[
    int | None,
    typer.Option(
        "--jobs", "-j", min=1, help="Runs simulated at the same time. Default: one per core."
    ),
]


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
    Separator, decimal sign and encoding are found out, or stated under dialect:.

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
    Separator, decimal sign and encoding are found out, or stated under dialect:.

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
    Separator, decimal sign and encoding are found out, or stated under dialect:.

    Example: beltid fit-friction rig.csv
    """
    from beltid.stages import fit_friction as stage

    execute(stage.run, {"rig": rig}, "friction.parquet", common)


@app.command(
    "build-surface",
    cls=PlainCommand,
    short_help="friction -> surface.parquet: friction over force and speed",
)
@with_common_options
def build_surface(friction: Friction, *, common: Common) -> None:
    """Build the friction surface: the coefficient over normal force and sliding speed.

    One surface per contact arc and their average, as bicubic splines through the measured
    values; outside the measured range the nearest measured value holds. Writes surface.parquet.

    Example: beltid build-surface friction.parquet
    """
    from beltid.stages import build_surface as stage

    execute(stage.run, {"friction": friction}, "surface.parquet", common)


@app.command(
    "refine-surface",
    cls=PlainCommand,
    short_help="friction, stiffness -> surface_refined.parquet: without the bias",
)
@with_common_options
def refine_surface(friction: Friction, stiffness: Stiffness, *, common: Common) -> None:
    """Find the friction surface with which the simulated rig gives the measured tensions.

    The published procedure gives each coefficient the mean force on the arc, which ignores that
    a stiff belt presses harder where it enters and leaves the pulley. Here the surface is solved
    for, all arcs together; its smoothness is chosen by the data. Shows what is left of the
    difference between simulated and measured coefficients. Writes surface_refined.parquet.

    Example: beltid refine-surface friction.parquet stiffness.parquet
    """
    from beltid.stages import refine_surface as stage

    inputs = {"friction": friction, "stiffness": stiffness}
    execute(stage.run, inputs, "surface_refined.parquet", common)


@app.command(
    "simulate-rig",
    cls=PlainCommand,
    short_help="surface, stiffness -> simulated.parquet: the rig again",
)
@with_common_options
def simulate_rig(
    surface: Surface,
    stiffness: Stiffness,
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
            help="Only runs with this contact arc, one of rig.arcs_deg of the config; "
            "may be repeated.",
        ),
    ] = None,
    tension: Annotated[
        list[float] | None,
        typer.Option(
            metavar="N",
            help="Only runs with this initial tension, one of rig.initial_tensions_N of the "
            "config; may be repeated.",
        ),
    ] = None,
    speed: Annotated[
        list[float] | None,
        typer.Option(
            metavar="RAD/S",
            help="Only runs with this pulley speed, one of rig.pulley_speeds_rad_s of the config; "
            "may be repeated.",
        ),
    ] = None,
    elements: Annotated[
        int | None,
        typer.Option(
            min=4,
            max=2000,
            metavar="EVEN NUMBER",
            help="Beam elements of the belt, an even number: as many on either half of the arc. "
            "Default: as the config says, else by its stiffness.",
        ),
    ] = None,
    profile_time: Annotated[
        list[float] | None,
        typer.Option(
            metavar="SECONDS",
            help="Also write the contact along the arc at this time after the pulley starts to "
            "turn (pressure, friction, slip, tension, who sticks), to <result>_profiles.parquet; "
            "may be repeated. Method transient only.",
        ),
    ] = None,
    jobs: Jobs = None,
    *,
    common: Common,
) -> None:
    """Repeat the runs of the friction rig on the computer, with the identified contact.

    A flexible belt (ANCF beam elements) is laid on the pulley, tightened, and the pulley turned:
    stick, slip and full sliding. All arcs, tensions and speeds of the config, or those picked.
    Writes simulated.parquet with the columns of a bench recording; runs picked by --arc, --tension
    or --speed go to simulated_part.parquet, so that a part never replaces the whole campaign.

    Example: beltid simulate-rig surface.parquet stiffness.parquet --arc 82
    """
    from beltid.stages import simulate_rig as stage

    def options(talk: TerminalTalk) -> Options:
        return stage.SimulateOptions(
            force=common.force,
            talk=talk,
            method=method,
            arcs_deg=tuple(arc or ()),
            tensions_N=tuple(tension or ()),
            speeds_rad_s=tuple(speed or ()),
            elements=elements,
            jobs=jobs,
            profile_times_s=tuple(profile_time or ()),
        )

    name = "simulated_part.parquet" if arc or tension or speed else "simulated.parquet"
    inputs = {"surface": surface, "stiffness": stiffness}
    execute(stage.run, inputs, name, common, options)


@app.command(
    "compare", cls=PlainCommand, short_help="friction, simulated -> compare.parquet: do they agree?"
)
@with_common_options
def compare(friction: Friction, simulated: Simulated, *, common: Common) -> None:
    """Compare the simulated with the measured friction coefficients; exit 0 or 4.

    The simulated recording goes through the same reduction as the measured one. Differences per
    arc, averaged over arcs, and for low, middle and high normal force. Runs are matched by arc,
    tension and speed.

    Tolerances by default: RMS 6 %, mean magnitude 5 %, largest 20 %; others under compare: in the
    config. Exit 4, too, if fewer than half of the usable measured runs have a simulated partner.
    Writes compare.parquet.

    Example: beltid compare friction.parquet simulated.parquet
    """
    from beltid.stages import compare as stage

    inputs = {"friction": friction, "simulated": simulated}
    execute(stage.run, inputs, "compare.parquet", common)


@app.command("run", cls=PlainCommand, short_help="CONFIG.yaml -> runs/<belt>/: all of the above")
@with_common_options(
    out_help="Folder of the results, one folder per belt in it. Default: runs",
    out_names=("--runs-dir",),
)
def run(
    configs: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="CONFIG",
            help="Configs, one per belt. Each names its recordings under data: press and rig are "
            "needed, speedloss may be left out. Default: the config of --config, else the one "
            "that the environment variable BELTID_CONFIG names.",
        ),
    ] = None,
    jobs: Jobs = None,
    *,
    common: Common,
) -> None:
    """Run the whole chain for one belt or several: from the recordings to the comparison.

    Stiffness, sliding speeds, friction, the surface as published and refined; the rig is simulated
    with both surfaces, and both are compared. Results go to runs/<belt>/. What is up to date is
    kept, so that a second run does nothing. A belt that fails does not stop the others.

    Example: beltid run configs/4pk.yaml configs/5pk.yaml
    """
    from beltid.batch import BatchOptions, config_sources, run_batch

    folder = common.out or Path("runs")

    def work(talk: TerminalTalk) -> Summary:
        sources = config_sources(configs or [], common.config)
        return run_batch(sources, folder, BatchOptions(force=common.force, talk=talk, jobs=jobs))

    finish(work, common, kept=f"what was finished stands in {folder}")


def main() -> None:
    """Entry point of the command line."""
    prepare_streams()
    hear_signals()
    try:
        app()
    except Stopped as stopped:  # before or after the work; the work says itself what it kept
        typer.echo(f"error: {stopped.word}", err=True)
        sys.exit(stopped.exit_status)
    except OSError as error:
        if not is_of_help(error):
            raise
        mute("stdout")
        typer.echo(f"error: {told(error)}", err=True)
        sys.exit(EXIT_INPUT)

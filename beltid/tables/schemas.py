"""All tables that are read or written: a line per column with its name, values, unit, meaning.

``name?`` is a column that a table may lack: in an artifact, a diagnostic beside its public columns.
The values are a range, ``number`` (any finite one), ``count``, ``flag``, ``text``, a choice of
words, or a list of numbers; with ``?``, a value may be missing. The head of a table names its kind,
what writes it, and the column with the label of a run.
"""

import math
import re
from dataclasses import dataclass, replace
from typing import Literal

RANGE = re.compile(r"(>=?) (\S+)|([\[(])(\S+), (\S+)([\])])")
LENGTH_OF_LIST = re.compile(r"list(?: of (\d+))?")


@dataclass(frozen=True, slots=True)
class Column:
    """One column of a table.

    The unit of its public `name` is the suffix; `unit` is "" for none and "1" for a dimensionless
    number. A `nullable` column may miss values (nan, or None among texts), a table may lack one
    that is not `required`. Lists hold float64 and have the same `length` in all rows (0: any).
    """

    name: str
    dtype: Literal["float64", "int64", "bool", "string", "list"]
    unit: str
    meaning: str
    nullable: bool = False
    low: float = -math.inf
    high: float = math.inf
    open_low: bool = False
    open_high: bool = False
    required: bool = True
    length: int = 0
    choices: tuple[str, ...] = ()

    @property
    def allowed(self) -> str:
        """Allowed range as text, ``> 0`` or ``in (0, 360)``, or the allowed texts."""
        if self.choices:
            return " or ".join(filter(None, [", ".join(self.choices[:-1]), self.choices[-1]]))
        return interval(self.low, self.high, open_low=self.open_low, open_high=self.open_high)


def interval(low: float, high: float, *, open_low: bool, open_high: bool) -> str:
    """Format a range: ``> 0``, ``in (0, 360)``, or ``finite`` without bounds."""
    if math.isinf(low) and math.isinf(high):
        return "finite"
    if math.isinf(high):
        return f"{'>' if open_low else '>='} {low:g}"
    return f"in {'[('[open_low]}{low:g}, {high:g}{'])'[open_high]}"


@dataclass(frozen=True, slots=True)
class Table:
    """One kind of table: what writes it, and the column with the label of a run ("": none)."""

    kind: str
    command: str
    label: str
    columns: tuple[Column, ...]
    version: int = 1

    def column(self, name: str) -> Column:
        """Return a column by name; KeyError if there is none."""
        return {column.name: column for column in self.columns}[name]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all columns, in order."""
        return tuple(column.name for column in self.columns)


def table_of(text: str) -> Table:
    """Read a table from its text: its head, and a line per column."""
    head, *lines = text.splitlines()
    kind, _, by = head.partition(": ")
    command, _, label = by.partition(", by ")
    return Table(kind, command, label, tuple(map(column_of, lines)))


def column_of(line: str) -> Column:
    """Read a column from its line: name, values, unit, meaning, with two blanks between them."""
    name, values, unit, meaning = re.split(" {2,}", line.strip())
    kind = values.removesuffix("?")
    words = {"count": "int64", "flag": "bool", "text": "string"}
    dtype = words.get(kind, "list" if LENGTH_OF_LIST.match(kind) else "float64")
    more: dict[str, object] = {"nullable": kind != values, "required": not name.endswith("?")}
    if " | " in kind:
        dtype, more["choices"] = "string", tuple(kind.split(" | "))
    elif kind == "count":
        more["low"] = 0.0
    elif of := LENGTH_OF_LIST.match(kind):
        more["length"] = int(of[1] or 0)
    elif of := RANGE.fullmatch(kind):
        more |= {"low": float(of[2] or of[4]), "open_low": (of[1] or of[3]) in (">", "(")}
        more |= {"high": float(of[5] or "inf"), "open_high": of[6] == ")"}
    elif kind not in (*words, "number"):
        raise ValueError(f"{line}: cannot be read as a column")
    return Column(name.removesuffix("?"), dtype, unit.removeprefix("-"), meaning, **more)  # type: ignore[arg-type]


TABLES: dict[str, Table] = {
    table.kind: table
    for table in map(
        table_of,
        """
press: the compression press, by test
test               text         -      label of the test
temperature_degC?  [-90, 200]?  degC   temperature
time_s             number       s      time from the start of the recording
displacement_mm    number?      mm     travel of the crosshead, towards the plate
force_N            number?      N      force of the press, positive in compression

rig: the friction rig, by run
run                 text                -      label of the run
time_s              number              s      time from the start of the recording
tension_tight_N     > 0?                N      tension of the tight span
tension_slack_N     > 0?                N      tension of the slack span
pulley_speed_rad_s  number?             rad/s  speed of the pulley, 0 before it turns
temperature_degC?   [-90, 200]?         degC   temperature
arc_deg             (0, 3600]           deg    contact arc
initial_tension_N   > 0                 N      nominal tension before the pulley turns
weight_N?           > 0                 N      dead weight that one span carries
torque_N_m?         number?             N m    of the belt on the pulley, > 0 as the tight span
hub_force_N?        >= 0?               N      force of the belt on the pulley's axis
belt_speed_m_s?     number?             m/s    speed of the belt
idle?               true | false?       -      whether the pulley turned without the belt
condition?          dry | wet | dusty?  -      surface
side?               rib | back?         -      side of the belt on the pulley

points: the friction rig, as a table of its plateaus, by run
run?                 text                -      label of the run
arc_deg?             (0, 3600]?          deg    contact arc
tension_tight_N?     >= 0?               N      tension of the tight span
tension_slack_N?     >= 0?               N      tension of the slack span
weight_N?            >= 0?               N      dead weight that one span carries
torque_N_m?          number?             N m    of the belt on the pulley, > 0 as the tight span
hub_force_N?         >= 0?               N      force of the belt on the pulley's axis
belt_speed_m_s?      number?             m/s    speed of the belt
pulley_speed_rad_s?  number?             rad/s  speed of the pulley
slip_speed_m_s?      number?             m/s    sliding speed
mu?                  number?             1      friction coefficient while sliding
mu_se?               >= 0?               1      standard error
normal_force_N_m?    >= 0?               N/m    normal force per length
temperature_degC?    [-90, 200]?         degC   temperature
initial_tension_N?   > 0?                N      nominal tension before the pulley turns
idle?                true | false?       -      whether the pulley turned without the belt
condition?           dry | wet | dusty?  -      surface
side?                rib | back?         -      side of the belt on the pulley

speedloss: the speed-loss bench, by run
run                 text     -      label of the operating point
time_s              number   s      time from the start of the recording
initial_tension_N   > 0      N      tension of the belt at rest
torque_N_m          number?  N m    torque of the driven pulley
driver_speed_rad_s  number?  rad/s  speed of the driver pulley
driven_speed_rad_s  number?  rad/s  speed of the driven pulley

stiffness: beltid fit-stiffness
temperature_degC     number?  degC   temperature; null for the pooled law
k_linear_N_m2        >= 0     N/m²   linear coefficient of Eq. (3)
k_quadratic_N_m3     >= 0     N/m³   quadratic coefficient of Eq. (3)
k_linear_se_N_m2     >= 0?    N/m²   standard error
k_quadratic_se_N_m3  >= 0?    N/m³   standard error
covariance           list of 4?  N²/m⁴, N²/m⁵, N²/m⁵, N²/m⁶  of (k_linear, k_quadratic), by rows
contact_offset_mm    number?  mm     travel of the crosshead at first contact
rms_residual_N_m     >= 0?    N/m    root mean square of the residual
hysteresis_ratio     >= 0?    1      dissipated over stored energy
max_penetration_m    > 0      m      deepest penetration of the fit
max_force_N_m        > 0      N/m    largest line force of the fit
n_samples            count    1      samples used
k_linear_u_N_m2?     >= 0?    N/m²   combined standard uncertainty
k_quadratic_u_N_m3?  >= 0?    N/m³   combined standard uncertainty
n_cycles?            count    1      load cycles used
n_set_aside?         count    1      samples set aside
notes?               text?    -      what the user should know

slip: beltid fit-slip
driver_speed_rad_s  number?  rad/s  speed of the driver pulley
initial_tension_N   > 0?     N      tension of the belt at rest
torque_N_m          number?  N m    torque of the driven pulley
speed_loss_rad_s    number?  rad/s  driver minus driven speed
slip_speed_m_s      number?  m/s    sliding speed, Eq. (7)
slip_speed_se_m_s   >= 0?    m/s    standard error
run?                text     -      label of the operating point
n_samples?          count    1      samples used
status?             text     -      ok, or why it was set aside
notes?              text?    -      what the user should know

friction: beltid fit-friction, by run
run                  text                -      label of the run
arc_deg              (0, 3600]?          deg    contact arc
initial_tension_N    > 0?                N      tension measured at rest
nominal_tension_N    > 0?                N      nominal tension of the run
pulley_speed_rad_s   number?             rad/s  speed of the pulley on the plateau
slip_speed_m_s       number?             m/s    sliding speed omega R
tension_tight_N      > 0?                N      tension of the tight span, sliding
tension_slack_N      > 0?                N      tension of the slack span, sliding
mu_sliding           number?             1      friction coefficient while sliding, Eq. (6)
mu_sliding_se        >= 0?               1      standard error
mu_sticking          number?             1      friction coefficient at the sticking peak
normal_force_N_m     >= 0?               N/m    mean of Eq. (8) over the arc
temperature_degC     number?             degC   temperature
n_samples            count               1      samples of the plateau
status               text                -      ok, or why it was set aside
mu_sliding_u?        >= 0?               1      combined standard uncertainty
normal_force_u_N_m?  >= 0?               N/m    combined standard uncertainty
mu_sticking_se?      >= 0?               1      standard error
imbalance_N?         number?             N      tight minus slack cell at rest
imbalance_se_N?      >= 0?               N      standard error
shared_tail?         number?             1      of ln mu, all runs: one sd of the shape of the tail
shared_drift?        number?             1      of ln mu, all runs: one sd of cells or belt drifting
shared_cells?        number?             1      of ln mu, all runs: one sd of the cells' zeros
momentum_N?          >= 0                N      m v² of a running belt, taken off its tensions
torque_with?         tight | slack?      -      span whose tension was measured with a torque
start_time_s?        number?             s      start of the rotation
peak_time_s?         number?             s      time of the sticking peak
plateau_start_s?     number?             s      start of the sliding plateau
plateau_end_s?       number?             s      end of the sliding plateau
condition?           dry | wet | dusty?  -      surface
side?                rib | back?         -      side of the belt on the pulley
notes?               text?               -      what the user should know

surface: beltid build-surface
arc_deg           (0, 3600]?  deg    contact arc; null for the average
normal_force_N_m  > 0         N/m    normal force per length
slip_speed_m_s    > 0         m/s    sliding speed
mu                > 0?        1      friction coefficient
mu_se             >= 0?       1      standard error
n_arcs            count       1      arcs that were averaged
mu_spread?        >= 0?       1      standard deviation between arcs
measured?         flag        -      whether the node lies within the measured range
mu_u?             >= 0?       1      combined standard uncertainty (k = 1)
mu_factor?        list?       1      row of the factor of the covariance of ln mu

compare: beltid compare, by run
run                   text        -      label of the measured run
arc_deg               (0, 3600]?  deg    contact arc
nominal_tension_N     > 0?        N      nominal tension of the run
pulley_speed_rad_s    number?     rad/s  speed of the pulley
mu_measured           number?     1      measured friction coefficient
mu_simulated          number?     1      simulated friction coefficient
difference            number?     1      simulated minus measured
within_tolerance      flag        -      whether the point is within tolerance
relative_difference?  number?     1      difference over measured
mu_measured_se?       >= 0?       1      standard error
normal_force_N_m?     >= 0?       N/m    mean of Eq. (8), measured
slip_speed_m_s?       number?     m/s    sliding speed omega R
u_measured?           >= 0?       1      standard uncertainty of mu_measured
u_input?              >= 0?       1      of mu_simulated, from its inputs
u_numerical?          >= 0?       1      of mu_simulated, from its mesh
u_validation?         >= 0?       1      standard uncertainty of difference
e_over_u?             number?     1      difference over u_validation
status?               text        -      ok, or why the point is not compared

drive: beltid simulate-drive, by run
point                      count    1      number of the operating point, from 1
run                        text     -      label of the measured run, or of the point
pulley                     text     -      name of the pulley
driver_speed_rad_s         number   rad/s  speed of the driver pulley
initial_tension_N          > 0      N      of the belt at rest, or of the slack span
torque_N_m                 number?  N m    delivered by the driver, or taken off
speed_rad_s                number?  rad/s  speed of the pulley, in the sign of the driver's
speed_loss_rad_s           number?  rad/s  speed at idle minus speed under load
speed_loss_u_rad_s         >= 0?    rad/s  its standard uncertainty
loss_creep_rad_s           number?  rad/s  part of the loss from the stretch of the belt
loss_seating_rad_s         number?  rad/s  part from the penetration of the ribs
loss_slip_rad_s            number?  rad/s  part from pulleys that slide as a whole
tension_in_N               >= 0?    N      axial force where the belt enters
tension_out_N              >= 0?    N      axial force where the belt leaves
hub_force_N                >= 0?    N      force of the belt on the axis
hub_angle_deg              number?  deg    its direction, anticlockwise from the x axis
wrap_deg                   >= 0     deg    arc between the tangent points
arc_used_deg               >= 0?    deg    arc that slides
reserve                    >= 0?    1      wrap over the arc needed; null on an idler
slip_speed_max_m_s         >= 0?    m/s    largest sliding speed
normal_force_min_N_m       >= 0?    N/m    smallest line force
normal_force_max_N_m       >= 0?    N/m    largest line force
share_below_speed_range    >= 0?    1      of the friction: slower than measured
share_outside_force_range  >= 0?    1      of the friction: outside the measured forces
friction_power_W           number?  W      lost to friction, without the hysteresis of the belt
status                     text     -      adhesion, full slip, gross slip or slack
steady_states?             count    1      states with which the arc carries its forces
span_frequency_Hz?         >= 0?    Hz     lowest natural frequency of the span behind

compare_drive: beltid compare-drive, by run
run                   text     -      label of the measured run
driver_speed_rad_s    number?  rad/s  speed of the driver pulley
initial_tension_N     > 0?     N      tension of the belt at rest
torque_N_m            number?  N m    torque of the driven pulley
loss_measured_rad_s   number?  rad/s  measured speed loss
loss_predicted_rad_s  number?  rad/s  predicted speed loss
difference_rad_s      number?  rad/s  predicted minus measured
relative_difference   number?  1      difference over measured
u_measured_rad_s      >= 0?    rad/s  of the measured loss
u_input_rad_s         >= 0?    rad/s  of the predicted loss
u_validation_rad_s    >= 0?    rad/s  of the difference
e_over_u              number?  1      difference over its standard uncertainty
loss_creep_rad_s      number?  rad/s  predicted part from the stretch of the belt
loss_seating_rad_s    number?  rad/s  predicted part from the penetration of the ribs
loss_slip_rad_s       number?  rad/s  predicted part from pulleys that slide as a whole
arc_share             >= 0?    1      largest share of an arc that slides
judged                flag     -      whether the point counts in the verdict
status                text     -      ok, or why the point is not judged

press_curves: beltid run, by test
test              text     -      label of the test
temperature_degC  number?  degC   temperature
cycle             count    1      number of the cycle, from 1
branch            text     -      loading or unloading
penetration_m     number?  m      from the contact of the law, < 0 before it
line_force_N_m    number?  N/m    force per length of belt

rig_curves: beltid run, by run
run                 text     -      label of the run
time_s              number   s      time from the start of the recording
tension_tight_N     number?  N      of the tight span, cells corrected
tension_slack_N     number?  N      of the slack span, cells corrected
mu                  number?  1      apparent friction coefficient of them, Eq. (6)
pulley_speed_rad_s  number?  rad/s  speed of the pulley
""".strip().split("\n\n"),
    )
}
TABLES["crossvalidation"] = replace(
    TABLES["compare"], kind="crossvalidation", command="beltid cross-validate"
)
TABLES["simulated"] = replace(
    TABLES["rig"],
    kind="simulated",
    command="beltid simulate-rig",
    columns=TABLES["rig"].columns[:8],
)
RECORDINGS = ("press", "rig", "speedloss", "points")
ARTIFACTS = tuple(kind for kind in TABLES if kind not in RECORDINGS)
CONDITIONS = ("condition", "side")  # of a run
WHERE_KNOWN = (*CONDITIONS, "momentum_N", "torque_with")  # of some rigs
RUN_TEXTS = ("idle", *CONDITIONS)  # may be empty
NOMINAL = ("arc_deg", "initial_tension_N", "weight_N")  # constant within a run
SETTINGS = (*NOMINAL, "temperature_degC", "belt_speed_m_s", *RUN_TEXTS)
"""Columns with one value per run."""
CELLS = ("tension_tight_N", "tension_slack_N")
CHANNELS = (*CELLS, "weight_N", "torque_N_m", "hub_force_N", "belt_speed_m_s", "idle")
"""Columns of a rig of which each bench has some."""


def table(kind: str) -> Table:
    """Return the table of a kind."""
    return TABLES[kind]


def rig_table(
    measures: str = "two_cells", weight_on: str = "tight", *, running: bool = False
) -> Table:
    """Return the table of a friction-rig recording for what the rig measures."""
    required = {
        "two_cells": CELLS,
        "dead_weight": ("weight_N", CELLS[weight_on == "tight"]),
        "torque": ("torque_N_m",),
        "torque_hub": ("torque_N_m", "hub_force_N"),
    }[measures]
    optional = {*CELLS, "weight_N"} if measures == "torque" else set()
    optional |= {"idle"} if "torque_N_m" in required else set()
    optional |= {"belt_speed_m_s"} if running else set()
    if measures != "two_cells" or running:  # only two cells at a belt at rest need it
        optional.add("initial_tension_N")
    return replace(
        TABLES["rig"],
        columns=tuple(
            replace(c, required=c.name in required, nullable=c.nullable or c.name in optional)
            if c.name in {*required, *optional}
            else c
            for c in TABLES["rig"].columns
            if c.name in {*required, *optional} or c.name not in CHANNELS
        ),
    )

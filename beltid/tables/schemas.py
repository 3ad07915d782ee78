"""Definitions of all tables that are read or written.

They are the bench recordings (press, rig, speedloss, points) and the artifacts. Optional columns of
an artifact are diagnostics in addition to its public columns.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from beltid.tables.columns import (
    Column,
    Table,
    count,
    nonnegative,
    numbers,
    optional,
    positive,
    real,
    standard_error,
    text,
    uncertainty,
)

__all__ = ["ARTIFACTS", "RECORDINGS", "TABLES", "Column", "Table", "table"]

_RUN = text("run", "label of the run")
_TEST = text("test", "label of the test")
_TIME = real("time_s", "s", "time from the start of the recording", nullable=False)
_TEMPERATURE = Column(
    "temperature_degC", "float64", "degC", "temperature", True, -90.0, 200.0, required=False
)
_ARC = Column("arc_deg", "float64", "deg", "contact arc", False, 0.0, 3600.0, open_low=True)
_PULLEY_SPEED = real("pulley_speed_rad_s", "rad/s", "speed of the pulley")
_FORCE = nonnegative("normal_force_N_m", "N/m", "mean of Eq. (8) over the arc", nullable=True)
_SLIDING_SPEED = real("slip_speed_m_s", "m/s", "sliding speed omega R")
_SET_TENSION = positive("nominal_tension_N", "N", "nominal tension of the run", nullable=True)
_STATUS = text("status", "ok, or why it was set aside")
_NOTES = text("notes", "what the user should know", nullable=True)
_TIGHT = positive("tension_tight_N", "N", "tension of the tight span", nullable=True)
_SLACK = positive("tension_slack_N", "N", "tension of the slack span", nullable=True)
_INITIAL = positive("initial_tension_N", "N", "nominal tension before the pulley turns")
_RIG = (
    _RUN,
    _TIME,
    _TIGHT,
    _SLACK,
    replace(_PULLEY_SPEED, meaning="speed of the pulley, 0 before it turns"),
    _TEMPERATURE,
    _ARC,
    _INITIAL,
)
_OTHER_CHANNELS = (
    positive("weight_N", "N", "dead weight that one span carries"),
    real("torque_N_m", "N m", "torque of the belt on the pulley, > 0 where the tight span pulls"),
    nonnegative("hub_force_N", "N", "force of the belt on the pulley's axis", nullable=True),
    real("belt_speed_m_s", "m/s", "speed of the belt"),
)
_IDLE = Column(
    "idle",
    "string",
    "",
    "whether the pulley turned without the belt, for the drag of its bearings",
    True,
    choices=("true", "false"),
)
_CONDITIONS = (
    Column("condition", "string", "", "surface", True, choices=("dry", "wet", "dusty")),
    Column("side", "string", "", "side of the belt on the pulley", True, choices=("rib", "back")),
)
CONDITIONS: Final = tuple(column.name for column in _CONDITIONS)
"""Columns with the conditions of a run."""
_TENSIONS_FROM = (
    nonnegative("momentum_N", "N", "m v² of a running belt, subtracted from its tensions"),
    Column(
        "torque_with",
        "string",
        "",
        "span whose tension was measured together with a torque",
        True,
        choices=("tight", "slack"),
    ),
)
WHERE_KNOWN: Final = (*CONDITIONS, *(column.name for column in _TENSIONS_FROM))
"""Columns of the friction table that only some rigs and recordings provide."""
RUN_TEXTS: Final = (_IDLE.name, *CONDITIONS)
"""Columns of a recording that stay empty if they are not stated."""


_ANY_RIG = Table(
    "rig",
    1,
    "the friction rig",
    (*_RIG, *optional(*_OTHER_CHANNELS, _IDLE, *_CONDITIONS)),
    label="run",
)
_POINTS = Table(
    "points",
    1,
    "the friction rig, as a table of its plateaus",
    optional(
        _RUN,
        replace(_ARC, nullable=True),
        *(
            replace(column, low=0.0, open_low=False, nullable=True)
            for column in (_TIGHT, _SLACK, _OTHER_CHANNELS[0])
        ),
        *_OTHER_CHANNELS[1:],
        _PULLEY_SPEED,
        real("slip_speed_m_s", "m/s", "sliding speed"),
        real("mu", "1", "friction coefficient while sliding"),
        standard_error("mu_se", "1"),
        replace(_FORCE, meaning="normal force per length"),
        _TEMPERATURE,
        replace(_INITIAL, nullable=True),
        _IDLE,
        *_CONDITIONS,
    ),
    label="run",
)

_POINT = replace(_RUN, meaning="label of the operating point")

_DRIVER_SPEED = real("driver_speed_rad_s", "rad/s", "speed of the driver pulley")

_PRESS = Table(
    "press",
    1,
    "the compression press",
    (
        _TEST,
        _TEMPERATURE,
        _TIME,
        real("displacement_mm", "mm", "travel of the crosshead, growing towards the plate"),
        real("force_N", "N", "force of the press, positive in compression"),
    ),
    label="test",
)
_SPEEDLOSS = Table(
    "speedloss",
    1,
    "the speed-loss bench",
    (
        _POINT,
        _TIME,
        positive("initial_tension_N", "N", "tension of the belt at rest"),
        real("torque_N_m", "N m", "torque of the driven pulley"),
        _DRIVER_SPEED,
        real("driven_speed_rad_s", "rad/s", "speed of the driven pulley"),
    ),
    label="run",
)
_STIFFNESS = Table(
    "stiffness",
    1,
    "beltid fit-stiffness",
    (
        real("temperature_degC", "degC", "temperature; null for the pooled law"),
        nonnegative("k_linear_N_m2", "N/m²", "linear coefficient of Eq. (3)"),
        nonnegative("k_quadratic_N_m3", "N/m³", "quadratic coefficient of Eq. (3)"),
        standard_error("k_linear_se_N_m2", "N/m²"),
        standard_error("k_quadratic_se_N_m3", "N/m³"),
        Column(
            "covariance",
            "list",
            "N²/m⁴, N²/m⁵, N²/m⁵, N²/m⁶",
            "covariance of (k_linear, k_quadratic), row by row",
            nullable=True,
        ),
        real("contact_offset_mm", "mm", "travel of the crosshead at first contact"),
        nonnegative("rms_residual_N_m", "N/m", "root mean square of the residual", nullable=True),
        nonnegative("hysteresis_ratio", "1", "dissipated over stored energy", nullable=True),
        positive("max_penetration_m", "m", "deepest penetration of the fit"),
        positive("max_force_N_m", "N/m", "largest line force of the fit"),
        count("n_samples", "samples used"),
        *optional(
            uncertainty("k_linear_u_N_m2", "N/m²"),
            uncertainty("k_quadratic_u_N_m3", "N/m³"),
            count("n_cycles", "load cycles used"),
            count("n_set_aside", "samples set aside"),
            _NOTES,
        ),
    ),
)
_SLIP = Table(
    "slip",
    1,
    "beltid fit-slip",
    (
        _DRIVER_SPEED,
        positive("initial_tension_N", "N", "tension of the belt at rest", nullable=True),
        real("torque_N_m", "N m", "torque of the driven pulley"),
        real("speed_loss_rad_s", "rad/s", "driver minus driven speed"),
        real("slip_speed_m_s", "m/s", "sliding speed, Eq. (7)"),
        standard_error("slip_speed_se_m_s", "m/s"),
        *optional(
            _POINT,
            count("n_samples", "samples used"),
            _STATUS,
            _NOTES,
        ),
    ),
)
_FRICTION = Table(
    "friction",
    1,
    "beltid fit-friction",
    (
        _RUN,
        replace(_ARC, nullable=True),
        positive("initial_tension_N", "N", "tension measured at rest", nullable=True),
        _SET_TENSION,
        replace(_PULLEY_SPEED, meaning="speed of the pulley on the plateau"),
        _SLIDING_SPEED,
        positive("tension_tight_N", "N", "tension of the tight span, sliding", nullable=True),
        positive("tension_slack_N", "N", "tension of the slack span, sliding", nullable=True),
        real("mu_sliding", "1", "friction coefficient while sliding, Eq. (6)"),
        standard_error("mu_sliding_se", "1"),
        real("mu_sticking", "1", "friction coefficient at the sticking peak"),
        _FORCE,
        real("temperature_degC", "degC", "temperature"),
        count("n_samples", "samples of the plateau"),
        _STATUS,
        *optional(
            uncertainty("mu_sliding_u", "1"),
            uncertainty("normal_force_u_N_m", "N/m"),
            standard_error("mu_sticking_se", "1"),
            real("imbalance_N", "N", "tight minus slack cell at rest"),
            standard_error("imbalance_se_N", "N"),
            *(
                real(name, "1", f"change of ln mu by one standard deviation of {of}, in all runs")
                for name, of in (
                    ("shared_tail", "the shape of the tail"),
                    ("shared_drift", "a drift of the cells or a relaxation of the belt"),
                    ("shared_cells", "zero points of the cells at rest"),
                )
            ),
            *_TENSIONS_FROM,
            real("start_time_s", "s", "start of the rotation"),
            real("peak_time_s", "s", "time of the sticking peak"),
            real("plateau_start_s", "s", "start of the sliding plateau"),
            real("plateau_end_s", "s", "end of the sliding plateau"),
            *_CONDITIONS,
            _NOTES,
        ),
    ),
    label="run",
)
_SURFACE = Table(
    "surface",
    1,
    "beltid build-surface",
    (
        replace(_ARC, nullable=True, meaning="contact arc; null for the average"),
        positive("normal_force_N_m", "N/m", "normal force per length"),
        positive("slip_speed_m_s", "m/s", "sliding speed"),
        positive("mu", "1", "friction coefficient", nullable=True),
        standard_error("mu_se", "1"),
        count("n_arcs", "arcs that were averaged"),
        *optional(
            nonnegative("mu_spread", "1", "standard deviation between arcs", nullable=True),
            Column("measured", "bool", "", "whether the node lies within the measured range"),
            nonnegative("mu_u", "1", "combined standard uncertainty (k = 1)", nullable=True),
            numbers("mu_factor", "1", "row of the factor of the covariance of ln mu"),
        ),
    ),
)
_COMPARE = Table(
    "compare",
    1,
    "beltid compare",
    (
        text("run", "label of the measured run"),
        replace(_ARC, nullable=True),
        _SET_TENSION,
        _PULLEY_SPEED,
        real("mu_measured", "1", "measured friction coefficient"),
        real("mu_simulated", "1", "simulated friction coefficient"),
        real("difference", "1", "simulated minus measured"),
        Column("within_tolerance", "bool", "", "whether the point is within tolerance"),
        *optional(
            real("relative_difference", "1", "difference over measured"),
            standard_error("mu_measured_se", "1"),
            replace(_FORCE, meaning="mean of Eq. (8), measured"),
            _SLIDING_SPEED,
            nonnegative("u_measured", "1", "standard uncertainty of mu_measured", nullable=True),
            nonnegative("u_input", "1", "of mu_simulated, from its inputs", nullable=True),
            nonnegative("u_numerical", "1", "of mu_simulated, from its mesh", nullable=True),
            nonnegative("u_validation", "1", "standard uncertainty of difference", nullable=True),
            real("e_over_u", "1", "difference over u_validation"),
            text("status", "ok, or why the point is not compared"),
        ),
    ),
    label="run",
)

_LOSS = real("speed_loss_rad_s", "rad/s", "speed at idle minus speed under load")
_DRIVE = Table(
    "drive",
    1,
    "beltid simulate-drive",
    (
        count("point", "number of the operating point, from 1"),
        text("run", "label of the measured run, or of the point"),
        text("pulley", "name of the pulley"),
        replace(_DRIVER_SPEED, nullable=False),
        positive("initial_tension_N", "N", "tension of the belt at rest, or of the slack span"),
        real("torque_N_m", "N m", "torque that the driver delivers, or that is taken off"),
        real("speed_rad_s", "rad/s", "speed of the pulley, in the sign of the driver's"),
        _LOSS,
        nonnegative("speed_loss_u_rad_s", "rad/s", "its standard uncertainty", nullable=True),
        real("loss_creep_rad_s", "rad/s", "part of the loss from the stretch of the belt"),
        real("loss_seating_rad_s", "rad/s", "part from the penetration of the ribs"),
        real("loss_slip_rad_s", "rad/s", "part from pulleys that slide as a whole"),
        nonnegative("tension_in_N", "N", "axial force where the belt enters", nullable=True),
        nonnegative("tension_out_N", "N", "axial force where the belt leaves", nullable=True),
        nonnegative("hub_force_N", "N", "force of the belt on the axis", nullable=True),
        real("hub_angle_deg", "deg", "its direction, anticlockwise from the x axis"),
        nonnegative("wrap_deg", "deg", "arc between the tangent points"),
        nonnegative("arc_used_deg", "deg", "arc that slides", nullable=True),
        nonnegative("reserve", "1", "wrap over the arc needed; null on an idler", nullable=True),
        nonnegative("slip_speed_max_m_s", "m/s", "largest sliding speed", nullable=True),
        nonnegative("normal_force_min_N_m", "N/m", "smallest line force", nullable=True),
        nonnegative("normal_force_max_N_m", "N/m", "largest line force", nullable=True),
        nonnegative(
            "share_below_speed_range",
            "1",
            "of the sliding friction, below the slowest measured sliding",
            nullable=True,
        ),
        nonnegative(
            "share_outside_force_range",
            "1",
            "of the sliding friction, outside the measured line forces",
            nullable=True,
        ),
        real("friction_power_W", "W", "lost to friction, without the hysteresis of the belt"),
        text("status", "adhesion, full slip, gross slip or slack"),
        *optional(count("steady_states", "states with which the arc carries its forces")),
        *optional(
            nonnegative("span_frequency_Hz", "Hz", "lowest, of the span behind", nullable=True)
        ),
    ),
    label="run",
)
_COMPARE_DRIVE = Table(
    "compare_drive",
    1,
    "beltid compare-drive",
    (
        text("run", "label of the measured run"),
        _DRIVER_SPEED,
        positive("initial_tension_N", "N", "tension of the belt at rest", nullable=True),
        real("torque_N_m", "N m", "torque of the driven pulley"),
        real("loss_measured_rad_s", "rad/s", "measured speed loss"),
        real("loss_predicted_rad_s", "rad/s", "predicted speed loss"),
        real("difference_rad_s", "rad/s", "predicted minus measured"),
        real("relative_difference", "1", "difference over measured"),
        nonnegative("u_measured_rad_s", "rad/s", "of the measured loss", nullable=True),
        nonnegative("u_input_rad_s", "rad/s", "of the predicted loss", nullable=True),
        nonnegative("u_validation_rad_s", "rad/s", "of the difference", nullable=True),
        real("e_over_u", "1", "difference over its standard uncertainty"),
        real("loss_creep_rad_s", "rad/s", "predicted part from the stretch of the belt"),
        real("loss_seating_rad_s", "rad/s", "predicted part from the penetration of the ribs"),
        real("loss_slip_rad_s", "rad/s", "predicted part from pulleys that slide as a whole"),
        nonnegative("arc_share", "1", "largest share of an arc that slides", nullable=True),
        Column("judged", "bool", "", "whether the point counts in the verdict"),
        text("status", "ok, or why the point is not judged"),
    ),
    label="run",
)

_PRESS_CURVES = Table(
    "press_curves",
    1,
    "beltid run",
    (
        _TEST,
        real("temperature_degC", "degC", "temperature"),
        count("cycle", "number of the cycle, from 1"),
        text("branch", "loading or unloading"),
        real("penetration_m", "m", "from the contact point of the law, negative before contact"),
        real("line_force_N_m", "N/m", "force per length of belt"),
    ),
    label="test",
)
_RIG_CURVES = Table(
    "rig_curves",
    1,
    "beltid run",
    (
        _RUN,
        _TIME,
        real("tension_tight_N", "N", "tension of the tight span, corrected for known cell errors"),
        real("tension_slack_N", "N", "tension of the slack span, corrected for known cell errors"),
        real("mu", "1", "apparent friction coefficient of these tensions, Eq. (6)"),
        _PULLEY_SPEED,
    ),
    label="run",
)

TABLES: Final[dict[str, Table]] = {
    table.kind: table
    for table in (
        _PRESS,
        _ANY_RIG,
        _POINTS,
        _SPEEDLOSS,
        _STIFFNESS,
        _SLIP,
        _FRICTION,
        _SURFACE,
        Table("simulated", 1, "beltid simulate-rig", _RIG, label="run"),
        _COMPARE,
        _DRIVE,
        _COMPARE_DRIVE,
        _PRESS_CURVES,
        _RIG_CURVES,
    )
}
RECORDINGS: Final = ("press", "rig", "speedloss", "points")
NOMINAL: Final = ("arc_deg", "initial_tension_N", "weight_N")
"""Columns with the nominal settings of a run, constant within it."""
SETTINGS: Final = (*NOMINAL, "temperature_degC", "belt_speed_m_s", *RUN_TEXTS)
"""Columns with one value per run."""
ARTIFACTS: Final = tuple(kind for kind in TABLES if kind not in RECORDINGS)


def table(kind: str) -> Table:
    """Return the table of a kind.

    Raises
    ------
    KeyError
        If there is no such kind; a bug in the code, not a user error.
    """
    return TABLES[kind]


RIG_KINDS: Final = (
    ("two_cells", "tight"),
    ("dead_weight", "tight"),
    ("dead_weight", "slack"),
    ("torque_hub", "tight"),
    ("torque", "tight"),
)
"""Kinds of friction rig and the span with the weight; those that need more channels come first."""


def rig_table(
    measures: str = "two_cells", weight_on: str = "tight", *, running: bool = False
) -> Table:
    """Return the table of a friction-rig recording for what the rig measures.

    Parameters
    ----------
    measures : {"two_cells", "dead_weight", "torque", "torque_hub"}
        What it measures. For `torque`, one of the two tensions is enough.
    weight_on : {"tight", "slack"}
        Span that carries a dead weight.
    running : bool
        Whether the belt moves.
    """
    cell = "tension_slack_N" if weight_on == "tight" else "tension_tight_N"
    required = {
        "two_cells": ("tension_tight_N", "tension_slack_N"),
        "dead_weight": ("weight_N", cell),
        "torque": ("torque_N_m",),
        "torque_hub": ("torque_N_m", "hub_force_N"),
    }[measures]
    one_span = ("tension_tight_N", "tension_slack_N", "weight_N")
    extra: tuple[str, ...] = one_span if measures == "torque" else ()
    extra += ("idle",) if "torque_N_m" in required else ()
    extra += ("belt_speed_m_s",) if running else ()
    channels = {column.name for column in (_TIGHT, _SLACK, *_OTHER_CHANNELS, _IDLE)}
    # only rigs with two cells and a belt at rest need the initial tension
    unneeded = set() if measures == "two_cells" and not running else {_INITIAL.name}
    columns = []
    for column in table("rig").columns:
        if column.name in required:
            columns.append(replace(column, required=True))
        elif column.name in {*unneeded, *extra}:
            columns.append(replace(column, required=False, nullable=True))
        elif column.name not in channels:
            columns.append(column)
    return replace(table("rig"), columns=tuple(columns))

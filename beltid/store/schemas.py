"""Every table that is read or written: columns, types, units, ranges. One source for all.

The tables are those of the bench recordings (press, rig, speedloss) and of the artifacts. Columns
marked `extra` are diagnostics that an artifact may carry beyond its public columns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, Literal

DType = Literal["float64", "int64", "bool", "string", "list"]


@dataclass(frozen=True, slots=True)
class Column:
    """One column of a table.

    Attributes
    ----------
    name : str
        Public name, with the unit as its ending.
    dtype : {"float64", "int64", "bool", "string", "list"}
        Type; "list" is a list of four float64.
    unit : str
        Unit; "" for none, "1" for a pure number.
    meaning : str
        What it is, in words.
    nullable : bool
        Whether a value may be missing (nan, or None in a string column).
    low, high : float
        Range of allowed values.
    open_low, open_high : bool
        Whether a bound itself is excluded.
    required : bool
        Whether the table must have the column.
    """

    name: str
    dtype: DType
    unit: str
    meaning: str
    nullable: bool = False
    low: float = -math.inf
    high: float = math.inf
    open_low: bool = False
    open_high: bool = False
    required: bool = True

    @property
    def allowed(self) -> str:
        """The range in words: ``> 0``, ``in (0, 360)``."""
        if math.isinf(self.high):
            return (
                "finite"
                if math.isinf(self.low)
                else f"{'>' if self.open_low else '>='} {self.low:g}"
            )
        if math.isinf(self.low):
            return f"{'<' if self.open_high else '<='} {self.high:g}"
        left, right = "[("[self.open_low], "])"[self.open_high]
        return f"in {left}{self.low:g}, {self.high:g}{right}"


@dataclass(frozen=True, slots=True)
class Table:
    """One kind of table.

    Attributes
    ----------
    kind : str
        Name of the kind.
    version : int
        Schema version; it changes when a column changes its name, unit or meaning.
    command : str
        What writes it, for messages.
    columns : tuple of Column
        Columns in their order.
    label : str
        The column that labels one recording; "" if there is none.
    """

    kind: str
    version: int
    command: str
    columns: tuple[Column, ...]
    label: str = ""

    def column(self, name: str) -> Column:
        """The column of that name; KeyError if there is none."""
        for column in self.columns:
            if column.name == name:
                return column
        raise KeyError(f"a {self.kind} table has no column {name}")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all columns, in order."""
        return tuple(column.name for column in self.columns)


def _positive(name: str, unit: str, meaning: str, *, nullable: bool = False) -> Column:
    return Column(name, "float64", unit, meaning, nullable, 0.0, open_low=True)


def _nonnegative(name: str, unit: str, meaning: str, *, nullable: bool = False) -> Column:
    return Column(name, "float64", unit, meaning, nullable, 0.0)


def _real(name: str, unit: str, meaning: str, *, nullable: bool = True) -> Column:
    return Column(name, "float64", unit, meaning, nullable)


def _count(name: str, meaning: str) -> Column:
    return Column(name, "int64", "1", meaning, low=0)


def _text(name: str, meaning: str, *, nullable: bool = False) -> Column:
    return Column(name, "string", "", meaning, nullable)


def _optional(*columns: Column) -> tuple[Column, ...]:
    return tuple(replace(column, required=False) for column in columns)


_TIME = _real("time_s", "s", "time", nullable=False)
_TEMPERATURE = Column(
    "temperature_degC", "float64", "degC", "temperature", True, -90.0, 200.0, required=False
)
_ARC = Column(
    "arc_deg", "float64", "deg", "contact arc", False, 0.0, 360.0, open_low=True, open_high=True
)
_RIG = (
    _text("run", "label of the run"),
    _TIME,
    _positive("tension_tight_N", "N", "tension of the tight span", nullable=True),
    _positive("tension_slack_N", "N", "tension of the slack span", nullable=True),
    _real("pulley_speed_rad_s", "rad/s", "speed of the pulley"),
    _TEMPERATURE,
    _ARC,
    _positive("initial_tension_N", "N", "nominal tension before the pulley turns"),
)

_PRESS = Table(
    "press",
    1,
    "the compression press",
    (
        _text("test", "label of the test"),
        _TEMPERATURE,
        _TIME,
        _real("displacement_mm", "mm", "travel of the crosshead, growing towards the plate"),
        _real("force_N", "N", "force of the press, positive in compression"),
    ),
    label="test",
)
_SPEEDLOSS = Table(
    "speedloss",
    1,
    "the speed-loss bench",
    (
        _text("run", "label of the operating point"),
        _TIME,
        _positive("initial_tension_N", "N", "tension of the belt at rest"),
        _real("torque_N_m", "N m", "torque of the driven pulley"),
        _real("driver_speed_rad_s", "rad/s", "speed of the driver pulley"),
        _real("driven_speed_rad_s", "rad/s", "speed of the driven pulley"),
    ),
    label="run",
)
_STIFFNESS = Table(
    "stiffness",
    1,
    "beltid fit-stiffness",
    (
        _real("temperature_degC", "degC", "temperature; null for the pooled law"),
        _nonnegative("k_linear_N_m2", "N/m²", "linear coefficient of Eq. (3)"),
        _nonnegative("k_quadratic_N_m3", "N/m³", "quadratic coefficient of Eq. (3)"),
        _nonnegative("k_linear_se_N_m2", "N/m²", "standard error", nullable=True),
        _nonnegative("k_quadratic_se_N_m3", "N/m³", "standard error", nullable=True),
        Column(
            "covariance",
            "list",
            "N²/m⁴, N²/m⁵, N²/m⁵, N²/m⁶",
            "covariance of (k_linear, k_quadratic), row by row",
            nullable=True,
        ),
        _real("contact_offset_mm", "mm", "travel of the crosshead at first contact"),
        _nonnegative("rms_residual_N_m", "N/m", "root mean square of the residual", nullable=True),
        _nonnegative("hysteresis_ratio", "1", "dissipated over stored energy", nullable=True),
        _positive("max_penetration_m", "m", "deepest penetration of the fit"),
        _positive("max_force_N_m", "N/m", "largest line force of the fit"),
        _count("n_samples", "samples used"),
        *_optional(
            _count("n_cycles", "load cycles used"),
            _count("n_set_aside", "samples set aside"),
            _text("tests", "labels of the tests used", nullable=True),
            _text("notes", "what the user should know", nullable=True),
        ),
    ),
)
_SLIP = Table(
    "slip",
    1,
    "beltid fit-slip",
    (
        _positive("driver_speed_rad_s", "rad/s", "speed of the driver pulley"),
        _positive("initial_tension_N", "N", "tension of the belt at rest"),
        _real("torque_N_m", "N m", "torque of the driven pulley", nullable=False),
        _real("speed_loss_rad_s", "rad/s", "driver minus driven speed", nullable=False),
        _real("slip_speed_m_s", "m/s", "largest sliding speed, Eq. (7)", nullable=False),
        _nonnegative("slip_speed_se_m_s", "m/s", "standard error", nullable=True),
        *_optional(
            _text("run", "label of the operating point"),
            _count("n_samples", "samples used"),
            _text("status", "ok, or why it was set aside"),
            _text("notes", "what the user should know", nullable=True),
        ),
    ),
)
_FRICTION = Table(
    "friction",
    1,
    "beltid fit-friction",
    (
        _text("run", "label of the run"),
        replace(_ARC, nullable=True),
        _positive("initial_tension_N", "N", "tension measured at rest", nullable=True),
        _positive("nominal_tension_N", "N", "tension the run was set to", nullable=True),
        _real("pulley_speed_rad_s", "rad/s", "speed of the pulley on the plateau"),
        _real("slip_speed_m_s", "m/s", "sliding speed omega R"),
        _positive("tension_tight_N", "N", "tension of the tight span, sliding", nullable=True),
        _positive("tension_slack_N", "N", "tension of the slack span, sliding", nullable=True),
        _real("mu_sliding", "1", "friction coefficient while sliding, Eq. (6)"),
        _nonnegative("mu_sliding_se", "1", "standard error", nullable=True),
        _real("mu_sticking", "1", "friction coefficient at the sticking peak"),
        _nonnegative("normal_force_N_m", "N/m", "mean of Eq. (8) over the arc", nullable=True),
        _real("temperature_degC", "degC", "temperature"),
        _count("n_samples", "samples of the plateau"),
        _text("status", "ok, or why it was set aside"),
        *_optional(
            _nonnegative("mu_sticking_se", "1", "standard error", nullable=True),
            _text("mu_sticking_reason", "why mu_sticking is missing", nullable=True),
            _real("imbalance_N", "N", "tight minus slack cell at rest"),
            _nonnegative("imbalance_se_N", "N", "standard error", nullable=True),
            _real("start_time_s", "s", "start of the rotation"),
            _real("peak_time_s", "s", "time of the sticking peak"),
            _real("plateau_start_s", "s", "start of the sliding plateau"),
            _real("plateau_end_s", "s", "end of the sliding plateau"),
            _count("n_spikes", "spikes taken out"),
            _count("n_missing", "samples missing"),
            _nonnegative("ripple_amplitude_N", "N", "ripple of the turning pulley", nullable=True),
            _nonnegative("ripple_period_s", "s", "period of the ripple", nullable=True),
            _nonnegative("tail_time_s", "s", "decay time from the peak", nullable=True),
            _real("drift", "1", "relative drift of mu over the plateau"),
            Column("swapped", "bool", "", "whether the cells were found swapped"),
            _text("notes", "what the user should know", nullable=True),
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
        _positive("normal_force_N_m", "N/m", "normal force per length"),
        _positive("slip_speed_m_s", "m/s", "sliding speed"),
        _positive("mu", "1", "friction coefficient", nullable=True),
        _nonnegative("mu_se", "1", "standard error", nullable=True),
        _count("n_arcs", "arcs that were averaged"),
        *_optional(
            _nonnegative("mu_spread", "1", "standard deviation between arcs", nullable=True),
            Column("measured", "bool", "", "whether the node lies within the measured range"),
        ),
    ),
)
_COMPARE = Table(
    "compare",
    1,
    "beltid compare",
    (
        _text("run", "label of the measured run"),
        replace(_ARC, nullable=True),
        _positive("nominal_tension_N", "N", "tension the run was set to", nullable=True),
        _real("pulley_speed_rad_s", "rad/s", "speed of the pulley"),
        _real("mu_measured", "1", "measured friction coefficient"),
        _real("mu_simulated", "1", "simulated friction coefficient"),
        _real("difference", "1", "simulated minus measured"),
        Column("within_tolerance", "bool", "", "whether the point is within tolerance"),
        *_optional(
            _real("relative_difference", "1", "difference over measured"),
            _nonnegative("mu_measured_se", "1", "standard error", nullable=True),
            _nonnegative("normal_force_N_m", "N/m", "mean of Eq. (8), measured", nullable=True),
            _real("slip_speed_m_s", "m/s", "sliding speed"),
            _text("force_band", "low, middle or high normal force", nullable=True),
            _text("status", "ok, or why the point is not compared"),
        ),
    ),
    label="run",
)

TABLES: Final[dict[str, Table]] = {
    table.kind: table
    for table in (
        _PRESS,
        Table("rig", 1, "the friction rig", _RIG, label="run"),
        _SPEEDLOSS,
        _STIFFNESS,
        _SLIP,
        _FRICTION,
        _SURFACE,
        Table("simulated", 1, "beltid simulate-rig", _RIG, label="run"),
        _COMPARE,
    )
}
RECORDINGS: Final = ("press", "rig", "speedloss")
ARTIFACTS: Final = ("stiffness", "slip", "friction", "surface", "simulated", "compare")


def table(kind: str) -> Table:
    """The table of a kind.

    Raises
    ------
    KeyError
        If there is no such kind; a mistake in the code, not of the user.
    """
    return TABLES[kind]

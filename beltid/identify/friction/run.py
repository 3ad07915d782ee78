"""Inputs and results of the reduction of friction rig runs.

A recording is a table; `run_records` splits it into runs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import InputError
from beltid.identify.friction.kinds import (
    TWO_CELLS,
    UNTREATED,
    Drag,
    RigKind,
    Span,
    Treatment,
    drag_of,
)

Array = NDArray[np.float64]


NAN = float("nan")


class RunRejected(Exception):
    """Signals that a run cannot be reduced; the message becomes the status of the run.

    It is caught within the reduction of the run: one bad run must not stop the others.
    """


@dataclass(frozen=True, slots=True)
class FrictionSettings:
    """Settings of the reduction. The defaults suit both bench and simulated recordings.

    Raises
    ------
    InputError
        If values are out of range; lists all of them.
    """

    min_plateau_samples: int = 12
    """Fewest usable samples of sliding."""
    spike_threshold: float = 6.0
    """Distance from the neighbours above which a sample is a spike, in standard deviations."""
    correct_imbalance: Literal["auto"] | bool = "auto"
    """Whether to subtract the difference of the cells at rest. ``True``: in every run, half from
    each cell, with the noise of the rest phase. ``False``: never; the standard error allows for a
    clear difference. ``"auto"``: where it is clear, as the difference of zero points or of gains
    that all runs of the bench show together; otherwise as with ``False``."""
    check_initial_tension: bool = True
    """Whether tensions at rest that do not match the stated ones are an error."""
    max_mu: float = 3.0
    """Largest credible friction coefficient [-]."""
    speed_bins_rad_s: tuple[float, ...] = ()
    """Edges of the speed bins into which a run at a changing speed is cut [rad/s]."""

    def __post_init__(self) -> None:
        problems = [
            f"friction.{name} = {value!r}, must be in [{low:g}, {high:g}]"
            for name, low, high in (
                ("min_plateau_samples", 8, 1_000_000),
                ("spike_threshold", 3.0, 100.0),
                ("max_mu", 0.01, 100.0),
            )
            if not low <= (value := getattr(self, name)) <= high
        ]
        if self.correct_imbalance not in ("auto", True, False):
            setting = f"friction.correct_imbalance = {self.correct_imbalance!r}"
            problems.append(f"{setting}, must be auto, true or false")
        if problems:
            raise InputError(problems)


@dataclass(frozen=True, slots=True)
class Conditions:
    """Test conditions of a run; None or nan if not stated."""

    condition: str | None = None
    """Surface: dry, wet or dusty."""
    side: str | None = None
    """Side of the belt on the pulley: rib or back."""
    humidity_percent: float = NAN
    hours_run: float = NAN
    pulley_material: str | None = None
    roughness_Ra_um: float = NAN

    def completed(self, default: Conditions) -> Conditions:
        """Return these conditions, with the missing ones taken from a default."""
        values: dict[str, Any] = {}
        for item in fields(self):
            value = getattr(self, item.name)
            is_stated = value is not None and value == value
            values[item.name] = value if is_stated else getattr(default, item.name)
        return Conditions(**values)


@dataclass(frozen=True, slots=True)
class RunRecord:
    """Recording of one run of the friction rig; columns of shape (n,), in order of time."""

    time_s: Array
    tension_tight_N: Array
    tension_slack_N: Array
    pulley_speed_rad_s: Array
    temperature_degC: Array | None = None
    run: str = ""
    arc_deg: float = NAN
    nominal_tension_N: float = NAN
    defect: str = ""
    """Why the record cannot be a single run (e.g. a nominal setting changes); empty if it can."""
    kind: RigKind = TWO_CELLS
    """What the bench measured; the tensions are derived from it."""
    belt_speed_m_s: float = 0.0
    """Speed of the belt; the pulley speed is relative to it [m/s]."""
    conditions: Conditions = Conditions()
    treatment: Treatment = UNTREATED

    @property
    def momentum_N(self) -> float:
        """Momentum part of the tensions of a running belt [N]; nan for a belt at rest."""
        return float(self.kind.momentum_N(self.belt_speed_m_s)) if self.kind.running else NAN


@dataclass(frozen=True, slots=True)
class RunReduction:
    """Result of one run of the friction rig. Values that could not be determined are nan.

    A rejected run keeps the values determined before the reason was found.
    """

    run: str = ""
    arc_deg: float = NAN
    """Contact arc, nominal [deg]."""
    initial_tension_N: float = NAN
    """Mean of both cells at the start of the rotation [N]."""
    nominal_tension_N: float = NAN
    pulley_speed_rad_s: float = NAN
    """Magnitude of the pulley's speed [rad/s]."""
    slip_speed_m_s: float = NAN
    """Sliding speed |omega| R, Eq. (7) [m/s]."""
    tension_tight_N: float = NAN
    """Tight tension of the plateau, without ripple and tail of the peak [N]."""
    tension_slack_N: float = NAN
    mu_sliding: float = NAN
    """Eq. (6) of the two plateau tensions [-]."""
    mu_sliding_se: float = NAN
    """Half-width of the 95 % interval over 1.96, from the noise of the record and its
    correlation, the shape of the tail, drift and the cells; includes errors common to all runs
    [-]."""
    mu_sticking: float = NAN
    """Peak of mu at the end of the build-up [-]; nan if the record does not resolve it."""
    mu_sticking_se: float = NAN
    normal_force_N_m: float = NAN
    """Closed mean of Eq. (8) over the arc [N/m]."""
    temperature_degC: float = NAN
    """Mean over the plateau [°C]."""
    n_samples: int = 0
    """Samples of the plateau."""
    status: str = ""
    """"ok", or why the run was rejected."""
    mu_sticking_reason: str = "the run was set aside"
    """Why mu_sticking is missing; empty if it is given."""
    imbalance_N: float = NAN
    """Tight minus slack cell at rest, as recorded [N]."""
    imbalance_se_N: float = NAN
    start_time_s: float = NAN
    """First sample at which the pulley turns [s]."""
    peak_time_s: float = NAN
    """Time of the sticking peak [s]."""
    plateau_start_s: float = NAN
    plateau_end_s: float = NAN
    n_spikes: int = 0
    """Samples of either channel excluded as spikes."""
    n_missing: int = 0
    """Samples without a usable tension, plus samples missing from an even time base."""
    ripple_amplitude_N: float = NAN
    """Amplitude of the strongest ripple of the tight tension [N]; zero without ripple."""
    ripple_period_s: float = NAN
    """Period of that ripple [s]; nan without ripple."""
    tail_time_s: float = NAN
    """Time in which the tail falls to 1/e of its height [s]; nan without a tail."""
    drift: float = NAN
    """Relative change of mu by drift over the sliding phase [-], as far as the noise allows."""
    shared_tail: float = NAN
    """Change of ln mu by one standard deviation of the tail shape, an error common to all runs
    [-]."""
    shared_drift: float = NAN
    """The same for a drift of the cells common to all runs [-]."""
    shared_cells: float = NAN
    """The same for the zeros and gains of the cells [-]."""
    momentum_N: float = NAN
    """Momentum part subtracted from the tensions of a running belt [N]; nan at rest."""
    torque_with: Span | None = None
    """Span whose tension was measured in addition to a torque."""
    conditions: Conditions = Conditions()
    swapped: bool = False
    """Whether the columns of the tight and the slack cell were swapped."""
    treatment: Treatment = UNTREATED
    notes: tuple[str, ...] = ()
    """Remarks on the run for the user."""

    @property
    def ok(self) -> bool:
        """Whether the run may be used."""
        return self.status == "ok"


def arc_problem(arc_deg: float) -> str:
    """Return why a contact arc cannot be used; empty if it can."""
    if math.isfinite(arc_deg) and 0.0 < arc_deg <= 3600.0:
        return ""
    return f"arc_deg = {arc_deg:g}, must be in (0, 3600]"


NONE = np.empty(0)

REQUIRED = ("time_s", "pulley_speed_rad_s", "arc_deg")
OPTIONAL = (
    "tension_tight_N",
    "tension_slack_N",
    "weight_N",
    "torque_N_m",
    "hub_force_N",
    "belt_speed_m_s",
    "temperature_degC",
    "initial_tension_N",
    "humidity_percent",
    "hours_run",
    "roughness_Ra_um",
)
MARKED, MOST_UNMARKED, LONGEST_MARK = 10.0, 0.95, 3
"""A mark exceeds this quantile of the magnitudes by this factor, for at most so many samples."""
CELLS = ("tension_tight_N", "tension_slack_N", "hub_force_N")
TEXT_COLUMNS = ("idle", "condition", "side", "pulley_material")
"""Text columns that describe a run."""


@dataclass(frozen=True, slots=True, eq=False)
class RunColumns:
    """Columns of one run.

    Attributes
    ----------
    label : str
        Label of the run.
    numbers : mapping of str to ndarray
        Numeric columns, shape (n,) each, n >= 1; optional columns may be missing.
    texts : mapping of str to str
        Entries of the text columns.
    """

    label: str
    numbers: Mapping[str, Array]
    texts: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_idle(self) -> bool:
        """Whether the pulley turned without the belt."""
        return self.texts.get("idle", "").lower() == "true"


def runs_of(columns: Mapping[str, ArrayLike], kind: RigKind) -> list[RunColumns]:
    """Split a recording into runs, in the order in which they first appear.

    Parameters
    ----------
    columns : mapping of str to array_like
        The columns of rig.csv, shape (n,) each; columns that the kind does not need may be
        missing. Rows of a run need not be together; they keep their order.
    kind : RigKind
        What the rig measures.

    Raises
    ------
    InputError
        If a column is missing, has another length or is not numeric, or if there are no samples.
    """
    needed = ("run", *REQUIRED, *kind.needed)
    missing = [f"column {name} is missing" for name in needed if name not in columns]
    if missing:
        raise InputError(missing)
    numeric: dict[str, Array] = {}
    problems = []
    for name in (*REQUIRED, *(name for name in OPTIONAL if name in columns)):
        try:
            numeric[name] = np.asarray(columns[name], dtype=float)
        except (TypeError, ValueError):
            problems.append(f"column {name} holds values that are not numbers")
    if problems:
        raise InputError(problems)
    labels = columns["run"]
    labels = labels if isinstance(labels, np.ndarray) else np.asarray(labels, dtype=object)
    texts = {
        name: np.asarray(columns[name], dtype=object) for name in TEXT_COLUMNS if name in columns
    }
    check_columns({"run": labels, **numeric, **texts})
    return [
        RunColumns(
            label,
            {name: values[rows] for name, values in numeric.items()},
            {name: text for name, values in texts.items() if (text := values[rows[0]]) is not None},
        )
        for label, rows in _groups(labels)
    ]


def run_records(
    columns: Mapping[str, ArrayLike], R: float, kind: RigKind = TWO_CELLS
) -> tuple[RunRecord, ...]:
    """Build the records of all runs except those of the idle pulley; see `runs_of`.

    Parameters
    ----------
    columns : mapping of str to array_like
        The columns of rig.csv.
    R : float
        Radius of the belt's centreline on the pulley [m].
    kind : RigKind
        What the rig measures.
    """
    runs = runs_of(columns, kind)
    drag = drag_of([run.numbers for run in runs if run.is_idle])
    return tuple(run_record(run, R, kind, drag) for run in runs if not run.is_idle)


def check_columns(columns: Mapping[str, NDArray[Any]]) -> None:
    """Reject columns that do not form one table.

    Raises
    ------
    InputError
        If a column is not one-dimensional, if they differ in length, or if they are empty.
    """
    problems = [
        f"column {name} has shape {values.shape}, must be one-dimensional"
        for name, values in columns.items()
        if values.ndim != 1
    ]
    sizes = {name: values.size for name, values in columns.items()}
    if not problems and len(set(sizes.values())) > 1:
        listed = ", ".join(f"{name} {size}" for name, size in sizes.items())
        problems.append(f"columns differ in length: {listed}")
    if not problems and next(iter(sizes.values())) == 0:
        problems.append("no samples: must be >= 1")
    if problems:
        raise InputError(problems)


def _groups(labels: NDArray[Any]) -> list[tuple[str, NDArray[np.intp]]]:
    """Return the label and rows of every run, in the order of first appearance."""
    codes: dict[object, int] = {}
    starts = np.flatnonzero(np.append(True, labels[1:] != labels[:-1]))
    firsts = (None if label != label else label for label in labels[starts].tolist())
    code = np.repeat(
        [codes.setdefault(label, len(codes)) for label in firsts],
        np.diff(np.append(starts, labels.size)),
    )
    order = np.argsort(code, kind="stable")
    bounds = np.searchsorted(code[order], np.arange(len(codes) + 1))
    return [(_label_text(label), order[bounds[k] : bounds[k + 1]]) for k, label in enumerate(codes)]


def _label_text(label: object) -> str:
    if label is None:
        return ""
    if isinstance(label, float) and label.is_integer():
        return str(int(label))
    return str(label)


def run_record(
    run: RunColumns, R: float, kind: RigKind = TWO_CELLS, drag: Drag | None = None
) -> RunRecord:
    """Build the record of one run; a nominal setting that changes within it is a defect.

    Parameters
    ----------
    run : RunColumns
        The columns.
    R : float
        Radius of the belt's centreline on the pulley [m].
    kind : RigKind
        What the rig measures.
    drag : Drag, optional
        Bearing drag to subtract from a torque.
    """
    columns = run.numbers
    if kind.is_derived:
        kind.check(columns)
    defects = []
    nominal = {}
    for name in ("arc_deg", "initial_tension_N", "weight_N"):
        values = columns.get(name, np.array([NAN]))
        first = float(values[0])
        nominal[name] = first
        same = np.isnan(values) if np.isnan(first) else values == first
        if not np.all(same):
            other = float(values[np.argmin(same)])
            defects.append(f"{name} changes within the run from {first:g} to {other:g}")
    if not defects:
        defects = [arc_problem(nominal["arc_deg"])]
    marks = lone_marks(columns["pulley_speed_rad_s"])
    if marks.size:
        speed = columns["pulley_speed_rad_s"].copy()
        speed[marks] = NAN
        columns = {**columns, "pulley_speed_rad_s": speed}
    record = RunRecord(
        time_s=columns["time_s"],
        tension_tight_N=columns.get("tension_tight_N", NONE),
        tension_slack_N=columns.get("tension_slack_N", NONE),
        pulley_speed_rad_s=columns["pulley_speed_rad_s"],
        temperature_degC=columns.get("temperature_degC"),
        run=run.label,
        arc_deg=nominal["arc_deg"],
        nominal_tension_N=nominal["initial_tension_N"],
        defect="; ".join(defects),
        kind=kind,
        treatment=replace(kind.treatment(columns, drag), n_marks=marks.size),
        conditions=conditions_of(run),
    )
    if not kind.is_derived:
        return record
    columns = {**columns, **{name: _present(columns[name]) for name in CELLS if name in columns}}
    tight, slack = kind.tensions(columns, record.arc_deg, R, drag)
    if kind.weight is not None and np.isnan(record.nominal_tension_N):
        record = replace(record, nominal_tension_N=nominal["weight_N"])
    belt_speed = float(np.nanmedian(kind.belt_speed(columns))) if kind.running else 0.0
    return replace(
        record,
        tension_tight_N=tight,
        tension_slack_N=slack,
        pulley_speed_rad_s=kind.relative_speed(columns, R),
        kind=kind.with_span_of(columns),
        belt_speed_m_s=belt_speed,
    )


def lone_marks(speed: Array) -> NDArray[np.intp]:
    """Find samples of a speed that are overflow marks or encoder pulses (k,).

    They are far above nearly all others and short; a pulley that rests most of the time still
    turns for longer.

    Parameters
    ----------
    speed : ndarray
        Samples of one run, nan where one is missing.
    """
    size = np.abs(np.nan_to_num(speed, nan=0.0))
    # divided, not multiplied: ten times an infinite speed is no number
    high = np.concatenate([[False], size / MARKED > np.quantile(size, MOST_UNMARKED), [False]])
    starts, ends = np.flatnonzero(high[1:] & ~high[:-1]), np.flatnonzero(high[:-1] & ~high[1:])
    short = [np.arange(a, b) for a, b in zip(starts, ends, strict=True) if b - a <= LONGEST_MARK]
    return np.concatenate([np.empty(0, dtype=np.intp), *short])


def _present(readings: Array) -> Array:
    """Return the readings of a cell with lost ones, exact zeros, as nan."""
    return np.where(readings == 0.0, np.nan, readings)


def conditions_of(run: RunColumns) -> Conditions:
    """Read the conditions of a run from its columns."""

    def number(name: str) -> float:
        return float(run.numbers[name][0]) if name in run.numbers else NAN

    def text(name: str) -> str | None:
        return run.texts[name].lower() if name in run.texts else None

    return Conditions(
        condition=text("condition"),
        side=text("side"),
        humidity_percent=number("humidity_percent"),
        hours_run=number("hours_run"),
        pulley_material=run.texts.get("pulley_material"),
        roughness_Ra_um=number("roughness_Ra_um"),
    )

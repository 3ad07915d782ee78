"""Runs of a friction rig, and the tensions of both spans from what the rig measures.

A recording is a table; `run_records` splits it into runs. Any two of these channels give the two
span forces; the formulas are in `laws.capstan`. The tensions go through the same reduction as those
of two cells; only the errors that they can have differ.

=========== ============================== ==================================================
Measures    Channels                       Errors of the tensions
=========== ============================== ==================================================
two_cells   both tensions                  independent errors of the two cells
dead_weight one tension; the other is W    none in W
torque      torque and one tension         torque: in the other tension; cell: in both
            torque and a weight            torque: in the other tension; none in the weight
torque_hub  torque and hub force           torque: half in each; hub force: in their sum
=========== ============================== ==================================================

Known errors of the cells are corrected first, so that the difference of the cells at rest shows
only the unknown rest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import InputError
from beltid.identify.estimators import median
from beltid.laws.capstan import (
    STRAIGHT,
    Spans,
    friction_coefficient,
    mean_normal_force,
    pressing_tension,
    running_sliding_speed,
    tensions_by_hub_force,
    tensions_by_torque,
)

Array = NDArray[np.float64]

Span = Literal["tight", "slack"]
Measures = Literal["two_cells", "dead_weight", "torque", "torque_hub"]
SPANS: tuple[Span, Span] = ("tight", "slack")
TURNS = 0.03
"""Share of the largest speed above which the pulley counts as turning."""
LEAST_SLIP = 1e-9
"""Ratio of sliding speed to belt speed below which the sliding is rounding error."""


@dataclass(frozen=True, slots=True)
class KnownCell:
    """Known errors of one load cell; the defaults describe a perfect one."""

    tare_N: float = 0.0  # reading without load [N]
    gain: float = 1.0  # ratio of the true force to the reading less tare [-]

    def tension(self, reading_N: ArrayLike) -> Array:
        """Convert readings of the cell [N] to the tension of its span, ``gain (reading - tare)``.

        Parameters
        ----------
        reading_N : array_like
            Readings [N].
        """
        return self.gain * (np.asarray(reading_N, dtype=float) - self.tare_N)


PERFECT = (KnownCell(), KnownCell())


@dataclass(frozen=True, slots=True, eq=False)
class Drag:
    """Torque of a pulley that turns without a belt: bearing friction and zero of the sensor."""

    speed_rad_s: Array  # speed and torque of the idle runs, sorted by speed, (k,)
    torque_N_m: Array
    at_rest_N_m: float  # reading of the sensor before the pulley turns [N m]

    def at(self, speed_rad_s: Array) -> Array:
        """Interpolate the torque to subtract; constant beyond the speeds of the idle runs.

        Parameters
        ----------
        speed_rad_s : ndarray
            Magnitudes of the pulley speed [rad/s].
        """
        turns = speed_rad_s > TURNS * float(np.nanmax(speed_rad_s, initial=0.0))
        drag = np.interp(speed_rad_s, self.speed_rad_s, self.torque_N_m)
        return np.where(turns, drag, self.at_rest_N_m)


@dataclass(frozen=True, slots=True)
class RigKind:
    """What a friction rig measures."""

    measures: Measures = "two_cells"  # measured channels
    weight_on: Span = "tight"  # span that carries the dead weight
    torque_with: Span = "slack"  # span whose tension is measured in addition to a torque
    running: bool = False  # whether the belt moves
    mass_per_length_kg_m: float = 0.0
    """Mass per length of the belt; used only if the belt moves [kg/m]."""
    cells: tuple[KnownCell, KnownCell] = PERFECT  # known errors of the tight and the slack cell
    spans: Spans = STRAIGHT
    """Rotation of the span forces by bending: a hub force is the resultant of both."""
    weight_stated: bool = True
    """Whether the user said which span that is: a weight beside a torque does not show it."""
    weighs: bool = False  # whether the tension measured in addition to a torque is a weight

    @property
    def is_derived(self) -> bool:
        """Whether the tensions are derived rather than read directly from two cells."""
        return self.measures != "two_cells" or self.running

    @property
    def has_torque(self) -> bool:
        """Whether a torque is measured, which includes the drag of the bearings."""
        return self.measures in ("torque", "torque_hub")

    @property
    def weight(self) -> Span | None:
        """Span whose tension is a dead weight; None for other kinds."""
        return self.weight_on if self.measures == "dead_weight" or self.weighs else None

    @property
    def span_beside_torque(self) -> Span | None:
        """Span whose tension is measured in addition to a torque; None for other kinds."""
        return self.torque_with if self.measures == "torque" else None

    def found_in(self, columns: Mapping[str, Array]) -> RigKind:
        """Return this kind with `torque_with` as the span whose tension the columns hold.

        Raises
        ------
        InputError
            If channels are missing.
        """
        needed = {
            "two_cells": ("tension_tight_N", "tension_slack_N"),
            "dead_weight": ("weight_N", f"tension_{other(self.weight_on)}_N"),
            "torque": ("torque_N_m",),
            "torque_hub": ("torque_N_m", "hub_force_N"),
        }[self.measures]
        missing = [f"column {name} is missing" for name in needed if not _has_values(columns, name)]
        if missing:
            raise InputError(missing)
        if self.measures != "torque":
            return self
        for span in (self.torque_with, other(self.torque_with)):
            if _has_values(columns, f"tension_{span}_N"):
                return replace(self, torque_with=span)
        if not _has_values(columns, "weight_N"):
            raise InputError("column tension_tight_N, tension_slack_N or weight_N is missing")
        if not self.weight_stated:
            raise InputError(
                "a weight beside a torque: state the span that carries it, rig.holds: weight_tight "
                "or rig.holds: weight_slack"
            )
        return replace(self, torque_with=self.weight_on, weighs=True)

    def reversed(self, table: str) -> str:
        """Explain a slack tension above the tight one; empty for two cells.

        Parameters
        ----------
        table : {"rig", "points"}
            Name under which the config maps the columns of the recording.
        """
        if self.measures == "dead_weight":
            return (
                f"the cell shows that the weight hangs on the {other(self.weight_on)} span while "
                f"the pulley turns, but the config states rig.holds: weight_{self.weight_on}"
            )
        if self.has_torque:
            return (
                "the torque is negative while the pulley turns; if the sensor counts the other "
                "way, reverse its sign with a minus before the column name: columns: "
                f'{{{table}: {{torque_N_m: "-torque_N_m"}}}}'
            )
        return ""

    def belt_speed(self, columns: Mapping[str, Array]) -> Array:
        """Return the magnitude of the belt speed [m/s].

        Raises
        ------
        InputError
            If no column gives it.
        """
        speed = np.abs(np.asarray(columns.get("belt_speed_m_s", np.nan), dtype=float))
        if not np.isfinite(speed).any():
            raise InputError("column belt_speed_m_s is missing")
        return speed

    def momentum_N(self, belt_speed_m_s: Array | float) -> Array | float:
        """Return the momentum part of the measured tensions [N]; zero with a hub force."""
        mass = 0.0 if self.measures == "torque_hub" else self.mass_per_length_kg_m
        return mass * belt_speed_m_s**2

    def tensions(
        self,
        columns: Mapping[str, Array],
        arc_deg: float | Array,
        R: float,
        drag: Drag | None = None,
    ) -> tuple[Array, Array]:
        """Compute the tensions that press the belt onto the pulley [N], shape (n,) each.

        Parameters
        ----------
        columns : mapping of str to ndarray
            The channels of this kind, shape (n,) each.
        arc_deg : float or ndarray
            Contact arc [deg].
        R : float
            Radius of the belt's centreline on the pulley [m].
        drag : Drag, optional
            Bearing drag to subtract from the torque.
        """
        if not self.has_torque:
            return self._span_tension(columns, "tight"), self._span_tension(columns, "slack")
        torque, magnitude, _ = _turning(columns)
        if drag is not None:
            torque = torque - drag.at(magnitude)
        if self.measures == "torque_hub":
            # the momentum of the belt does not load the axis
            hub, beta = columns["hub_force_N"], np.radians(arc_deg)
            return tensions_by_hub_force(torque, hub, beta, R, self.spans)
        measured = {f"T_{self.torque_with}": self._span_tension(columns, self.torque_with)}
        return tensions_by_torque(torque, R, **measured)

    def _span_tension(self, columns: Mapping[str, Array], span: Span) -> Array:
        """Compute the tension of a span from its cell or weight."""
        if span == self.weight:
            tension = np.asarray(columns["weight_N"], dtype=float)
        else:
            tension = self.cells[SPANS.index(span)].tension(columns[f"tension_{span}_N"])
        if not self.running:
            return tension
        return pressing_tension(tension, self.mass_per_length_kg_m, self.belt_speed(columns))

    def relative_speed(self, columns: Mapping[str, Array], R: float) -> Array:
        """Return the pulley speed relative to the belt, which gives the sliding speed [rad/s]."""
        speed = np.asarray(columns["pulley_speed_rad_s"], dtype=float)
        if not self.running:
            return speed
        belt = self.belt_speed(columns)
        sliding = running_sliding_speed(np.abs(speed), R, belt)
        return np.where(np.abs(sliding) > LEAST_SLIP * belt, sliding, 0.0) / R


TWO_CELLS = RigKind()
"""The rig of the paper."""


def other(span: Span) -> Span:
    """Return the span on the other side of the pulley."""
    return "slack" if span == "tight" else "tight"


def drag_of(idle: Sequence[Mapping[str, Array]]) -> Drag | None:
    """Compute the bearing drag from runs of the pulley without the belt; None without such runs.

    Parameters
    ----------
    idle : sequence of mapping
        Columns pulley_speed_rad_s [rad/s] and torque_N_m [N m] of each run.
    """
    found, at_rest = [], []
    for columns in idle:
        torque, magnitude, turns = _turning(columns)
        turns &= np.isfinite(torque)
        if not turns.any():
            continue
        found.append((median(magnitude[turns]), float(np.mean(torque[turns]))))
        still = np.isfinite(torque) & (magnitude <= TURNS * float(np.nanmax(magnitude)))
        if still.any():
            at_rest.append(float(np.mean(torque[still])))
    if not found:
        return None
    speeds, torques = np.array(sorted(found)).T
    return Drag(speeds, torques, float(np.mean(at_rest)) if at_rest else 0.0)


def _turning(columns: Mapping[str, Array]) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return the torque in the direction of rotation, the speed, and where the pulley turns."""
    torque, speed = (
        np.atleast_1d(np.asarray(columns[name], dtype=float))
        for name in ("torque_N_m", "pulley_speed_rad_s")
    )
    magnitude = np.abs(speed)
    turns = magnitude > 0.5 * float(np.nanmax(magnitude, initial=0.0))
    is_reversed = turns.any() and median(speed[turns]) < 0.0
    return -torque if is_reversed else torque, magnitude, turns


def _has_values(columns: Mapping[str, Array], name: str) -> bool:
    return bool(np.isfinite(np.asarray(columns.get(name, np.nan), dtype=float)).any())


NAN = float("nan")
MAX_MU = 3.0
"""Largest credible friction coefficient [-]."""
CELLS = ("tension_tight_N", "tension_slack_N", "hub_force_N")
CHANNELS = (
    *CELLS,
    *("time_s", "pulley_speed_rad_s", "belt_speed_m_s", "torque_N_m", "temperature_degC"),
)
NOMINAL = ("arc_deg", "initial_tension_N", "weight_N")
"""Settings of a run, which do not change within it."""
NUMBERS = (*CHANNELS, *NOMINAL)
TEXTS = ("condition", "side")
"""Text columns with the conditions of a run."""


class RunRejected(Exception):
    """Signals that a run cannot be reduced; the message becomes the status of the run.

    It is caught within the reduction of the run: one bad run must not stop the others.
    """


@dataclass(slots=True, kw_only=True)
class RunReduction:
    """Result of one run of the friction rig. Values that could not be determined are nan.

    The passes of the reduction fill it in: a rejected run keeps the values determined before the
    reason was found. What is known before is nan or None if not stated.
    """

    run: str = ""
    arc_deg: float = NAN  # contact arc, nominal [deg]
    nominal_tension_N: float = NAN
    momentum_N: float = NAN
    """Momentum part subtracted from the tensions of a running belt [N]; nan at rest."""
    torque_with: Span | None = None  # span whose tension was measured in addition to a torque
    condition: str | None = None  # surface: dry, wet or dusty; None if not stated
    side: str | None = None  # side of the belt on the pulley: rib or back
    drag_N_m: tuple[float, float] | None = None
    """Lowest and highest bearing drag subtracted from the torque [N m]."""
    initial_tension_N: float = NAN  # mean of both cells at the start of the rotation [N]
    pulley_speed_rad_s: float = NAN  # magnitude of the pulley's speed [rad/s]
    slip_speed_m_s: float = NAN  # sliding speed |omega| R, Eq. (7) [m/s]
    tension_tight_N: float = NAN
    """Tight tension of the plateau, without ripple and tail of the peak [N]."""
    tension_slack_N: float = NAN
    mu_sliding: float = NAN  # Eq. (6) of the two plateau tensions [-]
    mu_sliding_se: float = NAN
    """Standard deviation, from the noise of the record and its correlation, the shape of the tail,
    drift and the cells; includes errors common to all runs [-]."""
    mu_sticking: float = NAN
    """Peak of mu at the end of the build-up [-]; nan if the record does not resolve it."""
    mu_sticking_se: float = NAN
    normal_force_N_m: float = NAN  # closed mean of Eq. (8) over the arc [N/m]
    temperature_degC: float = NAN  # mean over the plateau [°C]
    n_samples: int = 0  # samples of the plateau
    status: str = ""
    """"ok", or why the run was rejected."""
    mu_sticking_reason: str = "the run was set aside"
    """Why mu_sticking is missing; empty if it is given."""
    imbalance_N: float = NAN  # Tight minus slack cell at rest, as recorded [N]
    imbalance_se_N: float = NAN
    held: float = NAN  # imbalance that the cells do not explain, over the initial tension [-]
    rest_N: tuple[float, float] = (NAN, NAN)  # readings of the tight and the slack span at rest [N]
    take_up_m: float = NAN
    """Travel of the pulley's surface during the build-up [m]; nan if the record does not resolve
    it."""
    start_time_s: float = NAN  # first sample at which the pulley turns [s]
    peak_time_s: float = NAN  # time of the sticking peak [s]
    plateau_start_s: float = NAN
    plateau_end_s: float = NAN
    n_spikes: int = 0  # samples of either channel excluded as spikes
    n_missing: int = 0  # samples without a usable tension
    drift: float = NAN
    """Relative change of mu by drift over the sliding phase [-], as far as the noise allows."""
    shared_tail: float = NAN
    """Change of ln mu by one standard deviation of the tail shape, an error common to all runs
    [-]."""
    shared_drift: float = NAN  # the same for a drift of the cells common to all runs [-]
    shared_cells: float = NAN  # the same for zeros and gains of the cells [-]
    converged: bool = True  # whether the search for the noise of the bench ended
    swapped: bool = False  # whether the columns of the tight and the slack cell were swapped
    notes: tuple[str, ...] = ()  # remarks on the run for the user

    @property
    def ok(self) -> bool:
        """Whether the run may be used."""
        return self.status == "ok"

    def set_plateau(self, tight: float, slack: float, R: float) -> None:
        """Set the tensions of the plateau [N], mu by Eq. (6) and the normal force by Eq. (8).

        A friction coefficient or a normal force that the tensions do not give is nan.

        Parameters
        ----------
        tight, slack : float
            Tensions of both spans [N].
        R : float
            Radius of the belt's centreline on the pulley [m].
        """
        self.tension_tight_N, self.tension_slack_N = float(tight), float(slack)
        self.mu_sliding = float(friction_coefficient(tight, slack, np.radians(self.arc_deg)))
        is_taut = tight > 0.0 and slack > 0.0
        self.normal_force_N_m = float(mean_normal_force(tight, slack, R)) if is_taut else NAN


@dataclass(slots=True)
class RunRecord:
    """Recording of one run of the friction rig; columns of shape (n,), in order of time."""

    time_s: Array
    tension_tight_N: Array
    tension_slack_N: Array
    pulley_speed_rad_s: Array
    temperature_degC: Array | None = None
    defect: str = ""
    """Why the record cannot be a single run (e.g. a nominal setting changes); empty if it can."""
    kind: RigKind = TWO_CELLS  # what the bench measured; the tensions are derived from it
    result: RunReduction = field(default_factory=RunReduction)
    """What is known of the run before its reduction."""
    belt_speed_m_s: float = 0.0  # speed of the belt; the pulley speed is relative to it [m/s]


def arc_problem(arc_deg: float) -> str:
    """Return why a contact arc cannot be used; empty if it can."""
    if math.isfinite(arc_deg) and 0.0 < arc_deg <= 3600.0:
        return ""
    return f"arc_deg = {arc_deg:g}, must be in (0, 3600]"


def run_records(
    columns: Mapping[str, NDArray[Any]], R: float, kind: RigKind = TWO_CELLS
) -> tuple[RunRecord, ...]:
    """Split a recording into runs, in the order in which they first appear.

    Parameters
    ----------
    columns : mapping of str to ndarray
        The columns of rig.csv, shape (n,) each, as the reader checked them. Rows of a run need not
        be together; they keep their order.
    R : float
        Radius of the belt's centreline on the pulley [m].
    kind : RigKind
        What the rig measures.

    Returns
    -------
    tuple of RunRecord
        All runs except those of the idle pulley.

    Raises
    ------
    InputError
        If a channel of the kind is missing.
    """
    numbers = {name: np.asarray(columns[name], float) for name in NUMBERS if name in columns}
    texts = {k: np.asarray(columns[k], object) for k in ("idle", *TEXTS) if k in columns}
    labels = np.array([_text(label) for label in np.asarray(columns["run"]).tolist()], object)
    _, first, code = np.unique(labels.astype(str), return_index=True, return_inverse=True)
    rows = np.split(np.argsort(code, kind="stable"), np.cumsum(np.bincount(code))[:-1])
    runs, idle = [], []
    for k in np.argsort(first).tolist():
        of_run = {name: values[rows[k]] for name, values in numbers.items()}
        said = {name: x[first[k]] for name, x in texts.items() if x[first[k]] is not None}
        described = {name: text.lower() for name, text in said.items()}
        if described.pop("idle", "") == "true":
            idle.append(of_run)
        else:
            runs.append((str(labels[first[k]]), of_run, described))
    drag = drag_of(idle)
    return tuple(_record(*run, R, kind, drag) for run in runs)


def _text(label: Any) -> str:
    if label is None or label != label:
        return ""
    return str(int(label)) if isinstance(label, float) and label.is_integer() else str(label)


def _record(
    label: str,
    columns: dict[str, Array],
    described: Mapping[str, str],
    R: float,
    kind: RigKind,
    drag: Drag | None,
) -> RunRecord:
    """Build the record of one run; a nominal setting that changes within it is a defect."""
    if kind.is_derived:
        kind = kind.found_in(columns)
    nominal, defects = dict.fromkeys(NOMINAL, NAN), []
    for name in NOMINAL:
        values = columns.get(name, np.full(1, NAN))
        nominal[name] = first = float(values[0])
        changed = values[~((values == first) | (np.isnan(values) & np.isnan(first)))]
        if changed.size:
            defects.append(f"{name} changes within the run from {first:g} to {changed[0]:g}")
    run = RunReduction(
        run=label,
        arc_deg=nominal["arc_deg"],
        nominal_tension_N=nominal["initial_tension_N"],
        torque_with=kind.span_beside_torque,
        drag_N_m=drag_range(kind, drag),
        condition=described.get("condition"),
        side=described.get("side"),
    )
    missing = np.empty(0)
    record = RunRecord(
        time_s=columns["time_s"],
        tension_tight_N=columns.get("tension_tight_N", missing),
        tension_slack_N=columns.get("tension_slack_N", missing),
        pulley_speed_rad_s=columns["pulley_speed_rad_s"],
        temperature_degC=columns.get("temperature_degC"),
        defect="; ".join(defects) or arc_problem(run.arc_deg),
        kind=kind,
        result=run,
    )
    if not kind.is_derived:
        return record
    # an exact zero of a cell is a lost reading
    cells = {name: columns[name] for name in CELLS if name in columns}
    columns |= {name: np.where(values == 0.0, NAN, values) for name, values in cells.items()}
    tensions = kind.tensions(columns, run.arc_deg, R, drag)
    record.tension_tight_N, record.tension_slack_N = tensions
    record.pulley_speed_rad_s = kind.relative_speed(columns, R)
    record.kind = replace(kind, cells=PERFECT)  # known errors are already corrected
    if kind.weight is not None and np.isnan(run.nominal_tension_N):
        run.nominal_tension_N = nominal["weight_N"]
    if kind.running:
        record.belt_speed_m_s = float(np.nanmedian(kind.belt_speed(columns)))
        run.momentum_N = float(kind.momentum_N(record.belt_speed_m_s))
    return record


def drag_range(kind: RigKind, drag: Drag | None) -> tuple[float, float] | None:
    """Return the lowest and the highest drag that is subtracted from a torque [N m]."""
    if drag is None or not kind.has_torque:
        return None
    return float(np.min(drag.torque_N_m)), float(np.max(drag.torque_N_m))

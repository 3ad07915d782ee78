"""What a bench measures in place of two load cells, turned into the tensions of both spans.

The formulas are those of `laws.capstan`. What comes out goes through the same reduction as the
tensions of two cells; what differs is which errors the tensions can have.

=========== ============================== ==================================================
Kind        Measured                       Errors of the tensions
=========== ============================== ==================================================
two_cells   both tensions                  of each cell its own
dead_weight one tension; the other is W    W has none
torque      torque and one tension         torque: of the other tension; cell: of both
torque_hub  torque and hub force           half of the torque's each; of the hub force's sum
=========== ============================== ==================================================

What is known to be wrong with the cells is taken off before anything else, so that the difference
of the cells at rest is only what is left of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import InputError
from beltid.identify.estimators.statistics import integrated_autocorrelation_time, median
from beltid.laws.capstan import (
    STRAIGHT,
    Spans,
    pressing_tension,
    running_sliding_speed,
    tensions_by_hub_force,
    tensions_by_torque,
)

Array = NDArray[np.float64]
Span = Literal["tight", "slack"]
Measures = Literal["two_cells", "dead_weight", "torque", "torque_hub"]
Course = Literal["", "falls", "rises"]
SPANS: tuple[Span, Span] = ("tight", "slack")
CELL_RANGES = {"tare_N": (-1e4, 1e4), "gain": (0.1, 10.0), "tilt_deg": (-60.0, 60.0)}
"""What may be stated of a cell."""
TURNS = 0.03
"""Share of the largest speed from which on the pulley turns."""
LEAST_SLIP = 1e-9
"""Sliding speed over that of a running belt below which it is rounding."""
TOUCH_DEG = 360.0
"""Arc from which on the turns of the belt may touch each other [deg]."""


@dataclass(frozen=True, slots=True)
class KnownCell:
    """Known errors of one load cell; the defaults are those of a perfect one."""

    tare_N: float = 0.0
    """Reading without a load [N]."""
    gain: float = 1.0
    """True force over reading, less tare [-]."""
    tilt_deg: float = 0.0
    """Angle between the free span of the belt and the axis of the cell [deg]."""

    @property
    def scale(self) -> float:
        """Tension over reading, less tare [-]."""
        return self.gain / float(np.cos(np.radians(self.tilt_deg)))

    @property
    def is_perfect(self) -> bool:
        """Whether there is nothing to take off."""
        return self.tare_N == 0.0 and self.scale == 1.0

    def tension(self, reading_N: ArrayLike) -> Array:
        """Tension of the span from the reading of its cell.

        The cell feels the part of the tension along its axis,
        ``T = gain (reading - tare) / cos(tilt)``.

        Parameters
        ----------
        reading_N : array_like
            Readings [N].
        """
        return self.scale * (np.asarray(reading_N, dtype=float) - self.tare_N)

    def described(self, name: str) -> str:
        """What is taken off, in words; empty for a perfect cell."""
        parts = [
            text
            for text, is_there in (
                (f"tare {self.tare_N:g} N", self.tare_N != 0.0),
                (f"gain {self.gain:g}", self.gain != 1.0),
                (f"tilt {self.tilt_deg:g} deg", self.tilt_deg != 0.0),
            )
            if is_there
        ]
        return f"{name} {', '.join(parts)}" if parts else ""


@dataclass(frozen=True, slots=True)
class KnownCells:
    """Known errors of both load cells of the rig, each that of its own column."""

    tight: KnownCell = KnownCell()
    slack: KnownCell = KnownCell()

    @property
    def note(self) -> str:
        """What is taken off, for the user; empty if there is nothing."""
        cells = (self.tight.described("tight cell"), self.slack.described("slack cell"))
        said = "; ".join(filter(None, cells))
        return f"known errors of the load cells taken off: {said}" if said else ""


@dataclass(frozen=True, slots=True, eq=False)
class Drag:
    """Torque of a pulley that turns without a belt: that of its bearings, and the sensor's zero.

    Attributes
    ----------
    speed_rad_s, torque_N_m, torque_se_N_m : ndarray, shape (k,)
        Idle runs, by rising speed: their torque and its standard error.
    at_rest_N_m : float
        What the sensor shows before the pulley turns [N m].
    """

    speed_rad_s: Array
    torque_N_m: Array
    torque_se_N_m: Array
    at_rest_N_m: float

    def at(self, speed_rad_s: Array) -> Array:
        """Torque to be taken off at some speeds, that of the nearest idle run beyond all of them.

        Parameters
        ----------
        speed_rad_s : ndarray
            Speeds of the pulley without their sign [rad/s].
        """
        turns = speed_rad_s > TURNS * float(np.nanmax(speed_rad_s, initial=0.0))
        of_speed = np.interp(speed_rad_s, self.speed_rad_s, self.torque_N_m)
        return np.where(turns, of_speed, self.at_rest_N_m)


@dataclass(frozen=True, slots=True)
class Treatment:
    """What was done to the channels of a run before its reduction.

    Attributes
    ----------
    cells : KnownCells
        Known errors of the cells that were taken off.
    drag_N_m : tuple of float, optional
        Lowest and highest drag of the bearings that was taken off the torque [N m].
    other_span : bool
        Whether the tension beside the torque is not that of the span stated.
    course : {"", "falls", "rises"}
        How the speed went of which the run is a bin; empty for a run at a steady speed.
    n_marks : int
        Marks of an overflow that were left out of the speed of the pulley.
    """

    cells: KnownCells = KnownCells()
    drag_N_m: tuple[float, float] | None = None
    other_span: bool = False
    course: Course = ""
    n_marks: int = 0


UNTREATED = Treatment()


@dataclass(frozen=True, slots=True)
class RigKind:
    """What a friction rig measures.

    Attributes
    ----------
    measures : {"two_cells", "dead_weight", "torque", "torque_hub"}
        Its channels.
    weight_on : {"tight", "slack"}
        Span that hangs on the dead weight.
    torque_with : {"tight", "slack"}
        Span whose tension is measured beside a torque.
    running : bool
        Whether the belt moves.
    belt_speed_m_s : float
        Speed of the belt where no column tells it [m/s].
    mass_per_length_kg_m : float
        Of the belt; it matters where the belt moves [kg/m].
    cells : KnownCells
        What is known to be wrong with the cells.
    spans : Spans
        How far their forces turn by bending: a hub force is the resultant of both.

    Raises
    ------
    InputError
        If errors of a cell are out of their range, or are stated of a cell that the kind does not
        have.
    """

    measures: Measures = "two_cells"
    weight_on: Span = "tight"
    torque_with: Span = "slack"
    running: bool = False
    belt_speed_m_s: float = float("nan")
    mass_per_length_kg_m: float = 0.0
    cells: KnownCells = field(default_factory=KnownCells)
    spans: Spans = STRAIGHT

    def __post_init__(self) -> None:
        without = {"dead_weight": [self.weight_on], "torque_hub": list(SPANS)}
        problems = [
            f"friction.tension_{span}_{name} = {value!r}, must be in [{low:g}, {high:g}]"
            for span in SPANS
            for name, (low, high) in CELL_RANGES.items()
            if not low <= (value := getattr(self.cell(span), name)) <= high
        ]
        problems += [
            f"friction.tension_{span}_tare_N, _gain, _tilt_deg: rig.kind: {self.measures} has no "
            f"cell in the {span} span; errors of another channel are a calibration: "
            "units: {rig: {...: {factor: 1.0, offset: 0.0}}}"
            for span in without.get(self.measures, [])
            if not self.cell(span).is_perfect
        ]
        if problems:
            raise InputError(problems)

    def cell(self, span: Span) -> KnownCell:
        """What is known of the cell of a span."""
        return self.cells.tight if span == "tight" else self.cells.slack

    @property
    def name(self) -> str:
        """The kind as a config states it."""
        return "running" if self.running else self.measures

    @property
    def is_derived(self) -> bool:
        """Whether the tensions are not simply the readings of two cells."""
        return self.measures != "two_cells" or self.running

    @property
    def has_torque(self) -> bool:
        """Whether a torque is measured, and with it the drag of the bearings."""
        return self.measures in ("torque", "torque_hub")

    @property
    def weight(self) -> Span | None:
        """The span whose tension is a dead weight."""
        return self.weight_on if self.measures == "dead_weight" else None

    def momentum_N(self, belt_speed_m_s: Array | float) -> Array | float:
        """Part of the measured tensions that turns a running belt [N]; a hub force has none."""
        if not self.running or self.measures == "torque_hub":
            return 0.0 * belt_speed_m_s
        return self.mass_per_length_kg_m * belt_speed_m_s**2

    @property
    def needed(self) -> tuple[str, ...]:
        """Columns that this kind needs; of a torque, one of both tensions beside them."""
        if self.measures == "dead_weight":
            return ("weight_N", f"tension_{other(self.weight_on)}_N")
        if self.measures == "torque":
            return ("torque_N_m",)
        if self.measures == "torque_hub":
            return ("torque_N_m", "hub_force_N")
        return ("tension_tight_N", "tension_slack_N")

    def measured_span(self, columns: Mapping[str, Array]) -> Span:
        """The span whose tension is measured beside a torque.

        Raises
        ------
        InputError
            If there is none.
        """
        for span in (self.torque_with, other(self.torque_with)):
            if np.isfinite(columns.get(f"tension_{span}_N", np.empty(0))).any():
                return span
        raise InputError(
            "rig.kind: torque needs the tension of one span: column tension_tight_N or "
            "tension_slack_N is missing; with the force on the axis (hub_force_N) it is rig.kind: "
            "torque_hub"
        )

    @property
    def span_beside_torque(self) -> Span | None:
        """The span whose tension is measured beside a torque; None of other kinds."""
        return self.torque_with if self.measures == "torque" else None

    def with_span_of(self, columns: Mapping[str, Array]) -> RigKind:
        """The kind with the span that the columns tell the tension of beside a torque."""
        if self.measures != "torque":
            return self
        return replace(self, torque_with=self.measured_span(columns))

    def treatment(self, columns: Mapping[str, Array], drag: Drag | None) -> Treatment:
        """What `tensions` does to such channels."""
        drag_N_m = None
        if drag is not None and self.has_torque:
            drag_N_m = float(np.min(drag.torque_N_m)), float(np.max(drag.torque_N_m))
        as_stated = self.measures != "torque" or self.measured_span(columns) == self.torque_with
        return Treatment(self.cells, drag_N_m, other_span=not as_stated)

    def check(self, columns: Mapping[str, Array]) -> None:
        """Refuse columns that are not those of this kind.

        Raises
        ------
        InputError
            With the channels that are missing.
        """
        missing = [
            f"rig.kind: {self.name} needs the column {name}, which is missing"
            for name in self.needed
            if not np.isfinite(np.asarray(columns.get(name, np.empty(0)), dtype=float)).any()
        ]
        if missing:
            raise InputError(missing)
        if self.measures == "torque":
            self.measured_span(columns)
        if self.running:
            self.belt_speed(columns)
        elif np.any(np.nan_to_num(np.asarray(columns.get("belt_speed_m_s", 0.0), dtype=float))):
            raise InputError(
                f"rig.kind: {self.name}, but the column belt_speed_m_s says that the belt moves; "
                f"must be rig.kind: running, with rig.running_measures: {self.measures}"
            )

    def reversed(self, table: str) -> str:
        """What it means if the slack span seems to pull more than the tight one; "" of two cells.

        Parameters
        ----------
        table : {"rig", "points"}
            The recording, for the name under which its columns are mapped.
        """
        if self.weight is not None:
            return (
                f"the cell shows the weight to hang on the {other(self.weight)} span while the "
                f"pulley turns, rig.weight_on: {self.weight}"
            )
        if self.has_torque:
            return (
                "the torque is negative while the pulley turns; if it counts the other way, turn "
                f"its sign by a minus before its name: columns: {{{table}: {{torque_N_m: "
                '"-torque_N_m"}}'
            )
        return ""

    def belt_speed(self, columns: Mapping[str, Array]) -> Array:
        """Speed of the belt [m/s], without its sign.

        Raises
        ------
        InputError
            If neither a column nor the config tells it.
        """
        speed = np.asarray(columns.get("belt_speed_m_s", np.nan), dtype=float)
        speed = np.abs(np.where(np.isfinite(speed), speed, self.belt_speed_m_s))
        if not np.isfinite(speed).any():
            raise InputError(
                "rig.kind: running needs the speed of the belt: column belt_speed_m_s is missing, "
                "and the config states no rig.belt_speed_m_s"
            )
        return speed

    def tensions(
        self,
        columns: Mapping[str, Array],
        arc_deg: float | Array,
        R: float,
        drag: Drag | None = None,
    ) -> tuple[Array, Array]:
        """Tensions that press the belt onto the pulley [N], shape (n,) each.

        Parameters
        ----------
        columns : mapping of str to ndarray
            The channels of this kind, shape (n,) each.
        arc_deg : float or ndarray
            Contact arc [deg].
        R : float
            Radius of the belt's centreline on the pulley [m].
        drag : Drag, optional
            What is taken off the torque.
        """
        span = {name: self._span(columns, name) for name in SPANS}
        if self.measures == "torque_hub":
            # the force on the axis has no part of the momentum that the belt carries along
            hub, beta = columns["hub_force_N"], np.radians(arc_deg)
            return tensions_by_hub_force(self._torque(columns, drag), hub, beta, R, self.spans)
        if self.measures == "torque":
            there = self.measured_span(columns)
            known = {f"T_{there}": span[there]}
            return tensions_by_torque(self._torque(columns, drag), R, **known)
        return span["tight"], span["slack"]

    def _span(self, columns: Mapping[str, Array], span: Span) -> Array:
        """Tension of a span from its cell or weight."""
        if span == self.weight:
            tension = np.asarray(columns["weight_N"], dtype=float)
        else:
            reading = np.asarray(columns.get(f"tension_{span}_N", np.nan), dtype=float)
            tension = self.cell(span).tension(reading)
        if not self.running:
            return tension
        return pressing_tension(tension, self.mass_per_length_kg_m, self.belt_speed(columns))

    def _torque(self, columns: Mapping[str, Array], drag: Drag | None) -> Array:
        """Torque of the belt, in the sense of the rotation."""
        torque, speed = (
            np.asarray(columns[k], float) for k in ("torque_N_m", "pulley_speed_rad_s")
        )
        size = np.abs(speed)
        turning = speed[size > 0.5 * float(np.nanmax(size, initial=0.0))]
        if turning.size and median(turning) < 0.0:
            torque = -torque
        return torque if drag is None else torque - drag.at(size)

    def relative_speed(self, columns: Mapping[str, Array], R: float) -> Array:
        """Speed of the pulley that gives the sliding speed under a belt at rest [rad/s]."""
        speed = np.asarray(columns["pulley_speed_rad_s"], dtype=float)
        if not self.running:
            return speed
        belt = self.belt_speed(columns)
        sliding = running_sliding_speed(np.abs(speed), R, belt)
        return np.where(np.abs(sliding) > LEAST_SLIP * belt, sliding, 0.0) / R


TWO_CELLS = RigKind()
"""The rig of the paper."""


def other(span: Span) -> Span:
    """The span on the other side of the pulley."""
    return "slack" if span == "tight" else "tight"


def drag_of(idle: Sequence[Mapping[str, Array]]) -> Drag | None:
    """Drag of the bearings from runs of the pulley without the belt; None without such runs.

    Parameters
    ----------
    idle : sequence of mapping
        Columns pulley_speed_rad_s [rad/s] and torque_N_m [N m] of each run.
    """
    speeds, torques, errors, rest = [], [], [], []
    for columns in idle:
        speed, torque = (
            np.atleast_1d(np.asarray(columns[name], dtype=float))
            for name in ("pulley_speed_rad_s", "torque_N_m")
        )
        size = np.abs(speed)
        turns = np.isfinite(torque) & (size > 0.5 * float(np.nanmax(size, initial=0.0)))
        if not turns.any():
            continue
        sign = -1.0 if median(speed[turns]) < 0.0 else 1.0
        part = sign * torque[turns]
        memory = integrated_autocorrelation_time(part) if part.size > 8 else 1.0
        speeds.append(median(size[turns]))
        torques.append(float(np.mean(part)))
        errors.append(float(np.std(part)) * np.sqrt(max(memory, 1.0) / part.size))
        still = np.isfinite(torque) & (size <= TURNS * float(np.nanmax(size)))
        if still.any():
            rest.append(sign * float(np.mean(torque[still])))
    if not speeds:
        return None
    order = np.argsort(speeds, kind="stable")
    return Drag(
        speed_rad_s=np.array(speeds)[order],
        torque_N_m=np.array(torques)[order],
        torque_se_N_m=np.array(errors)[order],
        at_rest_N_m=float(np.mean(rest)) if rest else 0.0,
    )

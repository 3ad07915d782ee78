"""Tensions of both spans from what a friction rig measures.

Any two of these channels give the two span forces; the formulas are in `laws.capstan`. The tensions
go through the same reduction as those of two cells; only the errors that they can have differ.

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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import InputError
from beltid.identify.estimators import median
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
SPANS: tuple[Span, Span] = ("tight", "slack")
TURNS = 0.03
"""Share of the largest speed above which the pulley counts as turning."""
LEAST_SLIP = 1e-9
"""Ratio of sliding speed to belt speed below which the sliding is rounding error."""
TOUCH_DEG = 360.0
"""Arc beyond which the turns of the belt may touch each other [deg]."""


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
        if self.running:
            self.belt_speed(columns)
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
        if not self.running or self.measures == "torque_hub":
            return 0.0 * belt_speed_m_s
        return self.mass_per_length_kg_m * belt_speed_m_s**2

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

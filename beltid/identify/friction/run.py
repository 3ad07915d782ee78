"""Runs of a friction rig, and the tensions of both spans from what the rig measures.

A recording is a table; `run_records` splits it into runs. Any two of the channels give the two span
forces (theory page, "The channels"; the formulas are in `laws.capstan`). All tensions go through
the same reduction; only the errors that they can have differ: those of the cells, none in a weight,
those of a torque in the tension that was not measured, half in each beside a hub force.

Known errors of the cells are corrected here, so that the difference of the cells at rest shows only
the unknown rest.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.arrays import Array, Columns, Mask
from beltid.errors import InputError
from beltid.laws.capstan import (
    STRAIGHT,
    Spans,
    friction_coefficient,
    mean_normal_force,
    pressing_tension,
    sliding_speed,
    tensions_by_hub_force,
    tensions_by_torque,
)

Span = Literal["tight", "slack"]
Measures = Literal["two_cells", "dead_weight", "torque", "torque_hub"]
SPANS: tuple[Span, Span] = ("tight", "slack")
OTHER: dict[Span, Span] = {"tight": "slack", "slack": "tight"}
TURNS = 0.03  # share of the largest speed above which the pulley counts as turning
LEAST_SLIP = 1e-9  # ratio of sliding speed to belt speed below which the sliding is rounding error
NAN = float("nan")
MAX_MU = 3.0  # largest credible friction coefficient [-]
CELLS = ("tension_tight_N", "tension_slack_N", "hub_force_N")
NOMINAL = ("arc_deg", "initial_tension_N", "weight_N")
"""Settings of a run, which do not change within it."""
SPEEDS = ("pulley_speed_rad_s", "belt_speed_m_s")
NUMBERS = (*CELLS, *NOMINAL, *SPEEDS, "time_s", "torque_N_m", "temperature_degC")
TEXTS = ("condition", "side")  # text columns with the conditions of a run


@dataclass(frozen=True, slots=True)
class KnownCell:
    """Known errors of one load cell; the defaults describe a perfect one."""

    tare_N: float = 0.0  # reading without load [N]
    gain: float = 1.0  # ratio of the true force to the reading less tare [-]

    def tension(self, reading_N: ArrayLike) -> Array:
        """Convert readings [N] to the tension, ``gain (reading - tare)``; exact zeros are lost."""
        reading = np.asarray(reading_N, dtype=float)
        return self.gain * (np.where(reading == 0.0, np.nan, reading) - self.tare_N)


PERFECT = (KnownCell(), KnownCell())


@dataclass(frozen=True, slots=True)
class RigKind:
    """What a friction rig measures."""

    measures: Measures = "two_cells"  # measured channels
    weight_on: Span = "tight"  # span that carries the dead weight
    torque_with: Span = "slack"  # span whose tension is measured in addition to a torque
    running: bool = False  # whether the belt moves
    mass_per_length_kg_m: float = 0.0  # of a moving belt
    cells: tuple[KnownCell, KnownCell] = PERFECT  # known errors of the tight and the slack cell
    spans: Spans = STRAIGHT
    """Rotation of the span forces by bending: a hub force is the resultant of both."""
    weight_stated: bool = True
    """Whether the user said which span that is: a weight beside a torque does not show it."""
    weighs: bool = False  # whether the tension measured in addition to a torque is a weight

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

    def lacks(self, columns: Columns) -> list[str]:
        """Return which channels are missing, in words."""
        beside = "weight_N" if self.weighs else f"tension_{self.torque_with}_N"
        needed = {
            "two_cells": CELLS[:2],
            "dead_weight": ("weight_N", f"tension_{OTHER[self.weight_on]}_N"),
            "torque": ("torque_N_m", beside),
            "torque_hub": ("torque_N_m", "hub_force_N"),
        }[self.measures] + ("belt_speed_m_s",) * self.running
        return [f"column {name} is missing" for name in needed if not _has_values(columns, name)]

    def found_in(self, columns: Columns) -> Self:
        """Return this kind with what a recording holds beside a torque, or raise `InputError`."""
        found = self
        if self.measures == "torque":
            both = (self.torque_with, OTHER[self.torque_with])
            spans = [span for span in both if _has_values(columns, f"tension_{span}_N")]
            weighs = not spans and _has_values(columns, "weight_N")
            if weighs and not self.weight_stated:
                raise InputError(
                    "a weight beside a torque: state the span that carries it, "
                    "rig.holds: weight_tight or rig.holds: weight_slack"
                )
            beside = self.weight_on if weighs else (spans or both)[0]
            found = replace(self, torque_with=beside, weighs=weighs)
        if missing := found.lacks(columns):
            raise InputError(missing)
        return found

    @property
    def reversed(self) -> str:
        """What explains a slack tension above the tight one; empty for two cells."""
        if self.measures == "dead_weight":
            return (
                f"the cell shows that the weight hangs on the {OTHER[self.weight_on]} span while "
                f"the pulley turns, but the config states rig.holds: weight_{self.weight_on}"
            )
        if self.has_torque:
            return (
                "the torque is negative while the pulley turns; if the sensor counts the other "
                "way, reverse its sign with a minus before the column name: columns: "
                '{rig: {torque_N_m: "-torque_N_m"}}'
            )
        return ""

    def tensions(self, columns: Columns, arc_deg: float | Array, R: float) -> tuple[Array, Array]:
        """Compute the tensions that press the belt on an arc [deg], radius R [m], (n,) each [N].

        A torque is that of the belt alone, in the direction of rotation.
        """
        if self.measures == "torque_hub":
            hub, beta = PERFECT[0].tension(columns["hub_force_N"]), np.radians(arc_deg)
            return tensions_by_hub_force(columns["torque_N_m"], hub, beta, R, self.spans)
        belt = np.abs(columns["belt_speed_m_s"]) if self.running else 0.0
        measured = SPANS if self.measures != "torque" else (self.torque_with,)
        tensions = {}
        for span in measured:
            cell = self.cells[SPANS.index(span)]
            weighs = span == self.weight
            force = columns["weight_N"] if weighs else cell.tension(columns[f"tension_{span}_N"])
            tensions[f"T_{span}"] = pressing_tension(force, self.mass_per_length_kg_m, belt)
        if self.measures == "torque":
            return tensions_by_torque(columns["torque_N_m"], R, **tensions)
        return tensions["T_tight"], tensions["T_slack"]

    def relative_speed(self, columns: Columns, R: float) -> Array:
        """Return the pulley speed relative to the belt, which gives the sliding speed [rad/s]."""
        if not self.running:
            return columns["pulley_speed_rad_s"]
        belt = np.abs(columns["belt_speed_m_s"])
        sliding = sliding_speed(np.abs(columns["pulley_speed_rad_s"]), R) - belt
        return np.where(np.abs(sliding) > LEAST_SLIP * belt, sliding, 0.0) / R


TWO_CELLS = RigKind()  # the rig of the paper


def idle_torque(idle: Sequence[Columns], speed_rad_s: Array) -> Array:
    """Return the torque of the pulley without a belt, by such runs, at its speeds [N m], (n,).

    It is bearing friction, constant beyond the speeds of these runs, and the zero of the sensor;
    where the pulley stands, what the sensor reads before it turns.
    """
    runs = [run for run in map(in_direction, idle) if run[2].any()]
    if not runs:
        return np.zeros(speed_rad_s.size)
    found = sorted((np.median(v[turns]), np.mean(M[turns])) for M, v, turns in runs)
    still = [M[np.isfinite(M) & (v <= TURNS * float(np.nanmax(v)))] for M, v, _ in runs]
    at_rest = np.mean([np.mean(M) for M in still if M.size] or 0.0)
    turns = speed_rad_s > TURNS * float(np.nanmax(speed_rad_s, initial=0.0))
    return np.where(turns, np.interp(speed_rad_s, *np.transpose(found)), at_rest)


def in_direction(columns: Columns) -> tuple[Array, Array, Mask]:
    """Return torque and speed in the direction of rotation, and where the pulley surely turns."""
    torque, speed = columns["torque_N_m"], columns["pulley_speed_rad_s"]
    turns = np.abs(speed) > 0.5 * float(np.nanmax(np.abs(speed), initial=0.0))
    backwards = turns.any() and np.median(speed[turns]) < 0.0
    return -torque if backwards else torque, np.abs(speed), turns & np.isfinite(torque)


def _has_values(columns: Columns, name: str) -> bool:
    return bool(np.isfinite(columns.get(name, np.nan)).any())


class RunRejected(Exception):
    """Says why a run cannot be reduced: its status; one bad run does not stop the others."""


def reject(holds: bool | np.bool_, reason: str) -> None:
    """Raise `RunRejected` with the reason if it holds."""
    if holds:
        raise RunRejected(reason)


@dataclass(slots=True, kw_only=True)
class RunReduction:
    """Result of one run of the friction rig. What is not known is nan or None.

    The passes of the reduction fill it in: a rejected run keeps what was found before the reason.
    """

    run: str = ""
    arc_deg: float = NAN  # contact arc, nominal [deg]
    nominal_tension_N: float = NAN
    momentum_N: float = NAN  # subtracted from the tensions of a running belt; nan at rest
    torque_with: Span | None = None  # span whose tension was measured in addition to a torque
    condition: str | None = None  # surface: dry, wet or dusty
    side: str | None = None  # side of the belt on the pulley: rib or back
    drag_N_m: float = NAN  # largest torque of the idle pulley that was subtracted
    initial_tension_N: float = NAN  # mean of both cells at the start of the rotation
    pulley_speed_rad_s: float = NAN  # magnitude of the pulley's speed
    slip_speed_m_s: float = NAN  # sliding speed |omega| R, Eq. (7)
    tension_tight_N: float = NAN  # of the plateau, without ripple and tail of the peak
    tension_slack_N: float = NAN
    mu_sliding: float = NAN  # Eq. (6) of the two plateau tensions
    mu_sliding_se: float = NAN  # its standard deviation, with errors common to all runs
    mu_sticking: float = NAN  # peak of mu at the end of the build-up; nan if it is not resolved
    mu_sticking_se: float = NAN
    normal_force_N_m: float = NAN  # closed mean of Eq. (8) over the arc
    temperature_degC: float = NAN  # mean over the plateau
    n_samples: int = 0  # samples of the plateau
    status: str = ""  # "ok", or why the run was rejected
    mu_sticking_reason: str = "the run was set aside"  # why mu_sticking is missing; or empty
    imbalance_N: float = NAN  # Tight minus slack cell at rest, as recorded
    imbalance_se_N: float = NAN
    held: float = NAN  # imbalance that the cells do not explain, over the initial tension
    rest_N: tuple[float, float] = (NAN, NAN)  # readings of the tight and the slack span at rest
    take_up_m: float = NAN  # travel of the pulley's surface during the build-up; nan if unresolved
    start_time_s: float = NAN  # first sample at which the pulley turns
    peak_time_s: float = NAN  # time of the sticking peak
    plateau_start_s: float = NAN
    plateau_end_s: float = NAN
    n_spikes: int = 0  # samples of either channel excluded as spikes
    n_missing: int = 0  # samples without a usable tension
    drift: float = NAN  # relative change of mu by drift over the sliding phase
    shared_tail: float = NAN
    """Changes of ln mu by one standard deviation of errors common to all runs: the tail shape, a
    drift of the cells, zeros and gains of the cells."""
    shared_drift: float = NAN
    shared_cells: float = NAN
    converged: bool = True  # whether the search for the noise of the bench ended
    swapped: bool = False  # whether the columns of the tight and the slack cell were swapped
    notes: tuple[str, ...] = ()  # remarks on the run for the user

    @property
    def ok(self) -> bool:
        """Whether the run may be used."""
        return self.status == "ok"

    def set_plateau(self, tight: float, slack: float, R: float) -> None:
        """Set tensions [N], mu by Eq. (6), the normal force by Eq. (8); nan where not given."""
        self.tension_tight_N, self.tension_slack_N = float(tight), float(slack)
        self.mu_sliding = float(friction_coefficient(tight, slack, np.radians(self.arc_deg)))
        is_taut = tight > 0.0 and slack > 0.0
        self.normal_force_N_m = float(mean_normal_force(tight, slack, R)) if is_taut else NAN


@dataclass(frozen=True, slots=True, eq=False)
class RunRecord:
    """Recording of one run of the friction rig in order of time, n samples."""

    time_s: Array  # (n,)
    tensions: Array  # of the tight and the slack span [N], nan where unusable, (n, 2)
    speed: Array  # of the pulley relative to the belt [rad/s], (n,)
    temperature: Array  # [°C], nan if unknown, (n,)
    kind: RigKind = TWO_CELLS  # what the bench measured; the tensions are derived from it
    result: RunReduction = field(default_factory=RunReduction)
    """What is known before; its status says which channels it lacks."""
    belt_speed_m_s: float = 0.0


def run_records(
    columns: Mapping[str, NDArray[Any]], R: float, kind: RigKind = TWO_CELLS
) -> tuple[RunRecord, ...]:
    """Split a recording into runs, in the order in which they first appear, without idle ones.

    The columns are those of rig.csv (n,), as the reader checked them; rows of a run need not be
    together, but keep their order. R [m] is the radius of the belt's centreline on the pulley.
    Raises `InputError` if a channel of the kind is missing.
    """
    numbers = {name: np.asarray(columns[name], float) for name in NUMBERS if name in columns}
    kind = kind.found_in(numbers)
    _, code = np.unique(np.asarray(columns["run"]).astype(str), return_inverse=True)
    rows = np.split(np.argsort(code, kind="stable"), np.cumsum(np.bincount(code))[:-1])
    runs, idle = [], []
    for of_run in sorted(rows, key=lambda of_run: int(of_run[0])):
        samples = {name: values[of_run] for name, values in numbers.items()}
        texts = {name: columns[name][of_run[0]] for name in ("idle", *TEXTS) if name in columns}
        words = {name: text.lower() for name, text in texts.items() if text is not None}
        if words.pop("idle", "") == "true":
            idle.append(samples)
        else:
            runs.append((RunReduction(run=str(columns["run"][of_run[0]]), **words), samples))
    return tuple(_record(run, samples, R, kind, idle) for run, samples in runs)


def _record(
    run: RunReduction, columns: Columns, R: float, kind: RigKind, idle: Sequence[Columns]
) -> RunRecord:
    """Build the record of one run, its torque freed of drag and counted as the pulley turns."""
    run.arc_deg, T_0, W = (float(columns[name][0]) if name in columns else NAN for name in NOMINAL)
    run.nominal_tension_N = W if kind.weight and np.isnan(T_0) else T_0
    run.torque_with, belt_speed = kind.span_beside_torque, 0.0
    run.status = "; ".join(kind.lacks(columns))
    if kind.has_torque:
        torque, speed, _ = in_direction(columns)
        drag = idle_torque(idle, speed)
        run.drag_N_m = float(np.nanmax(np.abs(drag))) if idle else NAN
        columns = {**columns, "torque_N_m": torque - drag}
    if kind.running:
        belt_speed = float(np.nanmedian(np.abs(columns["belt_speed_m_s"])))
        # the momentum of the belt does not load the axis
        mass = 0.0 if kind.measures == "torque_hub" else kind.mass_per_length_kg_m
        run.momentum_N = mass * belt_speed**2
    t, tensions = columns["time_s"], np.column_stack(kind.tensions(columns, run.arc_deg, R))
    speed = kind.relative_speed(columns, R)
    temperature = columns.get("temperature_degC", np.full(t.size, NAN))
    return RunRecord(t, tensions, speed, temperature, kind, run, belt_speed)

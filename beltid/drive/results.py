"""Results of a drive at an operating point: speeds, speed losses, forces, reserves.

The loss is relative to idling, as on the bench: an error of a radius of 0.2 % is as large as the
whole loss and cancels. The logarithm of the speed ratio is a sum of contributions of the strains,
the penetrations and the sliding of whole pulleys (D10); the loss is divided in that proportion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.drive.geometry import preceding
from beltid.drive.loop import LoopState, solve_loop
from beltid.drive.model import Drive, DrivePoint
from beltid.drive.rest import RestState, rest_state
from beltid.drive.rods import RodLevel, adhesion_arc
from beltid.drive.string import Level
from beltid.rig.flow import FlowState

Array = NDArray[np.float64]

Method = Literal["string", "rod"]

ADHESION: Final = "adhesion"
FULL_SLIP: Final = "full slip"
GROSS_SLIP: Final = "gross slip"
SLACK: Final = "slack"

PLACES: Final = 60  # along the sliding arc of the string
SHARES: Final = (
    "slip_speed_max_m_s",
    "normal_force_min_N_m",
    "normal_force_max_N_m",
    "share_below_speed_range",
    "share_outside_force_range",
)


class SpeedLoss(NamedTuple):
    """Loss of angular speed of every pulley against idling, and its parts, all (n,) [rad/s].

    It is the speed when idling less that under load, at the same speed of the driver.
    """

    total: Array
    creep: Array  # by the strains of the belt
    seating: Array  # by the penetrations
    slip: Array  # of pulleys that slide as a whole


@dataclass(frozen=True, slots=True)
class DriveResult:
    """Result at one operating point; arrays (n,) follow the pulleys in the order of `drive`."""

    point: DrivePoint
    drive: Drive  # its belt runs in the order of the pulleys
    rest: RestState
    state: LoopState  # under load
    idle: LoopState  # without the torques that are taken off

    def in_order(self, values: Array) -> Array:
        """Reorder values (n, ...) of the pulleys to the order in which the user stated them."""
        return values[::-1] if self.point.omega < 0.0 else values

    @property
    def status(self) -> tuple[str, ...]:
        """State of each pulley: adhesion, full slip, gross slip; slack if a span has no force."""
        if self.state.slack or self.idle.slack:
            return (SLACK,) * len(self.drive.pulleys)
        slip = self.state.arcs.slip
        names = np.where(slip == 0.0, ADHESION, FULL_SLIP)
        return tuple(np.where(np.isnan(slip), GROSS_SLIP, names).tolist())

    @property
    def speed(self) -> Array:
        """Angular speeds [rad/s], all with the driver's sign; nan without a steady state."""
        return np.sign(self.point.omega) * self._magnitude(self.state)

    @property
    def loss(self) -> SpeedLoss:
        """Speed loss relative to idling, and its parts, (D10)."""
        driver = self.drive.driver
        idling = self._magnitude(self.idle)
        behind = [
            (idle - idle[driver]) - (now - now[driver])
            for idle, now in zip(self._logs(self.idle), self._logs(self.state), strict=True)
        ]
        log_ratio = np.sum(behind, axis=0)
        total = np.where(np.isnan(self.speed), np.nan, -idling * np.expm1(-log_ratio))
        # the parts add up to the logarithm; the loss is divided in their proportion
        per_log = np.divide(total, log_ratio, out=idling.copy(), where=log_ratio != 0.0)
        return SpeedLoss(total, *(per_log * part for part in behind))

    @property
    def tensions(self) -> tuple[Array, Array]:
        """Axial forces of the belt before and after each pulley [N]."""
        strain = self.drive.stretch(self.state.P, self.state.v0) - 1.0
        leaving = self._known(self.drive.belt.EA * strain)
        return preceding(leaving), leaving

    @property
    def hub_force(self) -> Array:
        """Force of the belt on the axis of each pulley [N], shape (n, 2)."""
        return self._known(self.state.laid.hub_forces(self.state.P))

    @property
    def span_frequency(self) -> Array:
        """Lowest natural frequency of the span behind each pulley, sqrt(P/m)/(2 L) [Hz]."""
        speed = np.sqrt(np.maximum(self.state.P, 0.0) / self.drive.belt.rhoA)  # of waves
        return self._known(speed / (2.0 * self.state.laid.spans))

    @property
    def torque(self) -> Array:
        """Torque at each pulley [N m]: delivered by the driver, taken off by the others."""
        on_belt = self._known(self.state.arcs.torque)
        return np.where(np.arange(on_belt.size) == self.drive.driver, on_belt, -on_belt)

    @property
    def load(self) -> float:
        """Largest torque that a pulley takes off [N m]; 0 when the drive idles or is slack."""
        taken_off = np.delete(self.torque, self.drive.driver)
        return float(np.nanmax(taken_off, initial=0.0))

    @property
    def reserve(self) -> Array:
        """Arc on which the belt can slide over the arc that the change of force needs.

        Below 1 the whole pulley slides; infinite on an idler. A rod can slide where it sticks.
        """
        arcs, sticks = self.state.arcs, self._adhesion
        is_string = np.isnan(sticks) | (arcs.slip != 0.0)
        room = np.where(is_string, arcs.room, arcs.needed + sticks)
        idler = np.full(room.size, np.inf)
        return self._known(np.divide(room, arcs.needed, out=idler, where=arcs.needed > 0.0))

    @property
    def arc_used(self) -> Array:
        """Arc that does not stick on each pulley [rad]."""
        wraps, sticks = self.state.laid.wraps, self._adhesion
        used = np.where(np.isnan(sticks), np.minimum(self.state.arcs.needed, wraps), wraps - sticks)
        return self._known(used)

    @property
    def _adhesion(self) -> Array:
        """Angle on which the rod of each pulley sticks [rad]; nan of a string."""
        return np.array([math.nan if rod is None else adhesion_arc(rod) for rod in self._rods])

    @property
    def _rods(self) -> tuple[FlowState | None, ...]:
        """Rods of the pulleys, None for a string."""
        return self.state.rods or (None,) * self.state.P.size

    @property
    def shares(self) -> dict[str, Array]:
        """Where the friction of the pulleys acts, as columns of the drive table; nan if slack.

        There is more than one steady state only if friction falls with the speed.
        """
        state, level = self.state, self.state.level
        rows, states = np.full((state.P.size, 5), np.nan), np.zeros(state.P.size, dtype=np.int64)
        for i, rod in enumerate(() if state.slack else self._rods):
            P_in, P_out, x = float(state.P_in[i]), float(state.P[i]), float(state.arcs.slip[i])
            f, v, _ = level.along_arc(i, np.array([P_in, P_out]), state.v0, x)
            slides = level.arcs_by_speed(i, P_in, P_out, state.v0) > state.arcs.room[i]
            states[i] = int(not slides[0]) + np.count_nonzero(slides[1:] != slides[:-1])
            outside = level.outside(i, P_in, P_out, state.v0, x)
            if rod is not None:
                f, v = rod.touching["f_N"], rod.touching["speed"]
            rows[i] = v.max(), f.min(), f.max(), *outside
        return {**dict(zip(SHARES, rows.T, strict=True)), "steady_states": states}

    @property
    def friction_power(self) -> Array:
        """Power lost to friction on each pulley [W], (D11).

        The power of the shaft less the power that the belt carries away; the sum over all pulleys
        equals that of torque times speed.
        """
        state, belt = self.state, self.drive.belt
        # (1 + eps) dP, integrated: energy that the belt carries, per stress-free length
        carried = (
            0.5 * (belt.EA - belt.rhoA * state.v0**2) * self.drive.stretch(state.P, state.v0) ** 2
        )
        taken_along = state.v0 * (preceding(carried) - carried)
        return self._known(state.arcs.torque * self._magnitude(state) - taken_along)

    def along_arc(self, i: int) -> tuple[Array, Array, Array]:
        """Return angle from the entry [rad], line force [N/m] and slip [m/s] along an arc.

        The slip is positive where the pulley is ahead of the belt.
        """
        state, level, rod = self.state, self.state.level, self._rods[i]
        if rod is not None:
            angle = rod.touching["theta"] + 0.5 * float(self.rest.laid.wraps[i])
            return angle, rod.touching["f_N"], rod.touching["slip"]
        # the adhesion arc, then the sliding arc, with (D4) summed over steps of ln P
        P = np.geomspace(state.P_in[i], state.P[i], PLACES)
        force, slip, mu = level.along_arc(i, P, state.v0, float(state.arcs.slip[i]))
        steps = 0.5 * (1.0 / mu[1:] + 1.0 / mu[:-1]) * np.abs(np.diff(np.log(P)))
        from_exit = np.append(np.cumsum(steps[::-1])[::-1], 0.0)
        angle = np.append(0.0, np.maximum(state.laid.wraps[i] - from_exit, 0.0))
        ahead = math.copysign(1.0, P[0] - P[-1])
        return angle, np.append(force[0], force), ahead * np.append(slip[0], slip)

    def _known(self, values: Array) -> Array:
        """Return values, or nan for a slack drive, which has no numbers."""
        return np.where(self.state.slack, np.nan, values)

    def _magnitude(self, state: LoopState) -> Array:
        """Return the absolute speeds of the pulleys [rad/s]."""
        slips = np.isnan(state.arcs.slip)
        speed = np.where(slips, np.nan, state.arcs.W * state.v0)
        driver = self.drive.driver
        if state.slack or slips[driver]:  # the flow of the belt is not known
            speed[:] = np.nan
        speed[driver] = abs(self.point.omega)
        return speed

    def _logs(self, state: LoopState) -> tuple[Array, Array, Array]:
        """Return the summands of ln(omega / v0): stretch, seating, slip of a whole pulley."""
        stretch = self.drive.stretch(state.P_in, state.v0)
        rate = state.arcs.rate
        with np.errstate(invalid="ignore", divide="ignore"):  # in gross slip nothing is known
            return np.log(stretch), np.log(rate / stretch), np.log(state.arcs.W / rate)


class Simulator:
    """Solve operating points of a drive; the belt at rest and the idling drive are cached.

    An InputError says that rods have no contact law.
    """

    def __init__(self, drive: Drive, method: Method = "string") -> None:
        self.drive, self.method, self.strings = drive, method, Level.of(drive)
        self._rods = RodLevel(drive, self.strings) if method == "rod" else None
        self._rest: dict[str, tuple[RestState, Level]] = {}
        self._idle: dict[tuple[float, str], LoopState] = {}

    def solve(self, point: DrivePoint, near: DriveResult | None = None) -> DriveResult:
        """Find the steady state of a point, and of the drive that idles at its speed.

        At a negative speed of the driver the belt runs against the order of the pulleys: the result
        then contains the reversed drive and the reversed point. The search starts from a result at
        the same point of a similar drive, if there is one ``near``. An InputError says that the
        belt cannot be laid on or tightened as stated, a ConvergenceError that no steady state was
        found.
        """
        if point.omega < 0.0:
            return self.backwards._forwards(point.reversed(), near)
        return self._forwards(point, near)

    @cached_property
    def backwards(self) -> Simulator:
        """Simulator of the belt that runs the other way."""
        return Simulator(self.drive.reversed(), self.method)

    def at_rest(self, point: DrivePoint) -> RestState:
        """Tighten the belt at rest, as the point states it."""
        return self._tightened(point.T_0)[0]

    def _tightened(self, T_0: float) -> tuple[RestState, Level]:
        """Return the belt at rest, and the level of its pulleys."""
        key = str(T_0)  # nan is no key: it differs from itself
        if key not in self._rest:
            if self._rods is None:
                self._rest[key] = rest_state(self.drive, self.strings, T_0), self.strings
            else:
                self._rest[key] = self._rods.at_rest(T_0)
        return self._rest[key]

    def _forwards(self, point: DrivePoint, near: DriveResult | None) -> DriveResult:
        """Solve a point with the belt running in the order of the pulleys."""
        (rest, _), key = self._tightened(point.T_0), (point.omega, str(point.T_0))
        unloaded = point.scaled(0.0)
        if key not in self._idle:
            self._idle[key] = self._loop(unloaded, None if near is None else near.idle)
        idle = state = self._idle[key]
        if point != unloaded:
            state = self._loop(point, None if near is None else near.state)
        return DriveResult(point, self.drive, rest, state, idle)

    def _loop(self, point: DrivePoint, near: LoopState | None) -> LoopState:
        rest, level = self._tightened(point.T_0)
        if self._rods is None:
            return solve_loop(point, level, rest, near)
        return self._rods.solve(point, rest, level, near)

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

from beltid.drive.first_call import compiled
from beltid.drive.geometry import preceding
from beltid.drive.loop import LoopState, solve_loop
from beltid.drive.model import Drive, DrivePoint
from beltid.drive.rest import RestState, rest_state
from beltid.drive.rods import RodLevel, adhesion_arc
from beltid.drive.string import StringLevel

Array = NDArray[np.float64]

Method = Literal["string", "rod"]

ADHESION: Final = "adhesion"
FULL_SLIP: Final = "full slip"
GROSS_SLIP: Final = "gross slip"
SLACK: Final = "slack"


@dataclass(frozen=True, slots=True)
class SpeedLoss:
    """Loss of angular speed of every pulley against idling, all arrays (n,) [rad/s].

    Attributes
    ----------
    total : ndarray
        Speed when idling less speed under load, at the same speed of the driver; positive if a
        pulley falls behind.
    creep : ndarray
        Part due to the strains of the belt.
    seating : ndarray
        Part due to the penetrations.
    slip : ndarray
        Part due to pulleys that slide as a whole.
    """

    total: Array
    creep: Array
    seating: Array
    slip: Array


class SlidingShares(NamedTuple):
    """Where the friction of the pulleys acts, all arrays (n,).

    Attributes
    ----------
    slip_speed_max : ndarray
        Largest sliding speed [m/s].
    normal_force_min, normal_force_max : ndarray
        Smallest and largest line force [N/m].
    below_speed_range : ndarray
        Share of the sliding friction below the lowest measured sliding speed [-].
    outside_force_range : ndarray
        Share of the sliding friction outside the measured line forces [-].
    steady_states : ndarray of int
        Number of states in which the arc carries its forces; more than one only if mu falls with
        speed.
    """

    slip_speed_max: Array
    normal_force_min: Array
    normal_force_max: Array
    below_speed_range: Array
    outside_force_range: Array
    steady_states: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class DriveResult:
    """Result at one operating point; arrays (n,) follow the pulleys in the order of `drive`.

    Attributes
    ----------
    point : DrivePoint
        The operating point.
    drive : Drive
        The drive, its belt running in the order of the pulleys.
    rest : RestState
        The belt at rest.
    state, idle : LoopState
        States under load, and without the torques that are taken off.
    """

    point: DrivePoint
    drive: Drive
    rest: RestState
    state: LoopState
    idle: LoopState

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
        leaving = self.drive.belt.EA * (self.drive.stretch(self.state.P, self.state.v0) - 1.0)
        leaving = np.where(self.state.slack, np.nan, leaving)
        return preceding(leaving), leaving

    @property
    def hub_force(self) -> Array:
        """Force of the belt on the axis of each pulley [N], shape (n, 2)."""
        forces = self.state.laid.hub_forces(self.state.P)
        return np.where(self.state.slack, np.nan, forces)

    @property
    def span_frequency(self) -> Array:
        """Lowest natural frequency of the span behind each pulley, sqrt(P/m)/(2 L) [Hz]."""
        speed = np.sqrt(np.maximum(self.state.P, 0.0) / self.drive.belt.rhoA)  # of waves
        return np.where(self.state.slack, np.nan, speed / (2.0 * self.state.laid.spans))

    @property
    def torque(self) -> Array:
        """Torque at each pulley [N m]: delivered by the driver, taken off by the others."""
        on_belt = np.where(self.state.slack, np.nan, self.state.arcs.torque)
        return np.where(np.arange(on_belt.size) == self.drive.driver, on_belt, -on_belt)

    @property
    def load(self) -> float:
        """Largest torque that a pulley takes off [N m]; 0 when the drive idles or is slack."""
        taken_off = np.delete(self.torque, self.drive.driver)
        return float(np.nanmax(taken_off, initial=0.0))

    @property
    def reserve(self) -> Array:
        """Arc on which the belt can slide over the arc that the change of force needs.

        Below 1 the whole pulley slides; infinite on an idler.
        """
        arcs = self.state.arcs
        idler = np.full(arcs.needed.size, np.inf)
        reserve = np.divide(arcs.room, arcs.needed, out=idler, where=arcs.needed > 0.0)
        return np.where(self.state.slack, np.nan, reserve)

    @property
    def arc_used(self) -> Array:
        """Arc that does not stick on each pulley [rad]."""
        used = np.minimum(self.state.arcs.needed, self.state.laid.wraps)
        for i, rod in enumerate(self.state.rods):
            if rod is not None:
                used[i] = self.state.laid.wraps[i] - adhesion_arc(rod)
        return np.where(self.state.slack, np.nan, used)

    @property
    def shares(self) -> SlidingShares:
        """Sliding speeds, line forces, shares outside the measured range; nan if slack."""
        state, string = self.state, StringLevel(self.drive)
        n = state.P.size
        if state.slack:
            nan = np.full(n, np.nan)
            return SlidingShares(nan, nan, nan, nan, nan, np.zeros(n, dtype=np.int64))
        rows = []
        for i, (P_in, P_out) in enumerate(zip(state.P_in.tolist(), state.P.tolist(), strict=True)):
            x = float(state.arcs.slip[i])
            f, v, _ = string.along_arc(i, np.array([P_in, P_out]), state.v0, x)
            slides = string.arcs_by_speed(i, P_in, P_out, state.v0) > state.arcs.room[i]
            states = int(not slides[0]) + np.count_nonzero(slides[1:] != slides[:-1])
            outside = string.outside(i, P_in, P_out, state.v0, x)
            rod = state.rods[i] if state.rods else None
            if rod is not None:
                touches = rod.line_force > 0.0
                f, v = rod.line_force[touches], np.abs(rod.slip_speed[touches])
            rows.append((v.max(), f.min(), f.max(), *outside, states))
        v_max, f_min, f_max, below, beyond, counts = np.array(rows).T
        return SlidingShares(v_max, f_min, f_max, below, beyond, counts.astype(np.int64))

    @property
    def friction_power(self) -> Array:
        """Power lost to friction on each pulley [W], (D11).

        The power of the shaft less the power that the belt carries away; the sum over all pulleys
        equals that of torque times speed.
        """
        state = self.state
        taken_along = self._energy_flow(state.P_in) - self._energy_flow(state.P)
        power = state.arcs.torque * self._magnitude(state) - state.v0 * taken_along
        return np.where(state.slack, np.nan, power)

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

    def _energy_flow(self, P: Array) -> Array:
        """Integrate (1 + eps) dP: energy that the belt carries, per stress-free length [N]."""
        stretch = self.drive.stretch(P, self.state.v0)
        stiffness = self.drive.belt.EA - self.drive.belt.rhoA * self.state.v0**2
        return 0.5 * stiffness * (stretch**2 - 1.0)


class Simulator:
    """Solve operating points of a drive; the belt at rest and the idling drive are cached.

    Parameters
    ----------
    drive : Drive
        Belt, laws, pulleys, installation.
    method : {"string", "rod"}
        Whether the belt has its bending stiffness.

    Raises
    ------
    InputError
        At rod level without a contact law.
    """

    def __init__(self, drive: Drive, method: Method = "string") -> None:
        compiled()
        self.drive, self.method = drive, method
        self.level = StringLevel(drive)
        self._rods = RodLevel(drive, self.level) if method == "rod" else None
        self._rest: dict[float | None, RestState] = {}
        self._idle: dict[tuple[float, float | None], LoopState] = {}

    def solve(self, point: DrivePoint, near: DriveResult | None = None) -> DriveResult:
        """Find the steady state of a point, and of the drive that idles at its speed.

        At a negative speed of the driver the belt runs against the order of the pulleys: the result
        then contains the reversed drive and the reversed point.

        Parameters
        ----------
        point : DrivePoint
            The operating point.
        near : DriveResult, optional
            Result at the same point of a similar drive, from which the search starts.

        Raises
        ------
        InputError
            If the belt cannot be laid on or tightened as stated.
        ConvergenceError
            If no steady state was found.
        """
        if point.omega < 0.0:
            return self.backwards._forwards(point.reversed(), near)
        return self._forwards(point, near)

    @cached_property
    def backwards(self) -> Simulator:
        """Simulator of the belt that runs the other way."""
        return Simulator(self.drive.reversed(), self.method)

    def at_rest(self, point: DrivePoint) -> RestState:
        """Tighten the belt at rest, as the point states it.

        Raises
        ------
        InputError
            If the belt cannot be laid on or tightened as stated.
        """
        T_0 = _rest_key(point)
        if T_0 not in self._rest:
            self._rest[T_0] = rest_state(self.drive, self._rods or self.level, point.T_0)
        return self._rest[T_0]

    def _forwards(self, point: DrivePoint, near: DriveResult | None) -> DriveResult:
        """Solve a point with the belt running in the order of the pulleys."""
        rest, T_0 = self.at_rest(point), _rest_key(point)
        if (point.omega, T_0) not in self._idle:
            idle = None if near is None else near.idle
            self._idle[point.omega, T_0] = self._loop(point.scaled(0.0), rest, idle)
        state = self._loop(point, rest, None if near is None else near.state)
        return DriveResult(point, self.drive, rest, state, self._idle[point.omega, T_0])

    def _loop(self, point: DrivePoint, rest: RestState, near: LoopState | None) -> LoopState:
        if self._rods is None:
            return solve_loop(self.drive, point, self.level, rest, near)
        return self._rods.solve(point, rest, near)


def _rest_key(point: DrivePoint) -> float | None:
    """Return the cache key of the belt at rest: its tension, or None if a tensioner sets it."""
    return None if math.isnan(point.T_0) else point.T_0

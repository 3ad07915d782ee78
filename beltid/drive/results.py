"""Results of a drive at an operating point: speeds, speed losses, forces, reserves.

The loss is relative to idling, as on the bench: an error of a radius of 0.2 % is as large as the
whole loss and cancels. The logarithm of the speed ratio is a sum of contributions of the strains,
the penetrations and the sliding of whole pulleys (D10); the loss is divided in that proportion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from beltid.drive.geometry import preceding
from beltid.drive.loop import LoopState, RestState, rest_state, solve_loop
from beltid.drive.model import Drive, DrivePoint
from beltid.drive.rod_level import RodLevel
from beltid.drive.string import SlidingShares, StringLevel

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
        """Wrap over the arc that the change of force needs; infinite on an idler."""
        arcs = self.state.arcs
        idler = np.full(arcs.needed.size, np.inf)
        reserve = np.divide(self.state.laid.wraps, arcs.needed, out=idler, where=arcs.needed > 0.0)
        return np.where(self.state.slack, np.nan, reserve)

    @property
    def largest_reserve(self) -> Array:
        """Reserve at the measured sliding speed with the most effective friction.

        Below 1 no measured sliding speed can carry the forces steadily.
        """
        state = self.state
        least = StringLevel(self.drive).least_arcs(state.P_in, state.P, state.v0)
        idler = np.full(least.size, np.inf)
        return np.divide(state.laid.wraps, least, out=idler, where=least > 0.0)

    @property
    def arc_used(self) -> Array:
        """Arc that slides on each pulley [rad]."""
        used = np.minimum(self.state.arcs.needed, self.state.laid.wraps)
        return np.where(self.state.slack, np.nan, used)

    @property
    def shares(self) -> SlidingShares:
        """Sliding speeds, line forces, shares outside the measured range; nan if slack."""
        state = self.state
        shares = StringLevel(self.drive).shares(
            state.P_in, state.P, state.v0, state.laid.wraps, state.arcs.slip
        )
        for i, rod in enumerate(state.rods):
            if rod is not None:
                touches = rod.points.f_N > 0.0
                shares.slip_speed_max[i] = np.abs(rod.points.slip[touches]).max()
                shares.normal_force_min[i] = rod.points.f_N[touches].min()
                shares.normal_force_max[i] = rod.points.f_N[touches].max()
        if not state.slack:
            return shares
        unknown = np.full(state.P.size, np.nan)
        return SlidingShares(*(unknown,) * 5, np.zeros(state.P.size, dtype=np.int64))

    @property
    def friction_power(self) -> Array:
        """Power lost to friction on each pulley [W], (D11).

        The power of the shaft less the power that the belt carries away; the sum over all pulleys
        equals that of torque times speed.
        """
        state = self.state
        taken_along = self._energy_flow(state.P_in) - self._energy_flow(state.P)
        return state.arcs.torque * self._magnitude(state) - state.v0 * taken_along

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
        rate, W = state.arcs.rate, state.arcs.W
        return np.log(stretch), np.log(rate / stretch), np.log(W / rate)

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
            return self._reversed._forwards(point.reversed(), near)
        return self._forwards(point, near)

    @cached_property
    def _reversed(self) -> Simulator:
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

"""Solve the closed loop for span forces, belt flow and tensioner arm by Newton's method.

The unknowns are an effective force per span, the stress-free length of belt per second, and the
angle of the tensioner's arm. The equations are (D7) to (D9): the torque of every pulley except the
driver, the length of the belt or a given force, the moment of the arm, the speed of the driver.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from beltid.drive.geometry import Layout, arm_lever, layout, preceding, spring_moment
from beltid.drive.model import Drive, DrivePoint
from beltid.drive.rod import RodState
from beltid.drive.string import Arcs
from beltid.errors import ConvergenceError, InputError

Array = NDArray[np.float64]

MOST_ITERATIONS: Final = 60
TOLERANCE: Final = 1e-11
"""Largest residual of the scaled equations: torque over T_0 R, strain over T_0/EA, speed."""
ROUNDING_RESIDUAL: Final = 1e-7
"""Residual accepted if no step reduces it: the strain of a stiff belt is limited by rounding."""
MOST_HALVINGS: Final = 12
MOST_JACOBIANS: Final = 3
"""Jacobians tried from one state: the present one, and new ones by differences to both sides."""
DIFFERENCE: Final = 1e-7
ARM_STEP: Final = math.radians(0.5)
"""Step in which the arm of a tensioner is turned until its moment changes sign [rad]."""
SLACK: Final = 1e-5
"""A span with less than this share of the largest span force is slack."""


class Level(Protocol):
    """Model of the belt on the pulleys."""

    def arcs(self, P_in: Array, P_out: Array, v0: float, wraps: Array) -> Arcs:
        """Compute the belt on every pulley from the effective forces before and after it."""
        ...

    def extra_length(self, laid: Layout, P: Array) -> float:
        """Return the length of the loop beyond that of a belt that does not bend [m]."""
        ...


@dataclass(frozen=True, slots=True)
class RestState:
    """The belt at rest under a uniform tension.

    Attributes
    ----------
    T_0 : float
        Tension [N].
    arm_angle : float or None
        Angle of the tensioner's arm [rad].
    belt_length : float
        Stress-free length of the belt [m]; nan with a given slack force.
    laid : Layout
        Spans and wraps.
    """

    T_0: float
    arm_angle: float | None
    belt_length: float
    laid: Layout


@dataclass(frozen=True, slots=True)
class LoopState:
    """A steady state of the loop.

    Attributes
    ----------
    P : ndarray (n,)
        Effective forces P = N - m v0^2 (1 + eps) of the spans [N]; span i leaves pulley i.
    v0 : float
        Stress-free length of belt that passes a point per second [m/s].
    arm_angle : float or None
        Angle of the tensioner's arm [rad].
    laid : Layout
        Spans and wraps.
    arcs : Arcs
        State of the belt on the pulleys.
    slack : bool
        Whether the torques leave a span without force; the other values are then meaningless.
    iterations : int
        Newton steps.
    rods : tuple of RodState or None
        Rod on each pulley; empty at string level, None for a pulley that stays at string level.
    slopes : ndarray or None
        Last Jacobian of the iteration, in scaled unknowns.
    """

    P: Array
    v0: float
    arm_angle: float | None
    laid: Layout
    arcs: Arcs
    slack: bool = False
    iterations: int = 0
    rods: tuple[RodState | None, ...] = ()
    slopes: Array | None = None

    @property
    def P_in(self) -> Array:
        """Effective force of the span that enters each pulley [N], shape (n,)."""
        return preceding(self.P)


def rest_state(drive: Drive, level: Level, T_0: float) -> RestState:
    """Tighten the belt at rest, which determines its length.

    Parameters
    ----------
    drive : Drive
        Pulleys and installation.
    level : Level
        Model of the belt on the pulleys.
    T_0 : float
        Tension at rest [N]; nan with a tensioner whose mean position sets it.

    Raises
    ------
    InputError
        If no belt path fits, a required tension is missing, or the arm of the tensioner has no
        equilibrium.
    """
    if drive.tensioner is None:
        if math.isnan(T_0):
            raise InputError("initial tension: must be stated if there is no tensioner")
        return _laid_at_rest(drive, level, T_0, None)
    angle = _stated_angle(drive)
    if math.isnan(T_0):
        T_0 = _tension_of_arm(drive, angle)
        if not 0.0 < T_0 < drive.belt.EA:
            raise InputError(
                f"tensioner: no equilibrium in its mean position ({math.degrees(angle):.4g} deg): "
                f"its spring asks for a belt tension of {T_0:.4g} N"
            )
        return _laid_at_rest(drive, level, T_0, angle)
    return _laid_at_rest(drive, level, T_0, _angle_of_arm(drive, T_0))


def _laid_at_rest(drive: Drive, level: Level, T_0: float, angle: float | None) -> RestState:
    laid = layout(drive, angle)
    P = np.full(laid.spans.size, float(T_0))  # kernels are compiled for floats
    on_arcs = level.arcs(P, P, 0.0, laid.wraps).length
    free = laid.spans.sum() / drive.stretch(T_0, 0.0)
    length = free + on_arcs.sum() + level.extra_length(laid, P)
    given = drive.installation == "slack_force"
    return RestState(T_0, angle, math.nan if given else float(length), laid)


def _stated_angle(drive: Drive) -> float:
    """Return the mean arm angle, towards the stated pulley [rad], within pi of the free angle."""
    arm = drive.tensioner
    assert arm is not None
    pulley = drive.pulleys[arm.pulley]
    angle = math.atan2(pulley.y - arm.pivot[1], pulley.x - arm.pivot[0])
    return arm.free_angle + math.remainder(angle - arm.free_angle, 2.0 * math.pi)


def _arm_side(drive: Drive) -> float:
    """Return the sense in which the arm has left its free angle: +1 anticlockwise."""
    assert drive.tensioner is not None
    return math.copysign(1.0, _stated_angle(drive) - drive.tensioner.free_angle)


def _angle_of_arm(drive: Drive, T_0: float) -> float:
    """Return the angle in which the arm, let go in its mean position, comes to rest [rad]."""
    start, arm, side = _stated_angle(drive), drive.tensioner, _arm_side(drive)
    assert arm is not None

    def moment(angle: float) -> float:
        laid = layout(drive, angle)
        belt = arm_lever(arm, laid, np.full(laid.spans.size, T_0))
        return belt + spring_moment(arm, angle, side)

    angle = start
    step = math.copysign(ARM_STEP, moment(angle))
    with suppress(InputError):  # no belt path fits at a farther angle
        while abs(angle - start) < math.pi:
            if moment(angle + step) * step <= 0.0:
                return float(brentq(moment, angle, angle + step, xtol=1e-13))
            angle += step
    raise InputError(
        f"tensioner: no equilibrium with a belt tension of {T_0:g} N at rest, from "
        f"{math.degrees(start):.4g} to {math.degrees(angle):.4g} deg"
    )


def _tension_of_arm(drive: Drive, angle: float) -> float:
    """Return the uniform belt force that balances the arm [N]; negative if the belt had to push."""
    assert drive.tensioner is not None
    laid = layout(drive, angle)
    per_newton = arm_lever(drive.tensioner, laid, np.ones(laid.spans.size))
    return -spring_moment(drive.tensioner, angle, _arm_side(drive)) / per_newton


class _Loop:
    """Equations of an operating point; forces are scaled by T_0, the flow by the driver."""

    def __init__(self, drive: Drive, point: DrivePoint, level: Level, rest: RestState) -> None:
        self.drive, self.point, self.level, self.rest = drive, point, level, rest
        self.R = np.array([p.R for p in drive.pulleys])
        self.torque = np.array(point.torque) + np.array([p.drag for p in drive.pulleys])
        self.power = np.array(point.power) if point.power else np.zeros(self.R.size)
        self.omega = abs(point.omega)
        self.flow = self.omega * self.R[drive.driver]  # of a belt that does not stretch [m/s]
        self.laid = rest.arm_angle, rest.laid  # the last angle of the arm and its layout

    def state(self, u: Array) -> LoopState:
        """Unpack the unknowns and compute the belt on its pulleys."""
        n = self.R.size
        angle = None if self.rest.arm_angle is None else float(u[n + 1])
        if angle is not None and angle != self.laid[0]:
            self.laid = angle, layout(self.drive, angle)
        laid = self.laid[1]
        P, v0 = u[:n] * self.rest.T_0, float(u[n]) * self.flow
        P_in = preceding(P)
        return LoopState(P, v0, angle, laid, self.level.arcs(P_in, P, v0, laid.wraps))

    def residual(self, state: LoopState) -> Array:
        """Return the residuals of (D7) to (D9), scaled to order one."""
        drive, rest, arcs, driver = self.drive, self.rest, state.arcs, self.drive.driver
        speeds = arcs.W * state.v0
        r = np.empty(self.R.size + (1 if state.arm_angle is None else 2))
        n = self.R.size
        r[:n] = (arcs.torque + self.torque + self.power / speeds) / (rest.T_0 * self.R)
        r[driver] = speeds[driver] / self.omega - 1.0
        if drive.installation == "slack_force":
            r[n] = state.P[driver] / rest.T_0 - 1.0
        else:
            free = state.laid.spans / drive.stretch(state.P, state.v0)
            length = free.sum() + arcs.length.sum()
            length += self.level.extra_length(state.laid, state.P)
            r[n] = (length / rest.belt_length - 1.0) * drive.belt.EA / rest.T_0
        if drive.tensioner is not None and state.arm_angle is not None:
            moment = arm_lever(drive.tensioner, state.laid, state.P)
            moment += spring_moment(drive.tensioner, state.arm_angle, _arm_side(drive))
            r[n + 1] = moment / (rest.T_0 * drive.tensioner.arm)
        return r

    def jacobian(self, u: Array, r: Array, difference: float) -> Array:
        """Compute the Jacobian of the residual by one-sided differences, shape (n_u, n_u)."""
        columns = []
        for k in range(u.size):
            moved = u.copy()
            moved[k] += difference
            columns.append((self.residual(self.state(moved)) - r) / difference)
        return np.stack(columns, axis=1)

    def first_guess(self, near: LoopState | None) -> Array:
        """Return the unknowns of a similar state, or of a belt that neither stretches nor seats.

        The forces of the latter change by steps of M/R about the mean T_0.
        """
        if near is not None:
            arm = () if near.arm_angle is None else (near.arm_angle,)
            return np.array([*(near.P / self.rest.T_0), near.v0 / self.flow, *arm])
        drive = self.drive
        steps = (self.torque + self.power * self.R / self.flow) / self.R
        steps[drive.driver] = 0.0
        steps[drive.driver] = -steps.sum()
        P = np.cumsum(steps) / self.rest.T_0
        P += 1.0 - (P.mean() if drive.installation == "fixed_centres" else P[drive.driver])
        stretch = float(drive.stretch(self.rest.T_0, 0.0))
        arm = () if self.rest.arm_angle is None else (self.rest.arm_angle,)
        return np.array([*np.maximum(P, 0.05), 1.0 / stretch, *arm])


def solve_loop(
    drive: Drive,
    point: DrivePoint,
    level: Level,
    rest: RestState,
    near: LoopState | None = None,
) -> LoopState:
    """Find the steady state of an operating point.

    Uses Newton's method with a difference Jacobian that is reused while the residual falls fast. A
    span force may fall to a fifth in a step, so none becomes negative; a span whose force keeps
    falling is slack.

    Parameters
    ----------
    drive : Drive
        The drive, its belt running in the order of the pulleys.
    point : DrivePoint
        The operating point; only the magnitude of its speed is used.
    level : Level
        Model of the belt on the pulleys.
    rest : RestState
        The belt at rest.
    near : LoopState, optional
        State of a similar drive, from which the iteration starts.

    Raises
    ------
    ConvergenceError
        If no steady state was found.
    """
    loop, n = _Loop(drive, point, level, rest), len(drive.pulleys)
    if near is not None and near.slack:
        near = None
    u = loop.first_guess(near)
    first, state = np.max(u[:n]), loop.state(u)
    r = loop.residual(state)
    size, difference = float(np.abs(r).max()), DIFFERENCE
    J, stuck = None if near is None else near.slopes, 0
    for iteration in range(MOST_ITERATIONS):
        if size <= TOLERANCE:
            return replace(state, iterations=iteration, slopes=J)
        if np.min(u[:n]) < SLACK * max(first, np.max(u[:n])):  # or all of them together
            return replace(state, iterations=iteration, slack=True)
        fresh = J is None
        if J is None:
            J = loop.jacobian(u, r, difference)
        step = np.linalg.solve(J, -r)
        falling = step[:n] < 0.0
        share = min(1.0, float(np.min(-0.8 * u[:n][falling] / step[:n][falling], initial=1.0)))
        towards_slack = share < 1.0
        for _ in range(MOST_HALVINGS):
            try:
                trial = loop.state(u + share * step)
            except InputError:  # no belt path fits at the trial angle of the arm
                share *= 0.5
                continue
            r_trial = loop.residual(trial)
            trial_size = float(np.abs(r_trial).max())
            if trial_size < size or (towards_slack and math.isfinite(trial_size)):
                break
            share *= 0.5
        else:
            if size <= ROUNDING_RESIDUAL:
                return replace(state, iterations=iteration, slopes=J)
            stuck += 1
            if stuck > MOST_JACOBIANS:
                break
            # at the onset of full slip of a pulley the one-sided derivatives differ
            J, difference = None, -difference if fresh else difference
            continue
        stuck = 0
        if trial_size > 0.1 * size:
            J = None
        u, state, r, size = u + share * step, trial, r_trial, trial_size
    raise ConvergenceError(
        f"drive at {point.omega:g} rad/s: no steady state found in {iteration + 1} iterations; "
        f"largest residual {size:.3g} of the scaled equations, must be below {TOLERANCE:g}",
        iterations=iteration + 1,
        residual=size,
    )

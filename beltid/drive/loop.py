"""Tighten the belt of a drive at rest, and close its loop under load.

Under load the unknowns are an effective force per span, the stress-free length of belt per second,
and the angle of the tensioner's arm. The equations are (D7) to (D9): the torque of every pulley but
the driver, the length of the belt or a given force, the moment of the arm, the driver's speed.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq, root

from beltid.arrays import Array
from beltid.drive.model import DrivePoint, Layout, arm_moment, layout, preceding
from beltid.drive.string import Arcs, Level
from beltid.errors import ConvergenceError, InputError
from beltid.rig.flow import FlowState

ARM_STEP = math.radians(0.5)  # in which the arm of a tensioner is turned until a sign changes
TOLERANCE = 1e-8  # of the scaled equations: torque over T_0 R, strain over T_0/EA, speed
GOAL = 1e-10  # residual at which the search ends
DAMPED = 0.1  # first step of the second attempt, over the size of the unknowns; 100 in the first
SLACK = 1e-5  # share of the largest span force below which a span is slack
LARGEST = 1e4  # scaled force, flow or angle that is tried
SLOWEST = 1e-3  # flow for which the belt on the pulleys is computed, over that of the driver


@dataclass(frozen=True, slots=True)
class RestState:
    """The belt at rest under a uniform tension."""

    T_0: float  # [N]
    arm_angle: float | None  # of the tensioner [rad]
    belt_length: float  # stress-free [m]; nan with a given slack force
    laid: Layout
    level: Level  # the belt on its pulleys
    at_stop: bool = False  # whether the arm rests against a stop

    @property
    def hub_force(self) -> Array:
        """Force of the belt on the axis of each pulley [N], shape (n,)."""
        return np.hypot(*self.laid.hub_forces(np.full(self.laid.spans.size, self.T_0)).T)


def rest_state(level: Level, T_0: float) -> RestState:
    """Tighten the belt at rest, which determines its length, or its tension if that is stated.

    The tension ``T_0`` [N] is nan if the length of the belt, or the mean position of a tensioner,
    determines it. An InputError says that no belt path fits, or that the arm of the tensioner has
    no equilibrium.
    """
    drive = level.drive

    def laid_at(tension: float, angle: float | None) -> RestState:
        laid = layout(drive, angle)
        P = np.full(laid.spans.size, float(tension))  # kernels are compiled for floats
        length = laid.spans.sum() / drive.stretch(P, 0.0)[0]
        length += level.arcs(P, P, 0.0, laid.wraps).length.sum() + level.extra_length(laid, P)
        return RestState(float(tension), angle, float(length), laid, level)

    def too_long(tension: float, angle: float | None) -> float:
        return laid_at(tension, angle).belt_length - drive.belt_length

    def tightened(angle: float | None) -> RestState:
        """Tighten the belt of stated length with fixed pulleys."""
        low, high = 1e-6 * drive.belt.EA, 0.2 * drive.belt.EA
        if too_long(low, angle) * too_long(high, angle) >= 0.0:
            raise InputError(
                f"drive.belt_length_m = {drive.belt_length:g}: the path of the belt is "
                f"{laid_at(low, angle).belt_length:.5g} m long, must be longer than the belt, by "
                "less than 20 %"
            )
        tension = brentq(too_long, low, high, args=(angle,), xtol=1e-9, rtol=1e-13)
        return replace(laid_at(tension, angle), belt_length=drive.belt_length)

    arm, mean = drive.tensioner, drive.mean_angle
    by_length = math.isfinite(drive.belt_length) and math.isnan(T_0)
    if arm is None:
        state = tightened(None) if by_length else laid_at(T_0, None)
        given = drive.installation == "slack_force"
        return replace(state, belt_length=math.nan) if given else state

    def moment(angle: float, tension: float) -> float:
        """Moment of belt and spring on the arm [N m]."""
        laid = layout(drive, angle)
        return arm_moment(drive, laid, angle, np.full(laid.spans.size, tension))

    def balance(angle: float) -> float:
        """Tension of the belt that balances the spring [N]."""
        spring = moment(angle, 0.0)
        return -spring / (moment(angle, 1.0) - spring)

    low, high = arm.stops
    if by_length:
        found = [
            _walked(lambda angle: too_long(balance(angle), angle), mean, step)
            for step in (ARM_STEP, -ARM_STEP)
        ]
        angles = sorted((a for a in found if a is not None), key=lambda a: abs(a - mean))
        if angles and low <= angles[0] <= high:
            return laid_at(balance(angles[0]), angles[0])
        stops = [stop for stop in (low, high) if math.isfinite(stop)]
        if stops:
            nearest = min(stops, key=lambda stop: abs(stop - (angles or [mean])[0]))
            return replace(tightened(nearest), at_stop=True)
    elif math.isnan(T_0):
        if 0.0 < balance(mean) < drive.belt.EA:
            return laid_at(balance(mean), mean)
    else:  # where the arm, let go in its mean position, comes to rest
        step = math.copysign(ARM_STEP, moment(mean, T_0))
        angle = _walked(lambda angle: moment(angle, T_0), mean, step)
        if angle is not None and low <= angle <= high:
            return laid_at(T_0, angle)
    what = "" if math.isnan(T_0) else f" with a tension of {T_0:g} N at rest"
    asks = f"its spring asks for a tension of {balance(mean):.4g} N"
    if by_length:
        what = f" with a belt of {drive.belt_length:g} m"
        asks += f", a length of {laid_at(balance(mean), mean).belt_length:.5g} m"
    position = f"in its mean position, {math.degrees(mean):.4g} deg"
    raise InputError(f"tensioner: no equilibrium{what}; {position}, {asks}")


def _walked(f: Callable[[float], float], start: float, step: float) -> float | None:
    """Turn the arm until a function of its angle changes sign; None if it never does."""
    try:
        angle, value = start, f(start)
        while abs(angle - start) < math.pi:
            following = f(angle + step)
            if value * following <= 0.0:
                return float(brentq(f, angle, angle + step, xtol=1e-13))
            angle, value = angle + step, following
    except InputError:  # no belt path fits at a farther angle
        pass
    return None


@dataclass(frozen=True, slots=True)
class LoopState:
    """A steady state of the loop; span i leaves pulley i."""

    P: Array  # effective forces P = N - m v0^2 (1 + eps) of the spans (n,) [N]
    v0: float  # stress-free length of belt that passes a point per second [m/s]
    arm_angle: float | None  # of the tensioner [rad]
    laid: Layout
    arcs: Arcs
    level: Level  # that found it
    slack: bool = False  # a span is left without force; the other values are then meaningless
    jacobian: Array | None = None  # of the scaled equations
    rods: tuple[FlowState | None, ...] = ()  # on each pulley; empty for strings, None for the back

    @property
    def P_in(self) -> Array:
        """Effective force of the span that enters each pulley [N], shape (n,)."""
        return preceding(self.P)


class Loop:
    """Equations of an operating point, also for negative forces; ``held``: angle of a fixed arm."""

    def __init__(self, point: DrivePoint, rest: RestState, held: float | None) -> None:
        self.level, self.rest, self.held = rest.level, rest, held
        drive = self.drive = rest.level.drive
        self.R = np.array([p.R for p in drive.pulleys])
        self.torque = np.array(point.torque) + [p.drag for p in drive.pulleys]
        self.power = np.array(point.power) if point.power else np.zeros(self.R.size)
        self.omega = abs(point.omega)
        self.flow = self.omega * self.R[drive.driver]  # of a belt that does not stretch [m/s]
        self.turns = drive.tensioner is not None and held is None  # whether the arm does

    def residual(self, u: Array) -> tuple[Array, LoopState | None]:
        """Return the residuals of (D7) to (D9), scaled to order one, and the state, if any."""
        drive, rest, driver, n = self.drive, self.rest, self.drive.driver, self.R.size
        angle = float(u[n + 1]) if self.turns else self.held
        try:
            if not np.abs(u).max() < LARGEST:
                return np.full(u.size, 1e3), None
            laid = rest.laid if angle == rest.arm_angle else layout(drive, angle)
        except InputError:  # no belt path fits at this angle of the arm
            return np.full(u.size, 1e3), None
        P, v0 = u[:n] * rest.T_0, float(u[n]) * self.flow
        pull, v = np.maximum(P, SLACK * rest.T_0), max(v0, SLOWEST * self.flow)
        arcs = self.level.arcs(preceding(pull), pull, v, laid.wraps)
        lacks, speeds, r = P - pull, arcs.W * v + arcs.rate * (v0 - v), np.empty(u.size)
        torque = arcs.torque + (preceding(lacks) - lacks) * self.R
        r[:n] = (torque + self.torque + self.power / speeds) / (rest.T_0 * self.R)
        r[driver] = speeds[driver] / self.omega - 1.0
        if drive.installation == "slack_force":
            r[n] = P[driver] / rest.T_0 - 1.0
        else:
            length = (laid.spans / drive.stretch(P, v)).sum() + arcs.length.sum()
            length += self.level.extra_length(laid, pull)
            r[n] = (length / rest.belt_length - 1.0) * drive.belt.EA / rest.T_0
        if drive.tensioner is not None and self.turns:
            r[n + 1] = arm_moment(drive, laid, u[n + 1], P) / (rest.T_0 * drive.tensioner.arm)
        slack = bool(P.min() < SLACK * max(rest.T_0, P.max()))
        return r, LoopState(P, v0, angle, laid, arcs, self.level, slack)

    def start(self, near: LoopState | None) -> Array:
        """Return the unknowns of a similar state, or steps of M/R about the mean force T_0."""
        if near is not None:
            P, flow, angle = near.P / self.rest.T_0, near.v0 / self.flow, near.arm_angle
        else:
            drive, angle = self.drive, self.rest.arm_angle
            steps = (self.torque + self.power * self.R / self.flow) / self.R
            steps[drive.driver] = 0.0
            steps[drive.driver] = -steps.sum()
            P = np.cumsum(steps) / self.rest.T_0
            P += 1.0 - (P.mean() if drive.installation == "fixed_centres" else P[drive.driver])
            P, flow = np.maximum(P, 0.05), 1.0 / float(drive.stretch(self.rest.T_0, 0.0))
        return np.array([*P, flow, *([angle] if self.turns else [])])


def solve_loop(point: DrivePoint, rest: RestState, near: LoopState | None = None) -> LoopState:
    """Find the steady state of an operating point.

    The belt runs in the order of the pulleys, whatever the sign of the speed. The iteration starts
    from the state of a similar drive ``near``. A ConvergenceError says that there is none.
    """
    if near is not None and (near.slack or near.v0 <= 0.0):
        near = None
    state = _solved(Loop(point, rest, rest.arm_angle if rest.at_stop else None), near)
    arm = rest.level.drive.tensioner
    if arm is not None and state.arm_angle is not None and not state.slack:
        stop = float(np.clip(state.arm_angle, *arm.stops))
        if stop != state.arm_angle:
            state = _solved(Loop(point, rest, stop), near)
    return state


def _solved(loop: Loop, near: LoopState | None) -> LoopState:
    """Solve the equations of a loop by Broyden's method, then anew, then anew in small steps."""
    u, J = loop.start(near), None if near is None else near.jacobian
    if J is not None and J.shape == (u.size, u.size):
        (r, state), before = loop.residual(u), math.inf
        while np.abs(r).max() < before:
            before = np.abs(r).max()
            if state is not None and before <= GOAL:
                return replace(state, jacobian=J)
            step = np.linalg.lstsq(J, -r)[0]  # whatever the rank
            u = u + step
            r, state = loop.residual(u)
            J = J + np.outer(r, step) / (step @ step)
    for start, factor in ((near, 100.0), (None, DAMPED)):
        u, options = loop.start(start), {"factor": factor}
        found = root(lambda u: loop.residual(u)[0], u, tol=GOAL, options=options)
        r, state = loop.residual(found.x)
        if state is not None and np.abs(r).max() <= TOLERANCE:
            R = np.zeros((u.size, u.size))
            R[np.triu_indices(u.size)] = found.r
            return replace(state, jacobian=found.fjac.T @ R)
    raise ConvergenceError(
        f"drive at {loop.omega:g} rad/s: no steady state found; largest residual "
        f"{np.abs(r).max():.3g} of the scaled equations, must be below {TOLERANCE:g}",
    )

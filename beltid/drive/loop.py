"""Solve the closed loop for span forces, belt flow and tensioner arm.

The unknowns are an effective force per span, the stress-free length of belt per second, and the
angle of the tensioner's arm. The equations are (D7) to (D9): the torque of every pulley except the
driver, the length of the belt or a given force, the moment of the arm, the speed of the driver.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

from beltid.drive.geometry import Layout, arm_lever, layout, preceding, spring_moment
from beltid.drive.model import DrivePoint
from beltid.drive.rest import RestState, arm_side
from beltid.drive.string import Arcs, Level
from beltid.errors import ConvergenceError, InputError
from beltid.rig.flow import FlowState

Array = NDArray[np.float64]

TOLERANCE = 1e-8  # of the scaled equations: torque over T_0 R, strain over T_0/EA, speed
DAMPED = 0.1  # first step of the second attempt, over the size of the unknowns; 100 in the first
SLACK = 1e-5  # share of the largest span force below which a span is slack
LARGEST = 1e4  # scaled force, flow or angle that is tried
SLOWEST = 1e-3  # flow for which the belt on the pulleys is computed, over that of the driver


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
    rods: tuple[FlowState | None, ...] = ()  # on each pulley; empty for strings, None for the back

    @property
    def P_in(self) -> Array:
        """Effective force of the span that enters each pulley [N], shape (n,)."""
        return preceding(self.P)


class Loop:
    """Equations of an operating point; forces are scaled by T_0, the flow by the driver.

    They hold for negative forces, too, with the friction of a belt that is nearly slack, so that a
    solution is found and its status told from it. ``held`` is the angle of an arm at its stop.
    """

    def __init__(
        self, point: DrivePoint, level: Level, rest: RestState, held: float | None
    ) -> None:
        self.drive, self.level, self.rest, self.held = level.drive, level, rest, held
        self.R = np.array([p.R for p in self.drive.pulleys])
        self.torque = np.array(point.torque) + [p.drag for p in self.drive.pulleys]
        self.power = np.array(point.power) if point.power else np.zeros(self.R.size)
        self.omega = abs(point.omega)
        self.flow = self.omega * self.R[self.drive.driver]  # of a belt that does not stretch [m/s]
        self.arm = self.drive.tensioner if held is None else None

    def state(self, u: Array) -> LoopState:
        """Unpack the unknowns and compute the belt on its pulleys."""
        n = self.R.size
        angle = float(u[n + 1]) if self.arm else self.held
        laid = self.rest.laid if angle == self.rest.arm_angle else layout(self.drive, angle)
        P, v0 = u[:n] * self.rest.T_0, float(u[n]) * self.flow
        pull, v = np.maximum(P, SLACK * self.rest.T_0), max(v0, SLOWEST * self.flow)
        arcs = self.level.arcs(preceding(pull), pull, v, laid.wraps)
        return LoopState(P, v0, angle, laid, arcs, self.level)

    def residual(self, u: Array) -> Array:
        """Return the residuals of (D7) to (D9), scaled to order one."""
        try:
            if not np.abs(u).max() < LARGEST:
                return np.full(u.size, 1e3)
            state = self.state(u)
        except InputError:  # no belt path fits at this angle of the arm
            return np.full(u.size, 1e3)
        drive, rest, arcs, driver, n = self.drive, self.rest, state.arcs, self.drive.driver, u.size
        pull, v = np.maximum(state.P, SLACK * rest.T_0), max(state.v0, SLOWEST * self.flow)
        lacks = state.P - pull
        torque = arcs.torque + (preceding(lacks) - lacks) * self.R
        speeds = arcs.W * v + arcs.rate * (state.v0 - v)
        r = np.empty(n)
        n = self.R.size
        r[:n] = (torque + self.torque + self.power / speeds) / (rest.T_0 * self.R)
        r[driver] = speeds[driver] / self.omega - 1.0
        if drive.installation == "slack_force":
            r[n] = state.P[driver] / rest.T_0 - 1.0
        else:
            length = (state.laid.spans / drive.stretch(state.P, v)).sum() + arcs.length.sum()
            length += self.level.extra_length(state.laid, pull)
            r[n] = (length / rest.belt_length - 1.0) * drive.belt.EA / rest.T_0
        if self.arm and state.arm_angle is not None:
            moment = arm_lever(self.arm, state.laid, state.P)
            moment += spring_moment(self.arm, state.arm_angle, arm_side(drive, self.arm))
            r[n + 1] = moment / (rest.T_0 * self.arm.arm)
        return r

    def start(self, near: LoopState | None) -> Array:
        """Return the unknowns of a similar state, or of a belt that neither stretches nor seats.

        The forces of the latter change by steps of M/R about the mean T_0.
        """
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
        return np.array([*P, flow, *([angle] if self.arm else [])])


def solve_loop(
    point: DrivePoint, level: Level, rest: RestState, near: LoopState | None = None
) -> LoopState:
    """Find the steady state of an operating point.

    Of the point only the magnitude of its speed is used: the belt runs in the order of the pulleys.
    The iteration starts from the state of a similar drive, if there is one ``near``. Without a
    steady state a ConvergenceError is raised.
    """
    if near is not None and (near.slack or near.v0 <= 0.0):
        near = None
    held, arm = rest.arm_angle if rest.at_stop else None, level.drive.tensioner
    state = _solved(Loop(point, level, rest, held), near)
    if arm is not None and state.arm_angle is not None and not state.slack:
        stop = float(np.clip(state.arm_angle, *arm.stops))
        if stop != state.arm_angle:
            state = _solved(Loop(point, level, rest, stop), near)
    return state


def _solved(loop: Loop, near: LoopState | None) -> LoopState:
    """Solve the equations of a loop; if that fails, once more in small steps."""
    residual = math.inf
    for start, factor in ((near, 100.0), (None, DAMPED)):
        found = root(loop.residual, loop.start(start), tol=1e-10, options={"factor": factor})
        residual = float(np.abs(found.fun).max())
        if residual <= TOLERANCE:
            state = loop.state(found.x)
            slack = np.min(state.P) < SLACK * max(loop.rest.T_0, np.max(state.P))
            return replace(state, slack=bool(slack))
    raise ConvergenceError(
        f"drive at {loop.omega:g} rad/s: no steady state found; largest residual {residual:.3g} of "
        f"the scaled equations, must be below {TOLERANCE:g}",
    )

"""Tighten the belt of a drive at rest: its tension, its length, the arm of the tensioner."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from beltid.drive.geometry import Layout, arm_lever, layout, spring_moment
from beltid.drive.model import Drive, Tensioner
from beltid.drive.string import Level
from beltid.errors import InputError

Array = NDArray[np.float64]

ARM_STEP = math.radians(0.5)  # in which the arm of a tensioner is turned until a sign changes


@dataclass(frozen=True, slots=True)
class RestState:
    """The belt at rest under a uniform tension."""

    T_0: float  # [N]
    arm_angle: float | None  # of the tensioner [rad]
    belt_length: float  # stress-free [m]; nan with a given slack force
    laid: Layout
    at_stop: bool = False  # whether the arm rests against a stop

    @property
    def hub_force(self) -> Array:
        """Force of the belt on the axis of each pulley [N], shape (n,)."""
        return np.hypot(*self.laid.hub_forces(np.full(self.laid.spans.size, self.T_0)).T)


def rest_state(drive: Drive, level: Level, T_0: float) -> RestState:
    """Tighten the belt at rest, which determines its length, or its tension if that is stated.

    The tension ``T_0`` [N] is nan if the length of the belt, or the mean position of a tensioner,
    determines it. An InputError says that no belt path fits, or that the arm of the tensioner has
    no equilibrium.
    """

    def laid_at(tension: float, angle: float | None) -> RestState:
        laid = layout(drive, angle)
        P = np.full(laid.spans.size, float(tension))  # kernels are compiled for floats
        length = laid.spans.sum() / drive.stretch(P, 0.0)[0]
        length += level.arcs(P, P, 0.0, laid.wraps).length.sum() + level.extra_length(laid, P)
        return RestState(float(tension), angle, float(length), laid)

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

    arm = drive.tensioner
    by_length = math.isfinite(drive.belt_length) and math.isnan(T_0)
    if arm is None:
        state = tightened(None) if by_length else laid_at(T_0, None)
        given = drive.installation == "slack_force"
        return replace(state, belt_length=math.nan) if given else state
    mean, side = mean_angle(drive, arm), arm_side(drive, arm)

    def moment(angle: float, tension: float) -> float:
        """Moment of belt and spring on the arm [N m]."""
        laid = layout(drive, angle)
        belt = arm_lever(arm, laid, np.full(laid.spans.size, tension))
        return belt + spring_moment(arm, angle, side)

    def balance(angle: float) -> float:
        """Tension of the belt that balances the spring [N]."""
        spring = moment(angle, 0.0)
        return -spring / (moment(angle, 1.0) - spring)

    if not by_length and math.isnan(T_0):
        tension = balance(mean)
        if not 0.0 < tension < drive.belt.EA:
            raise InputError(
                f"tensioner: no equilibrium in its mean position ({math.degrees(mean):.4g} deg): "
                f"its spring asks for a belt tension of {tension:.4g} N"
            )
        return laid_at(tension, mean)
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
    else:  # where the arm, let go in its mean position, comes to rest
        step = math.copysign(ARM_STEP, moment(mean, T_0))
        angle = _walked(lambda angle: moment(angle, T_0), mean, step)
        if angle is not None and low <= angle <= high:
            return laid_at(T_0, angle)
    what = f"of {drive.belt_length:g} m" if by_length else f"with a tension of {T_0:g} N at rest"
    raise InputError(
        f"tensioner: no equilibrium with a belt {what}; in its mean position, "
        f"{math.degrees(mean):.4g} deg, the tension is {balance(mean):.4g} N, the length "
        f"{laid_at(balance(mean), mean).belt_length:.5g} m"
    )


def mean_angle(drive: Drive, arm: Tensioner) -> float:
    """Return the mean arm angle, towards the stated pulley [rad], within pi of the free angle."""
    pulley = drive.pulleys[arm.pulley]
    angle = math.atan2(pulley.y - arm.pivot[1], pulley.x - arm.pivot[0])
    return arm.free_angle + math.remainder(angle - arm.free_angle, 2.0 * math.pi)


def arm_side(drive: Drive, arm: Tensioner) -> float:
    """Return the sense in which the arm has left its free angle: +1 anticlockwise."""
    return math.copysign(1.0, mean_angle(drive, arm) - arm.free_angle)


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

"""Tighten the belt of a drive at rest: its tension, its length, the arm of the tensioner."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from beltid.drive.geometry import Layout, arm_lever, layout, spring_moment
from beltid.drive.model import Drive
from beltid.errors import InputError

if TYPE_CHECKING:
    from beltid.drive.loop import Level

Array = NDArray[np.float64]

ARM_STEP: Final = math.radians(0.5)
"""Step in which the arm of a tensioner is turned until a sign changes [rad]."""


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
    at_stop : bool
        Whether the arm rests against a stop.
    """

    T_0: float
    arm_angle: float | None
    belt_length: float
    laid: Layout
    at_stop: bool = False


def rest_state(drive: Drive, level: Level, T_0: float) -> RestState:
    """Tighten the belt at rest, which determines its length, or its tension if that is stated.

    Parameters
    ----------
    drive : Drive
        Pulleys and installation.
    level : Level
        Model of the belt on the pulleys.
    T_0 : float
        Tension at rest [N]; nan if the length of the belt, or the mean position of a tensioner,
        determines it.

    Raises
    ------
    InputError
        If no belt path fits, a required tension is missing, or the arm of the tensioner has no
        equilibrium.
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
            at = laid_at(low, angle).belt_length
            raise InputError(
                f"drive.belt_length_m = {drive.belt_length:g}: the path of the belt is {at:.5g} m "
                "long, must be longer than the belt, by less than 20 %"
            )
        tension = brentq(too_long, low, high, args=(angle,), xtol=1e-9, rtol=1e-13)
        return replace(laid_at(tension, angle), belt_length=drive.belt_length)

    arm = drive.tensioner
    stated = math.isfinite(drive.belt_length) and math.isnan(T_0)
    if arm is None:
        if stated:
            return tightened(None)
        if math.isnan(T_0):
            raise InputError("initial tension: must be stated if there is no tensioner")
        state = laid_at(T_0, None)
        given = drive.installation == "slack_force"
        return replace(state, belt_length=math.nan) if given else state
    mean, (low, high) = mean_angle(drive), arm.stops

    def balance(angle: float) -> float:
        """Tension of the belt that balances the spring [N]."""
        laid = layout(drive, angle)
        per_newton = arm_lever(arm, laid, np.ones(laid.spans.size))
        return -spring_moment(arm, angle, arm_side(drive)) / per_newton

    if math.isfinite(T_0):
        # where the arm, let go in its mean position, comes to rest
        def moment(angle: float) -> float:
            laid = layout(drive, angle)
            belt = arm_lever(arm, laid, np.full(laid.spans.size, T_0))
            return belt + spring_moment(arm, angle, arm_side(drive))

        step = math.copysign(ARM_STEP, moment(mean))
        angle = _walked(moment, mean, step)
        if angle is None:
            raise InputError(
                f"tensioner: no equilibrium with a belt tension of {T_0:g} N at rest, from "
                f"{math.degrees(mean):.4g} deg on"
            )
        if not low <= angle <= high:
            raise InputError(
                f"tensioner: a belt tension of {T_0:g} N at rest needs its arm at "
                f"{math.degrees(angle):.4g} deg, must be from {math.degrees(low):.4g} to "
                f"{math.degrees(high):.4g} deg, its stops"
            )
        return laid_at(T_0, angle)
    if stated:
        found = [
            _walked(lambda angle: too_long(balance(angle), angle), mean, step)
            for step in (ARM_STEP, -ARM_STEP)
        ]
        angles = sorted((a for a in found if a is not None), key=lambda a: abs(a - mean))
        if angles and low <= angles[0] <= high:
            return laid_at(balance(angles[0]), angles[0])
        stops = [stop for stop in (low, high) if math.isfinite(stop)]
        nearest = min(stops, key=lambda stop: abs(stop - (angles or [mean])[0]), default=None)
        if nearest is None:
            raise InputError(
                f"drive.belt_length_m = {drive.belt_length:g}: the tensioner has no equilibrium "
                "with a belt of this length; its mean position has one of "
                f"{laid_at(balance(mean), mean).belt_length:.5g} m"
            )
        return replace(tightened(nearest), at_stop=True)
    tension = balance(mean)
    if not 0.0 < tension < drive.belt.EA:
        raise InputError(
            f"tensioner: no equilibrium in its mean position ({math.degrees(mean):.4g} deg): "
            f"its spring asks for a belt tension of {tension:.4g} N"
        )
    return laid_at(tension, mean)


def mean_angle(drive: Drive) -> float:
    """Return the mean arm angle, towards the stated pulley [rad], within pi of the free angle."""
    arm = drive.tensioner
    assert arm is not None
    pulley = drive.pulleys[arm.pulley]
    angle = math.atan2(pulley.y - arm.pivot[1], pulley.x - arm.pivot[0])
    return arm.free_angle + math.remainder(angle - arm.free_angle, 2.0 * math.pi)


def arm_side(drive: Drive) -> float:
    """Return the sense in which the arm has left its free angle: +1 anticlockwise."""
    assert drive.tensioner is not None
    return math.copysign(1.0, mean_angle(drive) - drive.tensioner.free_angle)


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

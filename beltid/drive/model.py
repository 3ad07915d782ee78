"""Describe a belt drive: pulleys in the order of the belt, tensioning, operating point; its path.

A pulley turns anticlockwise (sense +1) or clockwise (-1); ribs and back turn opposite ways. With
the direction ``t`` of a span and its left normal ``n``, the belt touches a pulley of sense ``s`` at
``c - s R n``. So ``c_2 - c_1 = L t + (s_2 R_2 - s_1 R_1) n`` between two centres, which gives the
length L of the span and its direction.
"""

import math
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from beltid.arrays import Array
from beltid.errors import InputError
from beltid.laws.bicubic import SurfaceTables
from beltid.laws.friction_surface import HALF_TREND, FrictionSurface, continued
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt

ARM_MISFIT = 0.03  # error of a tensioner pulley's distance from the pivot, over the arm length


@dataclass(frozen=True, slots=True)
class Pulley:
    """One pulley of the drive."""

    name: str  # in tables and messages
    x: float  # centre [m]; on the tensioner's arm, at its mean position
    y: float
    R: float  # radius of the belt's centreline without load [m]
    ribs: bool = True  # whether the ribs of the belt touch the pulley, rather than its back
    drag: float = 0.0  # of the bearing [N m], >= 0, also when the drive idles


@dataclass(frozen=True, slots=True)
class Tensioner:
    """A spring-loaded arm that carries one of the pulleys.

    The spring turns the arm towards its free angle, the polar angle of the pulley's centre about
    the pivot at the free end of its travel, with ``preload + rate |angle - free_angle|``.
    """

    pulley: int  # index of the pulley on the arm
    pivot: tuple[float, float]  # axis of the arm [m]
    arm: float  # length from the pivot to the pulley's centre [m]
    free_angle: float  # [rad]
    preload: float  # moment at the free angle [N m]
    rate: float  # its growth [N m/rad]
    stops: tuple[float, float] = (-math.inf, math.inf)  # [rad], ascending, within pi of the free


@dataclass(frozen=True, slots=True)
class Drive:
    """Belt, laws of contact, pulleys and installation of a drive.

    Fixed pulley centres, a given force in the span that leaves the driver, or the arm of a
    tensioner set the tension. An InputError says that there is one pulley only, or that that of
    the tensioner is not at the end of its arm, of which only its direction is used.
    """

    belt: Belt
    law: NormalLaw | None  # of the ribs, Eq. (3); None for rigid pulleys
    surface: FrictionSurface  # of the ribs, as measured
    pulleys: tuple[Pulley, ...]  # as the belt passes them, at least two
    driver: int = 0
    installation: Literal["fixed_centres", "slack_force", "tensioner"] = "fixed_centres"
    tensioner: Tensioner | None = None  # only with the installation "tensioner"
    back_friction: float = 0.5  # coefficient of the back of the belt, which is rigid
    slow_trend: float = HALF_TREND  # share of the trend below the slowest measured speed, (D14)
    belt_length: float = math.nan  # stress-free [m], sets the tension at rest; nan: set by it
    friction: SurfaceTables = field(init=False, repr=False, compare=False)  # continued surface
    mean_angle: float = field(init=False, default=math.nan)  # of the arm, within pi of its free one

    def __post_init__(self) -> None:
        arm = self.tensioner
        if len(self.pulleys) < 2:
            raise InputError("a drive has at least two pulleys")
        if arm is not None:
            pulley = self.pulleys[arm.pulley]
            x, y = pulley.x - arm.pivot[0], pulley.y - arm.pivot[1]
            distance, turned = math.hypot(x, y), math.atan2(y, x) - arm.free_angle
            if abs(distance - arm.arm) > ARM_MISFIT * arm.arm:
                raise InputError(
                    f"pulley {pulley.name} is {distance:g} m from the pivot of the tensioner, "
                    f"must be the length of the arm, {arm.arm:g} m"
                )
            mean = arm.free_angle + math.remainder(turned, 2.0 * math.pi)
            object.__setattr__(self, "mean_angle", mean)
        object.__setattr__(self, "friction", continued(self.surface, self.slow_trend))

    def stretch(self, P: Array | float, v0: float) -> Array:
        """Return the stretch 1 + eps, (D1) [-], at effective forces P [N] and a flow v0 [m/s]."""
        return np.asarray((self.belt.EA + P) / (self.belt.EA - self.belt.rhoA * v0**2))

    def reversed(self) -> Self:
        """Reverse the running direction of the belt: the pulleys in reverse order."""
        last, arm = len(self.pulleys) - 1, self.tensioner
        return replace(
            self,
            pulleys=self.pulleys[::-1],
            driver=last - self.driver,
            tensioner=None if arm is None else replace(arm, pulley=last - arm.pulley),
        )


@dataclass(frozen=True, slots=True)
class DrivePoint:
    """Settings of one operating point."""

    omega: float  # of the driver [rad/s]; < 0 if the belt runs against the order of the pulleys
    # tension at rest [N]; with a given slack force the effective force P of that span in motion,
    # less than its tension by m v²; nan if a tensioner or the belt's length sets it
    T_0: float
    torque: tuple[float, ...]  # taken off at each pulley [N m]; the driver's entry is ignored
    power: tuple[float, ...] = ()  # taken off in addition [W]; empty for none

    def __post_init__(self) -> None:
        if self.omega == 0.0:
            raise InputError("driver speed 0 rad/s, must be finite and not 0")
        if self.T_0 <= 0.0:
            raise InputError(f"initial tension {self.T_0:g} N, must be > 0")

    def scaled(self, factor: float) -> Self:
        """Multiply all torques and powers by a factor; 0 lets the drive idle."""
        return replace(
            self,
            torque=tuple(factor * torque for torque in self.torque),
            power=tuple(factor * power for power in self.power),
        )

    def reversed(self) -> Self:
        """Reverse the order of the pulleys, to match :meth:`Drive.reversed`."""
        return replace(self, torque=self.torque[::-1], power=self.power[::-1])


def preceding(values: NDArray[Any]) -> NDArray[Any]:
    """Shift a ring: each entry becomes its predecessor. Several times faster than `numpy.roll`."""
    return np.concatenate((values[-1:], values[:-1]))


def following(values: NDArray[Any]) -> NDArray[Any]:
    """Shift a ring: each entry becomes its successor."""
    return np.concatenate((values[1:], values[:1]))


@dataclass(frozen=True, slots=True)
class Layout:
    """Spans and arcs of a belt on its pulleys; span i runs from pulley i to the next one."""

    centres: Array  # of the pulleys (n, 2) [m]
    starts: Array  # tangent points where the spans begin and end (n, 2) [m]
    ends: Array
    spans: Array  # lengths (n,) [m]
    directions: Array  # unit vectors of the spans in the running direction (n, 2)
    wraps: Array  # angles of the arcs between tangent points (n,) [rad]
    senses: Array  # +1 where a pulley turns anticlockwise, -1 where it turns clockwise (n,)

    def hub_forces(self, P: Array) -> Array:
        """Return the force of the belt on each axis (n, 2) [N] at the effective span forces P."""
        leaving = P[:, None] * self.directions
        return leaving - preceding(leaving)


def layout(drive: Drive, arm_angle: float | None = None) -> Layout:
    """Lay the belt on the pulleys of a drive, with the tensioner's arm at an angle [rad].

    Without it the pulley on the arm keeps its stated centre. An InputError says that pulleys
    overlap or that no belt path fits them.
    """
    pulleys = list(drive.pulleys)
    if arm_angle is not None and drive.tensioner is not None:
        arm, moved = drive.tensioner, drive.tensioner.pulley
        x = arm.pivot[0] + arm.arm * math.cos(arm_angle)
        y = arm.pivot[1] + arm.arm * math.sin(arm_angle)
        pulleys[moved] = replace(pulleys[moved], x=x, y=y)
    overlaps = [
        f"pulleys {a.name} and {b.name} overlap: their centres are "
        f"{math.hypot(b.x - a.x, b.y - a.y):g} m apart, must be more than {a.R + b.R:g} m"
        for a, b in combinations(pulleys, 2)
        if math.hypot(b.x - a.x, b.y - a.y) <= a.R + b.R
    ]
    if overlaps:
        raise InputError(overlaps)
    # the rib pulleys usually turn in the sense of the pulley order
    neighbours = zip(pulleys[-1:] + pulleys[:-1], pulleys, strict=True)
    twice_area = sum(a.x * b.y - b.x * a.y for a, b in neighbours)
    for sense in (math.copysign(1.0, twice_area), -math.copysign(1.0, twice_area)):
        laid = _lay(pulleys, sense)
        turns = abs(np.sum(laid.senses * laid.wraps)) / (2.0 * np.pi)
        if abs(turns - 1.0) < 1e-7 and not _crosses_itself(laid):
            return laid
    raise InputError(
        "the belt crosses itself or does not reach a pulley: the pulleys must be listed in the "
        "order of the belt, each with its centre and the side of the belt that touches it"
    )


def arm_moment(drive: Drive, laid: Layout, angle: float, P: Array) -> float:
    """Return the moment of belt and spring on the tensioner's arm [N m], anticlockwise > 0."""
    tensioner = drive.tensioner
    assert tensioner is not None
    free, side = tensioner.free_angle, math.copysign(1.0, drive.mean_angle - tensioner.free_angle)
    arm = laid.centres[tensioner.pulley] - tensioner.pivot
    force = laid.hub_forces(P)[tensioner.pulley]
    spring = -side * tensioner.preload - tensioner.rate * (angle - free)
    return float(arm[0] * force[1] - arm[1] * force[0]) + spring


def _lay(pulleys: list[Pulley], sense: float) -> Layout:
    """Lay the belt on, with the rib pulleys turning in the given sense."""
    centres = np.array([(p.x, p.y) for p in pulleys])
    senses = np.array([sense if p.ribs else -sense for p in pulleys])
    offsets = senses * np.array([p.R for p in pulleys])
    to_next = following(centres) - centres
    across = following(offsets) - offsets
    spans = np.sqrt(np.sum(to_next**2, axis=1) - across**2)
    angles = np.arctan2(to_next[:, 1], to_next[:, 0]) - np.arctan2(across, spans)
    wraps = np.mod(senses * (angles - preceding(angles)), 2.0 * np.pi)
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    normals = np.column_stack([-directions[:, 1], directions[:, 0]])
    starts = centres - offsets[:, None] * normals
    ends = starts + spans[:, None] * directions
    return Layout(centres, starts, ends, spans, directions, wraps, senses)


def _crosses_itself(laid: Layout) -> bool:
    """Return whether any two spans cross."""
    pairs = list(combinations(zip(laid.starts, laid.ends, strict=True), 2))
    return any(_separates(a, b, c, d) and _separates(c, d, a, b) for (a, b), (c, d) in pairs)


def _separates(a: Array, b: Array, c: Array, d: Array) -> bool:
    """Return whether points c and d lie on opposite sides of the line through a and b."""
    (x, y), (cx, cy), (dx, dy) = b - a, c - a, d - a
    return bool((x * cy - y * cx) * (x * dy - y * dx) < 0.0)

"""Describe a belt drive: pulleys in the order of the belt, tensioning, and operating point."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError
from beltid.laws.bicubic import SurfaceTables
from beltid.laws.friction_surface import HALF_TREND, FrictionSurface, continued
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt

Array = NDArray[np.float64]

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

    def reversed(self) -> Drive:
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

    def scaled(self, factor: float) -> DrivePoint:
        """Multiply all torques and powers by a factor; 0 lets the drive idle."""
        return replace(
            self,
            torque=tuple(factor * torque for torque in self.torque),
            power=tuple(factor * power for power in self.power),
        )

    def reversed(self) -> DrivePoint:
        """Reverse the order of the pulleys, to match :meth:`Drive.reversed`."""
        return replace(self, torque=self.torque[::-1], power=self.power[::-1])

"""Describe a belt drive: pulleys in the order of the belt, tensioning, and operating point."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError
from beltid.laws.bicubic import SurfaceTables
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.laws.slow_friction import HALF_TREND, continued
from beltid.params import Belt

Array = NDArray[np.float64]

Installation = Literal["fixed_centres", "slack_force", "tensioner"]

ARM_MISFIT: Final = 0.03
"""Largest error of a tensioner pulley's distance from the pivot, relative to the arm length.

Only the direction from the pivot to the stated centre is used."""


@dataclass(frozen=True, slots=True)
class Pulley:
    """One pulley of the drive.

    Parameters
    ----------
    name : str
        Name in tables and messages.
    x, y : float
        Centre [m]; for the pulley on the tensioner's arm, at the mean position of the arm.
    R : float
        Radius of the belt's centreline without load [m].
    ribs : bool
        Whether the ribs of the belt touch the pulley, rather than its back.
    drag : float
        Drag torque of the bearing [N m], >= 0, also present when the drive idles.
    """

    name: str
    x: float
    y: float
    R: float
    ribs: bool = True
    drag: float = 0.0


@dataclass(frozen=True, slots=True)
class Tensioner:
    """A spring-loaded arm that carries one of the pulleys.

    The spring turns the arm towards its free angle with the moment
    ``preload + rate |angle - free_angle|``.

    Parameters
    ----------
    pulley : int
        Index of the pulley on the arm.
    pivot : tuple of float
        Axis of the arm [m].
    arm : float
        Length from the pivot to the pulley's centre [m].
    free_angle : float
        Angle of the arm at the free end of its travel [rad], as the polar angle of the pulley's
        centre about the pivot.
    preload, rate : float
        Moment at the free angle [N m] and its growth [N m/rad].
    stops : tuple of float
        Angles between which the arm turns [rad], ascending, within pi of the free angle.
    """

    pulley: int
    pivot: tuple[float, float]
    arm: float
    free_angle: float
    preload: float
    rate: float
    stops: tuple[float, float] = (-math.inf, math.inf)


@dataclass(frozen=True, slots=True)
class Drive:
    """Belt, laws of contact, pulleys and installation of a drive.

    Parameters
    ----------
    belt : Belt
        Axial stiffness, bending stiffness and mass per stress-free length.
    law : NormalLaw or None
        Contact of the ribs, Eq. (3); None for rigid pulleys.
    surface : FrictionSurface
        Friction coefficient of the ribs, as measured.
    pulleys : tuple of Pulley
        Pulleys in the order in which the belt passes them, at least two.
    driver : int
        Index of the pulley that drives the belt.
    installation : {"fixed_centres", "slack_force", "tensioner"}
        What sets the tension: fixed pulley centres, a given force in the span that leaves the
        driver, or the arm of a tensioner.
    tensioner : Tensioner, optional
        Required with the installation "tensioner", not allowed otherwise.
    back_friction : float
        Friction coefficient of the back of the belt, which is assumed to be rigid.
    slow_trend : float
        Share of the trend at the slowest measured speed with which friction is extrapolated below
        it, (D14) [-], 0 to 1. Another share than half of it bounds the uncertainty.
    belt_length : float
        Stress-free length of the belt [m], which then determines its tension at rest; nan if the
        tension determines it.

    Attributes
    ----------
    friction : SurfaceTables
        The surface with its continuation.

    Raises
    ------
    InputError
        If there is one pulley only, or that of the tensioner is not at the end of its arm.
    """

    belt: Belt
    law: NormalLaw | None
    surface: FrictionSurface
    pulleys: tuple[Pulley, ...]
    driver: int = 0
    installation: Installation = "fixed_centres"
    tensioner: Tensioner | None = None
    back_friction: float = 0.5
    slow_trend: float = HALF_TREND
    belt_length: float = math.nan
    friction: SurfaceTables = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        arm = self.tensioner
        if len(self.pulleys) < 2:
            raise InputError("a drive has at least two pulleys")
        if arm is not None:
            pulley = self.pulleys[arm.pulley]
            distance = math.hypot(pulley.x - arm.pivot[0], pulley.y - arm.pivot[1])
            if abs(distance - arm.arm) > ARM_MISFIT * arm.arm:
                raise InputError(
                    f"pulley {pulley.name} is {distance:g} m from the pivot of the tensioner, "
                    f"must be the length of the arm, {arm.arm:g} m"
                )
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
    """Settings of one operating point.

    Parameters
    ----------
    omega : float
        Speed of the driver [rad/s]; negative if the belt runs against the order of the pulleys.
    T_0 : float
        Belt tension at rest [N]; with a given slack force the effective force P of that span in
        motion, less than its tension by m v²; nan if a tensioner or the belt's length sets it.
    torque : tuple of float
        Torque taken off at each pulley [N m], braking > 0; the driver's entry is ignored.
    power : tuple of float
        Power taken off at each pulley [W], in addition to the torque; empty for none.
    """

    omega: float
    T_0: float
    torque: tuple[float, ...]
    power: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        problems = []
        if not (math.isfinite(self.omega) and self.omega != 0.0):
            problems.append(f"driver speed {self.omega:g} rad/s, must be finite and not 0")
        if self.T_0 <= 0.0:
            problems.append(f"initial tension {self.T_0:g} N, must be > 0")
        if not np.all(np.isfinite((*self.torque, *self.power))):
            problems.append("torques and powers must be finite")
        if problems:
            raise InputError(problems)

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

"""Frozen physical parameters in SI units; the config states their bounds.

Attribute names are the symbols of the paper; configs, columns and options use words with units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from beltid.errors import InputError

Supports = Literal["pinned", "clamped"]
GivenForce = Literal["none", "tight", "slack", "hub"]


@dataclass(frozen=True, slots=True)
class Belt:
    """Section properties of a belt.

    Parameters
    ----------
    EA : float
        Axial stiffness [N].
    EI : float
        Bending stiffness [N m²].
    rhoA : float
        Mass per length [kg/m].
    damping_time : float
        Kelvin–Voigt ratio c/E of Eq. (9) [s].
    """

    EA: float
    EI: float
    rhoA: float
    damping_time: float = 1.0e-4


@dataclass(frozen=True, slots=True)
class Rig:
    """Geometry of the friction rig.

    Parameters
    ----------
    R : float
        Radius of the belt's centreline on the pulley [m].
    span : float
        Length from a support to the tangent point [m].
    supports : {"pinned", "clamped"}
        How the load cells hold the belt ends.
    given_force : {"none", "tight", "slack", "hub"}
        What stays constant while the pulley turns. "none": the position of both ends, and so the
        stress-free length. "tight", "slack": the tension of that end, which carries a dead weight
        and moves along its span. "hub": the sum of both tensions, set by a force on the pulley
        slide, which moves along the bisector of the arc.
    """

    R: float
    span: float
    supports: Supports = "pinned"
    given_force: GivenForce = "none"


@dataclass(frozen=True, slots=True)
class Contact:
    """Settings of the contact that are not part of the identified laws.

    Parameters
    ----------
    C_P : float
        Normal damping of one contact point of the default mesh, Eq. (4) [N s/m].
    points_per_element : int
        Equally spaced contact points per belt element.
    sticking_ratio : float
        Static friction coefficient over the sliding one at the lowest measured speed [-].
    """

    C_P: float = 300.0
    points_per_element: int = 5
    sticking_ratio: float = 1.0


@dataclass(frozen=True, slots=True)
class OperatingPoint:
    """Settings of one run of the friction rig.

    Parameters
    ----------
    beta : float
        Contact arc, in (0, 2 pi) [rad].
    T_0 : float
        Tension of the belt before the pulley turns [N].
    omega : float
        Speed of the pulley [rad/s].
    """

    beta: float
    T_0: float
    omega: float

    def __post_init__(self) -> None:
        for name, high in (("beta", 2.0 * math.pi), ("T_0", math.inf), ("omega", math.inf)):
            # an int would make numba compile the kernels again for another signature
            value = float(getattr(self, name))
            object.__setattr__(self, name, value)
            if not 0.0 < value < high:
                raise InputError(f"run.{name} = {value:g}, must be in (0, {high:g})")

"""Frozen physical parameters in SI units; the config states their bounds.

Attribute names are the symbols of the paper; configs, columns and options use words with units.
"""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

from beltid.errors import InputError

GivenForce = Literal["none", "tight", "slack", "hub"]


class Belt(NamedTuple):
    """Section properties of a belt, for compiled code as well."""

    EA: float  # axial stiffness [N]
    EI: float  # bending stiffness [N m²]
    rhoA: float  # mass per length [kg/m]
    damping_time: float = 1.0e-4  # Kelvin–Voigt ratio c/E of Eq. (9) [s]


@dataclass(frozen=True, slots=True)
class Rig:
    """Geometry of the friction rig.

    Without a given force both ends stay; else the tension of the end that carries a dead weight and
    moves along its span, or the sum of both, by a force on the hub along the bisector of the arc.
    """

    R: float  # radius of the belt's centreline on the pulley [m]
    span: float  # length from a support to the tangent point [m]
    supports: Literal["pinned", "clamped"] = "pinned"  # how the load cells hold the belt ends
    given_force: GivenForce = "none"


@dataclass(frozen=True, slots=True)
class Contact:
    """Settings of the contact that are not part of the identified laws."""

    C_P: float = 300.0  # normal damping of a contact point of the default mesh, Eq. (4) [N s/m]
    points_per_element: int = 9  # equally spaced, per belt element
    sticking_ratio: float = 1.0  # static friction over that of the lowest measured speed [-]


@dataclass(frozen=True, slots=True)
class OperatingPoint:
    """Settings of one run of the friction rig."""

    beta: float  # contact arc, in (0, 2 pi) [rad]
    T_0: float  # tension of the belt before the pulley turns [N]
    omega: float  # speed of the pulley [rad/s]

    def __post_init__(self) -> None:
        for name, high in (("beta", 2.0 * math.pi), ("T_0", math.inf), ("omega", math.inf)):
            # an int would make numba compile the kernels again for another signature
            value = float(getattr(self, name))
            object.__setattr__(self, name, value)
            if not 0.0 < value < high:
                raise InputError(f"run.{name} = {value:g}, must be in (0, {high:g})")

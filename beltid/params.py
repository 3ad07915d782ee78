"""Frozen physical parameters in SI units, with their bounds.

Attribute names are the symbols of the paper; configs, columns and options use words with units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from beltid.errors import InputError

Supports = Literal["pinned", "clamped"]
GivenForce = Literal["none", "tight", "slack", "hub"]


def _require(owner: str, **checks: tuple[float, bool, str]) -> None:
    problems = [
        f"{owner}.{name} = {value!r}, must be {allowed}"
        for name, (value, ok, allowed) in checks.items()
        if not (ok and math.isfinite(value))
    ]
    if problems:
        raise InputError(problems)


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

    def __post_init__(self) -> None:
        _require(
            "belt",
            EA=(self.EA, self.EA > 0, "> 0 N"),
            EI=(self.EI, self.EI > 0, "> 0 N m²"),
            rhoA=(self.rhoA, self.rhoA > 0, "> 0 kg/m"),
            damping_time=(self.damping_time, self.damping_time >= 0, ">= 0 s"),
        )


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

    def __post_init__(self) -> None:
        _require(
            "rig",
            R=(self.R, self.R > 0, "> 0 m"),
            span=(self.span, self.span > 0, "> 0 m"),
        )
        if self.supports not in ("pinned", "clamped"):
            raise InputError(f"rig.supports = {self.supports!r}, must be 'pinned' or 'clamped'")
        if self.given_force not in ("none", "tight", "slack", "hub"):
            allowed = "'none', 'tight', 'slack' or 'hub'"
            raise InputError(f"rig.given_force = {self.given_force!r}, must be {allowed}")


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

    def __post_init__(self) -> None:
        _require(
            "contact",
            C_P=(self.C_P, self.C_P >= 0, ">= 0 N s/m"),
            points_per_element=(
                self.points_per_element,
                1 <= self.points_per_element <= 9,
                "in 1..9",
            ),
            sticking_ratio=(self.sticking_ratio, self.sticking_ratio >= 1, ">= 1"),
        )


@dataclass(frozen=True, slots=True)
class OperatingPoint:
    """Settings of one run of the friction rig.

    Parameters
    ----------
    beta : float
        Contact arc [rad].
    T_0 : float
        Tension of the belt before the pulley turns [N].
    omega : float
        Speed of the pulley [rad/s].
    """

    beta: float
    T_0: float
    omega: float

    def __post_init__(self) -> None:
        _require(
            "run",
            beta=(self.beta, 0 < self.beta < 2 * math.pi, "in (0, 2 pi) rad"),
            T_0=(self.T_0, self.T_0 > 0, "> 0 N"),
            omega=(self.omega, self.omega > 0, "> 0 rad/s"),
        )
        # an int would make numba compile the kernels again for another signature
        for name in ("beta", "T_0", "omega"):
            object.__setattr__(self, name, float(getattr(self, name)))

"""User choices for an export, units and reference point, and the resulting files."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from beltid.export.reduction import Deviation, ReferencePoint


@dataclass(frozen=True, slots=True)
class UnitSystem:
    """Units of a target file, with conversion factors from SI.

    Attributes
    ----------
    name : str
        Value of the command-line option.
    length, line_force, stiffness, speed : str
        Names of the units.
    metre : float
        Units of length per metre.
    """

    name: str
    length: str
    line_force: str
    stiffness: str
    speed: str
    metre: float

    @property
    def newton_per_metre(self) -> float:
        """Units of line force per N/m."""
        return 1.0 / self.metre


SI: Final = UnitSystem("SI", "m", "N/m", "N/m^2", "m/s", 1.0)
MM: Final = UnitSystem("mm", "mm", "N/mm", "N/mm^2", "mm/s", 1.0e3)
SYSTEMS: Final = {system.name: system for system in (SI, MM)}


@dataclass(frozen=True, slots=True)
class Choices:
    """Choices for the targets that need them.

    Attributes
    ----------
    point : ReferencePoint
        Point at which one-point reductions are exact.
    units : UnitSystem
        Units of the files that support units other than SI.
    """

    point: ReferencePoint
    units: UnitSystem = SI


@dataclass(frozen=True, slots=True)
class Export:
    """Files for one target.

    Attributes
    ----------
    files : dict of str to bytes
        Content by file name.
    reductions : dict of str to Deviation
        Deviation from the law, by name of the simplification.
    """

    files: dict[str, bytes]
    reductions: dict[str, Deviation] = field(default_factory=dict)

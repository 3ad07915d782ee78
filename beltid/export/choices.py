"""What the user chose for a file: units and reference point; and what became of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from beltid.export.reduction import Deviation, ReferencePoint


@dataclass(frozen=True, slots=True)
class UnitSystem:
    """Units of a target file; a value in SI times a factor is the value in these units.

    Attributes
    ----------
    name : str
        As the option names it.
    length, line_force, stiffness, speed, pressure : str
        Names of the units.
    metre : float
        Units of length in a metre.
    pascal : float
        Units of pressure in a pascal.
    """

    name: str
    length: str
    line_force: str
    stiffness: str
    speed: str
    pressure: str
    metre: float
    pascal: float

    @property
    def newton_per_metre(self) -> float:
        """Units of line force in 1 N/m."""
        return 1.0 / self.metre


SI: Final = UnitSystem("SI", "m", "N/m", "N/m^2", "m/s", "Pa", 1.0, 1.0)
MM: Final = UnitSystem("mm", "mm", "N/mm", "N/mm^2", "mm/s", "MPa", 1.0e3, 1.0e-6)
SYSTEMS: Final = {system.name: system for system in (SI, MM)}


@dataclass(frozen=True, slots=True)
class Choices:
    """Choices for the targets that need them.

    Attributes
    ----------
    point : ReferencePoint
        Where one-point reductions are exact.
    units : UnitSystem
        Units of the files that may be in others than SI.
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
        What was simplified, and how far it is from the law.
    """

    files: dict[str, bytes]
    reductions: dict[str, Deviation] = field(default_factory=dict)

"""Systems of units that a target file can be written in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


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

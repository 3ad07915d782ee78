"""What the tolerance of the belt's length does to a drive: tensions, hub forces, reserves.

A belt is made with a tolerance, grows with temperature and wears; its tensioner turns until it
meets an end of its travel. The tolerance states all of that together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from beltid.drive.model import Drive, DrivePoint
from beltid.drive.results import DriveResult, Method, Simulator

Array = NDArray[np.float64]

LENGTHS: Final = (("min", -1.0), ("mean", 0.0), ("max", 1.0))
"""Names of the lengths, and tolerances that they add."""


@dataclass(frozen=True, slots=True)
class InstalledBelt:
    """A drive with a belt of one of the lengths: name, stress-free length [m], solved point."""

    name: str
    length: float
    result: DriveResult

    @property
    def hub_force_at_rest(self) -> Array:
        """Force of the belt on the axis of each pulley at rest [N], shape (n,)."""
        rest = self.result.rest
        forces = rest.laid.hub_forces(np.full(rest.laid.spans.size, rest.T_0))
        return np.hypot(*self.result.in_order(forces).T)

    @property
    def largest_tension(self) -> float:
        """Largest tension of a span at the operating point [N]."""
        return float(np.max(self.result.tensions[0]))


def installed_belts(
    drive: Drive, method: Method, point: DrivePoint, tolerance: float
) -> list[InstalledBelt]:
    """Solve a point with the shortest, the stated and the longest belt.

    Parameters
    ----------
    drive : Drive
        Drive with the length of its belt, or with a tension that determines it.
    method : {"string", "rod"}
        As of :class:`beltid.drive.results.Simulator`.
    point : DrivePoint
        Operating point.
    tolerance : float
        Largest difference of a belt's length, both ways [m].

    Raises
    ------
    InputError
        If a belt cannot be installed: too long for the pulleys, or too short for them.
    ConvergenceError
        If there is no steady state.
    """
    mean = Simulator(drive, method).solve(point).rest.belt_length
    point, found = replace(point, T_0=np.nan), []
    for name, share in LENGTHS:
        length = mean + share * tolerance
        result = Simulator(replace(drive, belt_length=length), method).solve(point)
        found.append(InstalledBelt(name, length, result))
    return found

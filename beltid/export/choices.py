"""What the user chose for a file, and what became of it."""

from __future__ import annotations

from dataclasses import dataclass, field

from beltid.export.reduction import Deviation, ReferencePoint
from beltid.export.units import SI, UnitSystem


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

"""Width of the ribbed side of a V-ribbed belt, from its type and number of ribs."""

from __future__ import annotations

import re
from typing import Final

RIB_PITCH_M: Final = {"H": 1.60e-3, "J": 2.34e-3, "K": 3.56e-3, "L": 4.70e-3, "M": 9.40e-3}
"""Rib pitch of the profiles PH to PM, ISO 9982."""


def ribbed_width(belt_type: str | None, ribs: int | None) -> float | None:
    """Width [m] of a belt whose type names its profile, such as 5PK or PJ; None where it does not.

    Parameters
    ----------
    belt_type : str or None
        Type as the maker writes it.
    ribs : int or None
        Number of ribs.
    """
    profile = re.search(r"(?<![A-Z])P([HJKLM])(?![A-Z])", (belt_type or "").upper())
    if profile is None or ribs is None:
        return None
    return ribs * RIB_PITCH_M[profile[1]]

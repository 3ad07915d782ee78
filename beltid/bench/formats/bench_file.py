"""What is found in a file of a bench, before anybody asks what it is good for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from beltid.errors import InputError
from beltid.tables.units import T, allowed_units, conversion

_ALLOWED: Final = ", ".join(allowed_units("s"))
SCALING: Final = {
    **dict.fromkeys(("slope", "scale", "scaling", "factor", "gain", "multiplier", "lsb"), 1.0),
    **dict.fromkeys(("offset", "intercept", "y_intercept", "bias"), 0.0),
}
"""Properties that tell how counts of a converter become numbers -> the value of no effect.

No format defines them; what one does define (`scale_factor`, ``NI_Scale``), its reader applies.
"""


def even_times(start_s: float, step_s: float, n: int) -> np.ndarray:
    """Times of evenly spaced samples [s], shape (n,), as the decimals that a table would hold.

    Rounded to a picosecond: 3 * 0.02 is 0.06 then, as in a file that writes its times.
    """
    return np.round(start_s + step_s * np.arange(n), 12)


def in_seconds(times: T, unit: str) -> T:
    """Times that a format tells in a unit of its own [s]; without a unit they are in seconds.

    Raises
    ------
    InputError
        If the unit is none of time.
    """
    known = conversion(unit, "s") or conversion(unit.lower(), "s")
    if known is None and unit.strip():
        raise InputError(f"the time is in {unit.strip()}, must be one of {_ALLOWED}")
    return times if known is None or known.factor == 1.0 else known.apply(times)


def scaling_beside(values: np.ndarray, properties: Mapping[str, Any]) -> str:
    """What is told beside whole numbers of how to scale them, such as ``slope = 0.02``; else "".

    Parameters
    ----------
    values : ndarray
        Samples as the file holds them: of other than whole numbers nothing is said.
    properties : mapping
        What the file tells about the channel.
    """
    if values.dtype.kind not in "iu":
        return ""
    told = []
    for name, value in properties.items():
        neutral = SCALING.get(str(name).lower())
        if neutral is None or np.size(value) != 1:
            continue
        try:
            number = float(np.ravel(value)[0])
        except (TypeError, ValueError):
            continue
        if number != neutral:
            told.append(f"{name} = {number:g}")
    return ", ".join(told)


@dataclass(frozen=True, slots=True)
class Field:
    """A line of a header: name, value as text, unit as written ("" where none is told)."""

    name: str
    text: str
    unit: str = ""


@dataclass(frozen=True, slots=True)
class Channel:
    """One channel.

    Attributes
    ----------
    name : str
        As the file calls it.
    unit : str
        As the file writes it, "" where none is told.
    values : ndarray
        float64 with nan where a sample is missing, or an object array of str and None.
    time_s : ndarray or None
        Time of every sample [s], where the format itself tells it; None where it does not.
    scaling : str
        What the file tells of a scaling that was not applied, see `scaling_beside`.
    """

    name: str
    unit: str
    values: np.ndarray
    time_s: np.ndarray | None = None
    scaling: str = ""

    @property
    def is_text(self) -> bool:
        """Whether it holds texts rather than numbers."""
        return bool(self.values.dtype.kind == "O")

    def first_texts(self) -> list[str]:
        """The first of its texts; none where it holds numbers."""
        return [text for text in self.values[:200] if text] if self.is_text else []


@dataclass(frozen=True, slots=True)
class Group:
    """Channels that the file keeps together: a group, a sheet, a struct, a raster, a segment.

    Attributes
    ----------
    name : str
        As the file calls it, "" where it has no name.
    channels : tuple of Channel
        Channels in the order of the file.
    fields : tuple of Field
        Header fields of this group.
    first_row : int
        Line or row of the first sample in the file, from 1; 0 where the format has no rows.
    """

    name: str
    channels: tuple[Channel, ...]
    fields: tuple[Field, ...] = ()
    first_row: int = 0


@dataclass(frozen=True, slots=True)
class BenchFile:
    """Everything that was found in a file.

    Attributes
    ----------
    format : str
        The format in words, such as ``"NI TDMS"``.
    groups : tuple of Group
        Groups that hold channels.
    fields : tuple of Field
        Header fields of the whole file.
    notes : tuple of str
        What was found out or left out.
    """

    format: str
    groups: tuple[Group, ...]
    fields: tuple[Field, ...] = ()
    notes: tuple[str, ...] = field(default=())

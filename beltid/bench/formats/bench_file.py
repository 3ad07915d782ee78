"""Contents of a bench file, before its channels are assigned to columns."""

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
    "scale_factor": 1.0,
    **dict.fromkeys(("offset", "intercept", "y_intercept", "bias"), 0.0),
    "add_offset": 0.0,
}
"""Properties that scale the counts of a converter -> the value that has no effect.

They are not applied; those of TDMS (``NI_Scale``) are, by its reader.
"""


def even_times(start_s: float, step_s: float, n: int) -> np.ndarray:
    """Return the times of evenly spaced samples [s], shape (n,), rounded to a picosecond.

    With rounding, 3 * 0.02 is 0.06, as in a file that lists its times.
    """
    return np.round(start_s + step_s * np.arange(n), 12)


def in_seconds(times: T, unit: str) -> T:
    """Convert times to seconds; times without a unit are taken as seconds.

    Raises
    ------
    InputError
        If the unit is not a unit of time.
    """
    to_seconds = conversion(unit, "s") or conversion(unit.lower(), "s")
    if to_seconds is None and unit.strip():
        raise InputError(f"the time is in {unit.strip()}, must be one of {_ALLOWED}")
    return times if to_seconds is None or to_seconds.factor == 1.0 else to_seconds.apply(times)


def unapplied_scaling(values: np.ndarray, properties: Mapping[str, Any]) -> str:
    """List the scaling properties of a channel of counts, such as ``slope = 0.02``; else "".

    Parameters
    ----------
    values : ndarray
        Samples as stored in the file; "" is returned unless they are integers.
    properties : mapping
        Properties of the channel in the file.
    """
    if values.dtype.kind not in "iu":
        return ""
    scalings = []
    for name, value in properties.items():
        neutral = SCALING.get(str(name).lower())
        if neutral is None or np.size(value) != 1:
            continue
        try:
            number = float(np.ravel(value)[0])
        except (TypeError, ValueError):
            continue
        if number != neutral:
            scalings.append(f"{name} = {number:g}")
    return ", ".join(scalings)


@dataclass(frozen=True, slots=True)
class Field:
    """A header entry: name, value as text, unit as written ("" if none is given)."""

    name: str
    text: str
    unit: str = ""


@dataclass(frozen=True, slots=True)
class Channel:
    """One channel.

    Attributes
    ----------
    name : str
        Name in the file.
    unit : str
        Unit as written in the file, "" if none is given.
    values : ndarray
        float64 with nan where a sample is missing, or an object array of str and None.
    time_s : ndarray or None
        Time of every sample [s] if the format stores it, else None.
    scaling : str
        Scaling in the file that was not applied, see `unapplied_scaling`.
    """

    name: str
    unit: str
    values: np.ndarray
    time_s: np.ndarray | None = None
    scaling: str = ""

    @property
    def is_text(self) -> bool:
        """Whether the channel holds texts, not numbers."""
        return bool(self.values.dtype.kind == "O")

    def first_texts(self) -> list[str]:
        """Return the texts among the first 200 values; none for a channel of numbers."""
        return [text for text in self.values[:200] if text] if self.is_text else []


@dataclass(frozen=True, slots=True)
class Group:
    """Channels that belong together in the file: a group, sheet, struct, raster or segment.

    Attributes
    ----------
    name : str
        Name in the file, "" if it has none.
    channels : tuple of Channel
        Channels in the order of the file.
    fields : tuple of Field
        Header fields of this group.
    first_row : int
        Line or row of the first sample in the file, from 1; 0 if the format has no rows.
    """

    name: str
    channels: tuple[Channel, ...]
    fields: tuple[Field, ...] = ()
    first_row: int = 0


@dataclass(frozen=True, slots=True)
class BenchFile:
    """Everything read from a file.

    Attributes
    ----------
    format : str
        The format in words, such as ``"NI TDMS"``.
    groups : tuple of Group
        Groups that hold channels.
    fields : tuple of Field
        Header fields of the whole file.
    notes : tuple of str
        What was detected or left out.
    """

    format: str
    groups: tuple[Group, ...]
    fields: tuple[Field, ...] = ()
    notes: tuple[str, ...] = field(default=())

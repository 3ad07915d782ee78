"""Values of a column: as numbers, missing, out of range."""

from __future__ import annotations

from typing import Any

import numpy as np

from beltid.tables.columns import Column


def floats(values: Any) -> np.ndarray:
    """float64 array of values, nan where one is missing (None, masked, pandas.NA).

    Raises
    ------
    ValueError, TypeError
        If a value is no number.
    """
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(np.float64), np.nan)
    array = np.asarray(values)
    if array.dtype.kind in "fiu":
        return array.astype(np.float64)
    if array.dtype.kind in "cmM":  # times would count as nanoseconds, complex values lose a part
        raise TypeError(f"{array.dtype} is no type of numbers")
    return np.array([np.nan if is_missing(v) else v for v in array], dtype=np.float64)


def is_missing(cell: Any) -> bool:
    """Whether one value stands for a missing one: None, nan, pandas.NA, pandas.NaT."""
    if cell is None or type(cell).__name__ in ("NAType", "NaTType"):
        return True
    return isinstance(cell, (float, np.floating)) and bool(np.isnan(cell))


def shown_value(value: float | str) -> str:
    """A number or a word in a message."""
    return value if isinstance(value, str) else f"{value:g}"


def absent(values: np.ndarray) -> np.ndarray:
    """Which values are missing: None among texts, nan among numbers."""
    if values.dtype == object:
        return np.fromiter((v is None for v in values), dtype=bool, count=len(values))
    return np.asarray(np.isnan(values))


def outside(numbers: np.ndarray, column: Column) -> np.ndarray:
    """Which numbers lie outside the range of a column; missing ones (nan) do not."""
    low = numbers <= column.low if column.open_low else numbers < column.low
    high = numbers >= column.high if column.open_high else numbers > column.high
    return np.asarray(low | high)

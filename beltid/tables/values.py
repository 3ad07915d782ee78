"""Values of a column: conversion to numbers, missing values, range checks."""

from typing import Any

import numpy as np

from beltid.tables.schemas import Column


def floats(values: Any) -> np.ndarray:
    """Convert values to a float64 array, with nan for missing ones (None, masked, pandas.NA)."""
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(np.float64), np.nan)
    array = np.asarray(values)
    if array.dtype.kind in "fiu":
        return array.astype(np.float64)
    if array.dtype.kind in "cmM":  # times would become nanoseconds, complex values lose a part
        raise TypeError(f"{array.dtype} is not a type of real numbers")
    return np.array([np.nan if is_missing(v) else v for v in array], dtype=np.float64)


def is_missing(cell: Any) -> bool:
    """Return whether a value is missing: None, nan, pandas.NA, pandas.NaT."""
    if cell is None or type(cell).__name__ in ("NAType", "NaTType"):
        return True
    return isinstance(cell, (float, np.floating)) and bool(np.isnan(cell))


def shown_value(value: float | str) -> str:
    """Format a number or a word for a message."""
    return value if isinstance(value, str) else f"{value:g}"


def absent(values: np.ndarray) -> np.ndarray:
    """Return a mask of missing values: None among texts, nan among numbers."""
    if values.dtype == object:
        return np.fromiter((v is None for v in values), dtype=bool, count=len(values))
    return np.asarray(np.isnan(values))


def outside(numbers: np.ndarray, column: Column) -> np.ndarray:
    """Return a mask of numbers outside the range of a column; nan is not outside."""
    low = numbers <= column.low if column.open_low else numbers < column.low
    high = numbers >= column.high if column.open_high else numbers > column.high
    return np.asarray(low | high)

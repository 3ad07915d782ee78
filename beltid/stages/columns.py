"""Columns and rows of tables: built from results, cut to what counts, in words."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from beltid.errors import InputError
from beltid.tables import schemas
from beltid.tables.values import is_missing, outside


@contextlib.contextmanager
def at(item: Any) -> Iterator[None]:
    """Put the file of an input before the lines of an InputError raised inside."""
    try:
        yield
    except InputError as error:
        if type(error) is not InputError:
            raise
        raise InputError(error.at(str(getattr(item, "path", "table")))) from None


def columns_from(kind: str, rows: Sequence[Any], **more: Sequence[Any]) -> dict[str, np.ndarray]:
    """Return the columns of a kind from attributes of these names, and from `more`.

    A number that the schema does not allow becomes nan.
    """
    columns: dict[str, np.ndarray] = {}
    for column in schemas.table(kind).columns:
        name = column.name
        if name not in more and not hasattr(rows[0], name):
            continue
        values = more[name] if name in more else [getattr(row, name) for row in rows]
        if name in schemas.WHERE_KNOWN and all(is_missing(value) for value in values):
            continue
        array = np.empty(len(values), dtype=object if column.dtype == "string" else column.dtype)
        array[:] = values
        if column.dtype == "float64":
            array = np.where(np.isfinite(array) & ~outside(array, column), array, np.nan)
        columns[name] = array
    return columns


def ok_rows(friction: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return which runs of a friction table are usable, shape (n,); all if it has no status."""
    status = friction.get("status")
    return np.ones(len(friction["arc_deg"]), dtype=bool) if status is None else status == "ok"


def span(values: Any) -> tuple[float, float] | None:
    """Return the lowest and highest finite value, or None if there is none."""
    values = np.asarray(values, dtype=float)
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if finite.size else None


def finite_or_none(value: float) -> float | None:
    """Return a number, or None in place of nan and infinity."""
    return value if np.isfinite(value) else None


def in_percent(share: float | None) -> float | None:
    """Convert a share to percent; None stays None."""
    return None if share is None else 100.0 * share


def listed(words: Sequence[str], most: int = 8) -> str:
    """Join the first `most` words, and state how many more there are."""
    text = ", ".join(words[:most])
    return f"{text} and {len(words) - most} more" if len(words) > most else text

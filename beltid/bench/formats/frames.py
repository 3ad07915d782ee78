"""Columns of something that is in memory: DataFrame, Arrow table, mapping."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from beltid.bench.formats.clock import Clock, holds_clock, is_clock
from beltid.bench.formats.rows import Texts, numbers_of, word_of
from beltid.errors import InputError, Problem, Problems
from beltid.tables.schemas import Column, Table
from beltid.tables.values import floats


def columns_of_frame(
    frame: Any,
    table: Table,
    name: str,
    names: Mapping[str, str],
    problems: Problems,
    clock: Clock | None = None,
) -> dict[str, np.ndarray]:
    """Columns of a table in memory, with the types of the schema.

    Parameters
    ----------
    frame : DataFrame, pyarrow Table or mapping
        The samples.
    table : Table
        The schema.
    name : str
        Name of the frame, for messages.
    names : mapping
        Our column -> its name in the frame.
    problems : Problems
        Collects what is missing or of the wrong type.
    clock : Clock, optional
        Reads the time where it is that of a clock.

    Raises
    ------
    InputError
        If the frame is no table, or has no rows.
    """
    have = names_of(frame, name)
    columns: dict[str, np.ndarray] = {}
    for column in table.columns:
        theirs = names.get(column.name, column.name)
        if theirs in have:
            values = _column(frame, have[theirs])
            if column.unit == "s":
                values = _seconds(values)
            times = _clock_times(values) if clock and column.name == "time_s" else None
            if clock is None or times is None:
                columns[column.name] = _values(values, column, name, problems)
                continue
            dates = _arrow(_column(frame, clock.date)) if clock.date else None
            columns[column.name], wrong = clock.read(times, dates)
            clock.report_wrong(wrong, times, lambda i: (f"{name}, row {i + 1}", i + 1), problems)
        elif column.required:
            problems.add(missing_column(theirs, list(have), name))
    lengths = {len(values) for values in columns.values()}
    if lengths == {0}:
        raise InputError(f"{name}: holds no samples")
    if len(lengths) > 1:
        problems.add(f"{name}: the columns have different lengths {sorted(lengths)}")
    return columns


def missing_column(wanted: str, have: Sequence[str], name: str) -> Problem:
    """Say that a column is missing, and what it may be called instead."""
    close = difflib.get_close_matches(wanted, have, n=1, cutoff=0.6)
    guess = f", did you mean {close[0]}?" if close else ""
    found = ", ".join(have[:20])
    return Problem(f"{name}: column {wanted} is missing{guess}; found are {found}", "columns")


def names_of(frame: Any, name: str) -> dict[str, Any]:
    """Names of the columns of a table in memory -> its own for them; InputError if it is none."""
    if isinstance(frame, Mapping):
        found = list(frame)
    elif hasattr(frame, "column_names"):
        found = list(frame.column_names)
    elif hasattr(frame, "columns") and hasattr(frame, "__getitem__"):
        found = list(frame.columns)
    else:
        raise InputError(
            f"{name}: is a {type(frame).__name__}, must be a DataFrame, an Arrow table or a dict "
            "of columns"
        )
    return {str(column): column for column in found}


def _column(frame: Any, theirs: Any) -> Any:
    column = frame[theirs]
    if hasattr(column, "to_pylist") and not hasattr(column, "iloc"):  # an Arrow column
        if hasattr(column.type, "value_type") and hasattr(column.type, "index_type"):
            return Texts.of_arrow(column).objects()
        try:
            return np.asarray(column.to_numpy())
        except (ValueError, TypeError):
            return column.to_pylist()
    return column


def _arrow(values: Any) -> Any:
    """Values as an Arrow array; None where they are of no type of Arrow."""
    import pyarrow as pa

    try:
        found = pa.array(values)
    except (pa.ArrowException, ValueError, TypeError):
        return None
    return found.combine_chunks() if isinstance(found, pa.ChunkedArray) else found


def _seconds(values: Any) -> Any:
    """Durations as seconds; values that are none as they are."""
    import pyarrow as pa

    found = _arrow(values)
    return numbers_of(found) if found is not None and pa.types.is_duration(found.type) else values


def _clock_times(values: Any) -> Any:
    """Clock times as an Arrow array; None where the values are something else."""
    import pyarrow as pa

    times = _arrow(values)
    if times is None:
        return None
    is_text = pa.types.is_string(times.type) or pa.types.is_large_string(times.type)
    if is_text and not is_clock(next((t.as_py() for t in times if t.is_valid), "")):
        return None
    return times if holds_clock(times.type) else None


def _values(values: Any, column: Column, name: str, problems: Problems) -> np.ndarray:
    if np.ndim(values) != 1:
        problems.add(f"{name}: column {column.name} has {np.ndim(values)} axes, must be a list")
        return np.empty(0)
    if column.dtype == "string":
        return Texts.of(map(word_of, np.asarray(values, dtype=object))).objects()
    try:
        return floats(values)
    except (ValueError, TypeError):
        cells = np.asarray(values, dtype=object)
        rows = [row for row, v in enumerate(cells) if isinstance(v, str) or not np.isscalar(v)]
        problems.add_alike(
            rows,
            lambda row: f"{column.name} = {cells[row]!r}, must be a number",
            lambda row: (f"{name}, row {row + 1}", row + 1),
        )
        if not rows:
            problems.add(f"{name}: column {column.name} must hold numbers")
        return np.full(len(values), np.nan)

"""Tables in memory as tables of Arrow: DataFrame, mapping, Arrow table."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from beltid.bench.formats.rows import word_of
from beltid.errors import InputError, Problems

if TYPE_CHECKING:
    import pyarrow as pa


def arrow_of(frame: Any, name: str, needed: Collection[str] | None = None) -> pa.Table:
    """A table of Arrow with the columns of a table in memory; values of several types are texts.

    Parameters
    ----------
    frame : DataFrame, pyarrow Table or mapping
        The samples.
    name : str
        Name of the frame, for messages.
    needed : collection of str, optional
        Only these columns.

    Raises
    ------
    InputError
        If the frame is no table.
    """
    import pyarrow as pa

    problems, columns = Problems(), {}
    for theirs in _names_of(frame, name):
        if needed is not None and theirs not in needed:
            continue
        values = frame[theirs]
        if np.ndim(values) != 1:
            axes = np.ndim(values)
            problems.add(f"{name}: column {theirs} has {axes} axes, must be a list", code="columns")
            continue
        columns[str(theirs)] = _arrow(values)
    if len(lengths := {len(values) for values in columns.values()}) > 1:
        problems.add(f"{name}: the columns have different lengths {sorted(lengths)}")
    problems.raise_if_any()
    return pa.table(columns)


def _names_of(frame: Any, name: str) -> list[Any]:
    if isinstance(frame, Mapping):
        return list(frame)
    if hasattr(frame, "column_names"):
        return list(dict.fromkeys(frame.column_names))
    if hasattr(frame, "columns") and hasattr(frame, "__getitem__"):
        return list(dict.fromkeys(frame.columns))
    raise InputError(
        f"{name}: is a {type(frame).__name__}, must be a DataFrame, an Arrow table or a dict of "
        "columns"
    )


def _arrow(values: Any) -> Any:
    import pyarrow as pa

    if isinstance(values, (pa.Array, pa.ChunkedArray)):
        return values
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(np.float64), np.nan)
    try:
        return pa.array(values, from_pandas=True)
    except (pa.ArrowException, ValueError, TypeError):
        return pa.array([word_of(value) for value in values], pa.string())

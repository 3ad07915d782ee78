"""Tables in memory as tables of Arrow: DataFrame, mapping, Arrow table."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from beltid.bench.formats.rows import word_of
from beltid.errors import InputError

if TYPE_CHECKING:
    import pyarrow as pa


def arrow_of(frame: Any, name: str, needed: Collection[str]) -> pa.Table:
    """A table of Arrow with the columns of a table in memory; values of several types are texts.

    Parameters
    ----------
    frame : DataFrame, pyarrow Table or mapping
        The samples.
    name : str
        Name of the frame, for messages.
    needed : collection of str
        Columns that must be lists of one length; others that are not are left out.

    Raises
    ------
    InputError
        If the frame is no table, or a column that is needed is none of it.
    """
    import pyarrow as pa

    columns = {str(theirs): frame[theirs] for theirs in _names_of(frame, name)}
    axes = {theirs: np.ndim(values) for theirs, values in columns.items()}
    problems = [
        f"{name}: column {theirs} has {n} axes, must be a list"
        for theirs, n in axes.items()
        if theirs in needed and n != 1
    ]
    lists = {theirs: values for theirs, values in columns.items() if axes[theirs] == 1}
    lengths = {len(values) for theirs, values in lists.items() if theirs in needed}
    if len(lengths) > 1:
        problems.append(f"{name}: the columns have different lengths {sorted(lengths)}")
    if problems:
        raise InputError(problems)
    length = next(iter(lengths), len(next(iter(lists.values()), ())))
    return pa.table({n: _arrow(values) for n, values in lists.items() if len(values) == length})


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

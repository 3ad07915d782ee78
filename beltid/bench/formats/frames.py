"""Convert tables in memory (DataFrame, mapping, Arrow table) to Arrow tables."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from beltid.bench.formats.rows import word_of
from beltid.errors import InputError

if TYPE_CHECKING:
    import pyarrow as pa


def arrow_of(frame: Any, name: str, needed: Collection[str]) -> pa.Table:
    """Convert a table in memory to an Arrow table; columns of mixed types become texts.

    Parameters
    ----------
    frame : DataFrame, pyarrow Table or mapping
        The samples.
    name : str
        Name of the frame, for messages.
    needed : collection of str
        Columns that must be 1-D and of equal length; any other column that is not is left out.

    Raises
    ------
    InputError
        If the frame is not a table, or a needed column is not 1-D or has another length.
    """
    import pyarrow as pa

    columns = {str(column): frame[column] for column in _names_of(frame, name)}
    axes = {column: np.ndim(values) for column, values in columns.items()}
    problems = [
        f"{name}: column {column} has {n} axes, must be a list"
        for column, n in axes.items()
        if column in needed and n != 1
    ]
    lists = {column: values for column, values in columns.items() if axes[column] == 1}
    lengths = {len(values) for column, values in lists.items() if column in needed}
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

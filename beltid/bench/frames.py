"""Parquet files, and tables in memory: DataFrame, Arrow table, mapping of columns."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from pyarrow import types

from beltid.bench.numbers import word_of
from beltid.bench.raw import Raw
from beltid.errors import InputError
from beltid.store.parquet import damaged, open_parquet


def read(path: Path, place: str) -> Iterator[Raw]:
    """Read a Parquet file."""
    file = open_parquet(path.read_bytes(), place, InputError)
    try:
        table = file.read()
        table.validate(full=True)
    except Exception as error:  # a damaged file can raise nearly anything
        raise InputError(f"{place}: {damaged(error)}") from None
    yield table_of(table, place)


def table_of(table: pa.Table, place: str) -> Raw:
    """Return an Arrow table as written; a column that is neither numbers nor texts is left out."""
    columns, units, left_out = {}, {}, []
    for field, values in zip(table.schema, table.columns, strict=True):
        kind = values.type
        if field.name in columns:
            raise InputError(f"{place}: column {field.name} occurs several times, must be once")
        units[field.name] = (field.metadata or {}).get(b"unit", b"").decode(errors="replace")
        if types.is_duration(kind):
            nanoseconds = values.cast(pa.duration("ns")).cast(pa.int64()).to_numpy()
            columns[field.name], units[field.name] = nanoseconds / 1e9, "s"
        elif (
            types.is_null(kind)
            or types.is_decimal(kind)
            or (types.is_primitive(kind) and (types.is_integer(kind) or types.is_floating(kind)))
        ):
            columns[field.name] = values.cast(pa.float64(), safe=False).to_numpy()
        elif types.is_nested(kind) or types.is_binary(kind):
            left_out.append(f"column {field.name} holds {kind}, left out")
        else:  # texts; times and true or false as texts
            columns[field.name] = pd.array(values.cast(pa.large_string()), dtype="str")
    return Raw(
        place,
        pd.DataFrame(columns, copy=False),
        format="Parquet",
        units={n: u for n, u in units.items() if u},
        notes=tuple(left_out),
    )


def frame_of(frame: Any, place: str, needed: Collection[str]) -> Raw:
    """Return a table in memory as written; columns of mixed types become texts.

    Parameters
    ----------
    frame : DataFrame, pyarrow Table or mapping
        The samples.
    place : str
        Name of the frame, for messages.
    needed : collection of str
        Columns that must be lists of equal length; any other column that is not is left out.

    Raises
    ------
    InputError
        If the frame is not a table, holds no samples, or a needed column is not such a list.
    """
    names = getattr(frame, "column_names", getattr(frame, "columns", frame))
    if not (isinstance(frame, Mapping) or hasattr(frame, "columns")):
        raise InputError(
            f"{place}: is a {type(frame).__name__}, must be a DataFrame, an Arrow table or a dict "
            "of columns"
        )
    columns = {str(name): frame[name] for name in dict.fromkeys(names)}
    axes = {name: np.ndim(values) for name, values in columns.items()}
    problems = [
        f"{place}: column {name} has {n} axes, must be a list"
        for name, n in axes.items()
        if name in needed and n != 1
    ]
    lists = {name: values for name, values in columns.items() if axes[name] == 1}
    lengths = {len(values) for name, values in lists.items() if name in needed}
    if len(lengths) > 1:
        problems.append(f"{place}: the columns have different lengths {sorted(lengths)}")
    if problems:
        raise InputError(problems)
    length = next(iter(lengths), len(next(iter(lists.values()), ())))
    if not length:
        raise InputError(f"{place}: holds no samples")
    whole = {n: _arrow(values) for n, values in lists.items() if len(values) == length}
    return table_of(pa.table(whole), place)


def _arrow(values: Any) -> Any:
    """Return a list as an Arrow array, of texts if its values are of several types."""
    if isinstance(values, (pa.Array, pa.ChunkedArray)):
        return values
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(np.float64), np.nan)
    try:
        return pa.array(values, from_pandas=True)
    except (pa.ArrowException, ValueError, TypeError):
        return pa.array([word_of(value) for value in values], pa.string())

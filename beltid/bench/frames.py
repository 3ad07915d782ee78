"""Parquet files, and tables in memory: DataFrame, Arrow table, mapping of columns."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import types

from beltid.bench.numbers import word_of
from beltid.bench.raw import Raw
from beltid.errors import InputError
from beltid.store.parquet import damaged, open_parquet

LONGEST_TEXT: Final = 1000


def read(path: Path, place: str) -> Iterator[Raw]:
    """Read a Parquet file."""
    file = open_parquet(path.read_bytes(), place, InputError)
    try:
        table = file.read()
        table.validate(full=True)
    except Exception as error:  # a damaged file can raise nearly anything
        raise InputError(f"{place}: {damaged(error)}") from None
    if not table.num_rows:
        raise InputError(f"{place}: is empty: it holds no samples")
    yield table_of(table, place)


def table_of(table: pa.Table, place: str) -> Raw:
    """Return an Arrow table as written; a column that is neither numbers nor texts is left out."""
    columns, units, left_out = {}, {}, []
    for field, values in zip(table.schema, table.columns, strict=True):
        if table.schema.names.count(field.name) > 1:
            raise InputError(f"{place}: column {field.name} occurs several times, must be once")
        units[field.name] = (field.metadata or {}).get(b"unit", b"").decode(errors="replace")
        place_of_column = f"{place}: column {field.name}"
        if types.is_dictionary(values.type):
            for chunk in values.chunks:  # a long text in every row takes the memory of one
                _refuse_long(chunk.dictionary, place_of_column)
            values = values.cast(values.type.value_type)
        if types.is_duration(values.type):
            nanoseconds = values.cast(pa.duration("ns")).cast(pa.int64()).to_numpy()
            columns[field.name], units[field.name] = nanoseconds / 1e9, "s"
        elif _is_number(values.type):
            columns[field.name] = values.cast(pa.float64(), safe=False).to_numpy()
        elif (texts := _texts(values, place_of_column)) is not None:
            columns[field.name] = texts
        else:
            left_out.append(f"column {field.name} holds {field.type}, left out")
    return Raw(
        place,
        pd.DataFrame(columns, copy=False),
        format="Parquet",
        units={n: u for n, u in units.items() if u},
        notes=tuple(left_out),
        row_word="row",
    )


def _is_number(kind: pa.DataType) -> bool:
    return bool(
        types.is_integer(kind)
        or types.is_floating(kind)
        or types.is_decimal(kind)
        or types.is_null(kind)
    )


def _texts(values: pa.ChunkedArray, place: str) -> Any:
    """Return texts, or times as texts; None for anything else."""
    kind = values.type
    if types.is_nested(kind) or types.is_binary(kind) or isinstance(kind, pa.BaseExtensionType):
        return None
    try:
        texts = values.cast(pa.large_string())
    except (pa.ArrowException, ValueError):
        return None
    _refuse_long(texts, place)
    return pd.array(texts, dtype="str")


def _refuse_long(texts: Any, place: str) -> None:
    is_text = types.is_string(texts.type) or types.is_large_string(texts.type)
    if is_text and (pc.max(pc.binary_length(texts)).as_py() or 0) > LONGEST_TEXT:
        raise InputError(f"{place} holds texts of more than {LONGEST_TEXT} bytes")


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
    names = getattr(frame, "column_names", None)
    names = getattr(frame, "columns", frame) if names is None else names
    if not (
        isinstance(frame, Mapping) or hasattr(frame, "column_names") or hasattr(frame, "columns")
    ):
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
    if isinstance(values, (pa.Array, pa.ChunkedArray)):
        return values
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(np.float64), np.nan)
    try:
        return pa.array(values, from_pandas=True)
    except (pa.ArrowException, ValueError, TypeError):
        return pa.array([word_of(value) for value in values], pa.string())

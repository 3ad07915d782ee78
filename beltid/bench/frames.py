"""Parquet files, and tables in memory: DataFrame, Arrow table, mapping of columns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
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
"""Bytes of a text; a file can repeat a long one in every row at no cost."""


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
        elif types.is_null(kind) or types.is_decimal(kind) or _is_number(kind):
            columns[field.name] = values.cast(pa.float64(), safe=False).to_numpy()
        elif (
            types.is_nested(kind) or types.is_binary(kind) or isinstance(kind, pa.BaseExtensionType)
        ):
            left_out.append(f"column {field.name} holds {kind}, left out")
        else:  # texts; times and true or false as texts
            columns[field.name] = _texts(values, f"{place}: column {field.name}")
    units = {name: unit for name, unit in units.items() if unit}
    frame = pd.DataFrame(columns, copy=False)
    return Raw(place, frame, format="Parquet", units=units, notes=tuple(left_out))


def _is_number(kind: pa.DataType) -> bool:
    return bool(types.is_integer(kind) or types.is_floating(kind))


def _texts(values: pa.ChunkedArray, place: str) -> Any:
    """Return a column as texts, none of them long."""
    for chunk in values.chunks:
        words = chunk.dictionary if types.is_dictionary(chunk.type) else chunk
        is_text = types.is_string(words.type) or types.is_large_string(words.type)
        if is_text and (pc.max(pc.binary_length(words)).as_py() or 0) > LONGEST_TEXT:
            raise InputError(f"{place} holds texts of more than {LONGEST_TEXT} bytes")
    return pd.array(values.cast(pa.large_string()), dtype="str")


def frame_of(frame: Any, place: str) -> Raw:
    """Return a DataFrame, pyarrow Table or mapping as written; what is no list is left out."""
    if not (isinstance(frame, Mapping) or hasattr(frame, "columns")):
        raise InputError(
            f"{place}: is a {type(frame).__name__}, must be a DataFrame, an Arrow table or a dict "
            "of columns"
        )
    names = getattr(frame, "column_names", getattr(frame, "columns", frame))
    columns = {str(name): frame[name] for name in dict.fromkeys(names)}
    lists = {name: _arrow(values) for name, values in columns.items() if np.ndim(values) == 1}
    lengths = sorted({len(values) for values in lists.values()})
    if len(lengths) > 1:
        raise InputError(f"{place}: the columns have different lengths {lengths}")
    if lengths in ([], [0]):
        raise InputError(f"{place}: holds no samples")
    return table_of(pa.table(lists), place)


def _arrow(values: Any) -> Any:
    """Return a list as an Arrow array, of texts if its values are of several types."""
    if isinstance(values, (pa.Array, pa.ChunkedArray)):
        return values
    try:
        return pa.array(values, from_pandas=True)
    except (pa.ArrowException, ValueError, TypeError):
        return pa.array([word_of(value) for value in values], pa.string())

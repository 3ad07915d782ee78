"""Open Parquet files safely; check and hash the columns of a table, convert them to Arrow and back.

The sizes that a file claims are checked before anything is read.
"""

import hashlib
import io
from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from beltid.errors import ArtifactError, InputError
from beltid.store.disk import sha256
from beltid.tables.schemas import Column, Table
from beltid.tables.values import absent, floats, is_missing, outside

MAX_CELLS = 500_000_000
MAX_EXPANSION = 20_000  # cells per byte of file; constant columns compress well


def open_parquet(data: bytes, name: str, error_type: type[InputError]) -> Any:
    """Open the bytes of a Parquet file, if it can hold what it claims; `name` is for messages."""

    def opened(texts: list[str]) -> Any:
        return pq.ParquetFile(
            pa.BufferReader(data),
            page_checksum_verification=True,
            read_dictionary=texts,
            pre_buffer=False,  # a whole row group would stay in memory until the end
        )

    try:
        file = opened([])
        footer, names = file.metadata, file.schema_arrow.names
        cells = footer.num_rows * max(1, footer.num_columns)
        sizes = [footer.row_group(i).total_byte_size for i in range(footer.num_row_groups)]
        limit = min(MAX_CELLS, MAX_EXPANSION * len(data))
        if not (0 <= cells <= limit and all(0 <= claimed <= 8 * limit for claimed in sizes)):
            raise ValueError(f"it claims {cells:,} values in {len(data):,} bytes")
        texts = [
            field.name
            for field in file.schema_arrow
            if names.count(field.name) == 1 and field.type in (pa.string(), pa.large_string())
        ]
        return opened(texts) if texts else file
    except Exception as error:  # a damaged file can raise almost any error
        raise error_type(f"{name}: {damaged(error)}") from None


def damaged(error: BaseException) -> str:
    """Return the message that a file is damaged, with the shortened error of its library."""
    return "damaged: " + (" ".join(str(error).split())[:120] or type(error).__name__)


def normalised(columns: Mapping[str, Any], table: Table, name: str) -> dict[str, np.ndarray]:
    """Convert columns to the order and types of the schema, and check every value."""
    missing = {c.name for c in table.columns if c.required} - set(columns)
    if unfit := sorted(missing | set(columns) - set(table.names)):
        raise ValueError(f"a {table.kind} table: missing or unknown columns {unfit}")
    of_schema = [column for column in table.columns if column.name in columns]
    values = {column.name: _typed(columns[column.name], column) for column in of_schema}
    if problems := [line for c in of_schema for line in _problems(values[c.name], c, name)]:
        raise ArtifactError(problems)
    return values


def _typed(values: Any, column: Column) -> np.ndarray:
    if column.dtype == "string":
        return np.array(
            [c if type(c) is str else None if is_missing(c) else str(c) for c in values],
            dtype=object,
        )
    if column.dtype == "list":
        rows = [None if is_missing(row) else np.ravel(row) for row in values]
        length = column.length or max((len(row) for row in rows if row is not None), default=0)
        gone = np.full(length, np.nan)
        whole = [gone if row is None or np.isnan(row).any() else row for row in rows]
        return np.array(whole, dtype=float).reshape(len(rows), length)
    if column.dtype == "float64":
        numbers = floats(values)
        numbers[np.isnan(numbers)] = np.nan  # all kinds of nan alike
        return numbers
    return np.asarray(values).astype(column.dtype)


def _problems(cells: np.ndarray, column: Column, name: str) -> list[str]:
    if column.dtype == "bool":
        return []
    wrong = np.zeros(cells.shape, dtype=bool) if column.nullable else absent(cells)
    if column.dtype != "string":
        wrong |= np.isinf(cells) | outside(cells, column)
    rows = np.flatnonzero(wrong.any(axis=1) if wrong.ndim > 1 else wrong)
    return [
        f"{name}: {column.name} = {cells[i]} in row {i + 1}, must be {column.allowed}"
        for i in rows[:3]
    ]


def parquet_bytes(
    values: Mapping[str, Any], table: Table, metadata: Mapping[bytes, bytes]
) -> bytes:
    """Return the bytes of a Parquet file with normalised columns and metadata.

    nan becomes null; the fields carry unit and meaning.
    """
    arrays, fields = [], []
    for name, cells in values.items():
        column = table.column(name)
        kind = pa.list_(pa.float64()) if column.dtype == "list" else pa.type_for_alias(column.dtype)
        if column.dtype == "list":
            cells = [None if np.isnan(row).any() else row.tolist() for row in cells]
        arrays.append(pa.array(cells, kind, from_pandas=True))
        fields.append(
            pa.field(name, kind, metadata={"unit": column.unit, "meaning": column.meaning})
        )
    buffer = io.BytesIO()
    pq.write_table(
        pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata)),
        pa.PythonFile(buffer, mode="w"),
        version="2.6",
        compression="zstd",
        compression_level=3,
        use_dictionary=[name for name in values if table.column(name).dtype == "string"],
        write_page_checksum=True,
    )
    return buffer.getvalue()


def columns_of_arrow(arrow: pa.Table, table: Table) -> dict[str, np.ndarray]:
    """Convert an Arrow table that was read to columns with the types of the schema."""
    columns: dict[str, Any] = {}
    for column in table.columns:
        if column.required or column.name in arrow.column_names:
            cells = arrow.column(column.name)
            # Arrow's own ways to numpy import pandas
            if column.dtype in ("list", "string", "bool") or cells.null_count:
                found = cells.to_pylist()  # with None for null
                columns[column.name] = (
                    np.array(found, float) if column.dtype == "float64" else found
                )
            else:
                columns[column.name] = np.from_dlpack(cells.combine_chunks()).copy()
    return normalised(columns, table, "its table")


def seal(text: bytes, columns: Mapping[str, np.ndarray]) -> bytes:
    """Return the seal over a record and the names, types and values of the columns of its table."""
    digest = hashlib.sha256()
    for name, values in columns.items():
        digest.update(f"{name}\0{values.dtype.kind}{values.shape}\0".encode())
        if values.dtype.kind == "O":
            cells = [b"\0" if cell is None else b"\1" + str(cell).encode() for cell in values]
            digest.update(b"".join(len(cell).to_bytes(8, "little") + cell for cell in cells))
        else:
            digest.update(values.astype(values.dtype.newbyteorder("<")).tobytes())
    return sha256(text + digest.hexdigest().encode()).encode()

"""Open Parquet files safely; check and hash the columns of a table, convert them to Arrow and back.

The sizes that a file claims are checked before anything is read.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from beltid.errors import ArtifactError, InputError
from beltid.tables.schemas import Column, Table
from beltid.tables.values import floats, is_missing, outside

if TYPE_CHECKING:
    import pyarrow as pa


MAX_CELLS: Final = 500_000_000
MAX_EXPANSION: Final = 20_000
"""Largest number of cells per byte of file; constant columns compress well."""

BUFFER: Final = 1 << 20
"""Read buffer of a column [bytes]."""
LARGEST: Final = 1e100
"""Largest magnitude of a number in an artifact, so that its square and cube do not overflow."""


def open_parquet(source: bytes | Path, name: str, error_type: type[InputError]) -> Any:
    """Open a Parquet file and check the sizes that it claims.

    Texts are read as dictionaries, so that a long text in every row takes the memory of one.

    Parameters
    ----------
    source : bytes or Path
        The bytes of the file, or its path; by path, it is read in blocks and may have any size.
    name : str
        Name of the file in messages.
    error_type : type
        Error to raise.

    Raises
    ------
    InputError
        Of type `error_type`, if it is damaged or claims more than it can contain.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    def opened(texts: list[str], footer: Any = None) -> Any:
        data = pa.BufferReader(source) if isinstance(source, bytes) else source
        return pq.ParquetFile(
            data,
            metadata=footer,
            page_checksum_verification=True,
            read_dictionary=texts,
            memory_map=False,
            # read-ahead data, with its whole row group, would stay in memory until the end
            pre_buffer=False,
            buffer_size=BUFFER,
        )

    try:
        file = opened([])
        footer, schema = file.metadata, file.schema_arrow
        if isinstance(source, bytes):
            _refuse_claims(footer, len(source), name, error_type)
        texts = [
            field.name
            for field in schema
            if schema.names.count(field.name) == 1
            and (pa.types.is_string(field.type) or pa.types.is_large_string(field.type))
        ]
        return opened(texts, footer) if texts else file
    except InputError:
        raise
    except Exception as error:  # a damaged file can raise almost any error
        raise error_type(f"{name}: {damaged(error)}") from None


def _refuse_claims(footer: Any, size: int, name: str, error_type: type[InputError]) -> None:
    cells = footer.num_rows * max(1, footer.num_columns)
    sizes = [footer.row_group(i).total_byte_size for i in range(footer.num_row_groups)]
    limit = min(MAX_CELLS, MAX_EXPANSION * size)
    if not (0 <= cells <= limit and all(0 <= claimed <= 8 * limit for claimed in sizes)):
        text = f"{name}: damaged: it claims {cells:,} values in {size:,} bytes"
        raise error_type(text)


def damaged(error: BaseException) -> str:
    """Return the message that a file is damaged, with the shortened error of its library."""
    return "damaged: " + (" ".join(str(error).split())[:120] or type(error).__name__)


def normalised(columns: Mapping[str, Any], table: Table, name: str) -> dict[str, np.ndarray]:
    """Convert columns to the order and types of the schema, and check every value."""
    unknown = [column for column in columns if column not in table.names]
    missing = [c.name for c in table.columns if c.required and c.name not in columns]
    if unknown or missing:
        raise ValueError(f"a {table.kind} table: unknown columns {unknown}, missing {missing}")
    values = {
        column.name: _typed(columns[column.name], column)
        for column in table.columns
        if column.name in columns
    }
    lengths = {column: len(cells) for column, cells in values.items()}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"a {table.kind} table: columns of different length {lengths}")
    problems = [
        problem
        for column, cells in values.items()
        for problem in _problems(cells, table.column(column), name)
    ]
    if problems:
        raise ArtifactError(problems)
    return values


def _typed(values: Any, column: Column) -> np.ndarray:
    if column.dtype == "string":
        cells = [None if is_missing(cell) else str(cell) for cell in np.asarray(values, object)]
        array = np.empty(len(cells), dtype=object)
        array[:] = cells
        return array
    if column.dtype == "list":
        return _matrix([None if is_missing(row) else np.ravel(row) for row in values], column)
    if column.dtype == "float64":
        return floats(values)
    array = np.asarray(values)
    wanted = np.bool_ if column.dtype == "bool" else np.int64
    if array.size == 0:
        return array.astype(wanted)
    if column.dtype == "bool" and array.dtype.kind not in "b":
        raise ValueError(f"{column.name} must hold true or false, it holds {array.dtype}")
    if array.dtype.kind not in "iub" and not np.all(array == np.floor(array.astype(float))):
        raise ValueError(f"{column.name} must hold whole numbers")
    return array.astype(wanted)


def _matrix(rows: list[Any], column: Column) -> np.ndarray:
    """Convert lists to the rows of a matrix, with nan for a missing list."""
    lengths = {len(row) for row in rows if row is not None}
    length = column.length or max(lengths, default=0)
    if lengths - {length}:
        raise ValueError(f"{column.name}: lists of {sorted(lengths)} numbers, must be {length}")
    matrix = np.full((len(rows), length), np.nan)
    for i, row in enumerate(rows):
        if row is not None:
            matrix[i] = row
    matrix[np.isnan(matrix).any(axis=1)] = np.nan  # an incomplete list counts as missing
    return matrix


def _problems(cells: np.ndarray, column: Column, name: str) -> list[str]:
    if column.dtype == "string":
        bad = [i for i, cell in enumerate(cells) if cell is None and not column.nullable]
        return [f"{name}: {column.name} is missing in row {i + 1}" for i in bad[:3]]
    if column.dtype == "bool":
        return []
    numbers = cells.astype(float)
    huge = np.abs(numbers) > LARGEST
    wrong = huge | outside(numbers, column)
    if not column.nullable:
        wrong |= np.isnan(numbers)
    rows = np.flatnonzero(wrong.any(axis=1) if wrong.ndim > 1 else wrong)
    return [
        f"{name}: {column.name} = {cells[i]} in row {i + 1}, must be {column.allowed}"
        + (f" and at most {LARGEST:g} in size" if np.any(huge[i]) else "")
        for i in rows[:3]
    ]


def arrow_table(values: Mapping[str, np.ndarray], table: Table) -> pa.Table:
    """Create an Arrow table of normalised columns; nan becomes null, fields carry their units."""
    import pyarrow as pa

    arrays, fields = [], []
    for name, cells in values.items():
        column = table.column(name)
        arrow_type = _arrow_type(column)
        if column.dtype == "list":
            missing = np.isnan(cells).any(axis=1)
            array = pa.array(
                [None if gone else row.tolist() for gone, row in zip(missing, cells, strict=True)],
                type=arrow_type,
            )
        else:
            array = pa.array(cells, type=arrow_type, from_pandas=True)
        arrays.append(array)
        field_metadata = {"unit": column.unit, "meaning": column.meaning}
        fields.append(pa.field(name, arrow_type, nullable=True, metadata=field_metadata))
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields))


def columns_of_arrow(arrow: pa.Table, table: Table, name: str) -> dict[str, np.ndarray]:
    """Convert an Arrow table that was read to columns with the types of the schema."""
    columns: dict[str, np.ndarray] = {}
    for column in table.columns:
        if column.name not in arrow.column_names:
            if column.required:
                text = f"{name}: damaged: column {column.name} is missing"
                raise ArtifactError(text)
            continue
        chunked = arrow.column(column.name)
        if column.dtype == "string":  # store each text once: a file may repeat a long one
            chunked = chunked.dictionary_encode()
        arrow_type = chunked.type.value_type if column.dtype == "string" else chunked.type
        if arrow_type != _arrow_type(column):
            raise ArtifactError(
                f"{name}: damaged: column {column.name} holds {arrow_type}, "
                f"must hold {_arrow_type(column)}",
            )
        columns[column.name] = _from_arrow(chunked, column)
    problems = [
        f"{problem} (damaged)"
        for column_name, cells in columns.items()
        for problem in _problems(cells, table.column(column_name), name)
    ]
    if problems:
        raise ArtifactError(problems)
    return columns


def _arrow_type(column: Column) -> pa.DataType:
    import pyarrow as pa

    return {
        "string": pa.string(),
        "float64": pa.float64(),
        "int64": pa.int64(),
        "bool": pa.bool_(),
        "list": pa.list_(pa.float64()),
    }[column.dtype]


def _from_arrow(chunked: pa.ChunkedArray, column: Column) -> np.ndarray:
    if column.dtype == "list":
        return _matrix(chunked.to_pylist(), column)
    if column.dtype == "string":
        encoded = chunked.unify_dictionaries().combine_chunks()
        words = np.array([*encoded.dictionary.to_pylist(), None], dtype=object)
        return np.asarray(words[_flat(encoded.indices, np.int32, -1)])
    array = chunked.combine_chunks()
    if column.dtype == "bool":  # Arrow packs eight into a byte
        return _flat(array.cast("uint8"), np.uint8).astype(bool)
    return _flat(array, column.dtype, np.nan)


def _flat(array: pa.Array, dtype: Any, missing: float = 0.0) -> np.ndarray:
    """Copy the numbers of an Arrow array; its own ways to do so import pandas."""
    valid, data = array.buffers()
    if not len(array):
        return np.empty(0, dtype)
    start = array.offset
    values = np.frombuffer(data, dtype, len(array), start * np.dtype(dtype).itemsize).copy()
    if array.null_count:
        bits = np.unpackbits(np.frombuffer(valid, np.uint8), bitorder="little")
        values[bits[start : start + len(array)] == 0] = missing
    return values


def columns_sha256(columns: Mapping[str, np.ndarray]) -> str:
    """Compute the SHA-256 of the names, types and values of the columns of a table, in order.

    All kinds of nan hash alike; numbers hash by their bits in little-endian order, so the hash is
    the same on every machine.
    """
    digest = hashlib.sha256()
    for name, values in columns.items():
        digest.update(f"{name}\0{values.dtype.kind}{values.shape}\0".encode())
        digest.update(_bytes_of(values))
    return digest.hexdigest()


def _bytes_of(values: np.ndarray[Any, Any]) -> bytes:
    if values.dtype.kind == "O":
        cells = [b"\0" if cell is None else b"\1" + str(cell).encode() for cell in values]
        return b"".join(len(cell).to_bytes(8, "little") + cell for cell in cells)
    if values.dtype.kind == "f":
        clean = np.where(np.isnan(values), np.nan, values)
        return clean.astype("<f8").tobytes()
    if values.dtype.kind == "b":
        return values.astype("u1").tobytes()
    return values.astype("<i8").tobytes()

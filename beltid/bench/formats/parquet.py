"""Read Parquet files and Arrow tables in blocks of rows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from beltid.artifacts.parquet_table import damaged, open_parquet
from beltid.bench.files.sources import Source
from beltid.bench.formats.csv_table import Wanted
from beltid.bench.formats.rows import Rows, Texts, numbers_of
from beltid.errors import InputError, Problems
from beltid.tables.schemas import RUN_TEXTS, Table

if TYPE_CHECKING:
    import pyarrow as pa

ROWS: Final = 1 << 18
"""Number of rows in a block."""
LONGEST_LABEL: Final = 1000
LABELS: Final = 1 << 14
"""Rows read at a time to check the length of labels."""
FIRST_ROWS: Final = 200
"""Rows used to detect what the texts of a column are."""


@dataclass(frozen=True, slots=True)
class ParquetTable:
    """An open Parquet file or an Arrow table.

    Attributes
    ----------
    name : str
        Name for messages.
    inside : PurePath
        Path within its folder.
    content : pyarrow.parquet.ParquetFile or pyarrow.Table
        The columns.
    schema : pyarrow.Schema
        Names and types of the columns.
    """

    name: str
    inside: PurePath
    content: Any
    schema: pa.Schema

    @classmethod
    def of(cls, source: Source) -> ParquetTable:
        """Open a file; see `open_parquet`."""
        file = open_parquet(source.data or source.path, source.name, InputError)
        return cls(source.name, source.inside, file, file.schema_arrow)

    def batches(self, columns: Sequence[str], rows: int) -> Iterable[pa.RecordBatch]:
        """Return some columns in blocks of at most `rows` rows."""
        if hasattr(self.content, "iter_batches"):
            return self.content.iter_batches(batch_size=rows, columns=columns)
        return self.content.select(list(dict.fromkeys(columns))).to_batches(max_chunksize=rows)


def parquet_blocks(
    part: ParquetTable, wanted: Mapping[str, Wanted], table: Table, first_row: int = 1
) -> Iterator[Rows]:
    """Yield the rows of a Parquet file in blocks.

    Parameters
    ----------
    part : ParquetTable
        The file.
    wanted : mapping of str to Wanted
        Our columns -> columns of the file.
    table : Table
        Schema of the recording; its numeric columns that are not wanted are filled with nan.
    first_row : int
        Number of the first row, for messages.

    Raises
    ------
    InputError
        If the file is damaged, or a column has a wrong type.
    """
    _refuse_columns(part, wanted)
    read = [name for w in wanted.values() for name in (w.index, w.date) if name is not None]
    texts = [w.index for w in wanted.values() if w.is_text or w.clock]
    texts += [w.date for w in wanted.values() if w.date is not None]
    _refuse_long_texts(part, texts)
    for batch in batches_of(part, read):
        try:
            rows = _rows(batch, part, wanted, table, first_row)
        except Exception as error:  # a number beyond float64
            raise InputError(f"{part.name}: {damaged(error)}") from None
        yield rows
        first_row += batch.num_rows


def batches_of(
    part: ParquetTable, columns: Sequence[str], rows: int | None = None
) -> Iterator[pa.RecordBatch]:
    """Yield columns of a Parquet file in validated blocks.

    Raises
    ------
    InputError
        If the file is damaged.
    """
    try:
        for batch in part.batches(columns, rows or ROWS):
            batch.validate(full=True)
            yield batch
    except Exception as error:  # a damaged file can raise nearly anything
        raise InputError(f"{part.name}: {damaged(error)}") from None


def first_texts(part: ParquetTable, names: Sequence[str]) -> dict[str, list[str]]:
    """Return the first values of the columns without numbers, as texts."""
    import pyarrow as pa

    schema = part.schema
    names = [
        name
        for name in dict.fromkeys(names)
        if schema.names.count(name) == 1 and not holds_numbers(schema.field(name))
    ]
    _refuse_long_texts(part, names)
    for batch in batches_of(part, names, FIRST_ROWS) if names else ():
        try:
            texts = [column.cast(pa.string()).to_pylist() for column in batch.columns]
        except pa.ArrowException:  # nested values
            return {}
        columns = zip(batch.schema.names, texts, strict=True)
        return {name: [text for text in column if text] for name, column in columns}
    return {}


def holds_numbers(field: pa.Field) -> bool:
    """Whether a column holds numbers, durations, or a dictionary of numbers."""
    import pyarrow as pa

    is_a, kind = pa.types, field.type
    inner = kind.value_type if is_a.is_dictionary(kind) else kind
    return bool(
        is_a.is_integer(inner)
        or is_a.is_floating(inner)
        or is_a.is_decimal(inner)
        or is_a.is_null(inner)
        or is_a.is_duration(kind)
    )


def _refuse_columns(part: ParquetTable, wanted: Mapping[str, Wanted]) -> None:
    """Refuse columns that occur twice, are nested, or have the wrong type."""
    import pyarrow as pa

    schema, name = part.schema, part.name
    problems = []
    for role, w in wanted.items():
        count = schema.names.count(w.index)
        if count > 1:
            problems.append(f"{name}: column {w.index} occurs {count} times, must be once")
        if count != 1 or w.clock is not None:
            continue
        field = schema.field(w.index)
        kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
        is_text = pa.types.is_string(kind) or pa.types.is_large_string(kind)
        is_text = is_text or (role == "idle" and pa.types.is_boolean(kind))
        may_be_duration = role == "time_s" or not pa.types.is_duration(kind)
        is_label = is_text or pa.types.is_boolean(kind)
        if not (holds_numbers(field) and may_be_duration) and not (is_label and w.is_text):
            allowed = "texts, whole numbers or booleans" if w.is_text else "numbers"
            held = "texts" if is_text else kind
            problems.append(f"{name}: column {w.index} holds {held}, must hold {allowed}")
    if problems:
        raise InputError(problems)


def _refuse_long_texts(part: ParquetTable, names: Sequence[str]) -> None:
    """Refuse texts so long that a block full of them would fill the memory."""
    import pyarrow as pa
    import pyarrow.compute as pc

    for name in names:
        kind = part.schema.field(name).type
        kind = kind.value_type if pa.types.is_dictionary(kind) else kind
        if not (pa.types.is_string(kind) or pa.types.is_large_string(kind)):
            continue
        for batch in batches_of(part, [name], LABELS):
            texts = batch.column(0)
            labels = texts.dictionary if pa.types.is_dictionary(texts.type) else texts
            longest = pc.max(pc.binary_length(labels)).as_py() or 0
            if longest > LONGEST_LABEL:
                raise InputError(
                    f"{part.name}: labels of {longest} bytes, must be at most {LONGEST_LABEL}"
                )


def _rows(
    batch: pa.RecordBatch,
    part: ParquetTable,
    wanted: Mapping[str, Wanted],
    table: Table,
    row: int,
) -> Rows:
    numbers: dict[str, np.ndarray] = {}
    texts: dict[str, Texts] = {}
    problems = Problems()
    for role, w in wanted.items():
        values = batch.column(w.index)
        if w.is_text:
            texts[role] = Texts.of_arrow(values)
        elif w.clock is not None:
            dates = None if w.date is None else batch.column(w.date)
            numbers[role], wrong = w.clock.read(values, dates)
            w.clock.report_wrong(
                wrong, values, lambda i: (f"{part.name}, row {row + i}", row + i), problems
            )
        else:
            numbers[role] = numbers_of(values)
    for column in table.columns:
        if column.dtype == "float64" and column.name not in {*wanted, *RUN_TEXTS}:
            numbers[column.name] = np.full(batch.num_rows, np.nan)
    return Rows(numbers, texts, row, problems)

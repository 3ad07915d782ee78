"""Parquet files: their columns by name and by the names of their folders, in blocks of rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from beltid.artifacts.parquet_table import damaged, open_parquet
from beltid.bench.files.sources import Source
from beltid.bench.formats.csv_table import Wanted
from beltid.bench.formats.numbers import NUMBER
from beltid.bench.formats.rows import Rows, Texts, numbers_of
from beltid.errors import InputError, Problems
from beltid.tables.schemas import SAID_OF_RUNS, Table

if TYPE_CHECKING:
    import pyarrow as pa

ROWS: Final = 1 << 18
"""Rows of a block."""
LONGEST_LABEL: Final = 1000
LABELS: Final = 1 << 14
"""Rows whose labels are read at a time to see how long they are."""
FIRST_ROWS: Final = 200
"""Rows that show what the texts of a column are."""


def open_source(source: Source, texts: Sequence[str]) -> Any:
    """A Parquet file, its claims checked where its bytes are in memory; see `open_parquet`."""
    return open_parquet(source.data or source.path, texts, source.name, InputError)


def columns_of_folders(source: Source) -> dict[str, str]:
    """Columns that the names of the folders of a file hold, and their value."""
    parts = (part.partition("=") for part in source.inside.parts[:-1])
    return {key: value for key, mark, value in parts if mark}


def parquet_blocks(
    source: Source, wanted: Mapping[str, Wanted], table: Table, first_row: int = 1
) -> Iterator[Rows]:
    """Blocks of rows of a Parquet file.

    Parameters
    ----------
    source : Source
        The file. Names of folders such as ``arc_deg=82`` hold a column of all the files in them.
    wanted : mapping of str to Wanted
        Our columns -> where they stand in the file or the names of its folders.
    table : Table
        Schema of the recording; its columns of numbers that are not wanted hold nothing.
    first_row : int
        Number of the first row, for messages.

    Raises
    ------
    InputError
        If the file is damaged, or a column is of another type.
    """
    folders = columns_of_folders(source)
    _refuse_columns(source, wanted, folders)
    texts = [w.index for w in wanted.values() if w.is_text or w.clock]
    texts += [w.date for w in wanted.values() if w.date is not None]
    file = open_source(source, texts)
    in_file = set(file.schema_arrow.names)
    read = [name for w in wanted.values() for name in (w.index, w.date) if name in in_file]
    for text in texts:
        _refuse_long_labels(file, text if text in in_file else None, source.name)
    for batch in batches_of(file, read, source.name):
        try:
            rows = _rows(batch, wanted, folders, table, first_row, source.name)
        except Exception as error:  # a number that no float64 holds
            raise InputError(f"{source.name}: {damaged(error)}", code="damaged") from None
        yield rows
        first_row += batch.num_rows


def batches_of(
    file: Any, columns: Sequence[str], name: str, rows: int | None = None
) -> Iterator[pa.RecordBatch]:
    """Columns of an opened Parquet file in blocks, each of them sound.

    Raises
    ------
    InputError
        If the file is damaged.
    """
    try:
        for batch in file.iter_batches(batch_size=rows or ROWS, columns=columns):
            batch.validate(full=True)
            yield batch
    except Exception as error:  # a damaged file can raise nearly anything
        raise InputError(f"{name}: {damaged(error)}", code="damaged") from None


def first_texts(source: Source, names: Sequence[str]) -> dict[str, list[str]]:
    """The first values of columns that hold no numbers, as texts."""
    import pyarrow as pa

    there = open_source(source, ()).schema_arrow
    names = [
        name
        for name in dict.fromkeys(names)
        if there.names.count(name) == 1 and not holds_numbers(there.field(name))
    ]
    if not names:
        return {}
    file = open_source(source, names)
    for name in names:
        _refuse_long_labels(file, name, source.name)
    for batch in batches_of(file, names, source.name, FIRST_ROWS):
        try:
            texts = [column.cast(pa.string()).to_pylist() for column in batch.columns]
        except pa.ArrowException:  # nested values
            return {}
        found = zip(batch.schema.names, texts, strict=True)
        return {name: [text for text in column if text] for name, column in found}
    return {}


def holds_numbers(field: pa.Field) -> bool:
    """Whether a column is of plain numbers or durations, or a dictionary of numbers."""
    import pyarrow as pa

    of, kind = pa.types, field.type
    inner = kind.value_type if of.is_dictionary(kind) else kind
    return bool(
        of.is_integer(inner)
        or of.is_floating(inner)
        or of.is_decimal(inner)
        or of.is_null(inner)
        or of.is_duration(kind)
    )


def _refuse_columns(
    source: Source, wanted: Mapping[str, Wanted], folders: Mapping[str, str]
) -> None:
    """Refuse columns that are given twice, nested, or of types that are not those of ours."""
    import pyarrow as pa

    there, name = open_source(source, ()).schema_arrow, source.name
    problems = []
    for role, w in wanted.items():
        count = there.names.count(w.index)
        if w.index in folders:
            value = folders[w.index]
            if count:
                problems.append(
                    f"{name}: column {w.index} is there, and its folder is called "
                    f"{w.index}={value}: one of them may hold it"
                )
            if not w.is_text and not NUMBER.fullmatch(value):
                problems.append(f"{name}: its folder is called {w.index}={value}, must be a number")
            continue
        if count > 1:
            problems.append(f"{name}: column {w.index} is there {count} times")
        if count != 1 or w.clock is not None:
            continue
        field = there.field(w.index)
        kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
        text = pa.types.is_string(kind) or pa.types.is_large_string(kind)
        text = text or (role == "idle" and pa.types.is_boolean(kind))
        is_time = role == "time_s" or not pa.types.is_duration(kind)
        if not (holds_numbers(field) and is_time) and not (text and w.is_text):
            allowed = "texts or whole numbers" if w.is_text else "numbers"
            problems.append(f"{name}: column {w.index} holds {field.type}, must hold {allowed}")
    if problems:
        raise InputError(problems)


def _refuse_long_labels(file: Any, label: str | None, name: str) -> None:
    """Refuse labels that would fill the memory if every row of a block had one."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if label is None:
        return
    try:
        for batch in file.iter_batches(batch_size=LABELS, columns=[label]):
            labels = batch.column(0)
            words = labels.dictionary if pa.types.is_dictionary(labels.type) else labels
            if not (pa.types.is_string(words.type) or pa.types.is_large_string(words.type)):
                return
            longest = pc.max(pc.binary_length(words)).as_py() or 0
            if longest > LONGEST_LABEL:
                raise InputError(
                    f"{name}: labels of {longest} bytes, must be at most {LONGEST_LABEL}"
                )
    except InputError:
        raise
    except Exception as error:  # a damaged file can raise nearly anything
        raise InputError(f"{name}: {damaged(error)}", code="damaged") from None


def _rows(
    batch: pa.RecordBatch,
    wanted: Mapping[str, Wanted],
    folders: Mapping[str, str],
    table: Table,
    row: int,
    name: str,
) -> Rows:
    numbers: dict[str, np.ndarray] = {}
    texts: dict[str, Texts] = {}
    problems = Problems()
    for role, w in wanted.items():
        if w.index in folders:
            told = folders[w.index]
            if w.is_text:
                texts[role] = Texts.of([told] * batch.num_rows)
            else:
                numbers[role] = np.full(batch.num_rows, float(told))
            continue
        values = batch.column(w.index)
        if w.is_text:
            texts[role] = Texts.of_arrow(values)
        elif w.clock is not None:
            dates = None if w.date is None else batch.column(w.date)
            numbers[role], wrong = w.clock.read(values, dates)
            w.clock.report_wrong(wrong, values, lambda i: (f"{name}, row {row + i}", i), problems)
        else:
            numbers[role] = numbers_of(values)
    for column in table.columns:
        if column.dtype == "float64" and column.name not in {*wanted, *SAID_OF_RUNS}:
            numbers[column.name] = np.full(batch.num_rows, np.nan)
    return Rows(numbers, texts, row, problems)

"""A Parquet recording in blocks: one file, or a folder of files in the order of their names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from beltid.artifacts.parquet_open import damaged, is_number, open_parquet, refused_columns
from beltid.bench.files.folders import parquet_files
from beltid.bench.formats.csv_reader import NUMBER
from beltid.bench.formats.csv_stream import Block
from beltid.errors import InputError
from beltid.tables.schemas import Column, Table

if TYPE_CHECKING:
    import pyarrow as pa

ROWS: Final = 1 << 18
"""Rows of a block."""
LONGEST_LABEL: Final = 1000
LABELS: Final = 1 << 14
"""Rows whose labels are read at a time to see how long they are."""


def parquet_blocks(path: Path, table: Table, names: Mapping[str, str]) -> Iterator[Block]:
    """Blocks of a Parquet recording.

    Parameters
    ----------
    path : Path
        A file or a folder. Names of folders such as ``arc_deg=82`` hold a column of all the files
        in them.
    table : Table
        Schema of the recording.
    names : mapping
        Our column -> its name in the file, where it differs.

    Raises
    ------
    InputError
        If a file is damaged, or a column is missing or of another type.
    """
    files = parquet_files(path) if path.is_dir() else [path]
    row = 1
    for file in files:
        from_folders = _from_folders(file.relative_to(path)) if path.is_dir() else {}
        for batch in _batches(file, table, names, from_folders):
            try:
                batch.validate(full=True)
                block = _block(batch, table, names, from_folders, row)
            except Exception as error:  # a text that is no UTF-8, a number that no float64 holds
                raise InputError(f"{file}: {damaged(error)}") from None
            yield block
            row += batch.num_rows


def _from_folders(file: Path) -> dict[str, str]:
    parts = (part.partition("=") for part in file.parts[:-1])
    return {key: value for key, mark, value in parts if mark}


def _batches(
    file: Path, table: Table, names: Mapping[str, str], from_folders: Mapping[str, str]
) -> Iterator[pa.RecordBatch]:
    import pyarrow as pa

    label = names.get(table.label, table.label)
    source = open_parquet(file, [label], str(file), InputError)
    there = source.schema_arrow
    ours = [names.get(column.name, column.name) for column in table.columns]
    problems, wanted = refused_columns(there, ours, label, str(file)), []
    if problems:
        raise InputError(problems)
    for column in table.columns:
        theirs = names.get(column.name, column.name)
        if theirs in from_folders:
            problems += _wrong_folder(file, column, theirs, from_folders[theirs], there)
            continue
        if theirs not in there.names:
            if column.required:
                problems.append(f"{file}: column {theirs} is missing")
            continue
        kind = there.field(theirs).type
        fits = _is_text(kind) or pa.types.is_integer(kind)
        fits |= pa.types.is_null(kind)
        if not (fits if column.dtype == "string" else is_number(kind)):
            problems.append(f"{file}: column {theirs} holds {kind}, must hold {column.dtype}")
        wanted.append(theirs)
    if problems:
        raise InputError(problems)
    try:
        if label in wanted:
            for labels in source.iter_batches(batch_size=LABELS, columns=[label]):
                _refuse_long(labels.column(0), file)
        yield from source.iter_batches(batch_size=ROWS, columns=wanted)
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{file}: {damaged(error)}") from None


def _refuse_long(labels: pa.Array, file: Path) -> None:
    """Refuse labels that would fill the memory if every row of a block had one."""
    import pyarrow as pa
    import pyarrow.compute as pc

    words = labels.dictionary if pa.types.is_dictionary(labels.type) else labels
    if not _is_text(words.type):
        return
    longest = pc.max(pc.binary_length(words)).as_py() or 0
    if longest > LONGEST_LABEL:
        raise InputError(f"{file}: labels of {longest} bytes, must be at most {LONGEST_LABEL}")


def _is_text(kind: Any) -> bool:
    import pyarrow as pa

    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind))


def _block(
    batch: pa.RecordBatch,
    table: Table,
    names: Mapping[str, str],
    from_folders: Mapping[str, str],
    row: int,
) -> Block:
    numbers: dict[str, np.ndarray] = {}
    labels: list[tuple[int, str | None]] = []
    for column in table.columns:
        theirs = names.get(column.name, column.name)
        if theirs in from_folders:
            if column.dtype == "string":
                labels = [(0, from_folders[theirs])]
            else:
                numbers[column.name] = np.full(batch.num_rows, float(from_folders[theirs]))
        elif theirs in batch.schema.names:
            values = batch.column(theirs)
            if column.dtype == "string":
                labels = _labels(values)
            else:
                numbers[column.name] = _floats(values)
    return Block(numbers, labels, row)


def _wrong_folder(
    file: Path, column: Column, theirs: str, value: str, there: pa.Schema
) -> list[str]:
    """What is wrong with a column that the name of a folder holds."""
    problems = []
    if theirs in there.names:
        problems.append(
            f"{file}: column {theirs} is there, and its folder is called {theirs}={value}: "
            "one of them may hold it"
        )
    if column.dtype != "string" and not NUMBER.fullmatch(value):
        problems.append(f"{file}: its folder is called {theirs}={value}, must be a number")
    return problems


def _floats(values: pa.Array) -> np.ndarray:
    import pyarrow as pa

    if not pa.types.is_float64(values.type):
        values = values.cast(pa.float64(), safe=False)  # the nearest float64, as everywhere
    return values.to_numpy(zero_copy_only=False)  # nulls become nan


def _labels(values: pa.Array) -> list[tuple[int, str | None]]:
    """Rows at which the label changes, and the label."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if not _is_text(values.type):
        values = values.cast(pa.string())
    if not pa.types.is_dictionary(values.type):
        values = values.dictionary_encode()
    words = [str(word).strip() or None for word in values.dictionary.to_pylist()]
    codes = pc.fill_null(values.indices, -1).to_numpy(zero_copy_only=False)
    if not codes.size:
        return []
    starts = np.append(0, np.flatnonzero(np.diff(codes)) + 1)
    return [(int(i), words[codes[i]] if codes[i] >= 0 else None) for i in starts]

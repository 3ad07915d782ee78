"""Parquet recordings in blocks of rows: one file, or several in the order of their names."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from beltid.artifacts.parquet_table import damaged, is_number, open_parquet, refused_columns
from beltid.bench.files.sources import Source
from beltid.bench.formats.clock import Clock, holds_clock, holds_dates
from beltid.bench.formats.frames import missing_column
from beltid.bench.formats.numbers import NUMBER
from beltid.bench.formats.rows import Rows, Texts, numbers_of
from beltid.bench.read_options import ReadOptions
from beltid.errors import InputError, Problems
from beltid.tables.schemas import SAID_OF_RUNS, Column, Table

if TYPE_CHECKING:
    import pyarrow as pa

ROWS: Final = 1 << 18
"""Rows of a block."""
LONGEST_LABEL: Final = 1000
LABELS: Final = 1 << 14
"""Rows whose labels are read at a time to see how long they are."""


def parquet_clock(
    source: Source, options: ReadOptions, means_date: Callable[[str], bool]
) -> Clock | None:
    """Reader of the time of a file, where it is that of a clock; one column of dates may help."""
    there = open_source(source, ()).schema_arrow
    theirs = options.names.get("time_s", "time_s")
    if there.names.count(theirs) != 1 or not holds_clock(there.field(theirs).type):
        return None
    dates = [f.name for f in there if means_date(f.name) and holds_dates(f.type)]
    return Clock(theirs, options.dialect.time_zone, dates[0] if len(dates) == 1 else "")


def parquet_blocks(
    sources: Iterable[Source],
    table: Table,
    names: Mapping[str, str],
    clock: Clock | None = None,
    stated: Mapping[str, str] | None = None,
) -> Iterator[Rows]:
    """Blocks of rows of a Parquet recording, with all columns of its table.

    Parameters
    ----------
    sources : iterable of Source
        The files. Names of folders such as ``arc_deg=82`` hold a column of all the files in them.
    table : Table
        Schema of the recording.
    names : mapping
        Our column -> its name in the file, where it differs.
    clock : Clock, optional
        Reader of the time, where it is that of a clock.
    stated : mapping, optional
        Settings that the config states for every run, by our columns. With them a file without
        a column of labels is one run, called like the file.

    Raises
    ------
    InputError
        If a file is damaged, or a column is missing or of another type.
    """
    row = 1
    for source in sources:
        from_folders = columns_of_folders(source)
        if stated:
            there = open_source(source, ()).schema_arrow.names
            told = {table.label: source.inside.stem, **stated}
            by_name = {names.get(role, role): value for role, value in told.items()}
            without = {name: value for name, value in by_name.items() if name not in there}
            from_folders = {**without, **from_folders}
        texts = [names.get(table.label, table.label)]
        texts += [clock.name, *filter(None, [clock.date])] if clock else []
        file = open_source(source, texts)
        wanted = _wanted(file.schema_arrow, source.name, table, names, from_folders, clock)
        read = [*wanted.values(), *([clock.date] if clock and clock.date else [])]
        for text in texts:
            _refuse_long_labels(file, text if text in read else None, source.name)
        for batch in batches_of(file, read, source.name):
            try:
                rows = _rows(batch, table, wanted, from_folders, names, row, clock, source.name)
            except Exception as error:  # a number that no float64 holds
                raise InputError(f"{source.name}: {damaged(error)}", code="damaged") from None
            yield rows
            row += batch.num_rows


def open_source(source: Source, texts: Sequence[str]) -> Any:
    """A Parquet file, its claims checked where its bytes are in memory; see `open_parquet`."""
    return open_parquet(source.data or source.path, texts, source.name, InputError)


def batches_of(file: Any, columns: Sequence[str], name: str) -> Iterator[pa.RecordBatch]:
    """Columns of an opened Parquet file in blocks, each of them sound.

    Raises
    ------
    InputError
        If the file is damaged.
    """
    try:
        for batch in file.iter_batches(batch_size=ROWS, columns=columns):
            batch.validate(full=True)
            yield batch
    except Exception as error:  # a damaged file can raise nearly anything
        raise InputError(f"{name}: {damaged(error)}", code="damaged") from None


def columns_of_folders(source: Source) -> dict[str, str]:
    """Columns that the names of the folders of a file hold, and their value."""
    parts = (part.partition("=") for part in source.inside.parts[:-1])
    return {key: value for key, mark, value in parts if mark}


def holds_numbers(kind: pa.DataType) -> bool:
    """Whether a type is that of plain numbers or durations, or of a dictionary of numbers."""
    import pyarrow as pa

    inner = kind.value_type if pa.types.is_dictionary(kind) else kind
    return is_number(inner) or pa.types.is_duration(kind)


def _wanted(
    there: pa.Schema,
    name: str,
    table: Table,
    names: Mapping[str, str],
    from_folders: Mapping[str, str],
    clock: Clock | None,
) -> dict[str, str]:
    """Our columns that the file holds -> their names in it."""
    in_file = {column.name: names.get(column.name, column.name) for column in table.columns}
    is_read = clock is not None or _holds_durations(there, in_file.get("time_s", ""))
    checked = [theirs for ours, theirs in in_file.items() if not is_read or ours != "time_s"]
    problems = refused_columns(there, checked, in_file[table.label], name)
    if clock is not None and not (
        clock.name in there.names and holds_clock(there.field(clock.name).type)
    ):
        problems.append(f"{name}: column {clock.name} holds no clock times, as the first file does")
    if clock is not None and clock.date and there.names.count(clock.date) != 1:
        problems.append(f"{name}: column {clock.date} of dates is missing, the first file has it")
    wanted = {}
    for column in table.columns:
        theirs = in_file[column.name]
        if theirs in from_folders:
            problems += _wrong_folder(name, column, theirs, from_folders[theirs], there)
        elif theirs in there.names:
            wanted[column.name] = theirs
        elif column.required:
            problems.append(missing_column(theirs, [*there.names, *from_folders], name))
    if problems:
        raise InputError(problems)
    return wanted


def _holds_durations(there: pa.Schema, name: str) -> bool:
    import pyarrow as pa

    return there.names.count(name) == 1 and pa.types.is_duration(there.field(name).type)


def _wrong_folder(
    name: str, column: Column, theirs: str, value: str, there: pa.Schema
) -> list[str]:
    """What is wrong with a column that the name of a folder holds."""
    problems = []
    if theirs in there.names:
        problems.append(
            f"{name}: column {theirs} is there, and its folder is called {theirs}={value}: "
            "one of them may hold it"
        )
    if column.dtype != "string" and not NUMBER.fullmatch(value):
        problems.append(f"{name}: its folder is called {theirs}={value}, must be a number")
    return problems


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
    table: Table,
    wanted: Mapping[str, str],
    from_folders: Mapping[str, str],
    names: Mapping[str, str],
    row: int,
    clock: Clock | None,
    name: str,
) -> Rows:
    numbers: dict[str, np.ndarray] = {}
    texts: dict[str, Texts] = {}
    problems = Problems()
    for column in table.columns:
        told = from_folders.get(names.get(column.name, column.name))
        if column.dtype == "string":
            if column.name in wanted:
                texts[column.name] = Texts.of_arrow(batch.column(wanted[column.name]))
            elif told is not None:
                texts[column.name] = Texts.of([told] * batch.num_rows)
        elif column.name == "time_s" and clock is not None:
            times = batch.column(clock.name)
            dates = batch.column(clock.date) if clock.date else None
            numbers[column.name], wrong = clock.read(times, dates)
            clock.report_wrong(
                wrong, times, lambda i: (f"{name}, row {row + i}", row + i), problems
            )
        elif column.name in wanted:
            numbers[column.name] = numbers_of(batch.column(wanted[column.name]))
        elif told is not None or column.name not in SAID_OF_RUNS:
            value = np.nan if told is None else float(told)
            numbers[column.name] = np.full(batch.num_rows, value)
    return Rows(numbers, texts, row, problems)

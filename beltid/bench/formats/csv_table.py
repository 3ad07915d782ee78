"""Read CSV rows with Arrow, or row by row with line numbers if anything is wrong."""

from __future__ import annotations

import csv
import gzip
import io
import re
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.artifacts.file_bytes import opened
from beltid.bench.files.sniff import CUT_OFF
from beltid.bench.formats.clock import Clock
from beltid.bench.formats.dialect import BLANK, Layout, asides_note, blank_asides
from beltid.bench.formats.numbers import MISSING_WORDS, numbers_or_problems
from beltid.bench.formats.rows import Rows, Texts
from beltid.errors import InputError, Problems

CHUNK: Final = 16 << 20
"""Bytes read at a time."""
ARROW_BLOCK: Final = 1 << 20
"""Bytes that an Arrow thread reads at a time."""
LONGEST_ROW: Final = 64 << 20
_SPACING: Final = re.compile(rb"^ +| +(?=[ \n]|\Z)", re.MULTILINE)
"""Blanks that do not separate cells."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """A column to read.

    Attributes
    ----------
    index : int or str
        Position in the rows of the file, or the name for formats read by name.
    is_text : bool
        Whether it holds labels, not numbers.
    shown : str
        Name in messages.
    clock : Clock or None
        Reader of the clock times; None for numbers and labels.
    date : int, str or None
        Column with the dates of the clock times.
    """

    index: Any
    is_text: bool
    shown: str
    clock: Clock | None = None
    date: Any = None


def read_rows(layout: Layout, wanted: Mapping[str, Wanted], name: str) -> Rows:
    """Read the wanted columns.

    Parameters
    ----------
    layout : Layout
        The rows and their layout.
    wanted : mapping
        Our column names -> columns of the file.
    name : str
        File name for messages.

    Returns
    -------
    Rows
        The columns, without rows in which all wanted cells are empty.

    Raises
    ------
    UnicodeDecodeError
        If rows that Arrow cannot read are not UTF-8.
    """
    if layout.separator == BLANK:
        layout = replace(layout, body=_SPACING.sub(b"", layout.body))
    rows = _read_clean(layout, wanted)
    return (_read_row_by_row(layout, wanted, name) if rows is None else rows).filled()


def csv_blocks(
    chunks: Iterable[bytes],
    layout: Layout,
    wanted: Mapping[str, Wanted],
    encoding: str,
    name: str,
    notes: list[str],
) -> Iterator[Rows]:
    """Yield the rows of a CSV file of any size in blocks.

    Parameters
    ----------
    chunks : iterable of bytes
        The file, starting at its first row.
    layout : Layout
        Layout of the file; its body is not used.
    wanted : mapping of str to Wanted
        Columns to read.
    encoding : str
        Encoding of the file: UTF-8 or another superset of ASCII.
    name : str
        File name for messages.
    notes : list of str
        Receives the notes made at the end of the file.

    Raises
    ------
    InputError
        If a row is too long, or the bytes are not text.
    """
    asides = 0
    for line, data in _whole_rows(chunks, layout.first_line, name, notes):
        if b"\0" in data:
            at = line + data.count(b"\n", 0, data.index(b"\0"))
            raise InputError(f"{name}:{at}: contains a zero byte: damaged, or not a text file")
        try:
            body = data if encoding == "utf-8" else data.decode(encoding).encode()
            block, count = blank_asides(replace(layout, body=body, first_line=line))
            asides += count
            yield read_rows(block, wanted, name)
        except UnicodeDecodeError as error:
            at = line + data.count(b"\n", 0, error.start)
            raise InputError(
                f"{name}:{at}: byte 0x{data[error.start]:02X} is not {encoding.upper()}; if the "
                "file is in another encoding, say which: dialect: {encoding: latin-1}",
            ) from None
    notes += asides_note(asides)


def file_chunks(path: Path) -> Iterator[bytes]:
    """Yield the bytes of a plain or gzip file in chunks.

    Raises
    ------
    InputError
        If the file cannot be read or is damaged.
    """
    with opened(path) as raw:
        packed = raw.peek(2)[:2] == b"\x1f\x8b"
        try:
            source = gzip.GzipFile(fileobj=raw) if packed else raw
            while chunk := source.read(CHUNK):
                yield chunk
        except (gzip.BadGzipFile, EOFError, zlib.error):
            raise InputError(f"{path}: the gzip file is damaged or cut off") from None


def _line_feeds(data: bytes) -> int:
    """Count line feeds; `bytes.count` takes three times as long."""
    return int(np.count_nonzero(np.frombuffer(data, dtype=np.uint8) == ord("\n")))


def _whole_rows(
    chunks: Iterable[bytes], line: int, name: str, notes: list[str]
) -> Iterator[tuple[int, bytes]]:
    """Split the bytes into parts that end with a line feed outside quotation marks.

    Yield the number of the first line with each part, starting at `line`; line feeds are single.
    """
    rest = b""
    for chunk in chunks:
        end = chunk.rfind(b"\n") + 1
        # an odd number of quotation marks: a cell may continue after the last line feed
        quotes = rest.count(b'"') + (chunk.count(b'"', 0, end) if b'"' in chunk else 0)
        if end and (quotes % 2 == 0 or len(rest) + end > LONGEST_ROW):
            data = _single_feeds(b"".join((rest, memoryview(chunk)[:end])))
            yield line, data
            line += _line_feeds(data)
            rest = chunk[end:]
        else:
            rest += chunk
            if len(rest) > LONGEST_ROW:
                raise InputError(f"{name}:{line}: the row is longer than {LONGEST_ROW} bytes")
    if rest and not rest.endswith((b"\n", b"\r")) and CUT_OFF not in notes:
        notes.append(CUT_OFF)
    if rest:
        yield line, _single_feeds(rest + b"\n")


def _single_feeds(data: bytes) -> bytes:
    return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in data else data


def _read_clean(layout: Layout, wanted: Mapping[str, Wanted]) -> Rows | None:
    """Read with Arrow; return None if any row or cell is not as expected."""
    body = layout.body
    if b'"' in body and any(line.count(b'"') % 2 for line in body.split(b"\n")):
        return None  # a cell over several lines: only the exact reader counts lines correctly
    names = [f"c{i}" for i in range(len(layout.header))]
    table = _arrow_table(layout, wanted, names)
    if table is None:
        return None
    lines: int | np.ndarray = layout.first_line
    if _line_feeds(body) + (not body.endswith(b"\n")) != table.num_rows:
        lines = _filled_lines(body, layout.first_line)
        if len(lines) != table.num_rows:
            return None
    columns = {key: table.column(names[w.index]) for key, w in wanted.items()}
    numbers: dict[str, np.ndarray] = {}
    for key, w in wanted.items():
        if w.clock is not None:
            dates = None if w.date is None else table.column(names[w.date])
            numbers[key], wrong = w.clock.read(columns[key], dates)
            if wrong:
                return None
        elif not w.is_text and layout.signs.thousands:
            ungrouped = layout.signs.of_arrow(columns[key])
            if ungrouped is None:
                return None
            numbers[key] = ungrouped
        elif not w.is_text:
            numbers[key] = columns[key].to_numpy()
    texts = {
        key: Texts.of_arrow(columns[key], MISSING_WORDS) for key, w in wanted.items() if w.is_text
    }
    return Rows(numbers, texts, lines)


def _arrow_table(layout: Layout, wanted: Mapping[str, Wanted], names: list[str]) -> Any:
    """Read the wanted columns into an Arrow table with the given names; None if Arrow fails."""
    import pyarrow as pa
    from pyarrow import csv as pa_csv

    types = {
        names[w.index]: pa.string()
        if w.is_text or w.clock or layout.signs.thousands
        else pa.float64()
        for w in wanted.values()
    } | {names[w.date]: pa.string() for w in wanted.values() if w.date is not None}
    # An Arrow thread may be the last to release its input. If that input belonged to Python and
    # the interpreter exited at that moment, the process would abort.
    in_arrow = pa.BufferOutputStream()
    in_arrow.write(layout.body)
    try:
        return pa_csv.read_csv(
            pa.BufferReader(in_arrow.getvalue()),
            read_options=pa_csv.ReadOptions(column_names=names, block_size=ARROW_BLOCK),
            parse_options=pa_csv.ParseOptions(delimiter=layout.separator),
            convert_options=pa_csv.ConvertOptions(
                column_types=types,
                include_columns=list(types),
                null_values=sorted(MISSING_WORDS),
                strings_can_be_null=True,
                decimal_point=layout.signs.decimal,
            ),
        )
    except (pa.ArrowException, ValueError, KeyError):
        return None


def _filled_lines(body: bytes, first_line: int) -> np.ndarray:
    """Return the numbers of the lines that are not empty."""
    ends = np.flatnonzero(np.frombuffer(body, dtype=np.uint8) == ord("\n"))
    if not body.endswith(b"\n"):
        ends = np.append(ends, len(body))
    lengths = np.diff(ends, prepend=-1) - 1
    return np.flatnonzero(lengths > 0) + first_line


def _read_row_by_row(layout: Layout, wanted: Mapping[str, Wanted], name: str) -> Rows:
    """Read row by row and report every fault with its line."""
    import pyarrow as pa

    width, problems = len(layout.header), Problems()
    columns = {
        i: list[str | None]() for w in wanted.values() for i in (w.index, w.date) if i is not None
    }
    lines: list[int] = []
    misfits: dict[int, list[int]] = {}
    text = io.StringIO(layout.body.decode(), newline="")
    reader = csv.reader(text, delimiter=layout.separator, skipinitialspace=True)
    try:
        for row in reader:
            line = layout.first_line + reader.line_num - 1
            if not any(cell.strip() for cell in row):
                continue
            if len(row) < width or any(cell.strip() for cell in row[width:]):
                misfits.setdefault(len(row), []).append(line)
                continue
            lines.append(line)
            for index, column in columns.items():
                cell = row[index].strip()
                column.append(None if cell in MISSING_WORDS else cell)
    except csv.Error as error:
        line = layout.first_line + reader.line_num - 1
        problems.add(f"{name}:{line}: not a row of a CSV file: {error}", line)
    for count, at in misfits.items():
        misfit = f"{count} cells, must be {width}".format
        problems.add_alike(at, misfit, lambda line: (f"{name}:{line}", line))

    def place(row: int) -> tuple[str, int]:
        return f"{name}:{lines[row]}", lines[row]

    numbers: dict[str, np.ndarray] = {}
    for key, w in wanted.items():
        if w.clock is not None:
            cells = columns[w.index]
            dates = None if w.date is None else pa.array(columns[w.date], pa.string())
            numbers[key], wrong = w.clock.read(pa.array(cells, pa.string()), dates)
            w.clock.report_wrong(wrong, cells, place, problems)
        elif not w.is_text:
            numbers[key] = numbers_or_problems(
                columns[w.index], layout.signs, w.shown, place, problems
            )
    texts = {key: Texts.of(columns[w.index]) for key, w in wanted.items() if w.is_text}
    return Rows(numbers, texts, np.array(lines, dtype=np.int64), problems)

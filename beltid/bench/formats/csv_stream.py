"""A CSV recording in blocks, for files that are too big to be read at once."""

from __future__ import annotations

import gzip
import itertools
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from beltid.bench.files.encoding import CUT_OFF
from beltid.bench.formats.csv_reader import Wanted, read_rows
from beltid.bench.formats.dialect import MISSING_WORDS, Layout
from beltid.bench.problems import Problems
from beltid.errors import InputError

CHUNK: Final = 16 << 20
"""Bytes that are read at a time."""
MOST_ROWS: Final = 1 << 19
"""Rows of a block."""
LONGEST_ROW: Final = 64 << 20
MOST_CHANGES: Final = 1 << 16
AHEAD: Final = 1
"""Blocks that wait for their use."""


@dataclass(frozen=True, slots=True)
class Block:
    """Some rows of a recording; the arrays hold them only until the next block is asked for.

    Attributes
    ----------
    numbers : dict of str to ndarray
        float64 columns.
    labels : list of (int, str or None)
        Rows of the block at which a label begins, and the label; the first is row 0.
    lines : ndarray or int
        Line of every row in the file, or that of the first if none is left out.
    problems : Problems
        Rows that cannot be read, up to this block's last one; a block of nothing else has no row.
    """

    numbers: dict[str, np.ndarray]
    labels: list[tuple[int, str | None]]
    lines: np.ndarray | int
    problems: Problems = field(default_factory=Problems)

    @property
    def n_rows(self) -> int:
        """Number of its rows."""
        return len(next(iter(self.numbers.values())))


def file_chunks(path: Path) -> Iterator[bytes]:
    """The bytes of a file, plain or packed with gzip, in chunks.

    Raises
    ------
    InputError
        If the file cannot be read or is damaged.
    """
    try:
        with path.open("rb") as raw:
            packed = raw.peek(2)[:2] == b"\x1f\x8b"
            source = gzip.GzipFile(fileobj=raw) if packed else raw
            while chunk := source.read(CHUNK):
                yield chunk
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path}: {_reason(error)}") from None


def _reason(error: Exception) -> str:
    if isinstance(error, (EOFError, zlib.error, gzip.BadGzipFile)):
        return "the gzip file is damaged or cut off"
    return f"cannot be read: {getattr(error, 'strerror', None) or error}"


def csv_blocks(
    chunks: Iterator[bytes],
    layout: Layout,
    wanted: Mapping[str, Wanted],
    encoding: str,
    name: str,
    notes: list[str],
) -> Iterator[Block]:
    """Blocks of a CSV file.

    Parameters
    ----------
    chunks : iterator of bytes
        The file from its first row on.
    layout : Layout
        Its header; the body is not used.
    wanted : mapping of str to Wanted
        Columns to read; exactly one holds text, the label.
    encoding : str
        Encoding of the file: UTF-8 or another one that holds ASCII.
    name : str
        File name for messages.
    notes : list of str
        Takes what is found out at the end of the file.

    Raises
    ------
    InputError
        If a row is too long, or bytes are not text.
    """
    reader = _Reader(layout, wanted, encoding, name)
    rest = b""
    for chunk in chunks:
        end = chunk.rfind(b"\n") + 1
        # a quotation mark without its partner: a cell may go on after the last line feed
        whole = (rest.count(b'"') + chunk.count(b'"', 0, end)) % 2 == 0
        if end and (whole or len(rest) + end > LONGEST_ROW):
            yield from reader.blocks(rest + chunk[:end])
            rest = chunk[end:]
        else:
            rest += chunk
            if len(rest) > LONGEST_ROW:
                raise InputError(
                    f"{name}:{reader.line}: the row is longer than {LONGEST_ROW} bytes"
                )
    if rest and not rest.endswith((b"\n", b"\r")):
        notes.append(CUT_OFF)
    if rest:
        yield from reader.blocks(rest + b"\n")


class _Reader:
    """Clean rows by the compiled kernel, all others by the exact reader."""

    def __init__(
        self,
        layout: Layout,
        wanted: Mapping[str, Wanted],
        encoding: str,
        name: str,
    ) -> None:
        self.layout, self.wanted, self.name = layout, wanted, name
        self.encoding = encoding
        self.line = layout.first_line
        self.label = next(key for key, w in wanted.items() if w.is_text)
        self.numeric = [key for key, w in wanted.items() if not w.is_text]
        self.slots = np.full(len(layout.header), -1, dtype=np.int64)
        for slot, key in enumerate(self.numeric):
            self.slots[wanted[key].index] = slot
        self.marks = np.array([ord(layout.separator), ord(layout.decimal)], dtype=np.int64)
        # used again for later blocks: a fresh array costs as much as the numbers in it
        rooms = [np.empty((len(self.numeric), MOST_ROWS)) for _ in range(AHEAD + 2)]
        self.rooms = itertools.cycle(rooms)
        self.changes = np.empty((MOST_CHANGES, 3), dtype=np.int64)

    def blocks(self, data: bytes) -> Iterator[Block]:
        """Blocks of rows; `data` ends with a line feed."""
        from beltid.bench.formats.csv_kernel import NOT_SIMPLE, POWERS_OF_TEN, parse_rows

        if b"\0" in data:
            line = self.line + data.count(b"\n", 0, data.index(b"\0"))
            raise InputError(f"{self.name}:{line}: holds a zero byte: damaged, or not a text file")
        column = self.wanted[self.label].index
        view, begin = np.frombuffer(data, dtype=np.uint8), 0
        while begin < len(data):
            numbers = next(self.rooms)
            rows, end, n_changes, status = parse_rows(
                view[begin:],
                self.marks,
                self.slots,
                column,
                numbers,
                self.changes,
                POWERS_OF_TEN,
            )
            if rows:
                found = [change for change in self.changes[:n_changes].tolist() if change[0] < rows]
                labels = [
                    (row, self._label(data[begin + a : begin + b], self.line + row))
                    for row, a, b in found
                ]
                columns = {key: numbers[slot, :rows] for slot, key in enumerate(self.numeric)}
                yield Block(columns, labels, self.line)
                self.line += rows
                begin += end
            elif status == NOT_SIMPLE:
                yield from self._exactly(data[begin:])
                return

    def _exactly(self, rows: bytes) -> Iterator[Block]:
        """Rows that the kernel leaves alone."""
        body = self._text(rows, self.line)
        body = body.replace("\r\n", "\n").replace("\r", "\n") if "\r" in body else body
        layout = replace(self.layout, body=body, first_line=self.line)
        self.line += body.count("\n")
        problems = Problems()
        read = read_rows(layout, self.wanted, self.name, problems)
        labels = read.columns[self.label]
        # one object stands for equal labels most of the time: a comparison of names is rare
        starts = [i for i in range(len(labels)) if i == 0 or labels[i] != labels[i - 1]]
        columns = {key: read.columns[key] for key in self.numeric}
        yield Block(columns, [(i, labels[i]) for i in starts], read.lines, problems)

    def _label(self, cell: bytes, line: int) -> str | None:
        text = self._text(cell, line).strip()
        return None if text in MISSING_WORDS else text

    def _text(self, data: bytes, line: int) -> str:
        """Text of bytes that begin in a line."""
        try:
            return data.decode(self.encoding)
        except UnicodeDecodeError as error:
            line += data.count(b"\n", 0, error.start)
            raise InputError(
                f"{self.name}:{line}: byte 0x{data[error.start]:02X} is not "
                f"{self.encoding.upper()}; if the file is in another encoding, say which: "
                "dialect: {encoding: latin-1}"
            ) from None

"""A CSV recording in blocks, for files that are too big to be read at once."""

from __future__ import annotations

import gzip
import queue
import threading
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from beltid.errors import InputError
from beltid.store.csv_reader import Wanted, read_rows
from beltid.store.dialect import MISSING_WORDS, Layout
from beltid.store.problems import Problems

CHUNK: Final = 16 << 20
"""Bytes that are read at a time."""
MOST_ROWS: Final = 1 << 19
"""Rows of a block."""
LONGEST_ROW: Final = 64 << 20
MOST_CHANGES: Final = 1 << 16


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
    """

    numbers: dict[str, np.ndarray]
    labels: list[tuple[int, str | None]]
    lines: np.ndarray | int

    @property
    def n_rows(self) -> int:
        """Number of its rows."""
        return len(next(iter(self.numbers.values())))


@dataclass(slots=True)
class ByteStream:
    """The bytes of a file, unpacked, in chunks that are read ahead by a thread of their own.

    Parameters
    ----------
    path : Path
        The file, plain or packed with gzip.
    """

    path: Path
    _queue: queue.Queue[bytes | Exception] = field(default_factory=lambda: queue.Queue(2))
    _stopped: threading.Event = field(default_factory=threading.Event)

    def __iter__(self) -> Iterator[bytes]:
        """Chunks of the file.

        Raises
        ------
        InputError
            If the file cannot be read or is damaged.
        """
        reader = threading.Thread(target=self._read, daemon=True)
        reader.start()
        try:
            while chunk := self._queue.get():
                if isinstance(chunk, Exception):
                    raise InputError(f"{self.path}: {_reason(chunk)}") from None
                yield chunk
        finally:
            self._stopped.set()
            while reader.is_alive():
                _drain(self._queue)
                reader.join(0.05)

    def _read(self) -> None:
        try:
            with self.path.open("rb") as raw:
                packed = raw.peek(2)[:2] == b"\x1f\x8b"
                source = gzip.GzipFile(fileobj=raw) if packed else raw
                while not self._stopped.is_set() and (chunk := source.read(CHUNK)):
                    self._queue.put(chunk)
            self._queue.put(b"")
        except Exception as error:  # told where the chunks are asked for
            self._queue.put(error)


def _drain(waiting: queue.Queue[bytes | Exception]) -> None:
    try:
        while True:
            waiting.get_nowait()
    except queue.Empty:
        pass


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
    problems: Problems,
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
    problems : Problems
        Collects rows that cannot be read.
    """
    reader = _Reader(layout, wanted, encoding, name, problems)
    rest = b""
    for chunk in chunks:
        end = chunk.rfind(b"\n") + 1
        if end:
            yield from reader.blocks(rest + chunk[:end])
            rest = chunk[end:]
        else:
            rest += chunk
            if len(rest) > LONGEST_ROW:
                raise InputError(
                    f"{name}:{reader.line}: the row is longer than {LONGEST_ROW} bytes"
                )
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
        problems: Problems,
    ) -> None:
        self.layout, self.wanted, self.name, self.problems = layout, wanted, name, problems
        self.encoding = encoding
        self.line = layout.first_line
        self.label = next(key for key, w in wanted.items() if w.is_text)
        self.numeric = [key for key, w in wanted.items() if not w.is_text]
        self.slots = np.full(len(layout.header), -1, dtype=np.int64)
        for slot, key in enumerate(self.numeric):
            self.slots[wanted[key].index] = slot
        self.marks = np.array([ord(layout.separator), ord(layout.decimal)], dtype=np.int64)
        # used again for every block: a fresh array costs as much as the numbers in it
        self.numbers = np.empty((len(self.numeric), MOST_ROWS))
        self.changes = np.empty((MOST_CHANGES, 3), dtype=np.int64)

    def blocks(self, data: bytes) -> Iterator[Block]:
        """Blocks of rows; `data` ends with a line feed."""
        from beltid.store.csv_kernel import NOT_SIMPLE, POWERS_OF_TEN, parse_rows

        column = self.wanted[self.label].index
        view, begin = np.frombuffer(data, dtype=np.uint8), 0
        while begin < len(data):
            rows, end, n_changes, status = parse_rows(
                view[begin:],
                self.marks,
                self.slots,
                column,
                self.numbers,
                self.changes,
                POWERS_OF_TEN,
            )
            if rows:
                found = [change for change in self.changes[:n_changes].tolist() if change[0] < rows]
                labels = [(row, self._text(data[begin + a : begin + b])) for row, a, b in found]
                columns = {key: self.numbers[slot, :rows] for slot, key in enumerate(self.numeric)}
                yield Block(columns, labels, self.line)
                self.line += rows
                begin += end
            elif status == NOT_SIMPLE:
                yield from self._exactly(data[begin:])
                return

    def _exactly(self, rows: bytes) -> Iterator[Block]:
        """Rows that the kernel leaves alone."""
        try:
            body = rows.decode(self.encoding)
        except UnicodeDecodeError as error:
            line = self.line + rows[: error.start].count(b"\n")
            raise InputError(
                f"{self.name}:{line}: byte 0x{rows[error.start]:02X} is not {self.encoding}"
            ) from None
        body = body.replace("\r\n", "\n").replace("\r", "\n") if "\r" in body else body
        layout = replace(self.layout, body=body, first_line=self.line)
        self.line += body.count("\n")
        read = read_rows(layout, self.wanted, self.name, self.problems)
        if not len(read.lines):
            return
        labels = read.columns[self.label]
        # one object stands for equal labels most of the time: a comparison of names is rare
        starts = [0, *(i for i in range(1, len(labels)) if labels[i] != labels[i - 1])]
        columns = {key: read.columns[key] for key in self.numeric}
        yield Block(columns, [(i, labels[i]) for i in starts], read.lines)

    def _text(self, cell: bytes) -> str | None:
        text = cell.decode(self.encoding, errors="replace").strip()
        return None if text in MISSING_WORDS else text

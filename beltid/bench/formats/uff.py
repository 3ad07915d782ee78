"""Read universal files (UFF, UNV): time records in datasets 58, as text or binary (58b).

A dataset lies between two lines with -1. The reader takes functions of time with real ordinates
in single or double precision, evenly spaced or not; it leaves out all others and notes them.
Source: Universal File Datasets Summary, dataset 58, Structural Dynamics Research Laboratory,
University of Cincinnati.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

import numpy as np

from beltid.bench.formats.bench_file import (
    BenchFile,
    Channel,
    Field,
    Group,
    even_times,
    in_seconds,
)
from beltid.errors import InputError

RECORDS: Final = 11
"""Lines of a header: five lines of text, then the types of the function and its axes."""
_TIME: Final = 17
_REAL: Final = {2: 4, 4: 8}
"""Type of real ordinates -> bytes per number."""
_CLOSE: Final = re.compile(rb"^[ \t]*-1[ \t]*\r?$", re.MULTILINE)
_CLOSE_BINARY: Final = re.compile(rb"\r?\n?    -1[ \t]*\r?$", re.MULTILINE)  # may lack a line feed
_NOTHING: Final = ("", "NONE")
_TEXT: Final = {
    (2, 1): np.dtype([("y", "S13")]),
    (2, 0): np.dtype([("x", "S13"), ("y", "S13")]),
    (4, 1): np.dtype([("y", "S20")]),
    (4, 0): np.dtype([("x", "S13"), ("y", "S20")]),
}
"""Type of the ordinates and spacing -> Fortran columns of a sample."""


@dataclass(frozen=True, slots=True)
class _Dataset:
    """One dataset: its number, the rest of its first line, its bytes and their first line."""

    number: int
    mark: str
    options: str
    body: bytes
    first_line: int


def read(data: bytes, name: str) -> BenchFile:
    """Read the time records of a universal file.

    Parameters
    ----------
    data : bytes
        The file.
    name : str
        Name of the file, for messages.

    Raises
    ------
    InputError
        If the file is cut off or damaged, or holds no time record of real numbers.
    """
    channels: list[Channel] = []
    fields: dict[str, Field] = {}
    left_out: dict[str, int] = {}
    for dataset in _datasets(data, name):
        if dataset.number != 58:
            reason = f"dataset {dataset.number}"
        else:
            channel = _function(dataset, name)
            if isinstance(channel, Channel):
                channels.append(channel)
                fields |= {f.name: f for f in _fields(dataset)}
                continue
            reason = channel
        left_out[reason] = left_out.get(reason, 0) + 1
    notes = [
        f"{what} left out" + (f" ({n} times)" if n > 1 else "") for what, n in left_out.items()
    ]
    if not channels:
        held = "; ".join(notes) or "nothing"
        raise InputError(f"{name}: holds no time record of real numbers in a dataset 58: {held}")
    group = Group("", tuple(channels), tuple(fields.values()))
    return BenchFile("universal file (UFF 58)", (group,), (), tuple(notes))


def _datasets(data: bytes, name: str) -> list[_Dataset]:
    datasets: list[_Dataset] = []
    at, line = 0, 1
    while at < len(data):
        text, after = _line(data, at)
        if text.strip() != b"-1":
            if text.strip():
                raise _damaged(name, line, "must be -1, which begins a dataset")
            at, line = after, line + 1
            continue
        head, start = _line(data, after)
        kind = re.match(rb"\s*(\d{1,5})([bB]?)(.*)", head.rstrip())
        if kind is None:
            raise _damaged(name, line + 1, "must be the number of a dataset")
        end = start
        if kind[2]:  # binary samples may hold any bytes: find their end by their length
            for _ in range(RECORDS):
                end = _line(data, end)[1]
            end += _int(kind[3].decode("ascii", "replace").split(), 3, name, line + 1)
            if end > len(data):
                raise _damaged(name, line + 1, "the file ends within its binary samples")
        close = (_CLOSE_BINARY if kind[2] else _CLOSE).search(data, end)
        if close is None:
            raise _damaged(name, line, "the dataset that begins here does not end with -1")
        body = data[start : close.start()]
        options = kind[3].decode("ascii", "replace")
        datasets.append(_Dataset(int(kind[1]), kind[2].decode().lower(), options, body, line + 2))
        line += data.count(b"\n", at, close.end()) + 1
        at = _line(data, close.end())[1]
    return datasets


def _function(dataset: _Dataset, name: str) -> Channel | str:
    """Read the time record of a dataset 58, or say what it is instead."""
    header, at = [], 0
    for _ in range(RECORDS):
        text, at = _line(dataset.body, at)
        header.append(text.decode("latin-1").rstrip())
    at_line = dataset.first_line + 6
    shape, x_axis, y_axis = header[6], header[7], header[8]
    kind, n, spacing = (_int([shape[i : i + 10]], 0, name, at_line) for i in (0, 10, 20))
    if _int([x_axis[:10]], 0, name, at_line + 1) != _TIME:
        return "a function that is not of time"
    if kind not in _REAL:
        return "a function with complex values"
    start, step = (_float(shape[i : i + 13], name, at_line) for i in (30, 43))
    samples = dataset.body[at:]
    first = dataset.first_line + RECORDS
    if dataset.mark:
        table = _binary(samples, dataset, kind, n, spacing, name)
    else:
        table = _written(samples, _TEXT[kind, min(spacing, 1)], first, name)
    if len(table) != n:
        raise _damaged(name, first, f"{len(table)} samples follow, the header states {n}")
    if not n:
        return "a function without samples"
    time = even_times(start, step, n) if spacing else table["x"].astype(float)
    unit = x_axis[46:67].strip()
    try:
        time = in_seconds(time, "" if unit.upper() in _NOTHING else unit)
    except InputError as error:
        raise InputError(error.at(f"{name}:{at_line + 1}")) from None
    label, unit = y_axis[25:46].strip(), y_axis[46:67].strip()
    title = next((t for t in (header[0].strip(), label) if t.upper() not in _NOTHING), "")
    response = header[5][31:55].split()
    channel_name = title or f"response {' '.join(response)}"
    return Channel(
        channel_name, "" if unit.upper() in _NOTHING else unit, table["y"].astype(float), time
    )


def _binary(
    samples: bytes, dataset: _Dataset, kind: int, n: int, spacing: int, name: str
) -> np.ndarray:
    """Read binary samples; the number of bytes determines the size of a time value."""
    options = dataset.options.split()
    line = dataset.first_line - 1
    order, format_of_numbers = (_int(options, i, name, line) for i in (0, 1))
    if order not in (1, 2) or format_of_numbers != 2:
        raise InputError(f"{name}:{line}: binary numbers must be in IEEE 754 format")
    sign, size = "<>"[order - 1], _REAL[kind]
    time_size = 0 if spacing else (len(samples) // max(n, 1)) - size
    needed = n * (size + time_size)
    is_whole = len(samples) >= needed and not samples[needed:].strip()
    if not is_whole or time_size not in ((0,) if spacing else (4, 8)):
        raise _damaged(name, line, f"{len(samples)} bytes do not hold the {n} samples it states")
    y = ("y", f"{sign}f{size}")
    columns = [y] if spacing else [("x", f"{sign}f{time_size}"), y]
    return np.frombuffer(samples, columns, count=n)


def _written(samples: bytes, columns: np.dtype, first: int, name: str) -> np.ndarray:
    """Read samples that are written as text in Fortran columns."""
    rows = [row.rstrip() for row in samples.replace(b"D", b"E").split(b"\n")]
    while rows and not rows[-1]:
        rows.pop()
    for i, row in enumerate(rows):
        if len(row) % columns.itemsize:
            raise _damaged(name, first + i, "is not written in the columns of its format")
    cells = np.frombuffer(b"".join(rows), columns)
    try:
        return cells.astype([(field, float) for field in columns.names or ()])
    except ValueError as error:
        raise _damaged(name, first, f"below here: {error}") from None


def _fields(dataset: _Dataset) -> list[Field]:
    """Return the header texts of a dataset, without the first one, which names the channel."""
    lines = dataset.body.split(b"\n", 5)[1:5]
    texts = [line.decode("latin-1").strip() for line in lines]
    return [
        Field(f"ID line {i}", text)
        for i, text in enumerate(texts, start=2)
        if text.upper() not in _NOTHING
    ]


def _line(data: bytes, at: int) -> tuple[bytes, int]:
    """Return a line without its end, and where the next line begins."""
    end = data.find(b"\n", at)
    end = len(data) if end < 0 else end
    return data[at:end].rstrip(b"\r"), end + 1


def _int(words: list[str], index: int, name: str, line: int) -> int:
    try:
        value = int(words[index])
    except (IndexError, ValueError):
        raise _damaged(name, line, "a number in its header is missing or not a number") from None
    if not 0 <= value < 1 << 40:
        raise _damaged(name, line, f"{value} in its header is out of range")
    return value


def _float(text: str, name: str, line: int) -> float:
    try:
        return float(text.replace("D", "E") or "0")
    except ValueError:
        raise _damaged(name, line, f'"{text}" in its header is not a number') from None


def _damaged(name: str, line: int, what: str) -> InputError:
    return InputError(f"{name}:{line}: damaged universal file: {what}")

"""Read LabVIEW measurement files (.lvm): segments, each with its own header."""

from __future__ import annotations

import re
from collections.abc import Sequence
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
from beltid.bench.formats.clock import DAY_S, Clock
from beltid.bench.formats.numbers import NumberSigns, numbers_or_problems
from beltid.errors import InputError, Problems

END: Final = "***End_of_Header***"
HEADER: Final = 10_000
"""Characters searched for the separator."""
_SEPARATOR: Final = re.compile(r"^Separator(.)(?:Tab|Comma|Space)\b", re.MULTILINE | re.IGNORECASE)
"""The header line that names the separator, which is written with the separator itself."""
_TECHNICAL: Final = re.compile(
    r"LabVIEW Measurement|(Writer|Reader)_Version|(Decimal_)?Separator|Multi_Headings|X_Columns|"
    r"Time_Pref|Channels|Samples|X0|Delta_X|[XY]_Dimension|[XY]_Unit_Label"
)
"""Header keys that describe the format, not the measurement."""


@dataclass(frozen=True, slots=True)
class _Segment:
    """One segment: its channels, header fields, first line and start in absolute time [s]."""

    channels: tuple[Channel, ...]
    fields: tuple[Field, ...]
    first_line: int
    clock_s: float | None


def read(text: str, name: str) -> BenchFile:
    """Read a LabVIEW measurement file.

    Parameters
    ----------
    text : str
        The file, with single line feeds.
    name : str
        Name of the file, for messages.

    Raises
    ------
    InputError
        With every line that cannot be read, or if there are no samples.
    """
    separator = _SEPARATOR.search(text, 0, HEADER)
    reader = _Reader(text.split("\n"), separator[1] if separator else "\t", name)
    header, at = reader.header(0)
    reader.signs = NumberSigns("," if header.cell("Decimal_Separator") == "," else ".")
    reader.x_columns = header.cell("X_Columns").lower() or "one"
    segments = []
    while (at := reader.next_filled(at)) < len(reader.lines):
        segment, at = reader.segment(at)
        if segment is not None:
            segments.append(segment)
    reader.problems.raise_if_any()
    if not segments:
        raise InputError(f"{name}: holds no samples, only a header")
    groups, notes = _join(segments)
    return BenchFile("LabVIEW measurement (.lvm)", groups, header.fields, notes)


@dataclass(frozen=True, slots=True)
class _Header:
    """Keys of a header and their cells, one cell per channel."""

    lines: dict[str, list[str]]

    def cell(self, key: str, index: int = 0) -> str:
        """Return the cell of a channel; "" if there is none."""
        cells = self.lines.get(key, [])
        return cells[index] if index < len(cells) else ""

    @property
    def fields(self) -> tuple[Field, ...]:
        """Header fields that describe the measurement."""
        texts = {key: self.cell(key) for key in self.lines if not _TECHNICAL.fullmatch(key)}
        return tuple(Field(key, text) for key, text in texts.items() if text)

    @property
    def clock_s(self) -> float | None:
        """Absolute start time [s], counted from 1970-01-01; None if it is not given."""
        import pyarrow as pa

        clock = Clock("")
        seconds, wrong = clock.read(pa.array([f"{self.cell('Date')} {self.cell('Time')}"]))
        return float(seconds[0]) + clock.first_day * DAY_S if clock.dated and not wrong else None


class _Reader:
    """Reader of the segments of one file."""

    def __init__(self, lines: Sequence[str], separator: str, name: str) -> None:
        self.lines = lines
        self.separator = separator
        self.name = name
        self.signs = NumberSigns()
        self.x_columns = "one"
        self.problems = Problems()

    def next_filled(self, at: int) -> int:
        """Return the index of the first line from `at` that is not blank."""
        while at < len(self.lines) and not self.lines[at].strip():
            at += 1
        return at

    def cells(self, at: int) -> list[str]:
        """Split a line into cells."""
        return [cell.strip() for cell in self.lines[at].split(self.separator)]

    def header(self, at: int) -> tuple[_Header, int]:
        """Read the header that begins at a line; return it and the line after it."""
        lines: dict[str, list[str]] = {}
        special = False
        for i in range(at, len(self.lines)):
            key, *cells = self.cells(i)
            special = special or key.startswith("***Start_Special")
            if not special and key == END:
                return _Header(lines), i + 1
            if not special and key:
                lines[key] = cells
            special = special and not key.startswith("***End_Special")
        raise InputError(
            f"{self.name}:{at + 1}: the header does not end with {END}: the file is cut off"
        )

    def segment(self, at: int) -> tuple[_Segment | None, int]:
        """Read the segment that begins at a line; return it and the line after its last sample."""
        header = _Header({})
        if not self.cells(at)[0].startswith("X_Value"):
            header, at = self.header(at)
            at = self.next_filled(at)
        if at == len(self.lines):
            raise InputError(f"{self.name}:{at}: the file ends after a header: it is cut off")
        names = [cell for cell in self.cells(at) if cell != "Comment"]
        while names and not names[-1]:
            names.pop()
        first = at + 1
        rows, last = self._rows(first, len(names))
        if not rows:
            self.problems.add(f"{self.name}:{first}: no samples below the channel names")
            return None, last

        def place(row: int) -> tuple[str, int]:
            return f"{self.name}:{first + row + 1}", first + row + 1

        columns = [
            numbers_or_problems([c or None for c in cells], self.signs, name, place, self.problems)
            for name, cells in zip(names, zip(*rows, strict=True), strict=True)
        ]
        channels = self._channels(names, header, columns, first)
        fields = tuple(
            f for f in header.fields if f.name not in ("Date", "Time")
        )  # given per channel
        return _Segment(channels, fields, first + 1, header.clock_s), last

    def _rows(self, at: int, width: int) -> tuple[list[list[str]], int]:
        """Read the samples that begin at a line; return their cells and the line after them."""
        rows: list[list[str]] = []
        while at < len(self.lines) and self.lines[at].strip():
            if self.lines[at].startswith("Channels" + self.separator):
                break
            cells = self.cells(at)
            if len(cells) < width and at >= len(self.lines) - 2:
                self.problems.add(f"{self.name}:{at + 1}: the last row is cut off")
            rows.append([*cells, *[""] * (width - len(cells))][:width])
            at += 1
        return rows, at

    def _channels(
        self, names: Sequence[str], header: _Header, columns: Sequence[np.ndarray], first: int
    ) -> tuple[Channel, ...]:
        """Build the channels of a segment; the X columns are arranged as the file states."""
        if self.x_columns == "multi":
            pairs = [(i, i + 1) for i in range(0, len(names) - 1, 2)]
        else:
            pairs = [(0, i) for i in range(1, len(names))]
        channels = []
        for k, (x, y) in enumerate(pairs):
            rows = len(columns[y])
            used = np.flatnonzero(~np.isnan(columns[y]))
            length = int(used[-1]) + 1 if used.size else 0
            stated = header.cell("Samples", k)
            if stated.isdecimal() and float(stated) > rows:
                self.problems.add(
                    f"{self.name}:{first + rows}: {names[y]} has {rows} samples, its "
                    f"header states {stated}: the file is cut off"
                )
            if length == 0:
                continue
            time = None
            if header.cell("X_Dimension", k).lower() in ("", "time", "zeit"):
                time = self._time(columns[x][:length], header, k, length)
                if time is not None:
                    time = self._seconds(time, header.cell("X_Unit_Label", k), first)
            unit = header.cell("Y_Unit_Label", k)
            channels.append(Channel(names[y], unit, columns[y][:length], time))
        return tuple(channels)

    def _seconds(self, time: np.ndarray, unit: str, first: int) -> np.ndarray:
        try:
            return in_seconds(time, unit)
        except InputError as error:
            raise InputError(error.at(f"{self.name}, header above line {first + 1}")) from None

    def _time(self, written: np.ndarray, header: _Header, k: int, length: int) -> np.ndarray | None:
        if self.x_columns != "no" and not np.isnan(written).all():
            return written
        try:
            start = float(header.cell("X0", k).replace(",", ".") or "0")
            step = float(header.cell("Delta_X", k).replace(",", "."))
        except ValueError:
            return None
        return even_times(start, step, length) if step > 0 else None


def _join(segments: Sequence[_Segment]) -> tuple[tuple[Group, ...], tuple[str, ...]]:
    """Join segments without a gap into one group: LabVIEW writes a header per block."""
    parts: list[list[_Segment]] = []
    for segment in segments:
        if parts and _continues(parts[-1][-1], segment):
            parts[-1].append(segment)
        else:
            parts.append([segment])
    groups = []
    for number, part in enumerate(parts, start=1):
        name = f"segment {number}" if len(parts) > 1 else ""
        groups.append(Group(name, _concatenated(part), part[0].fields, part[0].first_line))
    notes = []
    if len(parts) < len(segments):
        notes.append(f"{len(segments)} segments without gaps between them joined into {len(parts)}")
    return tuple(groups), tuple(notes)


def _continues(before: _Segment, after: _Segment) -> bool:
    """Whether a segment starts one time step after the end of the previous one."""
    if [c.name for c in before.channels] != [c.name for c in after.channels]:
        return False
    t_before, t_after = before.channels[0].time_s, after.channels[0].time_s
    if t_before is None or t_after is None or len(t_before) < 2:
        return False
    step = (t_before[-1] - t_before[0]) / (len(t_before) - 1)
    if abs(t_after[0] - t_before[-1] - step) <= 0.5 * step:
        return True
    if before.clock_s is None or after.clock_s is None or after.clock_s == before.clock_s:
        return False
    gap = (after.clock_s + t_after[0]) - (before.clock_s + t_before[-1]) - step
    return bool(abs(gap) <= 1.5 * step)


def _concatenated(part: Sequence[_Segment]) -> tuple[Channel, ...]:
    if len(part) == 1:
        return part[0].channels
    channels = []
    for k, first in enumerate(part[0].channels):
        pieces = [segment.channels[k] for segment in part]
        times: list[np.ndarray] = []
        for piece in pieces:
            time = piece.time_s
            assert time is not None
            if times:
                step = (times[-1][-1] - times[-1][0]) / max(len(times[-1]) - 1, 1)
                if abs(time[0] - times[-1][-1] - step) > 0.5 * step:  # time restarts: shift it
                    time = time - time[0] + times[-1][-1] + step
            times.append(time)
        values = np.concatenate([piece.values for piece in pieces])
        channels.append(Channel(first.name, first.unit, values, np.concatenate(times)))
    return tuple(channels)

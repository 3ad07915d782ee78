"""LabVIEW measurement files (.lvm): segments, each with a header of its own."""

from __future__ import annotations

import datetime
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from beltid.bench.formats.bench_file import BenchFile, Channel, Field, Group, even_times
from beltid.bench.formats.numbers import NumberSigns
from beltid.errors import Alike, InputError, Problems

END: Final = "***End_of_Header***"
HEADER: Final = 10_000
"""Characters in which the separator is looked for."""
_SEPARATOR: Final = re.compile(r"^Separator(.)(?:Tab|Comma|Space)\b", re.MULTILINE | re.IGNORECASE)
"""The line that names the separator holds it, too."""
_TECHNICAL: Final = frozenset(
    {
        "Writer_Version",
        "Reader_Version",
        "Separator",
        "Decimal_Separator",
        "Multi_Headings",
        "X_Columns",
        "Time_Pref",
        "LabVIEW Measurement",
    }
)


@dataclass(frozen=True, slots=True)
class _Segment:
    """One segment: its channels, its first line, and its start in absolute time [s]."""

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
        With every line that cannot be read.
    """
    lines = text.split("\n")
    told = _SEPARATOR.search(text, 0, HEADER)
    separator = told[1] if told else "\t"
    header, at = _header(lines, 0, separator, name)
    reader = _Reader(lines, separator, header, name)
    segments = []
    while (at := reader.next_filled(at)) < len(lines):
        segment, at = reader.segment(at)
        if segment is not None:
            segments.append(segment)
    reader.problems.add_alike(reader.unread)
    reader.problems.raise_if_any()
    if not segments:
        raise InputError(f"{name}: holds no samples, only a header")
    fields = tuple(
        Field(key, cells[0])
        for key, cells in header.lines.items()
        if key not in _TECHNICAL and cells
    )
    groups, notes = _joined(segments)
    return BenchFile("LabVIEW measurement (.lvm)", groups, fields, notes)


@dataclass(frozen=True, slots=True)
class _Header:
    """Keys of a header and their cells."""

    lines: dict[str, list[str]]

    def one(self, key: str, default: str = "") -> str:
        """First cell of a key."""
        return next(iter(self.lines.get(key, [])), default)

    def cell(self, key: str, index: int) -> str:
        """Cell of a channel."""
        cells = self.lines.get(key, [])
        return cells[index] if index < len(cells) else ""


def _header(lines: Sequence[str], at: int, separator: str, name: str) -> tuple[_Header, int]:
    """The header that begins at a line, and the line after its end."""
    found: dict[str, list[str]] = {}
    special = False
    for i in range(at, len(lines)):
        cells = [cell.strip() for cell in lines[i].split(separator)]
        if cells[0].startswith("***Start_Special"):
            special = True
        if not special and cells[0] == END:
            return _Header(found), i + 1
        if not special and cells[0]:
            found[cells[0]] = cells[1:]
        if cells[0].startswith("***End_Special"):
            special = False
    raise InputError(f"{name}:{at + 1}: the header does not end with {END}, the file is cut off")


class _Reader:
    """Reads the segments of one file."""

    def __init__(self, lines: Sequence[str], separator: str, header: _Header, name: str) -> None:
        self.lines = lines
        self.separator = separator
        self.header = header
        self.name = name
        self.signs = NumberSigns("," if header.one("Decimal_Separator", ".") == "," else ".")
        self.x_columns = header.one("X_Columns", "One").lower()
        self.problems = Problems()
        self.unread = Alike()

    def next_filled(self, at: int) -> int:
        """First line from `at` that is not blank."""
        while at < len(self.lines) and not self.lines[at].strip():
            at += 1
        return at

    def cells(self, at: int) -> list[str]:
        """Cells of a line."""
        return [cell.strip() for cell in self.lines[at].split(self.separator)]

    def segment(self, at: int) -> tuple[_Segment | None, int]:
        """The segment that begins at a line, and the line after its last sample."""
        header = _Header({})
        if not self.cells(at)[0].startswith("X_Value"):
            header, at = _header(self.lines, at, self.separator, self.name)
            at = self.next_filled(at)
        if at == len(self.lines):
            raise InputError(f"{self.name}:{at}: the file ends after a header, it is cut off")
        names = [cell for cell in self.cells(at) if cell != "Comment"]
        while names and not names[-1]:
            names.pop()
        first = at + 1
        rows, last = self._rows(first, len(names))
        if not rows:
            self.problems.add(f"{self.name}:{first}: no samples below the names of the channels")
            return None, last
        table = np.array(rows, dtype=float)
        channels = self._channels(names, header, table, first)
        return _Segment(channels, self._fields(header), first + 1, self._clock(header)), last

    def _rows(self, at: int, width: int) -> tuple[list[list[float]], int]:
        rows: list[list[float]] = []
        while at < len(self.lines):
            line = self.lines[at]
            if not line.strip() or line.startswith("Channels" + self.separator):
                break
            cells = self.cells(at)
            if len(cells) < width:
                cells += [""] * (width - len(cells))
                if at >= len(self.lines) - 2 and not cells[width - 1]:
                    self.problems.add(f"{self.name}:{at + 1}: the last row is cut off")
            rows.append([self._number(cell, at) for cell in cells[:width]])
            at += 1
        return rows, at

    def _number(self, cell: str, at: int) -> float:
        if not cell:
            return np.nan
        value = self.signs.number(cell)
        if not isinstance(value, str):
            return value
        self.unread.add(at + 1, f'{self.name}:{at + 1}: "{cell[:40]}", {value}')
        return np.nan

    def _channels(
        self, names: Sequence[str], header: _Header, table: np.ndarray, first: int
    ) -> tuple[Channel, ...]:
        """Channels of a segment; where X stands in the file, and how often, the file says."""
        if self.x_columns == "multi":
            pairs = [(i, i + 1) for i in range(0, len(names) - 1, 2)]
        else:
            pairs = [(0, i) for i in range(1, len(names))]
        channels = []
        for k, (x, y) in enumerate(pairs):
            values = table[:, y]
            used = ~np.isnan(values)
            length = int(np.flatnonzero(used)[-1]) + 1 if used.any() else 0
            stated = header.cell("Samples", k)
            if stated.isdecimal() and float(stated) > max(length, len(table)):
                self.problems.add(
                    f"{self.name}:{first + len(table)}: {names[y]} has {len(table)} samples, its "
                    f"header tells {stated}: the file is cut off"
                )
            if length == 0:
                continue
            time = None
            if header.cell("X_Dimension", k).lower() in ("", "time", "zeit"):
                time = self._time(table[:length, x], header, k, length)
            unit = header.cell("Y_Unit_Label", k)
            channels.append(Channel(names[y], unit, values[:length], time))
        return _sharing_time(channels)

    def _time(self, written: np.ndarray, header: _Header, k: int, length: int) -> np.ndarray | None:
        if self.x_columns != "no" and not np.isnan(written).all():
            return written
        try:
            start = float(header.cell("X0", k).replace(",", ".") or "0")
            step = float(header.cell("Delta_X", k).replace(",", "."))
        except ValueError:
            return None
        return even_times(start, step, length) if step > 0 else None

    def _fields(self, header: _Header) -> tuple[Field, ...]:
        """What the segment says about itself beyond its channels."""
        known = (
            "Channels",
            "Samples",
            "X0",
            "Delta_X",
            "X_Dimension",
            "Y_Unit_Label",
            "Y_Dimension",
        )
        return tuple(
            Field(key, cells[0])
            for key, cells in header.lines.items()
            if key not in (*known, "Date", "Time", "X_Unit_Label") and cells and cells[0]
        )

    def _clock(self, header: _Header) -> float | None:
        """Absolute start of a segment [s], counted from an arbitrary day."""
        date = re.fullmatch(r"(\d{4})/(\d{1,2})/(\d{1,2})", header.cell("Date", 0))
        time = re.fullmatch(r"(\d{1,2}):(\d{2}):(\d{2}(?:[.,]\d+)?)", header.cell("Time", 0))
        if date is None or time is None:
            return None
        try:
            day = datetime.date(*(int(part) for part in date.groups())).toordinal()
        except ValueError:
            return None
        hours, minutes, seconds = time.groups()
        return (
            day * 86400.0 + int(hours) * 3600 + int(minutes) * 60 + float(seconds.replace(",", "."))
        )


def _sharing_time(channels: Sequence[Channel]) -> tuple[Channel, ...]:
    """Channels of equal times share one array."""
    shared: list[np.ndarray] = []
    out = []
    for channel in channels:
        time = channel.time_s
        if time is not None:
            same = (known for known in shared if np.array_equal(known, time, equal_nan=True))
            known = next(same, None)
            if known is None:
                shared.append(time)
            else:
                time = known
        out.append(Channel(channel.name, channel.unit, channel.values, time))
    return tuple(out)


def _joined(segments: Sequence[_Segment]) -> tuple[tuple[Group, ...], tuple[str, ...]]:
    """Segments that go on without a gap are one group: LabVIEW writes a header per block."""
    parts: list[list[_Segment]] = []
    for segment in segments:
        if parts and _goes_on(parts[-1][-1], segment):
            parts[-1].append(segment)
        else:
            parts.append([segment])
    groups = []
    for number, part in enumerate(parts, start=1):
        name = f"segment {number}" if len(parts) > 1 else ""
        groups.append(Group(name, _concatenated(part), part[0].fields, part[0].first_line))
    notes = []
    if len(parts) < len(segments):
        notes.append(f"{len(segments)} segments that go on without a gap joined to {len(parts)}")
    return tuple(groups), tuple(notes)


def _goes_on(before: _Segment, after: _Segment) -> bool:
    """Whether a segment starts one step after the end of the one before."""
    if [c.name for c in before.channels] != [c.name for c in after.channels]:
        return False
    one, two = before.channels[0].time_s, after.channels[0].time_s
    if one is None or two is None or len(one) < 2:
        return False
    step = (one[-1] - one[0]) / (len(one) - 1)
    if abs(two[0] - one[-1] - step) <= 0.5 * step:
        return True
    if before.clock_s is None or after.clock_s is None or after.clock_s == before.clock_s:
        return False
    late = (after.clock_s + two[0]) - (before.clock_s + one[-1]) - step
    return bool(abs(late) <= 1.5 * step)


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
                if abs(time[0] - times[-1][-1] - step) > 0.5 * step:  # its own clock: shift it
                    time = time - time[0] + times[-1][-1] + step
            times.append(time)
        values = np.concatenate([piece.values for piece in pieces])
        channels.append(Channel(first.name, first.unit, values, np.concatenate(times)))
    return _sharing_time(channels)

"""Groups of channels of a bench file -> pieces of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import PurePath

import numpy as np

from beltid.bench.channels.alignment import Timed, aligned
from beltid.bench.channels.channel_mapping import SETTINGS, notes_of, readings_of, told_elsewhere
from beltid.bench.channels.pieces import Piece
from beltid.bench.channels.readings import Candidate, Question, Reading
from beltid.bench.channels.text_tables import convert
from beltid.bench.formats.bench_file import BenchFile, Channel, Group
from beltid.bench.formats.dialect import ReadOptions
from beltid.bench.formats.header import check_header
from beltid.bench.formats.table_head import is_number
from beltid.bench.problems import Problems
from beltid.tables.columns import Table


def candidates_of(groups: Sequence[Group], *, named: bool) -> list[Candidate]:
    """The channels of groups, as candidates for our columns."""
    return [
        Candidate(channel.name, channel.unit, (g, c), group.name if named else "")
        for g, group in enumerate(groups)
        for c, channel in enumerate(group.channels)
    ]


def read_groups(
    file: BenchFile, name: str, table: Table, options: ReadOptions, problems: Problems
) -> list[Piece]:
    """Read the columns of a table from the groups of a file.

    Groups that each hold all the sensors are a run each; groups that complete each other are the
    rasters of one recording.

    Parameters
    ----------
    file : BenchFile
        What was found in the file.
    name : str
        Its name, for messages.
    table : Table
        What is needed.
    options : ReadOptions
        What the config states.
    problems : Problems
        Collects what is wrong.
    """
    question = Question(table, options, name, problems)
    reader = _Reader(file, question)
    whole = [i for i, group in enumerate(file.groups) if _is_whole(group, question)]
    notes = list(file.notes)
    if len(whole) < 2:
        piece = reader.piece(file.groups, None)
        pieces = [] if piece is None else [piece]
    else:
        other = [g.name for i, g in enumerate(file.groups) if i not in whole]
        if other:
            notes.append("groups left out: " + ", ".join(other[:12]))
        pieces = [
            piece
            for i in whole
            for piece in [reader.piece([file.groups[i]], file.groups[i].name)]
            if piece is not None
        ]
    if pieces and notes:
        pieces[0] = replace(pieces[0], notes=(*notes, *pieces[0].notes))
    return pieces


def _sensors(table: Table) -> list[str]:
    return [
        c.name
        for c in table.columns
        if c.required and c.dtype != "string" and c.name not in (*SETTINGS, "time_s")
    ]


def _is_whole(group: Group, question: Question) -> bool:
    """Whether a group holds all the sensors that a run needs."""
    silent = Question(question.table, question.options, group.name)
    found = readings_of(candidates_of([group], named=True), silent)
    return all(role in found for role in _sensors(question.table))


class _Reader:
    """Reads pieces from the groups of one file."""

    def __init__(self, file: BenchFile, question: Question) -> None:
        self.file = file
        self.question = question

    def piece(self, groups: Sequence[Group], run_name: str | None) -> Piece | None:
        """Columns of groups that are one run, or of all of them; None if something is wrong."""
        name, table, problems = self.question.place, self.question.table, self.question.problems
        options = self.question.options
        place = f"{name}, {run_name}" if run_name else name
        wrong = problems.count
        question = Question(table, options, place, problems)
        readings = _readings(groups, question)
        fields = (*self.file.fields, *(f for group in groups for f in group.fields))
        path = PurePath(name)
        names: tuple[str, ...] = (path.name, path.stem)
        if run_name:
            names = (f"{path.name}/{run_name}", run_name, *names)
        channels = [channel.name for group in groups for channel in group.channels]
        clocked = any(c.time_s is not None for group in groups for c in group.channels)
        if problems.count == wrong:
            in_file = {c.name: options.names.get(c.name, c.name) for c in table.columns}
            told = told_elsewhere(options.runs, names, fields, table)
            told |= set(readings) | ({"time_s"} if clocked or len(groups) > 1 else set())
            check_header(tuple(channels), in_file, table, place, problems, told)
        if problems.count > wrong:
            return None
        columns, notes = _columns(groups, readings, question)
        if problems.count > wrong:
            return None
        convert(columns, {r: reading for r, reading in readings.items() if r != "time_s"})
        used = {reading.candidate.name for reading in readings.values()}
        left_out = [channel for channel in channels if channel not in used]
        said = [*notes_of(readings, table), *notes]
        if left_out:
            said.append("channels left out: " + ", ".join(dict.fromkeys(left_out[:12])))
        length = len(next(iter(columns.values())))
        # rows of the file are those of the samples only where none was interpolated
        first = groups[0].first_row if len(groups) == 1 and not notes else 0
        rows = first + np.arange(length) if first else np.empty(0, dtype=np.int64)
        label = run_name or path.stem
        return Piece(place, names, label, columns, readings, fields, rows, tuple(said), place)


def _readings(groups: Sequence[Group], question: Question) -> dict[str, Reading]:
    """Channels of our columns; a group that holds all sensors is asked before the others."""
    table = question.table
    candidates = candidates_of(groups, named=len(groups) > 1)
    if len(groups) == 1:
        return readings_of(candidates, question)
    whole = [i for i, group in enumerate(groups) if _is_whole(group, question)]
    if not whole:
        # every raster may have a time of its own; a single one is that of all
        clock = readings_of(candidates, Question(table, question.options), ["time_s"])
        roles = [c.name for c in table.columns if c.name != "time_s" or clock]
        return readings_of(candidates, question, roles)
    inside = [c for c in candidates if c.key[0] == whole[0]]
    outside = [c for c in candidates if c.key[0] != whole[0]]
    found = readings_of(inside, question)
    lacking = [c.name for c in table.columns if c.name not in found and c.name != "time_s"]
    return {**found, **readings_of(outside, question, lacking)}


def _columns(
    groups: Sequence[Group], readings: dict[str, Reading], question: Question
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Values of our columns on one time."""
    taken = {r: _channel(groups, reading) for r, reading in readings.items()}
    values = {
        r: _typed(channel, readings[r], _first_row(groups, readings[r]), question)
        for r, channel in taken.items()
    }
    problems, wrong = question.problems, question.problems.count
    clocks = _Clocks(groups, readings, values, question)
    timed: dict[str, Timed] = {}
    for role, channel in taken.items():
        if role == "time_s":
            continue
        clock = clocks.of(*readings[role].candidate.key)
        if clock is None:
            question.complain(f"there is no time for {channel.name}")
        elif len(clock) != len(values[role]):
            question.complain(
                f"{channel.name} has {len(values[role])} samples, its time {len(clock)}"
            )
        else:
            timed[role] = Timed(channel.name, values[role], clock)
    if problems.count > wrong or not timed:
        return {}, []
    columns, time, notes = aligned(timed, question.kind, question.place, problems)
    return {**columns, "time_s": time}, notes


def _channel(groups: Sequence[Group], reading: Reading) -> Channel:
    g, c = reading.candidate.key
    channel: Channel = groups[g].channels[c]
    return channel


def _first_row(groups: Sequence[Group], reading: Reading) -> int:
    return groups[reading.candidate.key[0]].first_row


class _Clocks:
    """The time of every channel [s]: a channel of its group, the format's, or that of the file."""

    def __init__(
        self,
        groups: Sequence[Group],
        readings: dict[str, Reading],
        values: dict[str, np.ndarray],
        question: Question,
    ) -> None:
        self.groups = groups
        self.shared = readings.get("time_s")
        self.raw = values.get("time_s")
        # the file's own words alone: what the config names for the time was looked for before
        self.question = replace(question, options=ReadOptions())
        self.known: dict[int, np.ndarray | None] = {}

    def of(self, g: int, c: int) -> np.ndarray | None:
        """Time of a channel of a group."""
        if self.shared is not None and self.shared.candidate.key[0] == g:
            return self._shared()
        own = self.groups[g].channels[c].time_s
        if own is not None:
            return own
        if g not in self.known:
            self.known[g] = self._in_group(g)
        return self.known[g]

    def _shared(self) -> np.ndarray | None:
        if self.raw is None or self.shared is None:
            return None
        by = self.shared.conversion
        return (self.raw + by.shift) * by.factor

    def _in_group(self, g: int) -> np.ndarray | None:
        candidates = candidates_of([self.groups[g]], named=False)
        found = readings_of(candidates, self.question, ["time_s"])
        if "time_s" not in found:
            return self._shared()
        channel = self.groups[g].channels[found["time_s"].candidate.key[1]]
        return None if channel.is_text else channel.values * found["time_s"].conversion.factor


def _typed(channel: Channel, reading: Reading, first: int, question: Question) -> np.ndarray:
    """Values of a channel with the type of our column."""
    if question.table.column(reading.role).dtype == "string":
        return _labels(channel.values)
    if not channel.is_text:
        return np.asarray(channel.values, dtype=float)
    numbers = np.full(len(channel.values), np.nan)
    for i, text in enumerate(channel.values):
        if text is None:
            continue
        if is_number(str(text).strip()):
            numbers[i] = float(str(text).strip().replace(",", "."))
        else:
            where = (
                f"{question.place}:{first + i}" if first else f"{question.place}, sample {i + 1}"
            )
            question.problems.add(
                f'{where}: {reading.shown} = "{str(text)[:40]}", must be a number', i + 1
            )
    return numbers


def _labels(values: np.ndarray) -> np.ndarray:
    labels = np.empty(len(values), dtype=object)
    for i, value in enumerate(values):
        if isinstance(value, (float, np.floating)):
            whole = float(value).is_integer()
            labels[i] = None if value != value else str(int(value) if whole else float(value))
        else:
            labels[i] = None if value is None else str(value).strip() or None
    return labels

"""Read groups of channels of a bench file into raw tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import PurePath

import numpy as np

from beltid.bench.channels.alignment import Timed, aligned
from beltid.bench.channels.channel_mapping import (
    Candidate,
    ChannelMapping,
    MappingContext,
    RawTable,
    are_recordings,
    is_whole,
    map_channels,
    notes_of,
    stated_elsewhere,
)
from beltid.bench.channels.text_tables import check_header, convert
from beltid.bench.formats.bench_file import BenchFile, Channel, Group
from beltid.bench.formats.clock import Clock, written_as
from beltid.bench.formats.dialect import side_by_side, without_position
from beltid.bench.formats.numbers import NumberSigns, first_no_number, numbers_or_problems
from beltid.bench.formats.rows import Texts, word_of
from beltid.bench.read_options import ReadOptions
from beltid.errors import PlaceOf
from beltid.tables.values import absent


def candidates_of(groups: Sequence[Group], *, named: bool) -> list[Candidate]:
    """Return the channels of groups as candidates for our columns."""
    return [
        Candidate(
            channel.name,
            channel.unit,
            (g, c),
            group.name if named else "",
            written_as(channel.first_texts()),
            channel.scaling,
            first_no_number(channel.first_texts()),
        )
        for g, group in enumerate(groups)
        for c, channel in enumerate(group.channels)
    ]


def read_groups(file: BenchFile, context: MappingContext) -> list[RawTable]:
    """Read the columns of a table from the groups of a file.

    Each group with all sensors is a run. Groups that complement each other are the rasters of one
    recording.

    Parameters
    ----------
    file : BenchFile
        Contents of the file.
    context : MappingContext
        Columns needed.
    """
    file = replace(file, groups=tuple(p for group in file.groups for p in _parts(group, context)))
    whole = [_is_whole(group, context) for group in file.groups]
    notes = list(file.notes)
    runs: list[tuple[Sequence[Group], str | None]] = [(file.groups, None)]
    if sum(whole) > 1:
        runs = [([g], g.name) for g, is_run in zip(file.groups, whole, strict=True) if is_run]
        other = [g.name for g, is_run in zip(file.groups, whole, strict=True) if not is_run]
        if other:
            notes.append("groups left out: " + ", ".join(other[:12]))
    raw_tables = [
        raw for groups, name in runs if (raw := _raw(file, groups, name, context)) is not None
    ]
    if raw_tables and notes:
        raw_tables[0] = replace(raw_tables[0], notes=(*notes, *raw_tables[0].notes))
    elif not raw_tables:  # the missing columns may be among those left out
        for note in notes:
            context.complain(note)
    return raw_tables


def _is_whole(group: Group, context: MappingContext) -> bool:
    return is_whole(candidates_of([group], named=True), context)


def _parts(group: Group, context: MappingContext) -> list[Group]:
    """Split a group into recordings that are side by side in it, if any."""
    parts = []
    for number, indices in enumerate(side_by_side([c.name for c in group.channels]), start=1):
        channels = [group.channels[i] for i in indices]
        filled = np.flatnonzero(np.any([~absent(c.values) for c in channels], axis=0))
        last = int(filled[-1]) + 1 if filled.size else 0
        shorter = tuple(
            Channel(without_position(c.name), c.unit, c.values[:last]) for c in channels
        )
        name = f"{group.name or PurePath(context.place).stem}-{number}"
        parts.append(Group(name, shorter, group.fields, group.first_row))
    if not parts:
        return [group]
    whole, *of_parts = (candidates_of([g], named=True) for g in (group, *parts))
    return parts if are_recordings(of_parts, whole, context) else [group]


def _raw(
    file: BenchFile, groups: Sequence[Group], run_name: str | None, context: MappingContext
) -> RawTable | None:
    """Read the columns of groups that form one run or recording; None if something is wrong."""
    name, table, problems = context.place, context.table, context.problems
    place = f"{name}, {run_name}" if run_name else name
    wrong = problems.count
    context = replace(context, place=place)
    mappings = _mappings(groups, context)
    fields = (*file.fields, *(f for group in groups for f in group.fields))
    path = PurePath(name)
    names: tuple[str, ...] = (path.name, path.stem)
    if run_name:
        names = (f"{path.name}/{run_name}", run_name, *names)
    channels = [channel.name for group in groups for channel in group.channels]
    clocked = any(c.time_s is not None for group in groups for c in group.channels)
    if problems.count == wrong:
        not_needed = stated_elsewhere(context.options.runs, fields, table)
        not_needed |= {"time_s"} if clocked or len(groups) > 1 else set()
        check_header(channels, context, mappings, not_needed)
    if problems.count > wrong:
        return None
    columns, notes, clock_notes = _columns(groups, mappings, context)
    if problems.count > wrong:
        return None
    convert(columns, {r: mapping for r, mapping in mappings.items() if r != "time_s"})
    all_notes = (*notes_of(mappings, table, channels), *notes, *clock_notes)
    length = len(next(iter(columns.values())))
    # the rows of the file match the samples only if none was interpolated
    first = groups[0].first_row if len(groups) == 1 and not notes else 0
    rows = first + np.arange(length) if first else np.empty(0, dtype=np.int64)
    label = run_name or path.stem
    return RawTable(place, names, label, columns, mappings, fields, rows, all_notes, place)


def _mappings(groups: Sequence[Group], context: MappingContext) -> dict[str, ChannelMapping]:
    """Map channels to our columns; a group with all sensors comes before the others."""
    table = context.table
    candidates = candidates_of(groups, named=len(groups) > 1)
    if len(groups) == 1:
        return map_channels(candidates, context)
    whole = [i for i, group in enumerate(groups) if _is_whole(group, context)]
    if not whole:
        # every raster may have its own time channel; a single one applies to all
        clock = map_channels(candidates, MappingContext(table, context.options), ["time_s"])
        roles = [c.name for c in table.columns if c.name != "time_s" or clock]
        return map_channels(candidates, context, roles)
    inside = [c for c in candidates if c.key[0] == whole[0]]
    outside = [c for c in candidates if c.key[0] != whole[0]]
    mappings = map_channels(inside, context)
    lacking = [c.name for c in table.columns if c.name not in mappings and c.name != "time_s"]
    return {**mappings, **map_channels(outside, context, lacking)}


def _columns(
    groups: Sequence[Group], mappings: dict[str, ChannelMapping], context: MappingContext
) -> tuple[dict[str, np.ndarray], list[str], list[str]]:
    """Return our columns at common times, notes on interpolation and notes on clock times."""
    channels = {r: _channel(groups, mapping.candidate) for r, mapping in mappings.items()}
    values = {
        r: _typed(channel, mappings[r], _first_row(groups, mappings[r]), context)
        for r, channel in channels.items()
        if not mappings[r].is_clock
    }
    problems, wrong = context.problems, context.problems.count
    if "time_s" not in context.table.names:
        if len({len(column) for column in values.values()}) > 1:
            context.complain("the columns have different lengths")
        return values, [], []
    clocks = _Clocks(groups, mappings, values, context)
    label = context.table.label
    timed: dict[str, Timed] = {}
    for role, channel in channels.items():
        if role == "time_s":
            continue
        clock = clocks.of(*mappings[role].candidate.key)
        if clock is None:
            context.complain(f"there is no time for {channel.name}")
        elif len(clock) != len(values[role]):
            context.complain(
                f"{channel.name} has {len(values[role])} samples, its time {len(clock)}"
            )
        else:
            timed[role] = Timed(channel.name, values[role], clock)
    if problems.count > wrong or not timed:
        return {}, [], []
    columns, time, notes = aligned(timed, context.kind, context.place, problems)
    if clocks.clock.first and problems.count == wrong:
        runs = Texts.of(columns[label]).codes if label in columns else None
        time = clocks.clock.elapsed(time, clocks.place(0), problems, runs)
    return {**columns, "time_s": time}, notes, clocks.clock.notes()


def _channel(groups: Sequence[Group], candidate: Candidate) -> Channel:
    g, c = candidate.key
    channel: Channel = groups[g].channels[c]
    return channel


def _first_row(groups: Sequence[Group], mapping: ChannelMapping) -> int:
    return groups[mapping.candidate.key[0]].first_row


class _Clocks:
    """Time of every channel [s]: from its group, from the format, or shared by the file."""

    def __init__(
        self,
        groups: Sequence[Group],
        mappings: dict[str, ChannelMapping],
        values: dict[str, np.ndarray],
        context: MappingContext,
    ) -> None:
        self.groups, self.mappings, self.values = groups, mappings, values
        self.context = context
        self.clock = Clock("")
        """Reads all clock times of the file, so that they count from the same midnight."""
        self.chosen: dict[int, ChannelMapping | None] = {}
        self.times: dict[int, np.ndarray] = {}

    def of(self, g: int, c: int) -> np.ndarray | None:
        """Return the time of a channel of a group."""
        shared = self.mappings.get("time_s")
        is_of_group = shared is not None and shared.candidate.key[0] == g
        own = self.groups[g].channels[c].time_s
        if own is not None and not is_of_group:
            return own
        if g not in self.chosen:
            self.chosen[g] = (None if is_of_group else self._in_group(g)) or shared
        mapping = self.chosen[g]
        return None if mapping is None else self._time_of(mapping)

    def place(self, g: int) -> PlaceOf:
        """Return the function that names the samples of a group in messages."""
        return places(self.context.place, self.groups[g].first_row)

    def _in_group(self, g: int) -> ChannelMapping | None:
        """Find the time among the channels of a group by the words in the file alone.

        The name in the config has been searched for before.
        """
        candidates = [c for c in candidates_of(self.groups, named=False) if c.key[0] == g]
        context = replace(self.context, options=ReadOptions())
        return map_channels(candidates, context, ["time_s"]).get("time_s")

    def _time_of(self, mapping: ChannelMapping) -> np.ndarray:
        g = mapping.candidate.key[0]
        if g not in self.times:
            if mapping.is_clock:
                self.times[g] = self._clock_times(mapping)
            elif mapping is self.mappings.get("time_s"):
                self.times[g] = mapping.conversion.apply(self.values["time_s"])
            else:
                channel = _channel(self.groups, mapping.candidate)
                first = _first_row(self.groups, mapping)
                self.times[g] = mapping.conversion.apply(
                    _typed(channel, mapping, first, self.context)
                )
        return self.times[g]

    def _clock_times(self, mapping: ChannelMapping) -> np.ndarray:
        """Convert clock times to seconds since the midnight before the first one in the file."""
        import pyarrow as pa

        g, problems, label = (
            mapping.candidate.key[0],
            self.context.problems,
            self.context.table.label,
        )
        self.clock.name = mapping.candidate.name
        times = _channel(self.groups, mapping.candidate).values
        dates = None if mapping.date is None else _channel(self.groups, mapping.date).values
        seconds, wrong = self.clock.read(
            pa.array(times, pa.string()), None if dates is None else pa.array(dates, pa.string())
        )
        self.clock.report_wrong(wrong, times, self.place(g), problems)
        has_label = label in self.mappings and self.mappings[label].candidate.key[0] == g
        runs = Texts.of(self.values[label]).codes if has_label else None
        return self.clock.elapsed(seconds, self.place(g), problems, runs, from_first=False)


def _typed(
    channel: Channel, mapping: ChannelMapping, first: int, context: MappingContext
) -> np.ndarray:
    """Return the values of a channel in the data type of our column."""
    if context.table.column(mapping.role).dtype == "string":
        return Texts.of(map(word_of, channel.values)).objects()
    if not channel.is_text:
        return np.asarray(channel.values, dtype=float)
    signs = NumberSigns.of(
        channel.first_texts(), context.options.dialect.decimal, context.options.dialect.thousands
    )
    place = places(context.place, first)
    return numbers_or_problems(channel.values, signs, mapping.shown, place, context.problems)


def places(name: str, first_row: int) -> PlaceOf:
    """Return the function that names samples in messages; `first_row` is 0 if there are no rows."""
    if first_row:
        return lambda i: (f"{name}:{first_row + i}", first_row + i)
    return lambda i: (f"{name}, sample {i + 1}", i + 1)

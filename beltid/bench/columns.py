"""Tables of a file -> our columns in our units at common times."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import pandas as pd

from beltid.bench.clock import DAY_S, Clock
from beltid.bench.mapping import (
    Channel,
    Found,
    Needs,
    channels_of,
    is_whole,
    mapped,
    notes_of,
    refuse_missing,
)
from beltid.bench.numbers import numbers_of, words_of
from beltid.bench.options import ReadOptions
from beltid.bench.raw import Field, Raw, is_text
from beltid.errors import Problems
from beltid.tables.schemas import SETTINGS
from beltid.tables.units import Conversion
from beltid.tables.values import absent

MASTERS: Final = {
    "press": ("force_N", "displacement_mm"),
    "rig": (
        *("tension_tight_N", "tension_slack_N", "torque_N_m", "hub_force_N"),
        "pulley_speed_rad_s",
    ),
    "speedloss": ("driver_speed_rad_s", "driven_speed_rad_s", "torque_N_m"),
}
"""Kind of recording -> channels that determine the result; the first one gives the time."""
MAX_RATE_RATIO: Final = 20.0
"""Largest ratio of rates at which two of these channels may still record one event."""
MIN_OVERLAP: Final = 5
"""Fewest samples of the master in the time that all channels share."""


@dataclass(frozen=True, slots=True)
class Part:
    """A recording, or one run of it, in our columns.

    Attributes
    ----------
    place : str
        File, and group in it.
    raw : Raw
        The table that gives the places of the samples.
    columns : dict of str to ndarray
        Our columns that were found, in our units.
    found : dict of str to Found
        How they were read.
    label : str
        Label of the run, if no column holds any.
    names : tuple of str
        Names by which patterns and tables of runs know it, the most specific first.
    fields : tuple of Field
        Entries of the header.
    notes : list of str
        Notes for the user.
    rows : ndarray or None
        Rows of the table that are samples; None: all of them.
    """

    place: str
    raw: Raw
    columns: dict[str, np.ndarray]
    found: dict[str, Found]
    label: str = ""
    names: tuple[str, ...] = ()
    fields: tuple[Field, ...] = ()
    notes: list[str] = field(default_factory=list)
    rows: np.ndarray | None = None

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def at(self, sample: int) -> tuple[str, int]:
        """Return the place of a sample for messages, and its line to sort them."""
        return self.raw.at(sample if self.rows is None else int(self.rows[sample]))


def read_part(
    raws: Sequence[Raw], needs: Needs, place: str, elsewhere: Collection[str] = ()
) -> Part | None:
    """Read our columns from the tables of one recording; None if something is wrong.

    Parameters
    ----------
    raws : sequence of Raw
        The tables: one, or several that complement each other.
    needs : Needs
        Columns needed; collects the problems.
    place : str
        File, and group in it.
    elsewhere : collection of str
        Our columns that are stated outside the columns.
    """
    problems, wrong = needs.problems, needs.problems.count
    channels, first = channels_of(raws), raws[0]
    units_place = first.units_place if len(raws) == 1 else place
    found = _found(raws, channels, needs, units_place)
    if problems.count == wrong:
        timed = any(raw.times is not None for raw in raws) or len(raws) > 1
        stated = {*elsewhere, *(["time_s"] if timed else [])}
        refuse_missing(channels, found, needs, first.head if len(raws) == 1 else place, stated)
    if problems.count > wrong:
        return None
    reader = _Reader(raws, found, needs, place)
    columns, rows, notes = reader.columns()
    for raw in raws:
        problems.take(raw.problems)
    if problems.count > wrong and not columns:
        return None
    notes = [
        *(note for raw in raws for note in raw.notes),
        *notes_of(found, needs.table, channels),
        *notes,
        *reader.clock.notes(),
    ]
    fields = tuple(dict.fromkeys(f for raw in raws for f in raw.fields))
    # without the tables, whose memory is free once the columns are used up
    main = first.bare() if len(raws) == 1 else Raw(place, pd.DataFrame())
    bare = {id(raw): raw.bare() for raw in raws}
    found = {
        role: replace(f, channel=replace(f.channel, raw=bare[id(f.channel.raw)]))
        for role, f in found.items()
    }
    return Part(place, main, columns, found, fields=fields, notes=notes, rows=rows)


def _found(
    raws: Sequence[Raw], channels: Sequence[Channel], needs: Needs, place: str
) -> dict[str, Found]:
    """Map channels to our columns; a table with all sensors comes before the others."""
    if len(raws) == 1:
        return mapped(channels, needs, place)
    names = [c.name for c in needs.table.columns]
    whole = [raw for raw in raws if is_whole([c for c in channels if c.raw is raw], needs)]
    if not whole:
        # every raster may have its own time channel; a single one applies to all
        silent = Needs(needs.table, needs.options)
        shared = mapped(channels, silent, place, ["time_s"])
        return mapped(channels, needs, place, [n for n in names if n != "time_s" or shared])
    inside = [c for c in channels if c.raw is whole[0]]
    found = mapped(inside, needs, place)
    lacking = [n for n in names if n not in found and n != "time_s"]
    return found | mapped([c for c in channels if c.raw is not whole[0]], needs, place, lacking)


class _Reader:
    """Reader of the values and times of a recording."""

    def __init__(
        self, raws: Sequence[Raw], found: dict[str, Found], needs: Needs, place: str
    ) -> None:
        self.raws, self.found, self.needs, self.place = raws, found, needs, place
        self.problems, self.clock = needs.problems, Clock()
        self.main = raws[0]

    def columns(self) -> tuple[dict[str, np.ndarray], np.ndarray | None, list[str]]:
        """Return our columns, the rows of the table that they are (None: all), and notes."""
        wrong, table = self.problems.count, self.needs.table
        values = {role: self._values(f) for role, f in self.found.items() if role != "time_s"}
        if "time_s" not in table.names:
            if len({len(v) for v in values.values()}) > 1:
                self.problems.add(f"{self.place}: the columns have different lengths")
                return {}, None, []
            return *self._filled(values), []
        times = {}
        for raw in {id(f.channel.raw): f.channel.raw for f in self.found.values()}.values():
            times[id(raw)] = self._time(raw)
        timed: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        for role, column in values.items():
            channel = self.found[role].channel
            time = times[id(channel.raw)]
            if time is None or len(time) != len(column):
                what = "no time" if time is None else f"a time of {len(time)} samples"
                self.problems.add(f"{self.place}: there is {what} for {channel.name}")
            else:
                timed[role] = column, time
        if not timed or (self.problems.count > wrong and len(timed) < len(values)):
            return {}, None, []
        names = {role: self.found[role].channel.name for role in timed}
        columns, notes = aligned(timed, names, table.kind, self.place, self.problems)
        if not columns:
            return {}, None, []
        columns, rows = self._filled(columns) if len(self.raws) == 1 else (columns, None)
        if self.clock.first:
            runs = columns.get(table.label)
            codes = pd.factorize(runs)[0] if runs is not None else np.zeros(len(columns["time_s"]))
            part = Part(self.place, self.main, columns, {}, rows=rows)
            columns["time_s"] = self.clock.elapsed(columns["time_s"], codes, part.at, self.problems)
        return columns, rows, notes

    def _filled(
        self, columns: dict[str, np.ndarray]
    ) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
        """Leave out the rows in which all of our columns are empty."""
        empty = np.ones(len(next(iter(columns.values()), ())), dtype=bool)
        for role, values in sorted(columns.items(), key=lambda item: item[1].dtype == object):
            if empty.any() and not (role == "time_s" and "time_s" not in self.found):
                empty &= absent(values)
        if not empty.any() or not columns:
            return columns, None
        rows = np.flatnonzero(~empty)
        return {role: values[rows] for role, values in columns.items()}, rows

    def _values(self, found: Found) -> np.ndarray:
        """Return a channel in the type and unit of our column."""
        raw, column = found.channel.raw, found.channel.raw.frame[found.channel.name]
        if self.needs.table.column(found.role).dtype == "string":
            return words_of(column)
        if is_text(column):
            signs = raw.signs
            numbers = numbers_of(column, signs, found.shown, raw.at, self.problems)
        else:
            numbers = column.to_numpy()
        return numbers if found.by == Conversion(1.0) else found.by.apply(numbers)

    def _time(self, raw: Raw) -> np.ndarray | None:
        """Return the times of a table [s]: of its channel, of the format, or shared by all."""
        shared = self.found.get("time_s")
        if shared is not None and shared.channel.raw is raw:
            return self._time_of(shared)
        if raw.times is not None:
            return raw.times
        own = Needs(self.needs.table, ReadOptions())
        inside = mapped([c for c in channels_of([raw]) if c.name], own, self.place, ["time_s"])
        if "time_s" in inside:
            return self._time_of(inside["time_s"])
        return None if shared is None else self._time_of(shared)

    def _time_of(self, found: Found) -> np.ndarray:
        if not found.is_clock:
            return self._values(found)
        raw, date = found.channel.raw, found.date
        times = raw.frame[found.channel.name]
        dates = None if date is None else raw.frame[date.name]
        seconds = self.clock.read(times, dates, raw.at, self.problems)
        if len(self.raws) > 1 and not self.clock.dated:  # rasters are aligned across midnight
            seconds = seconds + DAY_S * np.cumsum(
                np.diff(seconds, prepend=seconds[:1]) < -DAY_S / 2
            )
        return seconds


def aligned(
    channels: Mapping[str, tuple[np.ndarray, np.ndarray]],
    names: Mapping[str, str],
    kind: str,
    place: str,
    problems: Problems,
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Interpolate all channels linearly to the times of the master.

    Only the time that the sensors of `MASTERS` share is kept. Other channels are missing outside
    the time they cover; nothing is extrapolated. A missing sample stays missing.

    Parameters
    ----------
    channels : mapping of str to (ndarray, ndarray)
        Our columns without the time -> values and times [s], shape (n,) each.
    names : mapping of str to str
        Our columns -> names in the file.
    kind : str
        Kind of recording.
    place : str
        File or group, for messages.
    problems : Problems
        Collects the reasons why channels cannot be aligned.
    """
    masters = MASTERS.get(kind, ())
    first = next(role for role in (*masters, *channels) if role in channels)
    clock = channels[first][1]
    others = [role for role, (_, time) in channels.items() if not _same(time, clock)]
    if not others:
        return {**{r: values for r, (values, _) in channels.items()}, "time_s": clock}, []
    wrong = problems.count
    for role in (first, *others):
        time = channels[role][1]
        if not np.all(np.isfinite(time)) or np.any(np.diff(time) <= 0) or time.size < 2:
            problems.add(
                f"{place}: the time of {names[role]} (time_s) does not increase from sample to "
                "sample, so channels of other rates cannot be aligned with it"
            )
            return {}, []
        ratio = _rate(time) / _rate(clock)
        if role in masters and max(ratio, 1 / ratio) > MAX_RATE_RATIO:
            problems.add(
                f"{place}: {names[role]} has {_rate(time):.4g} samples per second, {names[first]} "
                f"{_rate(clock):.4g}; rates that differ by more than {MAX_RATE_RATIO:g} times are "
                "not aligned"
            )
    bounding = [time for role, (_, time) in channels.items() if role in masters]
    begin, end = max(t[0] for t in bounding), min(t[-1] for t in bounding)
    kept = (clock >= begin) & (clock <= end)
    if kept.sum() < MIN_OVERLAP:
        problems.add(
            f"{place}: the channels share {kept.sum()} samples of time, from {begin:g} to {end:g} "
            f"s; must be at least {MIN_OVERLAP}"
        )
    if problems.count > wrong:
        return {}, []
    shared = clock[kept]
    columns = {
        role: _interpolated(values, time, shared) if role in others else values[kept]
        for role, (values, time) in channels.items()
    }
    shown = ", ".join(f"{names[r]} ({_rate(channels[r][1]):.4g}/s)" for r in others)
    notes = [f"{shown} interpolated linearly to the times of {names[first]} ({_rate(clock):.4g}/s)"]
    if not kept.all():
        notes.append(
            f"{(~kept).sum()} samples outside the time shared by the sensors, {begin:g} to "
            f"{end:g} s, left out"
        )
    return {**columns, "time_s": shared}, notes


def _rate(time: np.ndarray) -> float:
    return 1.0 / float(np.median(np.diff(time)))


def _same(time: np.ndarray, clock: np.ndarray) -> bool:
    if time is clock:
        return True
    if time.shape != clock.shape:
        return False
    step = float(np.median(np.diff(clock))) if clock.size > 1 else 0.0
    return bool(np.all(np.abs(time - clock) <= 1e-6 * step))


def _interpolated(values: np.ndarray, time: np.ndarray, shared: np.ndarray) -> np.ndarray:
    if values.dtype == object:  # a label applies until the next one
        at = np.searchsorted(time, shared, side="right") - 1
        labels: np.ndarray = values[np.maximum(at, 0)]
        return labels
    return np.interp(shared, time, values, left=np.nan, right=np.nan)


def settings_in_head(fields: Sequence[Field], needs: Needs) -> set[str]:
    """Return our settings for which a header field has a known name, or the config names one."""
    from beltid.bench.vocabulary import roles_meant

    kind, stated = needs.table.kind, needs.options.names
    known = {role for f in fields for role in roles_meant(f.name, kind) if role in SETTINGS}
    named = {role for role, name in stated.items() if any(f.name == name for f in fields)}
    return known | {role for role in named if role in (*SETTINGS, needs.table.label)}

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
Timed = dict[str, tuple[np.ndarray, np.ndarray]]
"""Our columns -> values, and their times [s]."""


@dataclass(frozen=True, slots=True)
class Part:
    """A recording, or one run of it, in our columns."""

    place: str  # file, and group in it
    raw: Raw  # gives the places of the samples
    columns: dict[str, np.ndarray]  # those found, in our units
    found: dict[str, Found]  # how they were read
    label: str = ""  # of the run, if no column holds any
    names: tuple[str, ...] = ()  # by which patterns and tables of runs know it
    fields: tuple[Field, ...] = ()  # entries of the header
    notes: list[str] = field(default_factory=list)
    rows: np.ndarray | None = None  # of the table that are samples; None: all

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def at(self, sample: int) -> tuple[str, int]:
        """Return the place of a sample for messages, and its line to sort them."""
        return self.raw.at(sample if self.rows is None else int(self.rows[sample]))


def read_part(
    raws: Sequence[Raw], needs: Needs, place: str, elsewhere: Collection[str] = ()
) -> Part | None:
    """Read our columns from the tables of one recording; None if something is wrong.

    `elsewhere` lists our columns that are stated outside the columns.
    """
    problems, wrong = needs.problems, needs.problems.count
    channels, first, several = channels_of(raws), raws[0], len(raws) > 1
    found = _found(raws, channels, needs, place if several else first.units_place)
    if problems.count == wrong:
        timed = several or first.times is not None
        stated = {*elsewhere, *(["time_s"] if timed else [])}
        refuse_missing(channels, found, needs, place if several else first.head, stated)
    if problems.count > wrong:
        return None
    clock, notes = Clock(), [note for raw in raws for note in raw.notes]
    main = Raw(place, pd.DataFrame()) if several else first
    columns, rows, more = _columns(raws, found, needs, main, clock)
    for raw in raws:
        problems.take(raw.problems)
    if problems.count > wrong and not columns:
        return None
    notes += [*notes_of(found, needs.table, channels), *more, *clock.notes()]
    fields = tuple(dict.fromkeys(f for raw in raws for f in raw.fields))
    # without the tables, whose memory is free once the columns are used up
    bare = {id(raw): raw.bare() for raw in (*raws, main)}
    found = {
        role: replace(f, channel=replace(f.channel, raw=bare[id(f.channel.raw)]))
        for role, f in found.items()
    }
    return Part(place, bare[id(main)], columns, found, fields=fields, notes=notes, rows=rows)


def _found(
    raws: Sequence[Raw], channels: Sequence[Channel], needs: Needs, place: str
) -> dict[str, Found]:
    """Map channels to our columns; a table with all sensors comes before the others."""
    if len(raws) == 1:
        return mapped(channels, needs, place)
    names = [c.name for c in needs.table.columns]
    inside = [[c for c in channels if c.raw is raw] for raw in raws]
    whole = next((own for own in inside if is_whole(own, needs)), None)
    if whole is None:
        # every raster may have its own time channel; a single one applies to all
        shared = mapped(channels, Needs(needs.table, needs.options), place, ["time_s"])
        return mapped(channels, needs, place, [n for n in names if n != "time_s" or shared])
    found = mapped(whole, needs, place)
    lacking = [n for n in names if n not in found and n != "time_s"]
    return found | mapped([c for c in channels if c not in whole], needs, place, lacking)


def _columns(
    raws: Sequence[Raw], found: dict[str, Found], needs: Needs, main: Raw, clock: Clock
) -> tuple[dict[str, np.ndarray], np.ndarray | None, list[str]]:
    """Return our columns, the rows of the table `main` that they are (None: all), and notes."""
    problems, table, wrong, place = needs.problems, needs.table, needs.problems.count, main.place
    values = {role: values_of(f, needs) for role, f in found.items() if role != "time_s"}
    if "time_s" not in table.names:
        return *_filled(values, values), []
    used = {id(f.channel.raw): f.channel.raw for f in found.values()}
    times = {key: _time(raw, found, needs, clock, raws) for key, raw in used.items()}
    timed: Timed = {}
    for role, column in values.items():
        channel = found[role].channel
        time = times[id(channel.raw)]
        if time is None or len(time) != len(column):
            what = "no time" if time is None else f"a time of {len(time)} samples"
            problems.add(f"{place}: there is {what} for {channel.name}")
        else:
            timed[role] = column, time
    if not timed or (problems.count > wrong and len(timed) < len(values)):
        return {}, None, []
    names = {role: found[role].channel.name for role in timed}
    columns, notes = aligned(timed, names, table.kind, place, problems)
    columns, rows = _filled(columns, found) if len(raws) == 1 else (columns, None)
    if clock.first and columns:
        labels = columns.get(table.label, np.zeros(len(columns["time_s"])))
        codes = np.asarray(pd.factorize(labels)[0])
        at = Part(place, main, columns, {}, rows=rows).at
        columns["time_s"] = clock.elapsed(columns["time_s"], codes, at, problems)
    return columns, rows, notes


def _filled(
    columns: dict[str, np.ndarray], written: Collection[str]
) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
    """Leave out the rows in which all of our columns that the file has are empty."""
    empty = np.ones(len(next(iter(columns.values()), ())), dtype=bool)
    for role, values in sorted(columns.items(), key=lambda item: item[1].dtype == object):
        if role in written and empty.any():
            empty &= absent(values)
    if not empty.any() or not columns:
        return columns, None
    rows = np.flatnonzero(~empty)
    return {role: values[rows] for role, values in columns.items()}, rows


def values_of(found: Found, needs: Needs) -> np.ndarray:
    """Return a channel in the type and unit of our column; report what is no number."""
    raw, column = found.channel.raw, found.channel.raw.frame[found.channel.name]
    if needs.table.column(found.role).dtype == "string":
        return words_of(column)
    numbers = column.to_numpy()
    if is_text(column):
        numbers = numbers_of(column, raw.signs, found.shown, raw.at, needs.problems)
    return numbers if found.by == Conversion(1.0) else found.by.apply(numbers)


def _time(
    raw: Raw, found: Mapping[str, Found], needs: Needs, clock: Clock, raws: Sequence[Raw]
) -> np.ndarray | None:
    """Return the times of a table [s]: of its channel, of the format, or shared by all."""
    time = found.get("time_s")
    if time is None or time.channel.raw is not raw:
        if raw.times is not None:
            return raw.times
        own = Needs(needs.table, ReadOptions())
        time = mapped(channels_of([raw]), own, "", ["time_s"]).get("time_s", time)
    if time is None or not time.is_clock:
        return None if time is None else values_of(time, needs)
    of, date = time.channel.raw, time.date
    dates = None if date is None else of.frame[date.name]
    seconds = clock.read(of.frame[time.channel.name], dates, of.at, needs.problems)
    if len(raws) > 1 and not clock.dated:  # rasters are aligned across midnight
        nights = np.diff(seconds, prepend=seconds[:1]) < -DAY_S / 2
        seconds = seconds + DAY_S * np.cumsum(nights)
    return seconds


def aligned(
    channels: Timed, names: Mapping[str, str], kind: str, place: str, problems: Problems
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Interpolate all channels linearly to the times of the master; return columns and notes.

    Only the time that the sensors of `MASTERS` share is kept. Other channels are missing outside
    the time they cover; nothing is extrapolated. A missing sample stays missing.
    """
    masters = MASTERS.get(kind, ())
    first = next(role for role in (*masters, *channels) if role in channels)
    clock = channels[first][1]
    others = [role for role, (_, time) in channels.items() if not _same(time, clock)]
    if not others:
        return {**{r: values for r, (values, _) in channels.items()}, "time_s": clock}, []
    for role in (first, *others):
        time = channels[role][1]
        if time.size < 2 or not np.all(np.diff(time) > 0):
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
            return {}, []
    bounding = [time for role, (_, time) in channels.items() if role in masters]
    begin, end = max(t[0] for t in bounding), min(t[-1] for t in bounding)
    kept = (clock >= begin) & (clock <= end)
    if kept.sum() < MIN_OVERLAP:
        problems.add(
            f"{place}: the channels share {kept.sum()} samples of time, from {begin:g} to {end:g} "
            f"s; must be at least {MIN_OVERLAP}"
        )
        return {}, []
    columns = {
        role: _interpolated(values, time, clock[kept]) if role in others else values[kept]
        for role, (values, time) in channels.items()
    }
    shown = ", ".join(f"{names[r]} ({_rate(channels[r][1]):.4g}/s)" for r in others)
    note = f"{shown} interpolated linearly to the times of {names[first]} ({_rate(clock):.4g}/s)"
    if not kept.all():
        note += f"; {(~kept).sum()} samples outside the time shared by the sensors left out"
    return {**columns, "time_s": clock[kept]}, [note]


def _rate(time: np.ndarray) -> float:
    return 1.0 / float(np.median(np.diff(time)))


def _same(time: np.ndarray, clock: np.ndarray) -> bool:
    if time is clock or time.shape != clock.shape:
        return time is clock
    step = float(np.median(np.diff(clock))) if clock.size > 1 else 0.0
    return bool(np.all(np.abs(time - clock) <= 1e-6 * step))


def _interpolated(values: np.ndarray, time: np.ndarray, shared: np.ndarray) -> np.ndarray:
    if values.dtype == object:  # a label applies until the next one
        at = np.searchsorted(time, shared, side="right") - 1
        labels: np.ndarray = values[np.maximum(at, 0)]
        return labels
    return np.interp(shared, time, values, left=np.nan, right=np.nan)

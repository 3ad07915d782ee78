"""Tables of a file -> our columns in our units at common times."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import pandas as pd

from beltid.bench.mapping import (
    Found,
    Needs,
    channels_of,
    in_groups,
    mapped,
    meant,
    notes_of,
    refuse_missing,
    resolved,
)
from beltid.bench.numbers import DAY_S, Clock, numbers_of, words_of
from beltid.bench.raw import Raw, is_text
from beltid.tables.units import Conversion
from beltid.tables.values import absent

MASTERS: Final = (
    *("force_N", "displacement_mm", "driver_speed_rad_s", "driven_speed_rad_s"),
    *("tension_tight_N", "tension_slack_N", "torque_N_m", "hub_force_N", "pulley_speed_rad_s"),
)
"""Channels that determine the result; the first one gives the time."""
MIN_OVERLAP: Final = 5
"""Fewest samples of the master in the time that all channels share."""


@dataclass(frozen=True, slots=True)
class Part:
    """A recording, or one run of it, in our columns."""

    raw: Raw  # gives the places of the samples
    columns: dict[str, np.ndarray]  # those found, in our units
    found: dict[str, Found]  # how they were read
    label: str = ""  # of the run, if no column holds any
    names: tuple[str, ...] = ()  # by which patterns and tables of runs know it
    notes: list[str] = field(default_factory=list)
    rows: np.ndarray | None = None  # of the table that are samples; None: all

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def at(self, sample: int) -> tuple[str, int]:
        """Return the place of a sample for messages, and its line to sort them."""
        return self.raw.at(sample if self.rows is None else int(self.rows[sample]))


def read_part(raws: Sequence[Raw], needs: Needs, elsewhere: Collection[str] = ()) -> Part | None:
    """Read our columns from the tables of one recording; None if something is wrong.

    `elsewhere` lists our columns that are stated outside the columns.
    """
    problems, wrong, clock = needs.problems, needs.problems.count, Clock()
    times = _times(raws, needs, clock) if len(raws) > 1 else {}
    raws, all_of_them = [raw for raw in raws if id(raw) in times] or raws[:1], channels_of(raws)
    own = {id(time.channel.raw): time.channel.key for time, _ in times.values()}
    channels = [
        c
        for c in (in_groups(all_of_them) if times else all_of_them)
        if id(c.raw) in {*map(id, raws)} and own.get(id(c.raw)) != c.key
    ]
    place = f"{raws[0].place}:{line}" if (line := raws[0].units_line) else raws[0].head
    found = mapped(channels, needs, place)
    first = next((found[role].channel.raw for role in MASTERS if role in found), raws[0])
    if times:
        found["time_s"] = times[id(first)][0]
    if problems.count == wrong:
        refuse_missing(channels, found, needs, raws[0].head, elsewhere)
    if problems.count > wrong:
        return None
    # without the tables, whose memory is free once the columns are used up
    bare = {id(raw): raw.bare() for raw in raws}
    notes = [*dict.fromkeys(note for raw in raws for note in raw.notes)]
    rows: np.ndarray | None
    if times:
        columns, rows = _aligned(found, times, first, needs, notes)
    else:
        columns, rows = _filled({r: values_of(match, needs, clock) for r, match in found.items()})
    for raw in raws:
        problems.take(raw.problems)
    notes += notes_of(found, needs.table, channels)
    kept = {
        role: replace(f, channel=replace(f.channel, raw=bare[id(f.channel.raw)]))
        for role, f in found.items()
    }
    part = Part(bare[id(first)], columns, kept, notes=notes, rows=rows)
    if clock.first:
        labels = columns.get(needs.table.label, np.zeros(len(part)))
        codes = np.asarray(pd.factorize(labels)[0])
        columns["time_s"] = clock.elapsed(columns["time_s"], codes, part.at, problems)
        notes += clock.notes()
    return part


def _filled(columns: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
    """Leave out the rows in which all of our columns that the file has are empty."""
    empty = np.ones(len(next(iter(columns.values()), ())), dtype=bool)
    for values in sorted(columns.values(), key=lambda values: values.dtype == object):
        if empty.any():
            empty &= absent(values)
    if not empty.any() or not columns:
        return columns, None
    rows = np.flatnonzero(~empty)
    return {role: values[rows] for role, values in columns.items()}, rows


def values_of(found: Found, needs: Needs, clock: Clock | None = None) -> np.ndarray:
    """Return a channel in the type and unit of our column; report what is no number."""
    raw, column = found.channel.raw, found.channel.values
    if needs.table.column(found.role).dtype == "string":
        return words_of(column)
    if found.is_clock:
        return (clock or Clock()).read(column, raw.at, needs.problems)
    numbers = column.to_numpy()
    if is_text(column):
        numbers = numbers_of(column, raw.signs, found.shown, raw.at, needs.problems)
    return numbers if found.by == Conversion(1.0) else found.by.apply(numbers)


# --- rasters -------------------------------------------------------------------------------------

Times = dict[int, tuple[Found, np.ndarray]]
"""Table of a raster -> the channel with its times, and these in seconds."""


def _times(raws: Sequence[Raw], needs: Needs, clock: Clock) -> Times:
    """Return the rasters that hold a channel of ours and have a time, if need be one alike."""
    times: Times = {}
    wanted = {id(raw): meant(channels_of([raw]), needs) for raw in raws}
    for raw in raws:
        matches = wanted[id(raw)].pop("time_s", None)
        found = resolved(matches, needs, raw.place) if matches else None
        if found is not None:
            times[id(raw)] = found, values_of(found, needs, clock)
    for raw in raws:
        alike = [time for time in times.values() if len(time[1]) == len(raw.frame)]
        if id(raw) not in times and alike:
            times[id(raw)] = alike[0]
    return {of: time for of, time in times.items() if wanted[of]}


def _aligned(
    found: dict[str, Found], times: Times, first: Raw, needs: Needs, notes: list[str]
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Join the rasters of one recording at the times of the first with one of `MASTERS`.

    Numbers are interpolated linearly. Only the time that the sensors of `MASTERS` share is kept;
    other channels are missing outside the time they cover; nothing is extrapolated.
    """
    place = first.place
    seconds = {of: _past_midnights(time, written) for of, (time, written) in times.items()}
    time = seconds[id(first)]
    masters = [seconds[id(found[r].channel.raw)] for r in MASTERS if r in found] or [time]
    begin, end = max(t[0] for t in masters), min(t[-1] for t in masters)
    kept = (time >= begin) & (time <= end)
    columns, moved, left_out = {"time_s": times[id(first)][1][kept]}, list[str](), list[str]()
    for role in [role for role in found if role != "time_s"]:
        match, own = found[role], seconds[id(found[role].channel.raw)]
        values, name = values_of(match, needs), match.channel.name
        is_same = len(own) == len(time) and np.allclose(own, time, rtol=0, atol=1e-9)
        if not is_same and values.dtype == object:
            left_out.append(name)
            del found[role]
            continue
        if not is_same:
            moved.append(name)
            if not np.all(np.diff(own) > 0):
                needs.problems.add(
                    f"{place}: the time of {match.channel.raw.name} (time_s) does not increase "
                    "from sample to sample, so its channels cannot be aligned with those of others"
                )
            values = np.interp(time, own, values, left=np.nan, right=np.nan)
        columns[role] = values[kept]
    if kept.sum() < MIN_OVERLAP:
        needs.problems.add(
            f"{place}: the channels share {kept.sum()} samples of time, from {begin:g} to {end:g} "
            f"s; must be at least {MIN_OVERLAP}"
        )
    notes += [f"{', '.join(moved)} interpolated linearly to the other times"] if moved else []
    notes += [f"{', '.join(left_out)} left out: no numbers"] if left_out else []
    if not kept.all():
        notes.append(f"{(~kept).sum()} samples outside the time shared by the sensors left out")
    return columns, np.flatnonzero(kept)


def _past_midnights(time: Found, seconds: np.ndarray) -> np.ndarray:
    """Return clock times that go on past midnight."""
    nights = np.diff(seconds, prepend=seconds[:1]) < -DAY_S / 2
    return seconds + DAY_S * np.cumsum(nights) if time.is_clock else seconds

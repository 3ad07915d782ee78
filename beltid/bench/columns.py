"""Tables of a file -> our columns in our units at common times."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import pandas as pd

from beltid.bench.mapping import Found, Needs, channels_of, mapped, meant, notes_of, refuse_missing
from beltid.bench.numbers import DAY_S, Clock, is_number, numbers_of, words_of
from beltid.bench.raw import Raw, first_texts, is_text
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


def read_part(raw: Raw, needs: Needs, elsewhere: Collection[str] = ()) -> Part | None:
    """Read our columns from the table of one recording; None if something is wrong.

    `elsewhere` lists our columns that are stated outside the columns.
    """
    problems, wrong = needs.problems, needs.problems.count
    channels = channels_of([raw])
    found = mapped(channels, needs, raw.units_place)
    if problems.count == wrong:
        refuse_missing(channels, found, needs, raw.head, elsewhere)
    if problems.count > wrong:
        return None
    clock = Clock()
    columns = {role: values_of(match, needs, clock) for role, match in found.items()}
    problems.take(raw.problems)
    # without the table, whose memory is free once the columns are used up
    bare = raw.bare()
    notes = [*raw.notes, *notes_of(found, needs.table, channels)]
    kept = {r: replace(f, channel=replace(f.channel, raw=bare)) for r, f in found.items()}
    columns, rows = _filled(columns)
    part = Part(bare, columns, kept, notes=notes, rows=rows)
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
    raw, column = found.channel.raw, found.channel.raw.frame[found.channel.name]
    if needs.table.column(found.role).dtype == "string":
        return words_of(column)
    if found.is_clock:
        return (clock or Clock()).read(column, raw.at, needs.problems)
    numbers = column.to_numpy()
    if is_text(column):
        numbers = numbers_of(column, raw.signs, found.shown, raw.at, needs.problems)
    return numbers if found.by == Conversion(1.0) else found.by.apply(numbers)


def together(raws: Sequence[Raw], needs: Needs) -> Raw:
    """Join the rasters of one recording at the times of the one with the first of `MASTERS`.

    Numbers are interpolated linearly. Only the time that the sensors of `MASTERS` share is kept;
    other channels are missing outside the time they cover; nothing is extrapolated.
    """
    if len(raws) == 1:
        return raws[0]
    place, wrong = raws[0].place, needs.problems.count
    raws = [replace(raw, groups=dict.fromkeys(map(str, raw.frame), raw.name)) for raw in raws]
    roles = [meant(channels_of([raw]), needs) for raw in raws]
    wanted = [{f.channel.name for fs in of.values() for f in fs} for of in roles]
    times = {k: v for k, v in _times(raws, needs).items() if wanted[k] - {v[0]}}
    masters = [k for role in MASTERS for k in times if role in roles[k]]
    if not times or needs.problems.count > wrong:
        return raws[0]
    first = next(iter(masters or times))
    clock = times[first][1]
    begin = max(times[k][1][0] for k in masters or [first])
    end = min(times[k][1][-1] for k in masters or [first])
    kept = (clock >= begin) & (clock <= end)
    names = Counter(name for raw in raws for name in raw.frame)
    whole = replace(raws[first], name="", units={}, scaling={}, groups={}, lines=())
    columns, others, left_out = {}, list[str](), list[str]()
    for k, (name_of_time, time) in times.items():
        raw = raws[k]
        is_same = len(time) == len(clock) and np.allclose(time, clock, rtol=0, atol=1e-9)
        if not is_same and not np.all(np.diff(time) > 0):
            needs.problems.add(
                f"{place}: the time of {raw.name} (time_s) does not increase from sample to "
                "sample, so its channels cannot be aligned with those of other rates"
            )
        for name in [*raw.frame] if k == first else sorted(wanted[k] - {name_of_time}):
            is_alone = names[name] == 1 or name == name_of_time
            own = name if is_alone else f"{raw.name}/{name}"
            same = raw.frame[name].to_numpy()
            values = same if is_same else _interpolated(raw, name, time, clock, needs)
            if values is None:
                left_out.append(own)
                continue
            others += [] if is_same else [own]
            columns[own], whole.groups[own] = values[kept], raw.name
            whole.units[own] = raw.units.get(name, "")
            whole.scaling[own] = raw.scaling.get(name, "")
    if kept.sum() < MIN_OVERLAP:
        needs.problems.add(
            f"{place}: the channels share {kept.sum()} samples of time, from {begin:g} to {end:g} "
            f"s; must be at least {MIN_OVERLAP}"
        )
    notes = [f"{', '.join(others)} interpolated linearly to the other times"] if others else []
    notes += [f"{', '.join(left_out)} left out: no numbers"] if left_out else []
    if not kept.all():
        notes.append(f"{(~kept).sum()} samples outside the time shared by the sensors left out")
    fields = tuple(dict.fromkeys(f for raw in raws for f in raw.fields))
    notes = [*dict.fromkeys(n for raw in raws for n in raw.notes), *notes]
    return replace(whole, frame=pd.DataFrame(columns), fields=fields, notes=tuple(notes))


def _times(raws: Sequence[Raw], needs: Needs) -> dict[int, tuple[str, np.ndarray]]:
    """Return the rasters with a time -> its channel and seconds; one time applies to all alike."""
    times, clock = {}, Clock()
    for k, raw in enumerate(raws):
        found = mapped(channels_of([raw]), needs, raw.place, ["time_s"]).get("time_s")
        if found is not None:
            seconds = values_of(found, needs, clock)
            if found.is_clock:  # aligned across midnight
                nights = np.diff(seconds, prepend=seconds[:1]) < -DAY_S / 2
                seconds = seconds + DAY_S * np.cumsum(nights)
            times[k] = found.channel.name, seconds
    for k, raw in enumerate(raws):
        alike = [seconds for _, seconds in times.values() if len(seconds) == len(raw.frame)]
        if k not in times and alike:
            times[k] = "", alike[0]
    return times


def _interpolated(
    raw: Raw, name: str, time: np.ndarray, clock: np.ndarray, needs: Needs
) -> np.ndarray | None:
    """Return a channel at other times, nan outside its own; None if it holds no numbers."""
    column = raw.frame[name]
    numbers = column.to_numpy()
    if is_text(column):
        if not all(map(is_number, first_texts(column)[:1])):
            return None
        numbers = numbers_of(column, raw.signs, name, raw.at, needs.problems)
    return np.interp(clock, time, numbers, left=np.nan, right=np.nan)

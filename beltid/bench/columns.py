"""Columns of a run, in our units: from its tables, else from what is stated outside of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from beltid.bench import cells, mapping
from beltid.bench.mapping import Found, Needs, channels_of, meant, resolved
from beltid.bench.raw import (
    DAY_S,
    Clock,
    Field,
    Raw,
    codes_of,
    is_text,
    numbers_of,
    words_of,
)
from beltid.config.checks import name_pattern, number_in_name
from beltid.errors import Problems
from beltid.tables.schemas import SETTINGS, Column
from beltid.tables.units import CONVERSIONS, Conversion, canonical_unit
from beltid.tables.values import absent, is_missing, shown_value

MASTERS = (  # channels that determine the result; the first one gives the time
    *("force_N", "displacement_mm", "driver_speed_rad_s", "driven_speed_rad_s"),
    *("tension_tight_N", "tension_slack_N", "torque_N_m", "hub_force_N", "pulley_speed_rad_s"),
)
MIN_OVERLAP = 5  # fewest samples of the master in the time that all channels share


@dataclass(frozen=True, slots=True)
class Part:
    """A recording, or one run of it, in our columns."""

    raw: Raw  # gives the places of the samples
    columns: dict[str, np.ndarray]  # those found or stated, in our units
    found: dict[str, Found]  # how they were read
    names: tuple[str, ...]  # by which patterns and tables of runs know it; the second labels it
    notes: list[str] = field(default_factory=list)
    rows: np.ndarray | None = None  # of the table that are samples; None: all

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def at(self, sample: int) -> tuple[str, int]:
        """Return the place of a sample for messages, and its line to sort them."""
        return self.raw.at(sample if self.rows is None else int(self.rows[sample]))


def read_part(raws: Sequence[Raw], needs: Needs, names: tuple[str, ...] = ()) -> Part | None:
    """Read our columns from the tables of one recording, and empty them; None if it fails."""
    problems, wrong, clock = needs.problems, needs.problems.count, Clock(needs.problems)
    times = _times(raws, needs, clock) if len(raws) > 1 else {}
    own = {(id(time.channel.raw), time.channel.key) for time, _ in times.values()}
    named, raws = channels_of(raws), [raw for raw in raws if id(raw) in times] or raws[:1]
    channels = [c for c in named if c.raw in raws and (id(c.raw), c.key) not in own]
    raw, notes = raws[0], [*dict.fromkeys(note for raw in raws for note in raw.notes)]
    place = f"{raw.place}:{raw.units_line}" if raw.units_line else raw.head
    found = mapping.mapped(channels, needs, place)
    first = next((found[role].channel.raw for role in MASTERS if role in found), raw)
    if times:
        found["time_s"] = times[id(first)][0]
    is_mapped, fields = problems.count == wrong, [entry for raw in raws for entry in raw.fields]
    stated = _stated(raw.place, names, found, fields, needs, notes)
    unclear = () if is_mapped else meant(channels, needs)
    mapping.refuse_missing(channels, found, needs, raw.head, {*stated, *unclear})
    if not is_mapped or mapping.lacking(needs.table, {*found, *stated}):
        return None
    columns, rows = (
        _aligned(found, times, first, needs, notes)
        if times
        else _filled({r: values_of(match, needs, clock) for r, match in found.items()})
    )
    notes += mapping.notes_of(found, needs.table, channels)
    for raw in raws:
        for name in [*raw.frame]:
            del raw.frame[name]  # its memory is free
    part, label = Part(first, columns, found, names, notes, rows), needs.table.label
    labels = columns.get(label, np.zeros(len(part)))
    if clock.first:
        columns["time_s"] = clock.elapsed(columns["time_s"], codes_of(labels)[0], part.at)
        notes.append(clock.note)
    is_one = label in stated and "time_s" in needs.table.names
    if is_one and (count := len(codes_of(labels)[1])) > 1:
        problems.add(
            f"{raw.place}: {label} = {stated[label]} is stated for all of it, but its column "
            f"{label} holds {count} labels"
        )
    for role, value in stated.items():
        is_word = isinstance(value, str)
        values = np.full(len(part), value, dtype=object if is_word else float)
        before = columns.get(role, values[:0])
        before = before[~absent(before)]
        differ = before != value if is_word else ~np.isclose(before, value, rtol=1e-6)
        if np.any(differ):
            told = f"{shown_value(value)} as stated replaces {shown_value(before[differ][0])}"
            notes.append(f"{role} = {told} in the recording")
        columns[role] = values
    return part


def _filled(columns: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
    """Leave out the rows in which all of our columns that the file has are empty."""
    numbers_first = sorted(columns.values(), key=lambda values: values.dtype == object)
    empty = np.array(bool(columns))
    for values in numbers_first:
        empty = empty & absent(values) if empty.any() else empty
    if not empty.any():
        return columns, None
    rows = np.flatnonzero(~empty)
    return {role: values[rows] for role, values in columns.items()}, rows


def values_of(found: Found, needs: Needs, clock: Clock | None = None) -> np.ndarray:
    """Return a channel in the type and unit of our column; report what is no number."""
    raw, column = found.channel.raw, found.channel.values
    if needs.table.column(found.role).dtype == "string":
        return words_of(column)
    if found.is_clock:
        return (clock or Clock(needs.problems)).read(column, raw.at)
    numbers = column.to_numpy()
    if is_text(column):
        numbers = numbers_of(column, raw.signs, found.shown, raw.at, needs.problems)
    return numbers if found.by == Conversion(1.0) else found.by.apply(numbers)


# --- stated outside of the columns -------------------------------------------------------------


def _stated(
    place: str,
    names: Sequence[str],
    found: Mapping[str, Found],
    fields: Sequence[Field],
    needs: Needs,
    notes: list[str],
) -> dict[str, Any]:
    """Return label and settings: of all runs, in the name, in the table of runs, in the head."""
    table, told, unknown = needs.table, dict(needs.values), list[str]()
    if needs.pattern is not None:
        pattern = name_pattern(needs.pattern)
        values = next(filter(None, map(pattern.values, names)), {})
        for role in {*values} & {*SETTINGS, table.label} & {*table.names}:
            column, told[role] = table.column(role), values[role]
            unit = pattern.units.get(role, column.unit)
            try:
                if column.dtype != "string":
                    by = CONVERSIONS[column.unit][canonical_unit(unit)]
                    told[role] = by.apply(number_in_name(values[role]))
            except (KeyError, ValueError):
                needs.problems.add(
                    f'{place}: {role} = "{values[role]}" in the name, must be a number in {unit}'
                )
        if not values:
            stated = f'runs.{table.kind}.pattern = "{needs.pattern}"'
            unknown.append(f"{place}: the name does not match {stated}")
    if needs.rows:
        row = next((needs.rows[name] for name in names if name in needs.rows), None)
        told |= row or {}
        unknown += [f"{needs.run_table}: has no row for {names[0]}"] if row is None else []
    needed = {c.name for c in table.columns if c.required and c.name in SETTINGS}
    for problem in () if found.keys() >= {table.label, *needed} else unknown:
        needs.problems.add(problem)
    for role, matches in settings_in_head(fields, needs).items():
        if role not in found and role not in told:
            told |= _of_head(matches, needs, place, notes)
    return {role: value for role, value in told.items() if role in table.names}


def _of_head(
    matches: Sequence[Found], needs: Needs, place: str, notes: list[str]
) -> dict[str, Any]:
    """Return a setting from the fields of the head that the config names, or of known names."""
    silent = replace(needs, problems=Problems())
    values = {
        match.channel.name: values_of(resolved([match], silent, "") or match, silent)[0]
        for match in matches
    }
    role, name, recognised = matches[0].role, next(iter(values)), matches[0].how == "recognised"
    wrong = [problem.removeprefix(", sample 1: ") for _, problem in silent.problems.found]
    if len(set(values.values())) > 1:
        say = needs.say("columns", role, f'"{name}"')
        wrong.append(f"header fields {', '.join(values)} can be {role}, say which: {say}")
    if wrong and recognised and not needs.table.column(role).required:
        return {}
    if wrong:
        needs.problems.add(f"{place}: {wrong[0]}")
    elif recognised:
        notes.append(f"read header field {name} as {role}")
    return {role: np.nan if wrong else values[name]}


def settings_in_head(fields: Sequence[Field], needs: Needs) -> dict[str, list[Found]]:
    """Return our settings -> header fields: of the name in the config, else of known names."""
    found = meant(mapping.channels_of_head(fields, needs.dialect), needs) if fields else {}
    return {
        role: matches
        for role, matches in found.items()
        if role in (*SETTINGS, needs.table.label)
        if matches[0].how == "config" or needs.table.column(role).dtype != "string"
    }


def run_table(of: Needs) -> dict[str, Mapping[str, Any]]:
    """Read the table of runs: name of a file or group -> the values in its row."""
    if of.run_table is None:
        return {}
    told = [c for c in of.table.columns if c.name in (*SETTINGS, of.table.label)]
    file = Column("file", "string", "", "name of the file, or of the group")
    columns = (file, *(replace(column, required=False) for column in told))
    needs, path = Needs(replace(of.table, columns=columns)), of.run_table
    part = read_part([*cells.read_text(path, str(path), needs.dialect, needs.problems)], needs)
    needs.problems.raise_if_any()
    assert part is not None
    rows: dict[str, Mapping[str, Any]] = {}
    for k in range(len(part)):
        row = {role: values[k] for role, values in part.columns.items()}
        if (name := str(row.pop("file") or "")) in rows:
            needs.problems.add(f"{part.at(k)[0]}: {name} is in an earlier line, too")
        rows[name] = {role: cell for role, cell in row.items() if not is_missing(cell)}
    needs.problems.raise_if_any()
    return rows


# --- rasters -------------------------------------------------------------------------------------

Times = dict[int, tuple[Found, np.ndarray]]  # table of a raster -> channel of its times, these [s]


def _times(raws: Sequence[Raw], needs: Needs, clock: Clock) -> Times:
    """Return the rasters that hold a channel of ours and have a time, if need be one alike."""
    times, wanted = Times(), {id(raw): meant(channels_of([raw]), needs) for raw in raws}
    for raw in raws:
        matches = wanted[id(raw)].pop("time_s", ())
        if matches and (found := resolved(matches, needs, raw.place)) is not None:
            times[id(raw)] = found, values_of(found, needs, clock)
    for raw in raws:
        alike = (time for time in times.values() if len(time[1]) == len(raw.frame))
        if id(raw) not in times and (time := next(alike, None)):
            times[id(raw)] = time
    return {of: time for of, time in times.items() if wanted[of]}


def _aligned(
    found: dict[str, Found], times: Times, first: Raw, needs: Needs, notes: list[str]
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Interpolate the rasters at the times of the first sensor that all `MASTERS` share."""
    seconds = {  # clock times go on past midnight
        of: own + DAY_S * np.cumsum(found.is_clock & (np.diff(own, prepend=own[:1]) < -DAY_S / 2))
        for of, (found, own) in times.items()
    }
    time = seconds[id(first)]
    masters = [seconds[id(found[r].channel.raw)] for r in MASTERS if r in found] or [time]
    begin, end = max(t[0] for t in masters), min(t[-1] for t in masters)
    kept = (time >= begin) & (time <= end)
    columns, moved, left_out = {"time_s": times[id(first)][1][kept]}, list[str](), list[str]()
    for role in [role for role in found if role != "time_s"]:
        match = found[role]
        values, own = values_of(match, needs), seconds[id(match.channel.raw)]
        if len(own) == len(time) and np.allclose(own, time, rtol=0, atol=1e-9):
            columns[role] = values[kept]
        elif values.dtype == object:
            left_out.append(match.channel.name)
            del found[role]
        else:
            moved.append(match.channel.name)
            columns[role] = np.interp(time, own, values, left=np.nan, right=np.nan)[kept]
            if not np.all(np.diff(own) > 0):
                needs.problems.add(
                    f"{first.place}: the time of {match.channel.raw.name} (time_s) does not "
                    "increase from sample to sample, so its channels cannot be aligned with those "
                    "of other rates"
                )
    if kept.sum() < MIN_OVERLAP:
        needs.problems.add(
            f"{first.place}: the channels share {kept.sum()} samples of time, from {begin:g} to "
            f"{end:g} s; must be at least {MIN_OVERLAP}"
        )
    notes += [f"{', '.join(moved)} interpolated linearly to the other times"] if moved else []
    notes += [f"{', '.join(left_out)} left out: no numbers"] if left_out else []
    if not kept.all():
        notes.append(f"{(~kept).sum()} samples outside the time shared by the sensors left out")
    return columns, np.flatnonzero(kept)

"""Runs of a recording: their columns in our units, which tables they are, joined, and checked.

A column is found in the tables of a run, else in what is stated outside of them.
"""

import itertools
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import PurePath
from typing import Any

import numpy as np
import pandas as pd

from beltid.bench.cells import read_text
from beltid.bench.mapping import (
    Channel,
    Found,
    Needs,
    channels_of,
    channels_of_head,
    lacking,
    mapped,
    meant,
    notes_of,
    refuse_missing,
    resolved,
)
from beltid.bench.raw import (
    DAY_S,
    POSITION,
    Clock,
    Field,
    Raw,
    codes_of,
    is_text,
    numbers_of,
    roles_meant,
    stretches,
    words_of,
)
from beltid.config.checks import name_pattern, number_in_name
from beltid.errors import PlaceOf, Problems
from beltid.tables.schemas import NOMINAL, RUN_TEXTS, SETTINGS, Column
from beltid.tables.units import CONVERSIONS, Conversion, canonical_unit
from beltid.tables.values import absent, is_missing, outside, shown_value

MASTERS = (  # channels that determine the result; the first one gives the time
    *("force_N", "displacement_mm", "driver_speed_rad_s", "driven_speed_rad_s"),
    *("tension_tight_N", "tension_slack_N", "torque_N_m", "hub_force_N", "pulley_speed_rad_s"),
)
MIN_OVERLAP = 5  # fewest samples of the master in the time that all channels share
RESTART = 0.05  # share of the run before, into which time falls back in a new run
MIN_SAMPLES = 10
PHASE = 5  # fewest consecutive samples of a phase in which the pulley stands or turns
OTHER_RUN = 100.0  # least ratio of the largest run to one in another unit
TRUTHS = {"1": "true", "yes": "true", "ja": "true", "oui": "true"} | dict.fromkeys(
    ("0", "no", "nein", "non"), "false"
)


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
    problems, wrong, clock = needs.problems, len(needs.problems.found), Clock(needs.problems)
    times = _times(raws, needs, clock) if len(raws) > 1 else {}
    own = {(id(time.channel.raw), time.channel.key) for time, _ in times.values()}
    named, raws = channels_of(raws), [raw for raw in raws if id(raw) in times] or raws[:1]
    channels = [c for c in named if c.raw in raws and (id(c.raw), c.key) not in own]
    raw, notes = raws[0], [*dict.fromkeys(note for raw in raws for note in raw.notes)]
    place = f"{raw.place}:{raw.units_line}" if raw.units_line else raw.head
    found = mapped(channels, needs, place)
    first = next((found[role].channel.raw for role in MASTERS if role in found), raw)
    if times:
        found["time_s"] = times[id(first)][0]
    is_mapped = len(problems.found) == wrong
    fields = [entry for raw in raws for entry in raw.fields]
    stated = _stated(raw.place, names, found, fields, needs, notes)
    unclear = () if is_mapped else meant(channels, needs)
    refuse_missing(channels, found, needs, raw.head, {*stated, *unclear})
    if not is_mapped or lacking(needs.table, {*found, *stated}):
        return None
    columns, rows = (
        _aligned(found, times, first, needs, notes)
        if times
        else _filled({r: values_of(match, needs, clock) for r, match in found.items()})
    )
    notes += notes_of(found, needs.table, channels)
    for raw in raws:
        for name in [*raw.frame]:
            del raw.frame[name]  # its memory is free
    part, label = Part(first, columns, found, names, notes, rows), needs.table.label
    labels = columns.get(label, np.zeros(len(part)))
    if clock.first:
        columns["time_s"] = clock.elapsed(columns["time_s"], codes_of(labels)[0], part.at)
        notes.append(f"{clock.name}: seconds are counted from the first, {clock.first}")
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
    if any(x.dtype != object and not absent(x).any() for x in columns.values()):
        return columns, None
    rows = np.flatnonzero(~np.logical_and.reduce([absent(x) for x in columns.values()]))
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
    found = meant(channels_of_head(fields, needs.dialect), needs) if fields else {}
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
    part = read_part([*read_text(path, str(path), needs.dialect, needs.problems)], needs)
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


# --- the tables of a run ------------------------------------------------------------------------


def tables_of_runs(raws: Sequence[Raw], needs: Needs) -> tuple[list[list[Raw]], list[str]]:
    """Return the tables of each run of a file: one with all sensors, else all are of one run."""
    raws = [part for raw in raws for part in _beside(raw, needs)]
    runs = [raw for raw in raws if is_whole(channels_of([raw]), needs)]
    if not runs:  # those with the same channels are runs that lack something
        names, count = Counter(tuple(raw.frame) for raw in raws).most_common(1)[0]
        runs = [raw for raw in raws if tuple(raw.frame) == names]
        if count < 2 or len(names) < 2:
            return [raws], []
    if len(runs) == 1 and all(is_timed(raw, needs.table.kind) for raw in raws):
        return [raws], []
    left_out = ", ".join([raw.name for raw in raws if raw not in runs][:12])
    return [[raw] for raw in runs], [f"groups left out: {left_out}"] if left_out else []


def is_whole(channels: Sequence[Channel], needs: Needs) -> bool:
    """Return whether the channels include all sensors that a run needs, each once."""
    return not lacking(needs.table, [r for r, f in meant(channels, needs).items() if len(f) == 1])


def is_timed(raw: Raw, kind: str) -> bool:
    """Return whether a table has a time."""
    return any("time_s" in (n, *roles_meant(n, kind)) for n in map(str, raw.frame))


def _beside(raw: Raw, needs: Needs) -> list[Raw]:
    """Split a table into recordings side by side in it; a name that occurs once belongs to all."""
    repeated, written = dict[str, list[str]](), [str(name) for name in raw.frame]
    for name in filter(POSITION.search, written):
        repeated.setdefault(POSITION.sub("", name), []).append(name)
    counts, parts = {*map(len, repeated.values())}, []
    if len(repeated) < 2 or len(counts) != 1 or counts == {1}:
        return [raw]
    shared = [name for name in written if not POSITION.search(name)]
    for count, own in enumerate(zip(*repeated.values(), strict=True), start=1):
        frame = raw.frame[[*shared, *own]].dropna(how="all")
        bare = {name: POSITION.sub("", name) for name in (*shared, *own)}
        part = replace(
            raw,
            frame=frame.rename(columns=bare).reset_index(drop=True),
            units={bare[n]: u for n, u in raw.units.items() if n in bare},
            lines=[raw.lines[row] for row in frame.index] if len(raw.lines) else (),
            name=f"{raw.name or PurePath(raw.place).stem}-{count}",
        )
        parts.append(part)
    once = [c for c in channels_of([raw]) if c.name == c.base]
    if is_whole(once, needs) or not all(is_whole(channels_of([part]), needs) for part in parts):
        return [raw]
    return parts


def joined(
    parts: Sequence[Part], needs: Needs
) -> tuple[dict[str, np.ndarray], PlaceOf, list[str], set[str]]:
    """Return the columns of all runs, the place of a sample, notes, the columns of stated units."""
    table, problems, timed = needs.table, needs.problems, "time_s" in needs.table.names
    notes, owners = dict[str, list[str]](), dict[str, str]()
    counts = Counter(part.names[1] for part in parts)
    for part in parts:
        place, known = part.raw.place, part.columns.get(table.label, np.full(len(part), None))
        if not timed:
            numbered = [str(row + 1) if w is None else w for row, w in enumerate(known)]
            part.columns[table.label] = np.array(numbered, dtype=object)
        elif table.label not in part.columns:
            # groups of several files that are named alike are told by their files
            label, file = part.names[1], part.names[-1]
            label = f"{file}/{label}" if counts[label] > 1 and label != file else label
            part.columns[table.label] = _labels(part, label, problems)
        for label in codes_of(part.columns[table.label])[1] if timed else ():
            if (owner := owners.setdefault(label, place)) != place:
                problems.add(f"{place}: {table.label} {label} is already used in {owner}")
        for note in part.notes:
            notes.setdefault(note, []).append(place)
    problems.raise_if_any()
    lengths = [*map(len, parts)]
    ends = np.cumsum(lengths)

    def place_of(sample: int) -> tuple[str, int]:
        """Return the place of a sample in its part."""
        k = int(np.searchsorted(ends, sample, side="right"))
        where, line = parts[k].at(sample - int(ends[k]) + lengths[k])
        return where, line if len(parts) == 1 else sample + 1

    shown = []
    for note, (first, *others) in notes.items():
        more = f" and {len(others)} more" if others else ""
        shown.append(note if len(others) + 1 == len(parts) else f"{first}{more}: {note}")
    stated_units = [{r for r, f in part.found.items() if f.stated} for part in parts]
    present, columns = {name for part in parts for name in part.columns}, dict[str, np.ndarray]()
    for column in table.columns:
        if column.name in present or column.name not in RUN_TEXTS:
            missing, name = np.array([None if column.dtype == "string" else np.nan]), column.name
            pieces = [
                part.columns.pop(name) if name in part.columns else missing.repeat(n)
                for part, n in zip(parts, lengths, strict=True)
            ]
            columns[name] = pieces[0] if len(parts) == 1 else np.concatenate(pieces)
    return columns, place_of, shown, set.intersection(*stated_units)


def _labels(part: Part, label: str, problems: Problems) -> np.ndarray:
    """Label every sample: a run begins where a setting changes or the time restarts."""
    columns, time = part.columns, part.columns["time_s"]
    bounds = [*_starts(columns, time), len(time)]
    names = [f"{label}-{k}" for k in range(1, len(bounds))] if len(bounds) > 2 else [label]
    speed = columns.get("pulley_speed_rad_s", time[:0])
    for name, (first, end) in zip(names, itertools.pairwise(bounds), strict=True):
        if _rotations(speed[first:end][np.isfinite(speed[first:end])]) > 1:
            problems.add(
                f"{part.raw.place}: in run {name} the pulley turns several times with stops "
                "between: add a column of labels"
            )
    if len(names) > 1:
        part.notes.append(
            f"no column labels the runs: {len(names)} separated by changes of the settings and by "
            "restarts of the time"
        )
    return np.array(names, dtype=object).repeat(np.diff(bounds))


def _starts(columns: Mapping[str, np.ndarray], time: np.ndarray) -> list[int]:
    changed, starts = np.zeros(len(time), dtype=bool), [0]
    for values in (columns[name] for name in NOMINAL if name in columns):
        changed[1:] |= np.abs(np.diff(values)) > 1e-6 * np.abs(values[1:])
    for i in np.flatnonzero(changed | (np.diff(time, prepend=time[:1]) < 0)):
        begin = time[starts[-1]]
        # other decreases of time are reported by the checks
        if changed[i] or time[i] <= begin + RESTART * (time[i - 1] - begin):
            starts.append(int(i))
    return starts


def _rotations(speed: np.ndarray) -> int:
    """Count how often the pulley begins to turn: a run has one rotation."""
    if len(speed) < 4 * PHASE:
        return 0
    noise = float(np.median(np.abs(np.diff(speed)))) * 1.05
    turning = np.abs(speed) > max(0.02 * float(np.quantile(np.abs(speed), 0.99)), 6.0 * noise)
    phases = np.split(turning, np.flatnonzero(np.diff(turning)) + 1)
    states = itertools.groupby(bool(phase[0]) for phase in phases if phase.size >= PHASE)
    return [state for state, _ in states].count(True)


# --- checks ---------------------------------------------------------------------------------------


class Checker:
    """Checks of a recording, which fill in settings and bring words to their form."""

    def __init__(
        self, name: str, columns: dict[str, np.ndarray], place: PlaceOf, needs: Needs
    ) -> None:
        self.name, self.columns, self.place, self.needs = name, columns, place, needs
        self.table, self.problems = needs.table, needs.problems
        self.label, self.timed = columns[self.table.label], "time_s" in columns
        self.codes = codes_of(self.label)[0]
        self.begins = stretches(self.codes)

    def run(self, units_stated: Collection[str]) -> list[str]:
        """Run all checks; return notes on what is allowed. Stated units are not questioned."""
        empty = f"{self.table.label} is empty, it must label the recording"
        self._report(self.codes < 0, lambda i: empty)
        present = [column for column in self.table.columns if column.name in self.columns]
        for column in present:
            if column.choices:
                self._choices(column)
            if self.timed and column.name in (*NOMINAL, *RUN_TEXTS):
                self._setting(column.name)
        notes: list[str] = []
        for column in (column for column in present if column.dtype == "float64"):
            if column.name in units_stated or not self._doubts_unit(column):
                notes += self._numbers(column)
        if self.timed:
            self._time()
        return notes

    def _report(self, wrong: np.ndarray, text: Callable[[int], str]) -> None:
        self.problems.add_alike(np.flatnonzero(wrong), text, self.place)

    def _doubts_unit(self, column: Column) -> bool:
        """Report a column, or runs of it, about a thousand times too small or large."""
        values, kind, place = self.columns[column.name], self.table.kind, self.name
        # a few samples of a sensor, most likely of a belt at rest, do not show its unit
        few = self.timed and len(self.codes) < MIN_SAMPLES and column.name not in NOMINAL
        if guess := "" if few else other_unit(column, kind, values):
            self._report_unit(place, column, values, f"if it is in {guess}, say so", guess)
            return True
        is_compared = column.unit in ("N", "mm") and column.name not in NOMINAL
        if not self.timed or not is_compared or not self.codes.any():
            return False
        lows, highs = (of.reduceat(values, self.begins) for of in (np.fmin, np.fmax))
        runs = pd.DataFrame({"low": lows, "high": highs}).groupby(self.codes[self.begins])
        low, high = runs["low"].min(), runs["high"].max()
        size: Any = np.maximum(-low, high) if column.unit == "N" else (high - low) / 2
        for run in size.index[(size > 0.0) & (OTHER_RUN * size < size.max())]:
            rows = np.flatnonzero(self.codes == run)
            guess = other_unit(column, kind, values[rows])
            if guess and not ("idle" in self.columns and "true" in self.columns["idle"][rows]):
                where = f"{place}, {self.table.label} {self.label[rows[0]]}"
                advice = f"is this run alone in {guess}? If it is not, say so"
                self._report_unit(where, column, values[rows], advice, column.unit)
        return False

    def _report_unit(
        self, place: str, column: Column, values: np.ndarray, advice: str, unit: str
    ) -> None:
        span = f"lies between {np.nanmin(values):g} and {np.nanmax(values):g}"
        why = f"not plausible in {column.unit}; {advice}"
        say = self.needs.say("units", column.name, unit)
        self.problems.add(f"{place}: {column.name} {span}, {why}: {say}")

    def _setting(self, name: str) -> None:
        """Fill in a setting that only some rows of a run state; report it if it changes there."""
        values = self.columns[name]
        heads = stretches(self.codes, values)  # what is to be seen shows there
        heads = heads[~absent(values[heads]) & (self.codes[heads] >= 0)]
        codes, cells = self.codes[heads], values[heads]
        nothing = None if values.dtype == object else np.nan
        first = np.full(self.codes.max() + 2, nothing, values.dtype)
        first[codes[::-1]] = cells[::-1]  # the first one is written last
        rows = np.flatnonzero(cells != first[codes])
        if values.dtype != object:
            rows = rows[~np.isclose(cells[rows], first[codes[rows]], rtol=1e-6, atol=0.0)]
        self.problems.add_alike(
            np.sort(heads[rows[np.unique(codes[rows], return_index=True)[1]]]),
            lambda i: (
                f"{name} = {shown_value(values[i])}, must stay "
                f"{shown_value(first[self.codes[i]])} within {self.table.label} {self.label[i]} "
                "(is the label used twice?)"
            ),
            self.place,
        )
        if (missing := absent(values) & (self.codes >= 0)).any():
            self.columns[name] = np.where(missing, first[self.codes], values)

    def _numbers(self, column: Column) -> list[str]:
        """Check the numbers of a column: range, infinite and missing values."""
        values, missing = self.columns[column.name], np.isnan(self.columns[column.name])
        is_force = column.low == 0.0 and column.unit == "N"
        if is_force and np.count_nonzero(values < 0.0) > max(9, 0.5 * values.size):
            self.problems.add(
                f"{self.name}: {column.name} is negative nearly everywhere; if the sign of the "
                "cell is reversed, put a minus before its name in the file: "
                + self.needs.say("columns", column.name, f'"-{column.name}"')
            )
            return []
        extremes = np.array([np.fmin.reduce(values), np.fmax.reduce(values)])
        if np.any(np.isinf(extremes) | outside(extremes, column)):
            self._report(
                np.isinf(values) | outside(values, column),
                lambda i: f"{column.name} = {values[i]:g}, must be {column.allowed}",
            )
        empty = f"{column.name} is empty, must be {column.allowed}"
        if not column.nullable:
            self._report(missing & (self.codes >= 0), lambda i: empty)
        elif missing.all() and column.required:
            self.problems.add(f"{self.name}: {column.name} holds no numbers")
        elif missing.any() and not missing.all():
            return [f"{missing.sum()} of {values.size} samples of {column.name} are missing"]
        return []

    def _choices(self, column: Column) -> None:
        """Check a column that allows certain words only; case does not matter, and 1 is true."""
        truths = TRUTHS if column.choices == ("true", "false") else {}
        codes, words = pd.factorize(self.columns[column.name])
        right = np.array([*(truths.get(w.lower(), w.lower()) for w in words), None], dtype=object)
        self._report(
            np.array([word not in (None, *column.choices) for word in right])[codes],
            lambda i: f"{column.name} = {words[codes[i]]}, must be {column.allowed}",
        )
        self.columns[column.name] = right[codes]

    def _time(self) -> None:
        """Report times that go backwards within a run."""
        time, begins = self.columns["time_s"], self.begins
        last = pd.Series(time[np.append(begins[1:], len(time)) - 1])
        before = np.roll(time, 1)
        before[begins] = last.groupby(self.codes[begins]).shift()
        self._report(
            (time < before) & (self.codes >= 0),
            lambda i: (
                f"time_s = {time[i]:g} after {before[i]:g} in {self.table.label} {self.label[i]}, "
                "must not go backwards (is the label used twice?)"
            ),
        )


def other_unit(column: Column, kind: str, values: np.ndarray) -> str:
    """Return the unit in which the numbers would be plausible, or "" if they are so already.

    Benches record tensions of 20 to 2000 N, forces of 50 to 3000 N, travels of 0.03 to 5 mm.
    """
    is_finite, name = np.isfinite(values), column.name
    finite = values if is_finite.all() else values[is_finite]
    if not finite.size or (kind == "points" and name != "arc_deg"):
        return ""  # tables written by hand, for belts of any size
    low, high = float(finite.min()), float(finite.max())
    largest, travel = max(-low, high), high - low
    is_tension = column.unit == "N" and "tension" in name
    plausible = (
        (is_tension and high > 0.0 and largest < 5.0, "kN"),
        (is_tension and largest > 1e4 and np.median(np.abs(finite)) > 1e4, "mN"),
        (name == "force_N" and largest < 5.0, "kN"),
        (name == "force_N" and largest > 2e4, "mN"),
        (name == "displacement_mm" and 30.0 < travel < 1e6, "um"),
        (name == "displacement_mm" and 0.0 < travel < 5e-3, "m"),
        (name == "torque_N_m" and 0.0 < largest < 0.1, "kN m"),
        (name == "torque_N_m" and largest > 1000.0, "N mm"),
        (name == "arc_deg" and largest < 2 * np.pi, "rad"),
        (name == "temperature_degC" and low > 200.0, "K"),
    )
    return next((unit for holds, unit in plausible if holds), "")

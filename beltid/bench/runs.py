"""Runs of a recording: which tables they are, their labels, all runs joined, and checked."""

import itertools
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import PurePath
from typing import Any

import numpy as np
import pandas as pd

from beltid.bench.columns import Part
from beltid.bench.mapping import Channel, Needs, channels_of, lacking, meant
from beltid.bench.raw import POSITION, Raw, codes_of, roles_meant, stretches
from beltid.errors import PlaceOf, Problems
from beltid.tables.schemas import NOMINAL, RUN_TEXTS, Column
from beltid.tables.values import absent, outside, shown_value

RESTART = 0.05  # share of the run before, into which time falls back in a new run
MIN_SAMPLES = 10
PHASE = 5  # fewest consecutive samples of a phase in which the pulley stands or turns
OTHER_RUN = 100.0  # least ratio of the largest run to one in another unit
TRUTHS = {"1": "true", "yes": "true", "ja": "true", "oui": "true"} | dict.fromkeys(
    ("0", "no", "nein", "non"), "false"
)


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
    problems.merge_repeated([part.raw.place for part in parts])
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

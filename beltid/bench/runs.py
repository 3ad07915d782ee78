"""Runs of a recording: which tables are runs, their labels, their settings from outside columns."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePath
from typing import Any, Final

import numpy as np
import pandas as pd

from beltid.bench import text
from beltid.bench.columns import Part, read_part, values_of
from beltid.bench.mapping import (
    DIALECT,
    Found,
    Needs,
    channels_of,
    channels_of_head,
    how_to_state,
    is_whole,
    meant,
    resolved,
)
from beltid.bench.names import roles_meant, side_by_side, without_position
from beltid.bench.raw import Field, Raw
from beltid.config.checks import name_pattern, number_in_name
from beltid.errors import PlaceOf, Problems
from beltid.tables.schemas import NOMINAL, RUN_TEXTS, SETTINGS, Column, Table
from beltid.tables.units import conversion
from beltid.tables.values import absent, is_missing, shown_value

RESTART: Final = 0.05
"""A new run begins when time falls back into the first part, this share, of the run before."""
MIN_SAMPLES: Final = 10
PHASE: Final = 5
"""Fewest consecutive samples of a phase in which the pulley stands or turns."""


def tables_of_runs(raws: Sequence[Raw], needs: Needs) -> tuple[list[list[Raw]], list[str]]:
    """Return the tables of each run of a file: one with all sensors, else all are of one run.

    Tables with the same channels, none of which has all sensors, are runs that lack something.
    """
    raws = [part for raw in raws for part in _beside(raw, needs)]
    runs = [raw for raw in raws if is_whole(channels_of([raw]), needs)]
    if not runs:
        names, count = Counter(tuple(raw.frame) for raw in raws).most_common(1)[0]
        runs = [raw for raw in raws if tuple(raw.frame) == names]
        if count < 2 or len(names) < 2:
            return [raws], []
    if len(runs) == 1 and all(is_timed(raw, needs.table.kind) for raw in raws):
        return [raws], []
    left_out = ", ".join([raw.name for raw in raws if raw not in runs][:12])
    return [[raw] for raw in runs], [f"groups left out: {left_out}"] if left_out else []


def is_timed(raw: Raw, kind: str) -> bool:
    """Return whether a table has a time."""
    return any("time_s" in (n, *roles_meant(n, kind)) for n in map(str, raw.frame))


def _beside(raw: Raw, needs: Needs) -> list[Raw]:
    """Split a table into the recordings that are side by side in it, if any."""
    parts = []
    stem = raw.name or PurePath(raw.place).stem
    for count, names in enumerate(side_by_side([*raw.frame]), start=1):
        frame = raw.frame[names].dropna(how="all")
        bare = {name: without_position(name) for name in names}
        units = {bare[n]: u for n, u in raw.units.items() if n in bare}
        lines = [raw.lines[row] for row in frame.index] if len(raw.lines) else ()
        frame = frame.rename(columns=bare).reset_index(drop=True)
        parts.append(replace(raw, frame=frame, units=units, lines=lines, name=f"{stem}-{count}"))
    once = [c for c in channels_of([raw]) if c.name == c.base]
    are_whole = all(is_whole(channels_of([part]), needs) for part in parts)
    return parts if parts and are_whole and not is_whole(once, needs) else [raw]


class Settings:
    """Label and settings of runs whose columns do not hold them.

    They are in the head of the file, in its name, in a table of runs, or apply to all runs; what
    the config states takes precedence over the head.
    """

    def __init__(self, needs: Needs) -> None:
        self.needs, self.table = needs, needs.table
        self.pattern = name_pattern(needs.pattern) if needs.pattern else None
        self.rows = read_run_table(needs.run_table, needs.table) if needs.run_table else {}
        # for all runs, or in the names of files
        self.stated = {*needs.values, *(self.pattern.names if self.pattern else ())}

    def elsewhere(self, raws: Sequence[Raw]) -> set[str]:
        """Return our columns that the tables of a run need not contain."""
        fields = [entry for raw in raws for entry in raw.fields]
        roles = {self.table.label, *self.stated, *settings_in_head(fields, self.needs)}
        return roles | (set(SETTINGS) if self.rows else set())

    def of(self, part: Part) -> dict[str, Any]:
        """Return label and settings of a run from outside its columns."""
        needs, found = self.needs, self._from_head(part) | dict(self.needs.values)
        required = {c.name for c in self.table.columns if c.required and c.name in SETTINGS}
        is_complete = part.found.keys() >= {self.table.label, *required}
        if self.pattern is not None:
            values = next(filter(None, map(self.pattern.values, part.names)), None)
            found |= self._in_name(values, part.raw.place) if values else {}
            if not values and not is_complete:
                needs.problems.add(
                    f"{part.raw.place}: the name does not match runs.{self.table.kind}.pattern = "
                    f'"{needs.pattern}"'
                )
        if self.rows:
            name = next((n for n in part.names if n in self.rows), "")
            found |= self.rows[name] if name else {}
            if not name and not is_complete:
                needs.problems.add(f"{needs.run_table}: has no row for {part.names[0]}")
        return {role: value for role, value in found.items() if role in self.table.names}

    def _from_head(self, part: Part) -> dict[str, Any]:
        """Take settings from the head: from fields that the config names, or of known names."""
        found: dict[str, Any] = {}
        for role, matches in settings_in_head(part.raw.fields, self.needs).items():
            if role in part.found or role in self.stated:
                continue
            silent, values = replace(self.needs, problems=Problems()), dict[str, Any]()
            for match in matches:
                read = resolved([match], silent, "") or match
                values[match.channel.name] = values_of(read, silent)[0]
            name, value = next(iter(values.items()))
            wrong = [problem.removeprefix(", sample 1: ") for _, problem in silent.problems.found]
            if len(set(values.values())) > 1:
                say = self.needs.say("columns", role, f'"{name}"')
                wrong.append(f"header fields {', '.join(values)} can be {role}, say which: {say}")
            recognised = matches[0].how == "recognised"
            if not wrong:
                found[role] = value
                part.notes.extend([f"read header field {name} as {role}"] if recognised else [])
            elif not recognised or self.table.column(role).required:
                found[role] = np.nan  # the problem is reported only once
                self.needs.problems.add(f"{part.raw.place}: {wrong[0]}")
        return found

    def _in_name(self, values: Mapping[str, str], place: str) -> dict[str, Any]:
        """Take label and settings from what the pattern of the config finds in a name."""
        found: dict[str, Any] = {}
        assert self.pattern is not None
        for role in {*values} & {*SETTINGS, self.table.label} & {*self.table.names}:
            column, found[role] = self.table.column(role), values[role]
            unit = self.pattern.units.get(role, column.unit)
            by = conversion(unit, column.unit)
            try:
                if column.dtype != "string":
                    found[role] = (
                        by.apply(number_in_name(values[role])) if by else float("unknown unit")
                    )
            except ValueError:
                where = f'{place}: {role} = "{values[role]}" in the name'
                self.needs.problems.add(f"{where}, must be a number in {unit}")
        return found


def settings_in_head(fields: Sequence[Field], needs: Needs) -> dict[str, list[Found]]:
    """Return our settings -> header fields: of the name in the config, else of known names."""
    found = meant(channels_of_head(fields, needs.dialect), needs) if fields else {}
    return {
        role: matches
        for role, matches in found.items()
        if role in (*SETTINGS, needs.table.label)
        if matches[0].how == "config" or needs.table.column(role).dtype != "string"
    }


def read_run_table(path: Path, table: Table) -> dict[str, Mapping[str, Any]]:
    """Read a table of runs: name of a file or group -> the values in its row."""
    settings = [c for c in table.columns if c.name in (*SETTINGS, table.label)]
    file = Column("file", "string", "", "name of the file, or of the group")
    optional = (file, *(replace(column, required=False) for column in settings))
    needs = Needs(replace(table, columns=optional))
    part = read_part(list(text.read(path, str(path), DIALECT)), needs)
    needs.problems.raise_if_any()
    assert part is not None
    rows: dict[str, Mapping[str, Any]] = {}
    for k in range(len(part)):
        cells = {role: values[k] for role, values in part.columns.items()}
        name = str(cells.pop("file") or "")
        if name in rows:
            needs.problems.add(f"{part.at(k)[0]}: {name} is in an earlier line, too")
        rows[name] = {role: cell for role, cell in cells.items() if not is_missing(cell)}
    needs.problems.raise_if_any()
    return rows


def joined(
    parts: Sequence[Part], settings: Settings
) -> tuple[dict[str, np.ndarray], PlaceOf, list[str], set[str]]:
    """Join the columns of all runs, one after the other.

    Returns the columns of the table in its order, with nan or None for what is missing; the place
    of a sample; notes; and the columns whose unit is stated in all parts.
    """
    table, problems = settings.table, settings.needs.problems
    timed = "time_s" in settings.table.names
    notes: dict[str, list[str]] = {}
    owners: dict[str, str] = {}
    for part in parts:
        _fill(part, settings.of(part), table, problems)
        if timed and table.label not in part.columns:
            part.columns[table.label] = _labels(part, problems)
        elif not timed:
            words = part.columns.get(table.label, np.full(len(part), None))
            numbered = [str(row + 1) if w is None else w for row, w in enumerate(words)]
            part.columns[table.label] = np.array(numbered, dtype=object)
        for column in table.columns:
            if column.required and column.name in SETTINGS and column.name not in part.columns:
                advice = how_to_state(column.name, table.kind)
                problems.add(f"{part.raw.head}: column {column.name} is missing{advice}")
        # Parquet files with labelled rows are parts of one table
        is_part = part.raw.format == "Parquet" and table.label in part.found
        for label in () if is_part or not timed else pd.unique(part.columns[table.label]):
            owner = owners.setdefault(label, part.raw.place)
            if label is not None and owner != part.raw.place:
                problems.add(f"{part.raw.place}: {table.label} {label} is already used in {owner}")
        for note in part.notes:
            notes.setdefault(note, []).append(part.raw.place)
    if problems.count:
        problems.merge_repeated([part.raw.place for part in parts])
        problems.raise_if_any()
    starts = np.cumsum([0, *map(len, parts)])[:-1]

    def place(sample: int) -> tuple[str, int]:
        k = int(np.searchsorted(starts, sample, side="right")) - 1
        where, line = parts[k].at(sample - int(starts[k]))
        return where, line if len(parts) == 1 else sample + 1

    shown = []
    for note, places in notes.items():
        more = f" and {len(places) - 1} more" if len(places) > 1 else ""
        shown.append(note if len(places) == len(parts) else f"{places[0]}{more}: {note}")
    stated_units = [{r for r, f in part.found.items() if f.stated} for part in parts]
    return _together(parts, table), place, shown, set.intersection(*stated_units)


def _together(parts: Sequence[Part], table: Table) -> dict[str, np.ndarray]:
    """Concatenate the columns; of those that no part has, only texts of runs are left out."""
    present, lengths = {name for part in parts for name in part.columns}, [len(p) for p in parts]
    columns = {}
    for column in table.columns:
        if column.name in RUN_TEXTS and column.name not in present:
            continue
        missing, kind = (None, object) if column.dtype == "string" else (np.nan, float)
        pieces = [
            p.columns.pop(column.name) if column.name in p.columns else np.full(n, missing, kind)
            for p, n in zip(parts, lengths, strict=True)
        ]
        columns[column.name] = pieces[0] if len(pieces) == 1 else np.concatenate(pieces)
    return columns


def _fill(part: Part, stated: Mapping[str, Any], table: Table, problems: Problems) -> None:
    """Fill columns of a run with stated values; note what they replace."""
    labels = {*part.columns.get(table.label, ())} - {None}
    if table.label in stated and len(labels) > 1 and "time_s" in table.names:
        problems.add(
            f"{part.raw.place}: {table.label} = {stated[table.label]} is stated for all of it, but "
            f"its column {table.label} holds {len(labels)} labels"
        )
    for role, value in stated.items():
        is_word = isinstance(value, str)
        values = np.full(len(part), value, dtype=object if is_word else float)
        before = part.columns.get(role, values[:0])
        before = before[~absent(before)]
        differ = before != value if is_word else ~np.isclose(before, value, rtol=1e-6)
        if np.any(differ):
            replaced = f"{shown_value(before[differ][0])} in the recording"
            part.notes.append(f"{role} = {shown_value(value)} as stated replaces {replaced}")
        part.columns[role] = values


def _labels(part: Part, problems: Problems) -> np.ndarray:
    """Label every sample: a run begins where a setting changes or the time restarts."""
    columns, time = part.columns, part.columns["time_s"]
    bounds = [0, *_starts(columns, time), len(time)]
    labels = np.full(len(time), part.label, dtype=object)
    for k, (first, end) in enumerate(itertools.pairwise(bounds), start=1):
        if len(bounds) > 2:
            labels[first:end] = f"{part.label}-{k}"
        speed = columns.get("pulley_speed_rad_s", time[:0])[first:end]
        if _rotations(speed[np.isfinite(speed)]) > 1:
            stops = f"in run {labels[first]} the pulley turns several times with stops between"
            problems.add(f"{part.raw.place}: {stops}: add a column of labels")
    if len(bounds) > 2:
        part.notes.append(
            f"no column labels the runs: {len(bounds) - 1} separated by changes of the settings "
            "and by restarts of the time"
        )
    return labels


def _starts(columns: Mapping[str, np.ndarray], time: np.ndarray) -> list[int]:
    """Return the samples with which a new run begins."""
    changed = np.zeros(len(time), dtype=bool)
    for values in (columns[name] for name in NOMINAL if name in columns):
        changed[1:] |= np.abs(np.diff(values)) > 1e-6 * np.abs(values[1:])
    begin, starts = 0, []
    for i in np.flatnonzero(changed | (np.diff(time, prepend=time[:1]) < 0)):
        length = time[i - 1] - time[begin]
        restarts = time[i] <= time[begin] + RESTART * length and time[i] < time[i - 1]
        if changed[i] or restarts:  # other decreases of time are reported by the checks
            starts.append(int(i))
            begin = int(i)
    return starts


def _rotations(speed: np.ndarray) -> int:
    """Count how often the pulley begins to turn: a run has one rotation."""
    if len(speed) < 4 * PHASE:
        return 0
    noise = float(np.median(np.abs(np.diff(speed)))) * 1.05
    size = np.abs(speed)
    turning = size > max(0.02 * float(np.quantile(size, 0.99)), 6.0 * noise)
    phases = np.split(turning, np.flatnonzero(np.diff(turning.astype(np.int8))) + 1)
    states = [bool(phase[0]) for phase in phases if phase.size >= PHASE]
    return [state for state, _ in itertools.groupby(states)].count(True)

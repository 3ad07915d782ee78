"""What is in a file, and how it is read: the same functions that read it, with their answers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from beltid.bench import text
from beltid.bench.files import is_many, sources_of
from beltid.bench.mapping import (
    FORCES,
    Channel,
    Found,
    Needs,
    bench_of,
    can_be,
    channels_of,
    lacking,
    mapped,
    meant,
    rig_of,
    sensors_of,
)
from beltid.bench.numbers import numbers_of
from beltid.bench.options import ReadOptions
from beltid.bench.packed import format_of
from beltid.bench.raw import Raw, is_text
from beltid.bench.recording import of_plateaus, read_recording, tables_in
from beltid.bench.runs import settings_in_head
from beltid.bench.vocabulary import roles_hinted
from beltid.config.layout import KINDS
from beltid.config.name_pattern import name_pattern
from beltid.errors import InputError, Problems
from beltid.tables import schemas
from beltid.tables.columns import Table

SETTINGS: Final = ("arc_deg", "initial_tension_N", "weight_N", "temperature_degC")
HEAD: Final = 1 << 18
"""Bytes of a text that show the kind of its recording."""
_NUMBER: Final = r"[-+]?\d+(?:[.,p]\d+)?"
GAP: Final = 3.0
"""Steps of time over which samples are missing."""


@dataclass(frozen=True, slots=True)
class RunView:
    """A run found in a recording."""

    label: str
    n_samples: int
    duration_s: float
    rate_Hz: float  # median
    gaps: list[float]  # times after which samples are missing [s]
    settings: dict[str, float]  # arc, tension, temperature, speed reached


@dataclass(frozen=True, slots=True)
class Inspection:
    """Result of inspecting a recording."""

    kind: str  # stated or recognised; "" if it cannot be recognised
    names: tuple[str, ...]  # of its files
    tables: list[Raw]  # of the first file as written
    channels: list[Channel]  # of these tables
    found: dict[str, Found]  # our columns -> how they are read, as far as known
    runs: list[RunView]  # empty if it cannot be read yet
    notes: tuple[str, ...]
    problems: tuple[str, ...]  # to be stated or corrected; without, the command reads it
    rig: dict[str, str]  # keys of `rig` that the channels require and the config does not state
    can_be: dict[str, tuple[str, ...]]  # channels that are not read -> what they can be
    pattern: str  # of the file names, for settings that are nowhere else; "" if none


def inspect_recording(
    path: Path, config: Any, kind: str | None = None, *, guess: bool = False
) -> Inspection:
    """Look into the first file of a recording, and read all of it as the stage of its kind does.

    Parameters
    ----------
    path : Path
        File, folder, pattern or zip file.
    config : Config
        Options stated so far.
    kind : {"press", "rig", "speedloss"}, optional
        Kind of recording; None: recognised from the channels.
    guess : bool
        Whether to read the settings of the runs from the names of the files if they seem to be
        there and nowhere else.

    Raises
    ------
    InputError
        If its first file cannot be read at all.
    """
    options = [ReadOptions.of(config, k) for k in ([kind] if kind else KINDS)]
    sources = sources_of(path, [o.run_table for o in options if o.run_table is not None])
    called = {role: name for option in options for role, name in option.names.items()}
    needs = Needs(_any_table(), ReadOptions(called, dialect=options[0].dialect))
    tables = tables_in(sources[0], needs)
    needs.problems.raise_if_any()
    view = _View(tables, config)
    kind = kind or view.kind()
    rig = view.rig() if kind == "rig" else {}
    if rig:
        view.config = config.model_copy(update={"rig": config.rig.model_copy(update=rig)})
    names = tuple(source.inside.name for source in sources)
    pattern = _pattern(names, view.needs(kind), view.columns(kind), len(tables)) if kind else ""
    if pattern and guess:
        stated = {kind: {**view.config.runs[kind], "pattern": pattern}}
        view.config = view.config.model_copy(update={"runs": view.config.runs | stated})
    found = view.found(kind) if kind else {}
    notes, runs, problems = tables[0].notes, list[RunView](), tuple[str, ...]()
    try:
        if not kind:
            shown = ", ".join(c.name for c in view.channels[:12]) or "none"
            raise InputError(
                f"{path}: the channels do not tell which bench this is (found: {shown}); state it "
                f"with --kind {', '.join(KINDS[:-1])} or {KINDS[-1]}"
            )
        recording = read_recording(path, kind, view.config)
        found, notes = recording.found, recording.notes
        runs = runs_found(recording.columns, recording.kind)
        problems = _not_reduced(recording.columns, view.needs(kind))
    except InputError as error:
        problems = error.problems
    if rig:
        notes = (*notes, f"the channels are those of rig.kind: {rig['kind']}")
    return Inspection(
        kind,
        names,
        tables,
        view.channels,
        found,
        runs,
        notes,
        problems,
        rig,
        {} if runs else view.can_be([kind] if kind else KINDS, found),
        pattern,
    )


def _pattern(names: Sequence[str], needs: Needs, found: set[str], n_tables: int) -> str:
    """Return a pattern of all file names with a setting that is found nowhere else, or ""."""
    options = needs.options
    required = {c.name for c in needs.table.columns if c.required and c.name in schemas.NOMINAL}
    if not required - found - {*options.values} or options.pattern or options.run_table:
        return ""
    pattern, dot, ending = names[0].rpartition(".")
    for words, role in (
        (r"(?i:deg|grad|°)", "arc_deg"),
        (r"[Nn]", "initial_tension_N"),
        (r"(?:C|degC|°C)", "temperature_degC"),
    ):
        if role in needs.table.names and role not in found:
            unit = rf"{_NUMBER}(?={words}(?![A-Za-z]))"
            places = rf"(?<![\w{{]){unit}|(?<=_){unit}"
            pattern = re.sub(places, f"{{{role}}}", pattern, count=1)
    if "{" not in pattern:
        return ""
    first, separator, remainder = pattern.partition("_")
    numbered = re.match(rf"{_NUMBER}(?=[_.-]|$)", remainder)
    if separator and "{" not in first and n_tables == 1:
        pattern = f"{{{needs.table.label}}}_{remainder}"
        if numbered and all(name.startswith(first + separator) for name in names):
            pattern = f"{first}_{{{needs.table.label}}}{remainder[numbered.end() :]}"
    pattern = re.sub(rf"(?<=[_-]){_NUMBER}(?=[_.-]|$)", "{}", pattern) + dot + ending
    values = name_pattern(pattern).values
    return pattern if all(values(name) is not None for name in names) else ""


def _not_reduced(columns: dict[str, np.ndarray], needs: Needs) -> tuple[str, ...]:
    """Return why the command does not reduce what it reads."""
    spans = [columns[name] for name in FORCES[:3] if name in columns]
    is_torque = needs.table.kind == "rig" and needs.options.rig[0] == "torque"
    if not is_torque or any(np.isfinite(tension).any() for tension in spans):
        return ()
    return (
        "rig.kind: torque needs the tension of one span: column tension_tight_N, tension_slack_N "
        "or weight_N",
    )


def kind_of_file(path: Path, config: Any, kind: str) -> str:
    """Return the kind of recording whose sensors the first lines of a text name; "" if unclear."""
    options = ReadOptions.of(config, kind)
    if is_many(path) or options.names or format_of(path) != "text":
        return ""
    try:
        tables = list(text.read(path, str(path), options.dialect, _any_table().names, HEAD))
    except InputError:  # the stage that reads the file reports the problem
        return ""
    return bench_of(channels_of(tables), schemas.table(kind))


def _any_table() -> Table:
    """Return a table with the columns of all kinds, whose names show the header of a file."""
    tables = [schemas.table(kind) for kind in schemas.RECORDINGS]
    columns = {c.name: c for table in tables for c in table.columns}
    return Table("any", "", "", tuple(columns.values()))


class _View:
    """Answers on the channels of a file with what a config states so far."""

    def __init__(self, tables: Sequence[Raw], config: Any) -> None:
        self.tables, self.channels, self.config = tables, channels_of(tables), config
        self.fields = [entry for table in tables for entry in table.fields]

    def needs(self, kind: str) -> Needs:
        """Return what a kind of recording needs with the config so far."""
        options = ReadOptions.of(self.config, kind)
        needs = Needs(options.table(kind), options)
        return of_plateaus(self.tables, needs) if kind == "rig" else needs

    def found(self, kind: str) -> dict[str, Found]:
        """Return how our columns are read, as far as possible, group by group."""
        found: dict[str, Found] = {}
        for group in dict.fromkeys(c.group for c in self.channels):
            inside = [c for c in self.channels if c.group == group]
            found = mapped(inside, self.needs(kind), "") | found
        return found

    def can_be(self, kinds: Sequence[str], found: dict[str, Found]) -> dict[str, tuple[str, ...]]:
        """Return which of our columns unread channels can be, by unit or a word in the name."""
        read = {match.channel.qualified for match in found.values()}
        possible: dict[str, tuple[str, ...]] = {}
        for channel in self.channels:
            roles: list[str] = []
            for kind in kinds if channel.qualified not in read else ():
                columns = [
                    c
                    for c in self.needs(kind).table.columns
                    if c.dtype == "float64" and c.required and c.name not in found
                ]
                fit = [c.name for c in columns if can_be(channel, c)]
                hinted = [name for name in fit if name in roles_hinted(channel.name, kind)]
                has_unit = bool(channel.unit or channel.written)
                sensors = [name for name in fit if name not in schemas.SETTINGS]
                roles += hinted or (sensors if has_unit else [])
            if roles:
                possible[channel.qualified] = tuple(dict.fromkeys(roles))
        return possible

    def kind(self) -> str:
        """Recognise the kind of recording by its sensors; "" if none or several fit."""
        if self.needs("rig").table.kind == "points":
            return "rig"
        missing = {kind: self._missing(kind) for kind in KINDS}
        whole = [kind for kind in KINDS if not missing[kind]]
        if whole:
            return whole[0] if len(whole) == 1 else ""
        # if no kind has all its sensors (units may be ambiguous), the explained channels decide
        explained = {
            kind: len(found := self.found(kind)) + len(self.can_be([kind], found))
            for kind in KINDS
            if missing[kind] < 1.0
        }
        best = [kind for kind, n in explained.items() if n == max(explained.values())]
        return best[0] if len(best) == 1 else ""

    def _missing(self, kind: str) -> float:
        """Return the share of the sensors of a kind for which the file has no channel."""
        columns = self.columns(kind)
        if kind == "rig":
            n_forces = min(len(columns & {*FORCES}), 2)
            return 1.0 - (n_forces + ("pulley_speed_rad_s" in columns)) / 3
        table = schemas.table(kind)
        return len(lacking(table, columns)) / len(sensors_of(table))

    def rig(self) -> dict[str, str]:
        """Return the `rig` keys that the channels require and the config does not state."""
        stated = self.config.rig.model_fields_set & {"kind", "holds"}
        return {} if stated else rig_of(self.columns("rig"), self.needs("rig"))

    def columns(self, kind: str) -> set[str]:
        """Return the columns of a kind that channels or header fields of the file can be."""
        needs = Needs(schemas.table(kind), ReadOptions.of(self.config, kind))
        return {*meant(self.channels, needs), *settings_in_head(self.fields, needs)}


def ranges(channel: Channel) -> dict[str, float]:
    """Return rate, smallest, largest and first number of a channel; nan for texts."""
    raw, values = channel.raw, channel.raw.frame[channel.name]
    numbers = np.full(len(values), np.nan)
    if not is_text(values):
        numbers = values.to_numpy()
    elif not channel.written:
        numbers = numbers_of(values, raw.signs, "", raw.at, Problems())
    finite = numbers[np.isfinite(numbers)]
    low, high, first = (finite.min(), finite.max(), finite[0]) if finite.size else [np.nan] * 3
    step = _step(raw.times if raw.times is not None else finite[:0])
    rate = 1.0 / step if step > 0 else np.nan
    return {"rate_Hz": rate, "min": float(low), "max": float(high), "first": float(first)}


def _step(time: np.ndarray) -> float:
    return float(np.median(np.diff(time))) if len(time) > 1 else 0.0


def runs_found(columns: dict[str, np.ndarray], kind: str) -> list[RunView]:
    """Return the runs of a recording, in the order of their first sample."""
    codes, labels = pd.factorize(columns[schemas.table(kind).label])
    order = np.argsort(codes, kind="stable")
    bounds = np.cumsum(np.bincount(codes))[:-1]
    sensors = {name: x for name, x in columns.items() if x.dtype != object}
    return [
        _run_view(str(word), {name: x[rows] for name, x in sensors.items()}, kind)
        for word, rows in zip(labels, np.split(order, bounds), strict=True)
    ]


def _run_view(label: str, columns: dict[str, np.ndarray], kind: str) -> RunView:
    time, settings = columns.get("time_s"), _settings(columns, kind)
    if time is None:
        return RunView(label, 1, np.nan, np.nan, [], settings)
    step = _step(time)
    gaps = time[:-1][np.diff(time) > GAP * step].tolist() if step > 0 else []
    rate = 1.0 / step if step > 0 else np.nan
    return RunView(label, len(time), float(time[-1] - time[0]), rate, gaps, settings)


def _settings(columns: dict[str, np.ndarray], kind: str) -> dict[str, float]:
    """Return the settings of a run."""
    known = {name: x[np.isfinite(x)] for name, x in columns.items()}
    settings = {n: float(np.median(known[n])) for n in SETTINGS if len(known.get(n, ()))}
    speed = "driver_speed_rad_s" if kind == "speedloss" else "pulley_speed_rad_s"
    if len(turning := np.abs(known.get(speed, np.empty(0)))):
        # omit the rest phase; the highest samples alone would show sensor noise
        turning = turning[turning >= 0.5 * np.quantile(turning, 0.9)]
        settings[speed] = float(np.median(turning))
    if kind == "press":
        settings["force_N"] = float(np.abs(known["force_N"]).max())
    return settings

"""What is in a file, and how it is read: the same functions that read it, with their answers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from beltid.bench import text
from beltid.bench.columns import settings_in_head
from beltid.bench.files import is_many, sources_of
from beltid.bench.mapping import (
    EITHER,
    Channel,
    Found,
    Needs,
    bench_of,
    can_be,
    channels_of,
    kinds_of_benches,
    mapped,
    meant,
    sensors_of,
)
from beltid.bench.numbers import numbers_of
from beltid.bench.options import ReadOptions
from beltid.bench.packed import format_of
from beltid.bench.raw import Raw, is_text
from beltid.bench.recording import read_recording, tables_in
from beltid.bench.vocabulary import roles_hinted
from beltid.errors import InputError, Problems
from beltid.tables import schemas
from beltid.tables.columns import Table

SETTINGS: Final = ("arc_deg", "initial_tension_N", "weight_N", "temperature_degC")
HEAD: Final = 1 << 18
"""Bytes of a text that show the kind of its recording."""
GAP: Final = 3.0
"""Steps of time over which samples are missing."""


@dataclass(frozen=True, slots=True)
class RunView:
    """A run found in a recording.

    Attributes
    ----------
    label : str
        Its label.
    n_samples : int
        Number of samples.
    duration_s, rate_Hz : float
        Duration [s] and median rate [1/s].
    gaps : list of float
        Times after which samples are missing [s].
    settings : dict
        Arc, tension, temperature, speed reached, if the kind has them.
    """

    label: str
    n_samples: int
    duration_s: float
    rate_Hz: float
    gaps: list[float]
    settings: dict[str, float]


@dataclass(frozen=True, slots=True)
class Inspection:
    """Result of inspecting a recording.

    Attributes
    ----------
    kind : str
        Kind of recording, stated or recognised; "" if it cannot be recognised.
    names : tuple of str
        Names of its files.
    tables : list of Raw
        Tables of the first file as written.
    channels : list of Channel
        Their channels.
    found : dict of str to Found
        Our columns -> how they are read, as far as known.
    runs : list of RunView
        Its runs; empty if it cannot be read yet.
    notes, problems : tuple of str
        Notes, and what must still be stated or corrected; without problems the command reads it.
    rig : dict of str to str
        Keys of the section `rig` that the channels require and the config does not state.
    can_be : dict of str to tuple of str
        Channels that are not read -> our columns that they can be.
    """

    kind: str
    names: tuple[str, ...]
    tables: list[Raw]
    channels: list[Channel]
    found: dict[str, Found] = field(default_factory=dict)
    runs: list[RunView] = field(default_factory=list)
    notes: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()
    rig: dict[str, str] = field(default_factory=dict)
    can_be: dict[str, tuple[str, ...]] = field(default_factory=dict)


def inspect_recording(path: Path, config: Any, kind: str | None = None) -> Inspection:
    """Look into the first file of a recording, and read all of it as the stage of its kind does.

    Parameters
    ----------
    path : Path
        File, folder, pattern or zip file.
    config : Config
        Options stated so far.
    kind : str, optional
        Kind of recording; None: recognised from the channels.

    Raises
    ------
    InputError
        If its first file cannot be read at all.
    """
    options = [ReadOptions.of(config, k) for k in ([kind] if kind else schemas.RECORDINGS)]
    sources = sources_of(path, [o.run_table for o in options if o.run_table is not None])
    names = tuple(source.inside.name for source in sources)
    called = {role: name for option in options for role, name in option.names.items()}
    needs = Needs(_any_table(), ReadOptions(called, dialect=options[0].dialect))
    tables = tables_in(sources[0], needs)
    needs.problems.raise_if_any()
    channels = channels_of(tables)
    view = _View(tables, config)
    notes = tables[0].notes
    if not kind and not (kind := view.kind()):
        shown = ", ".join(c.name for c in channels[:20]) or "none"
        problem = (
            f"{path}: the channels do not show the kind of recording, say --kind press, rig, "
            f"speedloss or points; found: {shown}"
        )
        possible = view.can_be(schemas.RECORDINGS, {})
        return Inspection(
            "", names, tables, channels, notes=notes, problems=(problem,), can_be=possible
        )
    rig = view.rig() if kind in ("rig", "points") else {}
    if rig:
        config = view.config = config.model_copy(update={"rig": config.rig.model_copy(update=rig)})
        notes = (*notes, f"the channels are those of rig.kind: {rig['kind']}")
    try:
        recording = read_recording(path, kind, config)
    except InputError as error:
        found = view.found(kind)
        possible = view.can_be([kind], found)
        return Inspection(
            kind, names, tables, channels, found, [], notes, error.problems, rig, possible
        )
    problems = _not_reduced(recording.columns, view.needs(kind))
    runs = runs_found(recording.columns, kind)
    notes = (*recording.notes, *(notes[-1:] if rig else ()))
    return Inspection(kind, names, tables, channels, recording.found, runs, notes, problems, rig)


def _not_reduced(columns: dict[str, np.ndarray], needs: Needs) -> tuple[str, ...]:
    """Return why the command does not reduce what it reads."""
    spans = [columns[name] for name in EITHER - {"weight_N"} if name in columns]
    is_torque = needs.table.kind == "rig" and needs.options.rig[0] == "torque"
    if not is_torque or any(np.isfinite(tension).any() for tension in spans):
        return ()
    return (
        "rig.kind: torque needs the tension of one span: column tension_tight_N or "
        "tension_slack_N; a weight beside a torque is read, but not reduced",
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
    return bench_of(channels_of(tables), schemas.table(kind))[0]


def _any_table() -> Table:
    """Return a table with the columns of all kinds, whose names show the header of a file."""
    tables = [schemas.table(kind) for kind in schemas.RECORDINGS]
    columns = {c.name: c for table in tables for c in table.columns}
    return Table("any", "", "", tuple(columns.values()))


class _View:
    """Answers on the channels of a file.

    Parameters
    ----------
    tables : sequence of Raw
        Its tables.
    config : Config
        Options stated so far.
    """

    def __init__(self, tables: Sequence[Raw], config: Any) -> None:
        self.channels, self.config = channels_of(tables), config
        self.timed = any(table.times is not None for table in tables)
        self.fields = [field for table in tables for field in table.fields]

    def needs(self, kind: str) -> Needs:
        """Return what a kind of recording needs with the config so far."""
        options = ReadOptions.of(self.config, kind)
        return Needs(options.table(kind), options)

    def found(self, kind: str) -> dict[str, Found]:
        """Return how our columns are read, as far as possible, group by group."""
        found: dict[str, Found] = {}
        groups = dict.fromkeys(c.group for c in self.channels)
        for group in groups:
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
        if self._is_table_of_plateaus():
            return "points"
        kinds = ("press", "speedloss", "rig")
        tables = {kind: [self.needs(kind).table] for kind in kinds}
        if not self._states_rig():
            tables["rig"] += [table for table, _ in kinds_of_benches() if table.kind == "rig"]
        shares = {kind: max(map(self._share, tables[kind])) for kind in kinds}
        whole = max(shares.values()) == 1.0
        # if no kind has all its sensors (units may be ambiguous), the explained channels decide
        marks = {
            kind: (0 if whole or not share else self._explained(kind), share)
            for kind, share in shares.items()
        }
        best = max(marks, key=lambda kind: marks[kind])
        unclear = shares[best] == 0 or list(marks.values()).count(marks[best]) > 1
        return "" if unclear else best

    def rig(self) -> dict[str, str]:
        """Return the `rig` keys that the channels require and the config does not state."""
        if self._states_rig():
            return {}
        shares = {kind: self._share(schemas.rig_table(*kind)) for kind in schemas.RIG_KINDS}
        best = max(shares, key=lambda kind: shares[kind])
        if shares[best] < 1.0 or best[0] == "two_cells":
            return {}
        return {"kind": best[0]} | ({"weight_on": best[1]} if best[0] == "dead_weight" else {})

    def _states_rig(self) -> bool:
        return bool(self.config.rig.model_fields_set & {"kind", "weight_on"})

    def _explained(self, kind: str) -> int:
        """Count the channels that a kind of recording reads or may have a column for."""
        found = self.found(kind)
        return len(found) + len(self.can_be([kind], found))

    def _is_table_of_plateaus(self) -> bool:
        """Return whether each row is a plateau: a speed, an arc or a coefficient, but no time."""
        if self.timed or "time_s" in self._columns(schemas.table("rig")):
            return False
        columns = self._columns(schemas.table("points"))
        has_speed = bool(columns & {"pulley_speed_rad_s", "slip_speed_m_s"})
        return has_speed and ("arc_deg" in columns or {"mu", "normal_force_N_m"} <= columns)

    def _share(self, table: Table) -> float:
        """Return the share of a table's sensors that the file has channels for."""
        sensors, columns = {*sensors_of(table)}, self._columns(table)
        if "weight_N" in table.names and table.column("weight_N").required:
            sensors.add("weight_N")  # not a sensor, but the only mark of such a bench
        count = len(sensors & columns)
        if "torque_N_m" in sensors and {*table.names} >= EITHER and not sensors & EITHER:
            return (count + bool(columns & EITHER)) / (len(sensors) + 1)
        return count / len(sensors)

    def _columns(self, table: Table) -> set[str]:
        """Return the columns of a table that channels or header fields of the file can be."""
        needs = Needs(table, ReadOptions.of(self.config, table.kind))
        in_head = settings_in_head(self.fields, needs)
        return set(meant(self.channels, needs)) | (in_head & set(table.names))


def ranges(channel: Channel) -> dict[str, float]:
    """Return rate, smallest, largest and first number of a channel; nan for texts."""
    raw, values = channel.raw, channel.raw.frame[channel.name]
    if is_text(values):
        numbers = np.full(len(values), np.nan)
        if channel.cells and raw.signs.thousands:
            numbers = numbers_of(values, raw.signs, "", raw.at, Problems())
    else:
        numbers = values.to_numpy()
    finite = numbers[np.isfinite(numbers)]
    steps = np.diff(raw.times) if raw.times is not None else np.empty(0)
    step = float(np.median(steps)) if steps.size else 0.0
    low, high, first = (finite.min(), finite.max(), finite[0]) if finite.size else [np.nan] * 3
    rate = 1.0 / step if step > 0 else np.nan
    return {"rate_Hz": rate, "min": float(low), "max": float(high), "first": float(first)}


def runs_found(columns: dict[str, np.ndarray], kind: str) -> list[RunView]:
    """Return the runs of a recording, in the order of their first sample."""
    label = schemas.table(kind).label
    codes, labels = pd.factorize(columns[label])
    order = np.argsort(codes, kind="stable")
    bounds = np.cumsum(np.bincount(codes))[:-1]
    sensors = {name: x for name, x in columns.items() if x.dtype != object}
    return [
        _run_view(str(word), {name: x[rows] for name, x in sensors.items()}, kind)
        for word, rows in zip(labels, np.split(order, bounds), strict=True)
    ]


def _run_view(label: str, columns: dict[str, np.ndarray], kind: str) -> RunView:
    settings = _settings(columns, kind)
    if "time_s" not in columns:
        return RunView(label, 1, np.nan, np.nan, [], settings)
    time = columns["time_s"]
    steps = np.diff(time)
    step = float(np.median(steps)) if steps.size else 0.0
    gaps = time[:-1][steps > GAP * step].tolist() if step > 0 else []
    rate = 1.0 / step if step > 0 else np.nan
    return RunView(label, len(time), float(time[-1] - time[0]), rate, gaps, settings)


def _settings(columns: dict[str, np.ndarray], kind: str) -> dict[str, float]:
    """Return the settings of a run."""
    settings = {}
    for name in SETTINGS:
        values = columns.get(name)
        if values is not None and np.isfinite(values).any():
            settings[name] = float(np.nanmedian(values))
    speed = {"rig": "pulley_speed_rad_s", "speedloss": "driver_speed_rad_s"}.get(kind)
    if speed is not None and np.isfinite(columns[speed]).any():
        turning = np.abs(columns[speed])
        # omit the rest phase; the highest samples alone would show sensor noise
        turning = turning[turning >= 0.5 * np.nanquantile(turning, 0.9)]
        settings[speed] = float(np.median(turning))
    if kind == "press":
        settings["force_N"] = float(np.nanmax(np.abs(columns["force_N"])))
    return settings

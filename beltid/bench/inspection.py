"""What was understood of files before anything is computed with them: formats, channels, runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.bench.channels.channel_groups import candidates_of as channel_candidates
from beltid.bench.channels.channel_mapping import SETTINGS, readings_of
from beltid.bench.channels.readings import Candidate, Question
from beltid.bench.channels.text_tables import candidates_of as text_candidates
from beltid.bench.channels.text_tables import text_layout
from beltid.bench.files.sources import sources_of
from beltid.bench.formats.bench_file import Field
from beltid.bench.formats.csv_reader import Wanted, read_rows
from beltid.bench.formats.dialect import ReadOptions
from beltid.bench.formats.table_head import unit_in_name
from beltid.bench.opening import Opened, open_sources
from beltid.bench.problems import Problems
from beltid.errors import InputError
from beltid.tables import schemas

KINDS: Final = ("press", "rig", "speedloss")


@dataclass(frozen=True, slots=True)
class ChannelView:
    """A channel as it stands in the file.

    Attributes
    ----------
    candidate : Candidate
        Name, unit and group.
    n_samples : int
        Samples.
    rate_Hz : float
        Rate that the format tells [1/s]; nan where a time channel does.
    low, high, first : float
        Smallest, largest and first number, in the unit of the file; nan for texts.
    """

    candidate: Candidate
    n_samples: int
    rate_Hz: float
    low: float
    high: float
    first: float


@dataclass(frozen=True, slots=True)
class FileView:
    """A file as it was understood.

    Attributes
    ----------
    name : str
        Its name.
    format : str
        Format in words.
    encoding : str
        Encoding of its text, "" where it is no text.
    channels : tuple of ChannelView
        Every channel.
    fields : tuple of Field
        Header fields.
    notes : tuple of str
        What was found out on the way.
    """

    name: str
    format: str
    encoding: str
    channels: tuple[ChannelView, ...]
    fields: tuple[Field, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def candidates(self) -> list[Candidate]:
        """Its channels as candidates for our columns."""
        return [channel.candidate for channel in self.channels]


def open_all(path: Path, config: Any = None) -> list[Opened]:
    """The files that a path stands for, opened; none for a Parquet file.

    Parameters
    ----------
    path : Path
        File, folder, pattern or zip file.
    config : Config, optional
        Dialect of text files, tables of runs.

    Raises
    ------
    InputError
        If a file cannot be read.
    """
    tables = [] if config is None else list(config.runs.tables.values())
    sources = sources_of(path, tables)
    if len(sources) == 1 and sources[0].read()[:4] == b"PAR1":
        return []
    opened = open_sources(sources, ReadOptions.of(config, "rig"))
    problems = Problems()
    for one in opened:
        for wrong in one.wrong:
            problems.add(wrong)
    problems.raise_if_any()
    return opened


def views_of(opened: Sequence[Opened], path: Path, config: Any = None) -> list[FileView]:
    """Channels of opened files, or of the Parquet file that the path names."""
    options = ReadOptions.of(config, "rig")
    views = []
    for one in opened:
        if one.text is not None:
            views.append(_text(one, options))
        elif one.channels is not None:
            views.append(_channels(one))
    return views or [_parquet(path)]


def kinds_meant(view: FileView, config: Any = None) -> dict[str, float]:
    """Share of the sensors of every kind of recording that the channels of a file can be."""
    shares = {}
    for kind in KINDS:
        table = schemas.table(kind)
        sensors = [
            c.name
            for c in table.columns
            if c.required and c.dtype != "string" and c.name not in ("time_s", *SETTINGS)
        ]
        options = ReadOptions.of(config, kind)
        found: set[str] = set()
        for group in _groups(view.candidates):
            question = Question(table, options)
            readings = readings_of(group, question, sensors)
            unclear = {c for c in sensors if any(c in text for _, text in question.problems.found)}
            found |= set(readings) | unclear
        shares[kind] = len(found) / len(sensors)
    return shares


def _groups(candidates: Sequence[Candidate]) -> list[list[Candidate]]:
    groups: dict[str, list[Candidate]] = {}
    for candidate in candidates:
        groups.setdefault(candidate.group, []).append(candidate)
    return list(groups.values())


def _text(opened: Opened, options: ReadOptions) -> FileView:
    """Columns of a table in a text file, with their range."""
    assert opened.text is not None
    # any of our names makes the header of a tidy file plain to see
    table = schemas.table("press")
    found = text_layout(opened.text, opened.name, options, table)
    candidates = text_candidates(found)
    rows = read_rows(
        found,
        {str(c.key): Wanted(c.key, True, c.name) for c in candidates},
        opened.name,
        Problems(),
    )
    channels = tuple(
        _view(c, _numbers(rows.columns[str(c.key)], found.decimal), np.nan) for c in candidates
    )
    notes = (*opened.text.notes, *found.notes)
    return FileView(opened.name, opened.format, opened.text.encoding, channels, found.fields, notes)


def _numbers(cells: np.ndarray, decimal: str) -> np.ndarray:
    """Numbers of text cells; nan for what is none."""
    out = np.full(len(cells), np.nan)
    for i, cell in enumerate(cells):
        try:
            out[i] = float(str(cell).replace(decimal, ".")) if cell is not None else np.nan
        except ValueError:
            continue
    return out


def _channels(opened: Opened) -> FileView:
    assert opened.channels is not None
    file = opened.channels
    candidates = channel_candidates(file.groups, named=len(file.groups) > 1)
    views = []
    for candidate in candidates:
        g, c = candidate.key
        channel = file.groups[g].channels[c]
        rate = np.nan
        if channel.time_s is not None and channel.time_s.size > 1:
            step = float(np.median(np.diff(channel.time_s)))
            rate = 1.0 / step if step > 0 else np.nan
        numbers = _numbers(channel.values, ".") if channel.is_text else channel.values
        views.append(_view(candidate, numbers, rate))
    fields = (*file.fields, *(f for group in file.groups for f in group.fields))
    return FileView(opened.name, file.format, "", tuple(views), fields, file.notes)


def _parquet(path: Path) -> FileView:
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path)
    except Exception as error:  # a damaged file can raise nearly anything
        raise InputError(f"{path}: damaged: {' '.join(str(error).split())[:120]}") from None
    views = []
    for name in table.column_names:
        values = np.asarray(table.column(name).to_numpy(), dtype=object)
        views.append(_view(Candidate(name, "", name), _numbers(values, "."), np.nan))
    return FileView(str(path), "Parquet", "", tuple(views))


def _view(candidate: Candidate, numbers: np.ndarray, rate: float) -> ChannelView:
    finite = numbers[np.isfinite(numbers)]
    low, high, first = (
        (float(finite.min()), float(finite.max()), float(finite[0]))
        if finite.size
        else (np.nan, np.nan, np.nan)
    )
    return ChannelView(candidate, len(numbers), rate, low, high, first)


@dataclass(frozen=True, slots=True)
class RunView:
    """A run as it was found.

    Attributes
    ----------
    label : str
        Its label.
    n_samples : int
        Samples.
    duration_s, rate_Hz : float
        Length [s] and median rate [1/s].
    gaps : tuple of float
        Times at which samples are missing: a step of more than three median steps follows [s].
    settings : dict
        Arc, tension, temperature, speed reached, where the kind has them.
    """

    label: str
    n_samples: int
    duration_s: float
    rate_Hz: float
    gaps: tuple[float, ...]
    settings: dict[str, float]


def runs_found(columns: dict[str, np.ndarray], kind: str) -> list[RunView]:
    """Runs of a recording, in the order of their first sample."""
    label = schemas.table(kind).label
    labels = columns[label]
    runs = []
    order: dict[Any, list[int]] = {}
    for i, word in enumerate(labels.tolist()):
        order.setdefault(word, []).append(i)
    for word, rows in order.items():
        part = {name: values[rows] for name, values in columns.items() if name != label}
        time = part["time_s"]
        steps = np.diff(time)
        step = float(np.median(steps)) if steps.size else 0.0
        late = np.flatnonzero(steps > 3.0 * step) if step > 0 else np.empty(0, dtype=int)
        runs.append(
            RunView(
                str(word),
                len(rows),
                float(time[-1] - time[0]),
                1.0 / step if step > 0 else np.nan,
                tuple(float(time[i]) for i in late),
                _settings(part, kind),
            )
        )
    return runs


def _settings(part: dict[str, np.ndarray], kind: str) -> dict[str, float]:
    """What a run was made at."""
    settings = {}
    for name in ("arc_deg", "initial_tension_N", "temperature_degC"):
        values = part.get(name)
        if values is not None and np.isfinite(values).any():
            settings[name] = float(np.nanmedian(values))
    speed = {"rig": "pulley_speed_rad_s", "speedloss": "driver_speed_rad_s"}.get(kind)
    if speed is not None and np.isfinite(part[speed]).any():
        settings[speed] = float(np.nanquantile(np.abs(part[speed]), 0.9))
    if kind == "press":
        settings["force_N"] = float(np.nanmax(np.abs(part["force_N"])))
    return settings


def unit_of(candidate: Candidate) -> str:
    """Unit of a channel as the file writes it, in a cell of its own or in the name."""
    return candidate.unit or unit_in_name(candidate.name)

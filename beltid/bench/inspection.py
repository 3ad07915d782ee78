"""Inspect files before anything is computed from them: formats, channels, runs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.bench.big_recording import BigRecording, read_head
from beltid.bench.channels.channel_groups import candidates_of as channel_candidates
from beltid.bench.channels.channel_mapping import (
    Candidate,
    ChannelMapping,
    MappingContext,
    can_be,
    channels_meant,
    map_channels,
    sensors_of,
    unit_of,
)
from beltid.bench.channels.text_tables import candidates_of as text_candidates
from beltid.bench.channels.text_tables import text_layout
from beltid.bench.channels.vocabulary import roles_hinted
from beltid.bench.files.sniff import Decoded
from beltid.bench.files.sources import Source, are_parquet, unread_sources
from beltid.bench.formats.bench_file import Field
from beltid.bench.formats.csv_table import Wanted, csv_blocks
from beltid.bench.formats.dialect import Layout
from beltid.bench.formats.numbers import NumberSigns, is_number, numbers_or_problems
from beltid.bench.formats.rows import Texts, numbers_of
from beltid.bench.read_options import ReadOptions
from beltid.bench.recording import (
    Opened,
    Recording,
    open_sources,
    read_recording,
    read_rig,
    recording_of,
    sources_read_at_once,
)
from beltid.errors import InputError, Problems
from beltid.tables import schemas
from beltid.tables.columns import Table

TORQUE_SENSORS: Final = set(sensors_of(schemas.rig_table("torque")))
ANY_TABLE: Final = schemas.table("press")
"""Table whose column names help to find the header; any of our tables will do."""


@dataclass(frozen=True, slots=True)
class ChannelView:
    """A channel as it is in the file.

    Attributes
    ----------
    candidate : Candidate
        Name, unit and group.
    n_samples : int
        Number of samples.
    rate_Hz : float
        Rate stated by the format [1/s]; nan if a time channel gives it.
    low, high, first : float
        Smallest, largest and first number, in the unit of the file; nan for texts.
    """

    candidate: Candidate
    n_samples: int = 0
    rate_Hz: float = np.nan
    low: float = np.nan
    high: float = np.nan
    first: float = np.nan

    def with_numbers(self, numbers: np.ndarray) -> ChannelView:
        """Return the channel with more samples added."""
        finite = numbers[np.isfinite(numbers)]
        longer = replace(self, n_samples=self.n_samples + len(numbers))
        if not finite.size:
            return longer
        return replace(
            longer,
            low=float(np.fmin(self.low, finite.min())),
            high=float(np.fmax(self.high, finite.max())),
            first=float(finite[0]) if np.isnan(self.first) else self.first,
        )


@dataclass(frozen=True, slots=True)
class FileView:
    """An inspected file.

    Attributes
    ----------
    name : str
        Its name.
    format : str
        Name of the format.
    encoding : str
        Encoding of its text, "" for other files.
    channels : tuple of ChannelView
        All channels.
    fields : tuple of Field
        Header fields.
    notes : tuple of str
        Notes from reading it.
    """

    name: str
    format: str
    encoding: str
    channels: tuple[ChannelView, ...]
    fields: tuple[Field, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def candidates(self) -> list[Candidate]:
        """Channels as candidates for our columns."""
        return [channel.candidate for channel in self.channels]


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
    gaps : tuple of float
        Times after which samples are missing: the next step is over three median steps [s].
    settings : dict
        Arc, tension, temperature, speed reached, if the kind has them.
    """

    label: str
    n_samples: int
    duration_s: float
    rate_Hz: float
    gaps: tuple[float, ...]
    settings: dict[str, float]


@dataclass(frozen=True, slots=True)
class Inspection:
    """Result of inspecting a recording.

    Attributes
    ----------
    kind : str
        Kind of recording, stated or recognised.
    files : tuple of FileView
        Its files; if all are alike, only the first one has its channels inspected.
    mappings : dict of str to ChannelMapping
        Our columns -> how they are read, as far as known.
    runs : tuple of RunView
        Its runs; empty if it cannot be read yet.
    notes : tuple of str
        Notes for the user.
    problems : tuple of str
        What the user must still state or correct; empty if the recording can be read.
    rig : dict of str to str
        Keys of the section `rig` that the channels require and the config does not state.
    can_be : dict of str to tuple of str
        Channels of the first file that are not read -> our columns that they can be.
    """

    kind: str
    files: tuple[FileView, ...]
    mappings: dict[str, ChannelMapping]
    runs: tuple[RunView, ...] = ()
    notes: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()
    rig: dict[str, str] = field(default_factory=dict)
    can_be: dict[str, tuple[str, ...]] = field(default_factory=dict)


def inspect_recording(path: Path, config: Any, kind: str | None = None) -> Inspection:
    """Inspect files of any size and read them as the stage of their kind does.

    Parameters
    ----------
    path : Path
        File, folder, pattern or zip file.
    config : Config
        Options stated so far.
    kind : str, optional
        Kind of recording; None: recognised from the channels. It is "" in the result if it
        cannot be recognised.

    Raises
    ------
    InputError
        If a file cannot be read at all.
    """
    files, opened = _looked_into(path, config)
    try:
        kind = kind or _kind_meant(files[0], config, path)
    except InputError as error:
        can_be = _can_be(files[0], schemas.RECORDINGS, {}, config)
        problems = error.problems
        return Inspection("", tuple(files), {}, (), files[0].notes, problems, {}, can_be)
    rig = _rig_meant(files[0], config) if kind in ("rig", "points") else {}
    if rig:
        config = config.model_copy(update={"rig": config.rig.model_copy(update=rig)})
    try:
        recording: Recording | BigRecording
        if opened:
            recording = recording_of(opened, path, kind, ReadOptions.of(config, kind))
        elif kind == "rig":
            recording = read_rig(path, config)
        else:
            recording = read_recording(path, kind, config)
        if isinstance(recording, Recording):
            runs, notes = runs_found(recording.columns, kind), recording.notes
        else:
            runs = [_run_view(run.label, run.columns, kind) for run in recording]
            notes = recording.notes
    except InputError as error:
        mappings = _mappings(files[0], kind, config)
        can_be = _can_be(files[0], [kind], mappings, config)
        return Inspection(
            kind, tuple(files), mappings, (), files[0].notes, error.problems, rig, can_be
        )
    mappings = recording.mappings if isinstance(recording, Recording) else {}
    mappings = mappings or _mappings(files[0], kind, config)
    if rig:
        notes = (*notes, f"the channels are those of rig.kind: {rig['kind']}")
    return Inspection(kind, tuple(files), mappings, tuple(runs), notes, (), rig)


def _looked_into(path: Path, config: Any) -> tuple[list[FileView], list[Opened]]:
    """Inspect files; also return the opened files if the recording is read at once."""
    options = ReadOptions.of(config, "rig")
    at_once = sources_read_at_once(path, options)
    sources = at_once or unread_sources(path)
    if are_parquet(sources):
        return _parquet_views(sources, options), []
    if at_once is None:
        head = read_head(path, options, ANY_TABLE)
        encoding = head.decoded.encoding
        return [_text_view(str(path), head.decoded, head.layout, head.chunks, encoding)], []
    opened, problems = open_sources(sources, options), Problems()
    for message in (text for file in opened for text in file.wrong):
        problems.add(message)
    problems.raise_if_any()
    return [_view(file, options) for file in opened], opened


def _view(opened: Opened, options: ReadOptions) -> FileView:
    """Inspect an opened file, with the ranges of its channels."""
    if opened.channels is None:
        assert opened.text is not None
        layout = text_layout(opened.text, opened.name, options, ANY_TABLE)
        return _text_view(opened.name, opened.text, layout, [layout.body], "utf-8")
    file, views = opened.channels, []
    for candidate in channel_candidates(file.groups, named=len(file.groups) > 1):
        g, c = candidate.key
        channel = file.groups[g].channels[c]
        rate = np.nan
        if channel.time_s is not None and channel.time_s.size > 1:
            step = float(np.median(np.diff(channel.time_s)))
            rate = 1.0 / step if step > 0 else np.nan
        numbers = channel.values
        if channel.is_text:
            signs = NumberSigns.of(
                channel.first_texts(), options.dialect.decimal, options.dialect.thousands
            )
            numbers = numbers_or_problems(numbers, signs, "", lambda i: ("", i), Problems())
        views.append(ChannelView(candidate, rate_Hz=rate).with_numbers(numbers))
    fields = (*file.fields, *(f for group in file.groups for f in group.fields))
    return FileView(opened.name, file.format, "", tuple(views), fields, file.notes)


def _text_view(
    name: str, decoded: Decoded, layout: Layout, chunks: Iterable[bytes], encoding: str
) -> FileView:
    """Inspect the columns of a text file and their ranges; `encoding` is that of the chunks."""
    views = {str(c.key): ChannelView(c) for c in text_candidates(layout)}
    for rows in csv_blocks(chunks, layout, _all_columns(layout), encoding, name, []):
        nothing = np.full(len(rows), np.nan)
        views = {k: v.with_numbers(rows.numbers.get(k, nothing)) for k, v in views.items()}
    notes = (*decoded.notes, *layout.notes)
    channels = tuple(views.values())
    format_name = _text_format(decoded.text)
    return FileView(name, format_name, decoded.encoding, channels, layout.fields, notes)


def _all_columns(layout: Layout) -> dict[str, Wanted]:
    """Return all columns of a text file, as numbers if the first rows are mostly numbers."""
    cells, wanted = layout.first_cells(), {}
    for candidate in text_candidates(layout):
        filled = cells[candidate.key]
        is_text = 2 * sum(map(is_number, filled)) < len(filled)
        wanted[str(candidate.key)] = Wanted(candidate.key, is_text, candidate.name)
    return wanted


def _parquet_views(sources: Sequence[Source], options: ReadOptions) -> list[FileView]:
    """Inspect Parquet files; only the first one has the ranges of its channels."""
    from beltid.bench.channels.parquet_tables import candidates_of
    from beltid.bench.formats import parquet

    first = parquet.ParquetTable.of(sources[0])
    schema, n = first.schema, first.content.metadata.num_rows
    numeric = [
        name
        for name in schema.names
        if schema.names.count(name) == 1 and parquet.holds_numbers(schema.field(name))
    ]
    candidates = candidates_of(first, MappingContext(ANY_TABLE, options))
    views = {c.name: ChannelView(c, 0 if c.name in numeric else n) for c in candidates}
    for batch in parquet.batches_of(first, numeric):
        for name, values in zip(batch.schema.names, batch.columns, strict=True):
            views[name] = views[name].with_numbers(numbers_of(values))
    return [
        FileView(source.name, "Parquet", "", () if k else tuple(views.values()))
        for k, source in enumerate(sources)
    ]


def _rig_meant(view: FileView, config: Any) -> dict[str, str]:
    """Return the `rig` keys that the channels require and the config does not state."""
    if config.rig.model_fields_set & {"kind", "weight_on"}:
        return {}
    shares = {
        rig_kind: _share_of(view, schemas.rig_table(*rig_kind), config)
        for rig_kind in schemas.RIG_KINDS
    }
    best = max(shares, key=lambda rig_kind: shares[rig_kind])
    if shares[best] < 1.0 or best[0] == "two_cells":
        return {}
    return {"kind": best[0]} | ({"weight_on": best[1]} if best[0] == "dead_weight" else {})


def _kind_meant(view: FileView, config: Any, path: Path) -> str:
    """Recognise the kind of recording by its sensors."""
    if _is_table_of_plateaus(view, config):
        return "points"
    kinds = ("press", "speedloss", "rig")
    tables = {kind: [ReadOptions.of(config, kind).table(kind)] for kind in kinds}
    if not config.rig.model_fields_set & {"kind", "weight_on"}:
        tables["rig"] += [schemas.rig_table(*rig_kind) for rig_kind in schemas.RIG_KINDS]
    shares = {k: max(_share_of(view, table, config) for table in tables[k]) for k in kinds}
    # if no kind has all its sensors (units may be ambiguous), the explained channels decide
    whole = max(shares.values()) == 1.0
    marks = {
        kind: (share, 0 if whole or share == 0.0 else _explained(view, kind, config))
        for kind, share in shares.items()
    }
    best = max(marks, key=lambda kind: marks[kind][::-1])
    if shares[best] == 0 or list(marks.values()).count(marks[best]) > 1:
        channel_names = ", ".join(c.name for c in view.candidates[:20]) or "none"
        raise InputError(
            f"{path}: the channels do not show the kind of recording, say --kind press, rig, "
            f"speedloss or points; found: {channel_names}"
        )
    return best


def _explained(view: FileView, kind: str, config: Any) -> int:
    """Count the channels that a kind of recording reads or may have a column for."""
    mappings = _mappings(view, kind, config)
    return len(mappings) + len(_can_be(view, [kind], mappings, config))


def _is_table_of_plateaus(view: FileView, config: Any) -> bool:
    """Return whether each row is a plateau: a speed and an arc or a coefficient, but no time."""
    if any(np.isfinite(channel.rate_Hz) for channel in view.channels):
        return False
    columns_by_kind = {
        kind: _columns_meant(view, schemas.table(kind), config) for kind in ("rig", "points")
    }
    if "time_s" in columns_by_kind["rig"]:
        return False
    columns = columns_by_kind["points"]
    has_speed = bool(columns & {"pulley_speed_rad_s", "slip_speed_m_s"})
    return has_speed and ("arc_deg" in columns or {"mu", "normal_force_N_m"} <= columns)


def _share_of(view: FileView, table: Table, config: Any) -> float:
    """Return the share of a table's sensors that the file has channels for."""
    sensors = set(sensors_of(table))
    if "weight_N" in table.names and table.column("weight_N").required:
        sensors.add("weight_N")  # not a sensor, but the only mark of such a bench
    columns = _columns_meant(view, table, config)
    count = len(sensors & columns)
    if sensors == TORQUE_SENSORS:  # one of the two tensions is enough
        either = bool(columns & {"tension_tight_N", "tension_slack_N"})
        return (count + either) / (len(sensors) + 1)
    return count / len(sensors)


def _columns_meant(view: FileView, table: Table, config: Any) -> set[str]:
    """Return the columns of a table that channels of the file can be."""
    context = MappingContext(table, ReadOptions.of(config, table.kind))
    return set(channels_meant(view.candidates, context))


def _mappings(view: FileView, kind: str, config: Any) -> dict[str, ChannelMapping]:
    """Map the channels of a file to our columns, as far as possible."""
    options = ReadOptions.of(config, kind)
    table = options.table(kind)
    mappings: dict[str, ChannelMapping] = {}
    for group in _groups(view.candidates):
        mappings = {**map_channels(group, MappingContext(table, options)), **mappings}
    return mappings


def _can_be(
    view: FileView, kinds: Sequence[str], mappings: dict[str, ChannelMapping], config: Any
) -> dict[str, tuple[str, ...]]:
    """Return which columns unread channels can be, by their unit or a known word in their name."""
    read_names = {m.candidate.qualified for m in mappings.values()}
    roles_by_channel: dict[str, tuple[str, ...]] = {}
    for candidate in view.candidates:
        roles: list[str] = []
        for kind in kinds if candidate.qualified not in read_names else ():
            options = ReadOptions.of(config, kind)
            missing_columns = [
                c
                for c in options.table(kind).columns
                if c.dtype == "float64" and c.required and c.name not in mappings
            ]
            possible = [c.name for c in missing_columns if can_be(candidate, c)]
            hinted = [name for name in possible if name in roles_hinted(candidate.name, kind)]
            has_unit = bool(unit_of(candidate) or candidate.written)
            sensors = [name for name in possible if name not in schemas.SETTINGS]
            roles += hinted or (sensors if has_unit else [])
        if roles:
            roles_by_channel[candidate.qualified] = tuple(dict.fromkeys(roles))
    return roles_by_channel


def _groups(candidates: Sequence[Candidate]) -> list[list[Candidate]]:
    groups: dict[str, list[Candidate]] = {}
    for candidate in candidates:
        groups.setdefault(candidate.group, []).append(candidate)
    return list(groups.values())


def runs_found(columns: dict[str, np.ndarray], kind: str) -> list[RunView]:
    """Return the runs of a recording, in the order of their first sample."""
    label = schemas.table(kind).label
    labels = Texts.of(columns[label])
    sensors = {name: x for name, x in columns.items() if name != label and x.dtype != object}
    order = np.argsort(labels.codes, kind="stable")
    bounds = np.cumsum(np.bincount(labels.codes))[:-1]
    return [
        _run_view(word, {name: values[rows] for name, values in sensors.items()}, kind)
        for word, rows in zip(labels.words, np.split(order, bounds), strict=False)
    ]


def _run_view(label: str, columns: dict[str, np.ndarray], kind: str) -> RunView:
    if "time_s" not in columns:
        return RunView(label, 1, np.nan, np.nan, (), _settings(columns, kind))
    time = columns["time_s"]
    steps = np.diff(time)
    step = float(np.median(steps)) if steps.size else 0.0
    gap_starts = np.flatnonzero(steps > 3.0 * step) if step > 0 else np.empty(0, dtype=int)
    return RunView(
        label,
        len(time),
        float(time[-1] - time[0]),
        1.0 / step if step > 0 else np.nan,
        tuple(float(time[i]) for i in gap_starts),
        _settings(columns, kind),
    )


def _settings(part: dict[str, np.ndarray], kind: str) -> dict[str, float]:
    """Return the settings of a run."""
    settings = {}
    for name in ("arc_deg", "initial_tension_N", "weight_N", "temperature_degC"):
        values = part.get(name)
        if values is not None and np.isfinite(values).any():
            settings[name] = float(np.nanmedian(values))
    speed = {"rig": "pulley_speed_rad_s", "speedloss": "driver_speed_rad_s"}.get(kind)
    if speed is not None and np.isfinite(part[speed]).any():
        turning = np.abs(part[speed])
        # omit the rest phase; the highest samples alone would show sensor noise
        turning = turning[turning >= 0.5 * np.nanquantile(turning, 0.9)]
        settings[speed] = float(np.median(turning))
    if kind == "press":
        settings["force_N"] = float(np.nanmax(np.abs(part["force_N"])))
    return settings


def _text_format(text: str) -> str:
    """Recognise the program that wrote a text file from its first lines."""
    head = text[:4000]
    if head.startswith("MTS793|"):
        return "MTS 793 text"
    if "Standardkraft" in head or "Standardweg" in head or "Traversenweg" in head:
        return "Zwick testXpert text"
    return "CSV"

"""What was understood of files before anything is computed with them: formats, channels, runs."""

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
"""Any of our names makes the header of a tidy file plain to see."""


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
    n_samples: int = 0
    rate_Hz: float = np.nan
    low: float = np.nan
    high: float = np.nan
    first: float = np.nan

    def with_numbers(self, numbers: np.ndarray) -> ChannelView:
        """The same channel with more samples of it."""
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


@dataclass(frozen=True, slots=True)
class Inspection:
    """What was understood of a recording.

    Attributes
    ----------
    kind : str
        Kind of recording, stated or recognised.
    files : tuple of FileView
        Its files; channels are looked at in the first one where all are alike.
    mappings : dict of str to ChannelMapping
        Our columns -> how they are read, as far as it is decided.
    runs : tuple of RunView
        Its runs; none where it is not understood yet.
    notes : tuple of str
        What was found out.
    problems : tuple of str
        What is still to be told; none where the recording can be read.
    rig : dict of str to str
        Keys of the section `rig` that the channels ask for and the config does not state.
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
    """Look at files of any size, and read them as the stage of their kind does.

    Parameters
    ----------
    path : Path
        File, folder, pattern or zip file.
    config : Config
        What is known about the files already.
    kind : str, optional
        Kind of recording; None: found out from the channels. It is "" in the result where it
        cannot be found out.

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
    known = recording.mappings if isinstance(recording, Recording) else {}
    mappings = known or _mappings(files[0], kind, config)
    if rig:
        notes = (*notes, f"the channels are those of rig.kind: {rig['kind']}")
    return Inspection(kind, tuple(files), mappings, tuple(runs), notes, (), rig)


def _looked_into(path: Path, config: Any) -> tuple[list[FileView], list[Opened]]:
    """Files as they were understood, and those that are read at once as they were opened."""
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
    for wrong in (text for one in opened for text in one.wrong):
        problems.add(wrong)
    problems.raise_if_any()
    return [_view(one, options) for one in opened], opened


def _view(opened: Opened, options: ReadOptions) -> FileView:
    """An opened file, with the range of its channels."""
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
    """Columns of a table in a text file, with their range; `encoding` is that of the chunks."""
    views = {str(c.key): ChannelView(c) for c in text_candidates(layout)}
    for rows in csv_blocks(chunks, layout, _looked_at(layout), encoding, name, []):
        nothing = np.full(len(rows), np.nan)
        views = {k: v.with_numbers(rows.numbers.get(k, nothing)) for k, v in views.items()}
    notes = (*decoded.notes, *layout.notes)
    channels = tuple(views.values())
    format_name = _text_format(decoded.text)
    return FileView(name, format_name, decoded.encoding, channels, layout.fields, notes)


def _looked_at(layout: Layout) -> dict[str, Wanted]:
    """All columns of a text file: as numbers where the first rows hold mostly numbers."""
    cells, wanted = layout.first_cells(), {}
    for candidate in text_candidates(layout):
        filled = cells[candidate.key]
        is_text = 2 * sum(map(is_number, filled)) < len(filled)
        wanted[str(candidate.key)] = Wanted(candidate.key, is_text, candidate.name)
    return wanted


def _parquet_views(sources: Sequence[Source], options: ReadOptions) -> list[FileView]:
    """Parquet files; the range of the channels is looked for in the first one."""
    from beltid.bench.channels.parquet_tables import candidates_of
    from beltid.bench.formats import parquet

    first = parquet.ParquetTable.of(sources[0])
    there, n = first.schema, first.content.metadata.num_rows
    numeric = [
        name
        for name in there.names
        if there.names.count(name) == 1 and parquet.holds_numbers(there.field(name))
    ]
    candidates = candidates_of(first, MappingContext(ANY_TABLE, options))
    views = {c.name: ChannelView(c, 0 if c.name in numeric else n) for c in candidates}
    for batch in parquet.batches_of(first, numeric):
        for name, values in zip(batch.schema.names, batch.columns, strict=True):
            views[name] = views[name].with_numbers(numbers_of(values))
    for name, value in first.folders.items():
        number = float(value) if is_number(value) else np.nan
        views[name] = replace(views[name], low=number, high=number, first=number)
    return [
        FileView(source.name, "Parquet", "", () if k else tuple(views.values()))
        for k, source in enumerate(sources)
    ]


def _rig_meant(view: FileView, config: Any) -> dict[str, str]:
    """What the channels say of the rig where they are not those that the config states."""
    if config.rig.model_fields_set & {"kind", "weight_on"}:
        return {}
    shares = {
        found: _share_of(view, schemas.rig_table(*found), config) for found in schemas.RIG_KINDS
    }
    best = max(shares, key=lambda found: shares[found])
    if shares[best] < 1.0 or best[0] == "two_cells":
        return {}
    return {"kind": best[0]} | ({"weight_on": best[1]} if best[0] == "dead_weight" else {})


def _kind_meant(view: FileView, config: Any, path: Path) -> str:
    """The kind of recording whose sensors the channels are."""
    if _is_table_of_plateaus(view, config):
        return "points"
    kinds = ("press", "speedloss", "rig")
    tables = {kind: [ReadOptions.of(config, kind).table(kind)] for kind in kinds}
    if not config.rig.model_fields_set & {"kind", "weight_on"}:
        tables["rig"] += [schemas.rig_table(*found) for found in schemas.RIG_KINDS]
    shares = {k: max(_share_of(view, table, config) for table in tables[k]) for k in kinds}
    # sensors that share a unit are no sensor of their kind yet: then the channels explained decide
    whole = max(shares.values()) == 1.0
    marks = {
        kind: (share, 0 if whole or share == 0.0 else _explained(view, kind, config))
        for kind, share in shares.items()
    }
    best = max(marks, key=lambda kind: marks[kind][::-1])
    if shares[best] == 0 or list(marks.values()).count(marks[best]) > 1:
        found = ", ".join(c.name for c in view.candidates[:20]) or "none"
        raise InputError(
            f"{path}: the channels do not tell what it is a recording of, say --kind press, rig, "
            f"speedloss or points; found: {found}"
        )
    return best


def _explained(view: FileView, kind: str, config: Any) -> int:
    """How many channels a kind of recording reads, or has a column for."""
    mappings = _mappings(view, kind, config)
    return len(mappings) + len(_can_be(view, [kind], mappings, config))


def _is_table_of_plateaus(view: FileView, config: Any) -> bool:
    """Whether a row is a plateau: a speed and an arc or a coefficient, and no time."""
    if any(np.isfinite(channel.rate_Hz) for channel in view.channels):
        return False
    there = {kind: _there(view, schemas.table(kind), config) for kind in ("rig", "points")}
    if "time_s" in there["rig"]:
        return False
    found = there["points"]
    slides = bool(found & {"pulley_speed_rad_s", "slip_speed_m_s"})
    return slides and ("arc_deg" in found or {"mu", "normal_force_N_m"} <= found)


def _share_of(view: FileView, table: Table, config: Any) -> float:
    """Share of the sensors of a table that the channels of a file can be."""
    sensors = set(sensors_of(table))
    if "weight_N" in table.names and table.column("weight_N").required:
        sensors.add("weight_N")  # no sensor, but nothing else tells such a bench
    there = _there(view, table, config)
    found = len(sensors & there)
    if sensors == TORQUE_SENSORS:  # one of both tensions is enough
        either = bool(there & {"tension_tight_N", "tension_slack_N"})
        return (found + either) / (len(sensors) + 1)
    return found / len(sensors)


def _there(view: FileView, table: Table, config: Any) -> set[str]:
    """Our columns of a table that channels of a file can be meant by."""
    context = MappingContext(table, ReadOptions.of(config, table.kind))
    return set(channels_meant(view.candidates, context))


def _mappings(view: FileView, kind: str, config: Any) -> dict[str, ChannelMapping]:
    """How channels are read, as far as it is decided."""
    options = ReadOptions.of(config, kind)
    table = options.table(kind)
    found: dict[str, ChannelMapping] = {}
    for group in _groups(view.candidates):
        found = {**map_channels(group, MappingContext(table, options)), **found}
    return found


def _can_be(
    view: FileView, kinds: Sequence[str], mappings: dict[str, ChannelMapping], config: Any
) -> dict[str, tuple[str, ...]]:
    """What channels that are not read can be: by their unit, or by a known word in their name."""
    read = {m.candidate.qualified for m in mappings.values()}
    found: dict[str, tuple[str, ...]] = {}
    for candidate in view.candidates:
        roles: list[str] = []
        for kind in kinds if candidate.qualified not in read else ():
            options = ReadOptions.of(config, kind)
            open_columns = [
                c
                for c in options.table(kind).columns
                if c.dtype == "float64" and c.required and c.name not in mappings
            ]
            possible = [c.name for c in open_columns if can_be(candidate, c)]
            hinted = [name for name in possible if name in roles_hinted(candidate.name, kind)]
            told = bool(unit_of(candidate) or candidate.written)
            sensors = [name for name in possible if name not in schemas.SETTINGS]
            roles += hinted or (sensors if told else [])
        if roles:
            found[candidate.qualified] = tuple(dict.fromkeys(roles))
    return found


def _groups(candidates: Sequence[Candidate]) -> list[list[Candidate]]:
    groups: dict[str, list[Candidate]] = {}
    for candidate in candidates:
        groups.setdefault(candidate.group, []).append(candidate)
    return list(groups.values())


def runs_found(columns: dict[str, np.ndarray], kind: str) -> list[RunView]:
    """Runs of a recording, in the order of their first sample."""
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
    late = np.flatnonzero(steps > 3.0 * step) if step > 0 else np.empty(0, dtype=int)
    return RunView(
        label,
        len(time),
        float(time[-1] - time[0]),
        1.0 / step if step > 0 else np.nan,
        tuple(float(time[i]) for i in late),
        _settings(columns, kind),
    )


def _settings(part: dict[str, np.ndarray], kind: str) -> dict[str, float]:
    """What a run was made at."""
    settings = {}
    for name in ("arc_deg", "initial_tension_N", "weight_N", "temperature_degC"):
        values = part.get(name)
        if values is not None and np.isfinite(values).any():
            settings[name] = float(np.nanmedian(values))
    speed = {"rig": "pulley_speed_rad_s", "speedloss": "driver_speed_rad_s"}.get(kind)
    if speed is not None and np.isfinite(part[speed]).any():
        turning = np.abs(part[speed])
        # without the rest; the highest samples alone would be the noise of the sensor
        turning = turning[turning >= 0.5 * np.nanquantile(turning, 0.9)]
        settings[speed] = float(np.median(turning))
    if kind == "press":
        settings["force_N"] = float(np.nanmax(np.abs(part["force_N"])))
    return settings


def _text_format(text: str) -> str:
    """What wrote a table in a text file, where its first lines tell."""
    head = text[:4000]
    if head.startswith("MTS793|"):
        return "MTS 793 text"
    if "Standardkraft" in head or "Standardweg" in head or "Traversenweg" in head:
        return "Zwick testXpert text"
    return "CSV"

"""Recordings of the benches: files of any format in, validated columns out."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from beltid.artifacts.hashing import sha256
from beltid.bench.channels.channel_mapping import (
    ChannelMapping,
    MappingContext,
    stated_conversions,
)
from beltid.bench.files.sources import (
    Source,
    are_parquet,
    is_many,
    names_and_contents_sha256,
    refuse_large,
    sources_of,
)
from beltid.bench.formats.dialect import ReadOptions
from beltid.bench.formats.frames import columns_of_frame
from beltid.bench.opening import Opened, open_sources, read_opened
from beltid.bench.problems import Problems
from beltid.bench.runs.checks import Checker
from beltid.bench.runs.joining import completed, joined
from beltid.errors import InputError
from beltid.tables import schemas
from beltid.tables.columns import Table


@dataclass(frozen=True, slots=True)
class Recording:
    """A recording of a bench, validated.

    Attributes
    ----------
    kind : str
        "press", "rig" or "speedloss".
    columns : dict of str to ndarray
        The columns of the schema in its order and units: float64 with nan where a number is
        missing, object arrays of str for labels. An optional column that the file does not have
        is all nan.
    path : Path
        The file.
    sha256 : str
        Hash of the bytes of the file.
    notes : tuple of str
        What was found out, left out or missing.
    lines : ndarray
        Line of every row in the file, from 1; empty for files without lines, or several.
    mappings : dict
        Our columns -> how they were read; empty where the file has our own columns.
    """

    kind: str
    columns: dict[str, np.ndarray]
    path: Path
    sha256: str
    notes: tuple[str, ...] = ()
    lines: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    mappings: dict[str, ChannelMapping] = field(default_factory=dict)

    def line_of(self, index: int) -> int:
        """Line in the file, from 1, of the row with this index; for Parquet the row, from 1."""
        return int(self.lines[index]) if self.lines.size else index + 1


def read_recording(path: str | Path, kind: str, config: Any = None) -> Recording:
    """Read a recording and check that it can be what it claims to be.

    Parameters
    ----------
    path : path
        A file of any format that benches write (see `beltid.bench.formats`), plain or packed with
        gzip; a Parquet file with the columns of the kind; or a folder, a pattern such as
        ``runs/*.lvm`` or a zip file with a file per run.
    kind : {"press", "rig", "speedloss"}
        What it is a recording of.
    config : Config, optional
        Names, units and dialect of the bench's files, and where settings of the runs stand.

    Raises
    ------
    InputError
        With everything that is wrong, each with its line.
    """
    path = Path(path)
    options = ReadOptions.of(config, kind)
    tables = [] if options.runs is None or options.runs.table is None else [options.runs.table]
    return recording_from(sources_of(path, tables), path, kind, options)


def recording_from(
    sources: Sequence[Source], path: Path, kind: str, options: ReadOptions
) -> Recording:
    """The recording in some files; see `read_recording`."""
    if is_many(path):
        refuse_large(path, sources)
        digest = names_and_contents_sha256(sources)
    else:
        digest = sha256(sources[0].data)
    if are_parquet(sources):
        columns, notes = _from_parquet(sources, path, kind, options)
        return Recording(kind, columns, path, digest, notes)
    return recording_of(open_sources(sources, options), path, kind, options, digest)


def recording_of(
    opened: Sequence[Opened], path: Path, kind: str, options: ReadOptions, digest: str
) -> Recording:
    """The recording that opened files hold.

    Parameters
    ----------
    opened : sequence of Opened
        The files.
    path : Path
        What was named.
    kind : {"press", "rig", "speedloss"}
        What it is a recording of.
    options : ReadOptions
        What the config states.
    digest : str
        SHA-256 of names and contents.

    Raises
    ------
    InputError
        With everything that is wrong, each with its line.
    """
    table, problems = schemas.table(kind), Problems()
    read = [read_opened(one, table, options, problems) for one in opened]
    if not all(read):  # what cannot be read at all; wrong rows are told with what the checks find
        problems.told_once([one.name for one in opened])
        problems.raise_if_any()
    raw_tables = [raw for found in read for raw in found]
    columns, rows, notes, stated = joined(raw_tables, table, options, str(path), problems)

    def place(index: int) -> tuple[str, int]:
        return rows.place_of(index)

    notes += Checker(str(path), columns, table, place, problems).run({*options.units, *stated})
    problems.raise_if_any()
    lines = rows.lines if len(raw_tables) == 1 else np.empty(0, dtype=np.int64)
    mappings = {r: mapping for raw in raw_tables for r, mapping in raw.mappings.items()}
    return Recording(kind, columns, path, digest, tuple(notes), lines, mappings)


def columns_of(frame: Any, kind: str, config: Any = None) -> dict[str, np.ndarray]:
    """Columns of a recording that is in memory, checked as those of a file.

    Parameters
    ----------
    frame : DataFrame, pyarrow Table, mapping or Recording
        The samples; other columns than those of the kind are left out.
    kind : {"press", "rig", "speedloss"}
        What it is a recording of.
    config : Config, optional
        Names and units of the columns.

    Raises
    ------
    InputError
        With everything that is wrong, each with its row.
    """
    if isinstance(frame, Recording):
        frame = frame.columns
    table, options, problems = schemas.table(kind), ReadOptions.of(config, kind), Problems()
    columns = columns_of_frame(frame, table, "frame", options.names, problems)
    problems.raise_if_any()
    return _checked(columns, table, "frame", options)[0]


def _from_parquet(
    sources: Sequence[Source], path: Path, kind: str, options: ReadOptions
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Columns of Parquet files: an artifact of ours (simulated), or files of the same columns."""
    from beltid.artifacts.artifact import SEAL_KEY, artifact_from_bytes
    from beltid.bench.formats.parquet import open_source, parquet_blocks

    table, sources = schemas.table(kind), [source.loaded() for source in sources]
    about = open_source(sources[0], ()).schema_arrow.metadata or {}
    if len(sources) == 1 and SEAL_KEY in about:
        needed = "simulated" if kind == "rig" else None
        artifact = artifact_from_bytes(sources[0].data, path, needed)
        if needed is None:
            raise InputError(f"{path}: is a {artifact.kind} artifact, a {kind} recording is needed")
        problems = Problems()
        columns = columns_of_frame(artifact.columns, table, str(path), {}, problems)
        problems.raise_if_any()
        return _checked(columns, table, str(path), ReadOptions(), units_stated=table.names)
    blocks = list(parquet_blocks(sources, table, options.names))
    if not any(map(len, blocks)):
        raise InputError(f"{path}: holds no samples")
    parts = [block.columns() for block in blocks]
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return _checked(columns, table, str(path), options)


def _checked(
    columns: dict[str, np.ndarray],
    table: Table,
    name: str,
    options: ReadOptions,
    units_stated: Collection[str] = (),
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Columns that hold our names, converted as the config states and checked; and notes."""
    problems = Problems()
    columns = completed(columns, table, len(next(iter(columns.values()))))
    conversions = stated_conversions(MappingContext(table, options, name))
    for column, by in conversions.items():
        columns[column] = (columns[column] + by.shift) * by.factor

    def place(index: int) -> tuple[str, int]:
        return f"{name}, row {index + 1}", index + 1

    notes = Checker(name, columns, table, place, problems).run({*units_stated, *conversions})
    problems.raise_if_any()
    return columns, tuple(notes)

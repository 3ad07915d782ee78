"""Recordings of the benches: files of any format in, validated columns out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from beltid.artifacts.file_bytes import refuse_large
from beltid.bench.channels.channel_units import unit_conversion
from beltid.bench.channels.readings import Question, Reading
from beltid.bench.files.sources import content_sha256, sources_of
from beltid.bench.formats.dialect import ReadOptions
from beltid.bench.formats.frames import columns_of_frame
from beltid.bench.opening import Opened, open_sources, read_opened
from beltid.bench.problems import Problems
from beltid.bench.runs.checks import Checker
from beltid.bench.runs.joining import completed, joined
from beltid.errors import InputError
from beltid.tables import schemas
from beltid.tables.units import Conversion


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
    readings : dict
        Our columns -> how they were read; empty where the file has our own columns.
    """

    kind: str
    columns: dict[str, np.ndarray]
    path: Path
    sha256: str
    notes: tuple[str, ...] = ()
    lines: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    readings: dict[str, Reading] = field(default_factory=dict)

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
    besides = [] if options.runs is None or options.runs.table is None else [options.runs.table]
    sources = sources_of(path, besides)
    refuse_large(path, list(dict.fromkeys(source.path for source in sources)))
    digest = content_sha256(path, besides)
    if len(sources) == 1:
        data = sources[0].read()
        if data[:4] == b"PAR1":
            columns, told = _from_parquet(data, path, kind, options)
            return Recording(kind, columns, path, digest, told)
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
    pieces = [piece for found in read for piece in found]
    columns, rows, notes, stated = joined(pieces, table, options, str(path), problems)

    def place(index: int) -> tuple[str, int]:
        return rows.place_of(index)

    notes += Checker(str(path), columns, table, place, problems).run({*options.units, *stated})
    problems.raise_if_any()
    lines = rows.lines if len(pieces) == 1 else np.empty(0, dtype=np.int64)
    readings = {r: reading for piece in pieces for r, reading in piece.readings.items()}
    return Recording(kind, columns, path, digest, tuple(notes), lines, readings)


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
    return _checked_frame(frame, kind, "frame", ReadOptions.of(config, kind))[0]


def _convert(columns: dict[str, np.ndarray], conversions: Mapping[str, Conversion]) -> None:
    for column, by in conversions.items():
        if by != Conversion(1.0):
            columns[column] = (columns[column] + by.shift) * by.factor


def _from_parquet(
    data: bytes, path: Path, kind: str, options: ReadOptions
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Columns of a Parquet file: an artifact of ours (simulated) or one with the same columns."""
    from beltid.artifacts.artifact import SEAL_KEY, artifact_from_bytes
    from beltid.artifacts.parquet_open import damaged, open_parquet, refused_columns

    table, names = schemas.table(kind), options.names
    wanted = {names.get(column.name, column.name): column.required for column in table.columns}
    label = names.get(table.label, table.label)
    file = open_parquet(data, [label], str(path), InputError)
    there = file.schema_arrow
    sealed = SEAL_KEY in (there.metadata or {})
    if problems := [] if sealed else refused_columns(there, list(wanted), label, str(path)):
        raise InputError(problems)
    # all of them where one is missing: the message tells what is there
    missing = any(needed and column not in there.names for column, needed in wanted.items())
    chosen = None if missing else [column for column in wanted if column in there.names]
    try:
        frame = None if sealed else file.read(use_threads=False, columns=chosen)
        if frame is not None:
            frame.validate(full=True)
    except Exception as error:  # a damaged file can raise nearly anything
        raise InputError(f"{path}: {damaged(error)}") from None
    if sealed:
        needed = "simulated" if kind == "rig" else None
        artifact = artifact_from_bytes(data, path, needed)
        if needed is None:
            raise InputError(f"{path}: is a {artifact.kind} artifact, a {kind} recording is needed")
        frame, options = artifact.columns, ReadOptions()
    return _checked_frame(frame, kind, str(path), options, units_known=sealed)


def _checked_frame(
    frame: Any, kind: str, name: str, options: ReadOptions, *, units_known: bool = False
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    table = schemas.table(kind)
    problems = Problems()
    columns = columns_of_frame(frame, table, name, options.names, problems)
    problems.raise_if_any()
    length = len(next(iter(columns.values())))
    columns = completed(columns, table, length)
    question = Question(table, options, name)
    conversions = {
        ours: known
        for ours in options.units
        if isinstance(
            known := unit_conversion(table.column(ours), ours, "", question, False), Conversion
        )
    }
    _convert(columns, conversions)

    def place(index: int) -> tuple[str, int]:
        return f"{name}, row {index + 1}", index + 1

    stated = table.names if units_known else conversions
    notes = Checker(name, columns, table, place, problems).run(stated)
    problems.raise_if_any()
    return columns, tuple(notes)

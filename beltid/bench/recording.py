"""Read recordings of the benches: files of any format in, validated columns out.

`big_recording` reads big recordings of the friction rig run by run.
"""

from __future__ import annotations

import contextlib
import gzip
import io
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from beltid.artifacts.file_bytes import opened as opened_file
from beltid.bench.big_recording import BigRecording, open_big
from beltid.bench.channels.channel_mapping import (
    ChannelMapping,
    MappingContext,
    RawTable,
)
from beltid.bench.channels.text_tables import read_text
from beltid.bench.files.archives import unpacked
from beltid.bench.files.sniff import (
    GZIP,
    ISOLATED,
    LVM,
    PARQUET,
    TEXT,
    UFF,
    ZIP,
    Decoded,
    decode,
    sniff,
)
from beltid.bench.files.sources import (
    Source,
    are_parquet,
    folders_left_out,
    is_many,
    refuse_large,
    signature_of,
    size_of,
    sources_in,
    sources_of,
)
from beltid.bench.formats.bench_file import BenchFile
from beltid.bench.formats.rows import completed
from beltid.bench.read_options import ReadOptions
from beltid.bench.runs.checks import Checker
from beltid.bench.runs.run_settings import joined
from beltid.errors import InputError, Problems
from beltid.tables import schemas

if TYPE_CHECKING:
    import pandas as pd

    from beltid.bench.formats.parquet import ParquetTable

IN_OUR_UNITS: Final = "in_our_units"
"""Attribute of a DataFrame that is in our names and units already: read with its config, or
computed."""
BIG: Final = 64 << 20
"""Smallest size of a recording that is read run by run [bytes, unpacked]."""


@dataclass(frozen=True, slots=True)
class Recording:
    """A recording of a bench, validated.

    Attributes
    ----------
    kind : str
        "press", "rig" or "speedloss".
    columns : dict of str to ndarray
        The columns of the schema in its order and units: float64 with nan for missing numbers,
        object arrays of str for labels. An optional column that the file lacks is all nan.
    path : Path
        The file.
    notes : tuple of str
        Notes on what was recognised, left out or missing.
    mappings : dict
        Our columns -> how they were read; empty if the file has our own columns.
    is_artifact : bool
        Whether it is a simulated recording: an artifact of ours.
    """

    kind: str
    columns: dict[str, np.ndarray]
    path: Path
    notes: tuple[str, ...] = ()
    mappings: dict[str, ChannelMapping] = field(default_factory=dict)
    is_artifact: bool = False

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return len(self.columns[schemas.table(self.kind).label])


def read_recording(path: str | Path, kind: str, config: Any = None) -> Recording:
    """Read a recording and check that it is plausible.

    Parameters
    ----------
    path : path
        A file of any format that benches write (see `beltid.bench.formats`), plain or
        gzip-compressed; a Parquet file with the columns of the kind; or a folder, a pattern such as
        ``runs/*.lvm`` or a zip file with a file per run.
    kind : {"press", "rig", "speedloss"}
        Kind of recording.
    config : Config, optional
        Names, units and dialect of the bench's files, and where to find settings of the runs.

    Raises
    ------
    InputError
        With all errors, each with its line.
    """
    path = Path(path)
    options = ReadOptions.of(config, kind)
    tables = filter(None, [options.runs["table"]])
    return recording_from(sources_of(path, [*tables]), path, kind, options)


def is_big(path: Path) -> bool:
    """Return whether a recording is so big on disk that helper processes pay off.

    `read_rig` decides whether it is read run by run: a small file may be compressed.
    """
    return sum(file.size for file in signature_of(path)) >= BIG


def read_rig(path: Path, config: Any = None) -> Recording | BigRecording:
    """Read a recording of the friction rig; run by run if it is big and its rows hold all settings.

    Parameters
    ----------
    path : Path
        A file, folder, pattern or zip file; see `beltid.bench.recording.read_recording`.
    config : Config, optional
        Names, units and dialect of the bench's files, and where to find settings of the runs.

    Raises
    ------
    InputError
        With all errors in a recording that is read at once, or in the head of a big one.
    """
    options = ReadOptions.of(config, "rig")
    sources = sources_read_at_once(path, options)
    if sources is None:
        return open_big(path, config)
    return recording_from(sources, path, "rig", options)


def sources_read_at_once(path: Path, options: ReadOptions) -> list[Source] | None:
    """Return the files of a recording that is read at once; None if it is read run by run.

    Raises
    ------
    InputError
        If there is no file, or it is too large to read at once and cannot be read run by run.
    """
    runs = options.runs
    in_rows = runs == ReadOptions().runs
    tables = [table] if (table := runs["table"]) else []
    if is_many(path):
        sources = sources_of(path, tables)
        return None if in_rows and size_of(sources) >= BIG and are_parquet(sources) else sources
    with opened_file(path) as file:
        data = file.read(BIG)
    whole = len(data) < BIG
    if in_rows and _is_stream(data, path, whole=whole):
        return None
    if not data:
        raise InputError(f"{path}: the file is empty")
    return sources_in(data, path) if whole else sources_of(path)


def _is_stream(data: bytes, path: Path, *, whole: bool) -> bool:
    """Return whether a file is big and its format can be read in blocks.

    Parameters
    ----------
    data : bytes
        Its first `BIG` bytes.
    path : Path
        The file.
    whole : bool
        Whether `data` is the whole file.
    """
    allowed: tuple[str, ...] = (TEXT, PARQUET)
    if sniff(data[:1024], path.name) == GZIP:
        allowed = (TEXT,)
        # the reader reports a damaged file
        with contextlib.suppress(OSError, EOFError, zlib.error):
            data = gzip.GzipFile(fileobj=io.BytesIO(data)).read(BIG if whole else 1024)
            whole = whole and len(data) < BIG
    kind = sniff(data[:1024], path.name.removesuffix(".gz"))
    return not whole and kind in allowed


def recording_from(
    sources: Sequence[Source], path: Path, kind: str, options: ReadOptions
) -> Recording:
    """Read the recording in one or more files; see `read_recording`."""
    if is_many(path):
        refuse_large(path, sources)
    if are_parquet(sources):
        recording = _from_parquet(sources, path, kind, options)
    else:
        recording = recording_of(open_sources(sources, options), path, kind, options)
    return replace(recording, notes=(*recording.notes, *folders_left_out(path, sources)))


def recording_of(
    opened: Sequence[Opened], path: Path, kind: str, options: ReadOptions
) -> Recording:
    """Read the recording in opened files.

    Parameters
    ----------
    opened : sequence of Opened
        The files.
    path : Path
        The path that the user named.
    kind : {"press", "rig", "speedloss"}
        Kind of recording.
    options : ReadOptions
        Options stated in the config.

    Raises
    ------
    InputError
        With all errors, each with its line.
    """
    table, problems = options.table(kind), Problems()
    tables_by_file = [
        read_opened(file, MappingContext(table, options, file.name, problems)) for file in opened
    ]
    if not all(tables_by_file):  # unreadable files; wrong rows are reported after the checks
        problems.merge_repeated([file.name for file in opened])
        problems.raise_if_any()
    raw_tables = [raw for tables in tables_by_file for raw in tables]
    return _joined(raw_tables, path, kind, options, problems)


def _joined(
    raw_tables: Sequence[RawTable], path: Path, kind: str, options: ReadOptions, problems: Problems
) -> Recording:
    """Join raw tables to a recording and check it."""
    table = options.table(kind)
    columns, place, notes, stated = joined(raw_tables, table, options, problems)
    checker, stated = Checker(str(path), columns, table, place, problems), {*options.units, *stated}
    notes += checker.run(stated)
    checker.compare_runs(stated)
    problems.raise_if_any()
    mappings = {r: mapping for raw in raw_tables for r, mapping in raw.mappings.items()}
    return Recording(kind, columns, path, tuple(notes), mappings)


def as_frame(columns: Mapping[str, np.ndarray], notes: Sequence[str] = ()) -> pd.DataFrame:
    """Return columns in our names and units as a DataFrame, marked as such for `columns_of`.

    Parameters
    ----------
    columns : mapping of str to ndarray
        The columns, shape (n,) each.
    notes : sequence of str
        Notes on them: ``.attrs["notes"]`` of the frame.
    """
    import pandas as pd

    frame = pd.DataFrame(columns)
    frame.attrs.update({"notes": list(notes), IN_OUR_UNITS: True})
    return frame


def columns_of(frame: Any, kind: str, config: Any = None) -> dict[str, np.ndarray]:
    """Return the columns of a recording in memory, checked like those of a file.

    Parameters
    ----------
    frame : DataFrame, pyarrow Table, mapping or Recording
        The samples; columns that the kind does not have are ignored.
    kind : {"press", "rig", "speedloss"}
        Kind of recording.
    config : Config, optional
        Names and units of the columns.

    Raises
    ------
    InputError
        With all errors, each with its row.
    """
    from beltid.bench.formats.frames import arrow_of
    from beltid.bench.formats.parquet import ParquetTable

    options, path = ReadOptions.of(config, kind), Path("frame")
    if isinstance(frame, Recording) or getattr(frame, "attrs", {}).get(IN_OUR_UNITS):
        options = ReadOptions(rig=options.rig)  # names and units are ours already
        frame = frame.columns if isinstance(frame, Recording) else frame
    values = options.runs["values"]  # a frame has no name and no header
    options = replace(options, runs={**ReadOptions().runs, "values": values})
    table = options.table(kind)
    arrow = arrow_of(frame, "frame", {options.names.get(name, name) for name in table.names})
    part = ParquetTable("frame", path, arrow, arrow.schema)
    recording = _of_tables([part], path, kind, options)
    if table.label not in recording.mappings and "time_s" in table.names:  # it may be the index
        raise InputError(f"frame: column {table.label} is missing")
    return recording.columns


def _of_tables(
    tables: Sequence[ParquetTable], path: Path, kind: str, options: ReadOptions
) -> Recording:
    """Read the recording in Parquet files or an Arrow table."""
    from beltid.bench.channels.parquet_tables import read_parquet

    context = MappingContext(options.table(kind), options)
    raw_tables = read_parquet(tables, path, context)
    if not raw_tables:
        context.problems.merge_repeated([table.name for table in tables])
        context.problems.raise_if_any()
    return _joined(raw_tables, path, kind, options, context.problems)


def _from_parquet(
    sources: Sequence[Source], path: Path, kind: str, options: ReadOptions
) -> Recording:
    """Read a recording in Parquet files: our artifact (simulated), or files of equal columns."""
    from beltid.artifacts.artifact import SEAL_KEY, artifact_from_bytes
    from beltid.bench.formats.parquet import ParquetTable

    sources = [source.loaded() for source in sources]
    tables = [ParquetTable.of(source) for source in sources]
    if len(tables) > 1 or SEAL_KEY not in (tables[0].schema.metadata or {}):
        return _of_tables(tables, path, kind, options)
    needed = "simulated" if kind == "rig" else None
    artifact = artifact_from_bytes(sources[0].data, path, needed)
    if needed is None:
        text = f"{path}: is a {artifact.kind} artifact, a {kind} recording is needed"
        raise InputError(text)
    table, problems = schemas.rig_table(), Problems()
    columns = completed(artifact.columns, table, len(artifact.columns[table.label]))
    checker = Checker(
        str(path), columns, table, lambda i: (f"{path}, row {i + 1}", i + 1), problems
    )
    notes = checker.run(table.names)
    problems.raise_if_any()
    return Recording(kind, columns, path, tuple(notes), is_artifact=True)


@dataclass(frozen=True, slots=True)
class Opened:
    """A file of known format: its text, its channels, or the reasons why it cannot be read.

    Attributes
    ----------
    name : str
        Its name, for messages.
    text : Decoded or None
        The text, for a text file.
    channels : BenchFile or None
        The contents, for any other format.
    wrong : tuple of str
        Reasons why it cannot be read.
    """

    name: str
    text: Decoded | None = None
    channels: BenchFile | None = None
    wrong: tuple[str, ...] = ()


def open_sources(sources: Sequence[Source], options: ReadOptions) -> list[Opened]:
    """Open files; those of formats whose readers may crash are read together in a child process."""
    from beltid.bench.formats.isolated.process import read_isolated, temporary_folder

    opened: list[Opened] = []
    jobs: dict[int, tuple[str, Path]] = {}
    folder: Path | None = None
    with contextlib.ExitStack() as stack:
        for number, source in enumerate(sources):
            try:
                found = _opened(source, options)
                if isinstance(found, tuple):
                    format_name, file = found
                    if isinstance(file, bytes):
                        folder = folder or Path(stack.enter_context(temporary_folder()))
                        (folder / str(number)).write_bytes(file)
                        file = folder / str(number)
                    jobs[number] = format_name, file
                    found = Opened(source.name)
            except InputError as error:
                found = Opened(source.name, wrong=error.problems)
            opened.append(found)
        contents_of_jobs = read_isolated(list(jobs.values())) if jobs else []
        for number, contents in zip(jobs, contents_of_jobs, strict=True):
            name = sources[number].name
            opened[number] = (
                Opened(name, wrong=tuple(contents.at(name)))
                if isinstance(contents, InputError)
                else Opened(name, channels=contents)
            )
    return opened


def read_opened(opened: Opened, context: MappingContext) -> list[RawTable]:
    """Read the columns of an opened file; `context` collects the problems."""
    for wrong in opened.wrong:
        context.problems.add(wrong)
    try:
        if opened.text is not None:
            return read_text(opened.text, context)
        if opened.channels is not None:
            from beltid.bench.channels.channel_groups import read_groups

            return read_groups(opened.channels, context)
    except InputError as error:
        for wrong in error.problems:
            context.problems.add(wrong)
    return []


def _opened(source: Source, options: ReadOptions) -> Opened | tuple[str, Path | bytes]:
    """Open a file, or return the format and the file or bytes that the child process must read."""
    data = plain = source.read()
    name = source.inside.name.removesuffix(".gz")
    format_name = sniff(data, name)
    if format_name == GZIP:
        plain = unpacked(data, source.path)
        format_name = sniff(plain, name)
    if format_name in ISOLATED:
        if plain is data and not source.is_member:
            return format_name, source.path
        return format_name, plain
    if format_name == LVM:
        from beltid.bench.formats import lvm

        decoded = decode(plain, source.name, options.dialect.encoding)
        return Opened(source.name, channels=lvm.read(decoded.text, source.name))
    if format_name == UFF:
        from beltid.bench.formats import uff

        return Opened(source.name, channels=uff.read(plain, source.name))
    refusal = {
        PARQUET: "a Parquet file among others, name it alone",
        **dict.fromkeys((ZIP, GZIP), "packed twice, unpack it"),
    }.get(format_name)
    if refusal:
        raise InputError(f"{source.name}: is {refusal}")
    decoded = decode(plain, source.name, options.dialect.encoding)
    return Opened(source.name, text=decoded)

"""Recordings of the friction rig of any size: big ones are read run by run.

A big CSV file, plain or packed with gzip, or big Parquet files; what a file is, its bytes tell.
"""

from __future__ import annotations

import codecs
import gzip
import io
import itertools
import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from beltid.artifacts.file_bytes import opened
from beltid.bench.channels.channel_mapping import (
    MappingContext,
    missing_setting,
    stated_conversions,
)
from beltid.bench.channels.text_tables import text_layout, text_notes, wanted_columns
from beltid.bench.channels.vocabulary import NOMINAL
from beltid.bench.files.ahead import ahead
from beltid.bench.files.sniff import GZIP, PARQUET, TEXT, Decoded, decode, sniff, unread
from beltid.bench.files.sources import (
    Source,
    are_parquet,
    is_many,
    size_of,
    sources_in,
    sources_of,
)
from beltid.bench.formats.csv_table import csv_blocks, file_chunks
from beltid.bench.formats.dialect import Layout, ReadOptions
from beltid.bench.recording import Recording, recording_from
from beltid.bench.runs.run_stream import RunColumns, RunStream
from beltid.errors import InputError, Problems
from beltid.tables import schemas
from beltid.tables.columns import Table

BIG: Final = 64 << 20
"""Bytes of a recording, unpacked, from which on it is read run by run."""
HEAD: Final = 1 << 20
_FEEDS: Final = "a file of this size must have line feeds"


@dataclass(frozen=True, slots=True)
class BigRecording:
    """A recording that is read run by run.

    Attributes
    ----------
    path : Path
        The file or folder.
    runs : RunStream
        Its runs.
    found_out : callable
        Returns the notes of now.
    """

    path: Path
    runs: RunStream
    found_out: Callable[[], tuple[str, ...]]

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found out, left out or missing; complete once the runs have been read."""
        return self.found_out()

    @property
    def n_samples(self) -> int:
        """Samples of the runs that have been read."""
        return self.runs.n_samples

    def __iter__(self) -> Iterator[RunColumns]:
        """The runs, in the order of the file."""
        return iter(self.runs)


def is_big(path: Path) -> bool:
    """Whether a recording takes that much on the disk that reading it is worth helpers.

    Whether it is read run by run, `read_rig` finds out: a small file may be packed.
    """
    try:
        if is_many(path):
            sources = sources_of(path)
            return size_of(sources) >= BIG and are_parquet(sources)
        if path.stat().st_size < BIG:
            return False
        with opened(path) as file:
            return sniff(file.read(1024), path.name) in (TEXT, PARQUET, GZIP)
    except (OSError, InputError):  # told by the one who reads it
        return False


def read_rig(path: Path, config: Any = None) -> Recording | BigRecording:
    """Read a recording of the friction rig: a big one whose rows tell all settings run by run.

    Parameters
    ----------
    path : Path
        A file, folder, pattern or zip file; see `beltid.bench.recording.read_recording`.
    config : Config, optional
        Names, units and dialect of the bench's files, and where settings of the runs stand.

    Raises
    ------
    InputError
        With everything that is wrong with a recording that is read at once, or the head of a big
        one.
    """
    options = ReadOptions.of(config, "rig")
    sources = sources_read_at_once(path, options)
    if sources is None:
        return open_big(path, config)
    return recording_from(sources, path, "rig", options)


def sources_read_at_once(path: Path, options: ReadOptions) -> list[Source] | None:
    """Files of a recording that is read at once; None if it is read run by run.

    Raises
    ------
    InputError
        If there is no file, or it is too large to be read at once and cannot be run by run.
    """
    runs = options.runs
    in_rows = runs is None or runs == type(runs)()
    tables = [] if runs is None or runs.table is None else [runs.table]
    if is_many(path):
        sources = sources_of(path, tables)
        return None if in_rows and size_of(sources) >= BIG and are_parquet(sources) else sources
    with opened(path) as file:
        data = file.read(BIG)
    whole = len(data) < BIG
    if in_rows and _is_stream(data, path, whole=whole):
        return None
    if not data:
        raise InputError(f"{path}: the file is empty")
    return sources_in(data, path) if whole else sources_of(path)


def open_big(path: Path, config: Any = None) -> BigRecording:
    """Open a recording of the friction rig to be read run by run, whatever its size.

    Parameters
    ----------
    path : Path
        A CSV file, plain or packed with gzip, a Parquet file, or a folder of Parquet files.
    config : Config, optional
        Names, units and dialect of the bench's files.

    Raises
    ------
    InputError
        If its head cannot be that of a recording of the friction rig; whatever is wrong further
        down is told while the runs are read.
    """
    options = ReadOptions.of(config, "rig")
    if is_many(path):
        return _parquet(sources_of(path), path, options)
    with opened(path) as file:
        magic = file.read(4)
    if magic == b"PAR1":
        return _parquet([Source(str(path), path, Path(path.name))], path, options)
    return _csv(path, options)


def _is_stream(data: bytes, path: Path, *, whole: bool) -> bool:
    """Whether a file that begins with these bytes is big, and of a format that is read in blocks.

    Parameters
    ----------
    data : bytes
        Its first `BIG` bytes.
    path : Path
        The file.
    whole : bool
        Whether they are all of it.
    """
    kind = sniff(data[:1024], path.name)
    if kind == GZIP:
        try:
            with gzip.GzipFile(fileobj=io.BytesIO(data)) as packed:
                data = packed.read(BIG if whole else 1024)
        except (OSError, EOFError, zlib.error):  # told by the one who reads it
            return False
        whole = whole and len(data) < BIG
        kind = sniff(data[:1024], path.name.removesuffix(".gz"))
        return not whole and kind == TEXT and not unread(data)
    return not whole and kind in (TEXT, PARQUET) and not unread(data)


@dataclass(frozen=True, slots=True)
class TextHead:
    """The head of a big text file, and the bytes that follow.

    Attributes
    ----------
    decoded : Decoded
        Text of the first lines.
    layout : Layout
        Header, units and separators.
    chunks : iterator of bytes
        The file from its first row on.
    """

    decoded: Decoded
    layout: Layout
    chunks: Iterator[bytes]


def read_head(path: Path, options: ReadOptions, table: Table) -> TextHead:
    """Head of a text file of any size, plain or packed with gzip.

    Raises
    ------
    InputError
        If the first lines are no text with a header.
    """
    name = str(path)
    chunks = ahead(file_chunks(path), 2)
    first = next(chunks, b"")
    if first[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE) or "16" in (options.encoding or ""):
        raise InputError(f"{name}: is in UTF-16; a file of this size must be in UTF-8")
    if len(first) > HEAD and b"\n" not in first[:HEAD]:
        raise InputError(f"{name}:1: no line feed in the first {HEAD:,} bytes; {_FEEDS}")
    head = first[:HEAD] if len(first) <= HEAD else first[: first.rfind(b"\n", 0, HEAD) + 1]
    decoded = decode(head, name, options.encoding)
    layout = text_layout(decoded, name, options, table)
    body = _after_lines(first, layout.first_line - 1)
    if re.search(rb"\r(?!\n)", first[: len(first) - len(body)]):
        raise InputError(f"{name}: lines that end in a carriage return alone; {_FEEDS}")
    return TextHead(decoded, layout, itertools.chain([body], chunks))


def _csv(path: Path, options: ReadOptions) -> BigRecording:
    name, table, problems = str(path), schemas.table("rig"), Problems()
    head = read_head(path, options, table)
    layout = head.layout
    mappings, wanted = wanted_columns(layout, name, table, options, problems)
    wrong = problems.count  # then the settings have been asked for as well
    for setting in NOMINAL:
        if setting not in mappings and not wrong:
            problems.add(missing_setting(setting, "rig", f"{name}:{layout.header_line}"))
    problems.raise_if_any()
    ends: list[str] = []
    blocks = csv_blocks(head.chunks, layout, wanted, head.decoded.encoding, name, ends)
    conversions = {role: m.conversion for role, m in mappings.items() if m.unit_stated or m.negated}
    runs = RunStream(ahead(blocks, 1), table, name, conversions, problems)
    told = (*layout.notes, *text_notes(layout, mappings, table))
    return BigRecording(path, runs, lambda: (*head.decoded.notes, *ends, *told, *runs.notes()))


def _after_lines(data: bytes, lines: int) -> bytes:
    """Bytes after some lines; none if there are not more."""
    at = 0
    for _ in range(lines):
        at = data.find(b"\n", at) + 1
        if not at:
            return b""
    return data[at:]


def _parquet(sources: Sequence[Source], path: Path, options: ReadOptions) -> BigRecording:
    from beltid.bench.formats.parquet import parquet_blocks

    table = schemas.table("rig")
    blocks = parquet_blocks(sources, table, options.names)
    conversions = stated_conversions(MappingContext(table, options))
    runs = RunStream(blocks, table, str(path), conversions, Problems())
    runs.row_word = ", row "
    return BigRecording(path, runs, lambda: tuple(runs.notes()))

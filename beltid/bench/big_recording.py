"""Recordings of the friction rig of any size, read run by run.

A CSV file, plain or gzip-compressed, or Parquet files. The format is recognised from the bytes.
"""

from __future__ import annotations

import codecs
import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.bench.channels.channel_mapping import (
    ChannelMapping,
    MappingContext,
    missing_setting,
    notes_of,
)
from beltid.bench.channels.text_tables import (
    candidates_of,
    text_layout,
    wanted_columns,
)
from beltid.bench.files.ahead import ahead
from beltid.bench.files.sniff import Decoded, decode
from beltid.bench.files.sources import Source, are_parquet, unread_sources
from beltid.bench.formats.csv_table import csv_blocks, file_chunks
from beltid.bench.formats.dialect import Layout, NoRowsError
from beltid.bench.read_options import ReadOptions
from beltid.bench.runs.run_stream import BigRecording
from beltid.errors import InputError, Problems
from beltid.tables.columns import Table
from beltid.tables.schemas import NOMINAL

__all__ = ["BigRecording", "open_big", "read_head"]

HEAD: Final = 1 << 20
LARGEST_HEAD: Final = 128 << 20
"""Bytes searched for the first row, which blank lines may precede."""
_FEEDS: Final = "a file of this size must use line feeds"


def open_big(path: Path, config: Any = None) -> BigRecording:
    """Open a recording of the friction rig of any size for reading run by run.

    Parameters
    ----------
    path : Path
        A CSV file, plain or gzip-compressed, a Parquet file, or a folder of Parquet files.
    config : Config, optional
        Names, units and dialect of the bench's files.

    Raises
    ------
    InputError
        If its head is not that of a friction rig recording. Errors further down are reported
        while the runs are read.
    """
    options, sources = ReadOptions.of(config, "rig"), unread_sources(path)
    return _parquet(sources, path, options) if are_parquet(sources) else _csv(path, options)


@dataclass(frozen=True, slots=True)
class TextHead:
    """The head of a big text file and the bytes after it.

    Attributes
    ----------
    decoded : Decoded
        Text of the first lines.
    layout : Layout
        Header, units and separators.
    chunks : iterator of bytes
        The file from its first row onwards.
    """

    decoded: Decoded
    layout: Layout
    chunks: Iterator[bytes]


def read_head(path: Path, options: ReadOptions, table: Table) -> TextHead:
    """Read the head of a text file of any size, plain or gzip-compressed.

    Raises
    ------
    InputError
        If the first lines are not text with a header.
    """
    name, size = str(path), HEAD
    chunks = ahead(file_chunks(path), 2)
    first = _filled(b"", chunks, size)
    encoding = options.dialect.encoding
    if first[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE) or "16" in (encoding or ""):
        raise InputError(f"{name}: is in UTF-16; a file of this size must be in UTF-8")
    if len(first) > HEAD and b"\n" not in first[:HEAD]:
        raise InputError(f"{name}:1: no line feed in the first {HEAD:,} bytes; {_FEEDS}")
    while True:
        whole = len(first) <= size
        decoded = decode(first if whole else _whole_lines(first[:size]), name, encoding)
        try:
            layout = text_layout(decoded, name, options, table)
            break
        except NoRowsError:  # the first row may be further down, or end further down
            if whole or size == LARGEST_HEAD:
                raise
            size = min(8 * size, LARGEST_HEAD)
            first = _filled(first, chunks, size)
    body = _after_lines(first, layout.first_line - 1)
    if re.search(rb"\r(?!\n)", first[: len(first) - len(body)]):
        raise InputError(f"{name}: lines end with a carriage return only; {_FEEDS}")
    return TextHead(decoded, layout, itertools.chain([body], chunks))


def _filled(data: bytes, chunks: Iterator[bytes], size: int) -> bytes:
    """Append chunks until there are more than `size` bytes, or no more chunks."""
    parts = [data]
    while sum(map(len, parts)) <= size and (chunk := next(chunks, b"")):
        parts.append(chunk)
    return b"".join(parts)


def _whole_lines(data: bytes) -> bytes:
    return data[: data.rfind(b"\n") + 1]


def _csv(path: Path, options: ReadOptions) -> BigRecording:
    name, table, problems = str(path), options.table("rig"), Problems()
    head = read_head(path, options, table)
    layout = head.layout
    context = MappingContext(table, options, name, problems)
    mappings, wanted = wanted_columns(layout, candidates_of(layout), context)
    _refuse_missing_settings(mappings, context, f"{name}:{layout.header_line}")
    notes = list(head.decoded.notes)
    blocks = csv_blocks(head.chunks, layout, wanted, head.decoded.encoding, name, notes)
    notes += [*layout.notes, *notes_of(mappings, table, layout.header)]
    return BigRecording(path, ahead(blocks, 1), table, mappings, wanted["time_s"].clock, notes)


def _after_lines(data: bytes, lines: int) -> bytes:
    """Return the bytes after the first `lines` lines; empty if there are none."""
    ends = np.flatnonzero(np.frombuffer(data, dtype=np.uint8) == ord("\n"))
    if lines > ends.size:
        return b""
    return data[ends[lines - 1] + 1 :] if lines else data


def _refuse_missing_settings(
    mappings: Mapping[str, ChannelMapping], context: MappingContext, place: str
) -> None:
    """Raise all problems with the columns, including settings that no column holds."""
    table, problems = context.table, context.problems
    wrong = problems.count  # missing settings have been reported as well in this case
    for setting in NOMINAL:
        needed = setting in table.names and table.column(setting).required
        if needed and setting not in mappings and not wrong:
            problems.add(missing_setting(setting, "rig", place))
    problems.raise_if_any()


def _parquet(sources: Sequence[Source], path: Path, options: ReadOptions) -> BigRecording:
    from beltid.bench.channels.parquet_tables import stream_parquet

    context = MappingContext(options.table("rig"), options)
    mappings, clock, blocks = stream_parquet(sources, context)
    _refuse_missing_settings(mappings, context, sources[0].name)
    notes = notes_of(mappings, context.table, ())
    return BigRecording(path, ahead(blocks, 1), context.table, mappings, clock, notes, ", row ")

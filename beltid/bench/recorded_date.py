"""Find the day on which a recording was made, if its files contain it.

It is in a header field (Date, Prüfdatum, start time) or in the time stamp of the first sample;
`beltid.bench.formats.clock` reads it.
"""

from __future__ import annotations

import datetime
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final

from beltid.bench.channels.vocabulary import means_date
from beltid.bench.files.sniff import PARQUET, TEXT, decode, sniff
from beltid.bench.files.sources import Source, sources_of, unread_sources
from beltid.bench.formats.bench_file import BenchFile, Field
from beltid.bench.formats.clock import day_in, holds_dates, written_as
from beltid.bench.formats.dialect import layout
from beltid.bench.read_options import ReadOptions
from beltid.bench.recording import open_sources
from beltid.config import Config
from beltid.errors import InputError

HEAD_BYTES: Final = 1 << 14
WORDS: Final = re.compile(
    r"(test|pr[uü]f|mess|measurement|recording|start)?[ _]?"
    r"(date|datum|datetime|date[/ ]time|datum[/ ]uhrzeit|time|zeit|zeitpunkt)( of test)?|"
    r"wf_start_time",
    re.IGNORECASE,
)
"""Names of header fields that may contain the day; a time of day alone does not."""
EXCEL_DAY: Final = re.compile(r'\s*"?([2-7]\d{4})([.,]\d*)?"?\s*($|[;\t])')
"""A date as Excel stores it: days from 1899-12-30."""


def recorded_on(path: Path, config: Config, kind: str) -> str | None:
    """Find the day of a recording, ``2024-05-17``; for several files those of the first and last.

    Parameters
    ----------
    path : Path
        File, folder, pattern or zip file.
    config : Config
        Options for reading the files.
    kind : str
        Kind of recording.

    Returns
    -------
    str or None
        None if no file contains it, or none can be read.
    """
    options = ReadOptions.of(config, kind)
    try:
        sources = unread_sources(path)
        if sources[0].first_bytes()[:2] == b"PK":
            sources = sources_of(path)
        ends = [sources[0], sources[-1]] if len(sources) > 1 else sources
        days = [day for source in ends if (day := next(_of_file(source, options), None))]
    except InputError:  # reported when the samples are read
        return None
    return " to ".join(dict.fromkeys(sorted(days))) or None


def _of_file(source: Source, options: ReadOptions) -> Iterator[str]:
    head = source.first_bytes(HEAD_BYTES)
    if len(head) == HEAD_BYTES:  # cut to whole lines so that the text can be decoded
        head = head[: head.rfind(b"\n") + 1 or None]
    form = sniff(head, source.name)
    if form == PARQUET:
        yield from _of_parquet(source)
    elif form == TEXT:
        yield from _of_text(decode(head, source.name, options.dialect.encoding).text, options)
    else:
        for opened in open_sources([source], options):
            if opened.text is not None:  # compressed
                yield from _of_text(opened.text.text[:HEAD_BYTES], options)
            if opened.channels is not None:
                yield from _of_channels(opened.channels)


def _of_text(text: str, options: ReadOptions) -> Iterator[str]:
    file_layout = layout(text, "", options.dialect, [options.names.get("time_s", "time_s")])
    yield from _of_fields(file_layout.fields)
    yield from _of_cells(zip(file_layout.header, file_layout.first_cells(), strict=True))


def _of_channels(file: BenchFile) -> Iterator[str]:
    yield from _of_fields(file.fields)
    for group in file.groups:
        yield from _of_fields(group.fields)
        yield from _of_cells((c.name, c.first_texts()) for c in group.channels)


def _of_parquet(source: Source) -> Iterator[str]:
    import pyarrow as pa

    from beltid.bench.formats.parquet import ParquetTable, batches_of

    part = ParquetTable.of(source)
    names = [f.name for f in part.schema if holds_dates(f.type)]
    for batch in batches_of(part, names):
        firsts = (column.slice(0, 1).cast(pa.string()).to_pylist() for column in batch.columns)
        yield from _of_cells(zip(names, ([c for c in f if c] for f in firsts), strict=True))
        return


def _of_fields(fields: Iterable[Field]) -> Iterator[str]:
    """Yield the days in header fields whose names may mean a date."""
    for field in fields:
        if not WORDS.fullmatch(field.name.strip()):
            continue
        number = EXCEL_DAY.match(field.text)
        if number and "dat" in field.name.lower():
            yield (datetime.date(1899, 12, 30) + datetime.timedelta(int(number[1]))).isoformat()
        elif day := day_in(field.text):
            yield day


def _of_cells(columns: Iterable[tuple[str, Sequence[str]]]) -> Iterator[str]:
    """Yield the days of the first time stamps, and of the first dates in date columns."""
    for name, cells in columns:
        written = written_as(cells)
        is_stamp = written == "clock" or (written == "date" and means_date(name))
        if is_stamp and (day := day_in(cells[0])):
            yield day

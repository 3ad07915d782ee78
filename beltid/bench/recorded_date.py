"""The day on which a recording was made, as far as its files tell.

It stands in a header field (Date, Prüfdatum, start time), or in a time stamp of the first sample.
"""

from __future__ import annotations

import datetime
import re
from collections.abc import Iterator
from pathlib import Path, PurePath
from typing import Any, Final

from beltid.artifacts.file_bytes import opened
from beltid.bench.files.sniff import LVM, PARQUET, TEXT, decode, sniff
from beltid.bench.files.sources import Source, is_many, sources_of
from beltid.bench.formats.bench_file import BenchFile
from beltid.bench.formats.dialect import ReadOptions
from beltid.bench.recording import open_sources
from beltid.errors import InputError

HEAD_BYTES: Final = 1 << 14
WORDS: Final = re.compile(
    r"(test|pr[uü]f|mess|measurement|recording|start)?[ _]?"
    r"(date|datum|datetime|date[/ ]time|datum[/ ]uhrzeit|time|zeit|zeitpunkt)( of test)?|"
    r"wf_start_time",
    re.IGNORECASE,
)
"""Names of header fields that may tell the day; a time of day alone has no day in it."""
STAMPED: Final = re.compile(
    r'\s*"?([^,;\t]*[,;\t]\s*"?)?(\d{4}-\d{1,2}-|\d{1,2}([./])\d{1,2}\3|\d{4}/\d{1,2}/)\d+[T ,;\t]'
)
"""A row of samples whose first or second cell is a time stamp with its day."""
EXCEL_DAY: Final = re.compile(r'\s*"?([2-7]\d{4})([.,]\d*)?"?\s*($|[;\t])')
YEAR_FIRST: Final = re.compile(r"\b(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})(?!\d)")
YEAR_LAST: Final = re.compile(r"\b(\d{1,2})([-/.])(\d{1,2})\2(\d{4})(?!\d)")


def recorded_on(path: Path, config: Any, kind: str) -> str | None:
    """Day of a recording, ``2024-05-17``; that of the first and the last file of several.

    Parameters
    ----------
    path : Path
        File, folder, pattern or zip file.
    config : Config
        How the files are written.
    kind : str
        Kind of recording.

    Returns
    -------
    str or None
        None where no file tells it, or none can be read.
    """
    options = ReadOptions.of(config, kind)
    try:
        sources = _sources(path)
        ends = [sources[0], sources[-1]] if len(sources) > 1 else sources
        days = [day for source in ends if (day := _of_file(source, options))]
    except InputError:  # what is wrong with it is told by the one who reads the samples
        return None
    return " to ".join(dict.fromkeys(sorted(days))) or None


def _sources(path: Path) -> list[Source]:
    """Files that a path stands for; a single one, which may be large, is not read."""
    if not is_many(path):
        with opened(path) as file:
            if file.read(2) != b"PK":
                return [Source(str(path), path, PurePath(path.name))]
    return sources_of(path)


def _of_file(source: Source, options: ReadOptions) -> str | None:
    head = _head(source)
    form = sniff(head, source.name)
    if form == PARQUET:
        return None
    if form in (TEXT, LVM):
        return next(_told_by_lines(decode(head, source.name, options.encoding).text), None)
    for one in open_sources([source], options):
        if one.text is not None:  # packed
            return next(_told_by_lines(one.text.text[:HEAD_BYTES]), None)
        if one.channels is not None:
            return next(_told_by(one.channels), None)
    return None


def _head(source: Source) -> bytes:
    """First bytes of a file; whole lines, as its text has to be decoded."""
    if source.data:
        head = source.read()[:HEAD_BYTES]
    else:
        with opened(source.path) as file:
            head = file.read(HEAD_BYTES)
    return head if len(head) < HEAD_BYTES else head[: head.rfind(b"\n") + 1 or None]


def _told_by(file: BenchFile) -> Iterator[str]:
    """Days in the header fields of a file."""
    fields = (*file.fields, *(field for group in file.groups for field in group.fields))
    for field in fields:
        if WORDS.fullmatch(field.name.strip()) and (day := _field_day(field.name, field.text)):
            yield day


def _told_by_lines(text: str) -> Iterator[str]:
    """Days in the lines on top of a text: those of named fields first, then of time stamps."""
    lines = text.splitlines()
    for line in lines:
        name, _, value = re.sub(r"^[#%;\s\"]+", "", line).partition(_separator(line))
        if WORDS.fullmatch(name.strip(' "')) and (day := _field_day(name, value)):
            yield day
    for line in lines:
        if STAMPED.match(line) and (day := day_in(line)):
            yield day


def _field_day(name: str, text: str) -> str | None:
    """The day in the value of a field; the number of a date is one of Excel, from 1899-12-30."""
    number = EXCEL_DAY.match(text)
    if number and "dat" in name.lower():
        return (datetime.date(1899, 12, 30) + datetime.timedelta(int(number[1]))).isoformat()
    return day_in(text)


def _separator(line: str) -> str:
    """What parts the name of a header field from its value."""
    return next((sign for sign in ("\t", ";", ":", "=", ",") if sign in line), ":")


def day_in(text: str) -> str | None:
    """The day in a text as ISO 8601; None if there is none, or month and day may be exchanged.

    Examples
    --------
    >>> day_in("17.05.2024 13:45"), day_in("2024/5/7"), day_in("05/07/2024"), day_in("05/27/2024")
    ('2024-05-17', '2024-05-07', None, '2024-05-27')
    """
    if match := YEAR_FIRST.search(text):
        year, month, day = (int(part) for part in match.groups())
    elif match := YEAR_LAST.search(text):
        first, second, year = int(match[1]), int(match[3]), int(match[4])
        if match[2] != "." and first <= 12 and second <= 12 and first != second:
            return None
        month_first = match[2] != "." and second > 12
        month, day = (first, second) if month_first else (second, first)
    else:
        return None
    try:
        return datetime.date(year, month, day).isoformat()
    except ValueError:
        return None

"""Recordings of the friction rig of any size: opened here, read run by run.

A big CSV file, plain or packed with gzip, a Parquet file, or a folder of Parquet files.
"""

from __future__ import annotations

import codecs
import itertools
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from beltid.bench.channels.channel_units import unit_conversion
from beltid.bench.channels.readings import Question
from beltid.bench.channels.text_tables import text_layout, text_notes, wanted_columns
from beltid.bench.files.ahead import ahead
from beltid.bench.files.encoding import decode
from beltid.bench.files.folders import parquet_files
from beltid.bench.formats.csv_stream import AHEAD, csv_blocks, file_chunks
from beltid.bench.formats.dialect import ReadOptions
from beltid.bench.formats.header import missing_setting
from beltid.bench.formats.parquet_stream import parquet_blocks
from beltid.bench.problems import Problems
from beltid.bench.runs.checks import SETTINGS
from beltid.bench.runs.run_stream import RunColumns, RunStream
from beltid.errors import InputError
from beltid.tables import schemas
from beltid.tables.units import Conversion

BIG: Final = 64 << 20
"""Bytes of a file from which on it is read run by run."""
ENDINGS: Final = (".csv", ".csv.gz", ".parquet")
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
    notes : callable
        What was found out, left out or missing; complete once the runs have been read.
    """

    path: Path
    runs: RunStream
    notes: Callable[[], tuple[str, ...]]

    def __iter__(self) -> Iterator[RunColumns]:
        """The runs, in the order of the file."""
        return iter(self.runs)


def is_big(path: Path) -> bool:
    """Whether a recording is to be read run by run: a big one, or one in folders."""
    try:
        if path.is_dir():
            files = parquet_files(path)
            in_folders = any(file.parent != path for file in files)
            return in_folders or sum(file.stat().st_size for file in files) >= BIG
        return path.name.lower().endswith(ENDINGS) and path.stat().st_size >= BIG
    except OSError:
        return False


def open_big(path: Path, config: Any = None) -> BigRecording:
    """Open a recording of the friction rig.

    Parameters
    ----------
    path : Path
        The file or folder.
    config : Config, optional
        Names, units and dialect of the bench's files.

    Raises
    ------
    InputError
        If its head cannot be that of a recording of the friction rig; whatever is wrong further
        down is told while the runs are read.
    """
    options = ReadOptions.of(config, "rig")
    if path.is_dir():
        return _parquet(path, options)
    with path.open("rb") as file:
        magic = file.read(4)
    return _parquet(path, options) if magic == b"PAR1" else _csv(path, options)


def _csv(path: Path, options: ReadOptions) -> BigRecording:
    name, table, problems = str(path), schemas.table("rig"), Problems()
    chunks = ahead(file_chunks(path), 2)
    first = next(chunks, b"")
    if first[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE) or "16" in (options.encoding or ""):
        raise InputError(f"{name}: is in UTF-16; a file of this size must be in UTF-8")
    if len(first) > HEAD and b"\n" not in first[:HEAD]:
        raise InputError(f"{name}:1: no line feed in the first {HEAD:,} bytes; {_FEEDS}")
    head = first[:HEAD] if len(first) <= HEAD else first[: first.rfind(b"\n", 0, HEAD) + 1]
    decoded = decode(head, name, options.encoding)
    found = text_layout(decoded, name, options, table)
    readings, wanted = wanted_columns(found, name, table, options, problems)
    wrong = problems.count  # then the settings have been asked for as well
    for setting in SETTINGS:
        if setting not in readings and not wrong:
            problems.add(missing_setting(setting, "rig", f"{name}:{found.header_line}"))
    problems.raise_if_any()
    body = _after_lines(first, found.first_line - 1)
    if re.search(rb"\r(?!\n)", first[: len(first) - len(body)]):
        raise InputError(f"{name}: lines that end in a carriage return alone; {_FEEDS}")
    source = itertools.chain([body], chunks)
    ends: list[str] = []
    blocks = csv_blocks(source, found, wanted, decoded.encoding, name, ends)
    conversions = {role: r.conversion for role, r in readings.items() if r.unit_stated or r.negated}
    runs = RunStream(ahead(blocks, AHEAD), table, name, conversions, problems)
    told = (*found.notes, *text_notes(found, readings, table))
    return BigRecording(path, runs, lambda: (*decoded.notes, *ends, *told, *runs.notes()))


def _after_lines(data: bytes, lines: int) -> bytes:
    """Bytes after some lines; none if there are not more."""
    at = 0
    for _ in range(lines):
        at = data.find(b"\n", at) + 1
        if not at:
            return b""
    return data[at:]


def _parquet(path: Path, options: ReadOptions) -> BigRecording:
    name, table, problems = str(path), schemas.table("rig"), Problems()
    blocks = parquet_blocks(path, table, options.names)
    conversions = {
        column.name: known
        for column in table.columns
        if isinstance(
            known := unit_conversion(column, column.name, "", Question(table, options), False),
            Conversion,
        )
    }
    runs = RunStream(blocks, table, name, conversions, problems)
    runs.row_word = ", row "
    return BigRecording(path, runs, lambda: tuple(runs.notes()))

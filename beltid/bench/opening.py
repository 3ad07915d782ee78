"""Files of a recording opened: unpacked, their format recognised, their channels read."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from beltid.bench.channels.channel_groups import read_groups
from beltid.bench.channels.raw_table import RawTable
from beltid.bench.channels.text_tables import read_text
from beltid.bench.files.archives import unpacked
from beltid.bench.files.encoding import Decoded, decode
from beltid.bench.files.sniff import GZIP, ISOLATED, LVM, PARQUET, ZIP, sniff, unread
from beltid.bench.files.sources import Source
from beltid.bench.formats import lvm
from beltid.bench.formats.bench_file import BenchFile, FormatError
from beltid.bench.formats.dialect import ReadOptions
from beltid.bench.formats.isolated.process import read_isolated
from beltid.bench.problems import Problems
from beltid.errors import InputError
from beltid.tables.columns import Table


@dataclass(frozen=True, slots=True)
class Opened:
    """A file whose format is known: its text, its channels, or why it cannot be read.

    Attributes
    ----------
    name : str
        Its name, for messages.
    format : str
        Its format in words.
    text : Decoded or None
        The text, of a table in a text file.
    channels : BenchFile or None
        What was found, of any other format.
    wrong : tuple of str
        Why it cannot be read.
    """

    name: str
    format: str
    text: Decoded | None = None
    channels: BenchFile | None = None
    wrong: tuple[str, ...] = ()


def open_sources(sources: Sequence[Source], options: ReadOptions) -> list[Opened]:
    """Open files, those of delicate formats together in a child process."""
    opened: list[Opened | None] = []
    jobs: list[tuple[str, Path]] = []
    at: list[int] = []
    with tempfile.TemporaryDirectory(prefix="beltid-") as folder:
        for number, source in enumerate(sources):
            try:
                one = _opened(source, options, Path(folder, str(number)))
            except InputError as error:
                one = Opened(source.name, "", wrong=error.problems)
            if isinstance(one, tuple):
                jobs.append(one)
                at.append(number)
                opened.append(None)
            else:
                opened.append(one)
        for number, found in zip(at, read_isolated(jobs) if jobs else [], strict=True):
            name = sources[number].name
            if isinstance(found, FormatError):
                opened[number] = Opened(name, "", wrong=(f"{name}: {found}",))
            else:
                opened[number] = Opened(name, found.format, channels=found)
    return [one for one in opened if one is not None]


def read_opened(
    opened: Opened, table: Table, options: ReadOptions, problems: Problems
) -> list[RawTable]:
    """Columns of an opened file."""
    for wrong in opened.wrong:
        problems.add(wrong)
    try:
        if opened.text is not None:
            raw = read_text(opened.text, opened.name, table, options, problems)
            return [] if raw is None else [raw]
        if opened.channels is not None:
            return read_groups(opened.channels, opened.name, table, options, problems)
    except InputError as error:
        for wrong in error.problems:
            problems.add(wrong)
    return []


def _opened(source: Source, options: ReadOptions, spare: Path) -> Opened | tuple[str, Path]:
    """An opened file, or the format and the file that the child process has to read."""
    data = source.read()
    plain = unpacked(data, source.path)
    name = source.inside.name.removesuffix(".gz")
    format_name = sniff(plain, name)
    if format_name in ISOLATED:
        if plain is data and not source.is_member:
            return format_name, source.path
        spare.write_bytes(plain)
        return format_name, spare
    if format_name == LVM:
        decoded = decode(plain, source.name, options.encoding)
        found = lvm.read(decoded.text, source.name)
        return Opened(source.name, found.format, channels=found)
    what = {
        PARQUET: "a Parquet file among others, name it alone",
        ZIP: "a zip file within another packed file, unpack it",
        GZIP: "packed twice, unpack it",
    }.get(format_name) or unread(plain)
    if what:
        raise InputError(f"{source.name}: is {what}")
    decoded = decode(plain, source.name, options.encoding)
    return Opened(source.name, text_format(decoded.text), text=decoded)


def text_format(text: str) -> str:
    """What wrote a table in a text file, where its first lines tell."""
    head = text[:4000]
    if head.startswith("MTS793|"):
        return "MTS 793 text"
    if "Standardkraft" in head or "Standardweg" in head or "Traversenweg" in head:
        return "Zwick testXpert text"
    return "CSV"

"""Check the recordings that a config names: do they exist, and what does a missing one prevent."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from beltid.artifacts.file_bytes import opened, read_bytes
from beltid.bench.big_recording import read_head
from beltid.bench.channels.text_tables import kind_of_columns
from beltid.bench.files.archives import members
from beltid.bench.files.sniff import GZIP, TEXT, ZIP, sniff
from beltid.bench.files.sources import exists, is_many, sources_of
from beltid.bench.read_options import ReadOptions
from beltid.bench.recording import read_recording, read_rig
from beltid.config import Config, ConfigSource
from beltid.config.source import KeyPath, Source, format_path, read_source
from beltid.errors import InputError
from beltid.tables import schemas

WITHOUT: Final = {
    "press": "no recording of the press (data.press): no contact law; the friction surface is that "
    "of the published procedure, not refined, and nothing is simulated, compared or predicted",
    "rig": "no recording of the friction rig (data.rig): no friction; the contact law of the press "
    "and the sliding speeds in service are all that is found",
}
"""Kind of recording needed by the full chain -> warning if it is missing."""


def lacking(config: Config) -> list[str]:
    """Return the kinds of recordings that the full chain needs and a config does not name."""
    return [kind for kind in WITHOUT if kind not in config.data.files]


def wrong_recordings(source: ConfigSource) -> list[str]:
    """Return problems of the recordings that a config names, each with its line in the config.

    Folders, patterns and zip files are opened in the same way as by the stage that reads them.
    """
    path = source.path
    assert path is not None
    places = read_source(path)
    data, tables = source.config.data.files, source.config.run_tables
    problems: list[str] = []
    if not data:
        text = "data names no recording, must be at least one of press, rig and speedloss"
        problems.append(f"{places.at(places.place(('data',)))}{text}")
    named: dict[KeyPath, Path] = {("data", kind): file for kind, file in data.items()}
    named |= {("runs", kind, "table"): file for kind, file in tables.items()}
    for keys, file in named.items():
        place = f"{places.at(places.place(keys))}{format_path(keys)}"
        for problem in _file_problems(file, list(tables.values())):
            problems.append(f"{place} = {problem}")
    return problems or _mismatched_kinds(source.config, places)


def unread_recordings(config: Config) -> list[str]:
    """Return why named recordings cannot be read; of a big rig recording, only the head is read."""
    problems: list[str] = []
    for kind, file in config.data.files.items():
        try:
            read_rig(file, config) if kind == "rig" else read_recording(file, kind, config)
        except InputError as error:
            problems += error.problems
    return problems


def _mismatched_kinds(config: Config, places: Source) -> list[str]:
    """Return problems of text files whose columns are those of another kind of recording."""
    data = config.data.files
    found_kinds = {kind: _header_kind(file, config, kind) for kind, file in data.items()}
    mismatched = {kind: found for kind, found in found_kinds.items() if found not in ("", kind)}
    problems: list[str] = []
    for kind, found in mismatched.items():
        if mismatched.get(found) != kind:
            text = f"data.{kind} = {data[kind]}, holds the columns of a {found} recording"
        elif list(mismatched).index(kind) < list(mismatched).index(found):
            text = (
                f"data.{kind} and data.{found} are swapped: {data[kind]} holds the columns of "
                f"a {found} recording, {data[found]} those of a {kind} recording"
            )
        else:
            continue
        where = places.at(places.place(("data", kind)))
        problems.append(f"{where}{text}")
    return problems


def _header_kind(file: Path, config: Config, kind: str) -> str:
    """Return the kind of recording from the header of a text file; "" if undetermined."""
    if is_many(file) or config.columns[kind]:
        return ""
    with opened(file) as stream:
        if sniff(stream.read(1024), file.name) not in (TEXT, GZIP):
            return ""
    try:
        head = read_head(file, ReadOptions.of(config, kind), schemas.table(kind))
    except InputError:  # the stage that reads the file reports the problem
        return ""
    return kind_of_columns(head.layout.header)


def _file_problems(file: Path, tables: list[Path]) -> Iterator[str]:
    """Yield the problems of the files of a path, as the text after its key."""
    if not exists(file):
        yield f"{file}, there is no such file"
        return
    try:
        if is_many(file):
            sources_of(file, tables)
        else:
            _check_readable(file)
    except InputError as error:
        yield from error.problems


def _check_readable(file: Path) -> None:
    """Raise an error for an unreadable file, or for a zip file that holds no recording."""
    with opened(file) as stream:
        head = stream.read(4)
    if head[:2] == b"PK" and sniff(data := read_bytes(file)) == ZIP:
        list(members(data, file))

"""Check the recordings that a config names: do they exist, and what does a missing one prevent."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from beltid.bench.files import exists, sources_of
from beltid.config import Config, ConfigSource
from beltid.config.source import KeyPath, format_path, read_source
from beltid.errors import InputError

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
    return problems


def unread_recordings(config: Config) -> list[str]:
    """Return why named recordings cannot be read."""
    from beltid.bench.recording import read_recording

    problems: list[str] = []
    for kind, file in config.data.files.items():
        try:
            read_recording(file, kind, config)
        except InputError as error:
            problems += error.problems
    return problems


def _file_problems(file: Path, tables: list[Path]) -> Iterator[str]:
    """Yield the problems of the files of a path, as the text after its key."""
    if not exists(file):
        yield f"{file}, there is no such file"
        return
    try:
        sources_of(file, tables)
    except InputError as error:
        yield from error.problems

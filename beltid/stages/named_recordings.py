"""Check the recordings that a config names: do they exist, and what does a missing one prevent."""

from __future__ import annotations

from collections.abc import Iterable
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
    data, tables = source.config.data.files, source.config.run_tables
    problems: list[str] = []
    if not data:
        text = "data names no recording, must be at least one of press, rig and speedloss"
        problems.append(f"{_place(source, ('data',))}{text}")
    named: dict[KeyPath, Path] = {("data", kind): file for kind, file in data.items()}
    named |= {("runs", kind, "table"): file for kind, file in tables.items()}
    for keys, file in named.items():
        place = f"{_place(source, keys)}{format_path(keys)}"
        problems += [f"{place} = {line}" for line in _file_problems(file, tables.values())]
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


def _place(source: ConfigSource, keys: KeyPath) -> str:
    assert source.path is not None
    places = read_source(source.path)
    return places.at(places.place(keys))


def _file_problems(file: Path, tables: Iterable[Path]) -> tuple[str, ...]:
    """Return the problems of the files of a path, as the text after its key."""
    if not exists(file):
        return (f"{file}, there is no such file",)
    try:
        sources_of(file, list(tables))
    except InputError as error:
        return error.problems
    return ()

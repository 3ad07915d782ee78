"""Configs of a batch: all of them checked before anything runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from beltid.config import ConfigSource, find_config, load_config
from beltid.config.yaml_source import parse, read_text
from beltid.errors import BeltidError, ConfigError, InputError

RECORDINGS: Final = {"press": True, "rig": True, "speedloss": False}
"""Recordings of a chain, and whether it needs them."""


def config_sources(paths: Sequence[Path], explicit: Path | None = None) -> list[ConfigSource]:
    """Load the configs of a batch and check that it can start.

    Parameters
    ----------
    paths : sequence of Path
        Configs, one per belt.
    explicit : Path or None
        A config named otherwise; it counts as one more.

    Raises
    ------
    ConfigError
        With everything that is wrong with all of them: missing recordings, belts of one name.
    """
    named = [*paths, *([explicit] if explicit is not None else [])]
    problems: list[str] = []
    sources: list[ConfigSource] = []
    for path in named:
        try:
            sources.append(ConfigSource(load_config(path), str(path), path))
        except BeltidError as error:
            problems += error.problems
    if not named:
        found = find_config(None)
        if found.path is None:
            raise InputError("no config named: beltid run CONFIG.yaml, or set $BELTID_CONFIG")
        sources = [found]
    for source in sources:
        problems += _missing_recordings(source)
    problems += _same_names(sources)
    if problems:
        raise ConfigError(problems)
    return sources


def _missing_recordings(source: ConfigSource) -> list[str]:
    """Recordings that the config does not name or that are not there, with their place."""
    path = source.path
    assert path is not None
    places = parse(read_text(path), str(path))
    problems = []
    for kind, needed in RECORDINGS.items():
        file = getattr(source.config.data, kind)
        at = places.prefix(("data", kind))
        if file is None and needed:
            problems.append(f"{at}data.{kind} is missing, the chain needs this recording")
        elif file is not None and not file.is_file():
            what = "is a folder" if file.is_dir() else "there is no such file"
            problems.append(f"{at}data.{kind} = {file}, {what}")
    return problems


def _same_names(sources: Sequence[ConfigSource]) -> list[str]:
    """Belts whose results would go to one folder; file systems may ignore case."""
    problems = []
    first: dict[str, ConfigSource] = {}
    for source in sources:
        name = source.config.belt.name
        other = first.setdefault(name.lower(), source)
        if other is not source:
            problems.append(
                f"{source.path}: belt.name = {name}, must differ from that of {other.path}: "
                "it names the folder of the results"
            )
    return problems

"""Which config belongs to a recording."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from beltid.config.loading import load_config
from beltid.config.model import Config
from beltid.errors import ConfigError

ENVIRONMENT_VARIABLE = "BELTID_CONFIG"
FILE_NAME = "beltid.yaml"
BUILT_IN = "the built-in 5PK rig of the paper"


@dataclass(frozen=True, slots=True)
class ConfigSource:
    """A config and where it came from.

    Attributes
    ----------
    config : Config
        The config.
    origin : str
        Where it came from, in words, for the user and the results.
    path : Path or None
        The file, or None for the built-in rig.
    case : str
        Name of the case, if the config is one of a sweep.
    swept : dict
        Its swept values by ``section.key``.
    """

    config: Config
    origin: str
    path: Path | None = None
    case: str = ""
    swept: Mapping[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name of the belt, and of the case in a sweep: that of the folder of the results."""
        belt = self.config.belt.name
        return f"{belt}/{self.case}" if self.case else belt


def find_config(
    recording_path: str | Path | None = None, explicit: str | Path | None = None
) -> ConfigSource:
    """Find the config of a recording.

    The first of: `explicit`; the file named by ``$BELTID_CONFIG``; ``<stem>.yaml``, then
    ``beltid.yaml``, beside the recording, then in each parent folder; the built-in 5PK rig.

    Parameters
    ----------
    recording_path : path, optional
        The recording (or artifact) to be worked on; without one no folder is searched.
    explicit : path, optional
        What the user named.

    Raises
    ------
    ConfigError
        If the config found is missing or wrong; the message says how it was found.
    """
    if explicit is not None:
        path = Path(explicit)
        return ConfigSource(load_config(path), f"{path} (--config)", path)
    named = named_by_environment()
    if named is not None:
        return _found(named, f"named by ${ENVIRONMENT_VARIABLE}")
    if recording_path is not None:
        for candidate in _candidates(Path(recording_path)):
            if _is_file(candidate):
                return _found(candidate, f"found for {Path(recording_path).name}")
    return ConfigSource(Config(), BUILT_IN)


def named_by_environment() -> Path | None:
    """The config that the environment variable names, if it names one."""
    named = os.environ.get(ENVIRONMENT_VARIABLE, "").strip()
    return Path(named) if named else None


def _found(path: Path, how: str) -> ConfigSource:
    try:
        return ConfigSource(load_config(path), f"{path} ({how})", path)
    except ConfigError as error:
        raise ConfigError(
            [*error.problems, f"{path}: this config was {how}, --config names another"]
        ) from None


def _candidates(recording: Path) -> Iterator[Path]:
    recording = Path(os.path.abspath(recording))
    stem = recording.name.split(".")[0] if recording.suffix == ".gz" else recording.stem
    for folder in recording.parents:
        if stem:
            yield folder / f"{stem}.yaml"
        yield folder / FILE_NAME


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a folder that may not be looked into holds no config of ours
        return False

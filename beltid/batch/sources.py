"""Configs of a batch, all checked before anything runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from beltid.config import ConfigSource, load_config
from beltid.config.loading import ENVIRONMENT_VARIABLE, named_by_environment
from beltid.errors import BeltidError, ConfigError, InputError
from beltid.stages.named_recordings import wrong_recordings


def config_sources(paths: Sequence[Path], explicit: Path | None = None) -> list[ConfigSource]:
    """Load the configs of a batch and check that it can start.

    Parameters
    ----------
    paths : sequence of Path
        Configs, one per belt.
    explicit : Path or None
        Additional config, given by ``--config``.

    Raises
    ------
    ConfigError
        With the problems of all configs, including missing recordings and equal belt names.
    """
    named = [(path, str(path)) for path in paths]
    if explicit is not None:
        named.append((explicit, f"{explicit} (--config)"))
    if not named:
        path = named_by_environment()
        if path is None:
            raise InputError("no config given: beltid run CONFIG.yaml, or set $BELTID_CONFIG")
        named.append((path, f"{path} (named by ${ENVIRONMENT_VARIABLE})"))
    problems: list[str] = []
    sources: list[ConfigSource] = []
    for path, origin in named:
        try:
            sources.append(ConfigSource(load_config(path), origin, path))
        except BeltidError as error:
            problems += error.problems
    for source in sources:
        problems += wrong_recordings(source)
    problems += _same_names(sources)
    if problems:
        raise ConfigError(problems)
    return sources


def _same_names(sources: Sequence[ConfigSource]) -> list[str]:
    """Report belts whose results would go to the same folder; file systems may ignore case."""
    problems = []
    first: dict[str, ConfigSource] = {}
    for source in sources:
        name = source.name
        other = first.setdefault(name.lower(), source)
        if other is not source:
            problems.append(
                f"{source.path}: belt.name = {name}, must differ from that of {other.path}: "
                "it names the folder of the results"
            )
    return problems

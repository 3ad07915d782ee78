"""Configs of a batch, all checked before anything runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from beltid.config import ConfigSource, load_cases
from beltid.config.loading import ENVIRONMENT_VARIABLE, named_by_environment
from beltid.errors import BeltidError, ConfigError, InputError
from beltid.stages.setup.named_recordings import wrong_recordings


def config_sources(paths: Sequence[Path], explicit: Path | None = None) -> list[ConfigSource]:
    """Load the configs of a batch and check that it can start.

    Parameters
    ----------
    paths : sequence of Path
        Configs, one per belt; one with a sweep gives a source per case.
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
    belts: list[list[ConfigSource]] = []
    for path, origin in named:
        try:
            cases = load_cases(path)
            belts.append([ConfigSource(c, origin, path, case, swept) for case, swept, c in cases])
        except BeltidError as error:
            problems += error.problems
    for cases_of_belt in belts:
        problems += wrong_recordings(cases_of_belt[0])
    problems += _same_names([cases_of_belt[0] for cases_of_belt in belts])
    if problems:
        raise ConfigError(problems)
    return [source for cases_of_belt in belts for source in cases_of_belt]


def _same_names(sources: Sequence[ConfigSource]) -> list[str]:
    """Report belts whose results would go to the same folder; file systems may ignore case."""
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

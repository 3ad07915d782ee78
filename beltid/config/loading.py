"""Load a config from a file or a dict."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from beltid.config.messages import problems_of
from beltid.config.model import Config
from beltid.config.sweep import swept_cases, take_sweep
from beltid.config.yaml_source import Source, parse, read_text
from beltid.errors import ConfigError

SHOWN = 40


def load_config(source: str | Path | Mapping[str, Any] | Config | None = None) -> Config:
    """Load a config; what it leaves out is that of the built-in 5PK rig.

    Parameters
    ----------
    source : path, mapping, Config or None
        A YAML file, a dict of the same shape, or None for the built-in 5PK rig of the paper.
        Relative paths under `data` count from the folder of the file.

    Returns
    -------
    Config
        The frozen config.

    Raises
    ------
    ConfigError
        With one line per problem: file, line, column, key path, found, allowed.
    """
    if source is None:
        return Config()
    if isinstance(source, Config):
        return source
    if isinstance(source, Mapping):
        return _checked(Source(values=_plain(source)))
    if not isinstance(source, (str, Path)):
        raise ConfigError(
            f"config = {type(source).__name__}, must be the path of a YAML file or a dict"
        )
    path = Path(source)
    config = _checked(parse(read_text(path), str(path)))
    return _with_paths_from(config, path.parent)


def load_cases(path: Path) -> list[tuple[str, dict[str, Any], Config]]:
    """Load every case of a config: one without a sweep is a single case without a name.

    Parameters
    ----------
    path : Path
        A YAML file.

    Returns
    -------
    list of (str, dict, Config)
        Name of the case (that of its folder), its swept values by ``section.key``, its config.

    Raises
    ------
    ConfigError
        With everything that is wrong with any of them.
    """
    source = parse(read_text(path), str(path))
    sweep = take_sweep(source)
    if not sweep:
        return [("", {}, _with_paths_from(_checked(source), path.parent))]
    problems = list(source.problems)
    cases = []
    for name, values, case in swept_cases(source, sweep):
        try:
            cases.append((name, values, _with_paths_from(_checked(case), path.parent)))
        except ConfigError as error:
            problems += error.problems
    if problems:
        raise ConfigError(_first(list(dict.fromkeys(problems))))
    return cases


def _checked(source: Source) -> Config:
    take_sweep(source)  # a single stage works on the config without it
    # `compare:` with nothing under it, everything commented out, means its defaults
    values = {
        key: value
        for key, value in source.values.items()
        if value is not None or key not in Config.model_fields
    }
    try:
        config = Config.model_validate(values)
    except ValidationError as error:
        source.problems += problems_of(error, Config, source)
        raise ConfigError(_first(source.problems)) from None
    if source.problems:
        raise ConfigError(_first(source.problems))
    return config


def _plain(value: Any) -> Any:
    """Numpy scalars and arrays of a dict to plain values."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if type(value).__module__ == "numpy" and hasattr(value, "tolist"):
        return value.tolist()
    return value


def _with_paths_from(config: Config, folder: Path) -> Config:
    resolved = {kind: _short(folder / path) for kind, path in config.data.files.items()}
    tables = {
        kind: config.runs.of(kind).model_copy(update={"table": _short(folder / table)})
        for kind, table in config.runs.tables.items()
    }
    return config.model_copy(
        update={
            "data": config.data.model_copy(update=resolved),
            "runs": config.runs.model_copy(update=tables),
        }
    )


def _short(path: Path) -> Path:
    """``configs/../rigdata`` as ``rigdata``, unless a symbolic link makes them differ."""
    short = os.path.normpath(path)
    return Path(short) if os.path.realpath(short) == os.path.realpath(path) else path


def _first(problems: list[str]) -> list[str]:
    more = len(problems) - SHOWN
    return [*problems[:SHOWN], f"and {more} more"] if more > 0 else problems

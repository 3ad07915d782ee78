"""Load a config from a file or a dict, find that of a recording, list its values."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from beltid.config.checks import Section, section_in
from beltid.config.model import Config
from beltid.config.source import KeyPath, Place, Source, format_path, read_source
from beltid.errors import ConfigError

SHOWN = 40
ENVIRONMENT_VARIABLE = "BELTID_CONFIG"
FILE_NAME = "beltid.yaml"
UNKNOWN = ("extra_forbidden", "invalid_key", "unknown")  # key; of other errors, the value
LAYOUT = ("columns", "units", "runs")
BUILT_IN = "the built-in 5PK rig of the paper"


def load_config(source: str | Path | Mapping[str, Any] | Config | None = None) -> Config:
    """Load a config; missing values are those of the built-in 5PK rig.

    Parameters
    ----------
    source : path, mapping, Config or None
        A YAML file, a dict of the same shape, or None for the built-in 5PK rig of the paper.
        Relative paths under `data` start at the folder of the file.

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
        return _checked(Source(source))
    if not isinstance(source, (str, Path)):
        raise ConfigError(
            f"config = {type(source).__name__}, must be the path of a YAML file or a dict"
        )
    path = Path(source)
    return _with_paths_from(_checked(read_source(path)), path.parent)


def _checked(source: Source) -> Config:
    """Validate the values of a source; raise all problems, in the order of the file."""
    # an empty section, such as `compare:` with all keys commented out, means its defaults
    values = {
        key: value
        for key, value in source.values.items()
        if value is not None or key not in Config.model_fields
    }
    problems: list[tuple[Place, str]] = []
    try:
        return Config.model_validate(values)
    except ValidationError as error:
        for detail in error.errors(include_url=False):
            place = source.place(detail["loc"], key=detail["type"] in UNKNOWN)
            problems.append((place, message(detail, Config, source.node(detail["loc"]))))
    lines = [f"{source.at(p)}{text}" for p, text in sorted(problems, key=lambda found: found[0])]
    hidden = [f"and {len(lines) - SHOWN} more"] if len(lines) > SHOWN else []
    raise ConfigError([*lines[:SHOWN], *hidden])


def _with_paths_from(config: Config, folder: Path) -> Config:
    files = {kind: _shorten(folder / path) for kind, path in config.data.files.items()}
    runs = {
        kind: {**config.runs[kind], "table": _shorten(folder / table)}
        for kind, table in config.run_tables.items()
    }
    data = config.data.model_copy(update=files)
    return config.model_copy(update={"data": data, "runs": config.runs | runs})


def _shorten(path: Path) -> Path:
    """Shorten ``configs/../rigdata`` to ``rigdata``, unless a symbolic link makes them differ."""
    short = os.path.normpath(path)
    return Path(short) if os.path.realpath(short) == os.path.realpath(path) else path


@dataclass(frozen=True, slots=True)
class ConfigSource:
    """A config, its origin for the user and the results, and its file (None: built in)."""

    config: Config
    origin: str
    path: Path | None = None

    @property
    def name(self) -> str:
        """Name of the belt, and of the folder of its results."""
        return self.config.belt.name


def find_config(
    recording_path: str | Path | None = None, explicit: str | Path | None = None
) -> ConfigSource:
    """Find the config of a recording or artifact.

    The first of: `explicit`; the file named by ``$BELTID_CONFIG``; ``<stem>.yaml``, then
    ``beltid.yaml``, next to the recording, then in each parent folder; the built-in 5PK rig. If it
    is wrong, the ConfigError says how it was found.
    """
    if explicit is not None:
        path = Path(explicit)
        return ConfigSource(load_config(path), f"{path} (--config)", path)
    if (named := named_by_environment()) is not None:
        return _load_found(named, f"named by ${ENVIRONMENT_VARIABLE}")
    for candidate in _candidates(recording_path) if recording_path is not None else ():
        if os.path.isfile(candidate):  # False, too, in a folder that may not be read
            return _load_found(candidate, f"found for {Path(str(recording_path)).name}")
    return ConfigSource(Config(), BUILT_IN)


def named_by_environment() -> Path | None:
    """Return the path in the environment variable BELTID_CONFIG, None if it is not set."""
    named = os.environ.get(ENVIRONMENT_VARIABLE, "").strip()
    return Path(named) if named else None


def _load_found(path: Path, how: str) -> ConfigSource:
    try:
        return ConfigSource(load_config(path), f"{path} ({how})", path)
    except ConfigError as error:
        told = f"{path}: this config was {how}, --config names another"
        raise ConfigError([*error.problems, told]) from None


def _candidates(recording_path: str | Path) -> Iterator[Path]:
    recording = Path(os.path.abspath(recording_path))
    stem = Path(recording.name.removesuffix(".gz")).stem
    for folder in recording.parents:
        yield from (folder / f"{stem}.yaml", folder / FILE_NAME)


def effective_values(
    values: Section | Mapping[str, Any], above: KeyPath = ()
) -> Iterator[tuple[KeyPath, Any, bool]]:
    """Yield the path of every key of a config, its value, and whether it is stated, in order."""
    stated = values.model_fields_set if isinstance(values, Section) else values
    for name, value in dict(values).items():
        path = (*above, name)
        if isinstance(value, Section) or (path[0] in LAYOUT and isinstance(value, Mapping)):
            yield from effective_values(value, path)
        elif value is not None or path[0] not in LAYOUT:
            yield path, value, name in stated


def message(detail: Mapping[str, Any], model: type[Section], node: Any = None) -> str:
    """Describe an error of the model: key path, what was found (as in a node), what is allowed."""
    path, kind = tuple(detail["loc"]), detail["type"]
    if kind in UNKNOWN:
        known = detail.get("ctx", {}).get("known") or _keys_at(path[:-1], model)
        return f"{format_path(path)} is not a known key{_remedy(path, known, model)}"
    if kind == "missing":
        return f"{format_path(path)} is missing"
    found = f"{format_path(path)} = {_found(detail['input'], node)}"
    if kind in ("model_type", "model_attributes_type"):
        return f"{found}, must be a section with the keys {', '.join(_keys_at(path, model))}"
    return f"{found}, {requirement(detail)}"


def requirement(detail: Mapping[str, Any]) -> str:
    """Return what a value must be, such as ``must be last or first``, from a pydantic error."""
    if detail["type"] == "literal_error":
        return "must be " + str(detail["ctx"]["expected"]).replace("'", "")
    return str(detail["msg"]).replace("Input should be", "must be")


def problem(detail: Mapping[str, Any], place: KeyPath) -> str:
    """Describe a pydantic error in a generated file: place, found, allowed."""
    if detail["type"] == "missing":
        return f"{format_path(place)} is missing"
    return f"{format_path(place)} = {repr(detail['input'])[:60]}, {requirement(detail)}"


def _remedy(path: KeyPath, known: Sequence[str], model: type[Section]) -> str:
    """Name the nearest known key, or that of another section, or all known keys."""
    word = str(path[-1])
    near = difflib.get_close_matches(word, known, n=1)
    near += [f"{name}.{word}" for name in model.model_fields if word in _keys_at((name,), model)]
    if near:
        return f", did you mean {near[0]}?"
    if word.isdigit() and path[:-1]:  # {span_length_m: 0,10} reads as a key 10
        return " (the decimal sign is a point)"
    return f", known are {', '.join(known)}"


def _keys_at(path: KeyPath, model: type[Section]) -> tuple[str, ...]:
    """Return the keys of the section at a path."""
    here: type[Section] | None = model
    for part in path:
        if isinstance(part, str) and here is not None:
            here = section_in(here.model_fields[part].annotation)
    return tuple(here.model_fields) if here else ()


def _found(value: Any, node: Any) -> str:
    """Return a value as the user wrote it, shortened."""
    if isinstance(value, (Mapping, list, tuple)):
        return "a section" if isinstance(value, Mapping) else "a list"
    if value is None:
        return "empty"
    text = f'"{value}"' if isinstance(value, str) else str(node.value if node else value)
    text = "".join(c if c.isprintable() else "?" for c in text)
    return text if len(text) <= 60 else text[:57] + "..."

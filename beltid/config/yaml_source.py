"""YAML text to plain values, with the line and column of every key and value.

YAML 1.2, core schema: ``3025.6e6`` and ``1e5`` are numbers, ``yes`` is a word. Features that a
config never needs are errors: duplicate keys, merge keys, tags, recursion, excessive size or depth.
"""

from __future__ import annotations

import codecs
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from beltid.errors import ConfigError

MAX_BYTES: Final = 300_000
MAX_DEPTH: Final = 16
SHOWN: Final = 40
MAX_VALUES: Final = 5_000  # values of an alias count at every use, so that they cannot multiply

KeyPath = tuple[str | int, ...]


@dataclass(frozen=True, slots=True, order=True)
class Place:
    """Line and column in a file, both counted from 1."""

    line: int
    column: int


NOWHERE: Final = Place(0, 0)


@dataclass(slots=True)
class Source:
    """Plain values of a config and their places.

    Attributes
    ----------
    name : str
        File name for messages; empty for a dict, which has no places.
    values : dict
        Sections and their values.
    places, key_places : dict
        Key path to the place of the value, and of the key.
    texts : dict
        Key path to the scalar as written in the file.
    problems : list of (Place, str)
        The problems, in the order in which they were found.
    """

    name: str = ""
    values: dict[Any, Any] = field(default_factory=dict)
    places: dict[KeyPath, Place] = field(default_factory=dict)
    key_places: dict[KeyPath, Place] = field(default_factory=dict)
    texts: dict[KeyPath, str] = field(default_factory=dict)
    problems: list[tuple[Place, str]] = field(default_factory=list)

    def place(self, path: KeyPath, *, key: bool = False) -> Place:
        """Return the place of a value (or key); if absent, of its section; else `NOWHERE`."""
        first, second = (self.key_places, self.places) if key else (self.places, self.key_places)
        for end in range(len(path), -1, -1):
            place = first.get(path[:end]) or second.get(path[:end])
            if place:
                return place
        return NOWHERE

    def at(self, place: Place, text: str) -> str:
        """Prefix a text with ``file:line:column: ``, as far as known."""
        if not self.name:
            return text
        where = "" if place == NOWHERE else f":{place.line}:{place.column}"
        return f"{self.name}{where}: {text}"

    def complain(self, place: Place, text: str) -> None:
        """Add a problem at a place."""
        self.problems.append((place, self.at(place, text)))

    def raise_if_any(self) -> None:
        """Raise a ConfigError with the problems in file order.

        Raises
        ------
        ConfigError
            If there is any problem; those beyond `SHOWN` are only counted.
        """
        in_order = sorted(self.problems, key=lambda item: item[0])
        lines = [problem for _, problem in in_order]
        more = len(lines) - SHOWN
        if lines:
            raise ConfigError([*lines[:SHOWN], f"and {more} more"] if more > 0 else lines)


def read_text(path: Path) -> str:
    """Read the text of a config file.

    Raises
    ------
    ConfigError
        If the file is missing, a folder, not readable, too large, or not UTF-8.
    """
    try:
        if path.is_dir():
            raise ConfigError(f"{path}: is a folder, a config is a YAML file")
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise ConfigError(f"{path}: there is no such config file") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ConfigError(f"{path}: the config cannot be read: {reason}") from None
    if len(raw) > MAX_BYTES:
        raise ConfigError(f"{path}: larger than {MAX_BYTES:,} bytes, this is not a config")
    raw = raw.removeprefix(codecs.BOM_UTF8)
    try:
        return raw.decode()
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise ConfigError(
            f"{path}:{line}: byte 0x{raw[error.start]:02X} is not UTF-8, save the config as UTF-8",
        ) from None


def parse(text: str, name: str) -> Source:
    """Parse a YAML text to plain values with their places.

    Parameters
    ----------
    text : str
        The YAML text.
    name : str
        Name of the file in messages.

    Raises
    ------
    ConfigError
        If the text is not YAML. Problems of single keys are collected in `Source.problems`.
    """
    node = _compose(text, name)
    source = Source(name=name)
    if node is None:
        raise ConfigError(f"{name}: the config is empty, it must hold sections such as belt:, rig:")
    if node.id != "mapping":
        text = f"found a {_kind(node)}, a config must hold sections such as belt:, rig:"
        raise ConfigError(source.at(_start(node), text))
    source.values = _Walk(source).mapping(node, ())
    return source


def _compose(text: str, name: str) -> Any:
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    try:
        _limit(YAML(typ="safe", pure=True), text, name)
        return YAML(typ="safe", pure=True).compose(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f"{name}:{mark.line + 1}:{mark.column + 1}" if mark else name
        text = f"{place}: not valid YAML: {_yaml_words(error)}"
        raise ConfigError(text) from None
    except YAMLError as error:
        position = getattr(error, "position", None)
        line = f":{text[:position].count(chr(10)) + 1}" if isinstance(position, int) else ""
        raise ConfigError(
            f"{name}{line}: not valid YAML: a character that YAML does not allow",
        ) from None
    except ConfigError:
        raise
    except Exception:  # malformed directives or escapes make ruamel.yaml raise almost any error
        raise ConfigError(f"{name}: not valid YAML") from None


def _limit(yaml: Any, text: str, name: str) -> None:
    """Reject excessive depth and size before any recursive code runs."""
    depth = 0
    for count, event in enumerate(yaml.parse(text)):
        kind = type(event).__name__
        depth += kind in ("MappingStartEvent", "SequenceStartEvent")
        depth -= kind in ("MappingEndEvent", "SequenceEndEvent")
        if depth > MAX_DEPTH or count > 4 * MAX_VALUES:
            what = f"nested deeper than {MAX_DEPTH}" if depth > MAX_DEPTH else "too many values"
            raise ConfigError(f"{name}:{event.start_mark.line + 1}: {what}, this is not a config")


def _yaml_words(error: Any) -> str:
    problem = str(error.problem or error.context or "unreadable")
    if "'\\t'" in problem:
        return "a tab, indent with blanks"
    if "mapping values are not allowed" in problem:
        return "an unexpected ':' (is the line above indented alike, is a text in quotes?)"
    if "found another document" in problem:
        return "a second document (---), a config is one document"
    return problem


def _kind(node: Any) -> str:
    return {"mapping": "section", "sequence": "list", "scalar": "single value"}[node.id]


class _Walk:
    """Converts the node graph to values and records places and problems."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.count = 0
        self.open: list[int] = []

    def mapping(self, node: Any, path: KeyPath) -> dict[Any, Any]:
        """Return the values of a mapping; a duplicate key keeps its first value."""
        values: dict[str, Any] = {}
        first: dict[str, Place] = {}
        for key_node, value_node in node.value:
            here = _start(key_node)
            if key_node.id != "scalar":
                self.source.complain(here, "a key must be a single word")
                continue
            key = str(key_node.value)
            if key == "<<" and key_node.style is None:
                self.source.complain(
                    here, "merge keys (<<) are not part of YAML 1.2, write the values out"
                )
                continue
            if key in values:
                duplicate = format_path((*path, key))
                text = f"{duplicate} is given twice, first in line {first[key].line}"
                self.source.complain(here, text)
                continue
            first[key] = self.source.key_places[(*path, key)] = here
            values[key] = self.value(value_node, (*path, key))
        return values

    def value(self, node: Any, path: KeyPath) -> Any:
        """Return the value of any node."""
        source, here = self.source, _start(node)
        source.places[path] = here
        self.count += 1
        if id(node) in self.open or len(path) > MAX_DEPTH:
            raise ConfigError(source.at(here, "an alias (*) contains itself"))
        if self.count > MAX_VALUES:
            raise ConfigError(source.at(here, "too many values, this is not a config"))
        if not re.fullmatch(r"tag:yaml\.org,2002:[a-z]+", str(node.tag)):
            text = f"{format_path(path)} has a tag ({node.tag}), a config holds plain values only"
            source.complain(here, text)
            return None
        if node.id == "scalar":
            source.texts[path] = node.value if node.style is None else f'"{node.value}"'
            return scalar(node.value) if _is_plain(node) else node.value
        self.open.append(id(node))
        try:
            if node.id == "mapping":
                return self.mapping(node, path)
            return [self.value(item, (*path, i)) for i, item in enumerate(node.value)]
        finally:
            self.open.pop()


def _start(node: Any) -> Place:
    return Place(node.start_mark.line + 1, node.start_mark.column + 1)


def _is_plain(node: Any) -> bool:
    return node.style is None and not node.tag.endswith(":str")


def scalar(text: str) -> Any:
    """Convert an unquoted scalar by the core schema of YAML 1.2."""
    if text in ("", "~", "null", "Null", "NULL"):
        return None
    if text in ("true", "True", "TRUE", "false", "False", "FALSE"):
        return text[0] in "tT"
    if len(text) > 400:
        return text
    if re.fullmatch(r"[-+]?[0-9]+", text):
        return int(text)
    if re.fullmatch(r"0o[0-7]+|0x[0-9a-fA-F]+", text):
        return int(text, 0)
    if re.fullmatch(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?", text):
        return float(text)
    if re.fullmatch(r"[-+]?\.(inf|Inf|INF)", text):
        return float(text.replace(".", ""))
    if text in (".nan", ".NaN", ".NAN"):
        return float("nan")
    return text


def format_path(path: KeyPath) -> str:
    """Format a key path as a person writes it: ``rig.arcs_deg[1]``."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text

"""The values of a config, YAML 1.2 by ruamel.yaml or a dict, and where and how each is written."""

from __future__ import annotations

import codecs
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from beltid.errors import ConfigError

MAX_BYTES: Final = 100_000
KeyPath = tuple[str | int, ...]
Place = tuple[int, int]  # line and column, from 1; 0 if unknown


def format_path(path: KeyPath) -> str:
    """Format a key path as a person writes it: ``rig.arcs_deg[1]``."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return "".join(parts).removeprefix(".")


@dataclass(frozen=True)
class Source:
    """Values of a config, the name of its file, and its YAML, whose nodes know their places."""

    values: Any
    name: str = ""
    root: Any = None

    def node(self, path: KeyPath, *, key: bool = False) -> Any:
        """Return the YAML node of a value (or key); if it is absent, that of its section."""
        node = self.root
        for depth, part in enumerate(path, 1):
            found = [pair for name, *pair in _items(node) if str(name) == str(part)]
            if not found:
                break
            node = found[0][not (key and depth == len(path))]
        return node

    def place(self, path: KeyPath, *, key: bool = False) -> Place:
        """Return the place of a value (or key); if it is absent, that of its section."""
        node = self.node(path, key=key)
        return _place(node.start_mark) if node is not None else (0, 0)

    def at(self, place: Place) -> str:
        """Return ``file:line:column: ``, as far as known."""
        where = f":{place[0]}:{place[1]}" if place[0] else ""
        return f"{self.name}{where}: " if self.name else ""


def read_source(path: Path) -> Source:
    """Read a YAML file; what is no YAML, or holds no sections, is a ConfigError with its place."""
    name = str(path)
    try:
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1).removeprefix(codecs.BOM_UTF8)
        text = raw.decode()
    except FileNotFoundError:
        raise ConfigError(f"{path}: there is no such config file") from None
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        wrong = f"byte 0x{raw[error.start]:02X} is not UTF-8, save the config as UTF-8"
        raise ConfigError(f"{path}:{line}: {wrong}") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ConfigError(f"{path}: the config cannot be read: {reason}") from None
    if len(raw) > MAX_BYTES:
        raise ConfigError(f"{path}: larger than {MAX_BYTES:,} bytes, this is not a config")
    source = _parsed(text, name)
    if not isinstance(source.values, Mapping):
        what = "list" if isinstance(source.values, list) else "single value"
        found = ": the config is empty" if source.values is None else f":1:1: found a {what}"
        raise ConfigError(f"{name}{found}, it must hold sections such as belt:, rig:")
    return source


def _parsed(text: str, name: str) -> Source:
    from ruamel.yaml import YAML
    from ruamel.yaml.constructor import DuplicateKeyError
    from ruamel.yaml.error import MarkedYAMLError

    yaml, root, place = YAML(typ="safe", pure=True), None, name
    try:
        root = yaml.compose(text)
        return Source(root and yaml.constructor.construct_document(root), name, root)
    except MarkedYAMLError as error:
        reason = str(error.problem)
        if mark := error.problem_mark or error.context_mark:
            place = "{}:{}:{}".format(name, *_place(mark))
        if isinstance(error, DuplicateKeyError):
            reason = next(_twice(root, (), set()))
        elif "'\\t'" in reason:
            reason = "a tab, indent with blanks"
        elif "mapping values are not allowed" in reason:
            reason = "an unexpected ':' (is the line above indented alike, is a text in quotes?)"
    except Exception as error:  # malformed characters, escapes and numbers raise almost any error
        reason = str(error).partition("\n")[0][:200]
    raise ConfigError(f"{place}: not valid YAML: {reason}")


def _twice(node: Any, path: KeyPath, seen: set[int]) -> Iterator[str]:
    """Say of each key that a section has twice where it stood first; an alias is seen once."""
    if id(node) in seen:
        return
    seen.add(id(node))
    lines: dict[str | int, int] = {}
    for name, key, value in _items(node):
        if name in lines:
            yield f"{format_path((*path, name))} is given twice, first in line {lines[name]}"
        lines.setdefault(name, key.start_mark.line + 1)
        yield from _twice(value, (*path, name), seen)


def _items(node: Any) -> list[tuple[str | int, Any, Any]]:
    """Return name, node of the key and of the value of each item of a section or list."""
    if node is None or node.id == "scalar":
        return []
    if node.id == "sequence":
        return [(i, item, item) for i, item in enumerate(node.value)]
    return [(str(key.value), key, value) for key, value in node.value]


def _place(mark: Any) -> Place:
    return mark.line + 1, mark.column + 1

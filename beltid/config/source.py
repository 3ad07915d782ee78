"""The values of a config with their places: YAML 1.2 by ruamel.yaml, or a dict."""

from __future__ import annotations

import codecs
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from beltid.errors import ConfigError

MAX_BYTES: Final = 100_000
KeyPath = tuple[str | int, ...]
Place = tuple[int, int]
"""Line and column, from 1; 0 if unknown."""


def format_path(path: KeyPath) -> str:
    """Format a key path as a person writes it: ``rig.arcs_deg[1]``."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return "".join(parts).removeprefix(".")


@dataclass(frozen=True, slots=True)
class Source:
    """Values of a config; if they are from a file, with its name and lines.

    `repeated` holds keys that are given twice: place and message.
    """

    values: Any
    name: str = ""
    lines: tuple[str, ...] = ()
    repeated: tuple[tuple[Place, str], ...] = ()

    def place(self, path: KeyPath, *, key: bool = False) -> Place:
        """Return the place of a value (or key); if it is absent, that of its section."""
        node, place = self.values, (-1, -1)
        for depth, part in enumerate(path, 1):
            try:
                if isinstance(node, list):
                    place = node.lc.item(part)  # type: ignore[attr-defined]
                elif key and depth == len(path):
                    place = node.lc.key(part)
                else:
                    place = node.lc.value(part)
                node = node[part]
            except (AttributeError, LookupError, TypeError):
                break
        return place[0] + 1, place[1] + 1

    def at(self, place: Place) -> str:
        """Return ``file:line:column: ``, as far as known."""
        where = f":{place[0]}:{place[1]}" if place[0] else ""
        return f"{self.name}{where}: " if self.name else ""

    def written(self, path: KeyPath) -> str:
        """Return a number as the file writes it; "" if unknown."""
        line, column = self.place(path)
        text = self.lines[line - 1][column - 1 :] if self.lines else ""
        match = re.match(r"[-+.\w]+", text)
        return match[0] if match else ""


def read_source(path: Path) -> Source:
    """Read a YAML file.

    Raises
    ------
    ConfigError
        If the file cannot be read, is not YAML, or holds no sections.
    """
    text, name = _text(path), str(path)
    repeated: list[tuple[Any, Any, Any]] = []
    values = _parsed(text, name, repeated)
    if not isinstance(values, Mapping):
        what = "list" if isinstance(values, list) else "single value"
        found = ": the config is empty" if values is None else f":1:1: found a {what}"
        raise ConfigError(f"{name}{found}, it must hold sections such as belt:, rig:")
    twice = []
    for section, key, mark in repeated:
        above = next((f"{name}." for name, value in values.items() if value is section), "")
        first = section.lc.key(key)[0] + 1
        place = (mark.line + 1, mark.column + 1)
        twice.append((place, f"{above}{key} is given twice, first in line {first}"))
    return Source(values, name, tuple(text.splitlines()), tuple(twice))


def _text(path: Path) -> str:
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
    return text


def _parsed(text: str, name: str, repeated: list[tuple[Any, Any, Any]]) -> Any:
    """Parse a text; of a key given twice, the first value counts."""
    from ruamel.yaml import YAML
    from ruamel.yaml.constructor import RoundTripConstructor
    from ruamel.yaml.error import MarkedYAMLError

    class Constructor(RoundTripConstructor):
        def check_mapping_key(
            self, node: Any, key_node: Any, mapping: Any, key: Any, value: Any
        ) -> bool:
            if key in mapping:
                repeated.append((mapping, key, key_node.start_mark))
            return key not in mapping

    yaml = YAML(typ="rt", pure=True)
    yaml.Constructor = Constructor
    try:
        return yaml.load(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f"{name}:{mark.line + 1}:{mark.column + 1}" if mark else name
        reason = str(error.problem or error.context)
        reason = "a tab, indent with blanks" if "'\\t'" in reason else reason
        if "mapping values are not allowed" in reason:
            reason = "an unexpected ':' (is the line above indented alike, is a text in quotes?)"
    except RecursionError:
        place, reason = name, "nested too deep"
    except Exception as error:  # malformed characters, escapes and numbers raise almost any error
        place, reason = name, str(error).partition("\n")[0][:200]
    raise ConfigError(f"{place}: not valid YAML: {reason}")

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
    """Values of a config, with the name of its file; "" if there is none."""

    values: Any
    name: str = ""

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


def read_source(path: Path) -> Source:
    """Read a YAML file.

    Raises
    ------
    ConfigError
        If the file cannot be read, is not YAML, or holds no sections.
    """
    name = str(path)
    values = _parsed(_text(path), name)
    if not isinstance(values, Mapping):
        what = "list" if isinstance(values, list) else "single value"
        found = ": the config is empty" if values is None else f":1:1: found a {what}"
        raise ConfigError(f"{name}{found}, it must hold sections such as belt:, rig:")
    return Source(values, name)


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


def _parsed(text: str, name: str) -> Any:
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError

    try:
        return YAML(typ="rt", pure=True).load(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f"{name}:{mark.line + 1}:{mark.column + 1}" if mark else name
        reason = str(error.problem or error.context)
        reason = "a tab, indent with blanks" if "'\\t'" in reason else reason
        if "mapping values are not allowed" in reason:
            reason = "an unexpected ':' (is the line above indented alike, is a text in quotes?)"
        elif twice := re.match(r'found duplicate key "(.*?)"', reason):
            reason = f"{twice[1]} is given twice"
    except RecursionError:
        place, reason = name, "nested too deep"
    except Exception as error:  # malformed characters, escapes and numbers raise almost any error
        place, reason = name, str(error).partition("\n")[0][:200]
    raise ConfigError(f"{place}: not valid YAML: {reason}")

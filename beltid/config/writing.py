"""Write a config as YAML text, with the meaning and the range of every key."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from beltid.config.checks import Section, allowed
from beltid.config.loading import effective_values
from beltid.config.model import Config
from beltid.config.source import KeyPath, format_path

HEAD: Final = """\
# Config of the belt {name}, for beltid.
#
# Units are part of a key. A line such as "# ribs: 5" shows a default: remove the # and enter your
# own value. `beltid config check FILE` checks this file, `beltid config show --all -c FILE` shows
# all keys with their values, including the sections friction, simulation, drive and plan, and
# columns, units and dialect for files in another format.
"""
SECTIONS: Final = (
    *("belt", "press", "rig", "conditions", "contact", "data"),
    *("compare", "compare_drive", "uncertainty"),
)
"""Sections of a new config, in its order."""


def config_text(config: Config, *, complete: bool = True) -> str:
    """Write a config, or only what it states, as YAML that `load_config` reads as equal."""
    values = effective_values(config)
    shown = {path: "" for path, _, is_stated in values if complete or is_stated}
    return _text(config, shown) if shown else "{}  # nothing is stated\n"


def template_text(config: Config, sources: Mapping[str, str]) -> str:
    """Write a config for a new belt: what is stated, with its source; the rest commented out.

    What is commented out stays a default: an uncertainty that is not stated is an assumption.
    """
    paths = [path for path, _, _ in effective_values(config) if path[0] in SECTIONS]
    shown = {path: sources.get(format_path(path)) for path in paths}
    files = {kind: str(path) for kind, path in config.data.files.items()}  # as the user names them
    config = config.model_copy(update={"data": config.data.model_copy(update=files)})
    return f"{HEAD.format(name=config.belt.name)}\n{_text(config, shown)}"


def _text(config: Config, shown: Mapping[KeyPath, str | None]) -> str:
    """Write some keys, each with a note; keys without one are commented out."""
    sections = [_lines({name: value}, shown, ()) for name, value in config]
    return "\n\n".join("\n".join(lines) for section in sections if (lines := list(section))) + "\n"


def _lines(
    values: Section | Mapping[str, Any], shown: Mapping[KeyPath, str | None], above: KeyPath
) -> Iterator[str]:
    indent = "  " * len(above)
    for name, value in dict(values).items():
        path = (*above, name)
        if path in shown:
            of, notes = type(values), [shown[path]]
            if issubclass(of, Section):
                notes = [of.model_fields[name].description, allowed(of, name), *notes]
            line = f"{indent}{'# ' if shown[path] is None else ''}{name}: {value_text(value)}"
            yield _line(line, "; ".join(filter(None, notes)))
        elif isinstance(value, (Section, dict)):
            inside = list(_lines(value, shown, path))
            title = str(value.__doc__).splitlines()[0] if isinstance(value, Section) else ""
            yield from [_line(f"{indent}{name}:", title), *inside] if inside else ()


def _line(text: str, comment: str) -> str:
    return f"{text:<43} # {comment}" if comment else text


def value_text(value: Any) -> str:
    """Format a value as YAML text."""
    if isinstance(value, (Section, dict)):
        items = dict(value).items()
        return "{" + ", ".join(f"{value_text(k)}: {value_text(v)}" for k, v in items) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(value_text, value)) + "]"
    if isinstance(value, Path):
        value = os.path.abspath(value)  # the text may be saved in any folder
    if isinstance(value, str) and re.fullmatch(r"[A-Za-z/][\w./-]*", value, re.ASCII):
        return value if value.lower() not in ("null", "true", "false") else f'"{value}"'
    text = json.dumps(value, ensure_ascii=False)
    # 1e-05 is a number only in YAML 1.2; with a point it is one for every reader
    is_short = isinstance(value, float) and "." not in text
    return text.replace("e", ".0e") if is_short else text

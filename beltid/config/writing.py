"""Write a config as YAML text, with the meaning and the range of every key."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from beltid.config.fields import Section, allowed, key_of
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
    """Write a config as YAML text that `load_config` reads back to an equal config.

    Parameters
    ----------
    config : Config
        The config.
    complete : bool
        Whether to write the defaults too, not only what is stated.
    """
    lines: list[str] = []
    above: KeyPath = ()
    for path, value, is_stated in effective_values(config):
        if not (complete or is_stated):
            continue
        for depth, name in enumerate(path[:-1]):
            if path[: depth + 1] != above[: depth + 1]:
                lines.append(f"{'' if depth or not lines else chr(10)}{'  ' * depth}{name}:")
        above = path[:-1]
        lines.append(_line(config, path, value))
    return "\n".join(lines or ["{}  # nothing is stated"]) + "\n"


def template_text(config: Config, sources: Mapping[str, str]) -> str:
    """Write a config as text for a new belt; `load_config` reads it back to the same values.

    Parameters
    ----------
    config : Config
        The values. Keys that are not written must have their defaults.
    sources : dict of str to str
        Keys (``section.key``) that are stated, and a comment on what states them. The others are
        commented out and so stay defaults: an uncertainty that is not stated is an assumption.
    """
    lines = [HEAD.format(name=config.belt.name)]
    for name in SECTIONS:
        section: Section = getattr(config, name)
        lines.append(f"{name + ':':<44}# {str(section.__doc__).splitlines()[0]}")
        for path, value, _ in effective_values(section, (name,)):
            source = sources.get(format_path(path))
            value = str(value) if isinstance(value, Path) else value  # as the user names it
            lines.append(_line(config, path, value, "# " if source is None else "", source or ""))
        lines.append("")
    return "\n".join(lines)


def _line(config: Config, path: KeyPath, value: Any, sign: str = "", source: str = "") -> str:
    """Return the line of a key, with its meaning, its range and what states it."""
    notes, section = [source], config
    for name in path[:-1]:
        section = getattr(section, str(name), None)
    if isinstance(section, Section):
        of, name = type(section), str(path[-1])
        notes = [key_of(of, name).meaning, allowed(of, name), source]
    line = f"{'  ' * (len(path) - 1)}{sign}{value_text(path[-1])}: {value_text(value)}"
    comment = "; ".join(filter(None, notes))
    return f"{line:<43} # {comment}" if comment else line


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

"""Write a config as YAML text, with the meaning and the range of every key."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping
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
    values = effective_values(config)
    shown = {path: "" for path, _, is_stated in values if complete or is_stated}
    return "\n".join(_lines(config, shown) if shown else ["{}  # nothing is stated"]) + "\n"


def template_text(config: Config, sources: Mapping[str, str]) -> str:
    """Write a config for a new belt: what is stated, with its source; the rest commented out.

    What is commented out stays a default: an uncertainty that is not stated is an assumption.
    """
    paths = [path for path, _, _ in effective_values(config) if path[0] in SECTIONS]
    shown = {path: sources.get(format_path(path)) for path in paths}
    files = {kind: str(path) for kind, path in config.data.files.items()}  # as the user names them
    config = config.model_copy(update={"data": config.data.model_copy(update=files)})
    return "\n".join([HEAD.format(name=config.belt.name), *_lines(config, shown)]) + "\n"


def _lines(config: Config, shown: Mapping[KeyPath, str | None]) -> Iterator[str]:
    """Yield the lines of some keys, each with a note; keys without one are commented out."""
    above: KeyPath = ()
    for path, value, _ in effective_values(config):
        if path not in shown:
            continue
        section: Any = config
        for depth, name in enumerate(path[:-1]):
            section = getattr(section, str(name), None)
            if path[: depth + 1] != above[: depth + 1]:
                yield from [""] * (depth == 0 and above != ())
                title = str(section.__doc__).splitlines()[0] if isinstance(section, Section) else ""
                yield _line(f"{'  ' * depth}{name}:", title)
        above, name, note = path[:-1], str(path[-1]), shown[path]
        of = type(section)
        declared = (key_of(of, name).meaning, allowed(of, name)) if section is not None else ()
        sign = "# " if note is None else ""
        line = f"{'  ' * len(above)}{sign}{name}: {value_text(value)}"
        yield _line(line, "; ".join(filter(None, (*declared, note))))


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

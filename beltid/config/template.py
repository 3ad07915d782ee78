"""The text of a config for a new belt: every key of the benches with its meaning and its range."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from beltid.config.meanings import MEANINGS, SECTIONS
from beltid.config.model import Config
from beltid.config.writing import allowed, value_text

COLUMN: Final = 44
HEAD: Final = """\
# Config of the belt {name}, for beltid.
#
# Units are part of a key. A line such as "# ribs: 5" holds a default that nobody stated: take the
# sign # away and put in your own value. `beltid config check FILE` checks this file, `beltid config
# show -c FILE` shows all keys with their values, also those of the sections friction, surface,
# slip, simulation and drive, and of columns, units and dialect for files written in other ways.
"""


def template_text(config: Config, stated: frozenset[str]) -> str:
    """Text of a config, with comments; `load_config` reads it back to the same values.

    Parameters
    ----------
    config : Config
        The values. What the text does not write out must have its default.
    stated : frozenset of str
        Keys (``section.key``) that the user stated; the others are commented out, so that they
        stay defaults: an uncertainty that nobody stated is an assumption.
    """
    lines = [HEAD.format(name=config.belt.name)]
    for section, what in SECTIONS.items():
        lines.append(f"{section + ':':<{COLUMN}}# {what}")
        lines += _keys(section, getattr(config, section), stated)
        lines.append("")
    return "\n".join(lines)


def _keys(section: str, values: Any, stated: frozenset[str]) -> Iterator[str]:
    for name, field in type(values).model_fields.items():
        key = f"{section}.{name}"
        value = getattr(values, name)
        text = str(value) if section == "data" and value is not None else value
        range_ = allowed(field.annotation, field.metadata)
        notes = [MEANINGS[key], range_] if range_ else [MEANINGS[key]]
        sign = "" if key in stated else "# "
        line = f"  {sign}{name}: {value_text(text)}"
        yield f"{line:<{COLUMN - 1}} # {'; '.join(notes)}"

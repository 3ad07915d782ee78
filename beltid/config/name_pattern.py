"""Settings in the names of files: a pattern with names in braces, or a regular expression.

Names are matched by RE2, which Arrow brings along: its time grows with the length of the name only,
whatever the pattern is. So it knows no look-around and no back-references.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Final

_PLACE: Final = re.compile(r"\{([A-Za-z_]\w*)?(?::([^{}]*))?\}")
_NUMBER: Final = r"[-+]?\d+(?:[.,p]\d+)?"
_TEXT_NAMES: Final = ("run", "test", "idle", "condition", "side", "pulley_material")


@dataclass(frozen=True, slots=True)
class NameParts:
    """A pattern that is known to compile.

    Attributes
    ----------
    regex : str
        Has a named group for every name.
    names : tuple of str
        Names that it gives values to.
    units : dict of str to str
        Name -> unit in which it is written, where the pattern states one.
    """

    regex: str
    names: tuple[str, ...]
    units: dict[str, str]

    def values(self, name: str) -> dict[str, str] | None:
        """Values that a name holds; None if it does not match."""
        found = _matched(self.regex, [name])[0].as_py()
        return None if found is None else {k: v for k, v in found.items() if v}


def name_pattern(pattern: str) -> NameParts:
    """Compile a pattern.

    Parameters
    ----------
    pattern : str
        ``{run}_{arc_deg}deg_{initial_tension_N}N_{}.lvm``: ``{run}``, ``{test}``, ``{condition}``
        and ``{side}`` stand for a text, ``{}`` for a text that is not used, other names for a
        number (decimal sign ``.``, ``,`` or ``p``), ``{pulley_speed_rad_s:rpm}`` for a number in
        this unit. A pattern with
        ``(?P<name>...)`` is a regular expression of RE2.

    Raises
    ------
    ValueError
        If it does not compile.
    """
    regex, units = (pattern, {}) if "(?P<" in pattern else _from_braces(pattern)
    try:
        names = tuple(field.name for field in _matched(regex, []).type)
    except ValueError as error:
        raise ValueError(_why(str(error))) from None
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if twice:
        raise ValueError(f"it does not compile: {', '.join(twice)} is named twice")
    return NameParts(regex, names, units)


def _matched(regex: str, names: list[str]) -> Any:
    """Arrow array of the groups that a regular expression finds in whole names."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if not regex.isprintable():  # a NUL would end it
        raise ValueError("it holds a character that cannot be printed")
    # names of files may hold bytes that are no text
    texts = [name.encode("utf-8", "replace").decode() for name in names]
    return pc.extract_regex(pa.array(texts, pa.string()), pattern=rf"\A(?:{regex})\z")


def _why(said: str) -> str:
    """Why a pattern does not compile, in words."""
    if "unnamed groups" in said:
        return "it does not compile: a group without a name, write (?:...)"
    said = said.removeprefix("Invalid regular expression: ").partition(r": \A(?:")[0]
    return f"it does not compile: {said}"


def _from_braces(pattern: str) -> tuple[str, dict[str, str]]:
    """A pattern with braces as a regular expression, and the units that it states."""
    units: dict[str, str] = {}
    parts: list[str] = []
    at = 0
    for place in _PLACE.finditer(pattern):
        parts.append(re.escape(pattern[at : place.start()]))
        at = place.end()
        name, unit = place[1], place[2]
        if unit:
            units[name] = unit
        if not name:
            parts.append(".*?")
        elif name in _TEXT_NAMES or "_" not in name:
            parts.append(f"(?P<{name}>.+?)")
        else:
            parts.append(f"(?P<{name}>{_NUMBER})")
    parts.append(re.escape(pattern[at:]))
    return "".join(parts), units


def number(text: str) -> float:
    """A number as names of files write it: ``0.21``, ``0,21`` or ``0p21``."""
    return float(text.replace(",", ".").replace("p", "."))

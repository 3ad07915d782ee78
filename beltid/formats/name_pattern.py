"""What the name of a file tells: a pattern with names in braces, or a regular expression."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

_PLACE: Final = re.compile(r"\{([A-Za-z_]\w*)?(?::([^{}]*))?\}")
_NUMBER: Final = r"[-+]?\d+(?:[.,p]\d+)?"
_TEXT_NAMES: Final = ("run", "test")


@dataclass(frozen=True, slots=True)
class NameParts:
    """A compiled pattern.

    Attributes
    ----------
    regex : Pattern
        Has a named group for every name.
    units : dict of str to str
        Name -> unit in which it is written, where the pattern tells one.
    """

    regex: re.Pattern[str]
    units: dict[str, str]

    @property
    def names(self) -> tuple[str, ...]:
        """Names that the pattern gives values to."""
        return tuple(self.regex.groupindex)

    def values(self, name: str) -> dict[str, str] | None:
        """Values that a name holds; None if it is not made up like that."""
        found = self.regex.fullmatch(name)
        return None if found is None else {k: v for k, v in found.groupdict().items() if v}


def name_pattern(pattern: str) -> NameParts:
    """Compile a pattern.

    Parameters
    ----------
    pattern : str
        ``{run}_{arc_deg}deg_{initial_tension_N}N_{}.lvm``: ``{run}`` and ``{test}`` stand for a
        text, ``{}`` for a text that is not used, other names for a number (decimal sign ``.``,
        ``,`` or ``p``), ``{pulley_speed_rad_s:rpm}`` for a number in this unit. A pattern with
        ``(?P<name>...)`` is a regular expression.

    Raises
    ------
    ValueError
        If it does not compile.
    """
    try:
        if "(?P<" in pattern:
            return NameParts(re.compile(pattern), {})
        return _from_braces(pattern)
    except re.error as error:
        raise ValueError(f"it does not compile: {error}") from None


def _from_braces(pattern: str) -> NameParts:
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
    return NameParts(re.compile("".join(parts)), units)


def number(text: str) -> float:
    """A number as names of files write it: ``0.21``, ``0,21`` or ``0p21``."""
    return float(text.replace(",", ".").replace("p", "."))

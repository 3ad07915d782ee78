"""Settings in file names: a pattern with names in braces, or a regular expression.

Names are matched by RE2 (part of Arrow), whose time is linear in the length of the name for every
pattern; in return it has no look-around and no back-references.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Final

_PLACE: Final = re.compile(r"\{([A-Za-z_]\w*)?(?::([^{}]*))?\}")
_NUMBER: Final = r"[-+]?\d+(?:[.,p]\d+)?"
_TEXT_NAMES: Final = ("run", "test", "idle", "condition", "side")


@dataclass(frozen=True, slots=True)
class NameParts:
    """A compiled pattern: regular expression, its groups, and units that the pattern states."""

    regex: str
    names: tuple[str, ...]
    units: dict[str, str]

    def values(self, name: str) -> dict[str, str] | None:
        """Return the values in a file name; None if it does not match."""
        groups = _match(self.regex, [name])[0].as_py()
        return None if groups is None else {k: v for k, v in groups.items() if v}


def name_pattern(pattern: str) -> NameParts:
    """Compile ``{run}_{arc_deg}deg_{initial_tension_N}N_{}.lvm``, or raise a ValueError.

    ``{run}``, ``{test}``, ``{condition}`` and ``{side}`` match a text, ``{}`` a text that is
    ignored, other names a number (decimal sign ``.``, ``,`` or ``p``), ``{pulley_speed_rad_s:rpm}``
    a number in this unit. A pattern with ``(?P<name>...)`` is a regular expression of RE2.
    """
    regex, units = (pattern, {}) if "(?P<" in pattern else _from_braces(pattern)
    try:
        names = tuple(field.name for field in _match(regex, []).type)
    except ValueError as error:
        reason = str(error).removeprefix("Invalid regular expression: ").partition(r": \A(?:")[0]
        raise ValueError(f"it does not compile: {reason}") from None
    if len(set(names)) < len(names):
        raise ValueError("it names one of them twice")
    return NameParts(regex, names, units)


def _match(regex: str, names: list[str]) -> Any:
    """Match whole names against a regular expression; return an Arrow array of the groups."""
    import pyarrow as pa
    import pyarrow.compute as pc

    # file names may contain bytes that are not text
    texts = [name.encode("utf-8", "replace").decode() for name in names]
    return pc.extract_regex(pa.array(texts, pa.string()), pattern=rf"\A(?:{regex})\z")


def _from_braces(pattern: str) -> tuple[str, dict[str, str]]:
    """Convert a pattern with braces to a regular expression and its units."""
    places = list(_PLACE.finditer(pattern))
    units = {place[1]: place[2] for place in places if place[2]}
    regex, at = "", 0
    for place in places:
        name = place[1]
        is_text = name in _TEXT_NAMES or "_" not in (name or "")
        group = f"(?P<{name}>{'.+?' if is_text else _NUMBER})" if name else ".*?"
        regex += re.escape(pattern[at : place.start()]) + group
        at = place.end()
    return regex + re.escape(pattern[at:]), units


def number(text: str) -> float:
    """Parse a number of a file name: ``0.21``, ``0,21`` or ``0p21``."""
    return float(text.replace(",", ".").replace("p", "."))

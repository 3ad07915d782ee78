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
    """A compiled pattern.

    Attributes
    ----------
    regex : str
        Regular expression with one named group per name.
    names : tuple of str
        Names in the pattern.
    units : dict of str to str
        Name -> unit of its number, if the pattern states one.
    """

    regex: str
    names: tuple[str, ...]
    units: dict[str, str]

    def values(self, name: str) -> dict[str, str] | None:
        """Return the values in a file name; None if it does not match."""
        groups = _match(self.regex, [name])[0].as_py()
        return None if groups is None else {k: v for k, v in groups.items() if v}


def name_pattern(pattern: str) -> NameParts:
    """Compile a pattern.

    Parameters
    ----------
    pattern : str
        ``{run}_{arc_deg}deg_{initial_tension_N}N_{}.lvm``: ``{run}``, ``{test}``, ``{condition}``
        and ``{side}`` match a text, ``{}`` a text that is ignored, other names a number (decimal
        sign ``.``, ``,`` or ``p``), ``{pulley_speed_rad_s:rpm}`` a number in this unit. A pattern
        with ``(?P<name>...)`` is a regular expression of RE2.

    Raises
    ------
    ValueError
        If the pattern does not compile.
    """
    regex, units = (pattern, {}) if "(?P<" in pattern else _from_braces(pattern)
    try:
        names = tuple(field.name for field in _match(regex, []).type)
    except ValueError as error:
        raise ValueError(_reason(str(error))) from None
    repeated = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if repeated:
        raise ValueError(f"it does not compile: {', '.join(repeated)} is named twice")
    return NameParts(regex, names, units)


def _match(regex: str, names: list[str]) -> Any:
    """Match whole names against a regular expression; return an Arrow array of the groups."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if not regex.isprintable():  # a NUL would end it
        raise ValueError("it contains a character that cannot be printed")
    # file names may contain bytes that are not text
    texts = [name.encode("utf-8", "replace").decode() for name in names]
    return pc.extract_regex(pa.array(texts, pa.string()), pattern=rf"\A(?:{regex})\z")


def _reason(message: str) -> str:
    """Explain in plain words why a pattern does not compile."""
    if "unnamed groups" in message:
        return "it does not compile: a group without a name, write (?:...)"
    message = message.removeprefix("Invalid regular expression: ").partition(r": \A(?:")[0]
    return f"it does not compile: {message}"


def _from_braces(pattern: str) -> tuple[str, dict[str, str]]:
    """Convert a pattern with braces to a regular expression and its units."""
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
    """Parse a number of a file name: ``0.21``, ``0,21`` or ``0p21``."""
    return float(text.replace(",", ".").replace("p", "."))

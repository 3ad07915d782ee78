"""Names of channels: their units and positions, and which of our columns their words mean."""

from __future__ import annotations

import functools
import re
import unicodedata
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from beltid.tables import schemas
from beltid.tables.units import canonical_unit, is_known_unit

POSITION: Final = re.compile(r" #\d{1,4}(?=\s|$)")
"""Number that distinguishes channels of the same name."""
_OTHER: Final = "1 - -- % # V mV mV/V A mA Hz Pa kPa MPa bar W kW J mm/s mm/min m/s m/s^2 m/s²"
OTHER_UNITS: Final = frozenset((*_OTHER.split(), "N/mm", "N/mm²", "l/min"))
"""Units that none of our columns has, but that occur in a row of units."""
_CLOCK_FORM: Final = re.compile(r"h{1,2}:mm(:ss)?([.,][sf0]+)?", re.IGNORECASE)
IN_NAME: Final = re.compile(r"[\[(<{]([^\[\](){}<>]*)[\])>}]\s*$")
"""Brackets at the end of a name, which may hold its unit."""
# "Zeit / s", "Zeit/s", "Zeit in s"; not the slash within a unit, as in "v rad/s"
_AFTER_NAME: Final = re.compile(r"(?:(?<!\s)\s+/\s*|(?<=\w{4})/|(?<!\s)\s+in\s+)(\S+)\s*$")
_CHANNEL: Final = re.compile(r"^(?:channel|kanal|voie|ch|ai|c) ?\d+ (?=.)")
"""Prefix that a recorder puts before the name of a channel."""
_UMLAUTS: Final = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"})


def is_unit(text: str) -> bool:
    """Return whether a text is one of our units or another unit common on benches."""
    known = is_known_unit(text) or canonical_unit(text) in OTHER_UNITS
    return known or bool(_CLOCK_FORM.fullmatch(text.strip("[]() ")))


def unit_in_name(name: str) -> str:
    """Extract the unit from a name: ``Kraft [N]``, ``Weg (mm)``, ``Zeit / s``; "" if none."""
    match = (IN_NAME.search(name) or _AFTER_NAME.search(name)) if len(name) <= 300 else None
    unit = match[1].strip() if match else ""
    return unit if unit and is_unit(unit) else ""


def without_unit(name: str) -> str:
    """Remove the unit from the name of a channel."""
    if not unit_in_name(name):
        return name.strip()
    return (IN_NAME if IN_NAME.search(name) else _AFTER_NAME).sub("", name).strip()


def distinct_names(names: Sequence[str]) -> list[str]:
    """Number the channel names that occur several times: ``Kraft #2 [N]``."""
    counts, positions = Counter(names), Counter[str]()
    distinct = []
    for name in names:
        positions[name] += 1
        bare = without_unit(name) if name and counts[name] > 1 else name
        mark = f" #{positions[name]}" if name and counts[name] > 1 else ""
        distinct.append(f"{bare}{mark}{name[len(bare) :]}")
    return distinct


def without_position(name: str) -> str:
    """Remove the number that `distinct_names` added."""
    return POSITION.sub("", name)


def side_by_side(names: Sequence[str]) -> list[list[str]]:
    """Split the names of a table with several recordings side by side; [] if it holds one.

    All have the same names in the same order; a name that occurs once belongs to all.
    """
    repeated: dict[str, list[str]] = {}
    for name in names:
        if POSITION.search(name):
            repeated.setdefault(without_position(name), []).append(name)
    counts = {len(alike) for alike in repeated.values()}
    if len(repeated) < 2 or len(counts) != 1 or counts == {1}:
        return []
    shared = [name for name in names if not POSITION.search(name)]
    return [[*shared, *part] for part in zip(*repeated.values(), strict=True)]


class Words(NamedTuple):
    """Words that identify a channel, and words that may be added to them."""

    keys: tuple[re.Pattern[str], ...]
    fillers: frozenset[str]

    def mean(self, name: str) -> bool:
        """Return whether a simplified name is a key with fillers only around it."""
        rests = (key.sub(" ", name, count=1) for key in self.keys if key.search(name))
        return any(self.fillers.issuperset(rest.split()) for rest in rests)


@functools.cache
def _vocabulary() -> dict[str, Words]:
    """Return the words of each of our columns."""
    text = (Path(__file__).parent / "vocabulary.txt").read_text(encoding="utf-8")
    entries = re.sub(r"\n +", " ", re.sub(r"#.*\n", "", text)).splitlines()
    words: dict[str, Words] = {}
    for role, _, rest in (entry.partition(": ") for entry in entries):
        keys, _, added = rest.partition(" / ")
        fillers = {f for f in added.split() if f[0] != "@"}
        fillers.update(*(words[f[1:]].fillers for f in added.split() if f[0] == "@"))
        patterns = tuple(re.compile(rf"\b{re.escape(key)}\b") for key in keys.split(", "))
        words[role] = Words(patterns, frozenset(fillers))
    return words


def simplified(name: str) -> str:
    """Reduce a channel's name to lower-case words without brackets, unit, accents and signs."""
    bare = IN_NAME.sub("", without_unit(name)) or name
    low = re.sub(r"(?<=[a-zäöüéè])(?=[A-Z])", " ", bare).lower().translate(_UMLAUTS)
    plain = unicodedata.normalize("NFKD", low).encode("ascii", "ignore").decode()
    words = " ".join(re.findall(r"[a-z0-9]+", POSITION.sub("", plain)))
    return _CHANNEL.sub("", words)


@functools.lru_cache(256)  # files of one bench have the same few names
def roles_meant(name: str, kind: str) -> tuple[str, ...]:
    """Return our columns of a kind of recording that a channel's name can mean."""
    plain, columns = simplified(name), (*schemas.table(kind).names, "file")
    words = _vocabulary()
    return tuple(r for r in words if r in columns and plain and words[r].mean(plain))


def span_of(name: str) -> str:
    """Return the span that a channel's name tells: "tight", "slack" or ""."""
    plain, words = simplified(name), _vocabulary()
    spans = ("tight", "slack")
    told = [s for s in spans if any(key.search(plain) for key in words[f"tension_{s}_N"].keys)]
    return told[0] if len(told) == 1 else ""

"""Names of channels: their units and positions, and which of our columns their words mean."""

from __future__ import annotations

import functools
import re
import unicodedata
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final

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


def split_unit(name: str) -> tuple[str, str]:
    """Split a name from the unit at its end: ``Kraft [N]``, ``Weg (mm)``, ``Zeit / s``."""
    match = (IN_NAME.search(name) or _AFTER_NAME.search(name)) if len(name) <= 300 else None
    unit = match[1].strip() if match else ""
    if match is None or not unit or not is_unit(unit):
        return name.strip(), ""
    return name[: match.start()].strip(), unit


def distinct_names(names: Sequence[str]) -> list[str]:
    """Number the channel names that occur several times: ``Kraft #2 [N]``."""
    counts, positions = Counter(names), Counter[str]()
    distinct = []
    for name in names:
        positions[name] += 1
        if name and counts[name] > 1:
            bare = split_unit(name)[0]
            name = f"{bare} #{positions[name]}{name[len(bare) :]}"
        distinct.append(name)
    return distinct


def side_by_side(names: Sequence[str]) -> list[list[str]]:
    """Split the names of a table with several recordings side by side; [] if it holds one.

    All have the same names in the same order; a name that occurs once belongs to all.
    """
    repeated: dict[str, list[str]] = {}
    for name in filter(POSITION.search, names):
        repeated.setdefault(POSITION.sub("", name), []).append(name)
    counts = {len(alike) for alike in repeated.values()}
    if len(repeated) < 2 or len(counts) != 1 or counts == {1}:
        return []
    shared = [name for name in names if not POSITION.search(name)]
    return [[*shared, *part] for part in zip(*repeated.values(), strict=True)]


@functools.cache
def _vocabulary() -> dict[str, tuple[list[re.Pattern[str]], set[str]]]:
    """Return the words that identify each of our columns, and those that may be added."""
    text = (Path(__file__).parent / "vocabulary.txt").read_text(encoding="utf-8")
    words: dict[str, tuple[list[re.Pattern[str]], set[str]]] = {}
    for entry in re.sub(r"\n +", " ", re.sub(r"#.*\n", "", text)).splitlines():
        role, _, rest = entry.partition(": ")
        keys, _, added = rest.partition(" / ")
        fillers = {f for f in added.split() if f[0] != "@"}
        fillers.update(*(words[f[1:]][1] for f in added.split() if f[0] == "@"))
        words[role] = [re.compile(rf"\b{re.escape(key)}\b") for key in keys.split(", ")], fillers
    return words


def simplified(name: str) -> str:
    """Reduce a channel's name to lower-case words without brackets, unit, accents and signs."""
    bare = IN_NAME.sub("", split_unit(name)[0]) or name
    low = re.sub(r"(?<=[a-zäöüéè])(?=[A-Z])", " ", bare).lower().translate(_UMLAUTS)
    plain = unicodedata.normalize("NFKD", low).encode("ascii", "ignore").decode()
    return _CHANNEL.sub("", " ".join(re.findall(r"[a-z0-9]+", POSITION.sub("", plain))))


@functools.lru_cache(256)  # files of one bench have the same few names
def roles_meant(name: str, kind: str) -> tuple[str, ...]:
    """Return our columns that a channel's name can mean: a key with fillers only around it."""
    plain, columns = simplified(name), (*schemas.table(kind).names, "file")
    roles = []
    for role, (keys, fillers) in _vocabulary().items():
        rests = (key.sub(" ", plain, count=1) for key in keys if key.search(plain))
        if role in columns and any(fillers.issuperset(rest.split()) for rest in rests):
            roles.append(role)
    return tuple(roles)


def span_of(name: str) -> str:
    """Return the span that a channel's name tells: "tight", "slack" or ""."""
    plain, words = simplified(name), _vocabulary()
    keys = {span: words[f"tension_{span}_N"][0] for span in ("tight", "slack")}
    told = [span for span, of in keys.items() if any(key.search(plain) for key in of)]
    return told[0] if len(told) == 1 else ""

"""Which of our columns the name of a channel can mean, by the words of ``vocabulary.txt``."""

from __future__ import annotations

import functools
import re
import unicodedata
from pathlib import Path
from typing import Final, NamedTuple

from beltid.bench.header import IN_NAME, without_unit
from beltid.bench.raw import POSITION
from beltid.tables import schemas

_CHANNEL: Final = re.compile(r"^(?:channel|kanal|voie|ch|ai|c) ?\d+ (?=.)")
"""Prefix that a recorder puts before the name of a channel."""
_UMLAUTS: Final = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"})


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
        longest_first = sorted(keys.split(", "), key=len, reverse=True)
        patterns = (re.compile(rf"\b{re.escape(key)}\b") for key in longest_first)
        words[role] = Words(tuple(patterns), frozenset(fillers))
    return words


def simplified(name: str) -> str:
    """Reduce a channel's name to lower-case words without brackets, unit, accents and signs."""
    bare = IN_NAME.sub("", without_unit(name)) or name
    low = re.sub(r"(?<=[a-zäöüéè])(?=[A-Z])", " ", bare).lower().translate(_UMLAUTS)
    plain = unicodedata.normalize("NFKD", low).encode("ascii", "ignore").decode()
    words = " ".join(re.findall(r"[a-z0-9]+", POSITION.sub("", plain)))
    return _CHANNEL.sub("", words)


def roles_meant(name: str, kind: str) -> tuple[str, ...]:
    """Return our columns of a kind of recording that a channel's name can mean."""
    plain = simplified(name)
    return tuple(role for role, words in _words_of(kind) if plain and words.mean(plain))


def span_of(name: str) -> str:
    """Return the span that a channel's name tells: "tight", "slack" or ""."""
    plain, words = simplified(name), _vocabulary()
    spans = ("tight", "slack")
    told = [s for s in spans if any(key.search(plain) for key in words[f"tension_{s}_N"].keys)]
    return told[0] if len(told) == 1 else ""


@functools.cache
def _words_of(kind: str) -> tuple[tuple[str, Words], ...]:
    """Return the columns of a kind of recording, or of a table of its runs, with their words."""
    columns = (*schemas.table(kind).names, "file")
    return tuple((role, words) for role, words in _vocabulary().items() if role in columns)

"""Which of our columns the name of a channel can mean, by the words of ``vocabulary.txt``."""

from __future__ import annotations

import functools
import re
import unicodedata
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from beltid.bench.header import POSITION, without_unit
from beltid.tables import schemas

_CHANNEL: Final = re.compile(r"^(?:channel|kanal|voie|ch|ai|c) ?\d+ (?=.)")
"""Prefix that a recorder puts before the name of a channel."""
_UMLAUTS: Final = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"})


@dataclass(frozen=True, slots=True)
class Words:
    """Words that identify a channel, and words that may be added to them."""

    keys: tuple[re.Pattern[str], ...]
    fillers: frozenset[str]

    def mean(self, name: str) -> bool:
        """Return whether a simplified name is a key with fillers only around it."""
        for key in self.keys:
            rest, hits = key.subn(" ", name, count=1)
            if hits and all(word in self.fillers for word in rest.split()):
                return True
        return False


@functools.cache
def _vocabulary() -> dict[str, Words]:
    """Return the words of each of our columns."""
    text = (Path(__file__).parent / "vocabulary.txt").read_text(encoding="utf-8")
    entries = re.sub(r"\n +", " ", re.sub(r"#.*\n", "", text)).splitlines()
    words: dict[str, Words] = {}
    for role, _, rest in (entry.partition(": ") for entry in entries):
        keys, _, added = rest.partition(" / ")
        fillers = {f for f in added.split() if f[0] != "@"}
        for other in (f[1:] for f in added.split() if f[0] == "@"):
            fillers |= words[other].fillers
        longest_first = sorted(keys.split(", "), key=len, reverse=True)
        patterns = (re.compile(rf"\b{re.escape(key)}\b") for key in longest_first)
        words[role] = Words(tuple(patterns), frozenset(fillers))
    return words


def simplified(name: str) -> str:
    """Reduce a channel's name to lower-case words without unit, accents and signs."""
    bare = re.sub(r"(?<=[a-zäöüéè])(?=[A-Z])", " ", without_unit(name))
    low = bare.lower().translate(_UMLAUTS)
    plain = unicodedata.normalize("NFKD", low).encode("ascii", "ignore").decode()
    words = " ".join(re.findall(r"[a-z0-9]+", POSITION.sub("", plain)))
    return _CHANNEL.sub("", words)


def roles_meant(name: str, kind: str) -> tuple[str, ...]:
    """Return our columns of a kind of recording that a channel's name can mean."""
    plain = simplified(name)
    return tuple(role for role, words in _words_of(kind) if plain and words.mean(plain))


def roles_hinted(name: str, kind: str) -> tuple[str, ...]:
    """Return our columns that a channel's name hints at: one of their words is part of it."""
    plain = simplified(name)
    return tuple(
        role
        for role, words in _words_of(kind)
        if any(len(key.pattern) >= 8 and key.search(plain) for key in words.keys)  # 4 letters
    )


def means_date(name: str) -> bool:
    """Return whether a channel's name says that it holds dates."""
    return _vocabulary()["date"].mean(simplified(name))


@functools.cache
def _words_of(kind: str) -> tuple[tuple[str, Words], ...]:
    """Return the columns of a kind of recording, or of a table of its runs, with their words."""
    columns = (*schemas.table(kind).names, "file")
    return tuple((role, words) for role, words in _vocabulary().items() if role in columns)

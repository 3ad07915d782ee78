"""Collect everything that is wrong with a file before giving up on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from beltid.errors import InputError

SHOWN: Final = 20


@dataclass(slots=True)
class Problems:
    """Problems of one file, told together in the order of its lines.

    Attributes
    ----------
    found : list of (int, str)
        Line (0 for the whole file) and wording of the problems that are kept.
    count : int
        How many there were, with those that were not kept.
    """

    found: list[tuple[int, str]] = field(default_factory=list)
    count: int = 0

    def add(self, text: str, line: int = 0) -> None:
        """Note a problem; beyond a few hundred only their number is kept."""
        self.count += 1
        if len(self.found) < 20 * SHOWN:
            self.found.append((line, text))

    def take(self, others: Problems) -> None:
        """Note the problems of a part of the file."""
        self.count += others.count
        self.found += others.found[: 20 * SHOWN - len(self.found)]

    def add_uncounted(self, more: int) -> None:
        """Count problems that are like one already noted."""
        self.count += max(0, more)

    def told_once(self, places: Sequence[str]) -> None:
        """Make one of problems that are the same in several files.

        Parameters
        ----------
        places : sequence of str
            Names of the files, with which their problems begin.
        """
        alike: dict[str, list[tuple[int, str]]] = {}
        for line, text in self.found:
            place = next((p for p in places if text.startswith(p)), "")
            rest = text[len(place) :].partition(": ")[2] if place else text
            alike.setdefault(rest if place else f"\0{text}", []).append((line, text))
        self.found = []
        for rest, told in alike.items():
            line, text = told[0]
            if len(told) > 1 and not rest.startswith("\0"):
                text = f"{text[: -len(rest) - 2]} and {len(told) - 1} more: {rest}"
                self.count -= len(told) - 1
            self.found.append((line, text))

    def raise_if_any(self) -> None:
        """Raise an InputError with the first problems and the number of the others.

        Raises
        ------
        InputError
            If there is any problem.
        """
        if not self.count:
            return
        shown = [text for _, text in sorted(self.found, key=lambda item: item[0])[:SHOWN]]
        more = self.count - len(shown)
        raise InputError([*shown, f"and {more} more"] if more else shown)

"""Collect everything that is wrong with a file before giving up on it."""

from __future__ import annotations

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

    def add_uncounted(self, more: int) -> None:
        """Count problems that are like one already noted."""
        self.count += max(0, more)

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

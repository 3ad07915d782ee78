"""The order of the runs of a session: the arc is changed least, repetitions lie far apart.

Runs of one arc follow each other. Within an arc they come in rounds: every setting once, then the
repetitions in the same order, so that the two runs of a pair are a round apart and tell a drift. A
round goes up through every other setting and down through those between, so that a drift over time
is no trend over the tension.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

Setting = TypeVar("Setting")


@dataclass(frozen=True, slots=True)
class ScheduledRun:
    """A run in its place of the session.

    Attributes
    ----------
    run : int
        Number of the run, as it was chosen.
    repeat, repeats : int
        Which of how many runs at its setting, from 1.
    start_min : float
        Minutes from the start of the session.
    """

    run: int
    repeat: int
    repeats: int
    start_min: float


def schedule(
    chosen: Sequence[int],
    settings: Sequence[tuple[float, float, float]],
    minutes_per_run: float,
    minutes_per_arc_change: float,
) -> list[ScheduledRun]:
    """Put chosen runs in order.

    Parameters
    ----------
    chosen : sequence of int
        The runs, one as often as it is repeated.
    settings : sequence of tuple of float
        Arc, initial tension, speed of every run that may be chosen.
    minutes_per_run, minutes_per_arc_change : float
        What they take [min]; the arc of the first run counts as set.

    Returns
    -------
    list of ScheduledRun
        Arcs ascending.
    """
    ordered: list[ScheduledRun] = []
    clock = 0.0
    for arc in sorted({settings[i][0] for i in chosen}):
        clock += minutes_per_arc_change if ordered else 0.0
        here = sorted((i for i in set(chosen) if settings[i][0] == arc), key=settings.__getitem__)
        counts = {i: chosen.count(i) for i in here}
        for repeat in range(1, max(counts.values()) + 1):
            for i in _up_and_down([i for i in here if counts[i] >= repeat]):
                ordered.append(ScheduledRun(i, repeat, counts[i], clock))
                clock += minutes_per_run
    return ordered


def _up_and_down(items: list[Setting]) -> list[Setting]:
    """Every other item upwards, those between downwards."""
    return items[::2] + items[1::2][::-1]

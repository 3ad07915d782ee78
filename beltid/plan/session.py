"""Order of the runs in a session: few arc changes, repetitions far apart.

Runs of one arc follow each other. Within an arc the runs of a repeated setting are spread evenly
from the first to the last position, so that they show a drift. The others fill the gaps: up
through every other setting and down through the remaining ones, so that a drift over time does not
look like a trend over the tension.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ScheduledRun:
    """A run at its position in the session."""

    run: int  # number of the candidate
    repeat: int  # count of this run among the runs at its setting, from 1, and their number
    repeats: int
    start_minutes: float  # minutes from the start of the session


def schedule(
    chosen: Sequence[int],
    settings: Sequence[tuple[float, float, float]],
    minutes_per_run: float,
    minutes_per_arc_change: float,
) -> list[ScheduledRun]:
    """Put chosen runs in order, with ascending arcs.

    Parameters
    ----------
    chosen : sequence of int
        The runs, listed once per repetition.
    settings : sequence of tuple of float
        Arc, initial tension and speed of every candidate.
    minutes_per_run, minutes_per_arc_change : float
        Durations [min]; the arc of the first run is already set.
    """
    ordered: list[ScheduledRun] = []
    clock = 0.0
    for arc in sorted({settings[i][0] for i in chosen}):
        clock += minutes_per_arc_change if ordered else 0.0
        on_arc = sorted((i for i in set(chosen) if settings[i][0] == arc), key=settings.__getitem__)
        seen = dict.fromkeys(on_arc, 0)
        for i in _spread({i: chosen.count(i) for i in on_arc}):
            seen[i] += 1
            ordered.append(ScheduledRun(i, seen[i], chosen.count(i), clock))
            clock += minutes_per_run
    return ordered


def _spread(counts: dict[int, int]) -> list[int]:
    """Order the runs of one arc, given the number of runs per setting in ascending order."""
    places = list(range(sum(counts.values())))
    last = places[-1]
    at: dict[int, int] = {}
    for i, count in sorted(counts.items(), key=lambda item: -item[1]):
        for k in range(count if count > 1 else 0):
            wanted = last * k / (count - 1)
            at[places.pop(min(range(len(places)), key=lambda p: abs(places[p] - wanted)))] = i
    single = [i for i, count in counts.items() if count == 1]
    at.update(zip(places, single[::2] + single[1::2][::-1], strict=True))
    return [at[place] for place in sorted(at)]

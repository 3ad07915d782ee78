"""Cycles of a press test, told apart by the reversals of the crosshead."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError
from beltid.identify.estimators.statistics import sample_noise
from beltid.identify.press.preparation import PressTest, spread

Array = NDArray[np.float64]
CycleChoice = Literal["last", "first", "all"]

REVERSAL_SHARE = 0.05
"""A turn back by less than this share of the whole travel is no reversal."""
UNLOADED_SHARE = 0.5
"""A cycle is unloaded if its force falls below this share of its peak."""


@dataclass(frozen=True, slots=True)
class PressCycle:
    """Loading up to a reversal and the unloading after it.

    Attributes
    ----------
    number : int
        1 for the first cycle of the test.
    loading, unloading : slice
        Samples of the branches.
    peak_force_N : float
        Largest force of the cycle [N].
    complete : bool
        Whether the belt was unloaded again.
    """

    number: int
    loading: slice
    unloading: slice
    peak_force_N: float
    complete: bool


def turning_points(travel: Array, threshold: float) -> NDArray[np.intp]:
    """Samples at which the crosshead turns, with the first and the last one.

    Parameters
    ----------
    travel : ndarray
        Crosshead travel, shape (n,).
    threshold : float
        Smallest way back that counts as a turn, in the unit of `travel`: noise and the creeping
        during a dwell stay below it.

    Returns
    -------
    ndarray of int
        Indices; extremes alternate between them.
    """
    turns: list[int] = []
    low = high = 0
    direction = 0
    for i, x in enumerate(travel.tolist()):
        if x > travel[high]:
            high = i
        if x < travel[low]:
            low = i
        if direction >= 0 and travel[high] - x > threshold:
            turns.append(high)
            direction, low = -1, i
        elif direction <= 0 and x - travel[low] > threshold:
            turns.append(low)
            direction, high = 1, i
    end = high if direction > 0 else low if direction < 0 else travel.size - 1
    start = [] if turns[:1] == [0] else [0]
    return np.array([*start, *turns, end], dtype=np.intp)


def find_cycles(test: PressTest) -> tuple[PressCycle, ...]:
    """Cycles of a test in their order of time, told apart by the reversals of the crosshead.

    Loadings that end below half of the test's largest force (preloads, aborted cycles) are no
    cycles.
    """
    travel = test.travel_m
    threshold = max(REVERSAL_SHARE * spread(travel), 10.0 * sample_noise(travel))
    turns = turning_points(travel, threshold)
    cycles: list[PressCycle] = []
    largest = float(np.max(test.force_N))
    for k in range(turns.size - 1):
        start, peak = int(turns[k]), int(turns[k + 1])
        if travel[peak] <= travel[start]:
            continue
        stop = int(turns[k + 2]) if k + 2 < turns.size else peak
        force = test.force_N[start : stop + 1]
        top = float(np.max(force))
        if top < 0.5 * largest:
            continue
        tail = test.force_N[peak : stop + 1]
        complete = stop > peak and float(np.min(tail)) < UNLOADED_SHARE * top
        cycles.append(
            PressCycle(
                number=len(cycles) + 1,
                loading=slice(start, peak + 1),
                unloading=slice(peak, stop + 1),
                peak_force_N=top,
                complete=complete,
            )
        )
    if not cycles:
        raise InputError(
            f"test {test.label}: no loading found: the crosshead never moves into the belt"
        )
    return tuple(cycles)


def choose_cycles(
    label: str, cycles: tuple[PressCycle, ...], choice: CycleChoice
) -> tuple[tuple[PressCycle, ...], tuple[str, ...]]:
    """Cycles that enter the fit, and what there is to say about the choice.

    Parameters
    ----------
    label : str
        Name of the test.
    cycles : tuple of PressCycle
        All cycles of the test.
    choice : {"last", "first", "all"}
        ``last`` is the belt conditioned by the cycles before; ``first`` is virgin rubber.
    """
    complete = tuple(c for c in cycles if c.complete)
    if not complete:
        kept = cycles if choice == "all" else (cycles[0 if choice == "first" else -1],)
        return kept, (
            f"test {label}: never unloaded: the law is that of the loading branch alone, "
            "which lies above the middle of the branches",
        )
    notes: tuple[str, ...] = ()
    wanted = cycles[0 if choice == "first" else -1]
    if choice == "all":
        kept = complete
        if len(complete) < len(cycles):
            notes = (f"test {label}: {len(cycles) - len(complete)} cycles not unloaded left out",)
    else:
        kept = (complete[0 if choice == "first" else -1],)
        if kept[0] is not wanted:
            notes = (
                f"test {label}: cycle {wanted.number} is not unloaded, "
                f"cycle {kept[0].number} used in its place",
            )
    return kept, notes

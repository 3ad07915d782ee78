"""What the next runs bring, what remains after them, and whether to stop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from beltid.plan.design import Knowledge, Need, RunRows, choose_runs, needed_for
from beltid.plan.target import Target
from beltid.uncertainty.sources import FITTED, Source

WORTH = 0.1  # share of the uncertainty that runs must take off to be worth their time
LOOK_AHEAD = 24  # runs by which it is judged whether any number of them helps
MOSTLY = 0.5  # share of the variance from which on shared errors are what remains

Stop = Literal["goal reached", "shared errors remain", "runs do not help"]


@dataclass(frozen=True, slots=True)
class Region:
    """Uncertainty of ln mu in a part of the target, before and after the runs.

    Attributes
    ----------
    force, speed : tuple of float
        Lowest and highest line force [N/m] and sliding speed [m/s].
    before, after : float
        Root of the mean variance of ln mu [-].
    """

    force: tuple[float, float]
    speed: tuple[float, float]
    before: float
    after: float


@dataclass(frozen=True, slots=True)
class Statement:
    """What a better statement of a shared error would bring.

    Attributes
    ----------
    source : Source
        The first of its name.
    contribution : float
        Its part in the uncertainty after the runs [-].
    halved : float
        Uncertainty after the runs if it were known twice as well [-].
    """

    source: Source
    contribution: float
    halved: float


@dataclass(frozen=True, slots=True)
class Plan:
    """The next runs and what they bring.

    Attributes
    ----------
    chosen : tuple of int
        Numbers of the candidates, one as often as it is repeated; empty where the plan is to stop.
    gains : tuple of float
        Of each of these: rise of the uncertainty if it were left out, as a share; below zero only
        where the run is needed.
    needed : dict of int to str
        Number of a candidate that the plan has to have -> what for: its arc, its repetition.
    before, after : float
        Root of the mean variance of ln mu over the target [-].
    before_at, after_at : ndarray, shape (q,)
        Standard uncertainty of ln mu at the points of the target.
    regions : tuple of Region
        The same per region.
    shared : float
        Share of the variance after the runs that all of them share.
    statements : tuple of Statement
        Shared errors, the largest first; those that are fitted, not stated, among them.
    stop : str or None
        Why to stop; None where the runs are worth their time.
    """

    chosen: tuple[int, ...]
    gains: tuple[float, ...]
    needed: dict[int, Need]
    before: float
    after: float
    before_at: np.ndarray
    after_at: np.ndarray
    regions: tuple[Region, ...]
    shared: float
    statements: tuple[Statement, ...]
    stop: Stop | None

    @property
    def best_statement(self) -> Statement | None:
        """What would help most of all that can be stated better; None if nothing can."""
        stated = (one for one in self.statements if one.source.basis != FITTED)
        return next(stated, None)


def choose_plan(
    before: Knowledge,
    runs: RunRows,
    target: Target,
    sources: Sequence[Source],
    count: int,
    goal: float,
) -> Plan:
    """Choose the next runs, as few as reach the goal; none where they are not worth their time.

    Parameters
    ----------
    before : Knowledge
        What is known of the surface.
    runs : RunRows
        The candidates.
    target : Target
        Where the surface has to be known.
    sources : sequence of Source
        The shared errors, in the order of the columns.
    count : int
        Runs to plan at most, >= 1.
    goal : float
        Root of the mean variance of ln mu over the target that is good enough [-].
    """
    W = target.W
    now = before.variance(W)
    stop: Stop | None = None
    chosen: list[int] = []
    if now <= goal**2:
        stop = "goal reached"
    else:
        chosen = choose_runs(before, runs, W, count)
        chosen = _without_harm(before, runs, W, chosen, count)
        reached = before.after(runs, chosen).variance(W)
        if reached <= goal**2:
            chosen = _fewest(before, runs, W, chosen, goal**2)
        elif not _is_worth(before, runs, W, reached):
            stop = "runs do not help"
            chosen = []
    after = before.after(runs, chosen)
    then = after.variance(W)
    shared = float(np.sum(after.changes * (W @ after.changes)))
    if stop == "runs do not help" and shared > MOSTLY * then:
        stop = "shared errors remain"
    variances = target.variances(before), target.variances(after)
    without = _without_each(before, runs, W, chosen)
    return Plan(
        chosen=tuple(chosen),
        gains=tuple(float(np.sqrt(without[i] / then)) - 1.0 for i in chosen),
        needed=needed_for(runs, chosen, len(chosen)),
        before=float(np.sqrt(now)),
        after=float(np.sqrt(then)),
        before_at=np.sqrt(variances[0]),
        after_at=np.sqrt(variances[1]),
        regions=_regions(target, *variances),
        shared=shared / then,
        statements=_statements(after, W, sources),
        stop=stop,
    )


def _without_each(
    before: Knowledge, runs: RunRows, W: np.ndarray, chosen: list[int]
) -> dict[int, float]:
    """Variance if one of the chosen runs were left out, by its number."""
    found = {}
    for i in sorted(set(chosen)):
        others = list(chosen)
        others.remove(i)
        found[i] = before.after(runs, others).variance(W)
    return found


def _without_harm(
    before: Knowledge, runs: RunRows, W: np.ndarray, chosen: list[int], count: int
) -> list[int]:
    """A choice less the runs that make the surface worse by what they share with the others.

    Those that a plan has to have stay.
    """
    chosen = list(chosen)
    while chosen:
        needed = needed_for(runs, chosen, count)
        without = _without_each(before, runs, W, chosen)
        free = {i: variance for i, variance in without.items() if i not in needed}
        worst = min(free, key=free.__getitem__, default=None)
        if worst is None or free[worst] >= before.after(runs, chosen).variance(W):
            break
        chosen.remove(worst)
    return chosen


def _is_worth(before: Knowledge, runs: RunRows, W: np.ndarray, reached: float) -> bool:
    """Whether runs lower the uncertainty: those planned, or as many as a session more."""
    wanted = before.variance(W) * (1.0 - WORTH) ** 2
    if reached <= wanted:
        return True
    more = choose_runs(before, runs, W, LOOK_AHEAD)
    return before.after(runs, more).variance(W) <= wanted


def _fewest(
    before: Knowledge, runs: RunRows, W: np.ndarray, enough: list[int], goal: float
) -> list[int]:
    """The smallest choice that reaches a variance, by bisection; `enough` reaches it."""
    low, best = 0, enough
    while len(best) - low > 1:
        middle = (low + len(best)) // 2
        found = choose_runs(before, runs, W, middle)
        if before.after(runs, found).variance(W) <= goal:
            best = found
        else:
            low = middle
    return best


def _regions(target: Target, before: np.ndarray, after: np.ndarray) -> tuple[Region, ...]:
    def mean(variance: np.ndarray, here: np.ndarray) -> float:
        return float(np.sqrt(np.average(variance[here], weights=target.weight[here])))

    return tuple(
        Region(
            force=(float(target.normal_force[here].min()), float(target.normal_force[here].max())),
            speed=(float(target.slip_speed[here].min()), float(target.slip_speed[here].max())),
            before=mean(before, here),
            after=mean(after, here),
        )
        for here in target.regions()
    )


def _statements(
    after: Knowledge, W: np.ndarray, sources: Sequence[Source]
) -> tuple[Statement, ...]:
    """Shared errors by their part in the uncertainty, those without effect left out."""
    whole = after.variance(W)
    of_source = np.einsum("pk,pk->k", after.changes, W @ after.changes)
    names = dict.fromkeys(source.name for source in sources)
    found = []
    for name in names:
        mine = [k for k, source in enumerate(sources) if source.name == name]
        variance = float(of_source[mine].sum())
        halved = float(np.sqrt(whole - 0.75 * variance))
        found.append(Statement(sources[mine[0]], float(np.sqrt(variance)), halved))
    found = [one for one in found if one.contribution > 1.0e-6]
    return tuple(sorted(found, key=lambda one: one.halved))

"""Gain from the next runs, uncertainty that remains after them, and whether to stop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from beltid.plan.candidates import in_both_directions
from beltid.plan.design import Knowledge, Need, RunRows, choose_runs, needed_for
from beltid.plan.target import Target
from beltid.uncertainty.sources import FITTED, Source

WORTH = 0.1  # share of the uncertainty that runs must remove to be worth their time
LOOK_AHEAD = 24  # number of runs used to judge whether more runs can help at all
LEAST = 1.0e-6  # contribution [-] that is named
MOSTLY = 0.5  # shared errors dominate above this share of the variance

Stop = Literal["goal reached", "shared errors remain", "runs do not help"]


@dataclass(frozen=True, slots=True)
class Region:
    """Uncertainty of ln mu in a part of the target, before and after the runs."""

    force: tuple[float, float]  # lowest and highest line force [N/m] and sliding speed [m/s]
    speed: tuple[float, float]
    before: float  # root of the mean variance of ln mu [-]
    after: float


@dataclass(frozen=True, slots=True)
class Statement:
    """Gain from stating a shared error more accurately."""

    source: Source  # the first source of that name
    contribution: float  # its contribution to the uncertainty after the runs [-]
    halved: float  # uncertainty after the runs if this error were half as large [-]


@dataclass(frozen=True, slots=True)
class Plan:
    """The next runs and their expected gain."""

    chosen: tuple[int, ...]
    """Numbers of the candidates, listed once per repetition; empty if the plan is to stop. With n
    candidates, n + i is candidate i with the pulley turning the other way."""
    gains: tuple[float, ...]
    """Relative rise of the uncertainty if that run were left out; below zero only for a run that
    the plan must contain."""
    needed: dict[int, Need]
    """Number of a candidate that the plan must contain -> reason: its arc, its repetition."""
    before: float  # root of the mean variance of ln mu over the target [-]
    after: float
    regions: tuple[Region, ...]  # uncertainty before and after, per region
    shared: float  # share of the variance after the runs that comes from shared errors
    statements: tuple[Statement, ...]
    """Shared errors, the largest first, including those that are fitted rather than stated."""
    stop: Stop | None  # reason to stop; None if the runs are worth their time

    @property
    def best_statement(self) -> Statement | None:
        """Stated error whose better statement would help most; None if no error is stated."""
        return next((item for item in self.statements if item.source.basis != FITTED), None)


def choose_plan(
    before: Knowledge,
    runs: RunRows,
    target: Target,
    sources: Sequence[Source],
    count: int,
    goal: float,
    can_reverse: bool = False,
) -> Plan:
    """Choose the fewest runs that reach the goal; none if they are not worth their time.

    Parameters
    ----------
    before : Knowledge
        Present knowledge of the surface.
    runs : RunRows
        The candidates.
    target : Target
        Where the surface must be known.
    sources : sequence of Source
        The shared errors, in the order of the columns.
    count : int
        Largest number of runs, >= 1.
    goal : float
        Root of the mean variance of ln mu over the target that is accurate enough [-].
    can_reverse : bool
        Whether runs in the other direction may be planned. They are where the gain of the cells is
        the error whose better statement would help most: it changes its sign with the direction.
    """
    plan = _planned(before, runs, target, sources, count, goal)
    best = plan.best_statement
    if can_reverse and plan.stop != "goal reached" and best and best.source.error == "cell_gain":
        both = in_both_directions(runs, sources)
        reverse = _planned(before, both, target, sources, count, goal)
        if reverse.chosen and reverse.after < plan.after:
            return reverse
    return plan


def _planned(
    before: Knowledge,
    runs: RunRows,
    target: Target,
    sources: Sequence[Source],
    count: int,
    goal: float,
) -> Plan:
    """Choose among given candidates."""
    W, now = target.W, before.variance(target.W)

    def left(rows: Sequence[int]) -> float:
        """Return the variance after some runs."""
        return before.after(runs, rows).variance(W)

    def without(rows: Sequence[int]) -> dict[int, float]:
        """Return the variance without each of some runs, by their number."""
        return {i: left(_less(rows, i)) for i in sorted(set(rows))}

    stop: Stop | None = "goal reached" if now <= goal**2 else None
    chosen: list[int] = []
    if stop is None:
        chosen = _without_harmful(choose_runs(before, runs, W, count), runs, count, left, without)
        worthwhile = now * (1.0 - WORTH) ** 2
        if left(chosen) <= goal**2:
            fewer = 0  # by bisection
            while len(chosen) - fewer > 1:
                middle = (fewer + len(chosen)) // 2
                trial = choose_runs(before, runs, W, middle)
                if left(trial) <= goal**2:
                    chosen = trial
                else:
                    fewer = middle
        elif left(chosen) > worthwhile < left(choose_runs(before, runs, W, LOOK_AHEAD)):
            stop, chosen = "runs do not help", []
    after = before.after(runs, chosen)
    then = after.variance(W)
    shared = float(np.sum(after.changes * (W @ after.changes))) / then
    if stop == "runs do not help" and shared > MOSTLY:
        stop = "shared errors remain"
    missing = without(chosen)
    return Plan(
        chosen=tuple(chosen),
        gains=tuple(float(np.sqrt(missing[i] / then)) - 1.0 for i in chosen),
        needed=needed_for(runs, chosen, len(chosen)),
        before=float(np.sqrt(now)),
        after=float(np.sqrt(then)),
        regions=_regions(target, target.variances(before), target.variances(after)),
        shared=shared,
        statements=_statements(after, W, sources),
        stop=stop,
    )


def _less(rows: Sequence[int], i: int) -> list[int]:
    """Return the runs with one of them listed once less."""
    others = list(rows)
    others.remove(i)
    return others


def _without_harmful(
    chosen: list[int],
    runs: RunRows,
    count: int,
    left: Callable[[Sequence[int]], float],
    without: Callable[[Sequence[int]], dict[int, float]],
) -> list[int]:
    """Drop the runs whose shared errors make the surface worse, but those the plan must contain."""
    while chosen:
        needed = needed_for(runs, chosen, count)
        free = {i: variance for i, variance in without(chosen).items() if i not in needed}
        worst = min(free, key=free.__getitem__, default=None)
        if worst is None or free[worst] >= left(chosen):
            break
        chosen = _less(chosen, worst)
    return chosen


def _regions(target: Target, before: np.ndarray, after: np.ndarray) -> tuple[Region, ...]:
    """Return the uncertainty in every region, before and after the runs."""

    def mean(variance: np.ndarray, here: np.ndarray) -> float:
        return float(np.sqrt(np.average(variance[here], weights=target.weight[here])))

    def span(values: np.ndarray) -> tuple[float, float]:
        return float(values.min()), float(values.max())

    return tuple(
        Region(
            span(target.normal_force[here]),
            span(target.slip_speed[here]),
            mean(before, here),
            mean(after, here),
        )
        for here in target.regions()
    )


def _statements(
    after: Knowledge, W: np.ndarray, sources: Sequence[Source]
) -> tuple[Statement, ...]:
    """Rank the shared errors by their contribution; those without effect are left out."""
    total = after.variance(W)
    of_source = np.einsum("pk,pk->k", after.changes, W @ after.changes)
    first: dict[str, Source] = {}
    variance: dict[str, float] = {}
    for source, part in zip(sources, of_source.tolist(), strict=True):
        first.setdefault(source.name, source)
        variance[source.name] = variance.get(source.name, 0.0) + part
    statements = (
        Statement(first[name], float(np.sqrt(part)), float(np.sqrt(total - 0.75 * part)))
        for name, part in variance.items()
        if part > LEAST**2
    )
    return tuple(sorted(statements, key=lambda item: item.halved))

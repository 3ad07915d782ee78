"""Choose runs for a target, judge whether to stop, and put the runs in order.

Runs of one arc follow each other. Within an arc the runs of a repeated setting are spread evenly,
so that they show a drift; the others fill the gaps, up through every other setting and down through
the remaining ones, so that a drift over time does not look like a trend over the tension.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from beltid.plan.candidates import in_both_directions
from beltid.plan.knowledge import (
    SAME_SPEED,
    Knowledge,
    Need,
    RunRows,
    choose_runs,
    less,
    needed_for,
)
from beltid.refine.posterior import Curves
from beltid.uncertainty.sources import FITTED, Source

Array = NDArray[np.float64]

PLACES: Final = 30  # forces at each speed
REGIONS: Final = 3  # along each axis


@dataclass(frozen=True, slots=True)
class Target:
    """Points at which ln mu must be known, arrays (q,)."""

    normal_force: Array  # line forces [N/m] and sliding speeds [m/s]
    slip_speed: Array
    weight: Array  # weights of the points; their sum is one
    rows: Array  # ln mu at the points per parameter of the surface, (q, size)

    @property
    def W(self) -> Array:
        """Weights of the parameters (size, size): ``p' W p`` is the mean square of ln mu."""
        return np.asarray(self.rows.T @ (self.weight[:, None] * self.rows))

    def variances(self, knowledge: Knowledge) -> Array:
        """Return the variance of ln mu at the points (q,)."""
        scatter = np.einsum("qp,pr,qr->q", self.rows, knowledge.scatter, self.rows)
        return np.asarray(scatter + np.sum(np.square(self.rows @ knowledge.changes), axis=1))


def surface_target(
    curves: Curves, force: tuple[float, float], speed: tuple[float, float]
) -> Target:
    """Weigh a range of forces [N/m] and speeds [m/s] uniformly in ln f and ln v.

    The speeds are those of the curves within the range, or outside by up to `SAME_SPEED`, each
    weighted by half of its gaps to the next ones.
    """
    low, high = np.log(speed)
    inside = (curves.log_speed >= low - SAME_SPEED) & (curves.log_speed <= high + SAME_SPEED)
    v = np.exp(curves.log_speed[inside])
    f = np.geomspace(*force, PLACES)
    gaps = np.diff(np.log(v))
    share = 0.5 * (np.append(gaps, 0.0) + np.append(0.0, gaps)) if v.size > 1 else np.ones(1)
    weight = np.repeat(share / share.sum() / PLACES, PLACES)
    rows = np.kron(np.eye(inside.size)[inside], curves.basis(np.log(f)))
    return Target(np.tile(f, v.size), np.repeat(v, PLACES), weight, rows)


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
    """Put chosen runs, listed once per repetition, in order, with ascending arcs.

    `settings` holds arc, initial tension and speed of every candidate; the arc of the first run is
    already set.
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
    gains: tuple[float, ...]  # relative rise of the uncertainty if that run were left out
    needed: dict[int, Need]  # candidate that the plan must contain -> reason
    before: float  # root of the mean variance of ln mu over the target [-]
    after: float
    regions: tuple[Region, ...]  # uncertainty before and after, per region
    shared: float  # share of the variance after the runs that comes from shared errors
    statements: tuple[Statement, ...]  # shared errors, stated or fitted, the largest first
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
    before, runs, target
        Present knowledge of the surface, the candidates, and where it must be known.
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
        return {i: left(less(rows, i)) for i in sorted(set(rows))}

    stop: Stop | None = "goal reached" if now <= goal**2 else None
    chosen: list[int] = []
    if stop is None:
        chosen = choose_runs(before, runs, W, count)
        while chosen:  # drop runs whose shared errors make the surface worse, but no needed ones
            needed = needed_for(runs, chosen, count)
            free = {i: variance for i, variance in without(chosen).items() if i not in needed}
            worst = min(free, key=free.__getitem__, default=None)
            if worst is None or free[worst] >= left(chosen):
                break
            chosen = less(chosen, worst)
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


def _regions(target: Target, before: np.ndarray, after: np.ndarray) -> tuple[Region, ...]:
    """Return the uncertainty before and after the runs in the thirds of ln force and ln speed."""
    regions, number, axes = [], [], (target.normal_force, target.slip_speed)
    for x in np.log(axes):
        width = max(float(np.ptp(x)), 1.0e-12)
        number.append(np.floor(REGIONS * (x - x.min()) / width * (1.0 - 1.0e-9)))
    for third in np.unique(number, axis=1).T:
        here = np.all(third == np.array(number).T, axis=1)
        force, speed = ((float(x[here].min()), float(x[here].max())) for x in axes)
        weight = target.weight[here]
        u = np.sqrt([np.average(x[here], weights=weight) for x in (before, after)])
        regions.append(Region(force, speed, float(u[0]), float(u[1])))
    return tuple(regions)


def _statements(
    after: Knowledge, W: np.ndarray, sources: Sequence[Source]
) -> tuple[Statement, ...]:
    """Rank the shared errors by their contribution; those without effect are left out."""
    total = after.variance(W)
    of_source = np.einsum("pk,pk->k", after.changes, W @ after.changes)
    statements = []
    for name in dict.fromkeys(source.name for source in sources):
        same = [k for k, source in enumerate(sources) if source.name == name]
        part = float(of_source[same].sum())
        if part > LEAST**2:
            left = float(np.sqrt(total - 0.75 * part))
            statements.append(Statement(sources[same[0]], float(np.sqrt(part)), left))
    return tuple(sorted(statements, key=lambda item: item.halved))

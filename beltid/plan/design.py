"""Choose runs that minimize the mean variance of ln mu over a target, judge whether to stop.

Run i of the rig is one observation of the linear model

    y_i = j_i p + s_i e + noise_i,    noise_i ~ N(0, v_i),    e ~ N(0, 1),                   (P1)

with the parameters p of the surface and the errors e that runs share. The covariance Sigma of p by
scatter, and the change C of p by each shared error, are what is known; new runs update both by

    G = Sigma J' (V + J Sigma J')^-1,  Sigma -> Sigma - G J Sigma,  C -> C + G (S - J C),    (P2)

and the objective is the mean variance over a target of weights W, u² = tr W (Sigma + C C') (P3).
"""

import itertools
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.arrays import Array
from beltid.refine.posterior import Curves
from beltid.uncertainty.sources import FITTED, Source

TIE = 1.0e-9  # relative difference of two variances that counts as equal; the first one wins
ARCS = 3  # fewest arcs of a plan, if the rig has as many and the plan twice as many runs
FEWEST_WITH_REPEAT = 3  # plans with at least so many runs repeat one
SAME_SPEED = 0.1  # largest distance in ln v at which a run belongs to a speed of the surface
PLACES = 30  # forces at each speed of a target
REGIONS = 3  # along each axis
WORTH = 0.1  # share of the uncertainty that runs must remove to be worth their time
LOOK_AHEAD = 24  # number of runs used to judge whether more runs can help at all
LEAST = 1.0e-6  # contribution [-] that is named
MOSTLY = 0.5  # shared errors dominate above this share of the variance
OF_CELLS = ("cell_gain", "cell_offset")
"""Errors of each cell, which reversing the pulley swaps."""

Need = Literal["arc", "repetition"]
Stop = Literal["goal reached", "shared errors remain", "runs do not help"]


@dataclass(frozen=True, slots=True)
class RunRows:
    """Runs as rows of the linear model."""

    J: Array  # derivatives of ln mu with respect to the parameters of the surface, (n, size)
    S: Array  # change of measured less simulated ln mu by one u of each shared error, (n, K)
    variance: Array  # of ln mu by the noise of the run, (n,)
    arc: NDArray[np.intp]  # number of the arc setting, (n,)

    def in_both_directions(self, sources: Sequence[Source]) -> "RunRows":
        """Append every run in the other direction, numbered after those in the first (2n).

        The errors of the cells have changed places; those of one size for both cells.
        """
        place = {(source.error, source.place): k for k, source in enumerate(sources)}
        swapped = [
            place.get((s.error, 1 - s.place), k) if s.error in OF_CELLS else k
            for k, s in enumerate(sources)
        ]
        S = np.vstack([self.S, self.S[:, swapped]])
        return RunRows(np.tile(self.J, (2, 1)), S, np.tile(self.variance, 2), np.tile(self.arc, 2))


@dataclass(frozen=True, slots=True)
class Knowledge:
    """Knowledge of the parameters of a surface."""

    scatter: Array  # covariance by scatter, and by what was never measured, (size, size)
    changes: Array  # of the parameters by one u of each shared error, (size, K)

    def after(self, runs: RunRows, chosen: Sequence[int]) -> "Knowledge":
        """Update with some of the runs, (P2); a run counts as often as it is listed."""
        rows = list(chosen)
        if not rows:
            return self
        J = runs.J[rows]
        spread = self.scatter @ J.T
        gain = np.linalg.solve(np.diag(runs.variance[rows]) + J @ spread, spread.T).T
        changes = self.changes + gain @ (runs.S[rows] - J @ self.changes)
        return Knowledge(self.scatter - gain @ spread.T, changes)

    def variance(self, W: Array) -> float:
        """Return the mean variance of ln mu over a target with weights W (size, size), (P3)."""
        return float(np.sum(W * self.scatter) + np.sum(self.changes * (W @ self.changes)))

    def variance_after_one(self, runs: RunRows, W: Array) -> Array:
        """Return the variance after adding each run (n,) alone: (P2), (P3) of rank one."""
        spread = self.scatter @ runs.J.T
        total = runs.variance + np.einsum("np,pn->n", runs.J, spread)
        seen = np.einsum("pn,pn->n", spread, W @ spread)
        new = runs.S - runs.J @ self.changes
        turned = np.einsum("nk,nk->n", (W @ spread).T @ self.changes, new)
        squared = np.einsum("nk,nk->n", new, new)
        change = (2.0 * turned - seen) / total + seen * squared / np.square(total)
        return np.asarray(self.variance(W) + change)


def choose_runs(before: Knowledge, runs: RunRows, W: Array, count: int) -> list[int]:
    """Choose the runs that leave the smallest mean variance: one by one, then by exchange.

    The target has the weights W (size, size). Returns numbers of the candidates, ascending, `count`
    >= 1 of them: at least two arcs (if there are several) and, in three or more runs, one repeated
    run. Deterministic.
    """
    chosen, better = list[int](), _completed(before, runs, W, [], count)
    while better:
        chosen, better = better, []
        variance = before.after(runs, chosen).variance(W)
        pairs = sorted(set(itertools.combinations(chosen, 2)))
        for dropped in (*((i,) for i in sorted(set(chosen))), *pairs):
            refilled = _completed(before, runs, W, less(chosen, *dropped), count)
            if before.after(runs, refilled).variance(W) < variance * (1.0 - TIE):
                better = refilled
                break
    return chosen


def less(chosen: Sequence[int], *dropped: int) -> list[int]:
    """Return the chosen runs with each of the dropped ones listed once less."""
    return sorted((Counter(chosen) - Counter(dropped)).elements())


def _completed(
    before: Knowledge, runs: RunRows, W: Array, chosen: Sequence[int], count: int
) -> list[int]:
    """Complete a choice by adding the best run at a time; ascending."""
    chosen = list(chosen)
    for left in range(count - len(chosen) - 1, -1, -1):
        variance = before.after(runs, chosen).variance_after_one(runs, W)
        if sum(_lacking(runs, chosen, count).values()) > left:  # only runs that a need asks for
            after_each = [_lacking(runs, [*chosen, i], count) for i in range(runs.arc.size)]
            lacking = np.array([sum(needs.values()) for needs in after_each])
            variance = np.where(lacking <= left, variance, np.inf)
        chosen.append(int(np.flatnonzero(variance <= variance.min() * (1.0 + TIE))[0]))
    return sorted(chosen)


def _lacking(runs: RunRows, chosen: Sequence[int], count: int) -> dict[Need, int]:
    """Return how many runs a plan of `count` runs still needs for what."""
    wanted = min(max(2, min(ARCS, count // 2)), count, np.unique(runs.arc).size)
    repeats = count < FEWEST_WITH_REPEAT or len(set(chosen)) < len(chosen)
    arcs = np.unique(runs.arc[list(chosen)]).size
    return {"arc": max(wanted - arcs, 0), "repetition": int(not repeats)}


def needed_for(runs: RunRows, chosen: Sequence[int], count: int) -> dict[int, Need]:
    """Map each indispensable run of a plan of `count` runs to what the plan needs it for."""
    lacking = {i: _lacking(runs, less(chosen, i), count) for i in set(chosen)}
    return {i: next(need for need in n if n[need]) for i, n in lacking.items() if any(n.values())}


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

    def regions(self, before: Knowledge, after: Knowledge) -> list[dict[str, Any]]:
        """Return rows with the uncertainty before and after runs in thirds of ln f and ln v."""
        axes, number = (self.normal_force, self.slip_speed), []
        for x in np.log(axes):
            width = max(float(np.ptp(x)), 1.0e-12)
            number.append(np.floor(REGIONS * (x - x.min()) / width * (1.0 - 1.0e-9)))
        rows = []
        for third in np.unique(number, axis=1).T:
            here = np.all(third == np.array(number).T, axis=1)
            part = Target(*(x[here] for x in (*axes, self.weight, self.rows)))
            share = part.weight.sum()
            u = (np.sqrt(known.variance(part.W) / share) for known in (before, after))
            ranges = ((float(x[here].min()), float(x[here].max())) for x in axes)
            names = ("force_range_N_m", "speed_range_m_s", "before_percent", "after_percent")
            values = (*ranges, *(100.0 * float(x) for x in u))
            rows.append(dict(zip(names, values, strict=True)))
        return rows


def surface_target(
    curves: Curves, force: tuple[float, float], speed: tuple[float, float]
) -> Target:
    """Weigh a range of forces [N/m] and speeds [m/s] uniformly in ln f and ln v.

    The speeds are those of the curves within the range, or outside by up to `SAME_SPEED`, each
    weighted by half of its gaps to the next ones.
    """
    low, high = np.log(speed)
    inside = (curves.log_speed >= low - SAME_SPEED) & (curves.log_speed <= high + SAME_SPEED)
    v, f = np.exp(curves.log_speed[inside]), np.geomspace(*force, PLACES)
    gaps = np.diff(np.log(v))
    share = np.append(gaps, 0.0) + np.append(0.0, gaps) if v.size > 1 else np.ones(1)
    weight = np.repeat(share / share.sum() / PLACES, PLACES)
    rows = np.kron(np.eye(inside.size)[inside], curves.basis(np.log(f)))
    return Target(np.tile(f, v.size), np.repeat(v, PLACES), weight, rows)


class Statement(NamedTuple):
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
    gains: Mapping[int, float]  # relative rise of the uncertainty if one such run were left out
    needed: dict[int, Need]  # candidate that the plan must contain -> reason
    before: float  # root of the mean variance of ln mu over the target [-]
    after: float
    regions: list[dict[str, Any]]  # uncertainty before and after, per region
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
    """Choose the fewest runs that reach the goal, at most `count`; none if not worth their time.

    `goal` is the root of the mean variance of ln mu over the target that is accurate enough [-];
    the sources are in the order of the columns. Runs in the other direction are planned, if they
    may be, where the gain of the cells is the error whose better statement would help most: it
    changes its sign with the direction.
    """
    W, chosen = target.W, list[int]()
    now = before.variance(W)
    stop: Stop | None = "goal reached" if now <= goal**2 else None

    def left(rows: Sequence[int]) -> float:
        """Return the variance after some runs."""
        return before.after(runs, rows).variance(W)

    def without(rows: Sequence[int]) -> dict[int, float]:
        """Return the variance without each of some runs, by their number."""
        return {i: left(less(rows, i)) for i in sorted(set(rows))}

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
    of_source = np.einsum("pk,pk->k", after.changes, W @ after.changes)
    shared = float(of_source.sum()) / then
    if stop == "runs do not help" and shared > MOSTLY:
        stop = "shared errors remain"
    plan = Plan(
        chosen=tuple(chosen),
        gains={i: math.sqrt(variance / then) - 1.0 for i, variance in without(chosen).items()},
        needed=needed_for(runs, chosen, len(chosen)),
        before=math.sqrt(now),
        after=math.sqrt(then),
        regions=target.regions(before, after),
        shared=shared,
        statements=_statements(sources, of_source, then),
        stop=stop,
    )
    best = plan.best_statement
    if can_reverse and stop != "goal reached" and best and best.source.error == "cell_gain":
        both = runs.in_both_directions(sources)
        reverse = choose_plan(before, both, target, sources, count, goal)
        if reverse.chosen and reverse.after < plan.after:
            return reverse
    return plan


def _statements(sources: Sequence[Source], of_source: Array, total: float) -> tuple[Statement, ...]:
    """Rank the shared errors by their contribution; those without effect are left out."""
    parts = dict[str, float]()
    for source, part in zip(sources, of_source.tolist(), strict=True):
        parts[source.name] = parts.get(source.name, 0.0) + part
    first = {source.name: source for source in reversed(sources)}
    statements = [
        Statement(first[name], math.sqrt(part), math.sqrt(total - 0.75 * part))
        for name, part in parts.items()
        if part > LEAST**2
    ]
    return tuple(sorted(statements, key=lambda item: item.halved))


class ScheduledRun(NamedTuple):
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

    On each arc, repeated settings come first and again after the others, among which the tension
    rises and falls again. `settings` holds arc, initial tension and speed of every candidate; the
    arc of the first run is already set.
    """
    ordered: list[ScheduledRun] = []
    clock, repeats = 0.0, Counter(chosen)
    for arc in sorted({settings[i][0] for i in chosen}):
        clock += minutes_per_arc_change if ordered else 0.0
        on_arc = sorted((i for i in repeats if settings[i][0] == arc), key=settings.__getitem__)
        there_and_back = sorted(on_arc[::2] + on_arc[1::2][::-1], key=lambda i: -repeats[i])
        for turn in range(max(repeats[i] for i in on_arc)):
            for i in (i for i in there_and_back if repeats[i] > turn):
                ordered.append(ScheduledRun(i, turn + 1, repeats[i], clock))
                clock += minutes_per_run
    return ordered

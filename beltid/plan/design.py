"""Choice of runs: the mean variance of ln mu over a target, as the refined surface will state it.

A run i of the rig is a datum of the linear model

    y_i = j_i p + s_i e + noise_i,    noise_i ~ N(0, v_i),    e ~ N(0, 1),                   (P1)

with the parameters p of the surface (ln mu at its knots) and the errors e that runs share, in units
of their standard uncertainties. The fit of the surface weighs the runs by their noise and by the
roughness of the surface; what they share it cannot tell from friction. So two factors describe what
is known: the covariance of p by scatter, Sigma, and the change C of p by each shared error. New
runs (rows J, S, noise V) move both,

    G = Sigma J' (V + J Sigma J')^-1,  Sigma -> Sigma - G J Sigma,  C -> C + G (S - J C),    (P2)

whatever the order of the runs. Their worth is the mean variance over the target, W its weights:

    u² = tr W (Sigma + C C').                                                                (P3)

It counts shared errors as they act: a run with a larger share of one than the others can make the
surface worse. That is why it is not the shortest arc, which has the smallest noise in tension and
the largest error of the arc, that is always chosen.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TIE = 1.0e-9  # relative difference of two variances that is rounding: the first candidate is taken
ARCS = 3  # that a plan has at least, where the rig has as many and the plan at least twice as many
FEWEST_WITH_REPEAT = 3  # runs of a plan from which on one is repeated

Need = Literal["arc", "repetition"]


@dataclass(frozen=True, slots=True)
class RunRows:
    """Runs as rows of the linear model.

    Attributes
    ----------
    J : ndarray, shape (n, size)
        Derivatives of ln mu of the runs by the parameters of the surface.
    S : ndarray, shape (n, K)
        Change of measured less simulated ln mu by one standard uncertainty of each shared error.
    variance : ndarray, shape (n,)
        Of ln mu by the noise of the run.
    arc : ndarray of int, shape (n,)
        Number of the arc setting.
    """

    J: Array
    S: Array
    variance: Array
    arc: NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Knowledge:
    """What is known of the parameters of a surface.

    Attributes
    ----------
    scatter : ndarray, shape (size, size)
        Covariance by what differs from run to run, and by what was never measured.
    changes : ndarray, shape (size, K)
        Change of the parameters by one standard uncertainty of each shared error.
    """

    scatter: Array
    changes: Array

    def after(self, runs: RunRows, chosen: Sequence[int]) -> Knowledge:
        """Knowledge after some of the runs, one as often as it is named, (P2)."""
        rows = list(chosen)
        if not rows:
            return self
        J = runs.J[rows]
        spread = self.scatter @ J.T
        gain = np.linalg.solve(np.diag(runs.variance[rows]) + J @ spread, spread.T).T
        return Knowledge(
            self.scatter - gain @ spread.T,
            self.changes + gain @ (runs.S[rows] - J @ self.changes),
        )

    def variance(self, W: Array) -> float:
        """Mean variance of ln mu over a target with weights W (size, size), (P3)."""
        return float(np.sum(W * self.scatter) + np.sum(self.changes * (W @ self.changes)))

    def variance_after_one(self, runs: RunRows, W: Array) -> Array:
        """The same after one run more, for each of the runs (n,): (P2), (P3) of rank one."""
        spread = self.scatter @ runs.J.T
        total = runs.variance + np.einsum("np,pn->n", runs.J, spread)
        seen = np.einsum("pn,pn->n", spread, W @ spread)
        new = runs.S - runs.J @ self.changes
        turned = np.einsum("nk,nk->n", (W @ spread).T @ self.changes, new)
        squared = np.einsum("nk,nk->n", new, new)
        change = (2.0 * turned - seen) / total + seen * squared / np.square(total)
        return np.asarray(self.variance(W) + change)


def choose_runs(before: Knowledge, runs: RunRows, W: Array, count: int) -> list[int]:
    """The runs with the smallest mean variance afterwards: one by one, then by exchange.

    Parameters
    ----------
    before : Knowledge
        What is known.
    runs : RunRows
        The candidates; each may be chosen several times.
    W : ndarray, shape (size, size)
        Weights of the target.
    count : int
        Runs to choose, >= 1.

    Returns
    -------
    list of int
        Numbers of the candidates, ascending. At least two arcs (of several) and, of three runs or
        more, one repeated run. The same for the same input.
    """
    chosen = _filled(before, runs, W, [], count)
    variance = before.after(runs, chosen).variance(W)
    improved = True
    while improved:
        improved = False
        for dropped in _singles_and_pairs(chosen):
            others = list(chosen)
            for i in dropped:
                others.remove(i)
            refilled = _filled(before, runs, W, others, count)
            lower = before.after(runs, refilled).variance(W)
            if lower < variance * (1.0 - TIE):
                chosen, variance, improved = refilled, lower, True
                break
    return chosen


def _singles_and_pairs(chosen: list[int]) -> list[tuple[int, ...]]:
    """What an exchange takes out: one run; where no such exchange helps, two."""
    singles = [(i,) for i in sorted(set(chosen))]
    return [*singles, *sorted(set(itertools.combinations(chosen, 2)))]


def _filled(before: Knowledge, runs: RunRows, W: Array, chosen: list[int], count: int) -> list[int]:
    """A choice made complete by the best run at a time, ascending."""
    chosen = list(chosen)
    for left in range(count - len(chosen) - 1, -1, -1):
        variance = before.after(runs, chosen).variance_after_one(runs, W)
        variance = np.where(_lacking(runs, chosen, count) <= left, variance, np.inf)
        chosen.append(int(np.flatnonzero(variance <= variance.min() * (1.0 + TIE))[0]))
    return sorted(chosen)


def _lacking(runs: RunRows, chosen: list[int], count: int) -> NDArray[np.intp]:
    """Runs (n,) that a choice with each candidate added still needs, for arcs and repetition."""
    mine = np.unique(runs.arc[chosen])
    arcs = mine.size + ~np.isin(runs.arc, mine)
    repeated = np.isin(np.arange(runs.arc.size), chosen)
    if count < FEWEST_WITH_REPEAT or len(set(chosen)) < len(chosen):
        repeated[:] = True
    return np.asarray(np.maximum(_arcs_wanted(runs, count) - arcs, 0) + ~repeated, dtype=np.intp)


def _arcs_wanted(runs: RunRows, count: int) -> int:
    return min(max(2, min(ARCS, count // 2)), count, np.unique(runs.arc).size)


def needed_for(runs: RunRows, chosen: Sequence[int], count: int) -> dict[int, Need]:
    """What a choice for a plan of `count` runs would lack without a run, by the run's number.

    A run that the plan could do without is not in it.
    """
    found: dict[int, Need] = {}
    for i in set(chosen):
        others = list(chosen)
        others.remove(i)
        if np.unique(runs.arc[others]).size < _arcs_wanted(runs, count):
            found[i] = "arc"
        elif count >= FEWEST_WITH_REPEAT and len(set(others)) == len(others):
            found[i] = "repetition"
    return found

"""Choose runs that minimize the mean variance of ln mu over a target.

The variance is that which the refined surface will report. Run i of the rig is one observation of
the linear model

    y_i = j_i p + s_i e + noise_i,    noise_i ~ N(0, v_i),    e ~ N(0, 1),                   (P1)

with the parameters p of the surface (ln mu at its knots) and the errors e that runs share, in units
of their standard uncertainties. The surface fit weighs the runs by their noise and by the roughness
of the surface; it cannot distinguish shared errors from friction. So two factors describe the
present knowledge: the covariance Sigma of p by scatter, and the change C of p by each shared error.
New runs (rows J, S, noise V) update both,

    G = Sigma J' (V + J Sigma J')^-1,  Sigma -> Sigma - G J Sigma,  C -> C + G (S - J C),    (P2)

in any order of the runs. The objective is the mean variance over the target with weights W:

    u² = tr W (Sigma + C C').                                                                (P3)

It includes shared errors: a run that is more sensitive to one than the others can make the surface
worse. So the shortest arc, with the smallest noise in tension but the largest error of the arc, is
not always chosen.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TIE = 1.0e-9  # relative difference of two variances that counts as equal; the first candidate wins
ARCS = 3  # fewest arcs of a plan, if the rig has as many and the plan twice as many runs
FEWEST_WITH_REPEAT = 3  # plans with at least so many runs repeat one

Need = Literal["arc", "repetition"]


@dataclass(frozen=True, slots=True)
class RunRows:
    """Runs as rows of the linear model."""

    J: Array
    """Derivatives of ln mu of the runs with respect to the parameters of the surface, (n, size)."""
    S: Array
    """Change of measured less simulated ln mu per standard uncertainty of each shared error, (n,
    K)."""
    variance: Array  # variance of ln mu by the noise of the run, (n,)
    arc: NDArray[np.intp]  # number of the arc setting, (n,)


@dataclass(frozen=True, slots=True)
class Knowledge:
    """Knowledge of the parameters of a surface."""

    scatter: Array
    """Covariance by the scatter from run to run, and by what was never measured, (size, size)."""
    changes: Array
    """Change of the parameters per standard uncertainty of each shared error, (size, K)."""

    def after(self, runs: RunRows, chosen: Sequence[int]) -> Knowledge:
        """Update with some of the runs, (P2); a run counts as often as it is listed."""
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

    Parameters
    ----------
    before : Knowledge
        Present knowledge.
    runs : RunRows
        The candidates; each may be chosen several times.
    W : ndarray, shape (size, size)
        Weights of the target.
    count : int
        Runs to choose, >= 1.

    Returns
    -------
    list of int
        Numbers of the candidates, ascending. At least two arcs (if there are several) and, in three
        or more runs, one repeated run. Deterministic.
    """
    chosen = _completed(before, runs, W, [], count)
    variance = before.after(runs, chosen).variance(W)
    improved = True
    while improved:
        improved = False
        for dropped in _singles_and_pairs(chosen):
            others = list(chosen)
            for i in dropped:
                others.remove(i)
            refilled = _completed(before, runs, W, others, count)
            lower = before.after(runs, refilled).variance(W)
            if lower < variance * (1.0 - TIE):
                chosen, variance, improved = refilled, lower, True
                break
    return chosen


def _singles_and_pairs(chosen: list[int]) -> list[tuple[int, ...]]:
    """List what an exchange may remove: first single runs, then pairs."""
    singles = [(i,) for i in sorted(set(chosen))]
    return [*singles, *sorted(set(itertools.combinations(chosen, 2)))]


def _completed(
    before: Knowledge, runs: RunRows, W: Array, chosen: list[int], count: int
) -> list[int]:
    """Complete a choice by adding the best run at a time; ascending."""
    chosen = list(chosen)
    for left in range(count - len(chosen) - 1, -1, -1):
        variance = before.after(runs, chosen).variance_after_one(runs, W)
        variance = np.where(_missing_runs(runs, chosen, count) <= left, variance, np.inf)
        chosen.append(int(np.flatnonzero(variance <= variance.min() * (1.0 + TIE))[0]))
    return sorted(chosen)


def _missing_runs(runs: RunRows, chosen: list[int], count: int) -> NDArray[np.intp]:
    """Count the runs (n,) still needed for arcs and repetition after adding each candidate."""
    covered = np.unique(runs.arc[chosen])
    arcs = covered.size + ~np.isin(runs.arc, covered)
    repeated = np.isin(np.arange(runs.arc.size), chosen)
    if count < FEWEST_WITH_REPEAT or len(set(chosen)) < len(chosen):
        repeated[:] = True
    return np.asarray(np.maximum(_arcs_wanted(runs, count) - arcs, 0) + ~repeated, dtype=np.intp)


def _arcs_wanted(runs: RunRows, count: int) -> int:
    return min(max(2, min(ARCS, count // 2)), count, np.unique(runs.arc).size)


def needed_for(runs: RunRows, chosen: Sequence[int], count: int) -> dict[int, Need]:
    """Map each indispensable run of a plan of `count` runs to what the plan needs it for."""
    needs: dict[int, Need] = {}
    for i in set(chosen):
        others = list(chosen)
        others.remove(i)
        if np.unique(runs.arc[others]).size < _arcs_wanted(runs, count):
            needs[i] = "arc"
        elif count >= FEWEST_WITH_REPEAT and len(set(others)) == len(others):
            needs[i] = "repetition"
    return needs

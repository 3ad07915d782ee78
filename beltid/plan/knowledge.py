"""Choose runs that minimize the mean variance of ln mu over a target.

Run i of the rig is one observation of the linear model

    y_i = j_i p + s_i e + noise_i,    noise_i ~ N(0, v_i),    e ~ N(0, 1),                   (P1)

with the parameters p of the surface (ln mu at its knots) and the errors e that runs share, in units
of their standard uncertainties, which the surface fit cannot distinguish from friction. So two
factors describe the present knowledge: the covariance Sigma of p by scatter, and the change C of p
by each shared error. New runs (rows J, S, noise V) update both, in any order,

    G = Sigma J' (V + J Sigma J')^-1,  Sigma -> Sigma - G J Sigma,  C -> C + G (S - J C),    (P2)

and the objective is the mean variance over the target with weights W, that of the refined surface:

    u² = tr W (Sigma + C C').                                                                (P3)

Before any run, ln mu at the knots is Gaussian with the roughness of the refined surface
(:mod:`beltid.refine.posterior`) at its usual sizes; the levels and the slope that roughness leaves
free have a broad prior,

    Sigma = s_c² B_c B_c' + s_d² B_d B_d' + K 1 1' + 0.15² x x',                             (P5)

where K, the covariance of the levels of the speeds, has a level common to all, a slope over ln v,
and a bend over ln v (an integrated Wiener process), and x = ln f_N less its mean. Additional knots
of a measured surface follow from its nodes by the same prior: Gaussian with the mean
Sigma_no Sigma_oo^-1 p_o and the covariance that this leaves. New runs are subject to the sources of
error that the surface stores, as stated then, and to those that it does not have.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from beltid.laws.friction_surface import FrictionSurface
from beltid.refine.posterior import BEFORE, CURVE, DIFFERENCE, PRIORS, SPEED_BEND, Curves
from beltid.uncertainty.measured import numbered_arcs
from beltid.uncertainty.sources import (
    ARC,
    SURFACE,
    Source,
    StandardUncertainties,
    SurfaceUncertainty,
    effect_sources,
    stated_sources,
    with_sources,
)

Array = NDArray[np.float64]

TIE = 1.0e-9  # relative difference of two variances that counts as equal; the first candidate wins
ARCS = 3  # fewest arcs of a plan, if the rig has as many and the plan twice as many runs
FEWEST_WITH_REPEAT = 3  # plans with at least so many runs repeat one

Need = Literal["arc", "repetition"]


@dataclass(frozen=True, slots=True)
class RunRows:
    """Runs as rows of the linear model."""

    J: Array  # derivatives of ln mu with respect to the parameters of the surface, (n, size)
    S: Array  # change of measured less simulated ln mu by one u of each shared error, (n, K)
    variance: Array  # of ln mu by the noise of the run, (n,)
    arc: NDArray[np.intp]  # number of the arc setting, (n,)


@dataclass(frozen=True, slots=True)
class Knowledge:
    """Knowledge of the parameters of a surface."""

    scatter: Array  # covariance by scatter, and by what was never measured, (size, size)
    changes: Array  # of the parameters by one u of each shared error, (size, K)

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

    The target has the weights W (size, size). Returns numbers of the candidates, ascending, `count`
    >= 1 of them: at least two arcs (if there are several) and, in three or more runs, one repeated
    run. Deterministic.
    """
    chosen = _completed(before, runs, W, [], count)
    variance = before.after(runs, chosen).variance(W)
    improved = True
    while improved:
        improved = False
        pairs = sorted(set(itertools.combinations(chosen, 2)))
        for dropped in (*((i,) for i in sorted(set(chosen))), *pairs):
            refilled = _completed(before, runs, W, less(chosen, *dropped), count)
            lower = before.after(runs, refilled).variance(W)
            if lower < variance * (1.0 - TIE):
                chosen, variance, improved = refilled, lower, True
                break
    return chosen


def less(chosen: Sequence[int], *dropped: int) -> list[int]:
    """Return the chosen runs with each of the dropped ones listed once less."""
    others = list(chosen)
    for i in dropped:
        others.remove(i)
    return others


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
        others = less(chosen, i)
        if np.unique(runs.arc[others]).size < _arcs_wanted(runs, count):
            needs[i] = "arc"
        elif count >= FEWEST_WITH_REPEAT and len(set(others)) == len(others):
            needs[i] = "repetition"
    return needs


LEVEL: Final = 1.0  # mu of a dry ribbed belt at the middle of the knots [-]: 0.7 to 1.5 is typical
LEVEL_WIDTH: Final = 0.38  # standard deviation of ln mu at that point: half of ln(1.5 / 0.7)
FORCE_SLOPE, FORCE_SLOPE_WIDTH = -0.15, 0.15  # d ln mu / d ln f_N and its standard deviation
SPEED_SLOPE, SPEED_SLOPE_WIDTH = 0.1, 0.15  # d ln mu / d ln v and its standard deviation
SAME_SPEED: Final = 0.1  # largest distance in ln v at which a run belongs to a speed of the surface


def sources_of_plan(
    known: SurfaceUncertainty | None,
    stated: StandardUncertainties,
    arcs_deg: Sequence[float],
    law_scatter: bool,
) -> tuple[Source, ...]:
    """List the shared errors of a known surface, then the additional ones of its candidates.

    These are at arcs [deg]; `law_scatter` says whether the covariance of the contact law is known.
    """
    stored = () if known is None else tuple(known.sources)
    _, arcs = numbered_arcs(arcs_deg, () if known is None else known.arcs_deg)
    size = next((source.size for source in stored if source.error == ARC), BEFORE[ARC].median)
    every = stated_sources(stated, SURFACE, len(arcs), law_scatter=law_scatter)
    return with_sources(stored, (*every, *effect_sources(ARC, size, len(arcs))))


def usual_surface(log_force: Array, log_speed: Array) -> FrictionSurface:
    """Return the mean of the prior, with which runs are simulated before any measurement."""
    x = log_force - log_force.mean()
    z = log_speed - log_speed.mean()
    log_mu = np.log(LEVEL) + FORCE_SLOPE * x[:, None] + SPEED_SLOPE * z
    return FrictionSurface(np.exp(log_force), np.exp(log_speed), np.exp(log_mu))


def prior_covariance(curves: Curves) -> Array:
    """Return the covariance of the knot values before any run (size, size), (P5)."""
    k, m = curves.log_force.size, curves.log_speed.size
    parts = curves.parts
    z = curves.log_speed - curves.log_speed.mean()
    early, late = np.minimum.outer(z, z) - z[0], np.maximum.outer(z, z) - z[0]
    bend = np.square(early) * (3.0 * late - early) / 6.0
    level = LEVEL_WIDTH**2 + SPEED_SLOPE_WIDTH**2 * np.outer(z, z) + SPEED_BEND**2 * bend
    x = np.tile(curves.log_force - curves.log_force.mean(), m)
    covariance = np.kron(level, np.ones((k, k))) + FORCE_SLOPE_WIDTH**2 * np.outer(x, x)
    for part in {CURVE, DIFFERENCE} & set(parts):
        covariance = covariance + PRIORS[part].median ** 2 * parts[part] @ parts[part].T
    return np.asarray(covariance)


def knots_for(low: float, high: float, measured: FrictionSurface | None, count: int) -> Array:
    """Place knots in ln f from a lowest to a highest force [N/m].

    The knots of a measured surface stay; further ones extend it at the spacing of its end nodes.
    """
    if measured is None:
        return np.linspace(np.log(low), np.log(high), count)
    nodes = np.log(measured.normal_force_N_m)
    first, last = nodes[1] - nodes[0], nodes[-1] - nodes[-2]
    below = max(round((nodes[0] - np.log(low)) / first), 0)
    above = max(round((np.log(high) - nodes[-1]) / last), 0)
    lower = nodes[0] - first * np.arange(below, 0, -1)
    return np.concatenate([lower, nodes, nodes[-1] + last * np.arange(1, above + 1)])


def speeds_for(wanted: Array, measured: FrictionSurface | None) -> Array:
    """Return the speeds [m/s] of a plan: those of a measured surface and the new ones."""
    wanted = np.unique(wanted)
    if measured is None:
        return wanted
    existing = measured.slip_speed_m_s
    distance = np.abs(np.log(wanted[:, None] / existing)).min(axis=1)
    return np.union1d(existing, wanted[distance > SAME_SPEED])


def knowledge_at(curves: Curves, measured: SurfaceUncertainty | None, n_errors: int) -> Knowledge:
    """Return the knowledge of ln mu at the knots of a plan, before its runs.

    The nodes of the measured surface, if there is one, are among the knots, and its shared errors
    are the first of all `n_errors`; the others do not affect it.
    """
    prior = prior_covariance(curves)
    changes = np.zeros((prior.shape[0], n_errors))
    if measured is None:
        return Knowledge(prior, changes)
    nf, nv, n_known = measured.changes.shape
    of_force = np.searchsorted(curves.log_force, np.log(measured.surface.normal_force_N_m) - 1.0e-9)
    of_speed = np.searchsorted(curves.log_speed, np.log(measured.surface.slip_speed_m_s) - 1.0e-9)
    nodes = np.add.outer(of_force, of_speed * curves.log_force.size).ravel()
    follows = np.linalg.solve(prior[np.ix_(nodes, nodes)], prior[nodes]).T
    factor = follows @ measured.scatter.reshape(nf * nv, -1)
    changes[:, :n_known] = follows @ measured.changes.reshape(nf * nv, -1)
    return Knowledge(factor @ factor.T + prior - follows @ prior[nodes], changes)

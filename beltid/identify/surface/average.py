"""Average of the curves of several contact arcs on a common grid, with honest standard errors.

Some arcs end before others at low and at high force (Eq. 8). The plain mean over the remaining arcs
would jump there by the difference between arcs, several percent, and the range that all of them
cover would discard a fifth of the measured range of ln f. Beyond its last point, an arc is
therefore continued *parallel* to the mean of the arcs that go on. Only measured arcs count in
``n_arcs``. A continued arc can reach values that were never measured: every node is limited to the
range of the friction coefficients of all runs at its speed (on the virtual benches this moves one
or two nodes of the lowest force, by at most 1.2 %).

Standard error: arcs are a sample of contact lengths. With ``n`` measured arcs

    se² = sum(se_arc²) / n² + t² tau² mu² / n

``tau`` is the relative spread between arcs beyond what the errors of the runs explain, by moments
over all speeds at the same force (the nearest such force where most arcs have ended). An arc may
differ by one factor at all speeds, so two or three arcs determine the spread poorly: Student's t at
a probability of 68 % widens it (1.84 for two arcs, 1.32 for three). The first part acts on nodes of
a speed through the splines; the second on all nodes, as the same arcs are averaged at each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from beltid.identify.surface.curves import Curve, Grid
from beltid.laws.friction_surface import FrictionSurface

Array = NDArray[np.float64]

MIN_NODE_GAP = 0.3  # of the usual gap; noise at closer force nodes causes steep slopes
WORTH_A_NOTE = 5e-3  # relative; smaller changes are comparable to the speed error of motors


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceGrid:
    """Friction surface on its grid, of one arc or averaged; values at the nodes (nf, nv)."""

    arc_deg: float  # contact arc, nan for the average over arcs
    normal_force_N_m: Array  # nodes (nf,)
    slip_speed_m_s: Array  # nodes (nv,)
    mu: Array  # friction coefficient [-]
    mu_se: Array  # standard error of mu, nan where unknown
    n_arcs: NDArray[np.int64]  # number of arcs measured at the node
    mu_spread: Array  # standard deviation of mu between arcs, nan for fewer than two
    scatter: Array  # factor of the covariance of ln mu behind mu_se, (nf, nv, r); 0 where unknown

    def to_surface(self) -> FrictionSurface:
        """Create the continuous surface through the nodes."""
        return FrictionSurface(self.normal_force_N_m, self.slip_speed_m_s, self.mu, self.mu_se)


def average(grid: Grid, errors_known: bool) -> tuple[SurfaceGrid, tuple[str, ...]]:
    """Build the surface through the mean of all arcs of a grid, or through its only arc.

    Parameters
    ----------
    grid : Grid
        Curves of one or several arcs.
    errors_known : bool
        Whether the standard errors of the points are known.

    Returns
    -------
    surface, notes : SurfaceGrid, tuple of str
        The notes name repetitions, arcs that never overlap, and limited nodes.
    """
    nodes, notes = _force_nodes(grid), list(grid.notes)
    mu, filled = (np.array(x).transpose(1, 2, 0) for x in _on_nodes(grid, nodes))
    if np.isnan(filled).any():
        notes.append("some arcs share no force with the others: the average may have a step there")
    unlimited = np.nanmean(filled, axis=0)
    bands = np.array([[curve.band for curve in row] for row in grid.by_speed])
    mean = np.clip(unlimited, bands[..., 0].min(axis=1), bands[..., 1].max(axis=1))
    change = np.abs(mean / unlimited - 1.0)
    if np.any(change > WORTH_A_NOTE):
        notes.append(
            f"{int((change > WORTH_A_NOTE).sum())} of {mean.size} nodes were limited to the values "
            "measured at their speed: extrapolated curves of some arcs would put them up to "
            f"{change.max():.1%} outside"
        )
    n_arcs = np.isfinite(mu).sum(axis=0)
    sd = np.ma.masked_invalid(mu).std(axis=0, ddof=1).filled(np.nan)
    from_runs = [_run_covariance(row, nodes) for row in grid.by_speed]
    own = np.sqrt(np.array([np.diag(C) for C in from_runs]).T)
    between = _between_arcs(own * mean, mean, sd, n_arcs)
    factor = np.zeros((*mean.shape, mean.size + 1))
    for k, C in enumerate(from_runs):
        values, vectors = np.linalg.eigh(C)
        columns = vectors * np.sqrt(np.maximum(values, 0.0))
        factor[:, k, k * nodes.size : (k + 1) * nodes.size] = columns
    factor[..., -1] = between
    known = errors_known or grid.arcs_deg.size > 1
    mu_se = mean * np.hypot(own, between) if known else np.full(mean.shape, np.nan)
    arc_deg = float(grid.arcs_deg[0]) if grid.arcs_deg.size == 1 else float("nan")
    factor = factor[..., np.any(factor, axis=(0, 1))]
    speeds = grid.speeds
    return SurfaceGrid(arc_deg, nodes, speeds, mean, mu_se, n_arcs, sd, factor), tuple(notes)


def _force_nodes(grid: Grid) -> Array:
    """Place force nodes over the range that every speed covers, where the points are [N/m]."""
    first, last = np.log(grid.force)
    if first == last:
        return np.array([grid.force[0]])
    curves = [curve for row in grid.by_speed for curve in row]
    count = max(curve.f.size for curve in curves)
    pooled = np.sort(np.log(np.concatenate([curve.f for curve in curves])))
    centres = np.array([group.mean() for group in np.array_split(pooled, count)])
    gap = MIN_NODE_GAP * float(np.median(np.diff(centres)))
    # the ends of the range replace the outermost centres
    inner = [x for x in centres[1:-1] if first + gap < x < last - gap]
    return np.array([grid.force[0], *np.exp(inner), grid.force[1]])


def _on_nodes(grid: Grid, nodes: Array) -> tuple[list[Array], list[Array]]:
    """Return measured and continued values at the nodes, (na, nf) for each speed."""
    measured, continued = [], []
    for row in grid.by_speed:
        if nodes.size == 1:  # one tension
            measured.append(np.array([curve.mu for curve in row]))
            continued.append(measured[-1])
            continue
        ends = np.concatenate([curve.f[[0, -1]] for curve in row])
        # an arc is continued from its last point
        path = np.union1d(nodes, ends[(ends > nodes[0]) & (ends < nodes[-1])])
        values, on_node = np.array([curve.at(path) for curve in row]), np.searchsorted(path, nodes)
        measured.append(values[:, on_node])
        continued.append(_continue_arcs(values)[:, on_node])
    return measured, continued


def _continue_arcs(values: Array) -> Array:
    """Continue every arc of one speed (na, n) parallel to the arcs that go on."""
    filled = values.copy()
    count = np.isfinite(values).sum(axis=0)
    best = np.flatnonzero(count == count.max())
    core = int(best[best.size // 2])
    for path in (range(core, values.shape[1]), range(core, -1, -1)):
        for inner, node in pairwise(path):
            at_inner, at_node = np.isfinite(filled[:, inner]), np.isfinite(filled[:, node])
            going_on, ending = at_inner & at_node, at_inner & ~at_node
            if going_on.any():
                growth = filled[going_on, node].mean() / filled[going_on, inner].mean()
                filled[ending, node] = filled[ending, inner] * growth
    return filled


def _run_covariance(curves: Sequence[Curve], nodes: Array) -> Array:
    """Return the covariance of ln mu by the errors of the runs, mean of the arcs measured there."""
    there = np.array([curve.covers(nodes) for curve in curves]) | (nodes.size == 1)
    n = np.maximum(there.sum(axis=0), 1)
    parts = [
        curve.covariance(nodes) * np.outer(mine, mine)
        for curve, mine in zip(curves, there, strict=True)
    ]
    return np.asarray(np.sum(parts, axis=0) / np.outer(n, n))


def _between_arcs(own: Array, mean: Array, sd: Array, n_arcs: NDArray[np.int64]) -> Array:
    """Compute the relative standard error by the spread between arcs, (nf, nv)."""
    freedom = n_arcs - 1
    if not freedom.any():
        return np.zeros(mean.shape)
    excess = np.where(freedom > 0, (sd**2 - n_arcs * own**2) / mean**2, 0.0)
    per_force = freedom.sum(axis=1)
    # where most arcs have ended, the spread is poorly determined: use the nearest other force
    rows = np.flatnonzero(2 * per_force >= per_force.max())
    tau2 = np.maximum((freedom * excess).sum(axis=1)[rows] / per_force[rows], 0.0)
    tau2 *= float(stdtrit(freedom.max(), ndtr(1.0))) ** 2
    nearest = [int(np.argmin(np.abs(rows - i))) for i in range(mean.shape[0])]
    return np.asarray(np.sqrt(tau2[nearest][:, None] / n_arcs))

"""Average of the curves of several contact arcs on a common grid, with honest standard errors.

Range of forces
---------------
A node needs a value at every speed, so some arc must cover its force at each speed. A few aborted
runs should not reduce the range of the others, though: if a speed ends long before most others, its
nearest value is used up to where they end. A speed that would leave no common range is left out.
The notes name both.

Where an arc ends
-----------------
Some arcs end before others at low and at high force (Eq. 8). The plain mean over the remaining arcs
would jump there by the difference between arcs, several percent, and the common range alone would
discard a fifth of the measured range of ln f. Beyond its last point, an arc is therefore continued
*parallel* to the mean of the arcs that go on. Only measured arcs count in ``n_arcs``.

A continued arc can reach values that were never measured. Every node is therefore limited to the
range of the friction coefficients of all runs at its speed: on the virtual benches this moves one
or two nodes of the lowest force, by at most 1.2 %.

Where a speed ends
------------------
A speed without runs at one end of the range, where some were aborted, keeps its nearest value there
(``n_arcs`` 0). The change of the other speeds over that stretch goes into the standard error.

Standard error
--------------
Random effects: arcs are a sample of contact lengths. With ``n`` measured arcs

    se² = sum(se_arc²) / n² + t² tau² mu² / n

``tau`` is the relative spread between arcs beyond what the errors of the runs explain, estimated by
moments over all speeds at the same force (the nearest such force where most arcs have ended). An
arc may differ by one factor at all speeds, so two or three arcs determine the spread poorly:
Student's t at a probability of 68 % widens it (1.84 for two arcs, 1.32 for three).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from beltid.errors import InputError
from beltid.identify.surface.curves import ONE_TENSION, CurveSet
from beltid.laws.friction_surface import FrictionSurface

Array = NDArray[np.float64]

MIN_RANGE = 0.02  # relative; a shorter range of forces does not count
NARROWED = 0.25  # ln f; a speed that ends earlier than most others by more keeps its last value
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

    def to_surface(self) -> FrictionSurface:
        """Create the continuous surface through the nodes."""
        return FrictionSurface(self.normal_force_N_m, self.slip_speed_m_s, self.mu, self.mu_se)


def average(curves: CurveSet, errors_known: bool) -> tuple[SurfaceGrid, tuple[str, ...]]:
    """Build the surface through the mean of all arcs of a set, or through its only arc.

    Parameters
    ----------
    curves : CurveSet
        Curves of one or several arcs.
    errors_known : bool
        Whether the standard errors of the points are known.

    Returns
    -------
    grid, notes : SurfaceGrid, tuple of str
        The notes name speeds left out, ranges cut, arcs that never overlap, and limited nodes.

    Raises
    ------
    InputError
        If no speed has a range of forces.
    """
    curves, notes = with_common_range(curves)
    nodes = _force_nodes(curves)
    mu, se, filled = _on_nodes(curves, nodes)
    complete = np.all(np.isfinite(filled).any(axis=0), axis=1)
    nodes, mu = nodes[complete], mu[:, complete]
    se, filled = se[:, complete], filled[:, complete]
    separate = [
        f"{arc:g}°" for arc, m in zip(curves.arcs_deg, filled, strict=True) if np.isnan(m).any()
    ]
    if separate:
        notes.append(
            f"arcs {', '.join(separate)} share no force with the others at some nodes: "
            "the average may have a step there"
        )
    unlimited = np.nanmean(filled, axis=0)
    bands = [np.array([c.band for c in at_speed]) for at_speed in curves.by_speed]
    mean = np.clip(unlimited, [b.min() for b in bands], [b.max() for b in bands])
    change = np.abs(mean / unlimited - 1.0)
    if np.any(change > WORTH_A_NOTE):
        notes.append(
            f"{int((change > WORTH_A_NOTE).sum())} of {mean.size} nodes were limited to the values "
            "measured at their speed: extrapolated curves of some arcs would put them up to "
            f"{change.max():.1%} outside"
        )
    n_arcs = np.isfinite(mu).sum(axis=0)
    sd = np.ma.masked_invalid(mu).std(axis=0, ddof=1).filled(np.nan)
    mu_se = _standard_error(mean, se, sd, n_arcs, errors_known)
    arc_deg = float(curves.arcs_deg[0]) if curves.arcs_deg.size == 1 else float("nan")
    grid = SurfaceGrid(arc_deg, nodes, curves.speeds, mean, mu_se, n_arcs, sd)
    return grid, tuple(notes)


def _force_nodes(curves: CurveSet) -> Array:
    """Place force nodes over the range that every speed covers, where the points are [N/m]."""
    common = common_range(curves)
    if common is None:
        return np.array([np.exp(np.mean([np.log(c.f[0]) for c in curves.curves]))])
    first, last = np.log(common)
    count = max(c.f.size for c in curves.curves)
    pooled = np.sort(np.log(np.concatenate([c.f for c in curves.curves])))
    centres = np.array([group.mean() for group in np.array_split(pooled, count)])
    gap = MIN_NODE_GAP * float(np.median(np.diff(centres)))
    # the ends of the range replace the outermost centres
    inner = [x for x in centres[1:-1] if first + gap < x < last - gap]
    return np.array([common[0], *np.exp(inner), common[1]])


def _on_nodes(curves: CurveSet, nodes: Array) -> tuple[Array, Array, Array]:
    """Return measured values, standard errors and continued values at the nodes, (na, nf, nv).

    The first two are nan where an arc was not measured; the last is nan only where no other arc
    shows how the arc would continue.
    """
    shape = (curves.arcs_deg.size, nodes.size, curves.speeds.size)
    mu, se, filled = (np.full(shape, np.nan) for _ in range(3))
    for k, group in enumerate(curves.by_speed):
        rows = np.searchsorted(curves.arcs_deg, [c.arc_deg for c in group])
        ends = np.concatenate([c.f[[0, -1]] for c in group])
        # an arc is continued from its last point
        path = np.union1d(nodes, ends[(ends > nodes[0]) & (ends < nodes[-1])])
        values, errors = np.array([c.at(path) for c in group]).transpose(1, 0, 2)
        on_node = np.searchsorted(path, nodes)
        mu[rows, :, k], se[rows, :, k] = values[:, on_node], errors[:, on_node]
        continued = _continue_arcs(values)
        measured = np.flatnonzero(np.isfinite(continued).any(axis=0))  # end values apply beyond
        filled[rows, :, k] = continued[:, np.clip(on_node, measured[0], measured[-1])]
    for a, node, k in np.argwhere(np.isnan(filled)):
        filled[a, node, k] = _by_proportion(filled, a, node, k, np.log(curves.speeds))
    return mu, se, filled


def _continue_arcs(values: Array) -> Array:
    """Continue every arc of one speed (na, n) parallel to the arcs that go on.

    Starts at the force with most arcs and proceeds outwards; values remain nan where two
    neighbouring forces have no arc in common.
    """
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


def _by_proportion(filled: Array, a: int, node: int, k: int, log_speed: Array) -> float:
    """Estimate an arc at a speed at which it was not run; nan if no other speed allows it.

    The ratio of the arc to the others is interpolated from the neighbouring speeds.
    """
    row = filled[:, node, :]
    others = np.isfinite(row[:, k])
    others[a] = False
    usable = np.isfinite(row[a]) & np.isfinite(row[others]).all(axis=0)
    if not others.any() or not usable.any():
        return float("nan")
    proportion = row[a, usable] / row[others][:, usable].mean(axis=0)
    return float(np.interp(log_speed[k], log_speed[usable], proportion) * row[others, k].mean())


def _standard_error(
    mean: Array, se: Array, sd: Array, n_arcs: NDArray[np.int64], errors_known: bool
) -> Array:
    """Compute the standard error of the average by the formulas of the module, (nf, nv)."""
    n = np.maximum(n_arcs, 1)
    from_runs = np.nansum(se**2, axis=0)
    freedom = n - 1
    if freedom.any():
        excess = np.where(freedom > 0, (sd**2 - from_runs / n) / mean**2, 0.0)
        per_force = freedom.sum(axis=1)
        # where most arcs have ended, the spread is poorly determined: use the nearest other force
        rows = np.flatnonzero(2 * per_force >= per_force.max())
        tau2 = np.maximum((freedom * excess).sum(axis=1)[rows] / per_force[rows], 0.0)
        tau2 *= float(stdtrit(freedom.max(), ndtr(1.0))) ** 2
        nearest = [int(np.argmin(np.abs(rows - i))) for i in range(mean.shape[0])]
        mu_se = np.sqrt(from_runs / n**2 + tau2[nearest][:, None] * mean**2 / n)
    else:
        mu_se = np.sqrt(from_runs) / n if errors_known else np.full(mean.shape, np.nan)
    for i, k in np.argwhere(n_arcs == 0):  # extended value: add the change of the other speeds
        measured = np.flatnonzero(n_arcs[:, k])
        if measured.size == 0:
            continue
        at = measured[np.argmin(np.abs(measured - i))]
        others = (n_arcs[i] > 0) & (n_arcs[at] > 0)
        change = np.abs(mean[i, others] / mean[at, others] - 1.0).mean() if others.any() else 0.0
        mu_se[i, k] = mean[i, k] * np.hypot(mu_se[at, k] / mean[at, k], change)
    return mu_se


def _ranges(curves: CurveSet) -> tuple[Array, Array]:
    """Return the lowest and highest force of any arc at each speed [N/m], each (nv,)."""
    forces = [np.concatenate([c.f for c in at_speed]) for at_speed in curves.by_speed]
    return np.array([f.min() for f in forces]), np.array([f.max() for f in forces])


def _covered(curves: CurveSet) -> tuple[Array, NDArray[np.bool_]]:
    """Return the ends of all curves (m + 1,) and which speeds cover the intervals (nv, m)."""
    ends = np.unique([c.f[[0, -1]] for c in curves.curves])
    middles = 0.5 * (ends[:-1] + ends[1:])
    covered = [np.any([c.covers(middles) for c in group], axis=0) for group in curves.by_speed]
    return ends, np.array(covered)


def common_range(curves: CurveSet) -> tuple[float, float] | None:
    """Find the first and last force of the surface [N/m]; None without a common range.

    Some arc covers both at every speed, except at speeds that end long before most others.
    """
    ends, covered = _covered(curves)
    everywhere = np.flatnonzero(covered.all(axis=0))
    if everywhere.size == 0:
        return None
    first, last = float(ends[everywhere[0]]), float(ends[everywhere[-1] + 1])
    if not last > first * (1.0 + MIN_RANGE):
        return None
    low, high = _ranges(curves)
    return (
        min(first, float(low[~_ends_early(np.log(low))].max())),
        max(last, float(high[~_ends_early(-np.log(high))].min())),
    )


def _ends_early(edge: Array) -> NDArray[np.bool_]:
    """Mark speeds with an edge (nv,) [ln f, increasing inwards] far inside that of most speeds."""
    ordered = np.sort(edge)
    most = edge.size // 2  # more than half of the speeds extend at least to this edge
    gaps = np.flatnonzero(np.diff(ordered[most:]) > NARROWED)
    if gaps.size == 0:
        return np.zeros(edge.shape, dtype=bool)
    return edge > ordered[most + gaps[0]]


def with_common_range(curves: CurveSet) -> tuple[CurveSet, list[str]]:
    """Select the largest set of speeds with a common range of forces; list what was left out."""
    forces = np.concatenate([c.f for c in curves.curves])
    if forces.size == len(curves.curves) and forces.max() < ONE_TENSION * forces.min():
        # one tension at all arcs and speeds: the surface depends on speed only
        f = np.exp([np.mean(np.log(forces))])
        return curves.with_curves(replace(c, f=f) for c in curves.curves), []
    _, covered = _covered(curves)
    candidates = np.unique(covered.T, axis=0)  # a row of speeds for every interval of the force
    best, extent = curves, (0, 0.0)
    for row in candidates[candidates.any(axis=1)]:
        speeds = curves.speeds[row]
        subset = curves.with_curves(c for c in curves.curves if c.speed in speeds)
        common = common_range(subset)
        if common and (speeds.size, common[1] / common[0]) > extent:
            best, extent = subset, (speeds.size, common[1] / common[0])
    if extent[0] == 0:
        raise InputError(
            "no speed was measured over a range of normal forces, must be at least two tensions "
            "at one arc and speed, or one tension at all of them"
        )
    low, high = _ranges(curves)
    notes = [
        f"speed {speed:.4g} m/s left out: measured from {low[k]:.0f} to {high[k]:.0f} N/m, no "
        "range in common with the other speeds"
        for k, speed in enumerate(curves.speeds)
        if speed not in best.speeds
    ]
    low, high = _ranges(best)
    notes += [
        f"speed {best.speeds[k]:.4g} m/s: measured {word} {edge[k]:.0f} N/m only, its value "
        "there is used where the other speeds continue"
        for word, edge, inwards in (("from", low, np.log(low)), ("up to", high, -np.log(high)))
        for k in np.flatnonzero(_ends_early(inwards))
    ]
    return best, notes

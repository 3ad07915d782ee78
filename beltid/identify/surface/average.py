"""Average of the curves of several contact arcs on a common grid, with honest standard errors.

Which forces
------------
A node needs a value at every speed, so its force must be covered by some arc at each of them. A few
broken runs must not cost the others their range, though: where a speed ends long before most others
do, its nearest value is held up to where they end. A speed that would leave no range at all is left
out. Both are named.

Where an arc ends
-----------------
Some arcs end before others at low and at high force (Eq. 8). The plain mean over the arcs that are
left would jump there by the difference between arcs, several percent, and the common range alone
would throw away a fifth of the measured range of ln f. So beyond its last point an arc is carried
on *parallel* to the mean of the arcs that go on. Only arcs that were measured count in ``n_arcs``.

Carried on, an arc can reach values that nobody has measured. So every node is held within the
lowest and the highest friction coefficient of all runs at its speed: on the virtual benches that
moves one or two nodes of the lowest force, by at most 1.2 %.

Where a speed ends
------------------
A speed that lacks runs at one end of the range, as some broke off, has its nearest value held
there (``n_arcs`` 0). What the other speeds change over that stretch goes into the standard error.

Standard error
--------------
Random effects: arcs are a sample of contact lengths. With ``n`` measured arcs

    se² = sum(se_arc²) / n² + t² tau² mu² / n

``tau`` is the relative spread between arcs beyond what the errors of the runs explain, by moments
over all speeds at the same force (the nearest such force where most arcs have ended). An arc may
differ by one factor at all speeds, so that two or three arcs hardly tell their spread: Student's t
at a probability of 68 % widens it (1.84 for two arcs, 1.32 for three).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from beltid.errors import InputError
from beltid.identify.surface.curves import ONE_TENSION, CurveSet
from beltid.laws.friction_surface import FrictionSurface

Array = NDArray[np.float64]

MIN_RANGE = 0.02  # relative; a shorter range of forces is none
NARROWED = 0.25  # ln f; a speed that ends earlier than most others by more is held
MIN_NODE_GAP = 0.3  # of the usual one; closer nodes of the force make steep slopes out of noise
WORTH_A_NOTE = 5e-3  # relative; nodes moved by less are within what motors miss their speed by


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceGrid:
    """Friction surface on its grid, of one arc or averaged; values at the nodes (nf, nv)."""

    arc_deg: float  # contact arc, nan for the average over arcs
    normal_force_N_m: Array  # nodes (nf,)
    slip_speed_m_s: Array  # nodes (nv,)
    mu: Array  # friction coefficient [-]
    mu_se: Array  # and its standard error, nan where unknown
    n_arcs: NDArray[np.int64]  # arcs measured at the node
    mu_spread: Array  # standard deviation of mu between them, nan for fewer than two

    def to_surface(self) -> FrictionSurface:
        """Continuous surface through the nodes."""
        return FrictionSurface(self.normal_force_N_m, self.slip_speed_m_s, self.mu, self.mu_se)


def average(
    curves: CurveSet, force_nodes: int | None, errors_known: bool
) -> tuple[SurfaceGrid, tuple[str, ...]]:
    """Surface through the mean of all arcs of a set (of one arc: its own surface).

    Parameters
    ----------
    curves : CurveSet
        Curves of one or several arcs.
    force_nodes : int or None
        Number of force nodes, evenly spaced in ln f; None puts as many as the fullest curve
        has points, where the points are.
    errors_known : bool
        Whether the standard errors of the points mean something.

    Returns
    -------
    grid, notes : SurfaceGrid, tuple of str
        Speeds left out, ranges cut, arcs that never overlap, nodes held are noted.

    Raises
    ------
    InputError
        If no speed has a range of forces.
    """
    curves, notes = with_common_range(curves)
    nodes = _force_nodes(curves, force_nodes)
    mu, se, filled = _on_nodes(curves, nodes)
    held = np.all(np.isfinite(filled).any(axis=0), axis=1)
    nodes, mu, se, filled = nodes[held], mu[:, held], se[:, held], filled[:, held]
    never = [
        f"{arc:g}°" for arc, m in zip(curves.arcs_deg, filled, strict=True) if np.isnan(m).any()
    ]
    if never:
        notes.append(
            f"arcs {', '.join(never)} share no force with the others at some nodes: "
            "the average may have a step there"
        )
    free = np.nanmean(filled, axis=0)
    bands = [[c.band for c in curves.curves if c.speed == k] for k in range(curves.speeds.size)]
    low, high = np.array([(min(b)[0], max(x[1] for x in b)) for b in bands]).T
    mean = np.clip(free, low, high)
    change = np.abs(mean / free - 1.0)
    if np.any(change > WORTH_A_NOTE):
        notes.append(
            f"{int((change > WORTH_A_NOTE).sum())} of {mean.size} nodes held within the values "
            "measured at their speed: arcs carried on beyond their last run would have put them "
            f"up to {change.max():.1%} outside"
        )
    n_arcs = np.isfinite(mu).sum(axis=0)
    squares = np.nansum((mu - np.nansum(mu, axis=0) / np.maximum(n_arcs, 1)) ** 2, axis=0)
    sd = np.where(n_arcs >= 2, np.sqrt(squares / np.maximum(n_arcs - 1, 1)), np.nan)
    mu_se = _standard_error(mean, se, sd, n_arcs, errors_known)
    arc_deg = float(curves.arcs_deg[0]) if curves.arcs_deg.size == 1 else float("nan")
    grid = SurfaceGrid(arc_deg, nodes, curves.speeds, mean, mu_se, n_arcs, sd)
    return grid, tuple(notes)


def _force_nodes(curves: CurveSet, count: int | None) -> Array:
    """Nodes of the force over the range that every speed covers [N/m]."""
    common = common_range(curves)
    if common is None:
        return np.array([np.exp(np.mean([np.log(c.f[0]) for c in curves.curves]))])
    first, last = np.log(common)
    if count is not None:
        return np.geomspace(*common, count)
    fullest = max(c.f.size for c in curves.curves)
    pooled = np.sort(np.log(np.concatenate([c.f for c in curves.curves])))
    centres = np.array([group.mean() for group in np.array_split(pooled, fullest)])
    gap = MIN_NODE_GAP * float(np.median(np.diff(centres)))
    # the ends of the range take the place of the outermost centres
    inner = [x for x in centres[1:-1] if first + gap < x < last - gap]
    return np.array([common[0], *np.exp(inner), common[1]])


def _on_nodes(curves: CurveSet, nodes: Array) -> tuple[Array, Array, Array]:
    """Measured values, standard errors, and values carried on at the nodes, each (na, nf, nv).

    The first two are nan where an arc was not measured; the last only where nothing tells how the
    arc would go on.
    """
    shape = (curves.arcs_deg.size, nodes.size, curves.speeds.size)
    mu, se, filled = (np.full(shape, np.nan) for _ in range(3))
    arcs = list(curves.arcs_deg)
    for k in range(curves.speeds.size):
        group = [c for c in curves.curves if c.speed == k]
        rows = [arcs.index(c.arc_deg) for c in group]
        if nodes.size == 1:  # a single tension: the points stand side by side as they are
            at = [c.at(np.clip(nodes, c.f[0], c.f[-1])) for c in group]
            mu[rows, :, k], se[rows, :, k] = np.array(at).transpose(1, 0, 2)
            filled[rows, :, k] = mu[rows, :, k]
            continue
        ends = np.concatenate([c.f[[0, -1]] for c in group])
        ends = ends[(ends > nodes[0]) & (ends < nodes[-1])]
        path = np.union1d(nodes, ends)  # an arc is carried on from its last point
        values, errors = np.array([c.at(path) for c in group]).transpose(1, 0, 2)
        on_node = np.searchsorted(path, nodes)
        mu[rows, :, k], se[rows, :, k] = values[:, on_node], errors[:, on_node]
        going_on = _carried_on(values)
        measured = np.flatnonzero(np.isfinite(going_on).any(axis=0))  # ends are held beyond
        filled[rows, :, k] = going_on[:, np.clip(on_node, measured[0], measured[-1])]
    for a, node, k in np.argwhere(np.isnan(filled)):
        filled[a, node, k] = _by_proportion(filled, a, node, k, np.log(curves.speeds))
    return mu, se, filled


def _carried_on(values: Array) -> Array:
    """Values of one speed (na, n) with every arc carried on parallel to those that go on.

    From the force with most arcs outwards; where no arc is common to two neighbours, nan is left.
    """
    filled = values.copy()
    count = np.isfinite(values).sum(axis=0)
    best = np.flatnonzero(count == count.max())
    core = int(best[best.size // 2])
    for path in (range(core, values.shape[1]), range(core, -1, -1)):
        for inner, node in pairwise(path):
            known, goes_on = np.isfinite(filled[:, inner]), np.isfinite(filled[:, node])
            both, ends = known & goes_on, known & ~goes_on
            if both.any():
                growth = filled[both, node].mean() / filled[both, inner].mean()
                filled[ends, node] = filled[ends, inner] * growth
    return filled


def _by_proportion(filled: Array, a: int, node: int, k: int, log_speed: Array) -> float:
    """Value of an arc at a speed it was never run at, nan if no other speed tells.

    The arc follows the others in the proportion that it has to them at the neighbouring speeds.
    """
    row = filled[:, node, :]
    others = np.isfinite(row[:, k])
    others[a] = False
    known = np.isfinite(row[a]) & np.isfinite(row[others]).all(axis=0)
    if not others.any() or not known.any():
        return float("nan")
    proportion = row[a, known] / row[others][:, known].mean(axis=0)
    return float(np.interp(log_speed[k], log_speed[known], proportion) * row[others, k].mean())


def _standard_error(
    mean: Array, se: Array, sd: Array, n_arcs: NDArray[np.int64], errors_known: bool
) -> Array:
    """Standard error of the average by the formulas of the module, (nf, nv)."""
    n = np.maximum(n_arcs, 1)
    from_runs = np.nansum(se**2, axis=0)
    freedom = n - 1
    if freedom.any():
        excess = np.where(freedom > 0, (sd**2 - from_runs / n) / mean**2, 0.0)
        per_force = freedom.sum(axis=1)
        # a force where most arcs have ended says little of their spread: its neighbour knows more
        rows = np.flatnonzero(2 * per_force >= per_force.max())
        tau2 = np.maximum((freedom * excess).sum(axis=1)[rows] / per_force[rows], 0.0)
        tau2 *= float(stdtrit(freedom.max(), ndtr(1.0))) ** 2
        nearest = [int(np.argmin(np.abs(rows - i))) for i in range(mean.shape[0])]
        mu_se = np.sqrt(from_runs / n**2 + tau2[nearest][:, None] * mean**2 / n)
    else:
        mu_se = np.sqrt(from_runs) / n if errors_known else np.full(mean.shape, np.nan)
    for i, k in np.argwhere(n_arcs == 0):  # held: with what the other speeds change
        measured = np.flatnonzero(n_arcs[:, k])
        if measured.size == 0:
            continue
        at = measured[np.argmin(np.abs(measured - i))]
        others = (n_arcs[i] > 0) & (n_arcs[at] > 0)
        change = np.abs(mean[i, others] / mean[at, others] - 1.0).mean() if others.any() else 0.0
        mu_se[i, k] = mean[i, k] * np.hypot(mu_se[at, k] / mean[at, k], change)
    return mu_se


def _ranges(curves: CurveSet) -> tuple[Array, Array]:
    """Lowest and highest force measured at each speed by any arc [N/m], each (nv,)."""
    low = np.full(curves.speeds.size, np.inf)
    high = np.full(curves.speeds.size, -np.inf)
    for c in curves.curves:
        low[c.speed] = min(low[c.speed], c.f[0])
        high[c.speed] = max(high[c.speed], c.f[-1])
    return low, high


def _covered(curves: CurveSet) -> tuple[Array, NDArray[np.bool_]]:
    """Ends of all curves (m + 1,) and whether a speed covers the stretch between two (nv, m)."""
    ends = np.unique([c.f[[0, -1]] for c in curves.curves])
    covered = np.zeros((curves.speeds.size, ends.size - 1), dtype=bool)
    for c in curves.curves:
        covered[c.speed] |= c.covers(0.5 * (ends[:-1] + ends[1:]))
    return ends, covered


def common_range(curves: CurveSet) -> tuple[float, float] | None:
    """First and last force of the surface [N/m], None if there is none.

    Some arc covers both at every speed, but for speeds that end long before most others do.
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
    """Speeds whose edge (nv,), growing inwards [ln f], lies beyond a gap past that of most."""
    ordered = np.sort(edge)
    most = edge.size // 2  # more than half of the speeds go on at least to this edge
    gaps = np.flatnonzero(np.diff(ordered[most:]) > NARROWED)
    if gaps.size == 0:
        return np.zeros(edge.shape, dtype=bool)
    return edge > ordered[most + gaps[0]]


def with_common_range(curves: CurveSet) -> tuple[CurveSet, list[str]]:
    """The most speeds that have a range of forces in common, and what had to be left out."""
    forces = np.concatenate([c.f for c in curves.curves])
    if forces.size == len(curves.curves) and forces.max() < ONE_TENSION * forces.min():
        return curves, []  # one tension at all arcs and speeds: a surface over the speed only
    _, covered = _covered(curves)
    candidates = np.unique(covered.T, axis=0)  # a row of speeds for every stretch of the force
    best, extent = curves, (0, 0.0)
    for speeds in candidates[candidates.any(axis=1)]:
        subset = curves.with_curves(c for c in curves.curves if speeds[c.speed])
        common = common_range(subset)
        if common and (int(speeds.sum()), common[1] / common[0]) > extent:
            best, extent = subset, (int(speeds.sum()), common[1] / common[0])
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
        "there is held where the other speeds go on"
        for word, edge, inwards in (("from", low, np.log(low)), ("up to", high, -np.log(high)))
        for k in np.flatnonzero(_ends_early(inwards))
    ]
    return best, notes

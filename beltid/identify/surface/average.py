"""Average of the curves of several contact arcs on a common grid, with honest standard errors.

Where an arc ends
-----------------
Long arcs lose part of their tension range to the steep decay of Eq. (8), so at low and at high
force some arcs end before others. The plain mean over the arcs that are left would jump there by
the difference between arcs (several percent on short arcs, where bending falsifies Eqs. 6 and 8
most), and the common range alone would throw away a fifth of the measured range of ln f. So beyond
its last point an arc is carried on *parallel* to the mean of the arcs that go on: the average
takes over their slope without a jump. Only arcs that were measured count in ``n_arcs``.

Carried on beyond its own range, an arc can reach values that nobody has measured. So every node
is held within the lowest and the highest friction coefficient of all runs at its speed: the
surface never leaves the measured band. It costs little: on the virtual benches the bound moves the
one or two nodes of the lowest force, by at most 1.2 %; nodes that all arcs cover lie well within.

Where a speed ends
------------------
A speed that lacks runs at one end of the range, as some broke off, has its nearest value held
there (``n_arcs`` 0). What the other speeds change over that stretch goes into the standard error.

Standard error
--------------
Random effects: arcs are a sample of contact lengths. With ``n`` measured arcs

    se² = sum(se_arc²) / n² + tau² mu² / n

``tau`` is the relative spread between arcs beyond what the errors of the runs explain, by moments
over all speeds at the same force (the nearest such force where most arcs have ended).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from beltid.identify.surface.curves import CurveSet
from beltid.identify.surface.range import common_range, with_common_range
from beltid.laws.friction_surface import FrictionSurface

Array = NDArray[np.float64]

MIN_NODE_GAP = 0.3  # of the usual one; closer nodes of the force make steep slopes out of noise
WORTH_A_NOTE = 5e-3  # relative; nodes moved by less are within what motors miss their speed by


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceGrid:
    """Friction surface on its grid, of one arc or averaged.

    Attributes
    ----------
    arc_deg : float
        Contact arc [deg], nan for the average over arcs.
    normal_force_N_m : ndarray (nf,)
        Nodes of the normal force per length [N/m].
    slip_speed_m_s : ndarray (nv,)
        Nodes of the sliding speed [m/s].
    mu, mu_se : ndarray (nf, nv)
        Friction coefficient and standard error [-]; an unknown error is nan.
    n_arcs : ndarray of int (nf, nv)
        Number of arcs measured at the node.
    mu_spread : ndarray (nf, nv)
        Standard deviation of mu between those arcs [-], nan for fewer than two.
    """

    arc_deg: float
    normal_force_N_m: Array
    slip_speed_m_s: Array
    mu: Array
    mu_se: Array
    n_arcs: NDArray[np.int64]
    mu_spread: Array

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
    grid : SurfaceGrid
        Its values lie within the band of the runs at each speed.
    notes : tuple of str
        Speeds left out, ranges cut, arcs that never overlap, nodes held within the band.

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
    mean, held_notes = _held_in_band(np.nanmean(filled, axis=0), curves)
    notes += held_notes
    n_arcs = np.isfinite(mu).sum(axis=0)
    sd = _spread(mu, n_arcs)
    mu_se = _standard_error(mean, se, sd, n_arcs, errors_known)
    grid = SurfaceGrid(
        arc_deg=float(curves.arcs_deg[0]) if curves.arcs_deg.size == 1 else float("nan"),
        normal_force_N_m=nodes,
        slip_speed_m_s=curves.speeds,
        mu=mean,
        mu_se=_with_uncertainty_of_held(mu_se, mean, n_arcs),
        n_arcs=n_arcs,
        mu_spread=sd,
    )
    return grid, tuple(notes)


def _held_in_band(mean: Array, curves: CurveSet) -> tuple[Array, list[str]]:
    """Node values (nf, nv) within the band of the runs at each speed, and what that changed."""
    low = np.full(curves.speeds.size, np.inf)
    high = np.zeros(curves.speeds.size)
    for c in curves.curves:
        low[c.speed] = min(low[c.speed], c.band[0])
        high[c.speed] = max(high[c.speed], c.band[1])
    held = np.clip(mean, low, high)
    change = np.abs(held / mean - 1.0)
    moved = change > WORTH_A_NOTE
    if not moved.any():
        return held, []
    return held, [
        f"{int(moved.sum())} of {mean.size} nodes held within the values measured at their speed: "
        f"arcs carried on beyond their last run would have put them up to {change.max():.1%} "
        "outside"
    ]


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
    """Measured values, their standard errors, and values carried on, at the nodes.

    Each (na, nf, nv). The first two are nan where an arc was not measured; the last only where
    nothing tells how the arc would go on.
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
        filled[rows, :, k] = _held_beyond_ends(_carried_on(values))[:, on_node]
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


def _held_beyond_ends(values: Array) -> Array:
    """Values of one speed (na, n) with those at its ends held where no arc was measured."""
    measured = np.flatnonzero(np.isfinite(values).any(axis=0))
    held = values.copy()
    held[:, : measured[0]] = values[:, [measured[0]]]
    held[:, measured[-1] + 1 :] = values[:, [measured[-1]]]
    return held


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


def _spread(mu: Array, n_arcs: NDArray[np.int64]) -> Array:
    """Standard deviation over the measured arcs, nan for fewer than two."""
    several = n_arcs >= 2
    mean = np.nansum(mu, axis=0) / np.maximum(n_arcs, 1)
    squares = np.nansum((mu - mean) ** 2, axis=0)
    return np.where(several, np.sqrt(squares / np.maximum(n_arcs - 1, 1)), np.nan)


def _standard_error(
    mean: Array, se: Array, sd: Array, n_arcs: NDArray[np.int64], errors_known: bool
) -> Array:
    """Standard error of the average by the random-effects formula of the module."""
    n = np.maximum(n_arcs, 1)
    from_runs = np.nansum(se**2, axis=0)
    freedom = n - 1
    if not freedom.any():
        return np.sqrt(from_runs) / n if errors_known else np.full(mean.shape, np.nan)
    excess = np.where(freedom > 0, (sd**2 - from_runs / n) / mean**2, 0.0)
    per_force = freedom.sum(axis=1)
    # a force where most arcs have ended says little about their spread: its neighbour knows more
    rows = np.flatnonzero(2 * per_force >= per_force.max())
    tau2 = np.maximum((freedom * excess).sum(axis=1)[rows] / per_force[rows], 0.0)
    nearest = [int(np.argmin(np.abs(rows - i))) for i in range(mean.shape[0])]
    return np.sqrt(from_runs / n**2 + tau2[nearest][:, None] * mean**2 / n)


def _with_uncertainty_of_held(mu_se: Array, mu: Array, n_arcs: NDArray[np.int64]) -> Array:
    """Standard errors (nf, nv), with what the other speeds change where the value is held."""
    widened = mu_se.copy()
    for i, k in np.argwhere(n_arcs == 0):
        measured = np.flatnonzero(n_arcs[:, k])
        if measured.size == 0:
            continue
        nearest = measured[np.argmin(np.abs(measured - i))]
        others = (n_arcs[i] > 0) & (n_arcs[nearest] > 0)
        change = np.abs(mu[i, others] / mu[nearest, others] - 1.0).mean() if others.any() else 0.0
        widened[i, k] = mu[i, k] * np.hypot(mu_se[nearest, k] / mu[nearest, k], change)
    return widened

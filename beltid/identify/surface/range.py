"""Range of normal forces that the curves of several arcs and speeds have in common.

A node of the averaged surface needs a value at every speed, so its force must be covered by some
arc at each of them. A few broken runs must not cost the others their range, though: where a speed
ends long before most others do, its nearest value is held up to where they end, and it is named.
A speed that would leave no range at all is left out and named.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError
from beltid.identify.surface.curves import ONE_TENSION, CurveSet

Array = NDArray[np.float64]

MIN_RANGE = 0.02  # relative; a shorter range of forces is none
NARROWED = 0.25  # ln f; a speed that ends earlier than most others by more is held


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

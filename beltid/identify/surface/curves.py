"""Measured points of the friction rig as curves mu(f_N), one per contact arc and speed setting.

The normal force of a run is a result (the mean of Eq. 8), not a setting, so the points of a
campaign are scattered in f_N. The settings are arc, tension and speed: the points of one arc and
one speed lie on a curve over f_N. A campaign is a grid if each arc was measured at each speed, and
some arc covers the same forces at every speed; others are for :mod:`.surface`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from beltid.identify.estimators.statistics import settings_of
from beltid.laws.bicubic import bounded_cubic

Array = NDArray[np.float64]

SPEED_GAP = 0.03  # relative gap that separates two speed settings
FORCE_GAP = 0.01  # runs of one arc and speed closer than this in force are repetitions
ARC_GAP = 1e-3  # relative; arcs are nominal settings and differ only by rounding
MAX_SPEED_SPREAD = 1.25  # largest ratio of highest to lowest speed within one setting
ONE_TENSION = 2.5  # largest ratio of the forces that one tension gives over all arcs and speeds
MIN_RANGE = 0.02  # relative; a shorter range of forces does not count
EDGE = 1e-9  # relative tolerance: a node at the end of a curve lies on the curve


@dataclass(frozen=True, slots=True)
class Points:
    """Sliding states of the friction rig, one entry per run, arrays (n,), all > 0."""

    arc_deg: Array  # contact arc
    f: Array  # mean normal force per length [N/m]
    v: Array  # measured sliding speed [m/s]
    mu: Array  # friction coefficient [-]
    se: Array  # its standard error [-]

    def take(self, index: NDArray[Any]) -> Points:
        """Select points by index or mask."""
        return Points(*(a[index] for a in (self.arc_deg, self.f, self.v, self.mu, self.se)))

    @property
    def arc_label(self) -> NDArray[np.intp]:
        """Number of the arc of each run, ascending from 0."""
        return settings_of(self.arc_deg, ARC_GAP)


@dataclass(frozen=True, slots=True)
class Curve:
    """Friction coefficient over normal force for one arc at one speed.

    The curve is a natural cubic spline of ln mu over ln f through its points, bounded like the
    friction surface. It fits power laws exactly and does not smooth, as the arcs are averaged. It
    predicts an omitted point of the virtual benches to 0.08 % RMS without noise and 0.36 % with
    0.25 % noise; with not-a-knot ends, to 0.07 and 0.62 %.
    """

    arc_deg: float
    speed: float  # of its setting, the mean of the measured speeds [m/s]
    f: Array  # force of its points [N/m], ascending, (m,)
    mu: Array  # friction coefficient of the points [-]
    se: Array  # its standard error [-]
    band: tuple[float, float]
    """Lowest and highest measured friction coefficient of its runs [-]."""

    def covers(self, force: Array) -> NDArray[np.bool_]:
        """Return whether forces [N/m] lie between the first and the last point."""
        return (force >= self.f[0] * (1.0 - EDGE)) & (force <= self.f[-1] * (1.0 + EDGE))

    def weights(self, force: Array) -> Array:
        """Return the weights of the points in the unbounded spline at forces [N/m], (n, m).

        Beyond the points, they are those of the nearest one.
        """
        if self.f.size == 1:
            return np.ones((force.size, 1))
        spline = CubicSpline(np.log(self.f), np.eye(self.f.size), bc_type="natural")
        return np.asarray(spline(np.log(np.clip(force, self.f[0], self.f[-1]))))

    def at(self, force: Array) -> Array:
        """Evaluate mu [-] at forces [N/m], nan outside the points."""
        clipped = np.clip(force, self.f[0], self.f[-1])
        mu = np.exp(bounded_cubic(np.log(self.f), np.log(self.mu), np.log(clipped)))
        return np.where(self.covers(force), mu, np.nan)

    def covariance(self, force: Array) -> Array:
        """Return the covariance of ln mu at forces [N/m] by the errors of the points, (n, n)."""
        weights = self.weights(force)
        return np.asarray((weights * np.square(self.se / self.mu)) @ weights.T)


@dataclass(frozen=True, slots=True)
class Grid:
    """Curves of a campaign: a row of arcs for each speed."""

    by_speed: tuple[tuple[Curve, ...], ...]
    """Curves at each speed, ascending, in the order of the arcs."""
    force: tuple[float, float]
    """First and last force that some arc covers at every speed [N/m]; equal for one tension."""
    notes: tuple[str, ...] = ()  # runs that were averaged

    @property
    def speeds(self) -> Array:
        """Speed settings [m/s], ascending, (nv,)."""
        return np.array([curves[0].speed for curves in self.by_speed])

    @property
    def arcs_deg(self) -> Array:
        """Contact arcs, ascending, (na,)."""
        return np.array([curve.arc_deg for curve in self.by_speed[0]])

    def of_arc(self, number: int) -> Grid | None:
        """Return the curves of one arc; None if its speeds have no range of forces in common."""
        rows = [(row[number],) for row in self.by_speed]
        force = _common_range(rows)
        return None if force is None else Grid(tuple(rows), force)


def grid_of(points: Points) -> Grid | None:
    """Group points into curves at the common speed of their setting; None if they are no grid.

    Parameters
    ----------
    points : Points
        Valid points, at least one.
    """
    at_speed, at_arc = settings_of(points.v, SPEED_GAP), points.arc_label
    n_speeds, n_arcs = int(at_speed.max()) + 1, int(at_arc.max()) + 1
    groups = [points.v[at_speed == k] for k in range(n_speeds)]
    pairs = {(int(k), int(a)) for k, a in zip(at_speed, at_arc, strict=True)}
    if len(pairs) < n_speeds * n_arcs or any(v.max() > MAX_SPEED_SPREAD * v.min() for v in groups):
        return None
    speeds = np.array([v.mean() for v in groups])
    corrected = _at_common_speed(points, at_speed, speeds, at_arc)
    rows, notes = [], []
    for k, speed in enumerate(speeds):
        row = []
        for a in range(n_arcs):
            here = (at_arc == a) & (at_speed == k)
            mine = corrected.take(here)
            f, mu, se = _without_repetitions(mine)
            arc, band = float(mine.arc_deg.mean()), points.mu[here]
            row.append(Curve(arc, float(speed), f, mu, se, (band.min(), band.max())))
            if repeated := int(here.sum()) - f.size:
                notes.append(
                    f"arc {arc:g}°, {speed:.4g} m/s: {repeated} runs repeat the force of another "
                    "and were averaged with it"
                )
        rows.append(tuple(row))
    force = _common_range(rows)
    return None if force is None else Grid(tuple(rows), force, tuple(notes))


def _common_range(rows: Sequence[tuple[Curve, ...]]) -> tuple[float, float] | None:
    """Find the first and last force that some arc covers at every speed; None without a range."""
    curves = [curve for row in rows for curve in row]
    ends = np.unique([curve.f[[0, -1]] for curve in curves])
    if all(curve.f.size == 1 for curve in curves) and ends[-1] < ONE_TENSION * ends[0]:
        # one tension at all arcs and speeds: the surface depends on speed only
        f = float(np.exp(np.mean([np.log(curve.f[0]) for curve in curves])))
        return f, f
    middles = 0.5 * (ends[:-1] + ends[1:])
    covered = [np.any([curve.covers(middles) for curve in row], axis=0) for row in rows]
    everywhere = np.flatnonzero(np.all(covered, axis=0))
    if everywhere.size == 0:
        return None
    first, last = float(ends[everywhere[0]]), float(ends[everywhere[-1] + 1])
    return (first, last) if last > first * (1.0 + MIN_RANGE) else None


def _without_repetitions(points: Points) -> Array:
    """Average repetitions, weighted by their errors if all are known; rows f, mu, se."""
    label = settings_of(points.f, FORCE_GAP)
    means = []
    for same in (points.take(label == k) for k in range(label.max() + 1)):
        weights = same.se**-2.0 if np.all(same.se > 0.0) else np.ones(same.f.size)
        weights /= weights.sum()
        means.append((weights @ same.f, weights @ same.mu, np.sqrt(weights**2 @ same.se**2)))
    return np.array(means).T


def _at_common_speed(
    points: Points, at_speed: NDArray[np.intp], speeds: Array, at_arc: NDArray[np.intp]
) -> Points:
    """Correct points to the mean speed of their setting."""
    exponent = np.zeros(points.f.size)
    for here in (at_arc == a for a in range(at_arc.max() + 1) if speeds.size > 1):
        x, y, label = np.log(points.f[here]), np.log(points.mu[here]), at_speed[here]
        rows = []
        for k in range(speeds.size):
            order = np.argsort(x[label == k])
            rows.append(np.interp(x, x[label == k][order], y[label == k][order]))
        slope = np.gradient(np.stack(rows), np.log(speeds), axis=0)
        exponent[here] = slope[label, np.arange(x.size)]
    factor = (speeds[at_speed] / points.v) ** exponent
    return replace(points, mu=points.mu * factor, se=points.se * factor)

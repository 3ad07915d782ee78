"""Measured points of the friction rig as curves mu(f_N), one per contact arc and speed setting.

The normal force of a run is a result (the mean of Eq. 8), not a setting, so the points of a
campaign are scattered in f_N. The settings are arc, tension and speed: the points of one arc and
one speed lie on a curve over f_N.

A campaign may also have a different tension and speed in every run. Then no curve is measured.
Instead, one mixed model estimates the surface of ln mu over (ln f, ln v) from the runs of all arcs;
it is tabulated at common speeds and then treated in the same way.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, CubicSpline

from beltid.errors import InputError
from beltid.identify.estimators.statistics import settings_of
from beltid.laws.bicubic import bounded_cubic
from beltid.mixed import Mixed, Own, Shared, Size

Array = NDArray[np.float64]

SPEED_GAP = 0.03  # relative gap that separates two speed settings
FORCE_GAP = 0.01  # runs of one arc and speed closer than this in force are repetitions
ARC_GAP = 1e-3  # relative; arcs are nominal settings and differ only by rounding
MAX_SPEED_SPREAD = 1.25  # largest ratio of highest to lowest speed within one setting
USUAL_SPEED_SPREAD = 1.05
"""Usual value of this ratio: motors reach their speed to within a percent or two."""
ONE_TENSION = 2.5  # largest ratio of the forces that one tension gives over all arcs and speeds
SPEED_STEP = 0.18
"""Spacing of the tabulated speeds without settings [ln v], so that one is close to every run."""
FEWEST_RUNS = 6
"""Least number of runs without settings: four for a bilinear surface, two for the scatter."""
MOST_RUNS, CELLS = 400, 12
"""Runs beyond which neighbours of one arc are averaged, and cells along each axis."""
SPLINES = 7  # along each of ln f and ln v
BEND, ARC_EFFECT, SCATTER, LARGEST = 0.02, 0.007, 0.001, 1.0
"""Usual second difference of ln mu between splines, difference between arcs, scatter of runs; and
the largest of each."""
ROUNDING = 1e-5  # of ln mu
EDGE = 1e-9  # relative tolerance: a node at the end of a curve lies on the curve


@dataclass(frozen=True, slots=True)
class Points:
    """Sliding states of the friction rig, one entry per run, arrays (n,), all > 0."""

    arc_deg: Array  # contact arc
    f: Array  # mean normal force per length [N/m]
    v: Array  # measured sliding speed [m/s]
    mu: Array  # friction coefficient [-]
    se: Array  # its standard error [-]

    def take(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> Points:
        """Select points by index or mask."""
        return Points(*(a[index] for a in (self.arc_deg, self.f, self.v, self.mu, self.se)))


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

    def at(self, force: Array) -> tuple[Array, Array]:
        """Evaluate mu and its standard error [-] at forces [N/m], nan outside the points.

        Standard errors are propagated with the weights of the points in the unbounded spline.
        """
        clipped = np.clip(force, self.f[0], self.f[-1])
        mu = np.exp(bounded_cubic(np.log(self.f), np.log(self.mu), np.log(clipped)))
        se = mu * np.sqrt(self.weights(force) ** 2 @ (self.se / self.mu) ** 2)
        inside = self.covers(force)
        return np.where(inside, mu, np.nan), np.where(inside, se, np.nan)


@dataclass(frozen=True, slots=True)
class CurveSet:
    """All curves of a campaign."""

    curves: tuple[Curve, ...]  # at most one for each arc and speed
    notes: tuple[str, ...] = ()  # merged runs and missing combinations
    joined: bool = False  # whether arcs are not settings: each curve is from the runs of all arcs

    @property
    def arcs_deg(self) -> Array:
        """Contact arcs, ascending, (na,)."""
        return np.unique([c.arc_deg for c in self.curves])

    @property
    def speeds(self) -> Array:
        """Speed settings [m/s], ascending, (nv,)."""
        return np.unique([c.speed for c in self.curves])

    @property
    def by_speed(self) -> list[list[Curve]]:
        """Curves of each speed setting."""
        return [[c for c in self.curves if c.speed == speed] for speed in self.speeds]

    def with_curves(self, curves: Iterable[Curve]) -> CurveSet:
        """Return a set of these curves, without notes."""
        return replace(self, curves=tuple(curves), notes=())


def build_curves(points: Points) -> CurveSet:
    """Group points into curves and correct them to the common speed of their setting.

    Parameters
    ----------
    points : Points
        Valid points, at least one.

    Raises
    ------
    InputError
        If the speeds overlap, so that their settings cannot be distinguished.
    """
    speed_label = settings_of(points.v, SPEED_GAP)
    arc_label = settings_of(points.arc_deg, ARC_GAP)
    speeds = np.bincount(speed_label, points.v) / np.bincount(speed_label)
    arcs = np.bincount(arc_label, points.arc_deg) / np.bincount(arc_label)
    if _is_scattered(points, speed_label, arc_label):
        return _scattered_curves(points, arc_label)
    problems = [
        f"slip_speed_m_s: {group.size} speeds between {group.min():g} and {group.max():g} m/s "
        f"without a gap of {SPEED_GAP:.0%}, must be repeated settings of the speed"
        for group in (points.v[speed_label == k] for k in range(speeds.size))
        if group.max() > MAX_SPEED_SPREAD * group.min()
    ]
    if problems:
        raise InputError(problems)
    corrected = _at_common_speed(points, speed_label, speeds, arc_label)
    curves: list[Curve] = []
    notes: list[str] = []
    for a, arc in enumerate(arcs):
        missing, repeated = [], 0
        for k, speed in enumerate(speeds):
            here = (arc_label == a) & (speed_label == k)
            if not here.any():
                missing.append(f"{speed:.4g}")
                continue
            band = float(points.mu[here].min()), float(points.mu[here].max())
            f, mu, se = _without_repetitions(corrected.take(here))
            curves.append(Curve(float(arc), float(speed), f, mu, se, band))
            repeated += int(here.sum()) - f.size
        if missing:
            more = f" and {len(missing) - 6} other speeds," if len(missing) > 6 else ""
            notes.append(f"arc {arc:g}°: no run at {', '.join(missing[:6])}{more} m/s")
        if repeated:
            notes.append(
                f"arc {arc:g}°: {repeated} runs repeat the force and speed of another "
                "and were averaged with it"
            )
    return CurveSet(tuple(curves), tuple(notes))


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
    points: Points, speed_label: NDArray[np.intp], speeds: Array, arc_label: NDArray[np.intp]
) -> Points:
    """Correct points to the mean speed of their setting.

    A motor misses its speed by up to a percent. With the slope d ln mu / d ln v between
    neighbouring settings (0.1 to 0.3) that is a tenth of a percent of mu, corrected here.
    """
    exponent = np.zeros(points.f.size)  # 0 for an arc with one speed
    for a in range(arc_label.max() + 1):
        here = arc_label == a
        used, label = np.unique(speed_label[here], return_inverse=True)
        if used.size < 2:
            continue
        x, y = np.log(points.f[here]), np.log(points.mu[here])
        rows = []
        for k in range(used.size):
            order = np.argsort(x[label == k])
            rows.append(np.interp(x, x[label == k][order], y[label == k][order]))
        slope = np.gradient(np.stack(rows), np.log(speeds[used]), axis=0)
        exponent[here] = slope[label, np.arange(x.size)]
    factor = (speeds[speed_label] / points.v) ** exponent
    return replace(points, mu=points.mu * factor, se=points.se * factor)


def _is_scattered(
    points: Points, speed_label: NDArray[np.intp], arc_label: NDArray[np.intp]
) -> bool:
    """Return whether the speeds of a campaign are not repeated settings.

    This is so if a group of speeds without a gap spreads too far for one setting, or if most runs
    have no other run of their arc at the same speed to form a curve with.
    """
    if points.f.size < FEWEST_RUNS or points.f.max() < ONE_TENSION * points.f.min():
        return False
    in_curve = 0
    for k in range(int(speed_label.max()) + 1):
        here = speed_label == k
        spread = points.v[here].max() / points.v[here].min()
        if spread > MAX_SPEED_SPREAD:
            return True
        if spread <= USUAL_SPEED_SPREAD:
            runs_of_arcs = np.bincount(arc_label[here])
            in_curve += int(runs_of_arcs[runs_of_arcs >= 2].sum())
    return 2 * in_curve < points.f.size


def _scattered_curves(points: Points, arc_label: NDArray[np.intp]) -> CurveSet:
    """Estimate the curves of all arcs together at common speeds, from all runs."""
    ordered = np.sort(points.v)  # place speeds so that each is near a run, and each run near one
    cells = np.floor(np.log(ordered / ordered[0]) / SPEED_STEP)
    groups = [ordered[cells == k] for k in np.unique(cells)]
    speeds = np.array([np.sqrt(group[0] * group[-1]) for group in groups])
    n_arcs = int(arc_label.max()) + 1
    repeated = n_arcs if 2 * n_arcs < points.f.size else 1
    # as many nodes along the force as a grid of that many runs would have
    count = int(np.ceil(np.sqrt(points.f.size / repeated)))
    nodes = np.geomspace(points.f.min(), points.f.max(), count)
    at = np.stack(np.meshgrid(nodes, speeds, indexing="ij"), axis=-1)
    label = arc_label if repeated > 1 else np.zeros_like(arc_label)
    log_mu, se = smooth_surface(*_thinned(points, label), at.reshape(-1, 2))
    unlimited = np.exp(log_mu).reshape(count, -1)
    band = float(points.mu.min()), float(points.mu.max())
    mu = np.clip(unlimited, *band)  # limit corners without runs to the measured values
    mu_se = np.hypot(mu * se.reshape(mu.shape), unlimited - mu)
    curves = tuple(
        Curve(float(points.arc_deg.mean()), float(speed), nodes, mu[:, k], mu_se[:, k], band)
        for k, speed in enumerate(speeds)
    )
    note = (
        f"the {points.f.size} speeds are not repeated settings: the surface uses {speeds.size} "
        f"speeds between {speeds[0]:.4g} and {speeds[-1]:.4g} m/s, all arcs together"
    )
    return CurveSet(curves, (note,), joined=True)


def _thinned(points: Points, label: NDArray[np.intp]) -> tuple[Points, NDArray[np.intp]]:
    """Average very many runs of each arc in cells of the plane (ln f, ln v); leave fewer as is."""
    if points.f.size <= MOST_RUNS:
        return points, label
    cells = [label]
    for x in (np.log(points.f), np.log(points.v)):
        share = (x - x.min()) / max(float(np.ptp(x)), EDGE)
        cells.append(np.minimum(share * CELLS, CELLS - 1).astype(np.intp))
    kept, cell = np.unique(np.stack(cells, axis=1), axis=0, return_inverse=True)
    n = np.bincount(cell)
    arc, f, v, mu = (
        np.exp(np.bincount(cell, np.log(x)) / n)
        for x in (points.arc_deg, points.f, points.v, points.mu)
    )
    return Points(arc, f, v, mu, np.sqrt(np.bincount(cell, points.se**2)) / n), kept[:, 0]


def smooth_surface(points: Points, arc_label: NDArray[np.intp], at: Array) -> tuple[Array, Array]:
    """Estimate ln mu through scattered runs by a mixed model, and its standard error.

    ln mu is a tensor product of cubic B-splines over (ln f, ln v) whose second differences have an
    unknown size (P-splines), with an effect of each arc and errors of the runs, of unknown sizes.

    Parameters
    ----------
    points : Points
        The runs.
    arc_label : ndarray of int, shape (n,)
        Number of the arc of each run.
    at : ndarray, shape (m, 2)
        Forces [N/m] and speeds [m/s] to estimate at.

    Returns
    -------
    log_mu, se : ndarray, shape (m,)
        ln mu, and its standard error by the scatter of runs and arcs and between the runs.
    """
    x = np.log(np.column_stack([points.f, points.v]))
    low, high = x.min(axis=0), np.maximum(x.max(axis=0), x.min(axis=0) + EDGE)
    bent = np.diff(np.eye(SPLINES), 2, axis=0)
    rough, one = bent.T @ bent, np.eye(SPLINES)
    shared = [
        Shared(
            "surface",
            _splines((x - low) / (high - low)),
            Size(BEND, 2.0, LARGEST),
            precision=np.kron(rough, one) + np.kron(one, rough),
        )
    ]
    if arc_label.max() > 0:
        arcs = np.equal.outer(arc_label, np.arange(arc_label.max() + 1)).astype(float)
        shared.append(Shared("arc", arcs, Size(ARC_EFFECT, 1.2, LARGEST)))
    stated = np.hypot(points.se / points.mu, ROUNDING)
    own = [
        Own("scatter", Size(SCATTER, 2.0, LARGEST), diagonal=np.ones(points.f.size)),
        Own("stated errors", Size(1.0), diagonal=stated),
    ]
    posterior = Mixed(np.log(points.mu), shared, own).fit(tolerance=1e-6)
    mean, covariance = posterior.of("surface")
    rows = _splines((np.log(at) - low) / (high - low))
    return rows @ mean, np.sqrt(np.einsum("ij,jk,ik->i", rows, covariance, rows))


def _splines(s: Array) -> Array:
    """Return the products of cubic B-splines over the unit square at points (n, 2)."""
    knots = np.linspace(-3.0, SPLINES, SPLINES + 4) / (SPLINES - 3)
    inside = np.clip(s, 0.0, 1.0 - EDGE)
    f, v = (BSpline.design_matrix(column, knots, 3).toarray() for column in inside.T)
    return np.asarray((f[:, :, None] * v[:, None, :]).reshape(len(s), -1))

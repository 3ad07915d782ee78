"""Measured points of the friction rig as curves mu(f_N), one per contact arc and speed setting.

The normal force of a run is a result (the mean of Eq. 8), not a setting, so the points of a
campaign are scattered in f_N. What was set is the arc, the tension and the speed: the points of
one arc and one speed lie on a curve over f_N.

A campaign may also give every run a tension and a speed of its own. Then no curve is measured; per
arc the surface of ln mu over (ln f, ln v) is estimated from all of its runs by kriging and
tabulated at common speeds, and what follows is the same. Where most runs have an arc of their own,
too, all arcs are taken together.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import solve

from beltid.errors import InputError
from beltid.identify.estimators.statistics import settings_of
from beltid.laws.bicubic import bounded_cubic

Array = NDArray[np.float64]

SPEED_GAP = 0.03  # relative gap that parts two settings of the speed
FORCE_GAP = 0.01  # runs of one arc and speed closer than this in force are repetitions
ARC_GAP = 1e-3  # arcs are nominal settings and differ by rounding only, relative
MAX_SPEED_SPREAD = 1.25  # highest over lowest speed that can still be one setting
USUAL_SPEED_SPREAD = 1.05
"""The same of a usual setting: motors meet their speed to a percent or two."""
ONE_TENSION = 2.5  # highest over lowest force that one tension gives over all arcs and speeds
SPEED_STEP = 0.18
"""Distance of the speeds of a table without settings [ln v]: every run is near to one of them."""
FEWEST_RUNS = 6
"""Runs of an arc without settings: three for a plane, as many for the scatter about it."""
MOST_CELLS = 400  # of very many runs of an arc, neighbours are averaged first
LOG_STIFFNESS = np.linspace(-7.0, 16.0, 93)  # ln of spline over noise variance, tried
STATED_ERRORS = 5.0  # degrees of freedom that the stated errors of the runs are worth
EDGE = 1e-9  # a node made from the end of a curve lies on the curve, relative


@dataclass(frozen=True, slots=True)
class Points:
    """Sliding states of the friction rig, one entry per run, arrays (n,), all > 0."""

    arc_deg: Array  # contact arc
    f: Array  # mean normal force per length [N/m]
    v: Array  # measured sliding speed [m/s]
    mu: Array  # friction coefficient and its standard error [-]
    se: Array

    def take(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> Points:
        """Points of an index or a mask."""
        return Points(*(a[index] for a in (self.arc_deg, self.f, self.v, self.mu, self.se)))


@dataclass(frozen=True, slots=True)
class Curve:
    """Friction coefficient over normal force for one arc at one speed.

    The curve passes through its points: a natural cubic spline of ln mu over ln f, which fits
    power laws exactly, bounded like the friction surface; not smoothed, as the arcs are averaged.
    A point of the virtual benches left out is missed by 0.08 % RMS without noise and 0.36 % with
    0.25 % noise; with not-a-knot ends by 0.07 and 0.62 %.
    """

    arc_deg: float
    speed: int  # index of the speed setting
    f: Array  # force of its points [N/m], ascending, (m,)
    mu: Array  # friction coefficient of the points and its standard error [-]
    se: Array
    band: tuple[float, float]
    """Lowest and highest friction coefficient of its runs as they were measured [-]."""

    def covers(self, force: Array) -> NDArray[np.bool_]:
        """Whether forces [N/m] lie between the first and the last point."""
        return (force >= self.f[0] * (1.0 - EDGE)) & (force <= self.f[-1] * (1.0 + EDGE))

    def at(self, force: Array) -> tuple[Array, Array]:
        """Friction coefficient and standard error [-] at forces [N/m], nan outside the points.

        Standard errors are propagated through the weights of the points in the unbounded spline.
        """
        inside = self.covers(force)
        held = np.clip(force, self.f[0], self.f[-1])
        if self.f.size == 1:
            mu, se = np.full(held.shape, self.mu[0]), np.full(held.shape, self.se[0])
        else:
            nodes, x = np.log(self.f), np.log(held)
            mu = np.exp(bounded_cubic(nodes, np.log(self.mu), x))
            weights = CubicSpline(nodes, np.eye(nodes.size), bc_type="natural")(x)
            se = mu * np.sqrt(weights**2 @ (self.se / self.mu) ** 2)
        return np.where(inside, mu, np.nan), np.where(inside, se, np.nan)


@dataclass(frozen=True, slots=True)
class CurveSet:
    """All curves of a campaign."""

    arcs_deg: Array  # contact arcs, ascending, (na,)
    speeds: Array  # speed settings, the mean of their measured speeds [m/s], ascending, (nv,)
    curves: tuple[Curve, ...]  # at most one for each arc and speed
    notes: tuple[str, ...] = ()  # what was merged or is missing
    joined: bool = False  # arcs that are no settings: curves through the runs of all of them

    def of_arc(self, arc_deg: float) -> CurveSet:
        """Curves of one arc, with the speeds that it has."""
        one = replace(self, arcs_deg=np.array([arc_deg]), notes=())
        return one.with_curves(c for c in self.curves if c.arc_deg == arc_deg)

    def with_curves(self, curves: Iterable[Curve]) -> CurveSet:
        """The set with other curves; speeds without a curve are dropped."""
        kept = tuple(curves)
        used = sorted({c.speed for c in kept})
        kept = tuple(replace(c, speed=used.index(c.speed)) for c in kept)
        return replace(self, speeds=self.speeds[used], curves=kept)


def build_curves(points: Points) -> CurveSet:
    """Sort points into curves and bring them to the common speed of their setting.

    Parameters
    ----------
    points : Points
        Valid points, at least one.

    Raises
    ------
    InputError
        If the speeds run into each other, so that no settings can be told apart.
    """
    speed_label = settings_of(points.v, SPEED_GAP)
    arc_label = settings_of(points.arc_deg, ARC_GAP)
    speeds = np.array([points.v[speed_label == k].mean() for k in range(speed_label.max() + 1)])
    arcs = np.array([points.arc_deg[arc_label == k].mean() for k in range(arc_label.max() + 1)])
    if _is_scattered(points, speed_label, arc_label):
        scattered = _scattered_curves(points, arc_label, arcs)
        if scattered is not None:
            return scattered
    problems = [
        f"slip_speed_m_s: {group.size} speeds between {group.min():g} and {group.max():g} m/s "
        f"without a gap of {SPEED_GAP:.0%}, must be repeated settings of the speed"
        for group in (points.v[speed_label == k] for k in range(speeds.size))
        if group.max() > MAX_SPEED_SPREAD * group.min()
    ]
    if problems:
        raise InputError(problems)
    at_setting = _at_common_speed(points, speed_label, speeds, arc_label)
    curves: list[Curve] = []
    notes: list[str] = []
    for a, arc in enumerate(arcs):
        masks = [(arc_label == a) & (speed_label == k) for k in range(speeds.size)]
        found = []
        for k, mask in enumerate(masks):
            if mask.any():
                band = float(points.mu[mask].min()), float(points.mu[mask].max())
                f, mu, se = _without_repetitions(at_setting.take(mask))
                found.append(Curve(float(arc), k, f, mu, se, band))
        missing = [f"{speeds[k]:.4g}" for k, mask in enumerate(masks) if not mask.any()]
        if missing:
            more = f" and {len(missing) - 6} other speeds," if len(missing) > 6 else ""
            notes.append(f"arc {arc:g}°: no run at {', '.join(missing[:6])}{more} m/s")
        repeated = int(np.sum(masks)) - sum(c.f.size for c in found)
        if repeated:
            notes.append(
                f"arc {arc:g}°: {repeated} runs repeat the force and speed of another "
                "and were averaged with it"
            )
        curves += found
    return CurveSet(arcs, speeds, tuple(curves), tuple(notes))


def _without_repetitions(points: Points) -> Array:
    """Rows f, mu, se with means of repetitions, weighted by their errors if all are known."""
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
    """Points as they would be at the mean speed of their setting.

    A motor misses its speed by up to a percent. With the slope d ln mu / d ln v between
    neighbouring settings (0.1 to 0.3) that is a tenth of a percent of mu, taken off here.
    """
    exponent = np.zeros(points.f.size)  # 0 where one speed is all there is of an arc
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
    """Whether the speeds of a campaign are no settings.

    They are not if runs that follow one another without a gap spread too far for one setting, or if
    most runs have no second one of their arc at the same speed to make a curve with.
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


def _scattered_curves(points: Points, arc_label: NDArray[np.intp], arcs: Array) -> CurveSet | None:
    """Curves of each arc at common speeds, from all of its runs; None if no arc has enough."""
    joined = 2 * int(np.sum(np.bincount(arc_label)[arc_label] >= FEWEST_RUNS)) < points.f.size
    if joined:
        arc_label, arcs = np.zeros_like(arc_label), np.array([points.arc_deg.mean()])
    ordered = np.sort(points.v)  # every run is to be near to a speed, every speed near to a run
    cells = np.floor(np.log(ordered / ordered[0]) / SPEED_STEP)
    groups = [ordered[cells == k] for k in np.unique(cells)]
    speeds = np.array([np.sqrt(group[0] * group[-1]) for group in groups])
    curves: list[Curve] = []
    few = []
    band = float(points.mu.min()), float(points.mu.max())
    for a, arc in enumerate(arcs):
        mine = points.take(arc_label == a)
        if mine.f.size < FEWEST_RUNS:
            few.append(
                f"arc {arc:g}°: {mine.f.size} runs, {FEWEST_RUNS} are needed without settings"
            )
            continue
        ends = mine.f.min(), mine.f.max()
        mine = _thinned(mine)
        x = np.log(np.column_stack([mine.f, mine.v]))
        # as many nodes along the force as a grid of that many runs would have
        nodes = np.geomspace(*ends, int(np.ceil(np.sqrt(mine.f.size))))
        at = np.stack(np.meshgrid(np.log(nodes), np.log(speeds), indexing="ij"), axis=-1)
        log_mu, se = kriging(x, np.log(mine.mu), mine.se / mine.mu, at.reshape(-1, 2))
        free = np.exp(log_mu).reshape(nodes.size, -1)
        mu = np.clip(free, *band)  # corners without runs: nothing beyond what was measured
        mu_se = np.hypot(mu * se.reshape(mu.shape), free - mu)
        curves += [
            Curve(float(arc), k, nodes, mu[:, k], mu_se[:, k], band) for k in range(speeds.size)
        ]
    if not curves:
        return None
    each = (
        "all arcs together, as they are none either" if joined else "each arc from all of its runs"
    )
    note = (
        f"the {points.f.size} speeds are no repeated settings: {speeds.size} speeds between "
        f"{speeds[0]:.4g} and {speeds[-1]:.4g} m/s, {each}"
    )
    return CurveSet(arcs, speeds, tuple(curves), (note, *few), joined)


def _thinned(points: Points) -> Points:
    """Points, or their means in cells of the plane (ln f, ln v) if there are very many."""
    if points.f.size <= MOST_CELLS:
        return points
    per_axis = int(np.sqrt(MOST_CELLS))
    cells = []
    for x in (np.log(points.f), np.log(points.v)):
        share = (x - x.min()) / max(float(np.ptp(x)), EDGE)
        cells.append(np.minimum(np.floor(share * per_axis), per_axis - 1))
    _, cell = np.unique(np.stack(cells, axis=1), axis=0, return_inverse=True)
    rows = [
        (g.arc_deg.mean(), np.exp(np.log(g.f).mean()), np.exp(np.log(g.v).mean()),
         np.exp(np.log(g.mu).mean()), float(np.sqrt(np.sum(g.se**2))) / g.f.size)
        for g in (points.take(cell.ravel() == k) for k in range(int(cell.max()) + 1))
    ]  # fmt: skip
    return Points(*np.array(rows).T)


def kriging(x: Array, y: Array, se: Array, at: Array) -> tuple[Array, Array]:
    """Smooth surface through scattered points with its standard errors (universal kriging).

    A plane plus a thin-plate spline, whose stiffness is the one of the highest restricted
    likelihood (Wahba 1990, Spline models for observational data, chapters 2 and 4).

    Parameters
    ----------
    x, at : ndarray, shape (n, 2), (m, 2)
        Places of the points, and places to estimate.
    y, se : ndarray, shape (n,)
        Values and standard errors, which may be wrong by a common factor; all zero if unknown.

    Returns
    -------
    value, error : ndarray, shape (m,)
        The error holds the noise of the runs and what the spline may do between them.
    """
    noise = np.where(se > 0.0, se, np.median(se[se > 0.0]) if np.any(se > 0.0) else 1.0)
    centre = x.mean(axis=0)
    P = np.column_stack([np.ones(len(x)), x - centre])
    K = _thin_plate(x, x)
    weighted = P / noise[:, None]
    null = np.linalg.qr(weighted, mode="complete")[0][:, P.shape[1] :]
    values, axes = np.linalg.eigh(null.T @ (K / np.outer(noise, noise)) @ null)
    values = np.maximum(values, 0.0)
    z2 = np.square(axes.T @ (null.T @ (y / noise)))
    unit = max(float(values.mean()), 1e-300)
    ratios = np.exp(LOG_STIFFNESS) / unit
    spread = 1.0 + ratios[:, None] * values
    # without a prior, a spline stiff enough to pass through all runs leaves them no error at all
    known = STATED_ERRORS if np.any(se > 0.0) else 0.0
    freedom = known + z2.size
    scatter = np.maximum((known + np.sum(z2 / spread, axis=1)) / freedom, 1e-30)
    best = int(np.argmin(np.sum(np.log(spread), axis=1) + freedom * np.log(scatter)))
    ratio, variance = ratios[best], scatter[best]

    n, p = P.shape
    system = np.zeros((n + p, n + p))
    system[:n, :n] = ratio * K + np.diag(noise**2)
    scale = float(np.abs(system).max())  # of the constraints, for the condition of the system
    system[:n, n:], system[n:, :n] = scale * P, scale * P.T
    plane = np.vstack([np.ones(len(at)), (at - centre).T])
    right = np.vstack([ratio * _thin_plate(x, at), scale * plane])
    weights = solve(system, right, assume_a="sym")
    error = np.maximum(-np.sum(weights * right, axis=0), 0.0)
    return weights[:n].T @ y, np.sqrt(variance * error)


def _thin_plate(a: Array, b: Array) -> Array:
    """``r² ln r`` between places, shape (len(a), len(b))."""
    r2 = np.sum(np.square(a[:, None, :] - b[None, :, :]), axis=-1)
    return 0.5 * r2 * np.log(np.where(r2 > 0.0, r2, 1.0))

"""Friction surface from the reduced runs of the friction rig (paper, section 2.2, Figs. 12 and 13).

Each contact arc and speed setting gives a curve over the normal force. Each arc gives a surface
over the range that it covers at all speeds. Simulations use the average over the arcs. A campaign
is a grid if each arc was measured at each speed, and some arc covers the same forces at each.

Some arcs end before others at low and at high force (Eq. 8). So that the mean does not jump there,
an arc is continued *parallel* to the mean of the arcs that go on. Arcs are a sample of contact
lengths. The standard error with ``n`` measured arcs is

    se² = sum(se_arc²) / n² + t² tau² mu² / n

with the relative spread ``tau`` between arcs beyond what the errors of the runs explain, and
Student's t at 68 %. Runs that are no grid have one smooth surface (P-splines over ln f, ln v).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, CubicSpline
from scipy.linalg import block_diag
from scipy.special import ndtr, stdtrit

from beltid.arrays import Array, Columns, Mask
from beltid.errors import InputError
from beltid.identify.estimators import settings_of
from beltid.laws.bicubic import bounded_cubic
from beltid.laws.friction_surface import FrictionSurface
from beltid.mixed import Mixed, Own, Shared, Size, root

SPEED_GAP = 0.03  # relative gap that separates two speed settings
FORCE_GAP = 0.01  # runs of one arc and speed closer than this in force are repetitions
ARC_GAP = 1e-3  # relative; arcs are nominal settings and differ only by rounding
MAX_SPEED_SPREAD = 1.25  # largest ratio of highest to lowest speed within one setting
ONE_TENSION = 2.5  # largest ratio of the forces that one tension gives over all arcs and speeds
MIN_RANGE = 0.02  # relative; a shorter range of forces does not count
MIN_NODE_GAP = 0.3  # of the usual gap; noise at closer force nodes causes steep slopes
SPEED_STEP = 0.18  # spacing of the speeds [ln v]
FEWEST_RUNS = 4  # of a bilinear surface
SPLINES = 7  # along each of ln f and ln v
BEND, ARC_EFFECT, SCATTER, LARGEST = 0.02, 0.007, 0.001, 1.0
"""Usual second difference of ln mu between splines, difference between arcs, scatter of runs; and
the largest of each."""
FLAT = 1e-6  # precision of what has no second difference, over that of a second difference
ROUNDING = 1e-5  # of ln mu
COLUMNS = "arc_deg", "normal_force_N_m", "slip_speed_m_s", "mu", "mu_se", "n_arcs", "mu_spread"
EDGE = 1e-9  # relative tolerance: a point at the end of a curve or surface lies on it


@dataclass(frozen=True, slots=True)
class Points:
    """Sliding states of the friction rig, one entry per run, arrays (n,), all > 0."""

    arc_deg: Array  # contact arc
    f: Array  # mean normal force per length [N/m]
    v: Array  # measured sliding speed [m/s]
    mu: Array  # friction coefficient [-]
    se: Array  # its standard error [-]

    @property
    def arc_label(self) -> NDArray[np.intp]:
        """Number of the arc of each run, ascending from 0."""
        return settings_of(self.arc_deg, ARC_GAP)


@dataclass(frozen=True, slots=True)
class Curve:
    """Friction coefficient over normal force for one arc at one speed.

    A natural cubic spline of ln mu over ln f through its points, bounded like the surface.
    """

    arc_deg: float
    speed: float  # of its setting, the mean of the measured speeds [m/s]
    f: Array  # force of its points [N/m], ascending, (m,)
    mu: Array  # friction coefficient of the points [-]
    se: Array  # its standard error [-]
    band: tuple[float, float]  # lowest and highest measured friction coefficient of its runs [-]

    def covers(self, force: Array) -> Mask:
        """Return whether forces [N/m] lie between the first and the last point."""
        return (force >= self.f[0] * (1.0 - EDGE)) & (force <= self.f[-1] * (1.0 + EDGE))

    def at(self, force: Array) -> Array:
        """Evaluate mu [-] at forces [N/m], nan outside the points."""
        log_force = np.log(np.clip(force, self.f[0], self.f[-1]))
        mu = np.exp(bounded_cubic(np.log(self.f), np.log(self.mu), log_force))
        return np.where(self.covers(force), mu, np.nan)

    def covariance(self, force: Array) -> Array:
        """Return the covariance of ln mu at forces [N/m] by the errors of the points, (n, n)."""
        weights = np.ones((force.size, 1))
        if self.f.size > 1:  # held beyond its ends
            spline = CubicSpline(np.log(self.f), np.eye(self.f.size), bc_type="natural")
            weights = spline(np.log(np.clip(force, self.f[0], self.f[-1])))
        return np.asarray((weights * np.square(self.se / self.mu)) @ weights.T)


Rows = Sequence[Sequence[Curve]]  # at each speed, ascending, the curves in the order of the arcs
Range = tuple[float, float]  # first and last force that some arc covers at every speed [N/m]


def grid_of(points: Points) -> tuple[Rows, Range] | None:
    """Group points into curves at the common speed of their setting; None if they are no grid."""
    at_speed, at_arc = settings_of(points.v, SPEED_GAP), points.arc_label
    groups = [points.v[at_speed == k] for k in range(at_speed.max() + 1)]
    runs, speeds = np.zeros((len(groups), at_arc.max() + 1), int), np.array([*map(np.mean, groups)])
    np.add.at(runs, (at_speed, at_arc), 1)
    if np.any(runs == 0) or any(v.max() > MAX_SPEED_SPREAD * v.min() for v in groups):
        return None
    corrected = _at_common_speed(points, at_speed, speeds, at_arc)
    rows = [list[Curve]() for _ in speeds]
    for k, a in np.ndindex(runs.shape):
        here = (at_arc == a) & (at_speed == k)
        band, arc, speed = points.mu[here], float(points.arc_deg[here].mean()), float(speeds[k])
        f, mu, se = _without_repetitions(points.f[here], corrected.mu[here], corrected.se[here])
        rows[k].append(Curve(arc, speed, f, mu, se, (band.min(), band.max())))
    force = _common_range(rows)
    return None if force is None else (rows, force)


def _common_range(rows: Rows) -> Range | None:
    """Find the first and last force that some arc covers at every speed; None without a range."""
    curves = [curve for row in rows for curve in row]
    ends = np.unique([curve.f[[0, -1]] for curve in curves])
    if all(curve.f.size == 1 for curve in curves) and ends[-1] < ONE_TENSION * ends[0]:
        # one tension at all arcs and speeds: the surface depends on speed only
        f = float(np.exp(np.mean([np.log(curve.f[0]) for curve in curves])))
        return f, f
    middles = 0.5 * (ends[:-1] + ends[1:])
    covered = [np.any([curve.covers(middles) for curve in row], axis=0) for row in rows]
    everywhere = np.append(np.all(covered, axis=0), False)
    common = ends[everywhere | np.roll(everywhere, 1)]  # of all intervals that every speed covers
    if not common.size or common[-1] <= common[0] * (1.0 + MIN_RANGE):
        return None
    return float(common[0]), float(common[-1])


def _without_repetitions(f: Array, mu: Array, se: Array) -> Array:
    """Average repetitions, weighted by their errors if all are known; rows f, mu, se."""
    label = settings_of(f, FORCE_GAP)
    weights = np.where(np.bincount(label, se <= 0.0)[label] == 0.0, se, 1.0) ** -2.0
    weights /= np.bincount(label, weights)[label]
    means = (np.bincount(label, weights * x) for x in (f, mu))
    return np.array([*means, np.sqrt(np.bincount(label, (weights * se) ** 2))])


def _at_common_speed(
    points: Points, at_speed: NDArray[np.intp], speeds: Array, at_arc: NDArray[np.intp]
) -> Points:
    """Correct points to the mean speed of their setting."""
    exponent, x, y = np.zeros(points.f.size), np.log(points.f), np.log(points.mu)
    by_force = np.argsort(x, kind="stable")
    for here in (at_arc == a for a in range(at_arc.max() + 1) if speeds.size > 1):
        groups = [by_force[(here & (at_speed == k))[by_force]] for k in range(speeds.size)]
        at_speeds = [np.interp(x[here], x[group], y[group]) for group in groups]
        slope = np.gradient(at_speeds, np.log(speeds), axis=0)
        exponent[here] = slope[at_speed[here], np.arange(here.sum())]
    factor = (speeds[at_speed] / points.v) ** exponent
    return replace(points, mu=points.mu * factor, se=points.se * factor)


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


def average(rows: Rows, force: Range) -> tuple[SurfaceGrid, list[str]]:
    """Build the surface through the mean of all arcs of a grid; a note says if they never overlap.

    Errors of zero are unknown ones: those of a single arc are then unknown, too.
    """
    nodes, notes = _force_nodes(rows, force), list[str]()
    if nodes.size == 1:  # one tension
        rows = [[replace(curve, f=nodes) for curve in row] for row in rows]
    # an arc is continued from its last point
    ends = np.concatenate([curve.f[[0, -1]] for row in rows for curve in row])
    path = np.union1d(nodes, ends[(ends > nodes[0]) & (ends < nodes[-1])])
    values = np.array([[curve.at(path) for curve in row] for row in rows])
    mu, filled = (
        of[..., np.isin(path, nodes)].transpose(1, 2, 0)
        for of in (values, np.array([_continued(of_speed) for of_speed in values]))
    )
    if np.isnan(filled).any():
        notes.append("some arcs share no force with the others: the average may have a step there")
    bands = np.array([[curve.band for curve in row] for row in rows])
    lowest, highest = bands[..., 0].min(axis=1), bands[..., 1].max(axis=1)
    mean = np.clip(np.nanmean(filled, axis=0), lowest, highest)
    n_arcs = np.isfinite(mu).sum(axis=0)
    sd = np.ma.masked_invalid(mu).std(axis=0, ddof=1).filled(np.nan)
    from_runs = [_run_covariance(row, nodes) for row in rows]
    own = np.sqrt(np.array([np.diag(C) for C in from_runs]).T)
    between = _between_arcs(own, mean, sd, n_arcs)
    factor = block_diag(*map(root, from_runs)).reshape(len(rows), nodes.size, -1).swapaxes(0, 1)
    factor = np.concatenate([factor, between[..., None]], axis=-1)
    speeds, relative = np.array([row[0].speed for row in rows]), np.hypot(own, between)
    mu_se = np.where(relative > 0.0, mean * relative, np.nan)
    factor = factor[..., np.any(factor, axis=(0, 1))]
    return SurfaceGrid(np.nan, nodes, speeds, mean, mu_se, n_arcs, sd, factor), notes


def _force_nodes(rows: Rows, force: Range) -> Array:
    """Place force nodes over the range that every speed covers, where the points are [N/m]."""
    if force[0] == force[1]:
        return np.array(force[:1])
    forces, (first, last) = [curve.f for row in rows for curve in row], np.log(force)
    count, pooled = max(f.size for f in forces), np.sort(np.log(np.concatenate(forces)))
    centres = np.array([group.mean() for group in np.array_split(pooled, count)])
    gap = MIN_NODE_GAP * float(np.median(np.diff(centres)))
    # the ends of the range replace the outermost centres
    inner = [x for x in centres[1:-1] if first + gap < x < last - gap]
    return np.array([force[0], *np.exp(inner), force[1]])


def _continued(values: Array) -> Array:
    """Continue every arc of one speed (na, n) parallel to the arcs that go on."""
    filled = values.copy()
    count = np.isfinite(values).sum(axis=0)
    best = np.flatnonzero(count == count.max())
    core = int(best[best.size // 2])
    for path in (range(core, values.shape[1]), range(core, -1, -1)):
        for inner, node in pairwise(path):
            at_inner, at_node = np.isfinite(filled[:, [inner, node]]).T
            going_on, ending = at_inner & at_node, at_inner & ~at_node
            if going_on.any():
                growth = filled[going_on, node].mean() / filled[going_on, inner].mean()
                filled[ending, node] = filled[ending, inner] * growth
    return filled


def _run_covariance(curves: Sequence[Curve], nodes: Array) -> Array:
    """Return the covariance of ln mu by the errors of the runs, mean of the arcs measured there."""
    there = np.array([curve.covers(nodes) for curve in curves])
    shares = there / np.maximum(there.sum(axis=0), 1)
    covariances = np.array([curve.covariance(nodes) for curve in curves])
    return np.asarray(np.sum(covariances * shares[:, :, None] * shares[:, None, :], axis=0))


def _between_arcs(own: Array, mean: Array, sd: Array, n_arcs: NDArray[np.int64]) -> Array:
    """Compute the relative standard error by the spread between arcs, (nf, nv)."""
    freedom = n_arcs - 1
    if not freedom.any():
        return np.zeros(mean.shape)
    excess = np.where(freedom > 0, (sd / mean) ** 2 - n_arcs * own**2, 0.0)
    per_force = freedom.sum(axis=1)
    # where most arcs have ended, the spread is poorly determined: use the nearest other force
    rows = np.flatnonzero(2 * per_force >= per_force.max())
    tau2 = np.maximum((freedom * excess).sum(axis=1)[rows] / per_force[rows], 0.0)
    tau2 *= float(stdtrit(freedom.max(), ndtr(1.0))) ** 2
    nearest = [int(np.argmin(np.abs(rows - i))) for i in range(mean.shape[0])]
    return np.asarray(np.sqrt(tau2[nearest][:, None] / n_arcs))


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceResult:
    """Friction surfaces of a campaign."""

    average: SurfaceGrid  # average over the arcs
    arcs: tuple[SurfaceGrid, ...]  # surface of each arc over its own range
    n_points: int  # number of points used
    set_aside: tuple[str, ...]  # rejected points, each with the reason
    notes: tuple[str, ...]  # for the user

    @property
    def surface(self) -> FrictionSurface:
        """Averaged surface, continuous."""
        return self.average.to_surface()

    @property
    def rms_arc_spread(self) -> float:
        """Root mean square over the nodes of the relative spread between arcs [-]; nan for one."""
        squares = np.square(self.average.mu_spread / self.average.mu)
        known = squares[np.isfinite(squares)]
        return math.sqrt(np.mean(known)) if known.size else math.nan

    def to_columns(self) -> Columns:
        """Build the surface table: a row per node, the average (``arc_deg`` nan) first."""
        parts = []
        for g in (self.average, *self.arcs):
            arc = np.full(g.mu.shape, g.arc_deg)
            nodes = np.meshgrid(g.normal_force_N_m, g.slip_speed_m_s, indexing="ij")
            parts.append([arc, *nodes, g.mu, g.mu_se, g.n_arcs, g.mu_spread])
        columns = (np.concatenate([x.ravel() for x in of]) for of in zip(*parts, strict=True))
        return dict(zip(COLUMNS, columns, strict=True))


def build_surface(
    arc_deg: ArrayLike,
    normal_force_N_m: ArrayLike,
    slip_speed_m_s: ArrayLike,
    mu: ArrayLike,
    mu_se: ArrayLike | None = None,
) -> SurfaceResult:
    """Build the friction surface of each arc and the averaged one; arrays of runs, (n,).

    From contact arcs [deg], mean normal forces per length, Eq. (8) [N/m], sliding speeds [m/s] of
    either sign, and friction coefficients, Eq. (6), with their standard errors [-]; the median of
    the others replaces an error that is nan. Raises `InputError` if no surface can be built.
    """
    values = np.array([arc_deg, normal_force_N_m, np.abs(slip_speed_m_s), mu], dtype=float)
    valid = (values > 0.0) & (values < np.inf)
    usable, notes = valid.all(axis=0), list[str]()
    set_aside = [
        f"point {k}: {', '.join(found)}, must be > 0"
        for k, (point, fine) in enumerate(zip(values.T, valid.T, strict=True))
        if (found := [f"{COLUMNS[i]} = {point[i]:g}" for i in np.flatnonzero(~fine)])
    ]
    if not usable.any():
        problem = f"no point for a friction surface among {usable.size}, at least one is needed"
        raise InputError([problem, *set_aside])
    se = np.full(usable.size, np.nan if mu_se is None else mu_se)[usable]
    known = np.isfinite(se) & (se >= 0.0)
    typical = float(np.median(se[known])) if known.any() else 0.0
    if not known.any():
        notes.append("no standard errors of mu given: the surface's are from the spread of arcs")
    elif not known.all():
        notes.append(
            f"{int((~known).sum())} points without a standard error: {typical:.3g} (median of the "
            "others) taken"
        )
    arcs_deg, f, v, coefficients = values[:, usable]
    points = Points(arcs_deg, f, v, coefficients, np.where(known, se, typical))
    grid, rows, of_grid = surface_through(points)
    notes, arcs = notes + of_grid, list[SurfaceGrid]()
    for of_arc in zip(*rows, strict=True):
        curves, arc = [[curve] for curve in of_arc], of_arc[0].arc_deg
        if force := _common_range(curves):
            arcs.append(replace(average(curves, force)[0], arc_deg=arc))
        else:
            notes.append(f"arc {arc:g}°: no surface of this arc alone, its speeds share no force")
    if grid.n_arcs.max() < 2:
        notes.append("no node was measured on two arcs: the spread between arcs is not known")
    return SurfaceResult(grid, tuple(arcs), points.f.size, tuple(set_aside), tuple(notes))


def surface_through(points: Points) -> tuple[SurfaceGrid, Rows, list[str]]:
    """Return the averaged surface of a grid or of scattered runs, its curves, if any, and notes."""
    curves = grid_of(points)
    if curves is None:
        grid, note = scattered_grid(points)
        return grid, (), [note]
    grid, notes = average(*curves)
    return grid, curves[0], notes


def surface_from_columns(columns: Mapping[str, ArrayLike]) -> FrictionSurface:
    """Read the averaged surface from a surface table, whose rows of the average have no arc_deg.

    Raises `InputError` if a column or the average is missing, or its rows form no complete grid.
    """
    if missing := [name for name in COLUMNS[:4] if name not in columns]:
        raise InputError([f"surface: column {name} is missing" for name in missing])
    rows = np.isnan(np.asarray(columns["arc_deg"], dtype=float))
    if not rows.any():
        raise InputError("surface: no row without arc_deg, must have the averaged surface")
    names = COLUMNS[1 : 5 if "mu_se" in columns else 4]
    f, v, *values = (np.asarray(columns[name], dtype=float)[rows] for name in names)
    forces, speeds = np.unique(f), np.unique(v)
    shape = forces.size, speeds.size
    if not f.size == len(set(zip(f, v, strict=True))) == forces.size * speeds.size:
        raise InputError(
            f"surface: {rows.sum()} averaged rows for {forces.size} forces and {speeds.size} "
            "speeds, must have each combination once"
        )
    order = np.lexsort((v, f))
    return FrictionSurface(forces, speeds, *(x[order].reshape(shape) for x in values))


def scattered_grid(points: Points) -> tuple[SurfaceGrid, str]:
    """Estimate the surface from all runs together; `InputError` if too few or of one force."""
    n = points.f.size
    if n < FEWEST_RUNS or points.f.max() < (1.0 + EDGE) * points.f.min():
        raise InputError(
            f"no speed was measured over a range of normal forces ({n} runs), must be at least "
            f"{FEWEST_RUNS} runs over a range, or one tension at every arc and speed"
        )
    cells = np.floor(np.log(points.v / points.v.min()) / SPEED_STEP)
    groups = [points.v[cells == k] for k in np.unique(cells)]
    speeds = np.array([np.sqrt(group.min() * group.max()) for group in groups])
    label, n_arcs = points.arc_label, int(points.arc_label.max()) + 1
    if 2 * n_arcs >= n:  # arcs are no settings
        label, n_arcs = np.zeros_like(label), 1
    # as many nodes along the force as a grid of that many runs would have
    forces = np.geomspace(points.f.min(), points.f.max(), max(2, int(np.ceil(np.sqrt(n / n_arcs)))))
    at = np.stack(np.meshgrid(forces, speeds, indexing="ij"), axis=-1)
    log_mu, factor = _smooth(points, label, at.reshape(-1, 2))
    # limit corners without runs to the measured values
    mu = np.clip(np.exp(log_mu), points.mu.min(), points.mu.max())
    factor = np.column_stack([factor, np.diag(log_mu - np.log(mu))])
    shape = forces.size, speeds.size
    mu, mu_se = (x.reshape(shape) for x in (mu, mu * np.linalg.norm(factor, axis=1)))
    of_one = np.ones(shape, dtype=np.int64), np.full(shape, np.nan), factor.reshape(*shape, -1)
    return SurfaceGrid(np.nan, forces, speeds, mu, mu_se, *of_one), (
        f"the {n} runs are no grid of arcs, speeds and forces: one smooth surface through all, at "
        f"{speeds.size} speeds between {speeds[0]:.4g} and {speeds[-1]:.4g} m/s"
    )


def _smooth(points: Points, arc_label: NDArray[np.intp], at: Array) -> tuple[Array, Array]:
    """Estimate ln mu at forces and speeds (m, 2), with a factor of its covariance (m, r)."""
    x = np.log(np.column_stack([points.f, points.v]))
    low, high = x.min(axis=0), np.maximum(x.max(axis=0), x.min(axis=0) + EDGE)
    bent, one = np.diff(np.eye(SPLINES), 2, axis=0), np.eye(SPLINES)
    precision = np.kron(bent.T @ bent, one) + np.kron(one, bent.T @ bent) + FLAT * np.kron(one, one)
    # a run is a group by itself: its errors are independent of the others
    columns, ones = _splines((x - low) / (high - low))[:, None], np.ones((points.f.size, 1))
    shared = [Shared("surface", columns, Size(BEND, 2.0, LARGEST), precision=precision)]
    if arc_label.max() > 0:
        arcs = np.eye(arc_label.max() + 1)[arc_label]
        shared.append(Shared("arc", arcs[:, None], Size(ARC_EFFECT, 1.2, LARGEST)))
    stated = np.hypot(points.se / points.mu, ROUNDING)[:, None]
    own = [
        Own("scatter", Size(SCATTER, 2.0, LARGEST), diagonal=ones),
        Own("stated", Size(1.0), diagonal=stated),
    ]
    posterior = Mixed(np.log(points.mu)[:, None], shared, own).fit(tolerance=1e-6)
    mean, covariance = posterior.of("surface")
    rows = _splines((np.log(at) - low) / (high - low))
    return rows @ mean, rows @ root(covariance)


def _splines(s: Array) -> Array:
    """Return the products of cubic B-splines over the unit square at points (n, 2)."""
    knots = np.linspace(-3.0, SPLINES, SPLINES + 4) / (SPLINES - 3)
    inside = np.clip(s, 0.0, 1.0 - EDGE)
    f, v = (BSpline.design_matrix(column, knots, 3).toarray() for column in inside.T)
    return np.asarray((f[:, :, None] * v[:, None, :]).reshape(len(s), -1))

"""Friction surface from the reduced runs of the friction rig (paper, section 2.2, Figs. 12 and 13).

Each contact arc and speed setting gives a curve over the normal force. Each arc gives a surface
over the range that it covers at all speeds. Simulations use the average over the arcs.

Runs that are no grid may have a different tension and speed each, or lack some combinations. Then
ln mu is a tensor product of cubic B-splines over (ln f, ln v) whose second differences have an
unknown size (P-splines), with an effect of each arc and errors of the runs, of unknown sizes. It is
tabulated at speeds of which each is near a run, and each run near one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline

from beltid.errors import InputError
from beltid.identify.surface.curves import Points, SurfaceGrid, average, grid_of
from beltid.laws.friction_surface import FrictionSurface
from beltid.mixed import Mixed, Own, Shared, Size, root

Array = NDArray[np.float64]

SPEED_STEP = 0.18  # spacing of the speeds [ln v]
FEWEST_RUNS = 4  # of a bilinear surface
SPLINES = 7  # along each of ln f and ln v
BEND, ARC_EFFECT, SCATTER, LARGEST = 0.02, 0.007, 0.001, 1.0
"""Usual second difference of ln mu between splines, difference between arcs, scatter of runs; and
the largest of each."""
FLAT = 1e-6  # precision of what has no second difference, over that of a second difference
ROUNDING = 1e-5  # of ln mu
EDGE = 1e-9  # a point at the end of the unit square lies in it


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceResult:
    """Friction surfaces of a campaign."""

    average: SurfaceGrid  # average over the arcs
    arcs: tuple[SurfaceGrid, ...]  # surface of each arc over its own range
    n_points: int  # number of points used
    set_aside: tuple[str, ...]  # rejected points, each with the reason
    notes: tuple[str, ...]
    """Remarks for the user: missing combinations, repetitions, degrees of interpolation."""

    @property
    def surface(self) -> FrictionSurface:
        """Averaged surface, continuous."""
        return self.average.to_surface()

    @property
    def rms_arc_spread(self) -> float:
        """Root mean square over the nodes of the relative spread between arcs [-]; nan for one."""
        relative = self.average.mu_spread / self.average.mu
        finite = relative[np.isfinite(relative)]
        return float(np.sqrt(np.mean(finite**2))) if finite.size else float("nan")

    def to_columns(self) -> dict[str, NDArray[Any]]:
        """Build the surface table: a row per node, the average (``arc_deg`` nan) first."""
        grids = (self.average, *self.arcs)
        columns: dict[str, list[NDArray[Any]]] = {"arc_deg": []}
        for k, g in enumerate(grids):
            # nan marks the average, even with a single arc
            columns["arc_deg"].append(np.full(g.mu.size, g.arc_deg if k else np.nan))
            nodes = np.meshgrid(g.normal_force_N_m, g.slip_speed_m_s, indexing="ij")
            table = dict(zip(("normal_force_N_m", "slip_speed_m_s"), nodes, strict=True))
            table |= {name: getattr(g, name) for name in ("mu", "mu_se", "n_arcs", "mu_spread")}
            for name, values in table.items():
                columns.setdefault(name, []).append(values.ravel())
        return {name: np.concatenate(parts) for name, parts in columns.items()}


def build_surface(
    arc_deg: ArrayLike,
    normal_force_N_m: ArrayLike,
    slip_speed_m_s: ArrayLike,
    mu: ArrayLike,
    mu_se: ArrayLike | None = None,
) -> SurfaceResult:
    """Build the friction surface of each arc and the averaged one.

    Parameters
    ----------
    arc_deg : array_like (n,)
        Contact arc of each run [deg].
    normal_force_N_m : array_like (n,)
        Mean normal force per length, Eq. (8) [N/m].
    slip_speed_m_s : array_like (n,)
        Measured sliding speed [m/s]; its sign does not matter.
    mu, mu_se : array_like (n,)
        Sliding friction coefficient, Eq. (6), and its standard error [-]. The median of the others
        replaces an error that is nan.

    Raises
    ------
    InputError
        If arrays differ in length, or no surface can be built from the points.
    """
    points, set_aside, notes, errors_known = _valid_points(
        arc_deg, normal_force_N_m, slip_speed_m_s, mu, mu_se
    )
    grid, grid_notes = grid_through(points, errors_known)
    notes += grid_notes
    arcs, curves = [], grid_of(points)
    for number, arc in enumerate(() if curves is None else curves.arcs_deg):
        alone = curves.of_arc(number) if curves is not None else None
        if alone is None:
            notes.append(f"arc {arc:g}°: no surface of this arc alone, its speeds share no force")
        else:
            arcs.append(average(alone, errors_known)[0])
    if grid.n_arcs.max() < 2:
        notes.append("no node was measured on two arcs: the spread between arcs is not known")
    notes += [f"averaged surface: {line}" for line in grid.to_surface().notes]
    return SurfaceResult(grid, tuple(arcs), points.f.size, tuple(set_aside), tuple(notes))


def grid_through(points: Points, errors_known: bool = True) -> tuple[SurfaceGrid, tuple[str, ...]]:
    """Return the averaged surface through points, with notes: of a grid, or of scattered runs.

    Raises
    ------
    InputError
        If there are too few points for a surface.
    """
    curves = grid_of(points)
    if curves is not None:
        return average(curves, errors_known)
    grid, note = scattered_grid(points)
    return grid, (note,)


def _valid_points(
    arc_deg: ArrayLike, f: ArrayLike, v: ArrayLike, mu: ArrayLike, mu_se: ArrayLike | None
) -> tuple[Points, list[str], list[str], bool]:
    """Return usable points, rejected ones, notes, and whether the errors are known."""
    inputs = {"arc_deg": arc_deg, "normal_force_N_m": f, "slip_speed_m_s": v, "mu": mu}
    if mu_se is not None:
        inputs["mu_se"] = mu_se
    arrays = {name: np.asarray(values, dtype=float) for name, values in inputs.items()}
    n = arrays["mu"].size
    problems = [
        f"{name}: shape {a.shape}, must be ({n},) like mu"
        for name, a in arrays.items()
        if a.shape != (n,)
    ]
    if problems:
        raise InputError(problems)
    se = arrays.pop("mu_se", np.full(n, np.nan))
    arrays["slip_speed_m_s"] = np.abs(arrays["slip_speed_m_s"])
    reasons = [
        ", ".join(f"{name} = {a[k]:g}" for name, a in arrays.items() if not 0.0 < a[k] < np.inf)
        for k in range(n)
    ]
    set_aside = [f"point {k}: {text}, must be > 0" for k, text in enumerate(reasons) if text]
    usable = np.array([not text for text in reasons], dtype=bool)
    if not usable.any():
        problem = f"no point for a friction surface among {n}, at least one is needed"
        raise InputError([problem, *set_aside])
    has_error = np.isfinite(se) & (se >= 0.0)
    notes = []
    if not (has_error & usable).any():
        notes.append("no standard errors of mu given: the surface's are from the spread of arcs")
        se = np.zeros(n)
    elif not has_error[usable].all():
        typical = float(np.median(se[has_error & usable]))
        notes.append(
            f"{int((~has_error & usable).sum())} points without a standard error: {typical:.3g} "
            "(median of the others) taken"
        )
        se = np.where(has_error, se, typical)
    points = Points(*(a[usable] for a in (*arrays.values(), se)))
    return points, set_aside, notes, bool((has_error & usable).any())


def surface_from_columns(columns: Mapping[str, ArrayLike]) -> FrictionSurface:
    """Read the averaged surface from a surface table.

    Parameters
    ----------
    columns : mapping of str to array_like
        Columns arc_deg, normal_force_N_m, slip_speed_m_s, mu and optionally mu_se; the rows of the
        average have ``arc_deg`` nan.

    Raises
    ------
    InputError
        If a column or the average is missing, or the averaged rows do not form a complete grid.
    """
    required = ("arc_deg", "normal_force_N_m", "slip_speed_m_s", "mu")
    missing = [f"surface: column {name} is missing" for name in required if name not in columns]
    if missing:
        raise InputError(missing)
    rows = np.isnan(np.asarray(columns["arc_deg"], dtype=float))
    if not rows.any():
        raise InputError("surface: no row without arc_deg, must have the averaged surface")
    names = (*required[1:], "mu_se") if "mu_se" in columns else required[1:]
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
    """Estimate the surface from all runs together; return it with a note.

    Parameters
    ----------
    points : Points
        The runs.

    Raises
    ------
    InputError
        If there are too few runs, or they have one force only.
    """
    n = points.f.size
    if n < FEWEST_RUNS or points.f.max() < (1.0 + EDGE) * points.f.min():
        raise InputError(
            f"no speed was measured over a range of normal forces ({n} runs), must be at least "
            f"{FEWEST_RUNS} runs over a range, or one tension at every arc and speed"
        )
    ordered = np.sort(points.v)
    cells = np.floor(np.log(ordered / ordered[0]) / SPEED_STEP)
    groups = [ordered[cells == k] for k in np.unique(cells)]
    speeds = np.array([np.sqrt(group[0] * group[-1]) for group in groups])
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
    grid = SurfaceGrid(
        arc_deg=float("nan"),
        normal_force_N_m=forces,
        slip_speed_m_s=speeds,
        mu=mu.reshape(shape),
        mu_se=(mu * np.linalg.norm(factor, axis=1)).reshape(shape),
        n_arcs=np.ones(shape, dtype=np.int64),
        mu_spread=np.full(shape, np.nan),
        scatter=factor.reshape(*shape, -1),
    )
    note = (
        f"the {n} runs are no grid of arcs, speeds and forces: one smooth surface through all, at "
        f"{speeds.size} speeds between {speeds[0]:.4g} and {speeds[-1]:.4g} m/s"
    )
    return grid, note


def _smooth(points: Points, arc_label: NDArray[np.intp], at: Array) -> tuple[Array, Array]:
    """Estimate ln mu at forces and speeds (m, 2), with a factor of its covariance (m, r)."""
    x = np.log(np.column_stack([points.f, points.v]))
    low, high = x.min(axis=0), np.maximum(x.max(axis=0), x.min(axis=0) + EDGE)
    bent, one = np.diff(np.eye(SPLINES), 2, axis=0), np.eye(SPLINES)
    rough = np.kron(bent.T @ bent, one) + np.kron(one, bent.T @ bent)
    precision = rough + FLAT * np.eye(len(rough))
    # a run is a group by itself: its errors are independent of the others
    columns, ones = _splines((x - low) / (high - low))[:, None], np.ones((points.f.size, 1))
    shared = [Shared("surface", columns, Size(BEND, 2.0, LARGEST), precision=precision)]
    if arc_label.max() > 0:
        arcs = np.equal.outer(arc_label, np.arange(arc_label.max() + 1)).astype(float)
        shared.append(Shared("arc", arcs[:, None], Size(ARC_EFFECT, 1.2, LARGEST)))
    own = [
        Own("scatter", Size(SCATTER, 2.0, LARGEST), diagonal=ones),
        Own(
            "stated", Size(1.0), diagonal=ones * np.hypot(points.se / points.mu, ROUNDING)[:, None]
        ),
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

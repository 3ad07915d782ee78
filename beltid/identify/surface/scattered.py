"""The surface of a campaign that is no grid: one mixed model through all of its runs.

A campaign may have a different tension and speed in every run, or lack some combinations. Then
ln mu is a tensor product of cubic B-splines over (ln f, ln v) whose second differences have an
unknown size (P-splines), with an effect of each arc and errors of the runs, of unknown sizes. It is
tabulated at speeds of which each is near a run, and each run near one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from beltid.errors import InputError
from beltid.identify.surface.average import SurfaceGrid
from beltid.identify.surface.curves import Points
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

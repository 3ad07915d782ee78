"""Check whether the friction drifts over a campaign: with run order, distance or temperature.

A smooth surface and the differences between arcs are subtracted from ln mu of the runs first:
Eq. (8) gives a run the mean force over its arc, so short and long arcs differ by some percent
without any drift. The residual is regressed on one cause at a time, since a campaign can seldom
separate them:

    ln mu = surface(ln f, ln v) + arc(ln f) + b (cause) + noise.

If force, speed and arc nearly determine the cause, as they do the order of a campaign that is
sorted by force, the runs cannot separate the two: the rest of the cause is then the noise of the
runs, which also changes their mean force. The squared multiple correlation of the cause with the
columns of the surface and of the arcs measures this; the variance inflation factor is
1/(1 - share).

This checks the recording and corrects nothing: the inverse solution fits such changes together
with the surface (:mod:`beltid.refine.effects`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.identify.estimators.statistics import mad_sigma, outlier_mask, settings_of

Array = NDArray[np.float64]

CLEAR = 3.0  # standard errors beyond which a slope is significant
CONFOUNDED = 0.9  # share of a cause explained by force, speed and arc: variance inflated tenfold
ARC_SPREAD = 0.03  # of ln mu between arcs: bending makes them differ by several percent
POWERS = ((1, 0), (2, 0), (3, 0), (4, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 1))  # of ln f, ln v
SETTING_GAP = 0.03  # relative, within one setting
RUNS_PER_SETTING = 6
ITERATIONS = 10  # for the scale and the excluded outliers
SMALLEST_SCALE = 1e-6  # of ln mu
RUNS_PER_UNKNOWN = 3
LEAST_RANGE = {"temperature": 1.0}  # K: less is the noise of a thermometer
CAUSES = {
    "order": ("order of the runs", 10.0, "10 runs"),
    "distance": ("sliding distance", 10.0, "10 m"),
    "temperature": ("temperature", 10.0, "10 K"),
}
"""Key -> description, step, and the step as text."""


@dataclass(frozen=True, slots=True)
class Drift:
    """Change of the friction with one cause.

    Attributes
    ----------
    cause : str
        Key of :data:`CAUSES`.
    change, standard_error : float
        Change of ln mu by the step of the cause, and its standard error.
    runs : int
        Runs used.
    explained : float
        Share of the cause that force, speed and arc of the runs explain: the square of its
        multiple correlation with them [-].
    """

    cause: str
    change: float
    standard_error: float
    runs: int
    explained: float

    @property
    def is_confounded(self) -> bool:
        """Whether the runs cannot separate the cause from force, speed and arc."""
        return self.explained > CONFOUNDED

    @property
    def is_clear(self) -> bool:
        """Whether the drift is significant and its cause is not confounded."""
        return abs(self.change) > CLEAR * self.standard_error and not self.is_confounded


def drift_check(columns: Mapping[str, np.ndarray]) -> tuple[Drift, ...]:
    """Regress the residual of ln mu about a smooth surface on order, distance and temperature.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Columns of a friction table, the runs in the order of the test. The sliding distance
        needs ``start_time_s`` and ``plateau_end_s``, the temperature ``temperature_degC``; a
        cause that is unknown, or the same in all runs, is skipped.

    Returns
    -------
    tuple of Drift
        In the order of :data:`CAUSES`; empty if there are too few runs.
    """
    causes = _causes(columns)
    names = ("arc_deg", "normal_force_N_m", "slip_speed_m_s", "mu_sliding")
    arc, f, v, mu = (np.asarray(columns[name], dtype=float) for name in names)
    tension = np.asarray(columns.get("nominal_tension_N", f), dtype=float)
    tension = np.where(tension > 0.0, tension, f)
    good = (columns["status"] == "ok") & (f > 0.0) & (v > 0.0) & (mu > 0.0)
    drifts = []
    for cause, values in causes.items():
        rows = good & np.isfinite(values)
        if not rows.any() or np.ptp(values[rows]) <= LEAST_RANGE.get(cause, 0.0):
            continue
        surface = _surface(np.log(f[rows]), np.log(v[rows]), tension[rows])
        arcs = _of_arcs(arc[rows])
        slope = _slope(surface, arcs, np.log(f[rows]), values[rows], np.log(mu[rows]))
        if slope is not None:
            step, (change, error) = CAUSES[cause][1], slope
            share = explained_share(np.hstack([surface, arcs]), values[rows])
            drifts.append(Drift(cause, step * change, step * error, int(rows.sum()), share))
    return tuple(drifts)


def _causes(columns: Mapping[str, np.ndarray]) -> dict[str, Array]:
    """Return the values of each cause that the table contains (n,)."""
    speed = np.asarray(columns["slip_speed_m_s"], dtype=float)
    causes = {"order": np.arange(speed.size, dtype=float)}
    times = [columns.get(name) for name in ("start_time_s", "plateau_end_s")]
    if all(time is not None for time in times):
        start, end = (np.asarray(time, dtype=float) for time in times)
        travel = speed * (end - start)
        # a rejected run slid as well; how far is not always known
        travel = np.where(np.isfinite(travel), travel, 0.0)
        causes["distance"] = np.cumsum(travel) - 0.5 * travel
    if "temperature_degC" in columns:
        causes["temperature"] = np.asarray(columns["temperature_degC"], dtype=float)
    return causes


def _surface(log_f: Array, log_v: Array, tension: Array) -> Array:
    """Return the zero-mean terms (n, m) of a smooth surface that the settings can resolve.

    A polynomial in ln f and ln v; if the runs use only a few speeds or tensions, each gets a
    separate level. A campaign sorted by its settings then shows no drift, instead of one caused
    by the misfit of the polynomial.
    """
    x, y = (a - a.mean() for a in (log_f, log_v))
    terms = [x**p * y**q for p, q in POWERS]
    for values in (log_v, np.log(tension)):
        settings = settings_of(np.exp(values), SETTING_GAP)
        if RUNS_PER_SETTING * np.unique(settings).size <= x.size:
            terms += [np.asarray(settings == k, dtype=float) for k in np.unique(settings)]
    design = np.column_stack(terms)
    design = design - design.mean(axis=0)
    # independent directions only: a campaign at one speed has none along the speed
    scaled = design / np.maximum(np.abs(design).max(axis=0), 1e-12)
    vectors, sizes, _ = np.linalg.svd(scaled, full_matrices=False)
    return np.asarray(vectors[:, sizes > 1e-6 * max(sizes[0], 1e-6)])


def explained_share(columns: Array, cause: Array) -> float:
    """Return squared multiple correlation of a cause (n,) with columns (n, m) and a constant."""
    X, y = columns - columns.mean(axis=0), cause - cause.mean()
    residual = y - X @ np.linalg.lstsq(X, y, rcond=None)[0]
    return float(1.0 - residual @ residual / (y @ y))


def _of_arcs(arc: Array) -> Array:
    """Return the terms (n, k) of the arcs: a level for each, or a parabola for too many arcs."""
    settings = np.unique(arc)
    if settings.size == 1 or RUNS_PER_SETTING * settings.size <= arc.size:
        return (arc[:, None] == settings).astype(float)
    x = (arc - arc.mean()) / float(np.std(arc))
    return np.column_stack([np.ones(arc.size), x, np.square(x)])


def _slope(
    surface: Array, arcs: Array, log_f: Array, cause: Array, log_mu: Array
) -> tuple[float, float] | None:
    """Fit the slope of ln mu over a cause and its standard error; None if runs are too few.

    Arcs may differ in level, slope and curvature over ln f.
    """
    x = ((log_f - log_f.mean()) / max(float(np.std(log_f)), 1e-12))[:, None]
    between = np.hstack([arcs, arcs * x, arcs * np.square(x)])
    n, unit = log_mu.size, float(np.std(cause))
    first = np.column_stack([np.ones(n), (cause - cause.mean()) / unit, surface])
    if n < RUNS_PER_UNKNOWN * first.shape[1]:
        return None
    design = np.hstack([first, between])
    prior = np.repeat([0.0, ARC_SPREAD**-2.0], [first.shape[1], between.shape[1]])
    scale, kept = 1e-3, np.ones(n, dtype=bool)
    for _ in range(ITERATIONS):
        rows = design[kept]
        covariance = np.linalg.inv(rows.T @ rows / scale**2 + np.diag(prior))
        values = covariance @ (rows.T @ log_mu[kept]) / scale**2
        residual = log_mu - design @ values
        # a single outlier is not a drift
        kept = ~outlier_mask(residual)
        freedom = n - np.trace(covariance @ (rows.T @ rows)) / scale**2
        scale = max(mad_sigma(residual) * np.sqrt(n / max(freedom, 1.0)), SMALLEST_SCALE)
    return float(values[1] / unit), float(np.sqrt(covariance[1, 1]) / unit)

"""The reduced runs of a friction table as the uncertainty room takes them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from beltid.uncertainty.measured import Measured
from beltid.uncertainty.sources import REDUCTION_SOURCES

POSITIVE = ("arc_deg", "normal_force_N_m", "slip_speed_m_s", "mu_sliding")
ARC_GAP = 1e-3  # relative; arcs are nominal settings and only differ by rounding


def measured_runs(columns: Mapping[str, np.ndarray], rows: np.ndarray, R: float) -> Measured:
    """Rows of a friction table; the tensions follow from force and coefficient, Eqs. (5) and (8).

    Parameters
    ----------
    columns : mapping of str to ndarray
        Columns of a friction table.
    rows : ndarray of int
        The rows to take, valid ones.
    R : float
        Radius of the belt's centreline on the pulley [m].

    Returns
    -------
    Measured
        A standard error that is missing is the median of the others, or zero if none is known; what
        the runs share is not in it but in the columns.
    """
    arc_deg, f, v, mu = (np.asarray(columns[name], dtype=float)[rows] for name in POSITIVE)
    own = own_errors(columns)
    errors = np.full(mu.size, np.nan) if own is None else own[rows]
    known = np.isfinite(errors)
    typical = float(np.median(errors[known])) if known.any() else 0.0
    initial = columns.get("initial_tension_N")
    beta = np.radians(arc_deg)
    log_ratio = mu * beta
    slack = f * R * log_ratio / np.expm1(log_ratio)
    tight = slack * np.exp(log_ratio)
    T_0 = np.sqrt(tight * slack) if initial is None else np.asarray(initial, dtype=float)[rows]
    return Measured(
        R=R,
        arc=arc_settings(arc_deg),
        beta=beta,
        T_0=np.where(np.isfinite(T_0), T_0, np.sqrt(tight * slack)),
        omega=np.abs(v) / R,
        tight=tight,
        slack=slack,
        mu=mu,
        mu_se=np.where(known, errors, typical),
        columns={key: values[rows][:, None] for key, values in shared_columns(columns).items()},
    )


def shared_columns(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Change of ln mu of each run (n,) by what the reduction shares; 0 where it is not known."""
    named = {key: np.asarray(columns[key], float) for key, _ in REDUCTION_SOURCES if key in columns}
    return {key: np.where(np.isfinite(values), values, 0.0) for key, values in named.items()}


def own_errors(columns: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Standard errors of mu (n,) without what the runs share; None if the table has none.

    The column ``mu_sliding_se`` is the whole of it: its own and the shared parts add up in squares.
    """
    if "mu_sliding_se" not in columns:
        return None
    whole, mu = (np.asarray(columns[key], float) for key in ("mu_sliding_se", "mu_sliding"))
    shared = sum(np.square(mu * share) for share in shared_columns(columns).values())
    return np.asarray(np.sqrt(np.maximum(np.square(whole) - shared, 0.0)))


def arc_settings(arc_deg: np.ndarray) -> np.ndarray:
    """Number of the arc setting of each run (n,), ascending from 0."""
    order = np.argsort(arc_deg, kind="stable")
    ordered = arc_deg[order]
    labels = np.empty(arc_deg.size, dtype=np.intp)
    labels[order] = np.concatenate([[0], np.cumsum(np.diff(ordered) > ARC_GAP * ordered[:-1])])
    return labels


def valid_rows(columns: Mapping[str, Any], rows: np.ndarray) -> np.ndarray:
    """Those of some rows whose arc, force, speed and coefficient are positive numbers."""
    good = np.ones(rows.size, dtype=bool)
    for name in POSITIVE:
        values = np.asarray(columns[name], dtype=float)[rows]
        values = np.abs(values) if name == "slip_speed_m_s" else values
        good &= np.isfinite(values) & (values > 0.0)
    return np.asarray(rows[good])

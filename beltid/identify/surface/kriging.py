"""Universal kriging: a smooth surface through scattered points, with honest errors between them.

A plane plus a thin-plate spline, whose stiffness is the one of the highest restricted likelihood
(Wahba 1990, Spline models for observational data, chapters 2 and 4).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve

Array = NDArray[np.float64]

LOG_STIFFNESS = np.linspace(-7.0, 16.0, 93)  # ln of spline over noise variance, tried


def kriging(x: Array, y: Array, se: Array, at: Array) -> tuple[Array, Array]:
    """Smooth surface through scattered points with its standard errors.

    Parameters
    ----------
    x, at : ndarray, shape (n, 2), (m, 2)
        Places of the points, and places to estimate.
    y, se : ndarray, shape (n,)
        Values and standard errors, whose common scale is estimated; all zero if unknown.

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
    scatter = np.maximum(np.mean(z2 / spread, axis=1), 1e-30)
    ratio = ratios[np.argmin(np.sum(np.log(spread), axis=1) + z2.size * np.log(scatter))]
    variance = float(np.mean(z2 / (1.0 + ratio * values)))

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

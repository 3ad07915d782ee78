"""How far to trust a fit of the sliding phase: noise with a memory, correlated channels, drift."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from beltid.identify.estimators.signal import NOISE_FLOOR
from beltid.identify.estimators.statistics import integrated_autocorrelation_time
from beltid.identify.friction.sliding_model import SlidingFit

Array = NDArray[np.float64]

ROUNDING = 1.0e-7
"""Least standard error of a log ratio: keeps weights 1/se² finite for noise-free recordings."""
MOST_TAKEN = 0.4
"""Largest part of the noise that the fitted terms are credited with."""


@dataclass(frozen=True, slots=True)
class LinearScheme:
    """Linear part of the least squares: ``coefficients = inverse @ samples``."""

    inverse: Array
    q: Array


def with_errors(fit: SlidingFit, scheme: LinearScheme, t: Array, sigma: Array) -> SlidingFit:
    """Standard errors of both log ratios, for samples correlated in time and between channels.

    The covariance of the channels is that of the residuals; the integrated autocorrelation time of
    the residual of ln(T_tight/T_slack) inflates it.
    """
    start = fit.levels + fit.tail
    if not np.all(fit.levels > 0.0):
        return fit
    residual = np.compress(fit.used, fit.residual, axis=0)
    series = residual @ (np.array([1.0, -1.0]) / fit.levels)
    n, n_terms = series.size, scheme.inverse.shape[0] + int(np.isfinite(fit.tau))
    time = correlation_time(series, n_terms)
    # every fitted term takes slow noise out of the residual: n/time samples are independent
    covariance = residual.T @ residual / (n * (1.0 - min(n_terms * time / n, MOST_TAKEN)))
    slope = None
    row = scheme.inverse[0]
    start_row = row
    if np.isfinite(fit.tau):
        age = t[fit.used] - fit.t_0
        slope = (age * np.exp(-age / fit.tau) / fit.tau**2)[:, None] * fit.tail
        start_row = row + scheme.inverse[-1]
    errors = []
    for at, linear in ((fit.levels, row), (start, start_row)):
        if not np.all(at > 0.0):
            errors.append(float("inf"))
            continue
        weights = _influence(at, linear, scheme.q, slope, sigma)
        variance = float(np.sum((weights @ covariance) * weights)) * time
        errors.append(float(np.sqrt(max(variance, 0.0) + ROUNDING**2)))
    return replace(
        fit,
        log_ratio_se=errors[0],
        start_log_ratio_se=errors[1],
        correlation_time=time,
        drift_score=_drift_score(t[fit.used], residual, scheme.q, slope, fit.combinations),
    )


def correlation_time(series: Array, n_terms: int) -> float:
    """Integrated autocorrelation time of the noise behind a residual [samples].

    A fitted term takes slow noise, ``tau/n`` of the variance each, out of the residual, so that its
    own autocorrelation is too short. From the first lag this can be put right:
    ``rho = rho_residual (1 - x) + x`` with ``x = n_terms tau/n`` and ``tau = (1 + rho)/(1 - rho)``.
    The larger of this and of the sum over all lags is taken.
    """
    power = float(np.mean(series**2))
    if power <= ROUNDING**2:
        return 1.0
    first_lag = float(np.mean(series[1:] * series[:-1])) / power
    time = 1.0
    for _ in range(8):
        taken = min(n_terms * time / series.size, MOST_TAKEN)
        rho = min(first_lag * (1.0 - taken) + taken, 0.99)
        time = max((1.0 + rho) / (1.0 - rho), 1.0)
    return max(time, integrated_autocorrelation_time(series))


def _drift_score(t: Array, residual: Array, q: Array, slope: Array | None, by: Array) -> float:
    """Score of a linear drift added to the model, for white noise (standard normal without one).

    That of ln(T_tight/T_slack), or of its companion (`SlidingFit.combinations`, columns of `by`):
    a tail may take the drift of a cell out of the one, hardly out of both.
    """
    scores = []
    for weights in by.T:
        column, basis = (t - np.mean(t)) / float(t[-1] - t[0]), q
        if slope is not None:
            extra = slope @ weights
            extra -= q @ (q.T @ extra)
            size = float(np.linalg.norm(extra))
            if size > 0.0:
                basis = np.column_stack([q, extra / size])
        column -= basis @ (basis.T @ column)
        size = float(np.linalg.norm(column))
        if size < 1e-3 * np.sqrt(t.size):
            continue
        series = residual @ weights
        scores.append(float(column @ series) / size / max(float(np.std(series)), NOISE_FLOOR))
    return max(scores, key=abs, default=0.0)


def _influence(at: Array, row: Array, q: Array, slope: Array | None, sigma: Array) -> Array:
    """Derivative by each sample of ln(at_tight/at_slack), where ``at = row @ samples``.

    The time constant is fitted, too: its share enters through the part of `slope`, the derivative
    of the model by the time constant [N/s], that the linear terms (orthonormal columns `q`) do not
    explain.
    """
    gradient = np.array([1.0, -1.0]) / at
    weights = row[:, None] * gradient
    if slope is None:
        return weights
    shift = float(gradient @ (row @ slope))
    free = (slope - q @ (q.T @ slope)) / sigma
    size = float(np.sum(free**2))
    return weights - free * (shift / size) / sigma if size > 0.0 else weights

"""Model of the sliding phase: level, tail of the sticking peak, ripple, drift.

Both tensions share the times of the model and have their own amplitudes,

    T_c(t) = L_c + A_c exp(-(t - t_0)/tau) + D_c (t - t_mid) + sum_k ripple_ck(t)

with c = tight, slack.

The tail decays over a travel of millimetres, which at low speed is a good part of the record: the
mean over even the last samples still carries some of it. The level L_c is the plateau without that
tail. Ripple as a regressor does what averaging over a whole number of its periods does, without
giving away the rest of the record. Terms that the record does not call for are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from beltid.identify.signal import (
    NOISE_FLOOR,
    line_columns,
    median,
    parabolic_maximum,
    robust_sigma,
    strongest_line,
)
from beltid.identify.statistics import integrated_autocorrelation_time

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAX_LINES = 3
COARSE = np.linspace(0.0, 1.0, 20)
FINE = np.linspace(0.0, 1.0, 7)
"""Trial time constants, as fractions of the logarithmic range."""
LONGEST_TAIL = 0.5
"""Longest time constant over the length of the record: a longer tail looks like a drift."""
SIGNIFICANT_TAIL = 12.0
"""Least gain of the tail in sums of squared noise (chi-square, about 3 degrees of freedom)."""
ROUNDING = 1.0e-7
"""Least standard error of a log ratio: keeps weights 1/se² finite for noise-free recordings."""
MOST_TAKEN = 0.4
"""Largest part of the noise that the fitted terms are credited with."""


@dataclass(frozen=True, slots=True)
class SlidingFit:
    """Fitted model of the sliding phase; first axis of pairs: tight, slack."""

    t_0: float
    """Time at which the tail has its amplitude A_c [s]."""
    levels: Array
    """L_c [N], shape (2,)."""
    tail: Array
    """A_c [N], shape (2,); zero without a tail."""
    tau: float
    """Time constant of the tail [s]; nan without a tail."""
    tau_at_bound: bool
    """Whether a longer time constant than the record can tell would fit better."""
    drift: Array
    """D_c [N/s], shape (2,); zero unless a drift was fitted."""
    lines: tuple[float, ...]
    """Frequencies of the ripple [Hz], the strongest first found."""
    ripple_N: Array
    """Amplitude of the first line in both tensions [N], shape (2,)."""
    used: Mask
    """Samples that are no outliers, shape (n,)."""
    residual: Array
    """Residual of both tensions [N], shape (n, 2)."""
    ripple: Array
    """Ripple part of both tensions [N], shape (n, 2)."""
    log_ratio_se: float
    """Standard error of ln(L_tight/L_slack), correlation of the samples allowed for [-]."""
    start_log_ratio_se: float
    """The same for the start of the tail, ln((L + A)_tight/(L + A)_slack) [-]."""
    correlation_time: float
    """Integrated autocorrelation time of the residual of ln(T_tight/T_slack) [samples]."""
    drift_score: float
    """Drift not yet fitted over its standard error for white noise [-]."""

    @property
    def log_ratio(self) -> float:
        """ln(L_tight/L_slack) [-]; nan if a level is not positive."""
        if not np.all(self.levels > 0.0):
            return float("nan")
        return float(np.log(self.levels[0] / self.levels[1]))

    def tail_at(self, t: Array | float) -> Array:
        """Part of the tail in ln(T_tight/T_slack) at the times `t` [-]."""
        decay = self.decay(t)
        high = self.levels[0] + self.tail[0] * decay
        low = self.levels[1] + self.tail[1] * decay
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.log(high / low) - self.log_ratio

    def decay(self, t: Array | float) -> Array:
        """Tail of unit amplitude at the times `t`."""
        time = np.asarray(t, dtype=float)
        if not np.isfinite(self.tau):
            return np.zeros_like(time)
        return np.exp(-(time - self.t_0) / self.tau)


def fit_sliding(t: Array, tensions: Array, sigma: Array, *, drift: bool = False) -> SlidingFit:
    """Fit the model to the samples of the sliding phase.

    Parameters
    ----------
    t : ndarray
        Times [s], non-decreasing, shape (n,), n >= 8.
    tensions : ndarray
        Tight and slack tension [N], finite, shape (n, 2).
    sigma : ndarray
        White noise of the two channels [N], > 0, shape (2,); only weights and tests depend on it.
    drift : bool
        Fit a linear drift, too; the tail is then bound to a sixth of the record, since a longer
        one could not be told from the drift.

    Returns
    -------
    SlidingFit
    """
    used = plausible_samples(tensions, sigma)
    for _ in range(4):
        terms = _select_terms(t[used], tensions[used] / sigma, drift)
        fit, scheme = _solve(t, tensions, used, terms, drift)
        spread = np.array([robust_sigma(fit.residual[used, c]) for c in (0, 1)])
        limit = 6.0 * np.maximum(spread, sigma)
        kept = np.all(np.abs(fit.residual) <= limit, axis=1)
        if np.count_nonzero(kept) < max(8, used.size // 3) or np.array_equal(kept, used):
            break
        used = kept
    return _with_errors(fit, scheme, t, sigma)


def plausible_samples(tensions: Array, sigma: Array) -> Mask:
    """Samples near the median of their channel: starts the rejection of long drop-outs."""
    middle = np.array([median(column) for column in tensions.T])
    deviation = np.abs(tensions - middle)
    spread = np.maximum([1.5 * median(column) for column in deviation.T], sigma)
    near = np.all(deviation <= 8.0 * spread + 0.15 * np.abs(middle), axis=1)
    return near if np.count_nonzero(near) >= 8 else np.ones(tensions.shape[0], dtype=bool)


@dataclass(frozen=True, slots=True)
class _Terms:
    tau: float
    at_bound: bool
    lines: tuple[float, ...]


def _select_terms(t: Array, scaled: Array, drift: bool) -> _Terms:
    """Choose the time constant and the lines, alternating until no further line stands out."""
    lines: tuple[float, ...] = ()
    while True:
        basis, _ = np.linalg.qr(_linear_columns(t, lines, drift))
        tau, at_bound, residual = _search_tail(t, scaled, basis, drift)
        if len(lines) == MAX_LINES:
            return _Terms(tau, at_bound, lines)
        if np.isfinite(tau):
            column = np.exp(-(t - t[0]) / tau)[:, None]
            column -= basis @ (basis.T @ column)
            basis = np.hstack([basis, column / np.linalg.norm(column)])
        noise = np.sqrt(np.mean(residual**2, axis=0))
        scale = np.maximum(noise, 0.01)
        line = strongest_line(t, residual / scale, basis)
        if line is None or any(abs(line - known) * (t[-1] - t[0]) < 0.3 for known in lines):
            return _Terms(tau, at_bound, lines)
        lines = (*lines, line)


def _linear_columns(t: Array, lines: tuple[float, ...], drift: bool) -> Array:
    columns = [np.ones((t.size, 1))]
    columns += [line_columns(t - t[0], frequency) for frequency in lines]
    if drift:
        columns.append((t - 0.5 * (t[0] + t[-1]))[:, None])
    return np.hstack(columns)


def _search_tail(t: Array, scaled: Array, basis: Array, drift: bool) -> tuple[float, bool, Array]:
    """Time constant with the largest least-squares gain, and the residual with it."""
    residual = scaled - basis @ (basis.T @ scaled)
    length = float(t[-1] - t[0])
    longest = length * (1.0 / 6.0 if drift else LONGEST_TAIL)
    shortest = min(max(1.5 * length / t.size, 0.004 * length), 0.5 * longest)
    trial = shortest * (longest / shortest) ** COARSE
    gain = _tail_gain(t, residual, basis, trial)[0]
    k = int(np.argmax(gain))
    near = trial[max(k - 1, 0)], trial[min(k + 1, trial.size - 1)]
    fine = near[0] * (near[1] / near[0]) ** FINE
    fine_gain = _tail_gain(t, residual, basis, fine)[0]
    tau = float(np.exp(parabolic_maximum(np.log(fine), fine_gain)))
    best, column, projection = _tail_gain(t, residual, basis, np.array([tau]))
    noise = float(np.sum(residual**2) - best[0]) / max(residual.size - 4, 1)
    if best[0] < SIGNIFICANT_TAIL * max(noise, 1e-4):
        return float("nan"), False, residual
    rest = residual - column * projection / float(np.sum(column**2))
    return tau, tau > 0.98 * longest, rest


def _tail_gain(t: Array, residual: Array, basis: Array, trial: Array) -> tuple[Array, Array, Array]:
    """Sum of squares that a tail of each trial time constant takes off the residual."""
    tail = np.exp(-(t - t[0])[:, None] / trial)
    tail -= basis @ (basis.T @ tail)
    size = np.sum(tail * tail, axis=0)
    projection = tail.T @ residual
    gain = np.sum(projection**2, axis=1) / np.maximum(size, 1e-9 * t.size)
    return gain, tail, projection


@dataclass(frozen=True, slots=True)
class _Scheme:
    """Linear part of the least squares: ``coefficients = inverse @ samples``."""

    inverse: Array
    q: Array


def _solve(
    t: Array, tensions: Array, used: Mask, terms: _Terms, drift: bool
) -> tuple[SlidingFit, _Scheme]:
    """Least squares with the chosen terms."""
    origin = float(t[used][0])
    columns = _linear_columns(t, terms.lines, drift)
    n_ripple = 2 * len(terms.lines)
    has_tail = np.isfinite(terms.tau)
    if has_tail:
        decay = np.exp(-(t - origin) / terms.tau)
        columns = np.column_stack([columns, decay])
    q, r = np.linalg.qr(columns[used])
    inverse = np.linalg.solve(r, q.T)
    coefficients = inverse @ tensions[used]
    waves = coefficients[1 : 1 + n_ripple]
    fit = SlidingFit(
        t_0=origin,
        levels=coefficients[0],
        tail=coefficients[-1] if has_tail else np.zeros(2),
        tau=terms.tau,
        tau_at_bound=terms.at_bound,
        drift=coefficients[1 + n_ripple] if drift else np.zeros(2),
        lines=terms.lines,
        ripple_N=np.hypot(waves[0], waves[1]) if n_ripple else np.zeros(2),
        used=used,
        residual=tensions - columns @ coefficients,
        ripple=columns[:, 1 : 1 + n_ripple] @ waves,
        log_ratio_se=float("nan"),
        start_log_ratio_se=float("nan"),
        correlation_time=1.0,
        drift_score=0.0,
    )
    return fit, _Scheme(inverse, q)


def _with_errors(fit: SlidingFit, scheme: _Scheme, t: Array, sigma: Array) -> SlidingFit:
    """Standard errors of both log ratios, for samples correlated in time and between channels.

    The covariance of the channels is that of the residuals; the integrated autocorrelation time of
    the residual of ln(T_tight/T_slack) inflates it.
    """
    start = fit.levels + fit.tail
    if not np.all(fit.levels > 0.0):
        return fit
    residual = fit.residual[fit.used]
    series = residual @ (np.array([1.0, -1.0]) / fit.levels)
    n, n_terms = series.size, scheme.inverse.shape[0] + int(np.isfinite(fit.tau))
    time = _correlation_time(series, n_terms)
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
        drift_score=_drift_score(t[fit.used], series, scheme.q, slope, fit.levels),
    )


def _correlation_time(series: Array, n_terms: int) -> float:
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


def _drift_score(t: Array, series: Array, q: Array, slope: Array | None, levels: Array) -> float:
    """Score of a linear drift added to the model, for white noise (standard normal without one)."""
    column = (t - np.mean(t)) / float(t[-1] - t[0])
    if slope is not None:
        extra = slope @ (np.array([1.0, -1.0]) / levels)
        extra -= q @ (q.T @ extra)
        size = float(np.linalg.norm(extra))
        if size > 0.0:
            q = np.column_stack([q, extra / size])
    column -= q @ (q.T @ column)
    size = float(np.linalg.norm(column))
    if size < 1e-3 * np.sqrt(t.size):
        return 0.0
    return float(column @ series) / size / max(float(np.std(series)), NOISE_FLOOR)


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

"""Fit the model of the sliding phase: which terms a record calls for, and their values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.identify.estimators.signal import (
    exponentials,
    line_columns,
    median,
    parabolic_maximum,
    robust_sigma,
    strongest_line,
    sums_of_squares,
)
from beltid.identify.friction.sliding_errors import LinearScheme, with_errors
from beltid.identify.friction.sliding_model import SlidingFit

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAX_LINES = 3
COARSE = np.linspace(0.0, 1.0, 24)
FINE = np.linspace(0.0, 1.0, 7)
"""Trial time constants, as fractions of the logarithmic range."""
LONGEST_TAIL = 0.5
"""Longest time constant over the length of the record: a longer tail looks like a drift."""
SIGNIFICANT_TAIL = 12.0
"""Least gain of the tail in sums of squared noise (chi-square, about 3 degrees of freedom)."""


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
    return with_errors(*fit_without_errors(t, tensions, sigma, drift=drift), t, sigma)


def fit_without_errors(
    t: Array, tensions: Array, sigma: Array, *, drift: bool = False
) -> tuple[SlidingFit, LinearScheme]:
    """The same without standard errors, and what `with_errors` needs to tell them."""
    used = plausible_samples(tensions, sigma)
    for _ in range(4):
        terms = _select_terms(t[used], np.compress(used, tensions, axis=0) / sigma, drift)
        fit, scheme = _solve(t, tensions, used, terms, drift)
        spread = np.array([robust_sigma(fit.residual[used, c]) for c in (0, 1)])
        limit = 6.0 * np.maximum(spread, sigma)
        kept = np.logical_and(*(np.abs(fit.residual) <= limit).T)
        if np.count_nonzero(kept) < max(8, used.size // 3) or np.array_equal(kept, used):
            break
        used = kept
    return fit, scheme


def plausible_samples(tensions: Array, sigma: Array) -> Mask:
    """Samples near the median of their channel: starts the rejection of long drop-outs."""
    middle = np.array([median(column) for column in tensions.T])
    deviation = np.abs(tensions - middle)
    spread = np.maximum([1.5 * median(column) for column in deviation.T], sigma)
    near = np.logical_and(*(deviation <= 8.0 * spread + 0.15 * np.abs(middle)).T)
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
        noise = np.sqrt(sums_of_squares(residual.T) / t.size)
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
    shortest = min(1.5 * length / t.size, 0.5 * longest)
    trial = shortest * (longest / shortest) ** COARSE
    gain = _tail_gain(t, residual, basis, trial)
    k = int(np.argmax(gain))
    near = trial[max(k - 1, 0)], trial[min(k + 1, trial.size - 1)]
    fine = near[0] * (near[1] / near[0]) ** FINE
    fine_gain = _tail_gain(t, residual, basis, fine)
    tau = float(np.exp(parabolic_maximum(np.log(fine), fine_gain)))
    best = float(_tail_gain(t, residual, basis, np.array([tau]))[0])
    noise = (float(np.sum(residual**2)) - best) / max(residual.size - 4, 1)
    if best < SIGNIFICANT_TAIL * max(noise, 1e-4):
        return float("nan"), False, residual
    column = np.exp(-(t - t[0]) / tau)
    column -= basis @ (basis.T @ column)
    rest = residual - np.outer(column, column @ residual / float(column @ column))
    return tau, tau > 0.98 * longest, rest


def _tail_gain(t: Array, residual: Array, basis: Array, trial: Array) -> Array:
    """Sum of squares that a tail of each trial time constant takes off the residual."""
    tail = exponentials(trial, t - t[0])
    # the residual is orthogonal to the basis: only the size of a tail needs what is left of it
    size = sums_of_squares(tail) - sums_of_squares(tail @ basis)
    return sums_of_squares(tail @ residual) / np.maximum(size, 1e-9 * t.size)


def _solve(
    t: Array, tensions: Array, used: Mask, terms: _Terms, drift: bool
) -> tuple[SlidingFit, LinearScheme]:
    """Least squares with the chosen terms."""
    origin = float(t[used][0])
    columns = _linear_columns(t, terms.lines, drift)
    n_ripple = 2 * len(terms.lines)
    has_tail = np.isfinite(terms.tau)
    if has_tail:
        decay = np.exp(-(t - origin) / terms.tau)
        columns = np.column_stack([columns, decay])
    q, r = np.linalg.qr(np.compress(used, columns, axis=0))
    inverse = np.linalg.inv(r) @ q.T
    coefficients = inverse @ np.compress(used, tensions, axis=0)
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
    return fit, LinearScheme(inverse, q)

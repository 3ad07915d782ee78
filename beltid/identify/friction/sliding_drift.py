"""Drift of the sliding phase: of friction, of a load cell, or of the belt.

A slow tail of the sticking peak and a drift may pass for each other. What tells them apart is the
direction in which both tensions move.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from beltid.identify.estimators.signal import NOISE_FLOOR, column_spread
from beltid.identify.friction.sliding import fit_sliding
from beltid.identify.friction.sliding_model import SlidingFit

Array = NDArray[np.float64]

SUSPECTED_DRIFT = 2.0
"""Score from which on a fit with a drift is tried as a rival of a tail."""
SCREENED_DRIFT = 3.0
"""Score from which on it may take the place of the fit."""
SLOW_TAIL = 0.2
"""Time constant over the length of the record from which on a tail may be a drift."""
AS_GOOD_AS_A_TAIL = 6.0
NO_TAIL_MOVES_SO = 3.0
"""A rival may leave so much more than the fit, in sums of squared noise, and must move in a
direction in which no tail moves, by these log odds."""
SIGNIFICANT_DRIFT = 14.0
"""Least gain of a drift in sums of squared noise (chi-square, two degrees of freedom: 1e-3)."""
VISIBLE_DRIFT = 1.0e-3
"""Least relative change of ln(T_tight/T_slack) by a drift that is fitted."""
LEAST_TIGHT = 0.8
"""Least change of the tight tension by friction over that of the slack one."""


def with_drift_if_called_for(
    t: Array, tensions: Array, sigma: Array, fit: SlidingFit
) -> tuple[SlidingFit, SlidingFit | None]:
    """The fit itself, or one with a drift if the record shows one; and the latter as a rival.

    A slow tail and a drift may pass for each other. Where the directions of the tensions speak for
    a drift, the fit with one is the rival of the tail.
    """
    if t.size < 16 or not np.all(fit.levels > 0.0):
        return fit, None
    length = float(t[-1] - t[0])
    slow = fit.tau > SLOW_TAIL * length
    score = abs(fit.drift_score)
    if not (slow or score > SUSPECTED_DRIFT):
        return fit, None
    other = fit_sliding(t, tensions, sigma, drift=True)
    rate = drift_rate(other) if np.all(other.levels > 0.0) else 0.0
    if abs(rate) * length < VISIBLE_DRIFT * abs(other.log_ratio):
        return fit, None
    both = fit.used & other.used
    plain, drifting = (float(np.sum((f.residual[both] / sigma) ** 2)) for f in (fit, other))
    # judged by the residual that the drift leaves: without it the drift itself looks like noise
    # with a long memory
    unit = drifting / (2.0 * np.count_nonzero(both)) * other.correlation_time
    called_for = score > SCREENED_DRIFT and plain - drifting > SIGNIFICANT_DRIFT * unit
    if called_for or (fit.tau_at_bound and drifting < plain):
        return other, other
    as_good = drifting - plain < AS_GOOD_AS_A_TAIL * unit
    is_rival = as_good and odds_of_a_cell(t, other) > NO_TAIL_MOVES_SO
    return fit, (other if is_rival else None)


def drift_rate(fit: SlidingFit) -> float:
    """Drift of ln(T_tight/T_slack) [1/s]."""
    return float(fit.drift[0] / fit.levels[0] - fit.drift[1] / fit.levels[1])


def settled_levels(
    t: Array, fit: SlidingFit, start_s: float, elapsed: float
) -> tuple[Array, float]:
    """Levels at the middle of the steady window, and the error of ln(T_tight/T_slack)."""
    rate = drift_rate(fit)
    over_window = rate * (float(t[-1]) - start_s)
    # the drift counts from the middle of the record, the plateau from that of the window
    levels = fit.levels + fit.drift * 0.5 * (start_s - float(t[0]))
    # friction may have changed, or a cell since it was right: either is as likely
    since = rate * elapsed / np.sqrt(2.0)
    se = float(np.linalg.norm([fit.log_ratio_se, over_window / np.sqrt(12.0), since]))
    return levels, se


def odds_of_a_cell(t: Array, fit: SlidingFit) -> float:
    """Logarithm of the odds that the drift of a fit is no slow tail, from its direction.

    Friction that falls or rises moves the tensions in opposite directions, the tight one by more:
    both ends are held, and bending and contact raise the sum of the tensions with the friction
    (by 1.04 times as much and more on simulated rigs of all kinds). A drift outside of these
    directions is one of a cell or of the belt.
    """
    noise = _drift_noise(t, fit)
    # friction moves between these two directions, forth or back; in units of the noise
    edges = np.array([[1.0, 0.0], [LEAST_TIGHT * noise[1] / noise[0], -1.0]])
    edges /= np.linalg.norm(edges, axis=1)[:, None]
    move = fit.drift / noise
    cross = edges[:, 0] * move[1] - edges[:, 1] * move[0]
    if cross[0] * cross[1] <= 0.0:
        return 0.0
    return 0.5 * float(move @ move - np.max((edges @ move) ** 2))


def rate_se(t: Array, fit: SlidingFit) -> float:
    """Standard error of the drift of ln(T_tight/T_slack) [1/s]."""
    return float(np.linalg.norm(_drift_noise(t, fit) / fit.levels))


def _drift_noise(t: Array, fit: SlidingFit) -> Array:
    """Standard errors of the drift of both tensions beside a tail [N/s], > 0, shape (2,)."""
    column = t[fit.used] - np.mean(t[fit.used])
    tail = fit.decay(t[fit.used])
    if np.any(tail):
        tail = tail - np.mean(tail)
        column = column - tail * float(tail @ column) / float(tail @ tail)
    noise = column_spread(np.compress(fit.used, fit.residual, axis=0))
    noise = noise * np.sqrt(fit.correlation_time)
    return np.maximum(noise, NOISE_FLOOR * fit.levels) / float(np.linalg.norm(column))

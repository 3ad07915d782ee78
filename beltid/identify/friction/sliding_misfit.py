"""What a fit of the sliding phase leaves unexplained."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.identify.estimators.signal import converter_error, difference_sigma, median
from beltid.identify.friction.sliding_model import SlidingFit

Array = NDArray[np.float64]

GOES_ON = 0.25
"""A rise goes on if a later slope may reach this part of its rate."""


def misfit(fit: SlidingFit, sigma: Array) -> float:
    """Variance of the block means of the residual over what white noise gives (about 1)."""
    series = fit.log_residual[fit.used]
    blocks = min(12, series.size // 4)
    if blocks < 2:
        return 0.0
    size = series.size // blocks
    means = np.mean(series[-size * blocks :].reshape(blocks, size), axis=1)
    white = float(np.hypot(*(sigma / fit.levels)))
    return float(np.mean(means**2)) * size / white**2


def rise_before(t_early: Array, early: Array, t: Array, fit: SlidingFit) -> float:
    """Least rise of ln(T_tight/T_slack) from samples before the fit to its level [-].

    A tail before the fit lies above the level: a rise is no tail, but a drift that was left out,
    unless the second half of the fit shows that it does not go on (the belt swings in a simulated
    start, or seats).

    Parameters
    ----------
    t_early, early : ndarray
        Times [s], shape (m,), and tensions [N], shape (m, 2), before the fit.
    t : ndarray
        Times of the samples that were fitted [s], shape (n,).
    fit : SlidingFit
        The fit.
    """
    high, low = (median(column) for column in early.T) if early.shape[0] >= 8 else (0.0, 0.0)
    if not (min(high, low) > 0.0 and np.all(fit.levels > 0.0)):
        return 0.0
    rise = fit.log_ratio - float(np.log(high / low))
    spread = float(np.std(fit.log_residual[fit.used])) / np.sqrt(early.shape[0])
    least = rise - 4.0 * float(np.hypot(1.25 * spread, fit.log_ratio_se))
    if least <= 0.0 or np.any(fit.drift):
        return least
    rate = least / float(np.mean(t) - np.mean(t_early))
    return 0.0 if _largest_slope(t, fit) < GOES_ON * rate else least


def _largest_slope(t: Array, fit: SlidingFit) -> float:
    """Largest slope of ln(T_tight/T_slack), tail included, in the second half of a fit [1/s]."""
    half = np.flatnonzero(fit.used)[np.count_nonzero(fit.used) // 2 :]
    if half.size < 8:
        return float("inf")
    run = t[half] - np.mean(t[half])
    y = (fit.log_residual + fit.tail_at(t))[half]
    size = float(run @ run)
    slope = float(run @ y) / size
    rest = y - np.mean(y) - slope * run
    se = float(np.sqrt(np.mean(rest**2) * fit.correlation_time / size))
    return slope + 3.0 * se


def rounding_se(tensions: Array, fit: SlidingFit, per_block: int, step: ArrayLike) -> float:
    """Error of ln(T_tight/T_slack) by coarse converters [-]."""
    if not np.any(step):
        return 0.0
    # the residual of block means hides the noise of the samples
    noise = (
        np.array([difference_sigma(column) for column in tensions.T])
        if per_block > 1
        else np.std(fit.residual[fit.used], axis=0)
    )
    return float(np.linalg.norm(converter_error(noise, step) / fit.levels))

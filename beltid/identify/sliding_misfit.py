"""What a fit of the sliding phase leaves unexplained."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.identify.signal import converter_error, difference_sigma, median
from beltid.identify.sliding_model import SlidingFit

Array = NDArray[np.float64]


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


def rise_before(early: Array, fit: SlidingFit) -> float:
    """Least rise of ln(T_tight/T_slack) from samples before the fit to its level [-].

    A tail before the fit lies above the level: a rise is no tail, but a drift that was left out.
    """
    high, low = (median(column) for column in early.T) if early.shape[0] >= 8 else (0.0, 0.0)
    if not (min(high, low) > 0.0 and np.all(fit.levels > 0.0)):
        return 0.0
    rise = fit.log_ratio - float(np.log(high / low))
    spread = float(np.std(fit.log_residual[fit.used])) / np.sqrt(early.shape[0])
    return rise - 4.0 * float(np.hypot(1.25 * spread, fit.log_ratio_se))


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

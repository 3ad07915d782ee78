"""The sticking peak: what the tail of the sliding phase says about where it starts.

The largest measured sample is a biased estimate: of many noisy samples near a flat maximum it picks
the noisiest. The model of the sliding phase, fitted to all of it, is followed back to the
moment at which the record leaves the build-up and joins it; that moment is known to one sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.identify.estimators.signal import channel_noise
from beltid.identify.friction.plateau import Plateau
from beltid.identify.friction.sliding_model import SlidingFit

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class StickingPeak:
    """Peak of ln(T_tight/T_slack), or why the record does not tell it."""

    log_ratio: float
    """ln(T_tight/T_slack) at the peak [-]; nan where the record does not resolve it."""
    log_ratio_se: float
    """Standard error with the uncertainty of the moment of the peak [-]."""
    time_s: float
    """Moment of the peak [s]; nan where it is not found."""
    reason: str
    """Why there is no value; empty if there is one."""


def unresolved(reason: str, time_s: float = float("nan")) -> StickingPeak:
    """A peak that the record does not resolve."""
    return StickingPeak(float("nan"), float("nan"), time_s, reason)


def sticking_peak(
    t: Array, tensions: Array, first: int, slide: int, plateau: Plateau, max_error: float
) -> StickingPeak:
    """Find the sticking peak from the model of the sliding phase.

    Parameters
    ----------
    t : ndarray
        Times of the usable samples [s], shape (n,).
    tensions : ndarray
        Tight and slack tension [N], finite, > 0, shape (n, 2).
    first : int
        Index of the first sample at which the pulley turns.
    slide : int
        Index at which the sliding phase was taken to start.
    plateau : Plateau
        The settled state.
    max_error : float
        Largest standard error of the peak, relative to ln(T_tight/T_slack), that still resolves it.
    """
    fit = plateau.fit
    if not np.isfinite(fit.tau):
        return unresolved("no peak stands out of the plateau")
    if not plateau.from_start:
        return unresolved("the tensions do not decay exponentially from the peak")
    if float(fit.tail_at(float(t[slide]))) <= 0.0:
        return unresolved("the tensions approach the plateau from below: no peak")
    noise = channel_noise(tensions[slide:])
    # the ripple is only known from the fitted samples on: allow for its amplitude
    limit = 3.0 * noise + fit.ripple_N
    join = _joins_model(t, tensions, slice(first, slide), fit, limit)
    if join > 0 and not _lies_below(t[join - 1], tensions[join - 1], fit):
        return unresolved("the tensions do not decay exponentially from the peak")
    travelled = float(t[join] - t[max(first - 1, 0)])
    climbed = np.abs(fit.levels + fit.tail - np.mean(tensions[:first], axis=0))
    margin_s = travelled * float(np.min(limit / np.maximum(climbed, limit)))
    return _judged(t, join, plateau, margin_s, max_error)


def _joins_model(t: Array, tensions: Array, stretch: slice, fit: SlidingFit, limit: Array) -> int:
    """Index of the first sample of the unbroken end of `stretch` that the model describes."""
    model = fit.levels + fit.tail * fit.decay(t[stretch])[:, None]
    off = np.flatnonzero(np.any(np.abs(tensions[stretch] - model) > limit, axis=1))
    return int(stretch.start) + (int(off[-1]) + 1 if off.size else 0)


def _lies_below(t: float, tensions: Array, fit: SlidingFit) -> bool:
    """Whether a sample is on the build-up, below the tail of the peak."""
    if not np.all(tensions > 0.0):
        return bool(tensions[0] < tensions[1])
    return float(np.log(tensions[0] / tensions[1])) < fit.log_ratio + float(fit.tail_at(t))


def _judged(
    t: Array, join: int, plateau: Plateau, margin_s: float, max_error: float
) -> StickingPeak:
    """Peak between the last sample of the build-up and the first one on the tail.

    Noise may hide the end of the build-up in the tail: the moment is uncertain by `margin_s`, too.
    """
    fit = plateau.fit
    before = float(t[max(join - 1, 0)])
    moment = 0.5 * (before + float(t[join]))
    peak = fit.log_ratio + float(fit.tail_at(moment))
    rate = abs(float(fit.tail_at(before) - fit.tail_at(float(t[join])))) / max(
        float(t[join]) - before, 1e-12
    )
    timing = rate * np.hypot(float(t[join]) - before, margin_s) / np.sqrt(12.0)
    se = float(np.linalg.norm([timing, fit.start_log_ratio_se, plateau.systematic_se]))
    if peak - fit.log_ratio < 3.0 * se and timing < se / 2.0:
        return unresolved("no peak stands out of the plateau", moment)
    if not se <= max_error * peak:
        return unresolved(
            f"the samples leave the peak uncertain by {100 * se / peak:.2g} %, "
            f"allowed is {100 * max_error:g} %",
            moment,
        )
    return StickingPeak(peak, se, moment, "")

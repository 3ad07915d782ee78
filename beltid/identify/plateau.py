"""The sliding plateau of a run: where it is steady, and the level it settles at."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.identify.rest_phase import SetAsideError
from beltid.identify.signal import (
    THINNED_SAMPLES,
    block_means,
    channel_noise,
    median,
    robust_sigma,
)
from beltid.identify.sliding import fit_sliding, plausible_samples
from beltid.identify.sliding_misfit import misfit, rise_before, rounding_se
from beltid.identify.sliding_model import SlidingFit
from beltid.identify.sliding_tail_fit import weigh_tails
from beltid.identify.sliding_tails import Tails
from beltid.identify.steady_window import steady_window

Array = NDArray[np.float64]

LATER_STARTS = (0.0, 0.12, 0.25, 0.4, 0.55)
"""Starts of the fit over the length of the sliding phase, tried until the model fits."""
ADEQUATE = 3.0
"""Largest misfit (see `misfit`) of a model that is adequate for white noise."""
SAME_MISFIT = 4.0
"""Misfits within this factor tell nothing but the memory of the noise."""
TAIL_AT_END = 2.0
"""Largest tail at the end of the record, in units of the tolerance: the fit takes it off."""
SCREENED_DRIFT = 3.0
"""Score from which on a fit with a drift is tried."""
SIGNIFICANT_DRIFT = 14.0
"""Least gain of a drift in sums of squared noise (chi-square, two degrees of freedom: 1e-3)."""
VISIBLE_DRIFT = 1.0e-3
"""Least relative change of ln(T_tight/T_slack) by a drift that is fitted."""
HIDDEN_TAIL_START = 0.25
"""Part of the sliding phase left out where noise may hide a tail."""


@dataclass(frozen=True, slots=True)
class PlateauCriteria:
    """What counts as settled; the fields of the same names in the settings of the reduction."""

    steady_tolerance: float
    max_drift: float
    min_samples: int
    min_fraction: float


@dataclass(frozen=True, slots=True)
class Plateau:
    """The settled state of a run."""

    fit: SlidingFit
    """Model of the sliding phase, of block means if the record is long."""
    from_start: bool
    """Whether one model describes the sliding phase from its very start."""
    start_s: float
    """Start of the steady window [s]; it lasts to the end of the sliding phase."""
    rejected: NDArray[np.bool_]
    """Samples of the sliding phase left out as outliers, shape (n,)."""
    levels: Array
    """Tight and slack tension of the plateau [N]: without tail and ripple, with a drift at the
    middle of the steady window, shape (2,)."""
    log_ratio_se: float
    """Standard error of ln(T_tight/T_slack) if the fit has the right terms [-]."""
    tail_left: float
    """Relative part of the tail in ln(T_tight/T_slack) at the end of the record [-]."""
    systematic_se: float
    """Standard error of ln(T_tight/T_slack) by coarse converters [-]."""
    drift: float
    """Relative change of ln(T_tight/T_slack) by drift over the sliding phase [-]."""
    tails: Tails
    """ln(T_tight/T_slack) of the plateau for tails of other shapes."""


def settle(
    t: Array, tensions: Array, criteria: PlateauCriteria, step: ArrayLike = (0.0, 0.0)
) -> Plateau:
    """Level and steady window of a sliding phase, with a tail of one exponential.

    What a slower tail would change is in `Plateau.tails`.

    Parameters
    ----------
    t : ndarray
        Times [s] from the end of the build-up on, non-decreasing, shape (n,).
    tensions : ndarray
        Tight and slack tension [N], finite, > 0, shape (n, 2).
    criteria : PlateauCriteria
        What counts as settled.
    step : array_like
        Steps of the converters of both cells [N], zero if they are fine, shape (2,).

    Raises
    ------
    SetAsideError
        If the tensions do not settle.
    """
    fewest = max(criteria.min_samples, 8)
    if t.size < fewest:
        raise SetAsideError(f"too short: {t.size} usable samples of sliding, must be >= {fewest}")
    near = np.arange(t.size)
    if t.size > THINNED_SAMPLES:  # drop-outs would get lost in the block means
        near = np.flatnonzero(plausible_samples(tensions, channel_noise(tensions)))
    thin = block_means(np.column_stack([t, tensions])[near])
    per_block = -(-near.size // thin.shape[0])
    time, values = thin[:, 0], thin[:, 1:]
    sigma = channel_noise(values)
    fit, start = _adequate_fit(time, values, sigma, fewest)
    before = slice(start // 3, start)
    early = time[before], values[before]
    time, values = time[start:], values[start:]
    fit = _with_drift_if_called_for(time, values, sigma, fit)
    if not fit.log_ratio > 0.0:
        raise SetAsideError("the tensions do not settle at two positive values")
    start_s = max(
        _steady_from(time, values, fit, criteria, per_block), _tail_steady_from(time, fit, criteria)
    )
    rejected = np.ones(t.size, dtype=bool)
    rejected[near] = False
    fitted = near[start * per_block :]
    rejected[fitted[~np.repeat(fit.used, per_block)[: fitted.size]]] = True
    whole = float(t[-1] - t[0])
    missed = rise_before(*early, time, fit) / fit.log_ratio
    found = _judged(time, fit, start_s, rejected, criteria, whole=whole, missed=missed)
    rounding = rounding_se(tensions[near][start * per_block :], fit, per_block, step)
    return replace(found, systematic_se=rounding)


def _steady_from(
    t: Array, tensions: Array, fit: SlidingFit, criteria: PlateauCriteria, per_block: int
) -> float:
    """Start of the steady window of ln(T_tight/T_slack) without its ripple [s]."""
    signal = _without_ripple(tensions, fit)
    valid = fit.used & np.isfinite(signal)
    window = steady_window(
        t[valid],
        signal[valid],
        criteria.steady_tolerance * fit.log_ratio,
        min_samples=-(-criteria.min_samples // per_block),
        min_fraction=criteria.min_fraction,
    )
    if window is None:
        raise SetAsideError(_why_not_steady(t[valid], signal[valid], criteria))
    return float(t[valid][window.first])


def _tail_steady_from(t: Array, fit: SlidingFit, criteria: PlateauCriteria) -> float:
    """Time from which the fitted tail changes within the tolerance [s]: noise may hide it."""
    tail = np.asarray(fit.tail_at(t))
    moving = np.flatnonzero(np.abs(tail - tail[-1]) > criteria.steady_tolerance * fit.log_ratio)
    return float(t[moving[-1] + 1] if moving.size else t[0])


def _adequate_fit(t: Array, tensions: Array, sigma: Array, fewest: int) -> tuple[SlidingFit, int]:
    """Fit from the earliest start from which one exponential tail describes the record.

    The tail of a real peak need not be one exponential from its very start. Noise with a memory
    looks like a misfit, too, but the same from every start: then nothing is gained by a later one.
    """
    tried: list[tuple[float, SlidingFit, int]] = []
    for fraction in LATER_STARTS:
        start = int(fraction * t.size)
        if tried and t.size - start < fewest:
            break
        fit = fit_sliding(t[start:], tensions[start:], sigma)
        tried.append((misfit(fit, sigma), fit, start))
        if tried[-1][0] < ADEQUATE:
            break
    least = min(size for size, _, _ in tried)
    limit = max(SAME_MISFIT * least, ADEQUATE)
    _, fit, start = next(entry for entry in tried if entry[0] <= limit)
    hidden = int(HIDDEN_TAIL_START * t.size)
    unseen = not np.isfinite(fit.tau) and fit.log_ratio_se > 5e-4 * abs(fit.log_ratio)
    if unseen and start < hidden and t.size - hidden >= fewest:
        return fit_sliding(t[hidden:], tensions[hidden:], sigma), hidden
    return fit, start


def _with_drift_if_called_for(
    t: Array, tensions: Array, sigma: Array, fit: SlidingFit
) -> SlidingFit:
    """The fit itself, or one with a drift if the record shows one."""
    if t.size < 16 or not np.all(fit.levels > 0.0):
        return fit
    if not (fit.tau_at_bound or abs(fit.drift_score) > SCREENED_DRIFT):
        return fit
    other = fit_sliding(t, tensions, sigma, drift=True)
    if not np.all(other.levels > 0.0):
        return fit
    both = fit.used & other.used
    plain, drifting = (float(np.sum((f.residual[both] / sigma) ** 2)) for f in (fit, other))
    if fit.tau_at_bound:
        return other if drifting < plain else fit
    rate = float(other.drift[0] / other.levels[0] - other.drift[1] / other.levels[1])
    if abs(rate) * float(t[-1] - t[0]) < VISIBLE_DRIFT * abs(other.log_ratio):
        return fit
    # judged by the residual that the drift leaves: without it the drift itself looks like noise
    # with a long memory
    unit = drifting / (2.0 * np.count_nonzero(both)) * other.correlation_time
    return other if plain - drifting > SIGNIFICANT_DRIFT * unit else fit


def _without_ripple(tensions: Array, fit: SlidingFit) -> Array:
    """ln(T_tight/T_slack) with the ripple taken off; nan where that is not positive."""
    plain = tensions - fit.ripple
    valid = np.all(plain > 0.0, axis=1)
    ratio = np.divide(plain[:, 0], plain[:, 1], out=np.full(valid.size, np.nan), where=valid)
    return np.log(ratio)


def _why_not_steady(t: Array, signal: Array, criteria: PlateauCriteria) -> str:
    """Reason for a record without a steady window, from the change over its last part."""
    n = max(4, int(max(criteria.min_fraction, 0.2) * t.size))
    time, last = t[-n:], signal[-n:]
    middle = median(last)
    span = float(time[-1] - time[0])
    change = 2.0 * (median(last[n // 2 :]) - median(last[: n // 2]))
    allowed = f"allowed is {100 * criteria.steady_tolerance:g} %"
    if abs(change) > criteria.steady_tolerance * abs(middle):
        direction = "rises" if change > 0.0 else "falls"
        size = 100 * abs(change / middle)
        return f"never settles: mu still {direction} by {size:.2g} % over {span:.3g} s, {allowed}"
    spread = 100 * robust_sigma(last) / abs(middle)
    return f"never settles: no steady window, mu wanders (spread {spread:.2g} %), {allowed}"


def _judged(
    t: Array,
    fit: SlidingFit,
    start_s: float,
    rejected: NDArray[np.bool_],
    criteria: PlateauCriteria,
    *,
    whole: float,
    missed: float,
) -> Plateau:
    """Levels of the plateau, or the reason why they are not to be trusted.

    `whole` is the length of the sliding phase, also where the fit starts later [s], and `missed`
    the relative rise of ln(T_tight/T_slack) before that start.
    """
    end = float(t[-1])
    tail_end = float(fit.tail_at(end)) / fit.log_ratio
    allowed = TAIL_AT_END * criteria.steady_tolerance
    if not abs(tail_end) < allowed:
        direction = "falls" if tail_end > 0.0 else "rises"
        raise SetAsideError(
            f"never settles: mu still {direction} at the end, {100 * abs(tail_end):.2g} % away "
            f"from its plateau, allowed is {100 * allowed:g} %"
        )
    rate = float(fit.drift[0] / fit.levels[0] - fit.drift[1] / fit.levels[1])
    drift = rate * whole / fit.log_ratio
    if abs(drift) > criteria.max_drift:
        raise SetAsideError(
            f"drifts: mu changes by {100 * drift:+.2g} % over the sliding phase, "
            f"allowed is {100 * criteria.max_drift:g} %"
        )
    if missed > criteria.max_drift:
        raise SetAsideError(
            f"never settles: mu rises by {100 * missed:.2g} % while the belt slides, "
            f"allowed is {100 * criteria.max_drift:g} %"
        )
    over_window = rate * (end - start_s)
    # the drift counts from the middle of the record, the plateau from that of the window
    levels = fit.levels + fit.drift * 0.5 * (start_s - float(t[0]))
    log_ratio_se = float(np.hypot(fit.log_ratio_se, over_window / np.sqrt(12.0)))
    return Plateau(
        fit=fit,
        from_start=end - float(t[0]) > 0.95 * whole,
        start_s=start_s,
        rejected=rejected,
        levels=levels,
        log_ratio_se=log_ratio_se,
        tail_left=tail_end,
        systematic_se=0.0,
        drift=drift,
        tails=_tails(t, fit, float(np.log(levels[0] / levels[1])), log_ratio_se),
    )


def _tails(t: Array, fit: SlidingFit, log_ratio: float, log_ratio_se: float) -> Tails:
    """Plateau for tails of other shapes.

    A drift and a slow tail may pass for each other: a fit with a drift counts beside them.
    """
    tails = weigh_tails(t, fit)
    return tails.beside(log_ratio, log_ratio_se) if np.any(fit.drift) else tails

"""The sliding plateau of a run: where it is steady, and the level it settles at."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.identify.estimators.signal import (
    THINNED_SAMPLES,
    block_means,
    channel_noise,
    median,
    robust_sigma,
)
from beltid.identify.friction.rest_phase import SetAsideError
from beltid.identify.friction.sliding import fit_sliding, fit_without_errors, plausible_samples
from beltid.identify.friction.sliding_drift import (
    drift_rate,
    odds_of_a_cell,
    rate_se,
    settled_levels,
    with_drift_if_called_for,
)
from beltid.identify.friction.sliding_errors import LinearScheme, with_errors
from beltid.identify.friction.sliding_misfit import misfit, rise_before, rounding_se
from beltid.identify.friction.sliding_model import SlidingFit
from beltid.identify.friction.sliding_tail_fit import weigh_tails
from beltid.identify.friction.sliding_tails import Tails
from beltid.identify.friction.steady_window import steady_window

Array = NDArray[np.float64]

LATER_STARTS = (0.0, 0.12, 0.25, 0.4, 0.55)
"""Starts of the fit over the length of the sliding phase, tried until the model fits."""
ADEQUATE = 3.0
"""Largest misfit (see `misfit`) of a model that is adequate for white noise."""
SAME_MISFIT = 4.0
"""Misfits within this factor tell nothing but the memory of the noise."""
TAIL_AT_END = 2.0
"""Largest tail at the end of the record, in units of the tolerance: the fit takes it off."""
CLEAR_DRIFT = 3.0
"""Standard errors from which on too large a drift sets a run aside."""
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
    tails: Tails | None = None
    """ln(T_tight/T_slack) of the plateau for tails of other shapes."""


def settle(
    t: Array,
    tensions: Array,
    criteria: PlateauCriteria,
    step: ArrayLike = (0.0, 0.0),
    since_s: float | None = None,
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
    since_s : float, optional
        When the cells were last known to be right [s]; by default when the sliding starts.

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
    fit, rival = with_drift_if_called_for(time, values, sigma, fit)
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
    elapsed = 0.5 * (start_s + float(t[-1])) - (float(t[0]) if since_s is None else since_s)
    lengths = _Lengths(whole, elapsed, missed)
    found = _judged(time, fit, start_s, rejected, criteria, lengths)
    return replace(
        found,
        systematic_se=rounding_se(tensions[near][start * per_block :], fit, per_block, step),
        tails=_tails(time, fit, rival, start_s, elapsed),
    )


@dataclass(frozen=True, slots=True)
class _Lengths:
    """What the judgement needs to know beyond the fitted samples."""

    whole: float
    """Length of the sliding phase, also where the fit starts later [s]."""
    elapsed: float
    """Time from when the cells were right to the middle of the steady window [s]."""
    missed: float
    """Relative rise of ln(T_tight/T_slack) before the start of the fit [-]."""


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
    tried: list[tuple[float, SlidingFit, LinearScheme, int]] = []
    for fraction in LATER_STARTS:
        start = int(fraction * t.size)
        if tried and t.size - start < fewest:
            break
        fit, scheme = fit_without_errors(t[start:], tensions[start:], sigma)
        tried.append((misfit(fit, sigma), fit, scheme, start))
        if tried[-1][0] < ADEQUATE:
            break
    least = min(size for size, *_ in tried)
    limit = max(SAME_MISFIT * least, ADEQUATE)
    _, fit, scheme, start = next(entry for entry in tried if entry[0] <= limit)
    fit = with_errors(fit, scheme, t[start:], sigma)
    hidden = int(HIDDEN_TAIL_START * t.size)
    unseen = not np.isfinite(fit.tau) and fit.log_ratio_se > 5e-4 * abs(fit.log_ratio)
    if unseen and start < hidden and t.size - hidden >= fewest:
        return fit_sliding(t[hidden:], tensions[hidden:], sigma), hidden
    return fit, start


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
    lengths: _Lengths,
) -> Plateau:
    """Levels of the plateau, or the reason why they are not to be trusted."""
    whole, missed = lengths.whole, lengths.missed
    end = float(t[-1])
    tail_end = float(fit.tail_at(end)) / fit.log_ratio
    allowed = TAIL_AT_END * criteria.steady_tolerance
    if not abs(tail_end) < allowed:
        direction = "falls" if tail_end > 0.0 else "rises"
        raise SetAsideError(
            f"never settles: mu still {direction} at the end, {100 * abs(tail_end):.2g} % away "
            f"from its plateau, allowed is {100 * allowed:g} %"
        )
    drift = drift_rate(fit) * whole / fit.log_ratio
    doubt = rate_se(t, fit) * whole / fit.log_ratio if drift else 0.0
    if abs(drift) > max(criteria.max_drift, CLEAR_DRIFT * doubt):
        raise SetAsideError(
            f"drifts: mu changes by {100 * drift:+.2g} % over the sliding phase, "
            f"allowed is {100 * criteria.max_drift:g} %"
        )
    if missed > criteria.max_drift:
        raise SetAsideError(
            f"never settles: mu rises by {100 * missed:.2g} % while the belt slides, "
            f"allowed is {100 * criteria.max_drift:g} %"
        )
    levels, log_ratio_se = settled_levels(t, fit, start_s, lengths.elapsed)
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
    )


def _tails(
    t: Array, fit: SlidingFit, rival: SlidingFit | None, start_s: float, elapsed: float
) -> Tails:
    """Plateau for tails of other shapes; a fit with a drift counts beside them."""
    if rival is None:
        return weigh_tails(t, fit)
    levels, se = settled_levels(t, rival, start_s, elapsed)
    tails = weigh_tails(t, rival)
    if not np.all(levels > 0.0):
        return tails
    return tails.beside(float(np.log(levels[0] / levels[1])), se, odds_of_a_cell(t, rival))

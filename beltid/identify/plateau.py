"""The sliding plateau of a run: where it is steady, and the level it settles at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.identify.rest_phase import SetAsideError
from beltid.identify.signal import (
    NOISE_FLOOR,
    block_means,
    difference_sigma,
    median,
    robust_sigma,
)
from beltid.identify.sliding import SlidingFit, fit_sliding, plausible_samples
from beltid.identify.statistics import integrated_autocorrelation_time
from beltid.identify.steady_window import steady_window

Array = NDArray[np.float64]

LATER_STARTS = (0.0, 0.12, 0.25, 0.4, 0.55)
"""Starts of the fit over the length of the sliding phase, tried until the model fits."""
ADEQUATE = 3.5
"""Largest misfit (see `_misfit`) of an adequate model."""


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
    """Standard error of ln(T_tight/T_slack) [-]."""
    tail_part: float
    """Relative part of the tail in ln(T_tight/T_slack) where the steady window starts [-]."""
    drift: float
    """Relative change of ln(T_tight/T_slack) by drift over the fitted record [-]."""


def settle(t: Array, tensions: Array, criteria: PlateauCriteria) -> Plateau:
    """Level and steady window of a sliding phase.

    Parameters
    ----------
    t : ndarray
        Times [s] from the end of the build-up on, non-decreasing, shape (n,).
    tensions : ndarray
        Tight and slack tension [N], finite, > 0, shape (n, 2).
    criteria : PlateauCriteria
        What counts as settled.

    Raises
    ------
    SetAsideError
        If the tensions do not settle.
    """
    fewest = max(criteria.min_samples, 8)
    if t.size < fewest:
        raise SetAsideError(f"too short: {t.size} usable samples of sliding, must be >= {fewest}")
    near = np.flatnonzero(plausible_samples(tensions, channel_noise(tensions)))
    thin = block_means(np.column_stack([t, tensions])[near])
    per_block = -(-near.size // thin.shape[0])
    time, values = thin[:, 0], thin[:, 1:]
    sigma = channel_noise(values)
    fit, start = _adequate_fit(time, values, sigma, fewest)
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
    return _judged(time, fit, start_s, rejected, criteria, from_start=start == 0)


def channel_noise(tensions: Array) -> Array:
    """White noise of both tensions [N], with a floor for noise-free recordings, shape (2,)."""
    return np.array([max(difference_sigma(c), NOISE_FLOOR * median(np.abs(c))) for c in tensions.T])


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

    The tail of a real peak need not be one exponential from its very start. If no start is
    adequate (noise with a memory), the one with the least misfit is taken.
    """
    best: tuple[float, SlidingFit, int] | None = None
    for fraction in LATER_STARTS:
        start = int(fraction * t.size)
        if t.size - start < fewest:
            break
        fit = fit_sliding(t[start:], tensions[start:], sigma)
        misfit = _misfit(fit)
        if best is None or misfit < 0.5 * best[0]:
            best = (misfit, fit, start)
        if misfit < ADEQUATE:
            break
    assert best is not None  # the first start always has enough samples
    return best[1], best[2]


def _misfit(fit: SlidingFit) -> float:
    """Variance of the block means of the residual over what white noise gives (about 1)."""
    series = _log_residual(fit)[fit.used]
    blocks = min(8, series.size // 4)
    if blocks < 2:
        return 0.0
    size = series.size // blocks
    means = np.mean(series[: size * blocks].reshape(blocks, size), axis=1)
    sigma = max(difference_sigma(series), 2.0 * NOISE_FLOOR)
    return float(np.mean(means**2)) * size / sigma**2


def _log_residual(fit: SlidingFit) -> Array:
    """Residual of ln(T_tight/T_slack) to first order."""
    return fit.residual[:, 0] / fit.levels[0] - fit.residual[:, 1] / fit.levels[1]


def _with_drift_if_called_for(
    t: Array, tensions: Array, sigma: Array, fit: SlidingFit
) -> SlidingFit:
    """The fit itself, or one with a drift if the record shows one."""
    if t.size < 16 or not np.all(fit.levels > 0.0):
        return fit
    series = _log_residual(fit)[fit.used]
    time = t[fit.used] - np.mean(t[fit.used])
    power = float(np.sum(time**2))
    slope = float(time @ series) / power
    spread = max(float(np.std(series)), NOISE_FLOOR)
    se = spread * np.sqrt(integrated_autocorrelation_time(series) / power)
    length = float(t[-1] - t[0])
    visible = abs(slope) * length > 1e-3 * abs(fit.log_ratio)
    if not fit.tau_at_bound and not (visible and abs(slope) > 4.0 * se):
        return fit
    other = fit_sliding(t, tensions, sigma, drift=True)
    misfits = [float(np.sum((f.residual[f.used] / sigma) ** 2)) for f in (fit, other)]
    return other if misfits[1] < misfits[0] else fit


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
    from_start: bool,
) -> Plateau:
    """Levels of the plateau, or the reason why they are not to be trusted."""
    end = float(t[-1])
    tail_end = float(fit.tail_at(end)) / fit.log_ratio
    if not abs(tail_end) < criteria.steady_tolerance:
        direction = "falls" if tail_end > 0.0 else "rises"
        raise SetAsideError(
            f"never settles: mu still {direction} at the end, {100 * abs(tail_end):.2g} % away "
            f"from its plateau, allowed is {100 * criteria.steady_tolerance:g} %"
        )
    rate = float(fit.drift[0] / fit.levels[0] - fit.drift[1] / fit.levels[1])
    drift = rate * (end - float(t[0])) / fit.log_ratio
    if abs(drift) > criteria.max_drift:
        raise SetAsideError(
            f"drifts: mu changes by {100 * drift:+.2g} % over the sliding phase, "
            f"allowed is {100 * criteria.max_drift:g} %"
        )
    over_window = rate * (end - start_s)
    return Plateau(
        fit=fit,
        from_start=from_start,
        start_s=start_s,
        rejected=rejected,
        # the drift counts from the middle of the record, the plateau from that of the window
        levels=fit.levels + fit.drift * 0.5 * (start_s - float(t[0])),
        log_ratio_se=float(np.hypot(fit.log_ratio_se, over_window / np.sqrt(12.0))),
        tail_part=float(fit.tail_at(start_s)) / fit.log_ratio,
        drift=drift,
    )

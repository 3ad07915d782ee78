"""The sliding plateau of a run: where it is steady, and the level it settles at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.identify.rest_phase import SetAsideError
from beltid.identify.signal import NOISE_FLOOR, difference_sigma
from beltid.identify.sliding import SlidingFit, fit_sliding
from beltid.identify.statistics import integrated_autocorrelation_time, mad_sigma

Array = NDArray[np.float64]

BLOCKS = 24
LATER_STARTS = (0.0, 0.12, 0.25, 0.4, 0.55)
"""Starts of the fit over the length of the sliding phase, tried until the model fits."""
ADEQUATE = 3.5
"""Largest misfit (see `_misfit`) of an adequate model."""


@dataclass(frozen=True, slots=True)
class SteadyWindow:
    """Window over which a signal is steady."""

    first: int
    """Index of its first sample; it lasts to the end of the signal."""
    change: float
    """Robust slope times length, in the unit of the signal."""


@dataclass(frozen=True, slots=True)
class PlateauCriteria:
    """What counts as settled; the fields of the same names in the settings of the reduction."""

    steady_tolerance: float
    max_drift: float
    min_samples: int
    min_fraction: float


@dataclass(frozen=True, slots=True)
class Plateau:
    """The settled state of a run. Indices count samples of the sliding phase."""

    fit: SlidingFit
    """Model fitted to the samples from `fit_start` on."""
    fit_start: int
    first: int
    """First sample of the steady window; it lasts to the end of the sliding phase."""
    levels: Array
    """Tight and slack tension of the plateau [N]: without tail and ripple, with a drift at the
    middle of the steady window, shape (2,)."""
    log_ratio_se: float
    """Standard error of ln(T_tight/T_slack) [-]."""
    tail_part: float
    """Relative part of the tail in ln(T_tight/T_slack) where the steady window starts [-]."""
    drift: float
    """Relative change of ln(T_tight/T_slack) by drift over the fitted record [-]."""


def steady_window(
    t: Array, signal: Array, tolerance: float, *, min_samples: int, min_fraction: float
) -> SteadyWindow | None:
    """Find the longest window up to the end of a signal over which it is steady.

    The signal is reduced to medians of at most ``BLOCKS`` blocks. A window is steady if the median
    of the slopes between all pairs of its blocks (Theil–Sen), times its length, is within the
    tolerance or within what noise gives, and the spread of its blocks is, too.

    Parameters
    ----------
    t : ndarray
        Times [s], non-decreasing, shape (n,).
    signal : ndarray
        Finite samples, periodic parts taken off, shape (n,).
    tolerance : float
        Change over the window that counts as steady, in the unit of the signal.
    min_samples : int
        Fewest samples of a window.
    min_fraction : float
        Shortest window over the length of the signal [-].

    Returns
    -------
    SteadyWindow or None
        None if no window is steady.
    """
    n = t.size
    shortest = max(min_samples, int(np.ceil(min_fraction * n)))
    if n < shortest or n < 4:
        return None
    blocks = int(np.clip(n // 4, 4, BLOCKS))
    bounds = np.linspace(0, n, blocks + 1).astype(int)
    value = np.array([np.median(signal[a:b]) for a, b in zip(bounds, bounds[1:], strict=False)])
    time = np.array([np.mean(t[a:b]) for a, b in zip(bounds, bounds[1:], strict=False)])
    noise = difference_sigma(signal) * 1.25 / np.sqrt(n / blocks)
    noise = max(noise, difference_sigma(value) if blocks >= 8 else 0.0)
    for k in range(blocks - 2):
        if n - bounds[k] < shortest:
            return None
        span = float(time[-1] - time[k])
        if span <= 0.0:
            return None
        slope = _theil_sen(time[k:], value[k:])
        count = blocks - k
        straight = value[k:] - slope * (time[k:] - np.mean(time[k:]))
        spread = mad_sigma(straight)
        allowed = max(tolerance, 3.0 * noise * np.sqrt(12.0 / count))
        if abs(slope) * span <= allowed and spread <= max(tolerance, 2.5 * noise):
            return SteadyWindow(int(bounds[k]), slope * span)
    return None


def _theil_sen(x: Array, y: Array) -> float:
    """Median of the slopes between all pairs of points."""
    i, j = np.triu_indices(x.size, 1)
    run = x[j] - x[i]
    valid = run > 0.0
    return float(np.median((y[j] - y[i])[valid] / run[valid])) if np.any(valid) else 0.0


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
    n = t.size
    fewest = max(criteria.min_samples, 8)
    if n < fewest:
        raise SetAsideError(f"too short: {n} usable samples of sliding, must be >= {fewest}")
    sigma = np.array(
        [max(difference_sigma(c), NOISE_FLOOR * float(np.median(np.abs(c)))) for c in tensions.T]
    )
    fit, start = _adequate_fit(t, tensions, sigma, fewest)
    fit = _with_drift_if_called_for(t[start:], tensions[start:], sigma, fit)
    if not fit.log_ratio > 0.0:
        raise SetAsideError("the tensions do not settle at two positive values")
    signal = _without_ripple(tensions[start:], fit)
    steady = np.flatnonzero(fit.used & np.isfinite(signal))
    window = steady_window(
        t[start:][steady],
        signal[steady],
        criteria.steady_tolerance * fit.log_ratio,
        min_samples=criteria.min_samples,
        min_fraction=criteria.min_fraction,
    )
    if window is None:
        raise SetAsideError(_why_not_steady(t[start:][steady], signal[steady], criteria))
    return _judged(t, fit, start, start + int(steady[window.first]), criteria)


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
    """Reason for a record without a steady window, from its last part."""
    last = slice(int((1.0 - max(criteria.min_fraction, 0.2)) * t.size), None)
    middle = float(np.median(signal[last]))
    change = 0.0
    if t[last].size >= 4:
        change = _theil_sen_thinned(t[last], signal[last]) * float(t[-1] - t[last][0])
    spread = mad_sigma(signal[last])
    if abs(change) > criteria.steady_tolerance * middle:
        direction = "rises" if change > 0.0 else "falls"
        return (
            f"never settles: mu still {direction} by {100 * abs(change) / middle:.2g} % over the "
            f"last {t[-1] - t[last][0]:.3g} s, allowed is {100 * criteria.steady_tolerance:g} %"
        )
    return (
        f"no steady window: mu wanders by more than {100 * criteria.steady_tolerance:g} % "
        f"(spread of the last samples {100 * spread / middle:.2g} %)"
    )


def _theil_sen_thinned(t: Array, signal: Array) -> float:
    blocks = np.array_split(np.arange(t.size), min(t.size, BLOCKS))
    return _theil_sen(
        np.array([np.mean(t[b]) for b in blocks]), np.array([np.median(signal[b]) for b in blocks])
    )


def _judged(
    t: Array, fit: SlidingFit, start: int, first: int, criteria: PlateauCriteria
) -> Plateau:
    """Levels of the plateau, or the reason why they are not to be trusted."""
    end, length = float(t[-1]), float(t[-1] - t[start])
    tail_end = float(fit.tail_at(end)) / fit.log_ratio
    if not abs(tail_end) < criteria.steady_tolerance:
        direction = "falls" if tail_end > 0.0 else "rises"
        raise SetAsideError(
            f"never settles: mu still {direction} towards its plateau at the end, "
            f"{100 * abs(tail_end):.2g} % away from it, "
            f"allowed is {100 * criteria.steady_tolerance:g} %"
        )
    rate = float(fit.drift[0] / fit.levels[0] - fit.drift[1] / fit.levels[1])
    drift = rate * length / fit.log_ratio
    if abs(drift) > criteria.max_drift:
        raise SetAsideError(
            f"drifts: mu changes by {100 * drift:+.2g} % over the sliding phase, "
            f"allowed is {100 * criteria.max_drift:g} %"
        )
    middle = 0.5 * (float(t[first]) + end) - 0.5 * (float(t[start]) + end)
    levels = fit.levels + fit.drift * middle
    over_window = rate * (end - float(t[first]))
    return Plateau(
        fit=fit,
        fit_start=start,
        first=first,
        levels=levels,
        log_ratio_se=float(np.hypot(fit.log_ratio_se, over_window / np.sqrt(12.0))),
        tail_part=float(fit.tail_at(float(t[first]))) / fit.log_ratio,
        drift=drift,
    )

"""Evaluate the rest phase of a run: tension, readings of the cells, their slopes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.identify.estimators.signal import difference_sigma
from beltid.identify.estimators.statistics import (
    integrated_autocorrelation_time,
    mad_sigma,
    median,
    outlier_mask,
)
from beltid.identify.friction.run import RunRejected

Array = NDArray[np.float64]
MIN_SAMPLES = 3
"""Fewest samples before the pulley turns."""
NEAR = 1e-4 / 6.0
"""Smallest spread of the samples at rest, relative to their median, for the search for outliers."""
AGREE, LARGE = 0.7, 0.1
"""Relative scatter of the levels of tension up to which they agree; share of the lowest stated
tension, or of the factor 1, above which the readings contradict the stated tensions."""
ROUGH = "If only the stated tensions are wrong, correct initial_tension_N"


@dataclass(frozen=True, slots=True)
class Rest:
    """Readings of the load cells before the pulley turns."""

    n_samples: int
    first_s: float
    last_s: float  # times of the first and the last sample [s]
    tension_N: float  # mean of both cells [N]
    end_N: float  # mean of both cells over the last samples [N]
    end_se_N: float
    imbalance_N: float  # Tight minus slack cell [N]
    imbalance_se_N: float
    slopes_N_s: tuple[float, float]
    """Slopes over time of the difference (tight minus slack) and of the sum of both cells [N/s]."""
    slope_ses_N_s: tuple[float, float]


def rest_state(t: Array, tensions: Array, rounding_N: ArrayLike = 0.0) -> Rest:
    """Determine initial tension and imbalance of the cells from the samples before the rotation.

    Samples just before the rotation whose tensions already separate (a lagging speed channel) are
    excluded.

    Parameters
    ----------
    t : ndarray
        Times before the pulley turns [s], shape (n,).
    tensions : ndarray
        Tensions of the tight and the slack cell [N], spikes and gaps as nan, shape (n, 2).
    rounding_N : array_like, shape (2,)
        Errors of means of both cells by coarse converters [N].

    Raises
    ------
    RunRejected
        If there are fewer than `MIN_SAMPLES` samples at rest.
    """
    kept = _quiet_samples(tensions)
    mean, difference = 0.5 * tensions[kept].sum(axis=1), -np.diff(tensions[kept])[:, 0]
    near = ~np.any([outlier_mask(x, NEAR * abs(median(x))) for x in (mean, difference)], axis=0)
    mean, difference, time = mean[near], difference[near], t[kept][near]
    n = difference.size
    slope, slope_se = _slope(time, difference)
    sum_slope, sum_se = _slope(time, 2.0 * mean)
    spread = float(np.std(difference)) * np.sqrt(n / max(n - 1.0, 1.0))
    se = spread * np.sqrt(integrated_autocorrelation_time(difference) / n)
    rounding = float(np.linalg.norm(rounding_N))
    # a converter that stays on one step hides a slope: each half may be off by its rounding
    jump = np.sqrt(8.0) * rounding / max(float(np.ptp(time)), 1e-12)
    last = max(n // 8, min(n, 3))
    return Rest(
        n_samples=n,
        first_s=float(time[0]),
        last_s=float(time[-1]),
        tension_N=float(np.mean(mean)),
        end_N=float(np.mean(mean[-last:])),
        end_se_N=float(np.std(np.diff(mean))) / np.sqrt(2.0 * last) if n > 2 else float("inf"),
        imbalance_N=float(np.mean(difference)),
        imbalance_se_N=float(np.hypot(se, rounding)),
        slopes_N_s=(slope, sum_slope),
        slope_ses_N_s=(float(np.hypot(slope_se, jump)), float(np.hypot(sum_se, jump))),
    )


def _quiet_samples(tensions: Array) -> NDArray[np.intp]:
    """Find the samples at rest with both tensions, before the tensions separate."""
    usable = np.flatnonzero(np.all(np.isfinite(tensions), axis=1))
    if usable.size < MIN_SAMPLES:
        raise RunRejected(
            f"no rest phase: {usable.size} usable samples before the pulley turns, "
            f"must be >= {MIN_SAMPLES}"
        )
    tight, slack = tensions[usable].T
    difference = tight - slack
    half = difference[: max(MIN_SAMPLES, usable.size // 2)]
    limit = 6.0 * max(difference_sigma(half), 1e-4 * median(tight))
    quiet = np.flatnonzero(np.abs(difference - median(half)) <= limit)
    return usable[: max(int(quiet[-1]) + 1 if quiet.size else 0, MIN_SAMPLES)]


def _slope(t: Array, x: Array) -> tuple[float, float]:
    """Fit the slope of x over t, and its standard error (infinite if unknown)."""
    dt = t - t.mean()
    squares = float(dt @ dt)
    if t.size < 4 or squares <= 0.0:
        return 0.0, float("inf")
    slope = float(dt @ x) / squares
    residual = x - x.mean() - slope * dt
    variance = float(residual @ residual) / (t.size - 2)
    # correlated noise disturbs a slope more than white noise does
    return slope, float(np.sqrt(variance * integrated_autocorrelation_time(residual) / squares))


def against_stated(measured_N: Array, stated_N: Array) -> str:
    """Compare the tensions at rest with the stated initial tensions and describe a mismatch.

    Each level of tension has an offset and a factor, medians over its runs. The median level
    counts if the levels agree on it, so that a few wrongly set runs or levels do not matter.

    Parameters
    ----------
    measured_N : ndarray
        Mean of both cells at rest [N], shape (n,).
    stated_N : ndarray
        Stated initial tensions [N], nan if not stated, shape (n,).

    Returns
    -------
    str
        Empty if they match, if the levels do not agree on a mismatch, or if fewer than four runs
        or a single tension do not allow a check.
    """
    usable = np.isfinite(measured_N) & (stated_N > 0.0)
    measured, stated = measured_N[usable], stated_N[usable]
    levels = np.unique(stated)
    if stated.size < 4 or np.ptp(levels) < 0.1 * levels[-1]:
        return ""
    offset_N, offset_apart = _median_level(measured - stated, stated)
    excess, excess_apart = _median_level(measured / stated - 1.0, stated)
    if min(offset_apart, excess_apart) > AGREE:
        return ""
    is_offset = offset_apart < excess_apart
    if is_offset and abs(offset_N) > LARGE * levels[0]:
        return (
            f"the tensions at rest are {offset_N:+.3g} N off the stated initial tensions at "
            f"{levels.size} levels of tension: were the load cells tared? State their readings "
            "without load as friction.tension_tight_tare_N and friction.tension_slack_tare_N. "
            f"{ROUGH}"
        )
    if not is_offset and abs(excess) > LARGE:
        return (
            f"the tensions at rest are {1.0 + excess:.4g} times the stated initial tensions at "
            f"{levels.size} levels of tension: is the unit of the cells right (units.rig), is the "
            "force of the whole hub stated? State a known error of the cells as "
            f"friction.tension_tight_gain and friction.tension_slack_gain. {ROUGH}"
        )
    return ""


def _median_level(values: Array, stated: Array) -> tuple[float, float]:
    """Return the median over the levels of tension, and their scatter relative to it."""
    of_levels = np.array([median(values[stated == level]) for level in np.unique(stated)])
    middle = median(of_levels)
    return middle, mad_sigma(of_levels) / max(abs(middle), 1e-300)

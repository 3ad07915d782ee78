"""Start of a run of the friction rig: when the pulley turns, and what the cells show before.

All thresholds are relative to the speed that the pulley reaches, so that neither the unit nor the
sign of the speed channel decides where the rotation starts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.identify.estimators.signal import (
    converter_rounding,
    difference_sigma,
    median,
    noise_before_rounding,
    running_median,
)
from beltid.identify.estimators.statistics import MAD_TO_SIGMA, integrated_autocorrelation_time

Array = NDArray[np.float64]


class RunRejected(Exception):
    """A run cannot be reduced; the message is the reason given in its status.

    Never leaves the reduction of a run: one bad run must not stop the others.
    """


@dataclass(frozen=True, slots=True)
class Rotation:
    """The part of a record in which the pulley turns."""

    first: int
    """Index of the first sample at which the pulley turns."""
    full_speed: int
    """Index of the first sample at which it has reached its speed."""
    end: int
    """Index after the last sample at which it turns."""
    speed_rad_s: float
    """Magnitude of the speed reached, median over the second half of the rotation [rad/s]."""
    reversed: bool
    """Whether the speed channel is negative."""
    unsteadiness: float
    """Relative change of the speed between the two halves of the time at full speed [-]."""


@dataclass(frozen=True, slots=True)
class Rest:
    """What the load cells show before the pulley turns."""

    n_samples: int
    first_s: float
    last_s: float
    """Times of the first and the last sample [s]."""
    tension_N: float
    """Mean of both cells [N]."""
    end_N: float
    """The same over the last samples [N]."""
    end_se_N: float
    imbalance_N: float
    """Tight minus slack cell [N]."""
    imbalance_se_N: float
    slopes_N_s: tuple[float, float]
    """Slopes over time of the difference (tight minus slack) and of the sum of both cells [N/s]."""
    slope_ses_N_s: tuple[float, float]
    noise_N: float
    """Standard deviation of the difference about its slope, over sqrt(2): of a cell [N]."""


def find_rotation(speed: Array) -> Rotation:
    """Locate the rotation of the pulley in the speed channel.

    Parameters
    ----------
    speed : ndarray
        Pulley speed [rad/s], finite, shape (n,).

    Raises
    ------
    RunRejected
        If the pulley never turns.
    """
    smooth = running_median(speed, 5)
    magnitude = np.abs(smooth)
    noise = difference_sigma(speed)
    reached = float(np.quantile(magnitude, 0.95))
    first, end = _first_rotation(magnitude, reached)
    top = median(magnitude[(first + end) // 2 : end]) if end > first else 0.0
    quiet = np.abs(speed[magnitude <= 0.5 * top])
    # speed noise grows with the speed on most encoders: compare with what the rest phase shows
    background = 4.0 * median(quiet) if quiet.size >= 3 else 0.0
    if not top > max(5.0 * noise, 2.0 * background):
        fastest = float(np.max(magnitude))
        if fastest > max(10.0 * top, 10.0 * noise):
            raise RunRejected("too short: the pulley turns in less than 5 % of the samples")
        raise RunRejected(
            f"the pulley never turns: pulley_speed_rad_s stays within {fastest:.3g} rad/s"
        )
    threshold = max(0.03 * top, min(2.0 * background, 0.3 * top))
    while first > 0 and abs(speed[first - 1]) > threshold and speed[first - 1] * smooth[first] > 0:
        first -= 1
    full = magnitude[first:end] >= 0.97 * top - 3.0 * noise
    full_speed = first + int(np.argmax(full))
    middle = (full_speed + end) // 2
    halves = [magnitude[full_speed:middle], magnitude[middle:end]]
    change = 0.0
    if min(part.size for part in halves) >= 3:
        change = (median(halves[1]) - median(halves[0])) / top
    backwards = bool(median(smooth[first:end]) < 0.0)
    return Rotation(first, full_speed, end, top, backwards, change)


def _first_rotation(magnitude: Array, reached: float) -> tuple[int, int]:
    """First and end index of the first start of the pulley; a later start at any speed is ignored.

    Glitches of the speed channel are no starts: the stretch lasts at least a fifth as long as the
    longest one.
    """
    edges = np.diff(np.concatenate([[0], (magnitude > 0.1 * reached).astype(np.int8), [0]]))
    starts, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    if starts.size == 0 or reached <= 0.0:
        return 0, 0
    long = ends - starts >= max(0.2 * float(np.max(ends - starts)), 4.0)
    k = int(np.argmax(long)) if long.any() else int(np.argmax(ends - starts))
    level = 0.5 * median(magnitude[starts[k] : ends[k]])
    inside = np.flatnonzero(magnitude[starts[k] : ends[k]] > level)
    return int(starts[k] + inside[0]), int(starts[k] + inside[-1] + 1)


def rest_state(
    t: Array,
    tight: Array,
    slack: Array,
    first: int,
    min_samples: int,
    steps: tuple[float, float] = (0.0, 0.0),
) -> Rest:
    """Initial tension and imbalance of the cells from the samples before the rotation.

    Samples just before the rotation whose tensions already part (a speed channel that lags) are
    left out.

    Parameters
    ----------
    t : ndarray
        Times [s], shape (n,).
    tight, slack : ndarray
        Tensions [N], spikes and gaps as nan, shape (n,).
    first : int
        Index of the first sample at which the pulley turns.
    min_samples : int
        Fewest samples that make a rest phase.
    steps : pair of float
        Steps of the converters of both cells [N], zero if they are fine.

    Raises
    ------
    RunRejected
        If there are fewer samples at rest.
    """
    both = np.flatnonzero(np.isfinite(tight[:first]) & np.isfinite(slack[:first]))
    if both.size < min_samples:
        raise RunRejected(
            f"no rest phase: {both.size} usable samples before the pulley turns, "
            f"must be >= {min_samples}"
        )
    difference = tight[both] - slack[both]
    half = difference[: max(min_samples, both.size // 2)]
    limit = 6.0 * max(difference_sigma(half), 1e-4 * median(tight[both]))
    parted = np.abs(difference - median(half)) > limit
    quiet = np.flatnonzero(~parted)
    last = max(int(quiet[-1]) + 1 if quiet.size else 0, min_samples)
    kept = both[:last]
    mean, difference = 0.5 * (tight[kept] + slack[kept]), tight[kept] - slack[kept]
    near = _near_median(mean) & _near_median(difference)
    mean, difference, time = mean[near], difference[near], t[kept][near]
    n = difference.size
    slope, slope_se, noise = _slope(time, difference)
    sum_slope, sum_se, _ = _slope(time, 2.0 * mean)
    spread = float(np.std(difference)) * np.sqrt(n / max(n - 1.0, 1.0))
    se = spread * np.sqrt(integrated_autocorrelation_time(difference) / n)
    recorded = [np.std(tight[kept]), np.std(slack[kept])]
    rounding = converter_rounding(noise_before_rounding(recorded, steps), steps)
    se = float(np.linalg.norm([se, *rounding]))
    # a converter that stays on one step hides a slope: either half may be off by its rounding
    jump = np.sqrt(8.0) * float(np.linalg.norm(rounding)) / max(float(np.ptp(time)), 1e-12)
    last = max(n // 8, min(n, 3))
    return Rest(
        n_samples=n,
        first_s=float(time[0]),
        last_s=float(time[-1]),
        tension_N=float(np.mean(mean)),
        end_N=float(np.mean(mean[-last:])),
        end_se_N=float(np.std(np.diff(mean))) / np.sqrt(2.0 * last) if n > 2 else float("inf"),
        imbalance_N=float(np.mean(difference)),
        imbalance_se_N=se,
        slopes_N_s=(slope, sum_slope),
        slope_ses_N_s=(float(np.hypot(slope_se, jump)), float(np.hypot(sum_se, jump))),
        noise_N=noise / np.sqrt(2.0),
    )


def _slope(t: Array, x: Array) -> tuple[float, float, float]:
    """Slope of x over t, its standard error (infinite if unknown), and the scatter about it."""
    away = t - t.mean()
    squares = float(away @ away)
    if t.size < 4 or squares <= 0.0:
        return 0.0, float("inf"), 0.0
    slope = float(away @ x) / squares
    residual = x - x.mean() - slope * away
    scatter = float(np.sqrt(residual @ residual / (t.size - 2)))
    # noise with a memory moves a slope more than white noise does
    memory = integrated_autocorrelation_time(residual)
    return slope, scatter * float(np.sqrt(max(memory, 1.0) / squares)), scatter


def _near_median(x: Array) -> NDArray[np.bool_]:
    """Samples that are no outliers of a steady signal."""
    distance = np.abs(x - median(x))
    spread = MAD_TO_SIGMA * median(distance)
    return distance <= max(6.0 * spread, 1e-4 * abs(median(x)), 3.0 * float(np.mean(distance)))

"""Phases of a run: rest, rotation of the pulley, and sliding of the belt as a whole.

All thresholds are relative to the speed that the pulley reaches, so that neither the unit nor the
sign of the speed channel decides where the rotation starts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

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
from beltid.identify.friction.channels import Channels, check_cells
from beltid.identify.friction.kinds import other
from beltid.identify.friction.run import RunRejected

Array = NDArray[np.float64]


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


def unswapped(channels: Channels, rotation: Rotation) -> tuple[Channels, bool]:
    """Swap the cells if the slack one carries more throughout the sliding.

    Raises
    ------
    RunRejected
        If that cannot be what happened.
    """
    half = slice((rotation.full_speed + rotation.end) // 2, rotation.end)
    usable = channels.usable[half]
    difference = (channels.tight[half] - channels.slack[half])[usable]
    if difference.size < 3:
        raise RunRejected(f"too short: {difference.size} usable samples of sliding")
    if median(difference) >= 0.0:
        return channels, False
    below = np.count_nonzero(difference < 0.0) / difference.size
    if below < 0.9:
        return channels, False
    kind = channels.kind
    if kind.weight is not None:
        raise RunRejected(
            f"the cell shows the weight to hang on the {other(kind.weight)} span while the pulley "
            f"turns, rig.weight_on: {kind.weight}"
        )
    if kind.has_torque:
        raise RunRejected(
            "the torque is negative while the pulley turns; if it counts the other way, turn its "
            'sign by a minus before its name: columns: {rig: {torque_N_m: "-torque_N_m"}}'
        )
    return replace(channels, tight=channels.slack, slack=channels.tight), True


def as_if_held(channels: Channels, rotation: Rotation) -> Channels:
    """Tensions of a belt on a dead weight as they would part if its ends were held.

    At the same ratio of both tensions at any moment, their sum stays what it is while the belt
    slides. So build-up and tail of the peak look like those of a bench with two cells.

    Raises
    ------
    RunRejected
        If there are hardly any usable samples of sliding.
    """
    half = slice((rotation.full_speed + rotation.end) // 2, rotation.end)
    with np.errstate(invalid="ignore", divide="ignore"):
        total = (channels.tight + channels.slack)[half]
        share = channels.tight / (channels.tight + channels.slack)
    if np.count_nonzero(np.isfinite(total)) < 3:
        raise RunRejected(f"too short: {np.count_nonzero(np.isfinite(total))} samples of sliding")
    held = median(total[np.isfinite(total)])
    return replace(channels, tight=held * share, slack=held * (1.0 - share))


@dataclass(frozen=True, slots=True, eq=False)
class SlidingPhase:
    """Usable samples of a run until the pulley stops, and where the belt begins to slide.

    Attributes
    ----------
    time_s : ndarray
        Times [s], shape (n,).
    tensions : ndarray
        Tight and slack tension [N], shape (n, 2).
    first : int
        First sample of the rotation.
    built : int
        First sample at which nine tenths of the build-up are reached.
    slide : int
        First sample that surely lies behind the build-up.
    """

    time_s: Array
    tensions: Array
    first: int
    built: int
    slide: int


def sliding_phase(channels: Channels, rotation: Rotation) -> SlidingPhase:
    """Find where the belt begins to slide as a whole.

    Raises
    ------
    RunRejected
        If it never does, or a cell does not answer.
    """
    keep = np.flatnonzero(channels.usable[: rotation.end])
    t = channels.time_s[keep]
    tensions = np.column_stack([channels.tight[keep], channels.slack[keep]])
    first = int(np.searchsorted(keep, rotation.first))
    difference = tensions[:, 0] - tensions[:, 1]
    n = t.size
    if n - first < 8:
        raise RunRejected(f"too short: {n - first} usable samples while the pulley turns")
    sliding = slice((rotation.full_speed + rotation.first + rotation.end) // 3, rotation.end)
    check_cells(channels, rotation.first, sliding, median(tensions[:first, 1]))
    # by time: a simulated recording has most of its samples in the build-up
    middle = 0.5 * float(t[first] + t[-1])
    settled = median(difference[min(int(np.searchsorted(t, middle)), n - 1) :])
    at_rest = median(difference[:first])
    least = 6.0 * difference_sigma(difference) / np.sqrt(0.5 * (n - first))
    if settled - at_rest <= max(least, 0.01 * median(tensions[:first, 1])):
        raise RunRejected(
            f"never slides: the tensions part by {settled - at_rest:.3g} N while the pulley turns"
        )
    reached = running_median(difference[first:], 5) - at_rest >= 0.9 * (settled - at_rest)
    build_up = int(np.argmax(reached))
    if t[first + build_up] > middle:
        raise RunRejected("never slides: the tensions still part at the end of the record")
    behind = t[first] + 1.5 * (t[first + build_up] - t[first])
    slide = max(int(np.searchsorted(t, behind, side="right")), first + build_up + 1)
    slide = max(slide, int(np.searchsorted(keep, rotation.full_speed)))
    # noise reaches the level too early as often as it falls below it too late
    built = int(np.count_nonzero(~reached[: 2 * build_up + 3]))
    return SlidingPhase(t, tensions, first, first + min(built, n - first - 1), slide)

"""Samples of a press cycle during which the crosshead stands.

While the crosshead stands the force relaxes from one branch towards the curve half-way between the
branches. These samples belong to neither branch: left in, they pull the end of the branch to the
middle, by half the hysteresis.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DWELL_SHARE = 0.15
"""The crosshead stands where it moves slower than this share of its speed on the branch."""
SPEED_ERROR = 0.2 * DWELL_SHARE
"""Largest standard error of the local speed, as a share of the speed on the branch."""
CONTACT_SHARE = 0.05
"""The speed on the branch is that above this share of the largest force: the way to the belt is
often driven faster."""
NO_TIME = 1.0e-3
"""Share of the usual time between samples below which a window has no length."""
MIN_WINDOWS = 8
"""Fewest windows of the local speed that a branch must hold for a dwell to be told."""


def moving_part(
    time_s: Array, travel_m: Array, force_N: Array, branch: slice, noise_m: float
) -> NDArray[np.intp]:
    """Samples of a branch at which the crosshead moves.

    The local speed is the distance of the means over `h` samples behind and ahead over the time
    between them; `h` is the smallest that tells a standing crosshead from the travel's noise.

    Parameters
    ----------
    time_s, travel_m, force_N : ndarray
        Whole test: time [s], nan where unknown, crosshead travel [m] and force [N], shape (n,).
    branch : slice
        The branch.
    noise_m : float
        Standard deviation of the travel's white noise or its resolution [m].

    Returns
    -------
    ndarray of int
        Indices into the test, rising. Standing samples at either end of the branch are left out;
        those within it too, unless they are the most of it (a press driven in steps). All samples
        of the branch if the noise hides the speed.
    """
    samples = np.arange(*branch.indices(travel_m.size))
    loaded = force_N[samples] > CONTACT_SHARE * float(np.max(force_N[samples]))
    clock = _clock(time_s)
    h = 1
    while MIN_WINDOWS * h <= samples.size:
        speed, duration = _local_speed(clock, travel_m, samples, h)
        ramp = _weighted_median(speed[loaded])
        # standard error of the speed: that of the difference of the means over their distance
        if ramp > 0.0 and noise_m * np.sqrt(2.0 / h) <= SPEED_ERROR * ramp * h * duration:
            return _without_dwell(samples, speed >= DWELL_SHARE * ramp, h)
        h *= 2
    return samples


def _clock(time_s: Array) -> Array:
    """Time [s]; the number of the sample where the clock is incomplete or stands."""
    steps = np.diff(time_s)
    runs = steps.size > 0 and np.all(steps >= 0.0) and float(np.median(steps)) > 0.0
    return time_s if runs else np.arange(time_s.size, dtype=float)


def _local_speed(
    clock: Array, travel: Array, samples: NDArray[np.intp], h: int
) -> tuple[Array, float]:
    """Speed at the samples [m/s] from the `h` samples on either side, and their typical spacing."""
    first, last = max(int(samples[0]) - h, 0), min(int(samples[-1]) + h + 1, travel.size)
    sums = [np.concatenate([[0.0], np.cumsum(c[first:last] - c[first])]) for c in (clock, travel)]
    at = samples - first
    size = last - first
    behind, ahead = np.maximum(at - h, 0), np.minimum(at + h + 1, size)
    # the sample itself is in both means: at the ends of the test the window is one-sided
    means = [
        ((s[ahead] - s[at]) / (ahead - at), (s[at + 1] - s[behind]) / (at + 1 - behind))
        for s in sums
    ]
    (t_ahead, t_behind), (x_ahead, x_behind) = means
    spacing = t_ahead - t_behind
    # samples at one and the same time are apart by rounding only: they tell no speed
    least = NO_TIME * float(np.median(np.diff(clock)))
    speed = np.abs(x_ahead - x_behind) / np.where(spacing > least, spacing, np.inf)
    return speed, float(np.median(spacing)) / h


def _weighted_median(speed: Array) -> float:
    """Speed above which half of the way is travelled: standing still does not lower it."""
    ordered = np.sort(speed)
    way = np.cumsum(ordered)
    if way.size == 0:
        return 0.0
    return float(ordered[int(np.searchsorted(way, 0.5 * way[-1]))])


def _without_dwell(samples: NDArray[np.intp], moving: Mask, h: int) -> NDArray[np.intp]:
    """Samples that move; a dwell is widened by the half window that blurs its ends."""
    stands = ~moving
    edges = np.flatnonzero(np.diff(np.concatenate([[False], stands, [False]]).astype(int)))
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        # shorter than the window: the crosshead turned, or the speed dipped
        if end - begin > h:
            stands[max(begin - h, 0) : end + h] = True
    kept = np.flatnonzero(~stands)
    if kept.size == 0:
        return samples
    inner = np.arange(kept[0], kept[-1] + 1)
    return samples[kept if 2 * kept.size >= inner.size else inner]

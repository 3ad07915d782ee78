"""Test for a steady window at the end of a signal, by robust slope and spread."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from beltid.identify.estimators.signal import difference_sigma, median, robust_sigma

Array = NDArray[np.float64]

BLOCKS = 24
"""Most blocks that a signal is reduced to."""


@dataclass(frozen=True, slots=True)
class SteadyWindow:
    """Window over which a signal is steady."""

    first: int
    """Index of its first sample; it lasts to the end of the signal."""
    change: float
    """Robust slope times length, in the unit of the signal."""


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
    most = max(4, min(n // 4, BLOCKS))
    blocks = min(range(most, max(4, most - 5) - 1, -1), key=lambda m: n % m)
    size = n // blocks
    offset = n - size * blocks
    value = np.median(signal[offset:].reshape(blocks, size), axis=1)
    time = np.mean(t[offset:].reshape(blocks, size), axis=1)
    noise = 1.25 * difference_sigma(signal) / np.sqrt(size)
    if blocks >= 8:
        # correlated samples leave more noise on the blocks than their number suggests
        step = np.diff(value)
        noise = max(noise, robust_sigma(step) / np.sqrt(2.0))
    for k in range(blocks - 2):
        first = offset + k * size
        if n - first < shortest or time[-1] <= time[k]:
            return None
        if not _starts_level(value[k:], tolerance, noise):
            continue
        change = _theil_sen(time[k:], value[k:]) * float(time[-1] - time[k])
        if _is_steady(time[k:], value[k:], change, tolerance, noise):
            return SteadyWindow(first, change)
    return None


def _starts_level(value: Array, tolerance: float, noise: float) -> bool:
    """Whether the first blocks of a window lie on the others.

    A slope of medians overlooks a short tail there.
    """
    count = value.size
    later = median(value[count // 4 + 1 :])
    lead = float(np.mean(value[: max(1, count // 8)]))
    first = abs(float(value[0]) - later) <= max(tolerance, 4.0 * noise)
    return first and abs(lead - later) <= max(tolerance, 3.0 * noise)


def _is_steady(time: Array, value: Array, change: float, tolerance: float, noise: float) -> bool:
    """Whether slope and spread of a window are within tolerance and noise."""
    if abs(change) > max(tolerance, 3.0 * noise * np.sqrt(12.0 / value.size)):
        return False
    run = time - time[0]
    straight = value - change / float(run[-1]) * run
    return robust_sigma(straight) <= max(tolerance, 2.5 * noise)


def _theil_sen(x: Array, y: Array) -> float:
    """Median of the slopes between all pairs of points."""
    i, j = _pairs(x.size)
    run, rise = x[j] - x[i], y[j] - y[i]
    valid = run > 0.0
    return median(rise[valid] / run[valid]) if np.any(valid) else 0.0


@lru_cache(maxsize=2 * BLOCKS)
def _pairs(n: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    return np.triu_indices(n, 1)

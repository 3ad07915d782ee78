"""Noise of block means: white noise, and zeros that wander with a memory.

An Ornstein-Uhlenbeck process of unit variance and memory tau has the covariance exp(-|t-t'|/tau).
Its means over blocks of evenly spaced samples have a covariance in closed form (geometric sums).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def block_covariance(first: Array, last: Array, count: Array, tau: float) -> Array:
    """Covariance of means over blocks of an Ornstein-Uhlenbeck process of unit variance.

    Parameters
    ----------
    first, last : ndarray
        Times of the first and last sample of each block [s], in their order, shape (m,).
    count : ndarray
        Evenly spaced samples of each block, shape (m,).
    tau : float
        Memory of the process [s].

    Returns
    -------
    ndarray, shape (m, m)
    """
    span = last - first
    step = np.where(count > 1.0, span / np.maximum(count - 1.0, 1.0), 1.0)
    rho = np.exp(-step / tau)
    left = -np.expm1(-step / tau)  # 1 - rho, without cancellation
    total = -np.expm1(-count * step / tau) / left  # sum of rho^k over the block
    share = total / count
    gap = np.maximum(first[None, :] - last[:, None], 0.0)
    across = share[:, None] * share[None, :] * np.exp(-gap / tau)
    upper = np.triu(across, 1)
    within = (count * (1.0 + rho) / left - 2.0 * rho * total / left) / count**2
    return upper + upper.T + np.diag(np.where(count > 1.0, within, 1.0))


def wander_since_rest(
    first: Array, last: Array, count: Array, rest: tuple[float, float], rest_count: int, tau: float
) -> Array:
    """The same for what the process has moved since its mean at rest, shape (m, m)."""
    whole = block_covariance(
        np.append(rest[0], first),
        np.append(rest[1], last),
        np.append(max(rest_count, 1), count),
        tau,
    )
    at_rest = whole[0, 1:]
    return whole[1:, 1:] - at_rest[:, None] - at_rest[None, :] + whole[0, 0]


def early_misfit(travel: Array) -> Array:
    """Covariance of what a model may leave unexplained where the sliding begins, shape (m, m).

    It fades over a fifth of the record and is smooth over a tenth.

    Parameters
    ----------
    travel : ndarray
        Travel of the blocks [m], increasing, shape (m,).
    """
    x = (travel - travel[0]) / max(float(np.ptp(travel)), 1e-12)
    size = np.exp(-x / 0.2)
    return size[:, None] * size[None, :] * np.exp(-np.abs(x[:, None] - x[None, :]) / 0.1)

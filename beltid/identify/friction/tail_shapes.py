"""The tail of the sticking peak: shapes of its decay over the travel of the pulley's surface.

Rubber relaxes by a completely monotone curve, a mixture of exponentials,

    g(x) = int w(ln l) exp(-x/l) d ln l,  w ~ exp(-(ln l - ln l_c)²/(2 s²)),
    s = s_slow for l > l_c, s_fast below.                                                    (S2)

One spectrum (l_c, s_slow, s_fast) holds the single exponential (s = 0) and comes within 1e-4 of
ln(T_tight/T_slack) of stretched exponentials, power laws and double exponentials, without naming
them. All tails lie close to a space of a few dimensions; a tail is its coefficients in a basis of
that space.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import expm

Array = NDArray[np.float64]

SHORTEST, LONGEST = 1e-4, 1.0
"""Lengths of exponentials that the basis describes [m]."""
RANK = 14
"""Dimension of the basis: it is off by at most 2e-3 of the height of a tail."""
HALF = np.arange(0.1, 3.0, 0.2)
"""Midpoints of either half of a spectrum, in units of its width."""


@lru_cache(maxsize=1)
def _basis() -> tuple[Array, Array, CubicSpline, Array]:
    """Lengths of exponentials and their mix to basis functions, and two tables in that basis.

    Shapes (k,), (k, RANK); exponentials over ln l; -x d/dx of every function (RANK, RANK).
    """
    lengths = np.geomspace(SHORTEST, LONGEST, 45)
    x = np.concatenate([[0.0], np.geomspace(0.25 * SHORTEST, 2.0 * LONGEST, 120)])
    _, size, across = np.linalg.svd(np.exp(-x[:, None] / lengths), full_matrices=False)
    mix = across[:RANK].T / size[:RANK]
    basis = np.exp(-x[:, None] / lengths) @ mix
    log_length = np.linspace(np.log(SHORTEST), np.log(LONGEST), 160)
    exponentials = CubicSpline(log_length, np.exp(-x / np.exp(log_length)[:, None]) @ basis)
    slope = (x[:, None] / lengths * np.exp(-x[:, None] / lengths)) @ mix
    return lengths, mix, exponentials, slope.T @ basis


def tail_basis(travel: Array) -> Array:
    """Values of the basis functions at travels [m], shape (n, RANK)."""
    lengths, mix, _, _ = _basis()
    return np.asarray(np.exp(-travel[:, None] / lengths) @ mix)


def tail_coefficients(log_centre: Array, slow: Array, fast: Array) -> Array:
    """Coefficients of the tails of spectra, shape (n, RANK).

    Parameters
    ----------
    log_centre : ndarray
        ln l_c, l_c in m, shape (n,).
    slow, fast : ndarray
        Widths of the spectrum above and below l_c in ln l, >= 0, shape (n,).
    """
    _, _, exponentials, _ = _basis()
    floor = 1e-3  # of a width: the single exponential
    slow, fast = np.maximum(slow, floor), np.maximum(fast, floor)
    away = np.concatenate([slow[:, None] * HALF, -fast[:, None] * HALF], axis=1)
    weight = np.exp(-0.5 * np.concatenate([HALF, HALF]) ** 2)
    weight = weight * np.repeat(np.stack([slow, fast], axis=1), HALF.size, axis=1)
    weight /= weight.sum(axis=1, keepdims=True)
    nodes = np.clip(log_centre[:, None] + away, np.log(SHORTEST), np.log(LONGEST))
    return np.asarray(np.einsum("nj,njk->nk", weight, exponentials(nodes)))


def stretched(coefficients: Array) -> Array:
    """Derivative of tails by the logarithm of their length, as coefficients (..., RANK)."""
    return np.asarray(coefficients @ _basis()[3])


def stretching(log_factor: Array) -> Array:
    """Matrices that make tails longer, ``c -> E c``, by factors exp(log_factor), (n, RANK, RANK).

    They are exact for tails in the space of the basis, E = exp(log_factor S) with S of `stretched`.
    """
    return np.asarray(expm(np.asarray(log_factor)[:, None, None] * _basis()[3].T))

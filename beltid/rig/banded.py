"""Banded linear systems in compiled code: LU with partial pivoting, row by row.

The tangent of the belt couples a node to its two neighbours only, so with ``HALF`` off-diagonals
the factorisation costs O(n) for n coordinates. Row i of the storage holds the columns
``i - HALF ... i + 2 HALF``; the last ``HALF`` take the fill-in of row exchanges.
"""

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from beltid.arrays import Array

HALF = 7  # two nodes of four coordinates: |i - j| <= 7
WIDTH = 3 * HALF + 1


def kernel(function: Any) -> Any:
    """Compile a function; its cache on disk does not see an edit of what it calls elsewhere."""
    plain: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
    try:
        return numba.njit(cache=True, **plain)(function)
    except RuntimeError:  # no folder for the cache can be written
        return numba.njit(**plain)(function)


@kernel
def factorize(A: Array, pivots: NDArray[np.int64]) -> bool:
    """Factorize A (n, WIDTH) in place, row exchanges into ``pivots`` (n,); False: singular."""
    n = A.shape[0]
    right = 0  # last column reached by the rows exchanged so far
    for k in range(n):
        last = min(k + HALF, n - 1)
        p = k
        largest = abs(A[k, HALF])
        for i in range(k + 1, last + 1):
            size = abs(A[i, HALF + k - i])
            if size > largest:
                largest, p = size, i
        pivots[k] = p
        if not largest > 0.0:
            return False
        right = max(right, min(p + HALF, n - 1))
        if p != k:
            for j in range(k, right + 1):
                kept = A[k, HALF + j - k]
                A[k, HALF + j - k] = A[p, HALF + j - p]
                A[p, HALF + j - p] = kept
        inverse = 1.0 / A[k, HALF]
        row, filled = A[k, HALF:], right - k > HALF
        for i in range(k + 1, last + 1):
            other = A[i, HALF + k - i :]
            factor = other[0] * inverse
            other[0] = factor
            if factor == 0.0:
                continue
            # loops of fixed length are fast; the storage holds zeros beyond the last column
            if filled:
                for j in range(1, 2 * HALF + 1):
                    other[j] -= factor * row[j]
            else:
                for j in range(1, HALF + 1):
                    other[j] -= factor * row[j]
    return True


@kernel
def solve(A: Array, pivots: NDArray[np.int64], a: Array, b: Array, c: Array) -> None:
    """Solve with the factors; three loads (n,), hardly slower than one, become their solutions."""
    n = A.shape[0]
    for k in range(n):
        p = pivots[k]
        if p != k:
            a[k], a[p], b[k], b[p], c[k], c[p] = a[p], a[k], b[p], b[k], c[p], c[k]
        x, y, z = a[k], b[k], c[k]
        for i in range(k + 1, min(k + HALF, n - 1) + 1):
            factor = A[i, HALF + k - i]
            a[i] -= factor * x
            b[i] -= factor * y
            c[i] -= factor * z
    for k in range(n - 1, -1, -1):
        x, y, z = a[k], b[k], c[k]
        for j in range(k + 1, min(k + 2 * HALF, n - 1) + 1):
            factor = A[k, HALF + j - k]
            x, y, z = x - factor * a[j], y - factor * b[j], z - factor * c[j]
        inverse = 1.0 / A[k, HALF]
        a[k], b[k], c[k] = x * inverse, y * inverse, z * inverse

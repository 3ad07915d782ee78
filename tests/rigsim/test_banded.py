"""Banded LU against dense linear algebra."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from rig_bench import dense

from beltid.rigsim.banded import HALF, WIDTH, factorize, solve

Array = NDArray[np.float64]


def random_banded(n: int, seed: int, diagonal: float = 1.0) -> Array:
    """Random band; the storage right of the band, room for fill, is zero."""
    rng = np.random.default_rng(seed)
    A = np.zeros((n, WIDTH))
    for i in range(n):
        for j in range(max(0, i - HALF), min(n, i + HALF + 1)):
            A[i, HALF + j - i] = rng.normal() * (diagonal if i == j else 1.0)
    return A


def solved(A: Array, b: Array) -> tuple[bool, Array, NDArray[np.int64]]:
    factors, x = A.copy(), b.copy()
    pivots = np.zeros(A.shape[0], dtype=np.int64)
    regular: bool = factorize(factors, pivots)
    if regular:
        solve(factors, pivots, x)
    return regular, x, pivots


@settings(derandomize=True)
@given(st.integers(1, 60), st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1e-8, 1.0, 100.0]))
def test_solution_has_the_backward_error_of_a_pivoted_elimination(
    n: int, seed: int, diagonal: float
) -> None:
    A = random_banded(n, seed, diagonal if n > 1 else 1.0)
    full = dense(A)
    b = np.random.default_rng(seed + 1).normal(size=n)
    regular, x, _ = solved(A, b)
    if np.linalg.cond(full) > 1e14:
        return
    assert regular
    scale = np.linalg.norm(full, np.inf) * np.linalg.norm(x, np.inf) + np.linalg.norm(b, np.inf)
    assert np.linalg.norm(full @ x - b, np.inf) <= 1e-13 * scale
    reference = np.linalg.solve(full, b)
    close = 1e-13 * np.linalg.cond(full) * np.linalg.norm(reference)
    assert np.linalg.norm(x - reference) <= close


def test_rows_are_exchanged_where_the_diagonal_is_zero() -> None:
    n = 40
    A = random_banded(n, 7, diagonal=0.0)
    b = np.arange(n, dtype=float)
    regular, x, pivots = solved(A, b)
    assert regular
    assert np.any(pivots != np.arange(n))
    np.testing.assert_allclose(x, np.linalg.solve(dense(A), b), rtol=1e-9)


@pytest.mark.parametrize("column", [0, 11, 29])
def test_a_matrix_with_an_empty_column_is_singular(column: int) -> None:
    n = 30
    A = random_banded(n, 3)
    for i in range(max(0, column - HALF), min(n, column + HALF + 1)):
        A[i, HALF + column - i] = 0.0
    assert not solved(A, np.ones(n))[0]


def test_a_matrix_that_is_not_finite_is_not_factorized() -> None:
    A = random_banded(20, 5)
    A[9, :] = np.nan
    A[8, :] = np.nan
    regular, x, _ = solved(A, np.ones(20))
    # a nan may pass the elimination, but never as a finite solution
    assert not regular or not np.all(np.isfinite(x))

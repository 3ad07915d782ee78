"""Lemke's method against enumeration, an independent solver, degenerate and unsolvable problems."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import nnls

from beltid.errors import ConvergenceError
from beltid.rigsim.reference.lcp import LcpError, friction_lcp, lemke

Array = NDArray[np.float64]
FIXED = settings(derandomize=True)
seeds = st.integers(0, 10_000)


def by_enumeration(M: Array, q: Array) -> list[Array]:
    """All solutions: every choice of who is positive, tried."""
    solutions = []
    for choice in product((False, True), repeat=q.size):
        active = np.array(choice)
        z = np.zeros(q.size)
        if active.any():
            block = M[np.ix_(active, active)]
            if abs(np.linalg.det(block)) < 1e-12:
                continue
            z[active] = np.linalg.solve(block, -q[active])
        if z.min(initial=0.0) > -1e-9 and (M @ z + q).min() > -1e-9:
            solutions.append(z)
    return solutions


@FIXED
@given(st.integers(1, 6), seeds)
def test_positive_definite_problems_have_the_enumerated_solution(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    B = rng.normal(size=(n, n))
    M, q = B @ B.T + 0.1 * np.eye(n), rng.normal(size=n)
    found = lemke(M, q)
    (expected,) = by_enumeration(M, q)  # unique for a positive definite matrix
    np.testing.assert_allclose(found.z, expected, atol=1e-8)
    assert found.residual <= 1e-10
    assert found.complementarity <= 1e-10


@FIXED
@given(st.integers(2, 6), seeds)
def test_not_symmetric_positive_problems(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    B, skew = rng.normal(size=(n, n)), rng.normal(size=(n, n))
    M, q = B @ B.T + 0.1 * np.eye(n) + skew - skew.T, rng.normal(size=n)
    found = lemke(M, q)
    assert any(np.allclose(found.z, z, atol=1e-7) for z in by_enumeration(M, q))


@FIXED
@given(st.integers(2, 25), seeds)
def test_agrees_with_an_independent_solver(n: int, seed: int) -> None:
    """For M = L L^T the solution is the z >= 0 that makes |L^T z + L^-1 q| smallest."""
    rng = np.random.default_rng(seed)
    B = rng.normal(size=(n, n))
    M, q = B @ B.T + 0.1 * np.eye(n), rng.normal(size=n)
    L = np.linalg.cholesky(M)
    other, _ = nnls(L.T, -np.linalg.solve(L, q))
    np.testing.assert_allclose(lemke(M, q).z, other, atol=1e-7)


def test_nothing_to_do() -> None:
    found = lemke(np.eye(3), np.array([1.0, 0.0, 2.0]))
    assert found.pivots == 0
    assert not found.z.any()
    assert lemke(np.zeros((0, 0)), np.zeros(0)).z.size == 0


def test_degenerate_problems_do_not_go_in_circles() -> None:
    # ties in every ratio test: equal rows and right-hand sides
    M = np.ones((6, 6)) + np.eye(6)
    found = lemke(M, -np.ones(6))
    np.testing.assert_allclose(found.z, np.full(6, 1.0 / 7.0), atol=1e-12)
    # many zeros on the right-hand side
    q = np.array([-1.0, 0.0, 0.0, -1.0, 0.0, 0.0])
    found = lemke(M, q)
    assert found.residual < 1e-12
    assert found.complementarity < 1e-12


def test_semi_definite_problems_with_many_solutions() -> None:
    # three equal contacts on one freedom: only the sum of their forces is determined
    g = np.ones((3, 1))
    force, slip, solution = friction_lcp(g @ g.T, np.full(3, 0.9), np.array([1.0, 1.0, 1.0]))
    assert force.sum() == pytest.approx(0.9, abs=1e-12)
    np.testing.assert_allclose(slip, 0.0, atol=1e-12)
    assert solution.complementarity < 1e-12


@pytest.mark.parametrize(
    ("M", "q"),
    [
        ([[0.0]], [-1.0]),
        ([[-1.0]], [-1.0]),
        ([[1.0, -1.0], [-1.0, 1.0]], [-1.0, -1.0]),  # semi-definite, and nothing helps
    ],
)
def test_unsolvable_problems_raise_a_typed_error(M: list[list[float]], q: list[float]) -> None:
    with pytest.raises(LcpError, match="no solution") as caught:
        lemke(np.array(M), np.array(q))
    assert isinstance(caught.value, ConvergenceError)
    assert caught.value.exit_status == 3


def test_too_few_pivots_are_reported() -> None:
    rng = np.random.default_rng(1)
    B = rng.normal(size=(8, 8))
    with pytest.raises(LcpError, match="after 2 pivots"):
        lemke(B @ B.T + np.eye(8), -np.ones(8), most_pivots=2)


@FIXED
@given(st.integers(1, 8), seeds)
def test_friction_obeys_coulombs_law(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    B = rng.normal(size=(n, max(1, n - 2)))  # fewer freedoms than contacts
    G = 1e-8 * B @ B.T  # [m/N], as on the rig
    limits = rng.uniform(0.0, 50.0, n)
    free = 1e-6 * rng.normal(size=n)
    force, slip, _ = friction_lcp(G, free, limits)
    assert np.all(np.abs(force) <= limits * (1 + 1e-12))
    np.testing.assert_allclose(free - G @ force, slip, atol=1e-15)
    # sliding points carry their limit against the slip, the others do not slip
    sliding = np.abs(slip) > 1e-14
    np.testing.assert_allclose(force[sliding], (np.sign(slip) * limits)[sliding], rtol=1e-9)


def test_one_contact_by_hand() -> None:
    G = np.array([[2.0e-8]])
    # 2 µm of free slip want 100 N: with a limit of 150 N it sticks, with 40 N it slides on
    force, slip, _ = friction_lcp(G, np.array([2.0e-6]), np.array([150.0]))
    assert force[0] == pytest.approx(100.0)
    assert slip[0] == 0.0
    force, slip, _ = friction_lcp(G, np.array([-2.0e-6]), np.array([40.0]))
    assert force[0] == pytest.approx(-40.0)
    assert slip[0] == pytest.approx(-1.2e-6)

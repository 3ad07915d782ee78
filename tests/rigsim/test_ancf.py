"""The ANCF cable element: shape functions, mass, and the derivatives of its strain energy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from rig_bench import dense

from beltid.params import Belt
from beltid.rigsim.banded import WIDTH
from beltid.rigsim.beam.ancf import (
    length_powers,
    mass_matrix,
    section,
    shapes,
    strains,
    unit_shapes,
)
from beltid.rigsim.beam.belt import BeltArrays, add_internal, belt_arrays, store_strains

Array = NDArray[np.float64]

h = np.array([0.013, 0.004, 0.031])
nodes = np.concatenate([[0.0], np.cumsum(h)])
BELT = Belt(EA=1.0e5, EI=0.02, rhoA=0.1, damping_time=0.0)
FIXED = settings(derandomize=True)
unit = st.floats(0.0, 1.0)


def tables_at(xi: float) -> list[Array]:
    """Shape functions of the three elements, and two derivatives."""
    unit_ones = unit_shapes(np.array([xi]))
    return [shapes(unit_ones, length_powers(h), order) for order in (0, 1, 2)]


def cubics(xi: float, length: float) -> tuple[Array, Array, Array]:
    """Hermite cubics and two derivatives in s, from their end conditions, not from the code."""
    at_ends = [
        [1, 0, 0, 0],
        [0, 1, 0, 0],
        [1, length, length**2, length**3],
        [0, 1, 2 * length, 3 * length**2],
    ]
    coefficients = np.linalg.inv(np.array(at_ends))  # of 1, s, s^2, s^3, a column per function
    s = xi * length
    return (
        np.array([1, s, s**2, s**3]) @ coefficients,
        np.array([0, 1, 2 * s, 3 * s**2]) @ coefficients,
        np.array([0, 0, 2, 6 * s]) @ coefficients,
    )


@FIXED
@given(unit)
def test_shape_functions_are_the_cubics_of_their_end_conditions(xi: float) -> None:
    code = tables_at(xi)
    for e, length in enumerate(h):
        for order, exact in enumerate(cubics(xi, length)):
            scale = np.array([1, length, 1, length]) / length**order
            np.testing.assert_allclose(code[order][e, 0] / scale, exact / scale, atol=1e-11)


@FIXED
@given(unit, st.floats(-2, 2), st.floats(-2, 2), st.floats(-2, 2))
def test_a_parabola_is_carried_exactly(xi: float, a: float, b: float, c: float) -> None:
    N, N_s, N_ss = tables_at(xi)
    for e, length in enumerate(h):
        dofs = np.array([a, b, a + b * length + c * length**2, b + 2 * c * length])
        s = xi * length
        assert N[e, 0] @ dofs == pytest.approx(a + b * s + c * s**2, abs=1e-13)
        assert N_s[e, 0] @ dofs == pytest.approx(b + 2 * c * s, abs=1e-11)
        assert N_ss[e, 0] @ dofs == pytest.approx(2 * c, abs=1e-8)


def test_mass_matrix_is_the_quadrature_of_the_shape_functions() -> None:
    rhoA = 0.1
    x, w = np.polynomial.legendre.leggauss(4)  # exact to degree 7, the integrand has 6
    N = shapes(unit_shapes(0.5 * (x + 1)), length_powers(h), 0)
    expected = rhoA * np.einsum("m,emi,emj->eij", 0.5 * w, N, N) * h[:, None, None]
    M = mass_matrix(length_powers(h), rhoA)
    np.testing.assert_allclose(M, expected, rtol=1e-13, atol=1e-18)
    # a translation carries the mass of the element
    rigid = np.array([1.0, 0.0, 1.0, 0.0])
    np.testing.assert_allclose(rigid @ M @ rigid, rhoA * h, rtol=1e-14)


def section_energy(u: Array | NDArray[np.complex128], stretch: complex) -> complex:
    """Strain energy per reference length, written from the formulas of the rod, not the code."""
    ax, ay, bx, by = u
    p = (ax * ax + ay * ay) ** 0.5
    eps = p / stretch - 1
    kappa = (ax * by - ay * bx) / p**2 / stretch
    return stretch * (0.5 * BELT.EA * eps**2 + 0.5 * BELT.EI * kappa**2)


def section_gradient(u: Array, stretch: float) -> Array:
    step = 1e-30
    out = []
    for k in range(4):
        moved = u.astype(complex)
        moved[k] += 1j * step
        out.append(section_energy(moved, stretch).imag / step)
    return np.array(out)


direction = st.tuples(st.floats(0.9, 1.1), st.floats(-math.pi, math.pi))


@FIXED
@given(direction, st.floats(-60, 60), st.floats(-60, 60), st.floats(0.99, 1.01))
def test_section_forces_and_tangent_are_the_derivatives_of_the_energy(
    polar: tuple[float, float], bx: float, by: float, stretch: float
) -> None:
    p, angle = polar
    u = np.array([p * math.cos(angle), p * math.sin(angle), bx, by])
    eps, kappa = strains(u[0], u[1], u[2], u[3], stretch)
    forces = (BELT.EA * eps, BELT.EI * kappa)
    U = section(u[0], u[1], u[2], u[3], forces, (BELT.EA, BELT.EI, stretch))
    g = np.array([U.a_x, U.a_y, U.b_x, U.b_y])
    g_stretch = np.array([U.stretch_a_x, U.stretch_a_y, U.stretch_b_x, U.stretch_b_y])
    H = np.array(
        [
            [U.aa_xx, U.aa_xy, U.ab_xx, U.ab_xy],
            [U.aa_xy, U.aa_yy, U.ab_yx, U.ab_yy],
            [U.ab_xx, U.ab_yx, U.bb_xx, U.bb_xy],
            [U.ab_xy, U.ab_yy, U.bb_xy, U.bb_yy],
        ]
    )
    exact = section_gradient(u, stretch)
    np.testing.assert_allclose(g, exact, rtol=1e-10, atol=1e-9)
    # fourth-order differences of the exact gradient
    d = 1e-3
    for k in range(4):
        step = np.zeros(4)
        step[k] = d * (1.0 if k < 2 else 60.0)
        size = step[k]
        column = (
            8 * (section_gradient(u + step, stretch) - section_gradient(u - step, stretch))
            - section_gradient(u + 2 * step, stretch)
            + section_gradient(u - 2 * step, stretch)
        ) / (12 * size)
        np.testing.assert_allclose(H[:, k], column, rtol=0, atol=1e-7 * np.abs(H).max())
    by_stretch = (
        8 * (section_gradient(u, stretch + d) - section_gradient(u, stretch - d))
        - section_gradient(u, stretch + 2 * d)
        + section_gradient(u, stretch - 2 * d)
    ) / (12 * d)
    np.testing.assert_allclose(g_stretch, by_stretch, rtol=0, atol=1e-8 * BELT.EA)


def bent_belt(seed: int, belt: Belt = BELT) -> tuple[BeltArrays, Array]:
    """A belt with a smooth random shape and a little strain."""
    rng = np.random.default_rng(seed)
    angle = 0.4 * np.sin(40 * nodes + rng.uniform(0, 6))
    t = np.stack([np.cos(angle), np.sin(angle)], axis=1) * (1 + 0.002 * rng.normal(size=4))[:, None]
    r = np.concatenate([[[0, 0]], np.cumsum(0.5 * (t[1:] + t[:-1]) * h[:, None], axis=0)])
    return belt_arrays(belt, nodes, 5), np.concatenate([r, t], axis=1).ravel()


def internal(
    arrays: BeltArrays, q: Array, stretch: float, old: Array | None = None, rate: float = 0.0
) -> tuple[Array, Array, Array]:
    """Forces, dense tangent and derivative in the stretch."""
    A, f, f_stretch = np.zeros((q.size, WIDTH)), np.zeros(q.size), np.zeros(q.size)
    strain_old = np.zeros((*arrays.w_g.shape, 2)) if old is None else old
    add_internal(arrays, q, stretch, strain_old, rate, A, f, f_stretch)
    return f, dense(A), f_stretch


def belt_energy(q: NDArray[np.complex128], stretch: float, momentum: float) -> complex:
    """Energy of the whole belt with the same three Gauss points, written anew.

    That of its strain, less the kinetic energy of its running: per stress-free length
    ``m v0**2 |dr/dS|**2 / 2``.
    """
    x, w = np.polynomial.legendre.leggauss(3)
    total = 0.0j
    for e, length in enumerate(h):
        r = q[4 * e : 4 * e + 8].reshape(4, 2)
        for xi, weight in zip(0.5 * (x + 1), 0.5 * w, strict=True):
            _, N_s, N_ss = cubics(xi, length)
            total += weight * length * section_energy(np.concatenate([N_s @ r, N_ss @ r]), stretch)
            total -= weight * length * 0.5 * momentum * np.sum((N_s @ r) ** 2) / stretch
    return total


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(("stretch", "momentum"), [(0.995, 0.0), (1.0, 0.0), (1.004, 90.0)])
def test_internal_forces_are_the_gradient_of_the_belts_energy(
    seed: int, stretch: float, momentum: float
) -> None:
    arrays, q = bent_belt(seed)
    arrays = arrays._replace(momentum=momentum)
    f, K, f_stretch = internal(arrays, q, stretch)
    for k in range(q.size):
        moved = q.astype(complex)
        moved[k] += 1e-30j
        assert f[k] == pytest.approx(
            belt_energy(moved, stretch, momentum).imag / 1e-30,
            rel=1e-10,
            abs=1e-10 * np.abs(f).max(),
        )
    np.testing.assert_allclose(K, K.T, atol=1e-12 * np.abs(K).max())
    d = 1e-6
    for k in range(q.size):
        step = np.zeros(q.size)
        step[k] = d * (1e-2 if k % 4 < 2 else 1.0)
        difference = internal(arrays, q + step, stretch)[0] - internal(arrays, q - step, stretch)[0]
        np.testing.assert_allclose(
            K[:, k], difference / (2 * step[k]), atol=1e-7 * np.abs(K[:, k]).max()
        )
    by_stretch = (internal(arrays, q, stretch + d)[0] - internal(arrays, q, stretch - d)[0]) / (
        2 * d
    )
    np.testing.assert_allclose(f_stretch, by_stretch, atol=1e-8 * np.abs(f_stretch).max())


def test_damping_adds_force_and_tangent_in_proportion_to_the_strain_rates() -> None:
    tau, rate = 2.0e-4, 3.0e3
    damped = Belt(BELT.EA, BELT.EI, BELT.rhoA, damping_time=tau)
    arrays, q = bent_belt(3, damped)
    _, q_old = bent_belt(4, damped)
    old = np.zeros((*arrays.w_g.shape, 2))
    store_strains(arrays, q_old, 1.0, old)
    f, K, _ = internal(arrays, q, 1.0, old, rate)
    f_elastic, _, _ = internal(arrays, q, 1.0)
    # virtual power of the damping forces: tau rate (EA eps d_eps + EI kappa d_kappa)
    new = np.zeros_like(old)
    store_strains(arrays, q, 1.0, new)
    virtual = np.random.default_rng(5).normal(size=q.size) * 1e-7
    ahead, behind = np.zeros_like(old), np.zeros_like(old)
    store_strains(arrays, q + virtual, 1.0, ahead)
    store_strains(arrays, q - virtual, 1.0, behind)
    power = (
        tau
        * rate
        * np.sum(arrays.w_g[..., None] * [BELT.EA, BELT.EI] * (new - old) * 0.5 * (ahead - behind))
    )
    assert (f - f_elastic) @ virtual == pytest.approx(power, rel=1e-6)
    step = np.random.default_rng(6).normal(size=q.size) * 1e-8
    difference = internal(arrays, q + step, 1.0, old, rate)[0]
    difference -= internal(arrays, q - step, 1.0, old, rate)[0]
    np.testing.assert_allclose(K @ step, 0.5 * difference, atol=1e-6 * np.abs(difference).max())


@FIXED
@given(st.floats(-math.pi, math.pi), st.floats(-1, 1), st.floats(-1, 1), st.integers(0, 99))
def test_a_rigid_motion_turns_the_forces_and_strains_nothing(
    angle: float, x: float, y: float, seed: int
) -> None:
    arrays, q = bent_belt(seed)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    pairs = q.reshape(-1, 2) @ turn.T
    pairs[::2] += [x, y]
    f, _, _ = internal(arrays, q, 1.0)
    f_moved, _, _ = internal(arrays, pairs.ravel(), 1.0)
    scale = np.abs(f).max()
    np.testing.assert_allclose(f_moved, (f.reshape(-1, 2) @ turn.T).ravel(), atol=1e-9 * scale)
    # the internal forces have neither resultant nor moment
    np.testing.assert_allclose(f.reshape(-1, 4)[:, :2].sum(axis=0), 0.0, atol=1e-11 * scale)
    r, force = q.reshape(-1, 2), f.reshape(-1, 2)
    moment = np.sum(r[:, 0] * force[:, 1] - r[:, 1] * force[:, 0])
    assert moment == pytest.approx(0.0, abs=1e-12 * scale)


def test_a_straight_unstretched_belt_carries_no_force() -> None:
    arrays = belt_arrays(BELT, nodes, 5)
    q = np.column_stack([nodes, 0 * nodes, np.ones(4), np.zeros(4)]).ravel()
    f, _, _ = internal(arrays, q, 1.0)
    assert np.abs(f).max() < 1e-9
    # pre-tensioned by the stretch: the force of Hooke's law at the ends, nothing between
    stretch = 1.0 / 1.003
    f, _, _ = internal(arrays, q, stretch)
    assert f[-4] == pytest.approx(1e5 * 0.003, rel=1e-9)
    assert f[0] == pytest.approx(-1e5 * 0.003, rel=1e-9)
    np.testing.assert_allclose(f.reshape(-1, 4)[1:-1, :2], 0.0, atol=1e-9)

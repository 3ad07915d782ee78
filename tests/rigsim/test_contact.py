"""Contact of a part of the belt: energy, forces and tangent against independent computations."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from rig_bench import LAW_5PK, at, bench, dense, true_surface_5pk
from scipy.integrate import quad

from beltid.laws.penalty import NormalLaw
from beltid.params import Contact
from beltid.rigsim.contact.points import (
    SLIDE,
    STICK,
    Motion,
    Points,
    in_range,
    new_points,
    part_energy,
    touching_share,
)
from beltid.rigsim.model import RigModel
from beltid.rigsim.reference.step import assemble
from beltid.rigsim.steady import lay_on
from beltid.rigsim.step import Kinematics

Array = NDArray[np.float64]

HELD = [0, 1, -4, -3]
"""Coordinates at the supports, far from the contact."""
FIXED = settings(derandomize=True)

K1, K2, HALF_LENGTH = 6.5e7, 3.0256e11, 1.0e-3
penetration = st.floats(-3e-4, 3e-4)
inclination = st.floats(-0.25, 0.25)


def by_quadrature(delta: float, sigma: float) -> tuple[float, float, float]:
    """Mean line force, mean couple, and the share of the part that touches."""
    a = HALF_LENGTH

    def force(x: float) -> float:
        d = max(delta + sigma * x, 0.0)
        return K1 * d + K2 * d * d

    edge = -delta / sigma if sigma else 2 * a
    ends = [-a, edge, a] if abs(edge) < a else [-a, a]
    parts = list(itertools.pairwise(ends))
    V_d = sum(quad(force, *p, epsabs=0, epsrel=1e-12)[0] for p in parts) / (2 * a)
    V_s = sum(quad(lambda x: x * force(x), *p, epsabs=1e-14, epsrel=1e-12)[0] for p in parts)
    touching = 2 * a
    if abs(edge) < a:
        touching = a - edge if sigma > 0 else edge + a
    return V_d, V_s / (2 * a), touching / (2 * a)


@FIXED
@given(penetration, inclination)
def test_line_force_and_couple_are_integrals_over_what_touches(delta: float, sigma: float) -> None:
    assume(abs(delta + abs(sigma) * HALF_LENGTH) > 1e-9)  # quad needs some width
    V_d, V_s, _, _, _ = part_energy(delta, sigma, HALF_LENGTH, K1, K2)
    if delta <= -abs(sigma) * HALF_LENGTH:
        assert (V_d, V_s) == (0.0, 0.0)
        return
    force, couple, touching = by_quadrature(delta, sigma)
    assert V_d == pytest.approx(force, rel=1e-9, abs=1e-9)
    assert V_s == pytest.approx(couple, rel=1e-9, abs=1e-11 + 1e-12 * force)
    share, _, _, middle, _, _, half, _, _ = touching_share(delta, sigma, HALF_LENGTH)
    assert share == pytest.approx(touching, rel=1e-9)
    # the penetrations at the ends of what touches
    m = abs(sigma) * HALF_LENGTH
    assert middle + half == pytest.approx(delta + m, rel=1e-12)
    assert middle - half == pytest.approx(max(delta - m, 0.0), abs=1e-12)
    # two Gauss points are exact for the quadratic law
    two = [middle + g * half / math.sqrt(3.0) for g in (-1, 1)]
    assert share * sum(K1 * d + K2 * d * d for d in two) / 2 == pytest.approx(force, rel=1e-7)


@FIXED
@given(penetration, inclination)
def test_second_derivatives_of_a_part_are_those_of_its_forces(delta: float, sigma: float) -> None:
    m = abs(sigma) * HALF_LENGTH
    d_delta, d_sigma = 1e-9, 1e-6
    # differences must not straddle an edge of the law
    assume(abs(abs(delta) - m) > 1e-7 and abs(sigma) > 1e-4)
    _, _, V_dd, V_ds, V_ss = part_energy(delta, sigma, HALF_LENGTH, K1, K2)

    def at_(d: float, s: float) -> Array:
        return np.array(part_energy(delta + d, sigma + s, HALF_LENGTH, K1, K2)[:2])

    by_delta = (at_(d_delta, 0) - at_(-d_delta, 0)) / (2 * d_delta)
    by_sigma = (at_(0, d_sigma) - at_(0, -d_sigma)) / (2 * d_sigma)
    k = K1 + 2 * K2 * (abs(delta) + m)  # scale
    a = HALF_LENGTH
    np.testing.assert_allclose(by_delta, [V_dd, V_ds], atol=1e-5 * k, rtol=1e-5)
    np.testing.assert_allclose(by_sigma[0], V_ds, atol=1e-5 * k * a, rtol=1e-5)
    np.testing.assert_allclose(by_sigma[1], V_ss, atol=1e-5 * k * a * a, rtol=1e-5)


@FIXED
@given(penetration, inclination)
def test_derivatives_of_what_touches(delta: float, sigma: float) -> None:
    m = abs(sigma) * HALF_LENGTH
    d_delta, d_sigma = 1e-9, 1e-6
    assume(abs(abs(delta) - m) > 1e-7 and abs(sigma) > 1e-4 and delta > -m)

    def at_(d: float, s: float) -> Array:
        return np.array(touching_share(delta + d, sigma + s, HALF_LENGTH))[[0, 3, 6]]

    found = np.array(touching_share(delta, sigma, HALF_LENGTH)).reshape(3, 3)
    by_delta = (at_(d_delta, 0) - at_(-d_delta, 0)) / (2 * d_delta)
    by_sigma = (at_(0, d_sigma) - at_(0, -d_sigma)) / (2 * d_sigma)
    np.testing.assert_allclose(found[:, 1], by_delta, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(found[:, 2], by_sigma, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("sigma", [-0.2, -0.03, 0.01, 0.2])
def test_forces_and_stiffness_are_continuous_where_a_part_opens_and_closes(sigma: float) -> None:
    m = abs(sigma) * HALF_LENGTH
    tiny = 1e-13 * m
    k = K1 + 2 * K2 * 2 * m
    # full contact: everything is continuous, the average over what touches up to its value
    inside = part_energy(m + tiny, sigma, HALF_LENGTH, K1, K2)
    beyond = part_energy(m - tiny, sigma, HALF_LENGTH, K1, K2)
    np.testing.assert_allclose(inside, beyond, rtol=1e-9, atol=1e-12 * k)
    # first touch: nothing jumps, neither forces nor stiffness
    first = part_energy(-m + 1e-9 * m, sigma, HALF_LENGTH, K1, K2)
    assert first[0] <= 1e-15 * k
    assert abs(first[2]) <= 1e-8 * k
    assert abs(first[4]) <= 1e-8 * k * HALF_LENGTH**2


def test_a_part_that_lies_flat_carries_the_law() -> None:
    V_d, V_s, V_dd, *_ = part_energy(64e-6, 0.0, HALF_LENGTH, K1, K2)
    law = NormalLaw(K1, K2)
    assert V_d == pytest.approx(float(law.force(64e-6)), rel=1e-14)
    assert V_dd == pytest.approx(float(law.stiffness(64e-6)), rel=1e-14)
    assert V_s == 0.0
    assert part_energy(-1e-9, 0.0, HALF_LENGTH, K1, K2) == (0.0,) * 5


@pytest.mark.parametrize(
    ("value", "inside"), [(0.5, False), (1.0, True), (1.5, True), (2.0, True), (2.1, False)]
)
def test_the_measured_range_includes_its_ends(value: float, inside: bool) -> None:
    assert in_range((1.0, 2.0), value) is inside
    assert in_range((0.0, math.inf), value)


# ----- the assembled contact ----------------------------------------------------------------


def pressed(surface: bool, C_P: float = 300.0) -> tuple[RigModel, Array, float]:
    """A rig laid on and shaken a little, so that no symmetry hides a wrong sign."""
    rig = bench(
        law=LAW_5PK, mu=true_surface_5pk(30, 12) if surface else 0.7, contact=Contact(C_P=C_P)
    )
    model = rig.model(at(82, 270, 0.21), 16)
    laid = lay_on(model)
    rng = np.random.default_rng(11)
    q = laid.q.copy()
    q[:] += rng.normal(size=q.size) * np.tile([3e-6, 3e-6, 1e-3, 1e-3], q.size // 4)
    return model, q, laid.stretch


def assembled(
    model: RigModel, motion: Motion, points: Points, q: Array, stretch: float, row: int = 1
) -> tuple[Array, Array, Array]:
    """Residual, tangent, and the derivative in the stretch or (row 2) in the pulley's speed."""
    belt = model.system.belt
    limp = belt._replace(EA=0.0, EI=0.0, M=np.zeros_like(belt.M))  # the contact alone is left
    work = model.workspace(2)
    trial = Kinematics(q, np.zeros_like(q), q, np.zeros_like(q))
    assemble(model.system._replace(belt=limp), motion, points, trial, stretch, work)
    K = dense(work.A)
    K[HELD, HELD] = 0.0
    return work.vectors[0], K, work.vectors[row]


def fresh(model: RigModel, status: int, q: Array, stretch: float) -> Points:
    """Points whose last step was a little different from ``q``."""
    points = new_points(model.system.belt, status)
    still = Motion(0.2, 0.0, 1.0, 0.0)
    rng = np.random.default_rng(12)
    earlier = q + rng.normal(size=q.size) * np.tile([2e-6, 2e-6, 0, 0], q.size // 4)
    assembled(model, still, points, earlier, stretch)
    points.last["theta"][:] = points.theta
    points.last["rho"][:] = points.rho
    points.last["limit"][:] = points.F_max
    return points


def check_tangent(
    model: RigModel, motion: Motion, points: Points, q: Array, stretch: float, tolerance: float
) -> None:
    f, K, f_stretch = assembled(model, motion, points, q, stretch)
    assert np.abs(f).max() > 1.0
    columns = np.arange(q.size)
    if motion.rate > 0.0 and model.system.pulley.C_P > 0.0:
        # the share of a part that dissipates is differentiated in the penetration only
        share = share_in_contact(model, q)
        partly = np.any((share > 0) & (share < 1), axis=1)
        node = np.concatenate([partly, [False]]) | np.concatenate([[False], partly])
        columns = np.flatnonzero(~np.repeat(node, 4))
        assert np.count_nonzero(K[:, columns]) > 100
    for k in columns:
        d = 1e-9 if k % 4 < 2 else 1e-7
        step = np.zeros(q.size)
        step[k] = d
        ahead = assembled(model, motion, points, q + step, stretch)[0]
        behind = assembled(model, motion, points, q - step, stretch)[0]
        difference = (ahead - behind) / (2 * d)
        np.testing.assert_allclose(K[:, k], difference, atol=tolerance * np.abs(K).max())
    d = 1e-6
    by_stretch = assembled(model, motion, points, q, stretch + d)[0]
    by_stretch = by_stretch - assembled(model, motion, points, q, stretch - d)[0]
    # the damping of Eq. (4) belongs to a point, not to a length of belt
    if motion.rate == 0.0:
        np.testing.assert_allclose(
            f_stretch, by_stretch / (2 * d), atol=1e-6 * np.abs(f_stretch).max()
        )


def test_frictionless_contact_has_a_symmetric_exact_tangent() -> None:
    model, q, stretch = pressed(surface=False)
    points = new_points(model.system.belt, SLIDE)
    motion = Motion(0.2, 0.0, 0.0, 0.0)
    check_tangent(model, motion, points, q, stretch, 1e-6)
    _, K, _ = assembled(model, motion, points, q, stretch)
    np.testing.assert_allclose(K, K.T, atol=1e-12 * np.abs(K).max())


@pytest.mark.parametrize(("rate", "C_P"), [(0.0, 300.0), (2.0e3, 0.0), (2.0e3, 300.0)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_sliding_on_a_surface_has_an_exact_tangent(rate: float, C_P: float, sign: float) -> None:
    model, q, stretch = pressed(surface=True, C_P=C_P)
    points = fresh(model, SLIDE, q, stretch)
    points.patches["sign"][:] = sign
    motion = Motion(0.2, rate, 1.0, 0.0)
    check_tangent(model, motion, points, q, stretch, 2e-6)


@pytest.mark.parametrize("C_P", [0.0, 300.0])
def test_sticking_patches_have_an_exact_tangent(C_P: float) -> None:
    """Within the cone: the turning of a larger force is cut on purpose."""
    model, q, stretch = pressed(surface=False, C_P=C_P)
    points = fresh(model, STICK, q, stretch)
    motion = Motion(0.2, 2.0e3, 1.0, 1.0e3)
    assembled(model, motion, points, q, stretch)
    points.patches["la_T"][:] = 0.4 * points.patches["limit"]
    check_tangent(model, motion, points, q, stretch, 2e-6)


@pytest.mark.parametrize("status", [SLIDE, STICK])
@pytest.mark.parametrize("omega", [0.2, 0.25])
def test_a_running_belt_has_an_exact_tangent(status: int, omega: float) -> None:
    """The slip depends on position, gradient, stretch and speed of the pulley."""
    model, q, stretch = pressed(surface=True)
    points = fresh(model, status, q, stretch)
    motion = Motion(omega, 0.0, 1.0, 50.0, 0.0111)  # the belt turns with 0.22 rad/s
    assembled(model, motion, points, q, stretch)
    points.patches["sign"][:] = np.where(points.patches["slip"] < 0.0, -1.0, 1.0)
    slips = points.patches["slip"][points.patches["limit"] > 0.0]
    assert np.all(slips > 0.0) if omega > 0.22 else np.all(slips < 0.0)
    check_tangent(model, motion, points, q, stretch, 2e-6)
    by_omega = assembled(model, motion, points, q, stretch, row=2)[2]
    d = 1e-7
    ahead = assembled(model, motion._replace(omega=omega + d), points, q, stretch)[0]
    behind = assembled(model, motion._replace(omega=omega - d), points, q, stretch)[0]
    np.testing.assert_allclose(
        by_omega, (ahead - behind) / (2 * d), atol=1e-5 * np.abs(by_omega).max()
    )


def test_friction_is_mu_times_the_force_and_normal_forces_are_central() -> None:
    model, q, stretch = pressed(surface=True)
    points = new_points(model.system.belt, SLIDE)
    motion = Motion(0.21, 0.0, 1.0, 0.0)
    f, _, _ = assembled(model, motion, points, q, stretch)
    touches = np.zeros(points.F_N.shape, dtype=np.bool_)
    touches[:] = points.F_N > 0
    assert np.all(points.F_T[touches] > 0)
    # the moment of all forces about the pulley's centre is that of friction alone
    r, force = q.reshape(-1, 2), -f.reshape(-1, 2)
    moment = np.sum(r[:, 0] * force[:, 1] - r[:, 1] * force[:, 0])
    expected = -np.sum(points.rho * points.F_T)  # towards B is clockwise
    assert moment == pytest.approx(expected, rel=1e-12)
    # mu f integrated over what touches of each part, finely, with mu from the surface itself
    surface = true_surface_5pk(30, 12)
    rubbed = np.zeros(touches.shape)
    for index in zip(*np.nonzero(touches), strict=True):
        delta, sigma, w = part_of(model, q, *index)
        d = np.maximum(delta + sigma * np.linspace(-0.5, 0.5, 20001) * w, 0.0)
        line_force = LAW_5PK.force(d)
        rubbed[index] = np.mean(surface.mu(line_force, 0.21 * 0.05) * line_force) * w * stretch
    whole = np.zeros(touches.shape, dtype=np.bool_)
    all_touch = np.all(touches, axis=1, keepdims=True)
    whole[1:-1] = touches[1:-1] & all_touch[:-2] & all_touch[1:-1] & all_touch[2:]
    np.testing.assert_allclose(points.F_T[whole], rubbed[whole], rtol=2e-4)
    # where the force ends within a part, mu varies strongly: two look-ups are good to a percent
    np.testing.assert_allclose(points.F_T[touches], rubbed[touches], rtol=0.015)
    assert points.F_T.sum() == pytest.approx(rubbed.sum(), rel=1e-4)


def part_of(model: RigModel, q: Array, e: int, c: int) -> tuple[float, float, float]:
    """Penetration in the middle of a part, its slope, and the length of the part."""
    belt = model.system.belt
    nodes = q.reshape(-1, 4)[e : e + 2].reshape(4, 2)
    r, gradient = belt.N_c[e, c] @ nodes, belt.D_c[e, c] @ nodes
    rho = float(np.linalg.norm(r))
    return model.path.R - rho, -float(r @ gradient) / rho, float(belt.w_c[e, c])


def share_in_contact(model: RigModel, q: Array) -> Array:
    """Share of each part in contact, its penetration being linear along the part."""
    belt = model.system.belt
    r = np.stack([q.reshape(-1, 4)[:-1], q.reshape(-1, 4)[1:]], axis=1).reshape(-1, 4, 2)
    at_points = np.einsum("ecj,ejk->eck", belt.N_c, r)
    gradient = np.einsum("ecj,ejk->eck", belt.D_c, r)
    rho = np.linalg.norm(at_points, axis=-1)
    sigma = -np.sum(at_points * gradient, axis=-1) / rho
    x = np.linspace(-0.5, 0.5, 20001)
    share = np.zeros(rho.shape)
    for index in np.ndindex(rho.shape):
        share[index] = np.mean(model.path.R - rho[index] + sigma[index] * belt.w_c[index] * x > 0)
    return share


@pytest.mark.parametrize(("towards", "dissipates"), [(-1.0, True), (1.0, False)])
def test_what_touches_dissipates_while_approaching_only(towards: float, dissipates: bool) -> None:
    """Eqs. (1), (2), (4): a part that touches in part has its share.

    C_P belongs to a point of the default mesh; with m times its elements a point has C_P/m.
    """
    model, q, stretch = pressed(surface=False, C_P=300.0)
    default = bench(law=LAW_5PK).model(model.point).system.belt.h.size
    C_P = 300.0 * default / model.system.belt.h.size
    points = new_points(model.system.belt, SLIDE)
    assembled(model, Motion(0.0, 0.0, 0.0, 0.0), points, q, stretch)
    elastic = points.F_N.copy()
    rate, moved = 1.0e3, 1.0e-6
    points.last["rho"][:] = points.rho - towards * moved
    assembled(model, Motion(0.0, rate, 0.0, 0.0), points, q, stretch)
    share = share_in_contact(model, q)
    assert 0 < np.count_nonzero((share > 0) & (share < 1)) < 10
    expected = elastic + (C_P * rate * moved * share if dissipates else 0.0)
    np.testing.assert_allclose(points.F_N, expected, atol=1e-4 * 0.3)

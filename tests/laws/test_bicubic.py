"""Bounded bicubic patches: control points, the C2 spline where nothing is limited, accuracy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from beltid.laws.bicubic import bounded_cubic, patches
from beltid.laws.friction_surface import FrictionSurface

Array = NDArray[np.float64]

# power basis 1, s, s², s³ -> Bernstein basis
TO_BEZIER = np.array(
    [[1, 0, 0, 0], [1, 1 / 3, 0, 0], [1, 2 / 3, 1 / 3, 0], [1, 1, 1, 1]], dtype=float
)

# mu0, a, c, v0 of the virtual benches
LAWS = {
    "4pk": (1.05, 0.20, 0.50, 0.0020),
    "5pk": (0.95, 0.18, 0.45, 0.0015),
    "6pk": (0.88, 0.14, 0.38, 0.0012),
}
FORCES = np.array([900.0, 1650, 2600, 3550, 4300, 5050, 5850, 6600])
SPEEDS = np.array([0.0025, 0.005, 0.0105, 0.021, 0.042])


def law(belt: str, f: Array, v: Array) -> Array:
    mu0, a, c, v0 = LAWS[belt]
    speed = 1 + c * (np.log1p(v / v0) / np.log1p(0.01 / v0) - 1)
    return mu0 * (f / 5400) ** -a * speed


@given(st.integers(0, 2**32 - 1), st.integers(2, 6), st.integers(2, 6))
def test_every_control_point_lies_between_the_corners_of_its_cell(
    seed: int, nx: int, ny: int
) -> None:
    rng = np.random.default_rng(seed)
    x, y = np.cumsum(rng.lognormal(0, 1, nx)), np.cumsum(rng.lognormal(0, 1, ny))
    z = rng.choice([rng.uniform(0.5, 1.5, (nx, ny)), rng.integers(1, 4, (nx, ny)) * 0.5])
    C, _ = patches(x, y, z)
    control = TO_BEZIER @ C @ TO_BEZIER.T
    corners = np.stack([z[:-1, :-1], z[1:, :-1], z[:-1, 1:], z[1:, 1:]])
    low, high = corners.min(axis=0)[..., None, None], corners.max(axis=0)[..., None, None]
    assert np.all(control >= low - 1e-13)
    assert np.all(control <= high + 1e-13)


def test_control_points_of_a_saddle_where_no_twist_helps_stay_in_the_band() -> None:
    z = np.array([[1.0, 1, 9, 1], [1, 8, 1, 1], [9, 1, 1, 8], [1, 1, 9, 1]])
    C, limited = patches(np.arange(4.0), np.arange(4.0), z)
    control = TO_BEZIER @ C @ TO_BEZIER.T
    assert limited.all()
    assert control.min() >= 1.0 - 1e-13
    assert control.max() <= 9.0 + 1e-13


def test_unlimited_surface_is_the_tensor_cubic_spline() -> None:
    x, y = np.array([0.0, 0.7, 1.2, 2.0, 2.4, 3.1]), np.array([0.0, 0.5, 1.5, 2.0, 3.0])
    z = np.exp(-0.3 * x[:, None]) * (1 + 0.4 * y + 0.05 * y**2)
    C, limited = patches(x, y, z)
    assert not limited.any()
    at_x, at_y = np.linspace(0, 3.1, 41), np.linspace(0, 3.0, 37)
    spline = CubicSpline(y, CubicSpline(x, z)(at_x), axis=1)(at_y)
    i = np.clip(np.searchsorted(x, at_x, side="right") - 1, 0, x.size - 2)
    j = np.clip(np.searchsorted(y, at_y, side="right") - 1, 0, y.size - 2)
    s = ((at_x - x[i]) / np.diff(x)[i])[:, None] ** np.arange(4)
    t = ((at_y - y[j]) / np.diff(y)[j])[:, None] ** np.arange(4)
    values = np.einsum("ma,mnab,nb->mn", s, C[i[:, None], j[None, :]], t)
    assert values == pytest.approx(spline, rel=1e-13)


@pytest.mark.parametrize("nodes", [1, 2, 3])
def test_few_nodes_reproduce_the_polynomial_they_determine(nodes: int) -> None:
    # in the coordinate of the surface: constant, line, parabola; monotone, so nothing is limited
    f = np.array([1000.0, 2500, 6000])[:nodes]
    polynomial = np.polynomial.Polynomial([1.2, -0.2, 0.01][:nodes])
    surface = FrictionSurface(f, [0.01], polynomial(np.log1p(f / 1000.0))[:, None])
    assert surface.degree == (nodes - 1, 0)
    assert not surface.limited.any()
    at = np.linspace(f[0], f[-1], 31)
    assert surface.mu(at, 0.01) == pytest.approx(polynomial(np.log1p(at / 1000.0)), rel=1e-14)


@pytest.mark.parametrize(("belt", "documented"), [("4pk", 7e-4), ("5pk", 7e-4), ("6pk", 5e-4)])
def test_known_laws_are_met_between_the_nodes_as_documented(belt: str, documented: float) -> None:
    surface = FrictionSurface(FORCES, SPEEDS, law(belt, FORCES[:, None], SPEEDS))
    assert not surface.limited.any()
    f, v = np.geomspace(900, 6600, 150)[:, None], np.geomspace(0.0025, 0.042, 120)
    assert np.abs(surface.mu(f, v) / law(belt, f, v) - 1).max() < documented


def test_bounded_cubic_is_the_natural_spline_where_no_bound_acts():
    from scipy.interpolate import CubicSpline

    x = np.array([0.0, 0.7, 1.5, 2.1, 3.0])
    z = 1.0 + 2.0 * x + 0.1 * np.sin(x)  # steep enough for the spline to stay between its points
    at = np.linspace(0.0, 3.0, 61)
    expected = CubicSpline(x, z, bc_type="natural")(at)
    np.testing.assert_allclose(bounded_cubic(x, z, at), expected, rtol=1e-12)


@pytest.mark.parametrize(("by_x", "by_y", "by_z"), [(1e8, 1, 1), (1, 1e8, 1), (1, 1, 1e-8)])
def test_which_slopes_are_limited_depends_on_no_unit(by_x, by_y, by_z):
    rng = np.random.default_rng(4)
    x, y = np.cumsum(rng.lognormal(0, 0.5, 9)), np.cumsum(rng.lognormal(0, 0.5, 7))
    # steep along both axes, so that slopes are free and some twists are not
    z = 5.0 + 2.0 * x[:, None] + 2.0 * y + rng.normal(0.0, 0.4, (9, 7))
    C, limited = patches(x, y, z)
    scaled, same = patches(by_x * x, by_y * y, by_z * z)
    assert 0 < limited.sum() < limited.size
    assert np.array_equal(limited, same)
    np.testing.assert_allclose(scaled, by_z * C, rtol=1e-9, atol=1e-9 * by_z)

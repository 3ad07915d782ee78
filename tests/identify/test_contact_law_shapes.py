"""Contact laws about a reference force: values and coefficients from laws that are known."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from beltid.errors import FitError
from beltid.identify.press.contact_law_fits import fit_law
from beltid.identify.press.contact_laws import (
    CurveData,
    FittedLaw,
    coefficients_of,
    n_shape,
    shape_gradient,
    shape_values,
    slope_values,
)

SPAN, F = 2e-4, 8000.0
DISTANCE = 1.1e-4  # from the contact point to where F is reached
Y = np.linspace(-0.45, 0.6, 13)


def k_of(*shares):
    """Coefficients over the penetration of a law that carries F at the distance, by shares of F."""
    return np.array([share * F / DISTANCE ** (k + 1) for k, share in enumerate(shares)])


def shape_of(k):
    """Its Taylor coefficients where F is reached, in the scaled unknowns."""
    polynomial = np.polynomial.Polynomial([0.0, *k])
    return np.array(
        [
            polynomial.deriv(j)(DISTANCE) / math.factorial(j) * SPAN**j / F
            for j in range(1, len(k) + 1)
        ]
    )


LAWS = [
    ("linear", k_of(1.0)),
    ("quadratic", k_of(0.6, 0.4)),
    ("quadratic", k_of(1.3, -0.3)),
    ("quadratic", k_of(0.0, 1.0)),
    ("cubic", k_of(0.5, 0.3, 0.2)),
    ("cubic", k_of(0.9, 0.3, -0.2)),
]


@pytest.mark.parametrize(("name", "k"), LAWS)
def test_values_and_slopes_of_polynomials(name, k):
    shape = shape_of(k)
    delta = DISTANCE + SPAN * Y
    law = np.polynomial.Polynomial([0.0, *k])
    assert shape_values(name, shape, Y) == pytest.approx(law(delta) / F, rel=1e-12, abs=1e-14)
    assert slope_values(name, shape, Y) == pytest.approx(law.deriv()(delta) * SPAN / F, rel=1e-10)
    assert n_shape(name) == len(k)
    h = 1e-6
    for j in range(shape.size):
        e = h * np.eye(shape.size)[j]
        if k[0] == 0.0:  # a pure square is held so: its derivatives are those of any quadratic
            expected = Y ** (j + 1)
        else:
            expected = (shape_values(name, shape + e, Y) - shape_values(name, shape - e, Y)) / 2 / h
        assert shape_gradient(name, shape, Y)[:, j] == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_a_pure_square_has_no_force_before_the_contact():
    shape = shape_of(k_of(0.0, 1.0))
    before = -DISTANCE / SPAN - np.array([0.01, 0.3])
    assert shape_values("quadratic", shape, before) == pytest.approx([0.0, 0.0], abs=1e-14)
    assert slope_values("quadratic", shape, before) == pytest.approx([0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("n", [1.2, 1.5, 2.4])
def test_values_slopes_and_gradient_of_the_power_law(n):
    shape = np.array([0.55, n])
    assert shape_values("power", shape, Y) == pytest.approx((1 + Y / 0.55) ** n, rel=1e-13)
    h = 1e-6
    slope = (shape_values("power", shape, Y + h) - shape_values("power", shape, Y - h)) / 2 / h
    assert slope_values("power", shape, Y) == pytest.approx(slope, rel=1e-7)
    for j in (0, 1):
        e = h * np.eye(2)[j]
        by = (shape_values("power", shape + e, Y) - shape_values("power", shape - e, Y)) / 2 / h
        assert shape_gradient("power", shape, Y)[:, j] == pytest.approx(by, rel=1e-6, abs=1e-9)
    before = np.array([-0.56, -3.0])
    assert shape_values("power", shape, before) == pytest.approx([0.0, 0.0], abs=1e-9)
    assert np.array_equal(slope_values("power", shape, before), [0.0, 0.0])
    assert n_shape("power") == 2


def data(x=(0.0,), f=(1.0,), owner=(0,)):
    n = len(x)
    return CurveData(
        np.array(x, float), np.array(f, float), np.array(owner), np.zeros(n, int), SPAN, F
    )


def fitted(name, shape, by_unknowns=None, covariance=None):
    q = len(shape)
    by = np.eye(q) if by_unknowns is None else by_unknowns
    fit = SimpleNamespace(covariance=covariance)
    return FittedLaw(name, np.array(shape), np.array([0.25, 0.5]), fit, by)  # type: ignore[arg-type]


@pytest.mark.parametrize(("name", "k"), LAWS)
def test_coefficients_over_the_penetration(name, k):
    shape = shape_of(k)
    found = coefficients_of(fitted(name, shape), data())
    assert found.values == pytest.approx(k, rel=1e-9, abs=1e-9 * F / DISTANCE)
    assert found.distance_m == pytest.approx(DISTANCE, rel=1e-9)
    assert found.names == ("k_linear", "k_quadratic", "k_cubic")[: k.size]
    assert found.units == ("N/m²", "N/m³", "N/m⁴")[: k.size]
    if k[0] == 0.0:
        expected = np.diag([0.0, F / SPAN**2])
        assert found.gradient == pytest.approx(expected, rel=1e-12)
        return
    for j in range(k.size):
        e = 1e-6 * np.eye(k.size)[j]
        high, low = (coefficients_of(fitted(name, shape + s * e), data()).values for s in (1, -1))
        assert found.gradient[:, j] == pytest.approx((high - low) / 2e-6, rel=1e-5)


def test_coefficients_of_the_power_law():
    shape = np.array([0.55, 1.4])
    found = coefficients_of(fitted("power", shape), data())
    assert found.values == pytest.approx([F / (0.55 * SPAN) ** 1.4, 1.4], rel=1e-12)
    assert (found.names, found.units) == (("k", "n"), ("N/m^(1+n)", "-"))
    assert found.distance_m == pytest.approx(0.55 * SPAN, rel=1e-14)
    for j in (0, 1):
        e = 1e-6 * np.eye(2)[j]
        high, low = (
            coefficients_of(fitted("power", shape + s * e), data()).values for s in (1, -1)
        )
        assert found.gradient[:, j] == pytest.approx((high - low) / 2e-6, rel=1e-6, abs=1e-6)


def test_a_law_without_a_zero_has_no_contact_point():
    with pytest.raises(FitError, match="its force never comes down to zero"):
        coefficients_of(fitted("quadratic", [1.0, 0.5]), data())  # 1 + y + y²/2 > 0


def test_nodes_of_several_curves():
    curves = [
        SimpleNamespace(
            test="b", position_m=np.array([1e-5, 2e-5, 4e-5]), middle_N_m=np.array([1.0, 4.0, 9.0])
        ),
        SimpleNamespace(
            test="a", position_m=np.array([0.0, 6e-5]), middle_N_m=np.array([2.0, 8.0])
        ),
        SimpleNamespace(test="b", position_m=np.array([3e-5]), middle_N_m=np.array([10.0])),
    ]
    found = CurveData.of(curves)  # type: ignore[arg-type]
    assert found.span_m == pytest.approx(6e-5)
    assert found.F_N_m == 4.0  # half of the smallest largest force
    assert found.x == pytest.approx(np.array([1, 2, 4, 0, 6, 3]) / 6.0)
    assert found.f == pytest.approx(np.array([1, 4, 9, 2, 8, 10]) / 4.0)
    assert found.owner.tolist() == [0, 0, 0, 1, 1, 0]
    assert found.parts.tolist() == [0, 0, 0, 1, 1, 2]
    kept = found.only(np.array([False, False, False, True, True, False]))
    assert kept.owner.tolist() == [0, 0]
    assert kept.parts.tolist() == [1, 1]
    assert (kept.span_m, kept.F_N_m) == (found.span_m, found.F_N_m)


def test_where_each_test_reaches_the_reference():
    found = data(
        x=(0.4, 0.1, 0.2, 0.3, 0.0, 0.5), f=(1.6, 0.4, 0.9, 0.8, 0.5, 2.5), owner=(0, 0, 0, 0, 1, 1)
    ).reference_positions()
    # the force that falls from 0.9 to 0.8 counts as 0.9; from there 0.1 of 0.7 over 0.1
    assert found == pytest.approx([0.3 + 0.1 / 7.0, 0.125])


def test_covariance_and_values_of_a_held_law():
    covariance = np.diag([4.0, 9.0, 1.0, 1.0])
    free = fitted("quadratic", [2.0, 0.5], covariance=covariance)
    assert not free.is_held
    assert free.shape_cofactor == pytest.approx(np.diag([4.0, 9.0]))
    held = fitted("quadratic", [2.0, 0.0], np.array([[3.0], [1.0]]), covariance)
    assert held.is_held
    assert held.shape_cofactor == pytest.approx(np.array([[36.0, 12.0], [12.0, 4.0]]))
    nodes = data(x=(0.35, 0.4), f=(1.0, 1.0), owner=(0, 1))
    assert free.values(nodes) == pytest.approx([1 + 0.2 + 0.005, 1 - 0.2 + 0.005])
    assert free.values(nodes, np.array([0.35, 0.3])) == pytest.approx([1.0, 1.205])


def test_a_law_that_softens_is_held_at_a_line_and_a_squared_one_at_a_pure_square():
    y = np.linspace(-0.4, 0.5, 20)
    softening = data(x=y, f=1 + 2.0 * y - 0.4 * y**2, owner=np.zeros(20, int))
    held, line = fit_law("quadratic", softening), fit_law("linear", softening)
    assert held.is_held
    assert held.shape == pytest.approx([line.shape[0], 0.0], rel=1e-12)
    expected = np.array([[line.shape_cofactor[0, 0], 0.0], [0.0, 0.0]])
    assert held.shape_cofactor == pytest.approx(expected, rel=1e-12)
    # steeper than a square from any contact point: (1 + y / L)^3
    steep = data(x=y, f=(1 + y / 0.9) ** 3, owner=np.zeros(20, int))
    square = fit_law("quadratic", steep)
    A, B = square.shape
    assert square.is_held
    assert pytest.approx(4 * B, rel=1e-12) == A * A
    # one unknown, the distance L: dA/dL = -2/L², dB/dL = -2/L³
    L = 2.0 / A
    assert square.shape_by_unknowns[:, 0] == pytest.approx([-2 / L**2, -2 / L**3], rel=1e-9)

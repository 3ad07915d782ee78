"""Euler–Eytelwein on the friction rig: closed forms, limits and quadrature."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.integrate import quad

from beltid.laws import capstan

R = 0.05


@pytest.mark.parametrize(
    ("tight", "slack", "apparent", "last_digit"),
    [(371.09, 182.01, 0.49777, 1e-5), (367.81, 179.81, 0.5000, 1e-4)],
)
def test_reference_tensions_give_their_apparent_friction(
    tight: float, slack: float, apparent: float, last_digit: float
) -> None:
    beta = math.radians(82)
    # half a unit of the last digit of mu, and of both tensions
    rounding = 0.5 * last_digit + 0.005 * (1 / tight + 1 / slack) / beta
    assert capstan.friction_coefficient(tight, slack, beta) == pytest.approx(apparent, abs=rounding)


@given(st.floats(0.01, 3), st.floats(0.1, 6), st.floats(1, 1e4))
def test_friction_coefficient_solves_euler_eytelwein(mu: float, beta: float, slack: float) -> None:
    tight = slack * math.exp(mu * beta)  # Eq. (5)
    assert capstan.friction_coefficient(tight, slack, beta) == pytest.approx(mu, rel=1e-11)


def test_tensions_that_do_not_pull_have_no_coefficient() -> None:
    mu = capstan.friction_coefficient([100.0, -1.0, 5.0, 0.0], [50.0, 10.0, 0.0, 5.0], 1.0)
    assert mu[0] == pytest.approx(math.log(2.0))
    assert np.all(np.isnan(mu[1:]))
    assert capstan.friction_coefficient(0.2, 0.1, 0.5) == pytest.approx(2 * math.log(2.0))


@given(st.floats(0.05, 2.5), st.floats(0.3, 3), st.floats(10, 1000))
def test_mean_force_is_the_mean_of_the_force_along_the_arc(
    mu: float, beta: float, tight: float
) -> None:
    slack = tight / math.exp(mu * beta)
    integral, _ = quad(lambda phi: float(capstan.normal_force(phi, tight, mu, R)), 0.0, beta)
    assert capstan.mean_normal_force(tight, slack, R) == pytest.approx(integral / beta, rel=1e-9)


@pytest.mark.parametrize("x", [0.0, 1e-12, 1e-9, 0.99e-8, 1.01e-8, 1e-6, 1e-4])
def test_mean_force_of_nearly_equal_tensions_keeps_all_digits(x: float) -> None:
    tight = 270.0 * (1.0 + x)
    exact = (tight - 270.0) / 270.0  # x as it is after rounding
    series = 270.0 / R * (1 + exact / 2 - exact**2 / 12 + exact**3 / 24)
    assert capstan.mean_normal_force(tight, 270.0, R) == pytest.approx(series, rel=1e-14)


@given(st.floats(0.1, 6.2), st.floats(1, 1e3), st.floats(1, 1e3))
def test_torque_and_hub_force_give_the_tensions_that_made_them(
    beta: float, tight: float, slack: float
) -> None:
    # as vectors: the spans part by the angle beta
    H = math.hypot(tight * math.cos(beta) - slack, tight * math.sin(beta))
    found = capstan.tensions_by_hub_force((tight - slack) * R, H, beta, R)
    # H says less of the sum, the nearer the arc is to a whole turn or to nothing
    rounding = 1e-12 * (tight + slack) / math.sin(beta / 2) ** 2
    assert found[0] == pytest.approx(tight, rel=1e-12, abs=rounding)
    assert found[1] == pytest.approx(slack, rel=1e-12, abs=rounding)


BENT = [
    # EI [N m²], R, L [m], clamped, arc [°]; T_tight, T_slack [N], torque [N m], resultant [N] of
    # the forces at the ends of an independent discrete elastic rod on its bed, 900 elements, mu 0.7
    (0.03, 0.045, 0.12, False, 50, 87.51, 46.10, 1.8613, 72.08),
    (0.03, 0.045, 0.12, False, 90, 219.77, 75.62, 6.4811, 235.92),
    (0.02, 0.05, 0.10, False, 40, 66.96, 39.53, 1.3705, 47.77),
    (0.02, 0.05, 0.10, False, 40, 338.57, 206.93, 6.5719, 226.88),
    (0.02, 0.05, 0.10, False, 170, 274.76, 36.97, 11.8795, 311.53),
    (0.03, 0.045, 0.12, True, 50, 87.11, 45.26, 1.8818, 72.86),
    (0.02, 0.05, 0.10, True, 40, 66.77, 38.88, 1.3936, 48.57),
    (0.02, 0.05, 0.10, True, 82, 163.82, 60.58, 5.1581, 169.74),
]


@pytest.mark.parametrize("row", BENT)
def test_the_hub_force_of_a_bent_belt_is_that_of_an_elastic_rod(row: tuple[float, ...]) -> None:
    EI, radius, L, clamped, arc, tight, slack, M, H = row
    spans, beta = capstan.Spans(EI, L, bool(clamped)), math.radians(arc)
    assert capstan.hub_force(tight, slack, beta, radius, spans) == pytest.approx(H, rel=2.5e-3)
    found = capstan.tensions_by_hub_force(M, H, beta, radius, spans)
    assert found == pytest.approx((tight, slack), rel=4e-3)
    straight = capstan.tensions_by_hub_force(M, H, beta, radius)
    if arc < 90:
        assert sum(straight) > 1.015 * (tight + slack)


@given(st.floats(0.5, 3.5), st.floats(30, 1e3), st.floats(30, 1e3))
def test_torque_and_hub_force_of_a_bent_belt_give_its_tensions(
    beta: float, tight: float, slack: float
) -> None:
    spans = capstan.Spans(0.01, 0.15)
    H = capstan.hub_force(tight, slack, beta, R, spans)
    found = capstan.tensions_by_hub_force((tight - slack) * R, H, beta, R, spans)
    assert found == pytest.approx((tight, slack), rel=1e-9)


def test_a_hub_force_that_no_tensions_have_gives_none() -> None:
    # d = 200 N: at 82 degrees the resultant is at least 200 N * cos(41 degrees) = 150.9 N
    found = capstan.tensions_by_hub_force([10.0, 10.0], [150.0, 152.0], math.radians(82), R)
    assert np.isnan(found[0]).tolist() == [True, False]
    assert np.isnan(capstan.tensions_by_hub_force(10.0, 300.0, 2.0 * math.pi, R)[0])


def test_a_moving_belt_is_pressed_on_by_what_its_momentum_leaves() -> None:
    # 0.1 kg/m at 30 m/s: 90 N
    tight, slack = (capstan.pressing_tension(T, 0.1, 30.0) for T in (90.0 + 200.0, 90.0 + 100.0))
    assert capstan.friction_coefficient(tight, slack, 1.0) == pytest.approx(math.log(2.0))
    # 30.5 m/s at the pulley's surface under a belt of 30 m/s
    assert capstan.sliding_speed(610.0, R) - 30.0 == pytest.approx(0.5)

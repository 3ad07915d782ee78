"""Euler–Eytelwein on the friction rig: closed forms, limits and quadrature."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from beltid.laws import capstan

R = 0.05


def test_half_a_turn_that_multiplies_by_e_has_one_over_pi() -> None:
    mu = capstan.friction_coefficient(100.0 * math.e, 100.0, math.pi)
    assert mu == pytest.approx(1.0 / math.pi, rel=1e-15)


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


def test_sliding_speed_of_the_run_shown_in_the_paper() -> None:
    assert capstan.sliding_speed(0.21, R) == pytest.approx(0.0105)
    both = capstan.sliding_speed(np.array([0.21, 0.84]), R)
    assert both == pytest.approx([0.0105, 0.042])


@given(st.floats(0.05, 2.5), st.floats(0.3, 3), st.floats(10, 1000))
def test_mean_force_is_the_mean_of_the_force_along_the_arc(
    mu: float, beta: float, tight: float
) -> None:
    slack = tight / math.exp(mu * beta)
    integral, _ = quad(lambda phi: float(capstan.normal_force(phi, tight, mu, R)), 0.0, beta)
    mean = capstan.mean_normal_force(tight, slack, R)
    assert mean == pytest.approx(integral / beta, rel=1e-9)


@given(st.floats(1, 1e4), st.floats(1, 1e4))
def test_mean_force_is_symmetric_and_between_its_ends(a: float, b: float) -> None:
    mean = float(capstan.mean_normal_force(a, b, R))
    assert mean == pytest.approx(float(capstan.mean_normal_force(b, a, R)), rel=1e-9)
    assert min(a, b) / R * (1 - 1e-12) <= mean <= max(a, b) / R * (1 + 1e-12)


@pytest.mark.parametrize("x", [0.0, 1e-12, 1e-9, 0.99e-8, 1.01e-8, 1e-6, 1e-4])
def test_mean_force_of_nearly_equal_tensions_keeps_all_digits(x: float) -> None:
    tight = 270.0 * (1.0 + x)
    exact = (tight - 270.0) / 270.0  # x as it is after rounding
    series = 270.0 / R * (1 + exact / 2 - exact**2 / 12 + exact**3 / 24)
    assert capstan.mean_normal_force(tight, 270.0, R) == pytest.approx(series, rel=1e-14)

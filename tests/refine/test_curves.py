"""Splines of ln mu over ln f_N and their roughness, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from beltid.refine.curves import Curves

FORCES = np.log(np.geomspace(300.0, 15000.0, 12))
SPEEDS = np.log([0.0025, 0.005, 0.0105, 0.042])


@pytest.fixture
def curves() -> Curves:
    return Curves(FORCES, SPEEDS)


def test_power_law_is_reproduced_between_the_knots_and_held_beyond(curves):
    slope, level = -0.18, 0.3
    at = np.log([200.0, 300.0, 777.0, 15000.0, 40000.0])
    found = curves.basis(at) @ (level + slope * FORCES)
    expected = level + slope * np.clip(at, FORCES[0], FORCES[-1])
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_bending_of_power_laws_is_zero(curves):
    p = np.concatenate([level - 0.1 * k * FORCES for k, level in enumerate([1.0, 2.0, 3.0, 4.0])])
    assert p @ curves.bending() @ p == pytest.approx(0.0, abs=1e-9)


def test_bending_of_a_cubic_hump_is_its_integral():
    # a natural spline through sin(pi u) on a fine grid: integral of (pi² sin(pi u))² = pi⁴/2
    u = np.linspace(0.0, 1.0, 400)
    fine = Curves(u, np.array([0.0]))
    assert np.sin(np.pi * u) @ fine.bending() @ np.sin(np.pi * u) == pytest.approx(
        np.pi**4 / 2, rel=1e-4
    )


def test_difference_sees_only_what_is_not_separable(curves):
    shape = np.sin(FORCES)
    separable = np.concatenate([level + shape for level in [0.1, 0.5, 0.2, 0.9]])
    form = curves.difference()
    assert separable @ form @ separable == pytest.approx(0.0, abs=1e-9)
    # slopes 0, 1, 0, 0 in ln f: (1/gap) over the two gaps beside it, times the range of ln f
    tilted = np.zeros((4, 12))
    tilted[1] = FORCES
    gaps = np.diff(SPEEDS)
    expected = (1.0 / gaps[0] + 1.0 / gaps[1]) * (FORCES[-1] - FORCES[0])
    assert tilted.ravel() @ form @ tilted.ravel() == pytest.approx(expected, rel=1e-10)


def test_one_speed_has_no_difference():
    assert not Curves(FORCES, SPEEDS[:1]).difference().any()

"""Splines of ln mu over ln f_N and their smooth coordinates, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from beltid.refine.posterior import Curves

FORCES = np.log(np.geomspace(300.0, 15000.0, 12))
SPEEDS = np.log([0.0025, 0.005, 0.0105, 0.042])
CURVES = Curves(FORCES, SPEEDS)


def squares(curves: Curves, values: np.ndarray) -> dict[str, float]:
    """h' h of each part of given values at the knots."""
    parts = curves.coordinates()
    h = np.linalg.solve(np.hstack(list(parts.values())), values)
    ends = np.cumsum([Z.shape[1] for Z in parts.values()])[:-1]
    return {part: float(x @ x) for part, x in zip(parts, np.split(h, ends), strict=True)}


def test_a_power_law_is_reproduced_between_the_knots_and_held_beyond() -> None:
    at = np.log([200.0, 300.0, 777.0, 15000.0, 40000.0])
    expected = 0.3 - 0.18 * np.clip(at, FORCES[0], FORCES[-1])
    np.testing.assert_allclose(CURVES.basis(at) @ (0.3 - 0.18 * FORCES), expected, rtol=1e-12)


def test_a_power_law_at_levels_of_the_speeds_is_free() -> None:
    found = squares(
        CURVES, np.concatenate([level - 0.1 * FORCES for level in (1.0, 2.0, 3.0, 4.0)])
    )
    assert found["curve"] + found["difference"] == pytest.approx(0.0, abs=1e-12)


def test_a_curve_that_speeds_share_costs_its_integral() -> None:
    # a natural spline through sin(pi u) on a fine grid: integral of (pi² sin(pi u))² = pi⁴/2
    u = np.linspace(0.0, 1.0, 120)
    found = squares(Curves(u, SPEEDS[:1]), np.sin(np.pi * u))
    assert found["curve"] == pytest.approx(np.pi**4 / 2, rel=1e-3)
    assert "difference" not in Curves(u, SPEEDS[:1]).coordinates() or not found["difference"]


def test_slopes_that_differ_cost_their_integral() -> None:
    # slopes 0, 1, 0, 0 in ln f less their mean: 1/gap over the two gaps beside it, times the range
    tilted = np.zeros((4, 12))
    tilted[1] = FORCES
    gaps = np.diff(SPEEDS)
    expected = (1.0 / gaps[0] + 1.0 / gaps[1]) * (FORCES[-1] - FORCES[0])
    found = squares(CURVES, tilted.ravel())
    assert found["difference"] == pytest.approx(expected, rel=1e-9)
    assert found["curve"] == pytest.approx(0.0, abs=1e-9)

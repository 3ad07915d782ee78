"""Curves of one arc and speed: through their points, errors propagated, settings told apart."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from beltid.identify.surface.surface import Curve, Points, grid_of

F = np.array([900.0, 1650, 2600, 3550, 4300, 5050, 5850, 6600])


def curve(mu: np.ndarray, se: np.ndarray) -> Curve:
    return Curve(68.0, 0.01, F[: mu.size], mu, se, band=(float(mu.min()), float(mu.max())))


def test_curve_passes_through_its_points_and_ends_there() -> None:
    mu = 1 + 0.1 * np.sin(F)
    one = curve(mu, np.full(8, 0.01))
    assert one.at(F) == pytest.approx(mu, rel=1e-14)
    assert np.diag(one.covariance(F)) == pytest.approx((0.01 / mu) ** 2, rel=1e-12)
    assert np.isnan(one.at(np.array([899.0, 6601.0]))).all()


def test_half_way_between_two_runs_the_error_falls_by_root_two() -> None:
    pair = curve(np.array([1.0, 0.9]), np.array([0.01, 0.009]))  # 1 % each
    middle = np.array([np.sqrt(900.0 * 1650.0)])
    assert pair.at(middle) == pytest.approx([np.sqrt(0.9)])
    assert pair.covariance(middle)[0, 0] == pytest.approx(0.01**2 / 2, rel=1e-12)


@given(st.integers(0, 2**32 - 1), st.integers(2, 8))
@settings(max_examples=15, deadline=None)
def test_curve_stays_between_neighbouring_points(seed: int, n: int) -> None:
    mu = np.random.default_rng(seed).uniform(0.5, 1.5, n)
    for k in range(n - 1):
        values = curve(mu, np.zeros(n)).at(np.geomspace(F[k], F[k + 1], 20))
        low, high = sorted(mu[k : k + 2])
        assert np.all(values >= low * (1 - 1e-13))
        assert np.all(values <= high * (1 + 1e-13))


def test_precise_repetitions_count_more_than_rough_ones() -> None:
    points = Points(
        arc_deg=np.full(3, 40.0),
        f=np.array([1000.0, 1000.0, 2000.0]),
        v=np.full(3, 0.01),
        mu=np.array([1.0, 1.3, 0.9]),
        se=np.array([0.01, 0.02, 0.01]),
    )
    grid = grid_of(points)
    assert grid is not None
    ((one,),) = grid.by_speed
    assert one.f == pytest.approx([1000.0, 2000.0])
    assert one.mu == pytest.approx([1.06, 0.9])  # weights 4 : 1
    assert one.se == pytest.approx([0.02 / np.sqrt(5), 0.01])

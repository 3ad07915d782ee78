"""Curves and their average over arcs by hand: who counts where, what is carried on, in doubt."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm
from scipy.stats import t as student

from beltid.identify.surface.surface import Curve, Points, average, grid_of

SPEEDS = np.array([0.01, 0.02, 0.04])


def curve(arc, speed, f, mu, se=0.01, band=(0.1, 3.0)):
    f, mu = np.array(f, float), np.array(mu, float)
    return Curve(arc, SPEEDS[speed], f, mu, np.full(f.size, se), band)


def average_of(*rows, errors_known=True):
    return average(rows, (1000.0, 4000.0), errors_known)


# Student's t with one, two and three degrees of freedom; as probable as one standard deviation
T_1, T_2, T_3 = (student.ppf(norm.cdf(1.0), n) for n in (1, 2, 3))
LONG, SHORT = (1000.0, 2000.0, 4000.0), (1000.0, 2000.0)


def test_nodes_that_all_arcs_cover():
    curves = (
        (curve(40.0, 0, LONG, (1.0, 0.9, 0.8), 0.01), curve(80.0, 0, LONG, (0.9, 0.8, 0.7), 0.02)),
        (curve(40.0, 1, LONG, (1.2, 1.1, 1.0), 0.01), curve(80.0, 1, LONG, (1.1, 1.0, 0.86), 0.02)),
    )
    grid, notes = average_of(*curves)
    assert notes == []
    assert grid.normal_force_N_m == pytest.approx(LONG, rel=1e-12)
    assert math.isnan(grid.arc_deg)
    assert grid.mu == pytest.approx(np.array([[0.95, 1.15], [0.85, 1.05], [0.75, 0.93]]), rel=1e-9)
    assert np.all(grid.n_arcs == 2)
    apart = np.array([[0.1, 0.1], [0.1, 0.1], [0.1, 0.14]])
    assert grid.mu_spread == pytest.approx(apart / math.sqrt(2.0), rel=1e-9)
    runs = 0.01**2 + 0.02**2
    excess = (apart**2 / 2 - runs / 2) / grid.mu**2
    tau2 = T_1**2 * excess.mean(axis=1)[:, None]  # over both speeds at the same force
    assert grid.mu_se == pytest.approx(np.sqrt(runs / 4 + tau2 * grid.mu**2 / 2), rel=5e-3)
    assert np.linalg.norm(grid.scatter, axis=-1) == pytest.approx(grid.mu_se / grid.mu, rel=1e-9)
    assert average_of(*curves, errors_known=False)[0].mu_se == pytest.approx(grid.mu_se, rel=1e-9)


def test_an_arc_that_ends_is_carried_on_in_parallel():
    row = (
        curve(40.0, 0, LONG, (1.0, 0.9, 0.72)),
        curve(60.0, 0, LONG, (1.1, 1.0, 0.8)),
        curve(80.0, 0, SHORT, (0.7, 0.6)),
    )
    grid, notes = average_of(row)
    assert notes == []
    growth = (0.72 + 0.8) / (0.9 + 1.0)
    assert grid.mu[:, 0] == pytest.approx([2.8 / 3, 2.5 / 3, (0.72 + 0.8 + 0.6 * growth) / 3])
    assert grid.n_arcs[:, 0].tolist() == [3, 3, 2]
    assert grid.mu_spread[2, 0] == pytest.approx(0.08 / math.sqrt(2.0))
    # the last force has half as much freedom as the others, and tells its spread itself
    runs = 2 * 0.01**2
    excess = T_2**2 * (0.08**2 / 2 - runs / 2) / grid.mu[2, 0] ** 2
    expected = math.sqrt(runs / 4 + excess * grid.mu[2, 0] ** 2 / 2)
    assert grid.mu_se[2, 0] == pytest.approx(expected, rel=0.02)  # errors are those of ln mu


def test_a_force_where_most_arcs_have_ended_takes_the_spread_of_its_neighbour():
    ends = [curve(a, 0, SHORT, (1.0 + 0.001 * a, 0.9 + 0.001 * a)) for a in (40.0, 50.0)]
    others = curve(70.0, 0, LONG, (1.0, 0.9, 0.8)), curve(80.0, 0, LONG, (1.2, 1.1, 1.0))
    grid, _ = average_of((*ends, *others))
    assert grid.n_arcs[:, 0].tolist() == [4, 4, 2]
    spread = np.std([0.94, 0.95, 0.9, 1.1], ddof=1)
    tau2 = T_3**2 * (spread**2 - 4 * 0.01**2 / 4) / grid.mu[1, 0] ** 2
    expected = math.sqrt(2 * 0.01**2 / 4 + tau2 * grid.mu[2, 0] ** 2 / 2)
    assert grid.mu_se[2, 0] == pytest.approx(expected, rel=0.02)


def test_one_tension_gives_a_surface_over_the_speed_alone():
    """Its force differs between arcs and speeds: the node is their geometric mean."""
    found = grid_of(
        Points(
            np.array([40.0, 40.0, 80.0, 80.0]),
            np.array([1000.0, 1000.0, 1600.0, 1600.0]),
            np.array([0.01, 0.02, 0.01, 0.02]),
            np.array([1.0, 1.2, 0.9, 1.1]),
            np.full(4, 0.01),
        )
    )
    grid, _ = average(*found[:2], True)
    assert grid.normal_force_N_m == pytest.approx([math.sqrt(1000.0 * 1600.0)])
    assert grid.mu == pytest.approx(np.array([[0.95, 1.15]]))
    assert np.all(grid.n_arcs == 2)


# --- curves of one arc and speed ---

F = np.array([900.0, 1650, 2600, 3550, 4300, 5050, 5850, 6600])


def curve_of(mu: np.ndarray, se: np.ndarray) -> Curve:
    return Curve(68.0, 0.01, F[: mu.size], mu, se, band=(float(mu.min()), float(mu.max())))


def test_curve_passes_through_its_points_and_ends_there() -> None:
    mu = 1 + 0.1 * np.sin(F)
    one = curve_of(mu, np.full(8, 0.01))
    assert one.at(F) == pytest.approx(mu, rel=1e-14)
    assert np.diag(one.covariance(F)) == pytest.approx((0.01 / mu) ** 2, rel=1e-12)
    assert np.isnan(one.at(np.array([899.0, 6601.0]))).all()


def test_half_way_between_two_runs_the_error_falls_by_root_two() -> None:
    pair = curve_of(np.array([1.0, 0.9]), np.array([0.01, 0.009]))  # 1 % each
    middle = np.array([np.sqrt(900.0 * 1650.0)])
    assert pair.at(middle) == pytest.approx([np.sqrt(0.9)])
    assert pair.covariance(middle)[0, 0] == pytest.approx(0.01**2 / 2, rel=1e-12)


@given(st.integers(0, 2**32 - 1), st.integers(2, 8))
@settings(max_examples=15, deadline=None)
def test_curve_stays_between_neighbouring_points(seed: int, n: int) -> None:
    mu = np.random.default_rng(seed).uniform(0.5, 1.5, n)
    for k in range(n - 1):
        values = curve_of(mu, np.zeros(n)).at(np.geomspace(F[k], F[k + 1], 20))
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
    ((one,),) = grid[0]
    assert one.f == pytest.approx([1000.0, 2000.0])
    assert one.mu == pytest.approx([1.06, 0.9])  # weights 4 : 1
    assert one.se == pytest.approx([0.02 / np.sqrt(5), 0.01])

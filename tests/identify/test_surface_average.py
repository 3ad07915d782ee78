"""The average over arcs by hand: who counts where, what is carried on, what is in doubt."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import norm
from scipy.stats import t as student

from beltid.identify.surface.average import average
from beltid.identify.surface.curves import Curve, CurveSet

SPEEDS = np.array([0.01, 0.02, 0.04])


def curve(arc, speed, f, mu, se=0.01, band=(0.1, 3.0)):
    f, mu = np.array(f, float), np.array(mu, float)
    return Curve(arc, SPEEDS[speed], f, mu, np.full(f.size, se), band)


def curve_set(*curves):
    return CurveSet(curves)


# Student's t with one, two and three degrees of freedom; as probable as one standard deviation
T_1, T_2, T_3 = (student.ppf(norm.cdf(1.0), n) for n in (1, 2, 3))
LONG, SHORT = (1000.0, 2000.0, 4000.0), (1000.0, 2000.0)


def test_nodes_that_all_arcs_cover():
    curves = curve_set(
        curve(40.0, 0, LONG, (1.0, 0.9, 0.8), 0.01),
        curve(40.0, 1, LONG, (1.2, 1.1, 1.0), 0.01),
        curve(80.0, 0, LONG, (0.9, 0.8, 0.7), 0.02),
        curve(80.0, 1, LONG, (1.1, 1.0, 0.86), 0.02),
    )
    grid, notes = average(curves, True)
    assert notes == ()
    assert grid.normal_force_N_m == pytest.approx(LONG, rel=1e-12)
    assert math.isnan(grid.arc_deg)
    assert grid.mu == pytest.approx(np.array([[0.95, 1.15], [0.85, 1.05], [0.75, 0.93]]), rel=1e-9)
    assert np.all(grid.n_arcs == 2)
    apart = np.array([[0.1, 0.1], [0.1, 0.1], [0.1, 0.14]])
    assert grid.mu_spread == pytest.approx(apart / math.sqrt(2.0), rel=1e-9)
    runs = 0.01**2 + 0.02**2
    excess = (apart**2 / 2 - runs / 2) / grid.mu**2
    tau2 = T_1**2 * excess.mean(axis=1)[:, None]  # over both speeds at the same force
    assert grid.mu_se == pytest.approx(np.sqrt(runs / 4 + tau2 * grid.mu**2 / 2), rel=1e-9)
    unknown, _ = average(curves, False)
    assert unknown.mu_se == pytest.approx(grid.mu_se, rel=1e-9)


def test_an_arc_that_ends_is_carried_on_in_parallel():
    curves = curve_set(
        curve(40.0, 0, LONG, (1.0, 0.9, 0.72)),
        curve(60.0, 0, LONG, (1.1, 1.0, 0.8)),
        curve(80.0, 0, SHORT, (0.7, 0.6)),
    )
    grid, notes = average(curves, True)
    assert notes == ()
    growth = (0.72 + 0.8) / (0.9 + 1.0)
    assert grid.mu[:, 0] == pytest.approx([2.8 / 3, 2.5 / 3, (0.72 + 0.8 + 0.6 * growth) / 3])
    assert grid.n_arcs[:, 0].tolist() == [3, 3, 2]
    assert grid.mu_spread[2, 0] == pytest.approx(0.08 / math.sqrt(2.0))
    # the last force has half as much freedom as the others, and tells its spread itself
    runs = 2 * 0.01**2
    excess = T_2**2 * (0.08**2 / 2 - runs / 2) / grid.mu[2, 0] ** 2
    expected = math.sqrt(runs / 4 + excess * grid.mu[2, 0] ** 2 / 2)
    assert grid.mu_se[2, 0] == pytest.approx(expected, rel=1e-9)


def test_a_force_where_most_arcs_have_ended_takes_the_spread_of_its_neighbour():
    ends = [curve(a, 0, SHORT, (1.0 + 0.001 * a, 0.9 + 0.001 * a)) for a in (40.0, 50.0)]
    curves = curve_set(
        *ends, curve(70.0, 0, LONG, (1.0, 0.9, 0.8)), curve(80.0, 0, LONG, (1.2, 1.1, 1.0))
    )
    grid, _ = average(curves, True)
    assert grid.n_arcs[:, 0].tolist() == [4, 4, 2]
    runs = 4 * 0.01**2
    spread = np.std([0.94, 0.95, 0.9, 1.1], ddof=1)
    tau2 = T_3**2 * (spread**2 - runs / 4) / grid.mu[1, 0] ** 2
    expected = math.sqrt(2 * 0.01**2 / 4 + tau2 * grid.mu[2, 0] ** 2 / 2)
    assert grid.mu_se[2, 0] == pytest.approx(expected, rel=1e-9)


def test_a_speed_an_arc_was_never_run_at_follows_in_proportion():
    curves = curve_set(
        curve(40.0, 0, LONG, (1.0, 0.9, 0.8)),
        curve(40.0, 1, LONG, (1.2, 1.1, 1.0)),
        curve(40.0, 2, LONG, (1.5, 1.4, 1.3)),
        curve(80.0, 0, LONG, (0.9, 0.81, 0.72)),  # nine tenths of the other
        curve(80.0, 2, LONG, (1.05, 0.98, 0.91)),  # seven tenths
    )
    grid, _ = average(curves, True)
    # half way between the logarithms of the speeds: eight tenths
    assert grid.mu[:, 1] == pytest.approx(np.array([1.2, 1.1, 1.0]) * 0.9, rel=1e-9)
    assert grid.n_arcs[:, 1].tolist() == [1, 1, 1]


def test_a_speed_that_ends_early_is_held_with_the_change_of_the_others_in_doubt():
    curves = curve_set(
        curve(40.0, 0, LONG, (1.0, 0.9, 0.8)),
        curve(40.0, 1, LONG, (1.2, 1.1, 1.0)),
        curve(40.0, 2, SHORT, (1.5, 1.4)),
    )
    grid, notes = average(curves, True)
    assert "speed 0.04 m/s: measured up to 2000 N/m only" in notes[0]
    assert grid.n_arcs.tolist() == [[1, 1, 1], [1, 1, 1], [1, 1, 0]]
    assert grid.mu[:, 2] == pytest.approx([1.5, 1.4, 1.4])
    change = 0.5 * ((1 - 0.8 / 0.9) + (1 - 1.0 / 1.1))
    assert grid.mu_se[2, 2] == pytest.approx(1.4 * math.hypot(0.01 / 1.4, change), rel=1e-9)
    assert grid.mu_se[1, 2] == pytest.approx(0.01, rel=1e-9)


def test_one_tension_gives_a_surface_over_the_speed_alone():
    """Its force differs between arcs and speeds: the node is their geometric mean."""
    grid, notes = average(
        curve_set(
            curve(40.0, 0, [1000.0], [1.0]),
            curve(40.0, 1, [1000.0], [1.2]),
            curve(80.0, 0, [1600.0], [0.9]),
            curve(80.0, 1, [1600.0], [1.1]),
        ),
        True,
    )
    assert notes == ()
    assert grid.normal_force_N_m == pytest.approx([math.sqrt(1000.0 * 1600.0)])
    assert grid.mu == pytest.approx(np.array([[0.95, 1.15]]))
    assert np.all(grid.n_arcs == 2)

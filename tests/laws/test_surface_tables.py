"""Cells and local coordinates of the tables, by hand, on the nodes and on both sides of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from beltid.laws.surface_tables import evaluate_cell, locate, log_nodes

LN2 = math.log(2.0)
NODES, REFERENCE = log_nodes(np.array([1000.0, 3000.0, 7000.0]))


def test_nodes_are_logarithms_over_the_smallest_positive_one() -> None:
    assert pytest.approx([LN2, 2 * LN2, 3 * LN2], rel=1e-15) == NODES
    assert REFERENCE == 1000.0
    nodes, reference = log_nodes(np.array([0.0, 500.0, 1500.0]))
    assert nodes == pytest.approx([0.0, LN2, 2 * LN2], rel=1e-15)
    assert reference == 500.0
    assert log_nodes(np.array([0.0]))[1] == math.inf


PLACES = [
    (-5.0, (0, 0.0, 0.0)),
    (0.0, (0, 0.0, 0.0)),
    (999.0, (0, 0.0, 0.0)),
    (1000.0, (0, 0.0, 1 / (LN2 * 2000.0))),
    (1000.0 * (2**1.5 - 1), (0, 0.5, 1 / (LN2 * 1000.0 * 2**1.5))),
    (3000.0, (1, 0.0, 1 / (LN2 * 4000.0))),
    (1000.0 * (2**2.25 - 1), (1, 0.25, 1 / (LN2 * 1000.0 * 2**2.25))),
    (7000.0, (1, 1.0, 1 / (LN2 * 8000.0))),
    (7001.0, (1, 1.0, 0.0)),
]


def test_cell_and_slope_of_values_one_by_one_and_at_once() -> None:
    expected = np.array([place for _, place in PLACES]).T
    one_by_one = np.array([locate(NODES, REFERENCE, value) for value, _ in PLACES]).T
    at_once = locate(NODES, REFERENCE, np.array([value for value, _ in PLACES]))
    for found in (one_by_one, at_once):
        assert np.array_equal(found[0], expected[0])
        assert found[1] == pytest.approx(expected[1], rel=1e-14, abs=1e-15)
        assert found[2] == pytest.approx(expected[2], rel=1e-14)


def test_on_a_single_node_nothing_depends_on_the_value() -> None:
    for nodes in ([1000.0], [0.0]):
        for value in (-1.0, 0.0, 999.0, 1000.0, 1001.0):
            assert locate(*log_nodes(np.array(nodes)), value) == (0, 0.0, 0.0)


def test_zero_may_be_the_first_node() -> None:
    nodes, reference = log_nodes(np.array([0.0, 1000.0]))
    assert locate(nodes, reference, 0.0) == pytest.approx((0, 0.0, 1 / (LN2 * 1000.0)))


def test_the_polynomials_of_a_cell_and_their_derivatives() -> None:
    rng = np.random.default_rng(3)
    C = rng.uniform(-1.0, 1.0, (2, 3, 4, 4))
    i, j = rng.integers(0, 2, 8), rng.integers(0, 3, 8)
    s, t = rng.uniform(0.0, 1.0, (2, 8))
    p = np.polynomial.polynomial
    cells = [(C[i[k], j[k]], s[k], t[k]) for k in range(8)]
    mu, mu_s, mu_t = evaluate_cell(C, i, j, s, t)
    assert mu == pytest.approx([p.polyval2d(s, t, c) for c, s, t in cells], rel=1e-12)
    for axis, found in enumerate((mu_s, mu_t)):
        expected = [p.polyval2d(s, t, p.polyder(c, axis=axis)) for c, s, t in cells]
        assert found == pytest.approx(expected, rel=1e-12)

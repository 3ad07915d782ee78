"""Several signals at once give what each gives alone; sums are those of the definition."""

from __future__ import annotations

import math
import statistics

import numpy as np
import pytest

from beltid.identify.estimators.signal import (
    column_spread,
    exponentials,
    running_median,
    spike_mask,
    sums_of_squares,
)


@pytest.mark.parametrize("n", [2, 4, 5, 6, 7, 40, 41])
def test_signals_side_by_side_are_taken_each_on_its_own(n: int) -> None:
    rng = np.random.default_rng(n)
    rows = rng.normal(200.0, 1.0, (5, n))
    rows[1] *= 30.0  # a floor or a noise that one signal took from another would show
    rows[2, n // 2] += 50.0
    rows[3, 0] += 50.0
    rows[4] = 7.0
    assert np.array_equal(running_median(rows, 5), [running_median(row, 5) for row in rows])
    assert np.array_equal(spike_mask(rows, 6.0), [spike_mask(row, 6.0) for row in rows])
    if n >= 40:
        assert np.argwhere(spike_mask(rows, 12.0)).tolist() == [[2, n // 2], [3, 0]]


def test_decays_and_sums_of_squares_by_hand() -> None:
    decays = exponentials(np.array([0.5, 2.0]), np.array([0.0, 1.0, 3.0]))
    by_hand = [[math.exp(-t / tau) for t in (0.0, 1.0, 3.0)] for tau in (0.5, 2.0)]
    assert np.allclose(decays, by_hand, rtol=1e-15)
    squares = [math.fsum(x * x for x in row) for row in by_hand]
    assert np.allclose(sums_of_squares(decays), squares, rtol=1e-15)
    assert np.allclose(sums_of_squares(np.asfortranarray(decays)), squares, rtol=1e-15)


def test_the_spread_of_a_column_is_the_standard_deviation_of_its_values() -> None:
    columns = np.random.default_rng(3).normal(100.0, [1.0, 20.0], (57, 2))
    expected = [statistics.pstdev(column.tolist()) for column in columns.T]
    assert np.allclose(column_spread(columns), expected, rtol=1e-13)

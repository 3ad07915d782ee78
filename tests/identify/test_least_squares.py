"""Linear least squares on certified data (NIST StRD)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from beltid.errors import FitError, InputError
from beltid.identify.estimators.least_squares import solve_linear

# NIST Statistical Reference Datasets, linear regression; values as certified (15 digits)
PONTIUS_TEXT = """
.11019 .21956 .32949 .43899 .54803 .65694 .76562 .87487 .98292 1.09146 1.20001 1.30822 1.41599
1.52399 1.63194 1.73947 1.84646 1.95392 2.06128 2.16844 .11052 .22018 .32939 .43886 .54798 .65739
.76596 .87474 .98300 1.09150 1.20004 1.30818 1.41613 1.52408 1.63159 1.73965 1.84696 1.95445
2.06177 2.16829
"""
PONTIUS_X = [150000 * k for k in range(1, 21)] * 2
CERTIFIED = {
    "Pontius": (
        (PONTIUS_X, PONTIUS_TEXT.split(), (0, 1, 2)),
        [0.673565789473684e-03, 0.732059160401003e-06, -0.316081871345029e-14],
        [0.107938612033077e-03, 0.157817399981659e-09, 0.486652849992036e-16],
        0.205177424076185e-03,
    ),
    "NoInt1": (
        (range(60, 71), range(130, 141), (1,)),
        [2.07438016528926],
        [0.165289256198347e-01],
        3.56753034006338,
    ),
    "NoInt2": (
        ((4, 5, 6), (3, 4, 4), (1,)),
        [0.727272727272727],
        [0.420827318078432e-01],
        0.369274472937998,
    ),
}


def digits(found, certified) -> float:
    """Number of agreeing digits (log relative error) of the worst component."""
    error = np.abs(np.asarray(found) - certified) / np.abs(certified)
    return float(-np.log10(max(error.max(), 1e-16)))


@pytest.mark.parametrize("name", CERTIFIED)
def test_certified_values_of_nist(name):
    (x, y, powers), beta, se, residual_sd = CERTIFIED[name]
    design = np.array([[float(v) ** k for k in powers] for v in x])
    fit = solve_linear(design, np.array(y, dtype=float))
    assert digits(fit.parameters, beta) >= 11
    assert digits(fit.se, se) >= 11
    assert digits(np.sqrt(fit.residual_variance), residual_sd) >= 11


@given(st.lists(st.integers(-9, 9), min_size=3, max_size=3), st.floats(-12, 12))
def test_exact_data_give_the_exact_coefficients_in_any_unit(truth, exponent):
    unit = 10.0**exponent
    x = np.linspace(-1.0, 2.0, 9) * unit
    design = np.column_stack([np.ones(9), x, x**2])
    beta = np.array(truth) / unit ** np.arange(3)
    fit = solve_linear(design, design @ beta)
    assert np.abs((fit.parameters - beta) * unit ** np.arange(3)).max() < 1e-12


def test_dependent_columns_are_refused():
    x = np.arange(5.0)
    with pytest.raises(FitError, match="linearly dependent"):
        solve_linear(np.column_stack([x, 3 * x]), x)
    with pytest.raises(FitError, match="linearly dependent"):
        solve_linear(np.column_stack([x, 0 * x]), x)


def test_shapes_and_values_are_checked():
    with pytest.raises(InputError, match="n >= p"):
        solve_linear(np.ones((1, 2)), np.ones(1))
    with pytest.raises(InputError, match="finite"):
        solve_linear(np.array([[1.0], [np.nan]]), np.ones(2))

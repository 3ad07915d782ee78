"""Least squares, linear and nonlinear, on certified data (NIST StRD)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from beltid.errors import ConvergenceError, FitError, InputError
from beltid.identify.estimators.least_squares import LeastSquares, solve_linear, solve_nonlinear

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
    assert digits(np.sqrt(np.diag(fit.covariance)), se) >= 11
    freedom = fit.residuals.size - fit.parameters.size
    assert digits(np.linalg.norm(fit.residuals) / freedom**0.5, residual_sd) >= 11


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


# --- nonlinear: eleven certified digits, sets of higher difficulty ---


@dataclass(frozen=True)
class Certified:
    """A NIST Statistical Reference Dataset with its certified values (11 digits)."""

    model: Callable
    y: np.ndarray
    starts: tuple
    beta: list
    sd: list
    rss: float


def numbers(text: str) -> np.ndarray:
    return np.array(text.split(), dtype=float)


def derivatives_of(model: Callable, b: np.ndarray) -> np.ndarray:
    """By steps along the imaginary axis: exact to rounding, as nothing is subtracted."""
    step = 1e-30 * np.maximum(np.abs(b), 1e-30)
    return np.column_stack(
        [model(b + 1j * one).imag / one[k] for k, one in enumerate(np.diag(step))]
    )


MGH09_X = numbers("4 2 1 0.5 0.25 0.167 0.125 0.1 0.0833 0.0714 0.0625")
MGH09_Y = numbers("195.7 194.7 173.5 160.0 84.4 62.7 45.6 34.2 32.3 23.5 24.6") / 1000.0
MGH10_X = np.arange(50.0, 126.0, 5.0)
MGH10_Y = numbers(
    "34780 28610 23650 19630 16370 13720 11540 9744 8261 7030 6005 5147 4427 3820 3307 2872"
)
BOXBOD_X = numbers("1 2 3 5 7 10")
BOXBOD_Y = numbers("109 149 149 191 213 224")
THURBER_Y = """
80.574 84.248 87.264 87.195 89.076 89.608 89.868 90.101 92.405 95.854 100.696 101.060 401.672
390.724 567.534 635.316 733.054 759.087 894.206 990.785 1090.109 1080.914 1122.643 1178.351 1260.531
1273.514 1288.339 1327.543 1353.863 1414.509 1425.208 1421.384 1442.962 1464.350 1468.705 1447.894
1457.628
"""
THURBER_X = """
-3.067 -2.981 -2.921 -2.912 -2.840 -2.797 -2.702 -2.699 -2.633 -2.481 -2.363 -2.322 -1.501 -1.460
-1.274 -1.212 -1.100 -1.046 -0.915 -0.714 -0.566 -0.545 -0.400 -0.309 -0.109 -0.103 0.010 0.119
0.377 0.790 0.963 1.006 1.115 1.572 1.841 2.047 2.200
"""
THURBER_BETA = """
1.2881396800e03 1.4910792535e03 5.8323836877e02 7.5416644291e01 9.6629502864e-01 3.9797285797e-01
4.9727297349e-02
"""
THURBER_SD = """
4.6647963344e00 3.9571156086e01 2.8698696102e01 5.5675370270e00 3.1333340687e-02 1.4984928198e-02
6.5842344623e-03
"""


def mgh09(b: np.ndarray) -> np.ndarray:
    return b[0] * (MGH09_X**2 + b[1] * MGH09_X) / (MGH09_X**2 + b[2] * MGH09_X + b[3])


def mgh10(b: np.ndarray) -> np.ndarray:
    return b[0] * np.exp(b[1] / (MGH10_X + b[2]))


def boxbod(b: np.ndarray) -> np.ndarray:
    return b[0] * (1.0 - np.exp(-b[1] * BOXBOD_X))


def thurber(b: np.ndarray) -> np.ndarray:
    powers = np.column_stack([numbers(THURBER_X) ** k for k in range(4)])
    return powers @ b[:4] / (1.0 + powers[:, 1:] @ b[4:])


SETS = {
    "MGH09": Certified(
        mgh09,
        MGH09_Y,
        ((25.0, 39.0, 41.5, 39.0), (0.25, 0.39, 0.415, 0.39)),
        [1.9280693458e-01, 1.9128232873e-01, 1.2305650693e-01, 1.3606233068e-01],
        [1.1435312227e-02, 1.9633220911e-01, 8.0842031232e-02, 9.0025542308e-02],
        3.0750560385e-04,
    ),
    "MGH10": Certified(
        mgh10,
        MGH10_Y,
        ((2.0, 400000.0, 25000.0), (0.02, 4000.0, 250.0)),
        [5.6096364710e-03, 6.1813463463e03, 3.4522363462e02],
        [1.5687892471e-04, 2.3309021107e01, 7.8486103508e-01],
        8.7945855171e01,
    ),
    "BoxBOD": Certified(
        boxbod,
        BOXBOD_Y,
        ((1.0, 1.0), (100.0, 0.75)),
        [2.1380940889e02, 5.4723748542e-01],
        [1.2354515176e01, 1.0455993237e-01],
        1.1680088766e03,
    ),
    "Thurber": Certified(
        thurber,
        numbers(THURBER_Y),
        ((1000, 1000, 400, 40, 0.7, 0.3, 0.03), (1300, 1500, 500, 75, 1, 0.4, 0.05)),
        numbers(THURBER_BETA).tolist(),
        numbers(THURBER_SD).tolist(),
        5.6427082397e03,
    ),
}


def solve(model, y, start, **bounds) -> LeastSquares:
    def residuals(theta):
        # far from the minimum some models overflow: such a step is refused, as it is too bad
        with np.errstate(all="ignore"):
            return np.nan_to_num(np.clip(y - model(theta), -1e100, 1e100), nan=1e100)

    def derivatives(theta):
        with np.errstate(all="ignore"):
            return np.nan_to_num(np.clip(-derivatives_of(model, theta), -1e100, 1e100))

    return solve_nonlinear(residuals, derivatives, start, **bounds)


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("start", [0, 1])
def test_certified_values_of_nist_from_both_starts(name, start):
    s = SETS[name]
    fit = solve(s.model, s.y, s.starts[start])
    assert digits(fit.parameters, s.beta) >= 6
    assert digits(np.sqrt(np.diag(fit.covariance)), s.sd) >= 6
    assert digits(fit.residuals @ fit.residuals, s.rss) >= 6


def test_bounds_are_kept():
    x = np.linspace(0.0, 3.0, 20)
    y = 2.0 * np.exp(-0.7 * x)
    fit = solve(
        lambda b: b[0] * np.exp(-b[1] * x),
        y,
        [1.0, 1.5],
        bounds=([0.0, 1.0], [np.inf, 5.0]),
    )
    e = np.exp(-x)  # with the rate at its bound of 1 the amplitude is a linear problem
    assert fit.parameters == pytest.approx([e @ y / (e @ e), 1.0], rel=1e-6)


def test_a_search_that_breaks_down_is_an_error():
    with pytest.raises(ConvergenceError, match="broke down"):
        solve_nonlinear(lambda b: b * np.nan, lambda b: np.eye(1), [1.0])
    with pytest.raises(ConvergenceError, match="broke down"):
        solve(lambda b: b, np.ones(1), [1.0], bounds=(2.0, 3.0))

"""Fits of the normal contact laws of `contact_laws` to press curves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from beltid.errors import FitError
from beltid.identify.estimators.least_squares import solve_least_squares
from beltid.identify.estimators.nonlinear_fit import NonlinearFit, fit_nonlinear
from beltid.identify.press.contact_laws import (
    CurveData,
    FittedLaw,
    LawName,
    n_shape,
    shape_gradient,
    shape_values,
    slope_values,
)

Array = NDArray[np.float64]

EXPONENTS = (0.8, 1.0, 1.25, 1.5, 2.0, 3.0)
"""First values of the exponent; the best of them is taken."""
EXPONENT_BOUNDS = (0.2, 12.0)
DISTANCE_BOUNDS = (1.0e-3, 100.0)
"""Of L, in units of the travel that is fitted."""


def fit_law(name: LawName, data: CurveData, start: FittedLaw | None = None) -> FittedLaw:
    """Fit one law to the nodes, with a free position for every test.

    A coefficient of the quadratic law that would be negative is held at zero, as in the law that
    is handed on.

    Parameters
    ----------
    name : {"linear", "quadratic", "power", "cubic"}
        The law.
    data : CurveData
        Nodes.
    start : FittedLaw, optional
        Where the shape is searched from; by default first values are taken from the nodes.

    Raises
    ------
    FitError
        If there are fewer nodes than unknowns, or they do not determine the law.
    ConvergenceError
        If the search does not reach a minimum.
    """
    q = n_shape(name)
    p = data.reference_positions()
    if data.x.size <= q + p.size:
        raise FitError(f"{name} law: {data.x.size} nodes, must be more than {q + p.size}")
    shape = _first_shape(name, data, p) if start is None else start.shape
    low, high = np.full(q, -np.inf), np.full(q, np.inf)
    if name == "power":
        low, high = np.transpose([DISTANCE_BOUNDS, EXPONENT_BOUNDS])
    fit = _fitted(name, data, np.clip(shape, low, high), (low, high))
    law = FittedLaw(name, fit.parameters[:q], fit.parameters[q:], fit, np.eye(q))
    if name != "quadratic":
        return law
    A, B = law.shape
    if A > 0.0 and B < 0.0:
        line = fit_law("linear", data)
        held = np.array([line.shape[0], 0.0])
        return FittedLaw(name, held, line.positions, line.fit, np.array([[1.0], [0.0]]))
    return _purely_quadratic(data, A) if A > 0.0 and A * A < 4.0 * B else law


def _fitted(
    name: LawName, data: CurveData, shape: Array, bounds: tuple[Array, Array]
) -> NonlinearFit:
    """Search the minimum from a first shape, with its bounds."""
    q, p = shape.size, data.reference_positions()

    def model(theta: Array) -> Array:
        return shape_values(name, theta[:q], data.x - theta[q:][data.owner])

    def jacobian(theta: Array) -> Array:
        y = data.x - theta[q:][data.owner]
        slope = -slope_values(name, theta[:q], y)
        own = data.owner[:, None] == np.arange(p.size)
        return np.column_stack(
            [shape_gradient(name, theta[:q], y), np.where(own, slope[:, None], 0.0)]
        )

    free = np.full(p.size, np.inf)
    low, high = np.concatenate([bounds[0], -free]), np.concatenate([bounds[1], free])
    return fit_nonlinear(model, jacobian, data.f, np.concatenate([shape, p]), bounds=(low, high))


def _purely_quadratic(data: CurveData, A: float) -> FittedLaw:
    """The power law with the exponent 2, as a quadratic law; its one unknown is L."""
    p = data.reference_positions()

    def at(L: float) -> Array:
        return np.array([L, 2.0])

    def model(theta: Array) -> Array:
        return shape_values("power", at(theta[0]), data.x - theta[1:][data.owner])

    def jacobian(theta: Array) -> Array:
        shape, y = at(theta[0]), data.x - theta[1:][data.owner]
        own = data.owner[:, None] == np.arange(p.size)
        moved = np.where(own, -slope_values("power", shape, y)[:, None], 0.0)
        return np.column_stack([shape_gradient("power", shape, y)[:, 0], moved])

    low, high = np.full(1 + p.size, -np.inf), np.full(1 + p.size, np.inf)
    low[0], high[0] = DISTANCE_BOUNDS
    first = np.clip(2.0 / A, *DISTANCE_BOUNDS)
    fit = fit_nonlinear(model, jacobian, data.f, np.append(first, p), bounds=(low, high))
    L = float(fit.parameters[0])
    shape, by_L = np.array([2.0 / L, 1.0 / L**2]), np.array([[-2.0 / L**2], [-2.0 / L**3]])
    return FittedLaw("quadratic", shape, fit.parameters[1:], fit, by_L)


def _first_shape(name: LawName, data: CurveData, p: Array) -> Array:
    """First values of the shape, from linear problems."""
    y = data.x - p[data.owner]
    if name != "power":
        columns = np.column_stack([y**k for k in range(1, n_shape(name) + 1)])
        return solve_least_squares(columns, data.f - 1.0).coefficients
    best, found = np.inf, np.array([1.0, 1.0])
    for n in EXPONENTS:  # f^(1/n) is linear in y
        root = np.maximum(data.f, 0.0) ** (1.0 / n) - 1.0
        slope = float(y @ root) / float(y @ y)
        if slope <= 0.0:
            continue
        trial = np.array([1.0 / slope, n])
        rss = float(np.sum((data.f - shape_values(name, trial, y)) ** 2))
        if rss < best:
            best, found = rss, trial
    return found


def position_of(law: FittedLaw, data: CurveData) -> Array:
    """Positions p with which a law of known shape fits the nodes best, shape (tests,)."""
    found = data.reference_positions()
    for j in range(found.size):
        mine = data.owner == j
        x, f = data.x[mine], data.f[mine]

        def model(p: Array, x: Array = x) -> Array:
            return shape_values(law.name, law.shape, x - p[0])

        def jacobian(p: Array, x: Array = x) -> Array:
            return -slope_values(law.name, law.shape, x - p[0])[:, None]

        found[j] = fit_nonlinear(model, jacobian, f, found[j : j + 1]).parameters[0]
    return found

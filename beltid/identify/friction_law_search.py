"""Search for the unknowns of a parametric friction law, without a guess from outside.

The laws are linear in their amplitudes c, so for given exponent a and speed scale v* these are a
linear problem (variable projection). The exponent comes from a regression within the speeds; a scan
over v* shows where minima lie; from the best of them all unknowns are fitted together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.errors import ConvergenceError, FitError
from beltid.identify.friction_points import FrictionPoints
from beltid.identify.nonlinear_fit import NonlinearFit, fit_nonlinear
from beltid.laws.friction_formulas import (
    PARAMETERS,
    FrictionLawName,
    has_force_exponent,
    has_speed_scale,
    speed_terms,
)

Array = NDArray[np.float64]

SCAN = 49
"""Values of the speed scale that are tried."""
MOST_STARTS = 3
"""The search starts from the best local minima of the scan, at most so many."""
REACH: dict[FrictionLawName, float] = {
    "power_log": 1.0e3,
    "power_stribeck_1": 10.0,
    "power_stribeck_2": 10.0,
}
"""The speed scale is sought within the speeds of the points, widened by this factor each way."""


@dataclass(frozen=True, slots=True, eq=False)
class LawSearch:
    """Solution in the unknowns of the search: amplitudes, then a and ln v* where there are."""

    law: FrictionLawName
    fit: NonlinearFit
    jacobian: Array
    at_bound: bool


def search_law(law: FrictionLawName, points: FrictionPoints, f0: float) -> LawSearch:
    """Fit one law from the best first values of a scan.

    Parameters
    ----------
    law : str
        The law.
    points : FrictionPoints
        Points with weights.
    f0 : float
        Reference force [N/m].

    Raises
    ------
    FitError
        If the points are too few or too much alike for the law.
    ConvergenceError
        If no start leads to a minimum.
    """
    reason = _too_little(law, points)
    if reason:
        raise FitError(reason)
    model, jacobian, size = _functions(law, points.f / f0, points.v)
    low, high = np.full(size, -np.inf), np.full(size, np.inf)
    if has_speed_scale(law):
        reach = math.log(REACH[law])
        low[-1], high[-1] = math.log(points.v.min()) - reach, math.log(points.v.max()) + reach
    weights = 1.0 / points.se
    fits: list[NonlinearFit] = []
    failures: list[ConvergenceError] = []
    for start in _starts(law, points, f0, (float(low[-1]), float(high[-1]))):
        try:
            fits.append(
                fit_nonlinear(
                    model, jacobian, points.mu, start, weights=weights, bounds=(low, high)
                )
            )
        except ConvergenceError as error:
            failures.append(error)
    if not fits:
        raise failures[0]
    best = min(fits, key=lambda fit: fit.sum_of_squares)
    J = jacobian(best.parameters) / points.se[:, None]
    return LawSearch(law, best, J, bool(best.at_bound.any()))


def _functions(
    law: FrictionLawName, f: Array, v: Array
) -> tuple[Callable[[Array], Array], Callable[[Array], Array], int]:
    """Values of a law and their derivatives by its unknowns, and the number of these."""
    scaled, with_a = has_speed_scale(law), has_force_exponent(law)
    m = speed_terms(law, v, 0.0)[0].shape[1]

    def parts(theta: Array) -> tuple[Array, Array, Array]:
        terms, by_scale = speed_terms(law, v, float(theta[-1]) if scaled else 0.0)
        return f ** -(theta[m] if with_a else 0.0), terms @ theta[:m], by_scale @ theta[:m]

    def model(theta: Array) -> Array:
        falling, along, _ = parts(theta)
        return falling * along

    def jacobian(theta: Array) -> Array:
        falling, along, by_scale = parts(theta)
        terms, _ = speed_terms(law, v, float(theta[-1]) if scaled else 0.0)
        columns = [falling[:, None] * terms]
        if with_a:
            columns.append((-np.log(f) * falling * along)[:, None])
        if scaled:
            columns.append((falling * by_scale)[:, None])
        return np.column_stack(columns)

    return model, jacobian, m + with_a + scaled


def _too_little(law: FrictionLawName, points: FrictionPoints) -> str:
    """Why the points cannot tell the parameters of a law; empty if they can."""
    p = len(PARAMETERS[law])
    if points.f.size < p:
        return f"{points.f.size} points for {p} parameters"
    if has_force_exponent(law) and not points.forces_differ:
        return "all points at one force: the exponent a is not determined"
    needed = {"power_log": 3, "power_stribeck_1": 4, "power_stribeck_2": 4}.get(law, 1)
    if points.n_speeds < needed:
        return f"{points.n_speeds} sliding speeds, {needed} are needed for its speed dependence"
    return ""


def _starts(
    law: FrictionLawName, points: FrictionPoints, f0: float, scales: tuple[float, float]
) -> list[Array]:
    """First values: the exponent by regression, the amplitudes for each of a scan of scales."""
    a = [points.exponent()] if has_force_exponent(law) else []
    falling = (points.f / f0) ** -(a[0] if a else 0.0)
    grid = np.linspace(*scales, SCAN) if has_speed_scale(law) else np.zeros(1)
    found, misfits = [], []
    for s in grid[1:-1] if grid.size > 2 else grid:
        terms = falling[:, None] * speed_terms(law, points.v, float(s))[0] / points.se[:, None]
        c = np.linalg.lstsq(terms, points.mu / points.se, rcond=1e-12)[0]
        misfits.append(float(np.sum((points.mu / points.se - terms @ c) ** 2)))
        found.append(np.array([*c, *a, *([s] if has_speed_scale(law) else [])]))
    return [found[k] for k in _local_minima(misfits)[:MOST_STARTS]]


def _local_minima(misfits: Sequence[float]) -> list[int]:
    """Local minima of a scan, the lowest first."""
    padded = [math.inf, *misfits, math.inf]
    lowest = [k for k, value in enumerate(misfits) if value <= padded[k] and value <= padded[k + 2]]
    return sorted(lowest, key=lambda k: misfits[k])

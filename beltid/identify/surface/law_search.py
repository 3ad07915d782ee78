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
from beltid.identify.estimators.nonlinear_fit import NonlinearFit, cofactor_of, fit_nonlinear
from beltid.identify.surface.points import FrictionPoints
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
    f0: float
    scales: tuple[float, float]


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
    scales = (float(low[-1]), float(high[-1]))
    return LawSearch(law, best, J, bool(best.at_bound.any()), f0, scales)


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


def profile(
    search: LawSearch, points: FrictionPoints, rise: float
) -> tuple[Array, tuple[bool, bool]]:
    """Solutions with other speed scales that fit the points nearly as well.

    The errors of a speed scale are seldom symmetric, and several scales may do: the linear errors
    at one of them would not show it. For each of a scan of scales the amplitudes and a (linearised)
    are fitted anew.

    Parameters
    ----------
    search : LawSearch
        A law with a speed scale.
    points : FrictionPoints
        The points.
    rise : float
        Scales are kept whose chi² is above the lowest by less than this.

    Returns
    -------
    solutions : ndarray, shape (k, q)
        Unknowns of the search for the scales kept; infinite where a scale leaves one open.
    open_ended : tuple of bool
        Whether the scales kept reach the lower and the upper bound of the search.
    """
    best = search.fit.parameters
    grid = np.linspace(*search.scales, SCAN)
    limit = _at_scale(search, points, float(best[-1]))[1] + rise
    found = [_at_scale(search, points, float(s)) for s in grid]
    kept = [k for k, (_, misfit, _) in enumerate(found) if misfit < limit]
    solutions = np.empty((len(kept), best.size))
    for row, k in zip(solutions, kept, strict=True):
        unknowns, _, design = found[k]
        _, told = cofactor_of(design)
        row[:-1], row[-1] = np.where(told, unknowns, np.inf), grid[k]
    middle = 0.5 * (grid[0] + grid[-1])
    low = 0 in kept or (search.at_bound and best[-1] < middle)
    high = SCAN - 1 in kept or (search.at_bound and best[-1] > middle)
    return solutions, (bool(low), bool(high))


def _at_scale(search: LawSearch, points: FrictionPoints, s: float) -> tuple[Array, float, Array]:
    """Unknowns but the speed scale for a given one, chi², and the design of this problem."""
    a = float(search.fit.parameters[-2])
    terms = ((points.f / search.f0) ** -a)[:, None] * speed_terms(search.law, points.v, s)[0]
    by_a = -np.log(points.f / search.f0) * points.mu
    design = np.column_stack([terms, by_a]) / points.se[:, None]
    found = np.linalg.lstsq(design, points.mu / points.se, rcond=1e-12)[0]
    misfit = float(np.sum((points.mu / points.se - design @ found) ** 2))
    found[-1] += a
    return np.asarray(found, dtype=float), misfit, design

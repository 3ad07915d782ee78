"""How sure the parameters of a friction law are, and the comparison of laws in plain words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtr, chdtrc

from beltid.identify.estimators.nonlinear_fit import cofactor_of
from beltid.identify.surface.law_search import LawSearch, profile
from beltid.identify.surface.points import FrictionPoints
from beltid.laws.friction_formulas import PARAMETERS, UNITS, FrictionLawName, has_speed_scale

Array = NDArray[np.float64]

LOG_SCALE_DOUBT = 0.5 * math.log(10.0)
"""A speed whose 95 % interval spans more than a factor of ten either way is not determined."""
AMPLITUDE_DOUBT = 0.5
"""Nor is a coefficient whose standard error exceeds this share of the mean mu."""
TWO_ERRORS = 4.0
"""Rise of chi² at two standard errors, in units of the variance."""
ZERO_DOUBT = 2.0
"""A value within so many standard errors of zero is not told from it."""
CHI_SQUARE_BAND = (0.5, 1.5)
"""Chi² per degree of freedom outside, and improbable, is worth a note."""
IMPROBABLE = 0.01
AS_GOOD = 2.0
BELOW = ("v0", "mu0", "b", "v_s", "mu_s")
"""Parameters that are open if the speed scale may lie far below the measured speeds,"""
ABOVE = ("v0", "b", "v_s", "mu_k", "c")
"""and if it may lie far above."""
NOT_DETERMINED = "not determined by the data"
NOT_ZERO = "not different from zero"


@dataclass(frozen=True, slots=True)
class FrictionParameter:
    """A parameter of a friction law.

    Attributes
    ----------
    name, unit : str
        What it is; the unit is empty for a number.
    value, se : float
        Value and standard error; the error is infinite where the data do not tell the value.
    status : str
        Empty, "not different from zero", or "not determined by the data".
    """

    name: str
    unit: str
    value: float
    se: float
    status: str = ""

    @property
    def determined(self) -> bool:
        """Whether the data tell the value."""
        return self.status != NOT_DETERMINED


def covariance_scale(chi_square: float, dof: int, errors_known: bool, tau: float) -> float:
    """Factor from cofactor to covariance.

    Known errors are believed unless the law misses the points by more; unknown ones come from the
    scatter. Residuals with the correlation time tau are worth fewer points.
    """
    if dof <= 0:
        return tau if errors_known else math.inf
    variance = chi_square / dof
    return tau * (max(1.0, variance) if errors_known else variance)


def parameters_of(
    search: LawSearch, scale: tuple[float, float], points: FrictionPoints
) -> tuple[tuple[FrictionParameter, ...], Array]:
    """Parameters of a law with their errors, from the unknowns of the search.

    Parameters
    ----------
    search : LawSearch
        The solution.
    scale : tuple of float
        Factor from cofactor to covariance; relative standard error shared by all points.
    points : FrictionPoints
        The points.

    Returns
    -------
    parameters : tuple of FrictionParameter
    covariance : ndarray, shape (p, p)

    Notes
    -----
    The speed scale counts as free also where the search ended at its bound: so the doubt about it
    is in the errors of the amplitudes that go with it. Errors are linear ones, widened to half
    of what the parameters move over all speed scales that fit within two standard errors.
    """
    law, theta = search.law, search.fit.parameters
    factor, shared = scale
    cofactor, told = cofactor_of(search.jacobian)
    amplitudes = {"power_log": 2, "power_stribeck_1": 3, "power_stribeck_2": 3}.get(law, 1)
    common = np.where(np.arange(theta.size) < amplitudes, shared * theta, 0.0)
    covariance = factor * np.where(np.isfinite(cofactor), cofactor, 0.0)
    values, gradient = _public(law, theta)
    # a parameter that rests on an unknown that is not told is not told itself
    blind = np.any(np.abs(gradient[:, ~told]) > 0.0, axis=1) | (not math.isfinite(factor))
    covariance = gradient @ covariance @ gradient.T
    linear = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    se = np.where(blind, np.inf, np.maximum(linear, _moved(search, points, factor)))
    wider = np.divide(se, linear, out=np.ones_like(se), where=np.isfinite(se) & (linear > 0.0))
    covariance = covariance * np.outer(wider, wider) + gradient @ np.outer(common, common) @ (
        gradient.T
    )
    covariance[~np.isfinite(se), :] = covariance[:, ~np.isfinite(se)] = np.nan
    se = np.where(np.isfinite(se), np.hypot(se, gradient @ common), np.inf)
    parameters = tuple(
        FrictionParameter(n, UNITS.get(n, ""), float(x), float(s), _status(n, x, s, points))
        for n, x, s in zip(PARAMETERS[law], values, se, strict=True)
    )
    return _with_b(parameters), covariance


def _moved(search: LawSearch, points: FrictionPoints, factor: float) -> Array:
    """Half of what the parameters move over the speed scales that fit within two errors."""
    law, theta = search.law, search.fit.parameters
    values, _ = _public(law, theta)
    if not has_speed_scale(law) or not math.isfinite(factor):
        return np.zeros(values.size)
    solutions, (low, high) = profile(search, points, TWO_ERRORS * factor)
    moved = np.zeros(values.size)
    at = PARAMETERS[law].index("v0" if law == "power_log" else "v_s")
    for solution in solutions:
        with np.errstate(invalid="ignore", over="ignore"):
            other = np.abs(_public(law, solution)[0] - values)
        other[at] = values[at] * abs(solution[-1] - theta[-1])
        moved = np.maximum(moved, np.where(np.isnan(other), np.inf, other))
    for name in (*(BELOW if low else ()), *(ABOVE if high else ())):
        if name in PARAMETERS[law]:
            moved[PARAMETERS[law].index(name)] = np.inf
    return 0.5 * moved


def _public(law: FrictionLawName, theta: Array) -> tuple[Array, Array]:
    """Parameters by their names and their derivatives by the unknowns of the search."""
    if law in ("coulomb", "power"):
        return theta.copy(), np.eye(theta.size)
    if law == "power_log":  # mu0, mu0 b, a, ln v0 -> mu0, a, b, v0
        c0, c1, a, s = theta
        gradient = np.zeros((4, 4))
        gradient[0, 0] = gradient[1, 2] = 1.0
        gradient[2, :2] = -c1 / c0**2, 1.0 / c0
        gradient[3, 3] = math.exp(s)
        return np.array([c0, a, c1 / c0, math.exp(s)]), gradient
    mu_s, mu_k, c, a, s = theta  # -> mu_s, mu_k, a, v_s, c
    gradient = np.zeros((5, 5))
    gradient[0, 0] = gradient[1, 1] = gradient[2, 3] = gradient[4, 2] = 1.0
    gradient[3, 4] = math.exp(s)
    return np.array([mu_s, mu_k, a, math.exp(s), c]), gradient


def _status(name: str, value: float, se: float, points: FrictionPoints) -> str:
    """What is to be said about a parameter; empty if its value stands."""
    mean = float(np.mean(points.mu))
    largest = {
        "v0": LOG_SCALE_DOUBT * value,
        "v_s": LOG_SCALE_DOUBT * value,
        "c": AMPLITUDE_DOUBT * mean / float(points.v.max()),
        "b": max(1.0, abs(value)),
        "a": 1.0,
    }.get(name, AMPLITUDE_DOUBT * mean)
    if not se <= largest:
        return NOT_DETERMINED
    zero = name in ("a", "b", "c") and abs(value) <= ZERO_DOUBT * se
    return NOT_ZERO if zero else ""


def _with_b(parameters: tuple[FrictionParameter, ...]) -> tuple[FrictionParameter, ...]:
    """Where the speed has no provable influence, its scale means nothing."""
    if any(p.name == "b" and p.status == NOT_ZERO for p in parameters):
        return tuple(
            FrictionParameter(p.name, p.unit, p.value, p.se, NOT_DETERMINED)
            if p.name == "v0"
            else p
            for p in parameters
        )
    return parameters


def chi_square_note(law: str, chi_square: float, dof: int) -> list[str]:
    """A note where chi² per degree of freedom is far from one."""
    if dof <= 0:
        return [f"{law}: as many parameters as points, the misfit says nothing"]
    ratio = chi_square / dof
    if ratio > CHI_SQUARE_BAND[1] and chdtrc(dof, chi_square) < IMPROBABLE:
        return [
            f"{law}: chi² per degree of freedom {ratio:.3g}: the law misses the points by more "
            f"than their errors; the standard errors are widened {math.sqrt(ratio):.3g} times"
        ]
    if ratio < CHI_SQUARE_BAND[0] and chdtr(dof, chi_square) < IMPROBABLE:
        return [
            f"{law}: chi² per degree of freedom {ratio:.3g}: the points scatter by less than their "
            "errors, which are too large or shared by the points; shared ones do not average out, "
            "so the standard errors of the amplitudes may be too small"
        ]
    return []


def verdict_of(rows: Sequence[tuple[str, float, float, float, bool]], text: str) -> str:
    """Which formula to take, from (law, criterion, RMS and worst misfit, determined) of each."""
    known = [r for r in rows if not math.isnan(r[1])]
    if not known:
        return "Too few independent points to compare friction laws."
    best = min(known, key=lambda r: r[1])
    said = (
        f"Best formula: {best[0]}, {text} (f in N/m, v in m/s), misfit {100 * best[2]:.2g} % RMS, "
        f"{100 * abs(best[3]):.2g} % at worst"
    )
    if not best[4]:
        said += "; not all of its parameters are determined: use it within the measured range only"
    equal = [r[0] for r in known if r is not best and r[1] < AS_GOOD]
    if equal:
        said += f"; {', '.join(equal)} does as well"
    coulomb = next((r for r in rows if r[0] == "coulomb"), None)
    if coulomb is not None and best[0] != "coulomb":
        said += (
            f". A constant coefficient misses by {100 * coulomb[2]:.2g} % RMS, "
            f"{100 * abs(coulomb[3]):.2g} % at worst"
        )
    return said + "."

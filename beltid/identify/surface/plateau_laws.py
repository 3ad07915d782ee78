"""Friction law fitted to the forces of plateaus with a dead weight on one span.

A table of readings gives no scatter of a reading; only the residuals of a law show it. The law is
therefore fitted to the reading itself, the force of the cell, with one scatter for all readings.
The coefficient depends on the local line force f = T/R. With ``mu = mu0 (f/f0)^(-a)``, the
equilibrium of the belt ``dT/dphi = mu(T/R) T`` has the solution

    T_tight^a - T_slack^a = a mu0 (f0 R)^a beta,    a -> 0: ln(T_tight/T_slack) = mu0 beta,

which is Eq. (6) with a coefficient that follows the load along the arc.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import FitError, InputError
from beltid.identify.surface.laws import reference_force
from beltid.laws.capstan import friction_coefficient, mean_normal_force

Array = NDArray[np.float64]

CLEAR: Final = 3.0  # standard errors beyond which a difference is significant
SMALLEST_EXPONENT: Final = 1e-6  # below, the law is constant except for rounding
FEWEST: Final = 5


@dataclass(frozen=True, slots=True)
class PlateauLaw:
    """Power law of the line force, fitted to the plateaus."""

    mu0: float  # coefficient at the reference force [-], and exponent [-]
    a: float
    mu0_se: float  # their standard errors
    a_se: float
    reference_force_N_m: float  # f0 [N/m]
    rms_N: float  # root mean square of calculated less read force [N]
    of_arcs: Mapping[float, tuple[float, float]]
    """Logarithm of the ratio of the coefficient at an arc [deg] to that at all others, and its
    standard error; empty for a single arc."""

    @property
    def verdict(self) -> str:
        """The law in plain words."""
        trend = "no dependence on the load is proven"
        if abs(self.a) > CLEAR * self.a_se:
            trend = f"the coefficient {'falls' if self.a > 0.0 else 'rises'} with the load"
        return (
            f"Through the forces of the plateaus: mu = {self.mu0:.4g} "
            f"(f / {self.reference_force_N_m:g} N/m)^(-{self.a:.2g}), exponent {self.a:.2g} ± "
            f"{self.a_se:.2g}: {trend}. Misfit {self.rms_N:.2g} N RMS."
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """A warning for each arc that disagrees with the others."""
        return tuple(
            f"arc {arc:g}°: its coefficient is {100 * math.expm1(ratio):+.2g} % off what the other "
            f"arcs say, {abs(ratio) / se:.2g} standard errors: turns that touch, a pulley or an "
            "arc that differs, or a zero of the cell"
            for arc, (ratio, se) in self.of_arcs.items()
            if abs(ratio) > CLEAR * se
        )


def fit_plateau_law(
    arc_deg: ArrayLike,
    tight_N: ArrayLike,
    slack_N: ArrayLike,
    R: float,
    *,
    weight_on: Literal["tight", "slack"] = "tight",
    resolution_N: float = 0.0,
) -> PlateauLaw:
    """Fit the power law to the force that the cell measured on each plateau.

    Parameters
    ----------
    arc_deg, tight_N, slack_N : array_like, shape (n,)
        Contact arc [deg] and both forces [N] of each plateau, the tight one larger.
    R : float
        Radius of the belt's centreline on the pulley [m].
    weight_on : {"tight", "slack"}
        The span with the weight, whose force is exact; the cell measured the other span.
    resolution_N : float
        Resolution of a reading [N]; the scatter is at least this over the square root of 12.

    Raises
    ------
    InputError
        If there are fewer than five plateaus.
    FitError
        If the fit does not converge.
    """
    arc, tight, slack = (np.asarray(a, dtype=float).ravel() for a in (arc_deg, tight_N, slack_N))
    if arc.size < FEWEST:
        raise InputError(f"{arc.size} plateaus to fit a law to, must be at least {FEWEST}")
    beta, f0 = np.radians(arc), reference_force(mean_normal_force(tight, slack, R))
    weight, read, sign = (tight, slack, -1.0) if weight_on == "tight" else (slack, tight, 1.0)
    median = float(np.median(friction_coefficient(tight, slack, beta)))

    def calculated(mu0: Array | float, a: float) -> Array:
        if abs(a) < SMALLEST_EXPONENT:
            return np.asarray(weight * np.exp(sign * mu0 * beta))
        power = (weight / (f0 * R)) ** a + sign * a * mu0 * beta
        return np.asarray(f0 * R * np.maximum(power, 1e-300) ** (1.0 / a))

    def fitted(odd: NDArray[np.bool_] | None) -> tuple[Array, Array, float]:
        """Fit mu0, a and the ratio of one arc; return them, their errors and the misfit [N]."""
        from scipy.optimize import least_squares  # slow to import

        def misfit(p: Array) -> Array:
            mu0 = p[0] if odd is None else p[0] * np.where(odd, np.exp(p[-1]), 1.0)
            return calculated(mu0, float(p[1])) - read

        start = [median, 0.05] if odd is None else [median, 0.05, 0.0]
        found = least_squares(misfit, start, jac="3-point", x_scale="jac", xtol=1e-12, ftol=1e-14)
        if not found.success:
            raise FitError("law through the forces of the plateaus: no convergence")
        squares = 2.0 * float(found.cost)
        scatter = math.sqrt(squares / (read.size - len(start)))
        scatter = max(scatter, resolution_N / math.sqrt(12.0))
        errors = scatter * np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))
        return found.x, errors, math.sqrt(squares / read.size)

    p, se, rms = fitted(None)
    arcs = np.unique(arc) if np.ptp(arc) > 0.0 else ()
    of_arcs = {}
    for one in arcs:
        ratio, ratio_se, _ = fitted(arc == one)
        of_arcs[float(one)] = float(ratio[-1]), float(ratio_se[-1])
    return PlateauLaw(float(p[0]), float(p[1]), float(se[0]), float(se[1]), f0, rms, of_arcs)

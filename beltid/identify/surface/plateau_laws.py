"""Friction laws fitted to the forces of plateaus with a dead weight on one span.

A table of readings gives no scatter of a reading; only the residuals of a law show it. The law is
therefore fitted to the reading itself, the force of the cell, with one estimated scatter for all
readings. Readings of a small force then have little weight in the coefficient.

The coefficient depends on the local line force f = T/R. With ``mu = mu0 (f/f0)^(-a)``, the
equilibrium of the belt ``dT/dphi = mu(T/R) T`` has the solution

    T_tight^a - T_slack^a = a mu0 (f0 R)^a beta,    a -> 0: ln(T_tight/T_slack) = mu0 beta,

which is Eq. (6) with a coefficient that follows the load along the arc.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import FitError, InputError
from beltid.identify.surface.laws import round_reference
from beltid.laws.capstan import friction_coefficient, mean_normal_force

Array = NDArray[np.float64]

CLEAR: Final = 3.0  # standard errors beyond which a difference is significant
SMALLEST_EXPONENT: Final = 1e-6  # below, the law is constant except for rounding


@dataclass(frozen=True, slots=True)
class PlateauLaw:
    """A law fitted to the forces of the plateaus."""

    values: dict[str, float]  # parameters mu0 [-], a [-], zero_N [N], log_factor [-]
    errors: dict[str, float]  # their standard errors
    rms_N: float  # root mean square of read minus calculated force
    scatter_N: float  # standard deviation of a reading from the residuals or the resolution

    def clear(self, name: str) -> bool:
        """Return whether a parameter differs from zero by more than three standard errors."""
        return abs(self.values[name]) > CLEAR * self.errors[name]


@dataclass(frozen=True, slots=True)
class PlateauLaws:
    """Friction laws fitted to the plateaus."""

    constant: PlateauLaw
    power: PlateauLaw  # power of the line force
    with_zero: PlateauLaw  # power law with a zero offset of the cell
    by_arc: dict[float, PlateauLaw]
    """Power law for each of several arcs [deg]: ``log_factor`` is the logarithm of the ratio of its
    coefficient to that of the other arcs."""
    reference_force_N_m: float  # f0 of the power laws

    @property
    def verdict(self) -> str:
        """The outcome in plain words."""
        constant, power, f0 = self.constant, self.power, self.reference_force_N_m
        a, a_se = power.values["a"], power.errors["a"]
        if power.clear("a"):
            verb = "falls" if a > 0.0 else "rises"
            trend = f"the coefficient {verb} with the load, by {abs(a) / a_se:.2g} standard errors"
        else:
            trend = "no dependence on the load is proven"
        return (
            f"Through the forces of the plateaus: mu = {power.values['mu0']:.4g} (f / {f0:g} N/m)^"
            f"(-{a:.2g}), exponent {a:.2g} ± {a_se:.2g}: {trend}. Misfit {power.rms_N:.2g} N RMS; "
            f"a constant {constant.values['mu0']:.4g} ± {constant.errors['mu0']:.2g} misses by "
            f"{constant.rms_N:.2g} N."
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of arcs that disagree with the others, the most significant first."""
        values, errors = self.with_zero.values, self.with_zero.errors
        cause = (
            "turns that touch, a pulley or an arc that differs, or a zero of the cell (with a free "
            f"zero it is {values['zero_N']:.2g} ± {errors['zero_N']:.2g} N and the exponent "
            f"{values['a']:.2g} ± {errors['a']:.2g})"
        )
        odd = [
            (abs(law.values["log_factor"]) / law.errors["log_factor"], arc, law)
            for arc, law in self.by_arc.items()
            if law.clear("log_factor")
        ]
        return tuple(
            f"arc {arc:g}°: its coefficient is {100 * math.expm1(law.values['log_factor']):+.2g} % "
            f"off what the other arcs say, {times:.2g} standard errors: {cause}"
            for times, arc, law in sorted(odd, key=lambda entry: -entry[0])
        )


def fit_plateau_laws(
    arc_deg: ArrayLike,
    tight_N: ArrayLike,
    slack_N: ArrayLike,
    R: float,
    *,
    weight_on: Literal["tight", "slack"] = "tight",
    resolution_N: float = 0.0,
) -> PlateauLaws:
    """Fit friction laws to the force that the cell measured on each plateau.

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
        If a plateau violates tight force > slack force > 0, or there are fewer than five plateaus.
    FitError
        If a fit does not converge.
    """
    arc, tight, slack = (np.asarray(a, dtype=float).ravel() for a in (arc_deg, tight_N, slack_N))
    if arc.size < 5:
        raise InputError(f"{arc.size} plateaus to fit friction laws to, must be at least 5")
    invalid = np.flatnonzero(~((tight > slack) & (slack > 0.0) & (arc > 0.0)))
    if invalid.size:
        raise InputError(
            [
                f"plateau {i + 1}: tight force {tight[i]:g} N, must be above the slack force "
                f"{slack[i]:g} N, and that above zero"
                for i in invalid
            ]
        )
    f0 = round_reference(mean_normal_force(tight, slack, R))
    plateaus = _Plateaus(np.radians(arc), tight, slack, f0 * R, weight_on, resolution_N)
    median = float(np.median(friction_coefficient(tight, slack, plateaus.beta)))
    power = {"mu0": median, "a": 0.05}
    arcs = np.unique(arc) if np.ptp(arc) > 0.0 else ()  # a single arc has no others
    with_factor = power | {"log_factor": 0.0}
    return PlateauLaws(
        constant=plateaus.fit({"mu0": median}),
        power=plateaus.fit(power),
        with_zero=plateaus.fit(power | {"zero_N": 0.0}),
        by_arc={float(value): plateaus.fit(with_factor, arc == value) for value in arcs},
        reference_force_N_m=f0,
    )


@dataclass(frozen=True, slots=True)
class _Plateaus:
    """Plateaus: contact arc (n,) [rad], forces (n,) [N], tension at the reference force [N]."""

    beta: Array
    tight: Array
    slack: Array
    T_reference: float
    weight_on: str
    resolution: float

    def fit(
        self, start: dict[str, float], factor_on: NDArray[np.bool_] | bool = False
    ) -> PlateauLaw:
        """Fit the measured force by least squares; a factor applies to some plateaus, (n,)."""
        from scipy.optimize import least_squares  # slow to import

        measured = self.slack if self.weight_on == "tight" else self.tight

        def misfit(p: Array) -> Array:
            values = dict(zip(start, p, strict=True))
            factor = np.where(factor_on, math.exp(values.get("log_factor", 0.0)), 1.0)
            calculated = self.other_force(values["mu0"] * factor, values.get("a", 0.0))
            return np.asarray(calculated + values.get("zero_N", 0.0) - measured)

        x0 = list(start.values())
        solution = least_squares(misfit, x0, jac="3-point", x_scale="jac", xtol=1e-12, ftol=1e-14)
        if not solution.success:
            parameters = ", ".join(start)
            raise FitError(f"law through the forces ({parameters}): no convergence")
        squares = 2.0 * float(solution.cost)
        scatter = math.sqrt(squares / (measured.size - len(start)))
        scatter = max(scatter, self.resolution / math.sqrt(12.0))
        errors = scatter * np.sqrt(np.diag(np.linalg.inv(solution.jac.T @ solution.jac)))
        return PlateauLaw(
            values=dict(zip(start, solution.x.tolist(), strict=True)),
            errors=dict(zip(start, errors.tolist(), strict=True)),
            rms_N=math.sqrt(squares / measured.size),
            scatter_N=scatter,
        )

    def other_force(self, mu0: Array, a: float) -> Array:
        """Calculate the force of the span without the weight (n,) [N] from the law."""
        weight_is_tight = self.weight_on == "tight"
        weight = self.tight if weight_is_tight else self.slack
        sign = -1.0 if weight_is_tight else 1.0
        if abs(a) < SMALLEST_EXPONENT:
            return np.asarray(weight * np.exp(sign * mu0 * self.beta))
        power = (weight / self.T_reference) ** a + sign * a * mu0 * self.beta
        return np.asarray(self.T_reference * np.maximum(power, 1e-300) ** (1.0 / a))

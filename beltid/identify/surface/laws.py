"""Parametric friction laws fitted beside the surface, with parameters, errors and misfit.

Every law is ``mu = (f/f0)^(-a) sum_k c_k phi_k(v; v*)`` (:mod:`beltid.laws.friction_formulas`). For
given a and v* the amplitudes c are a linear problem; a scan over v* with these (variable
projection) gives first values, so that no guess is needed. Then all unknowns are fitted together,
weighted by the standard errors of the points.

Standard errors count the correlation of the residuals along the force, and are widened where the
law misses the points by more than their errors. What the data cannot tell is said to be so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import InputError, NumericsError
from beltid.identify.press.shared_law import correlation_time
from beltid.identify.surface.law_doubt import (
    FrictionParameter,
    chi_square_note,
    covariance_scale,
    parameters_of,
    verdict_of,
)
from beltid.identify.surface.law_search import LawSearch, search_law
from beltid.identify.surface.points import FrictionPoints, friction_points
from beltid.laws.friction_formulas import (
    FRICTION_LAWS,
    FrictionFormula,
    FrictionLawName,
)

Array = NDArray[np.float64]

ROUNDING = 1.0e-10
"""Relative misfits below are rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class FrictionLawFit:
    """One parametric law through the points of a surface.

    Attributes
    ----------
    law : str
        See :data:`beltid.laws.friction_formulas.FRICTION_LAWS`.
    parameters : tuple of FrictionParameter
        Values, standard errors and what is to be said about them.
    covariance : ndarray
        Of the parameters, in their order, shape (p, p); nan where one is not determined.
    reference_force_N_m : float
        f0, chosen in the middle of the points [N/m].
    rms_misfit : float
        Root mean square of the relative misfit, ``law/mu - 1`` [-].
    worst_misfit : float
        The largest relative misfit, with its sign [-].
    worst_at : tuple of float
        Force [N/m] and speed [m/s] where it occurs.
    chi_square : float
        Weighted sum of squares; nan if the errors of the points are not known.
    degrees_of_freedom : int
        Points less parameters.
    criterion : float
        AICc less that of the best law [-].
    notes : tuple of str
        What the user should know.
    """

    law: FrictionLawName
    parameters: tuple[FrictionParameter, ...]
    covariance: Array
    reference_force_N_m: float
    rms_misfit: float
    worst_misfit: float
    worst_at: tuple[float, float]
    chi_square: float
    degrees_of_freedom: int
    criterion: float
    notes: tuple[str, ...] = ()

    @property
    def values(self) -> dict[str, float]:
        """Values of the parameters by name."""
        return {p.name: p.value for p in self.parameters}

    @property
    def formula(self) -> FrictionFormula:
        """The law itself."""
        return FrictionFormula(self.law, self.reference_force_N_m, self.values)

    @property
    def determined(self) -> bool:
        """Whether the data determine all parameters."""
        return all(p.determined for p in self.parameters)


@dataclass(frozen=True, slots=True, eq=False)
class FrictionLaws:
    """Parametric laws beside a friction surface.

    Attributes
    ----------
    fits : tuple of FrictionLawFit
        From the simplest law to the richest.
    refused : tuple of (str, str)
        Laws that were not fitted, with the reason.
    best : str
        Law of the lowest criterion.
    verdict : str
        The outcome in plain words.
    n_points : int
        Points used.
    n_effective : float
        Independent ones among them.
    valid_force_N_m, valid_speed_m_s : tuple of float
        Range of the points: the formulas hold within it.
    notes : tuple of str
        What the user should know.
    """

    fits: tuple[FrictionLawFit, ...]
    refused: tuple[tuple[str, str], ...]
    best: FrictionLawName
    verdict: str
    n_points: int
    n_effective: float
    valid_force_N_m: tuple[float, float]
    valid_speed_m_s: tuple[float, float]
    notes: tuple[str, ...] = field(default=())

    def fit(self, law: FrictionLawName) -> FrictionLawFit:
        """The fit of one law."""
        return next(f for f in self.fits if f.law == law)


def fit_friction_laws(
    normal_force_N_m: ArrayLike,
    slip_speed_m_s: ArrayLike,
    mu: ArrayLike,
    mu_se: ArrayLike | None = None,
    *,
    reference_force_N_m: float | None = None,
    shared_relative_se: float = 0.0,
) -> FrictionLaws:
    """Fit the parametric friction laws to points (f, v, mu).

    Parameters
    ----------
    normal_force_N_m, slip_speed_m_s, mu : array_like
        Points, shape (n,): force per length of belt [N/m] > 0, sliding speed [m/s] > 0 (its sign
        does not matter), friction coefficient [-] > 0; others are left out.
    mu_se : array_like, optional
        Standard errors of mu [-], shape (n,). Without them every point has the same relative
        weight.
    reference_force_N_m : float, optional
        f0 [N/m]; by default the geometric mean of the forces, to two digits, which makes mu0 and a
        nearly uncorrelated.
    shared_relative_se : float
        Relative standard error common to all points, such as that of the arc angle or of a gain
        [-]: it is not averaged away and is added to the amplitudes.

    Raises
    ------
    InputError
        If arrays differ in length or fewer than two points can be used.
    """
    points = friction_points(normal_force_N_m, slip_speed_m_s, mu, mu_se)
    if not (math.isfinite(shared_relative_se) and shared_relative_se >= 0.0):
        raise InputError(f"shared_relative_se = {shared_relative_se!r}, must be >= 0")
    f0 = _reference(points, reference_force_N_m)
    searched, refused = _searched(points, f0)
    least = min(searched, key=lambda s: s.fit.sum_of_squares)
    tau = _correlation(points, least.fit.residuals)
    m = points.f.size / tau
    criteria = [_aicc(s, points, m) for s in searched]
    known = [c for c in criteria if not math.isnan(c)]
    lowest = min(known) if known else math.nan
    fits = tuple(
        _finished(s, points, f0, c - lowest, shared_relative_se)
        for s, c in zip(searched, criteria, strict=True)
    )
    best = min(fits, key=lambda f: math.inf if math.isnan(f.criterion) else f.criterion)
    return FrictionLaws(
        fits=fits,
        refused=tuple(refused),
        best=best.law,
        verdict=verdict_of(
            [(f.law, f.criterion, f.rms_misfit, f.worst_misfit, f.determined) for f in fits],
            best.formula.text,
        ),
        n_points=points.f.size,
        n_effective=m,
        valid_force_N_m=(float(points.f.min()), float(points.f.max())),
        valid_speed_m_s=(float(points.v.min()), float(points.v.max())),
        notes=points.notes,
    )


def _searched(points: FrictionPoints, f0: float) -> tuple[list[LawSearch], list[tuple[str, str]]]:
    """All laws that the points allow, and the others with the reason."""
    searched: list[LawSearch] = []
    refused: list[tuple[str, str]] = []
    for law in FRICTION_LAWS:
        try:
            searched.append(search_law(law, points, f0))
        except NumericsError as error:
            refused.append((law, str(error)))
    return searched, refused


def _reference(points: FrictionPoints, given: float | None) -> float:
    if given is None:
        return float(f"{np.exp(np.mean(np.log(points.f))):.2g}")
    if not (math.isfinite(given) and given > 0.0):
        raise InputError(f"reference_force_N_m = {given!r}, must be > 0 N/m")
    return float(given)


def _correlation(points: FrictionPoints, residuals: Array) -> float:
    """Integrated autocorrelation time of weighted residuals along the force [points]."""
    relative = residuals * points.se / points.mu
    if float(np.max(np.abs(relative))) <= ROUNDING:
        return 1.0
    return correlation_time(points.along_force(residuals))


def _aicc(search: LawSearch, points: FrictionPoints, m: float) -> float:
    """Information criterion for m independent points; nan if they are too few."""
    k = search.fit.parameters.size + 1  # the scale of the noise is one more
    if m <= k + 1:
        return math.nan
    n = points.f.size
    floor = float(np.mean((ROUNDING * points.mu / points.se) ** 2))
    mean_square = max(search.fit.sum_of_squares / n, floor)
    return m * math.log(mean_square) + 2.0 * k * m / (m - k - 1.0)


def _finished(
    search: LawSearch, points: FrictionPoints, f0: float, criterion: float, shared: float
) -> FrictionLawFit:
    """Parameters with their doubt, and the misfit."""
    fit = search.fit
    dof = fit.residuals.size - fit.parameters.size
    scale = covariance_scale(
        fit.sum_of_squares, dof, points.errors_known, _correlation(points, fit.residuals)
    )
    parameters, covariance = parameters_of(search, (scale, shared), points)
    relative = -fit.residuals * points.se / points.mu
    worst = int(np.argmax(np.abs(relative)))
    notes = [f"{search.law}: {p.name} is {p.status}" for p in parameters if p.status]
    negative = [p.name for p in parameters if p.name in ("mu0", "mu_s", "mu_k") and p.value < 0.0]
    notes += [f"{search.law}: {n} is negative, a number without a meaning" for n in negative]
    if search.at_bound:
        notes.append(f"{search.law}: its speed scale ended at the bound of the search")
    if points.errors_known:
        notes += chi_square_note(search.law, fit.sum_of_squares, dof)
    return FrictionLawFit(
        law=search.law,
        parameters=parameters,
        covariance=covariance,
        reference_force_N_m=f0,
        rms_misfit=float(np.sqrt(np.mean(relative**2))),
        worst_misfit=float(relative[worst]),
        worst_at=(float(points.f[worst]), float(points.v[worst])),
        chi_square=fit.sum_of_squares if points.errors_known else math.nan,
        degrees_of_freedom=dof,
        criterion=criterion,
        notes=tuple(notes),
    )

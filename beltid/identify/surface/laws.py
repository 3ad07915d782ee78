"""Parametric friction laws fitted to the surface with its covariance.

Every law is ``mu = (f/f0)^(-a) sum_k c_k phi_k(v; v*)`` (:mod:`beltid.laws.friction_formulas`).
With the relative misfits ``r = 1 - law/mu`` at the nodes and the covariance C of ln mu there, the
parameters minimise

    r' (C + q I)^-1 r,    q such that the minimum equals the degrees of freedom, q >= 0.

q is what the law itself misses the surface by (Paule and Mandel 1982); without known errors C is
zero and q the scatter. For given a and v* the amplitudes c are a linear problem: a scan over v*
gives first values, so that no guess is needed.

Where the law misses the surface (q > 0), standard errors count the correlation that is left in the
whitened misfits along the force. What the data do not determine is said to be so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtr, chdtrc

from beltid.errors import FitError, InputError, NumericsError
from beltid.identify.estimators.least_squares import solve_nonlinear
from beltid.identify.estimators.statistics import integrated_autocorrelation_time, settings_of
from beltid.laws.friction_formulas import FRICTION_LAWS, Coulomb, FrictionFormula

Array = NDArray[np.float64]

ROUNDING = 1.0e-20  # squares of relative misfits below are rounding
SPEED_GAP = 0.03  # speeds closer than this share are one setting
FORCE_SPREAD = 0.05  # forces within this share of each other do not show an exponent
SCAN = 49  # values of the speed scale that are tried
MOST_STARTS = 3  # the search starts from the best local minima of the scan, at most so many
MOST_ROUNDS = 30  # rounds between the parameters and q
SINGULAR = 1.0e-10  # singular values of unit columns below this share of the largest are zero
TWO_ERRORS = 4.0  # rise of chi² at two standard errors
NOT_DETERMINED = "not determined by the data"
NOT_ZERO = "not different from zero"


@dataclass(frozen=True, slots=True)
class FrictionParameter:
    """A parameter of a friction law."""

    name: str
    unit: str  # empty for a number
    value: float
    se: float  # standard error; infinite where the data do not determine the value
    status: str = ""  # empty, "not different from zero", or "not determined by the data"

    @property
    def determined(self) -> bool:
        """Whether the data determine the value."""
        return self.status != NOT_DETERMINED


@dataclass(frozen=True, slots=True, eq=False)
class FrictionLawFit:
    """One parametric law through the points of a surface."""

    law: str  # see :data:`beltid.laws.friction_formulas.FRICTION_LAWS`
    parameters: tuple[FrictionParameter, ...]
    covariance: Array  # of the parameters, (p, p); nan where one is not determined
    reference_force_N_m: float  # f0
    rms_misfit: float  # root mean square of the relative misfits ``law/mu - 1`` [-]
    worst_misfit: float  # the largest of them, with its sign
    worst_at: tuple[float, float]  # force [N/m] and speed [m/s] of it
    chi_square: float  # ``r' C^-1 r``, nan if the errors of the points are not known
    law_error: float  # sqrt(q), what the law misses the points by beyond their errors [-]
    degrees_of_freedom: int  # points less parameters
    criterion: float  # AICc less that of the best law [-]; nan with too few points
    notes: tuple[str, ...] = ()  # what the user should know

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
    """Parametric laws of a friction surface."""

    fits: tuple[FrictionLawFit, ...]  # from the simplest law to the richest
    refused: tuple[tuple[str, str], ...]  # laws that were not fitted, with the reason
    best: str  # law of the lowest criterion
    verdict: str  # the outcome in plain words
    n_points: int
    n_effective: float  # independent points
    valid_force_N_m: tuple[float, float]  # range of the points: the formulas hold within it
    valid_speed_m_s: tuple[float, float]
    notes: tuple[str, ...] = ()  # what the user should know

    def fit(self, law: str) -> FrictionLawFit:
        """The fit of one law."""
        return next(f for f in self.fits if f.law == law)


def fit_friction_laws(
    normal_force_N_m: ArrayLike,
    slip_speed_m_s: ArrayLike,
    mu: ArrayLike,
    mu_se: ArrayLike | None = None,
    *,
    factor: ArrayLike | None = None,
    reference_force_N_m: float | None = None,
) -> FrictionLaws:
    """Fit the parametric friction laws to points (f, v, mu).

    Parameters
    ----------
    normal_force_N_m, slip_speed_m_s, mu : array_like
        Points, shape (n,): force per length of belt [N/m] > 0, sliding speed [m/s] > 0 (its sign
        does not matter), friction coefficient [-] > 0; others are left out.
    mu_se : array_like, optional
        Standard errors of mu [-], shape (n,), of independent points; not used if there is a factor.
    factor : array_like, optional
        Factor S of the covariance ``S S'`` of ln mu, shape (n, r). Without either every point has
        the same relative weight.
    reference_force_N_m : float, optional
        f0 [N/m]; by default the geometric mean of the forces, to two digits, which makes mu0 and a
        nearly uncorrelated.

    Raises
    ------
    InputError
        If arrays differ in length or fewer than two points can be used.
    """
    points = _points(normal_force_N_m, slip_speed_m_s, mu, mu_se, factor)
    f0 = reference_force_N_m
    if f0 is None:
        f0 = float(f"{np.exp(np.mean(np.log(points.f))):.2g}")
    elif not (math.isfinite(f0) and f0 > 0.0):
        raise InputError(f"reference_force_N_m = {f0!r}, must be > 0 N/m")
    found: list[_Solution] = []
    refused: list[tuple[str, str]] = []
    for law in FRICTION_LAWS.values():
        try:
            found.append(_solve(law, points, f0))
        except NumericsError as error:
            refused.append((law.name, str(error)))
    n_effective = points.f.size / min(found, key=lambda s: s.deviance).tau
    # AICc for n_effective independent points; q is one parameter more
    k = np.array([s.p.size + 1.0 for s in found])
    room = n_effective - k - 1.0
    penalty = 2.0 * k * n_effective / np.where(room > 0.0, room, np.nan)
    criteria = n_effective / points.f.size * np.array([s.deviance for s in found]) + penalty
    criteria -= np.nanmin(criteria) if np.isfinite(criteria).any() else 0.0
    fits = tuple(_as_fit(s, points, float(c)) for s, c in zip(found, criteria, strict=True))
    best = min(fits, key=lambda f: math.inf if math.isnan(f.criterion) else f.criterion)
    (f_low, f_high), (v_low, v_high) = (
        (float(x.min()), float(x.max())) for x in (points.f, points.v)
    )
    return FrictionLaws(
        fits, tuple(refused), best.law, verdict_of(fits), points.f.size, n_effective,
        (f_low, f_high), (v_low, v_high), points.notes,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class _Points:
    """Usable points by speed setting and force; C of ln mu as ``U diag(variance) U'``."""

    f: Array
    v: Array
    mu: Array
    setting: NDArray[np.intp]
    U: Array
    variance: Array
    errors_known: bool
    notes: tuple[str, ...]

    def whitening(self, q: float) -> Array:
        """Symmetric root of ``(C + q I)^-1``: whitened misfits keep their places."""
        return (self.U / np.sqrt(np.maximum(self.variance + q, ROUNDING))) @ self.U.T

    def chi_square(self, r: Array, q: float) -> float:
        """``r' (C + q I)^-1 r`` of relative misfits."""
        return float(np.sum((self.U.T @ r) ** 2 / np.maximum(self.variance + q, ROUNDING)))


def _points(
    f: ArrayLike, v: ArrayLike, mu: ArrayLike, mu_se: ArrayLike | None, factor: ArrayLike | None
) -> _Points:
    """Check the points and put them in order."""
    named = {"normal_force_N_m": f, "slip_speed_m_s": v, "mu": mu}
    arrays = {name: np.asarray(value, dtype=float).ravel() for name, value in named.items()}
    n = arrays["mu"].size
    se = np.full(n, np.nan) if mu_se is None else np.asarray(mu_se, dtype=float).ravel()
    S = np.zeros((n, 0)) if factor is None else np.asarray(factor, dtype=float)
    sizes = {**{k: a.size for k, a in arrays.items()}, "mu_se": se.size, "factor": len(S)}
    problems = [
        f"{name}: {k} values, must be {n} as many as mu" for name, k in sizes.items() if k != n
    ]
    if problems:
        raise InputError(problems)
    arrays["slip_speed_m_s"] = np.abs(arrays["slip_speed_m_s"])
    rows = np.flatnonzero(np.all([np.isfinite(a) & (a > 0.0) for a in arrays.values()], axis=0))
    notes = []
    if rows.size < n:
        notes.append(f"{n - rows.size} of {n} points left out: force, speed, mu must be > 0")
    if rows.size < 2:
        raise InputError(f"friction laws: {rows.size} usable points of {n}, must be at least 2")
    setting = settings_of(arrays["slip_speed_m_s"][rows], SPEED_GAP)
    order = np.lexsort((arrays["normal_force_N_m"][rows], setting))
    rows = rows[order]
    force, speed, coefficient = (a[rows] for a in arrays.values())
    S, relative = S.reshape(n, -1)[rows], se[rows] / coefficient
    known = np.isfinite(relative) & (relative > 0.0)
    U, variance, errors_known = np.eye(rows.size), np.zeros(rows.size), True
    if np.any(S):
        U, singular, _ = np.linalg.svd(S, full_matrices=True)
        variance[: singular.size] = np.square(singular)
    elif known.any():
        typical = float(np.median(relative[known]))
        variance = np.square(np.where(known, relative, typical))
        if not known.all():
            count = int((~known).sum())
            notes.append(f"{count} points without a standard error: {100 * typical:.2g} % taken")
    else:
        errors_known = False
        notes.append("no standard errors of mu: points have equal relative weight")
    return _Points(
        force, speed, coefficient, setting[order], U, variance, errors_known, tuple(notes)
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Solution:
    """A law at its minimum."""

    law: Coulomb
    f0: float
    p: Array  # parameters
    q: float
    r: Array  # relative misfits 1 - law/mu
    J: Array  # whitened derivatives of law/mu
    tau: float  # correlation time of the whitened misfits
    deviance: float
    scales: tuple[float, float]
    at_bound: int  # -1 or 1 where the speed scale ended at the lower or upper bound


def _solve(law: Coulomb, points: _Points, f0: float) -> _Solution:
    """Parameters and q of one law; FitError if the points are too few or too much alike for it."""
    n_speeds = int(points.setting.max()) + 1
    if points.f.size < len(law.parameters):
        raise FitError(f"{points.f.size} points for {len(law.parameters)} parameters")
    if "a" in law.parameters and not points.f.max() > (1.0 + FORCE_SPREAD) * points.f.min():
        raise FitError("all points at one force: the exponent a is not determined")
    if n_speeds < law.speeds_needed:
        raise FitError(
            f"{n_speeds} sliding speeds, {law.speeds_needed} are needed for its speed dependence"
        )
    f, dof = points.f / f0, points.f.size - len(law.parameters)
    scales = (points.v.min() / law.reach, points.v.max() * law.reach)
    W = points.whitening(max(float(np.mean(points.variance)), ROUNDING))
    starts = _scan(law, points, f0, W, scales)
    solved = [_minimum(law, points, f, W, start, scales) for start in starts]
    p = min(solved, key=lambda p: float(np.sum((W @ _misfit(law, points, f, p)) ** 2)))
    q = -1.0
    for _ in range(MOST_ROUNDS):
        before, r = q, _misfit(law, points, f, p)
        q = law_variance(points.U.T @ r, points.variance, dof)
        W = points.whitening(q)
        if np.ptp(points.variance) == 0.0:
            break  # q changes no weight
        p = _minimum(law, points, f, W, p, scales)
        if abs(q - before) <= 1e-9 * q + ROUNDING:
            break
    r = _misfit(law, points, f, p)
    z = W @ r
    J = W @ (law.gradient(p, f, points.v) / points.mu[:, None])
    size = float(np.max(np.abs(r)))
    # what known errors explain is no correlation of the law's misfits
    explained = size * size <= ROUNDING or (points.errors_known and q == 0.0)
    parts = [z[points.setting == k] for k in range(n_speeds)]  # along the force
    times = [1.0 if explained else integrated_autocorrelation_time(part) for part in parts]
    tau = float(np.average(times, weights=[part.size for part in parts]))
    scale = p[law.parameters.index(law.scale)] if law.scale else math.nan
    bound = int(scale >= scales[1] * 0.999) - int(scale <= scales[0] * 1.001)
    deviance = float(np.sum(np.log(np.maximum(points.variance + q, ROUNDING))) + z @ z)
    return _Solution(law, f0, p, q, r, J, tau, deviance, scales, bound)


def _misfit(law: Coulomb, points: _Points, f: Array, p: Array) -> Array:
    return 1.0 - law.mu(p, f, points.v) / points.mu


def law_variance(rotated: Array, variance: Array, dof: int) -> float:
    """The q >= 0 at which ``sum r² / (variance + q)`` equals the degrees of freedom, 0 without any.

    Misfits `rotated` in the axes of the covariance and its eigenvalues `variance`, each (n,).
    """
    from scipy.optimize import brentq  # slow to import

    def excess(log_q: float) -> float:
        return float(np.sum(rotated**2 / (variance + math.exp(log_q)))) - dof

    low = math.log(ROUNDING)
    if dof <= 0 or excess(low) <= 0.0:
        return 0.0 if np.any(variance > 0.0) else ROUNDING
    high = math.log(float(rotated @ rotated) / dof) + 1e-6
    return math.exp(brentq(excess, low, high, xtol=1e-12, rtol=1e-14))


def _scan(
    law: Coulomb, points: _Points, f0: float, W: Array, scales: tuple[float, float]
) -> list[Array]:
    """First values: the exponent by regression within the speeds, the best scales of a scan."""
    a = 0.0
    if "a" in law.parameters:
        x, y = np.log(points.f), -np.log(points.mu)
        for k in range(int(points.setting.max()) + 1):
            mine = points.setting == k
            x[mine], y[mine] = x[mine] - x[mine].mean(), y[mine] - y[mine].mean()
        a = float(x @ y) / float(x @ x) if x @ x > 0.0 else 0.0
    grid = np.geomspace(*scales, SCAN)[1:-1] if law.scale else np.ones(1)
    found = [_at_scale(law, points, f0, W, a, float(s), free_a=False) for s in grid]
    padded = [math.inf, *(misfit for _, misfit, _ in found), math.inf]
    lowest = [k for k in range(len(found)) if padded[k + 1] <= min(padded[k], padded[k + 2])]
    lowest = sorted(lowest, key=lambda k: padded[k + 1])[:MOST_STARTS]
    return [found[k][0] for k in lowest]


def _at_scale(
    law: Coulomb, points: _Points, f0: float, W: Array, a: float, scale: float, *, free_a: bool
) -> tuple[Array, float, bool]:
    """Linear least squares for given speed scale; a free exponent is linearised at `a`.

    Parameters, chi², and whether all with a free exponent are determined.
    """
    falling = (points.f / f0) ** -a / points.mu
    columns = falling[:, None] * law.terms(points.v, scale)
    if free_a:
        columns = np.column_stack([columns, -np.log(points.f / f0)])
    design, y = W @ columns, W @ np.ones(points.f.size)
    c: Array = np.asarray(np.linalg.lstsq(design, y, rcond=1e-12)[0], dtype=np.float64)
    misfit = float(np.sum((y - design @ c) ** 2))
    if free_a:
        a, c = a + float(c[-1]), c[:-1]
    with np.errstate(all="ignore"):
        p = law.from_amplitudes(c, a, scale)
    return p, misfit, free_a and bool(_inverse(design)[1].all())


def _minimum(
    law: Coulomb, points: _Points, f: Array, W: Array, start: Array, scales: tuple[float, float]
) -> Array:
    """Parameters of the least ``|W r|²``, searched from a start; a speed scale by its logarithm."""
    at = [law.parameters.index(law.scale)] if law.scale else []
    low, high = np.full(start.size, -np.inf), np.full(start.size, np.inf)
    low[at], high[at] = np.log(scales[0]), np.log(scales[1])

    def public(theta: Array) -> Array:
        p = theta.copy()
        p[at] = np.exp(p[at])
        return p

    def derivatives(theta: Array) -> Array:
        p = public(theta)
        J = law.gradient(p, f, points.v)
        J[:, at] *= p[at]
        return -W @ (J / points.mu[:, None])

    theta = start.copy()
    theta[at] = np.clip(np.log(start[at]), low[at] + 1e-9, high[at] - 1e-9)
    found = solve_nonlinear(
        lambda t: W @ _misfit(law, points, f, public(t)), derivatives, theta, (low, high)
    )
    return public(found.parameters)


def _inverse(J: Array) -> tuple[Array, NDArray[np.bool_]]:
    """``(J'J)^-1``, and which parameters are determined; directions without influence left out."""
    length = np.linalg.norm(J, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    _, sizes, V = np.linalg.svd(J / length, full_matrices=False)
    seen = sizes > SINGULAR * max(float(sizes[0]), 1e-300)
    determined = np.sqrt(np.sum(V[~seen] ** 2, axis=0)) <= 1e-3
    inverse = (V[seen].T / sizes[seen] ** 2) @ V[seen] / np.outer(length, length)
    return inverse, determined


def _as_fit(solution: _Solution, points: _Points, criterion: float) -> FrictionLawFit:
    """Parameters with their uncertainty, and the misfit."""
    law, r = solution.law, -solution.r
    dof = r.size - solution.p.size
    covariance, se = _uncertainty(solution, points, dof)
    said = {
        name: status(name, x, s, points.mu, points.v)
        for name, x, s in zip(law.units, solution.p, se, strict=True)
    }
    if said.get("b") == NOT_ZERO:  # without provable influence of the speed its scale means nothing
        said["v0"] = NOT_DETERMINED
    parameters = tuple(
        FrictionParameter(name, unit, float(x), float(s), said[name])
        for (name, unit), x, s in zip(law.units.items(), solution.p, se, strict=True)
    )
    notes = [f"{law.name}: {p.name} is {p.status}" for p in parameters if p.status]
    notes += [
        f"{law.name}: {p.name} is negative, a number without a meaning"
        for p in parameters
        if p.name.startswith("mu") and p.value < 0.0
    ]
    if solution.at_bound:
        notes.append(f"{law.name}: its speed scale ended at the bound of the search")
    chi_square = points.chi_square(r, 0.0) if points.errors_known else math.nan
    if points.errors_known:
        notes += chi_square_note(law.name, chi_square, dof, math.sqrt(solution.q))
    worst = int(np.argmax(np.abs(r)))
    return FrictionLawFit(
        law=law.name,
        parameters=parameters,
        covariance=covariance,
        reference_force_N_m=solution.f0,
        rms_misfit=float(np.sqrt(np.mean(r**2))),
        worst_misfit=float(r[worst]),
        worst_at=(float(points.f[worst]), float(points.v[worst])),
        chi_square=chi_square,
        law_error=math.sqrt(solution.q),
        degrees_of_freedom=dof,
        criterion=criterion,
        notes=tuple(notes),
    )


def _uncertainty(solution: _Solution, points: _Points, dof: int) -> tuple[Array, Array]:
    """Covariance and standard errors of the parameters.

    The part of the speed scale in the linear errors is widened to half of what the parameters move
    over all scales that fit within two standard errors: its errors are seldom symmetric.
    """
    law, p = solution.law, solution.p
    inverse, determined = _inverse(solution.J)
    if dof <= 0 and not points.errors_known:
        determined = np.zeros(p.size, dtype=bool)
    covariance = solution.tau * inverse
    linear = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    se = np.where(determined, linear, np.inf)
    if law.scale and determined.any():
        at = law.parameters.index(law.scale)
        known = determined[at] and linear[at] > 0.0
        by_scale = covariance[at] / linear[at] if known else 0.0 * linear
        excess = (0.5 * _moved_by_scale(solution, points)) ** 2 - by_scale**2
        se = np.hypot(se, np.sqrt(np.maximum(excess, 0.0)))
    wider = np.divide(se, linear, out=np.ones_like(se), where=np.isfinite(se) & (linear > 0.0))
    covariance = covariance * np.outer(wider, wider)
    covariance[~np.isfinite(se), :] = covariance[:, ~np.isfinite(se)] = np.nan
    return covariance, se


def _moved_by_scale(solution: _Solution, points: _Points) -> Array:
    """What the parameters move over the speed scales that fit within two standard errors."""
    law, p = solution.law, solution.p
    at = law.parameters.index(law.scale)
    a = float(p[law.parameters.index("a")])
    W = points.whitening(solution.q)
    args = (law, points, solution.f0, W, a)
    grid = np.geomspace(*solution.scales, SCAN)
    limit = _at_scale(*args, float(p[at]), free_a=True)[1] + TWO_ERRORS * solution.tau
    others = [_at_scale(*args, float(s), free_a=True) for s in grid]
    kept = [k for k, (_, misfit, _) in enumerate(others) if misfit < limit]
    moved = np.zeros(p.size)
    for k in kept:
        other, _, determined = others[k]
        with np.errstate(invalid="ignore"):
            change = np.abs(other - p)
        change[at] = p[at] * abs(math.log(grid[k] / p[at]))
        if not determined:
            change[np.arange(p.size) != at] = np.inf
        moved = np.maximum(moved, np.where(np.isnan(change), np.inf, change))
    for open_ended, names in (
        (0 in kept or solution.at_bound < 0, law.open_below),
        (SCAN - 1 in kept or solution.at_bound > 0, law.open_above),
    ):
        if open_ended:
            moved[[law.parameters.index(name) for name in names]] = np.inf
    return moved


def status(name: str, value: float, se: float, mu: Array, v: Array) -> str:
    """What is to be said about a parameter at coefficients mu and speeds v; empty if it stands.

    A speed scale is not determined if its 95 % interval spans more than a factor of ten either way,
    a coefficient if its standard error exceeds half the mean mu, an exponent beyond 1.
    """
    half_mean = 0.5 * float(np.mean(mu))
    largest = {
        "v0": 0.5 * math.log(10.0) * value,
        "v_s": 0.5 * math.log(10.0) * value,
        "c": half_mean / float(np.max(v)),
        "b": max(1.0, abs(value)),
        "a": 1.0,
    }.get(name, half_mean)
    if not se <= largest:
        return NOT_DETERMINED
    return NOT_ZERO if name in ("a", "b", "c") and abs(value) <= 2.0 * se else ""


def chi_square_note(law: str, chi_square: float, dof: int, law_error: float) -> list[str]:
    """A note where chi² per degree of freedom is far from one, and not by chance."""
    if dof <= 0:
        return [f"{law}: as many parameters as points, the misfit says nothing"]
    ratio = chi_square / dof
    if ratio > 1.5 and chdtrc(dof, chi_square) < 0.01:
        return [
            f"{law}: chi² per degree of freedom {ratio:.3g}: the law misses the points by more "
            f"than their errors, by {100 * law_error:.2g} %, which is in the standard errors"
        ]
    if ratio < 0.5 and chdtr(dof, chi_square) < 0.01:
        return [
            f"{law}: chi² per degree of freedom {ratio:.3g}: the points scatter by less than their "
            "errors, which are too large or shared by the points; shared ones do not average out, "
            "so the standard errors of the amplitudes may be too small"
        ]
    return []


def verdict_of(fits: Sequence[FrictionLawFit]) -> str:
    """Which formula to take, in plain words."""
    known = [f for f in fits if not math.isnan(f.criterion)]
    if not known:
        return "Too few independent points to compare friction laws."
    best = min(known, key=lambda f: f.criterion)
    said = (
        f"Best formula: {best.law}, {best.formula.text} (f in N/m, v in m/s), misfit "
        f"{100 * best.rms_misfit:.2g} % RMS, {100 * abs(best.worst_misfit):.2g} % at worst"
    )
    if not best.determined:
        said += "; not all of its parameters are determined: use it within the measured range only"
    equal = [f.law for f in known if f is not best and f.criterion < 2.0]
    if equal:
        said += f"; {', '.join(equal)} does as well"
    coulomb = next((f for f in fits if f.law == "coulomb"), None)
    if coulomb is not None and best.law != "coulomb":
        said += (
            f". A constant coefficient misses by {100 * coulomb.rms_misfit:.2g} % RMS, "
            f"{100 * abs(coulomb.worst_misfit):.2g} % at worst"
        )
    return said + "."

"""Parametric friction laws fitted to the surface with its covariance.

Every law is ``mu = (f/f0)^(-a) sum_k c_k phi_k(v; v*)`` (:mod:`beltid.laws.friction_formulas`).
With the relative misfits ``r = 1 - law/mu`` at the nodes and the covariance C of ln mu there, the
parameters minimise

    r' (C + q I)^-1 r,    q such that the minimum equals the degrees of freedom, q >= 0.

q is the variance of the error of the law itself (Paule and Mandel 1982); without known errors, C is
zero and q is the scatter. For given a and v*, the amplitudes c are a linear problem. A scan over v*
provides start values, so the user need not guess any.

If the law deviates from the surface (q > 0), the standard errors include the correlation along the
force that remains in the whitened misfits. Parameters that the data do not determine are reported
as such.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import ConvergenceError, InputError, NumericsError
from beltid.identify.estimators.statistics import integrated_autocorrelation_time, settings_of
from beltid.identify.surface.curves import SPEED_GAP
from beltid.laws.friction_formulas import FRICTION_LAWS, FrictionFormula, FrictionLaw

Array = NDArray[np.float64]

ROUNDING = 1.0e-20  # smaller squares of relative misfits are rounding
FORCE_SPREAD = 0.05  # relative; forces in a narrower range do not determine an exponent
SCAN = 49  # number of speed scales in the scan
MOST_STARTS = 3  # largest number of local minima of the scan from which the search starts
TOLERANCE, MOST_EVALUATIONS = 1e-15, 2000  # of the search
MOST_ROUNDS = 30  # iterations between the parameters and q
SINGULAR = 1.0e-10  # singular values of unit columns below this share of the largest are zero
TWO_ERRORS = 4.0  # rise of chi² at two standard errors
NO_LAW = 0.1  # misfit beyond the points' errors above which no law is recommended
NOT_DETERMINED = "not determined by the data"
NOT_ZERO = "not different from zero"


@dataclass(frozen=True, slots=True)
class FrictionParameter:
    """A parameter of a friction law."""

    name: str
    unit: str  # empty if dimensionless
    value: float
    se: float  # standard error; infinite where the data do not determine the value
    status: str = ""  # empty, "not different from zero", or "not determined by the data"

    @property
    def determined(self) -> bool:
        """Whether the data determine the value."""
        return self.status != NOT_DETERMINED


@dataclass(frozen=True, slots=True, eq=False)
class FrictionLawFit:
    """Fit of one parametric law to the points of a surface."""

    law: str  # see :data:`beltid.laws.friction_formulas.FRICTION_LAWS`
    parameters: tuple[FrictionParameter, ...]
    reference_force_N_m: float  # f0
    rms_misfit: float  # root mean square of the relative misfits ``law/mu - 1`` [-]
    worst_misfit: float  # the largest misfit, with sign
    worst_force_N_m: float  # force of the largest misfit
    law_error: float  # sqrt(q), the error of the law beyond the errors of the points [-]
    correlation_time: float  # of the whitened misfits along the force [points]
    deviance: float  # -2 ln likelihood, but for a constant
    criterion: float = math.nan  # AICc minus that of the best law [-]; nan with too few points
    notes: tuple[str, ...] = ()  # what the user should know

    @property
    def formula(self) -> FrictionFormula:
        """The law with the fitted parameters."""
        return FrictionFormula(self.law, self.reference_force_N_m, self.values)

    @property
    def values(self) -> dict[str, float]:
        """Values of the parameters by name."""
        return {p.name: p.value for p in self.parameters}

    @property
    def determined(self) -> bool:
        """Whether the data determine all parameters."""
        return all(p.determined for p in self.parameters)


@dataclass(frozen=True, slots=True, eq=False)
class FrictionLaws:
    """Parametric laws of a friction surface."""

    fits: tuple[FrictionLawFit, ...]
    """Fits of the laws that the points can determine, in order of increasing complexity."""
    notes: tuple[str, ...] = ()  # what the user should know

    @property
    def best(self) -> str:
        """Law with the lowest criterion."""
        return min(self.fits, key=lambda f: (math.isnan(f.criterion), f.criterion)).law

    @property
    def verdict(self) -> str:
        """The outcome in plain words."""
        return verdict_of(self.fits)

    def fit(self, law: str) -> FrictionLawFit:
        """Return the fit of one law."""
        return next(f for f in self.fits if f.law == law)


def fit_friction_laws(
    normal_force_N_m: ArrayLike,
    slip_speed_m_s: ArrayLike,
    mu: ArrayLike,
    factor: ArrayLike | None = None,
) -> FrictionLaws:
    """Fit the parametric friction laws to points (f, v, mu).

    The reference force f0 is the geometric mean of the forces, rounded to two digits, so that mu0
    and a are nearly uncorrelated.

    Parameters
    ----------
    normal_force_N_m, slip_speed_m_s, mu : array_like
        Points, shape (n,): force per length of belt [N/m], sliding speed [m/s], friction
        coefficient [-], all > 0.
    factor : array_like, optional
        Factor S of the covariance ``S S'`` of ln mu, shape (n, r). Without it, or if it is zero,
        all points have the same relative weight.

    Raises
    ------
    InputError
        If arrays differ in length, a value is not > 0, or there are fewer than two points.
    """
    points = _points(normal_force_N_m, slip_speed_m_s, mu, factor)
    fits: list[FrictionLawFit] = []
    notes = [] if points.errors_known else ["no standard errors of mu: points have equal weight"]
    for law in FRICTION_LAWS.values():
        if points.determine(law):
            try:
                fits.append(_Fit(law, points).solve())
            except NumericsError as error:
                notes.append(f"{law.name}: {error}")
    n_effective = points.f.size / min(fits, key=lambda fit: fit.deviance).correlation_time
    # AICc for n_effective independent points; q counts as a parameter
    k = np.array([len(fit.parameters) + 1.0 for fit in fits])
    room = n_effective - k - 1.0
    penalty = 2.0 * k * n_effective / np.where(room > 0.0, room, np.nan)
    criteria = n_effective / points.f.size * np.array([fit.deviance for fit in fits]) + penalty
    criteria -= np.nanmin(criteria) if np.isfinite(criteria).any() else 0.0
    judged = (replace(fit, criterion=float(c)) for fit, c in zip(fits, criteria, strict=True))
    return FrictionLaws(tuple(judged), tuple(notes))


@dataclass(frozen=True, slots=True, eq=False)
class _Points:
    """Usable points by speed setting and force; C of ln mu as ``U diag(variance) U'``."""

    f0: float
    f: Array  # forces in units of f0
    v: Array
    mu: Array
    setting: NDArray[np.intp]
    U: Array
    variance: Array
    errors_known: bool

    def determine(self, law: FrictionLaw) -> bool:
        """Return whether the points are numerous and varied enough for the parameters of a law."""
        one_force = self.f.max() <= (1.0 + FORCE_SPREAD) * self.f.min()
        return (
            self.f.size >= len(law.parameters)
            and self.setting.max() + 1 >= law.speeds_needed
            and not ("a" in law.parameters and one_force)
        )

    def whitening(self, q: float) -> Array:
        """Compute the symmetric root of ``(C + q I)^-1``; whitened misfits keep their order."""
        return (self.U / np.sqrt(np.maximum(self.variance + q, ROUNDING))) @ self.U.T


def round_reference(force: Array) -> float:
    """Compute the reference force of a law: the geometric mean of forces, to two digits."""
    return float(f"{np.exp(np.mean(np.log(force))):.2g}")


def _points(f: ArrayLike, v: ArrayLike, mu: ArrayLike, factor: ArrayLike | None) -> _Points:
    """Check the points and sort them."""
    force, speed, coefficient = (np.asarray(x, dtype=float).ravel() for x in (f, v, mu))
    n = coefficient.size
    S = np.zeros((n, 0)) if factor is None else np.asarray(factor, dtype=float)
    if n < 2 or not force.size == speed.size == len(S) == n:
        raise InputError(
            f"friction laws: {force.size} forces, {speed.size} speeds, {n} coefficients and "
            f"{len(S)} rows of their covariance, must be equally many and at least 2"
        )
    values = np.array([force, speed, coefficient])
    if not np.all(np.isfinite(values) & (values > 0.0)):
        raise InputError("friction laws: a force, speed or coefficient is not a number > 0")
    setting = settings_of(speed, SPEED_GAP)
    order = np.lexsort((force, setting))
    force, speed, coefficient = (x[order] for x in (force, speed, coefficient))
    setting, S = setting[order], S[order]
    U, variance = np.eye(n), np.zeros(n)
    errors_known = bool(np.any(S))
    if errors_known:
        U, singular, _ = np.linalg.svd(S, full_matrices=True)
        variance[: singular.size] = np.square(singular)
    f0 = round_reference(force)
    return _Points(f0, force / f0, speed, coefficient, setting, U, variance, errors_known)


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """The least-squares problem of one law; W whitens the misfits."""

    law: FrictionLaw
    points: _Points

    def misfit(self, p: Array) -> Array:
        """Compute the relative misfits ``1 - law/mu``."""
        return 1.0 - self.law.mu(p, self.points.f, self.points.v) / self.points.mu

    def gradient(self, p: Array) -> Array:
        """Differentiate ``law/mu`` with respect to the parameters."""
        return self.law.gradient(p, self.points.f, self.points.v) / self.points.mu[:, None]

    @property
    def scale_at(self) -> list[int]:
        """Index of the speed scale among the parameters; empty if the law has none."""
        return [self.law.parameters.index(self.law.scale)] if self.law.scale else []

    @property
    def scales(self) -> Array:
        """Speed scales of the scan; the outer ones are the bounds of the search."""
        v, reach = self.points.v, self.law.reach
        return np.geomspace(v.min() / reach, v.max() * reach, SCAN)

    def solve(self) -> FrictionLawFit:
        """Find the parameters and q."""
        points = self.points
        dof = points.f.size - len(self.law.parameters)
        W = points.whitening(max(float(np.mean(points.variance)), ROUNDING))
        minima = [self.minimum(W, start) for start in self.starts(W)]
        p = min(minima, key=lambda p: float(np.sum((W @ self.misfit(p)) ** 2)))
        q = -1.0
        for _ in range(MOST_ROUNDS):
            previous = q
            q = law_variance(points.U.T @ self.misfit(p), points.variance, dof)
            W = points.whitening(q)
            if np.ptp(points.variance) == 0.0:
                break  # q does not change the weights
            p = self.minimum(W, p)
            if abs(q - previous) <= 1e-9 * q + ROUNDING:
                break
        r = self.misfit(p)
        z = W @ r
        tau = 1.0
        # misfits that known errors explain do not count as correlated errors of the law
        if np.max(np.abs(r)) ** 2 > ROUNDING and not (points.errors_known and q == 0.0):
            ends = np.flatnonzero(np.diff(points.setting)) + 1
            tau = integrated_autocorrelation_time(*np.split(z, ends))  # along the force
        variance = np.maximum(points.variance + q, ROUNDING)
        parameters, notes = self.judged(p, *self.standard_errors(p, W, tau, dof))
        worst = int(np.argmax(np.abs(r)))
        return FrictionLawFit(
            law=self.law.name,
            parameters=parameters,
            reference_force_N_m=points.f0,
            rms_misfit=float(np.sqrt(np.mean(r**2))),
            worst_misfit=-float(r[worst]),
            worst_force_N_m=float(points.f[worst] * points.f0),
            law_error=math.sqrt(q),
            correlation_time=tau,
            deviance=float(np.sum(np.log(variance)) + z @ z),
            notes=notes,
        )

    def starts(self, W: Array) -> list[Array]:
        """Find start values: best scales of a scan, with the exponent linearised about zero."""
        grid = self.scales[1:-1] if self.law.scale else np.ones(1)
        solutions = [self.at_scale(W, 0.0, float(scale)) for scale in grid]
        padded = [math.inf, *(misfit for _, misfit, _ in solutions), math.inf]
        lowest = [k for k in range(grid.size) if padded[k + 1] <= min(padded[k], padded[k + 2])]
        lowest = sorted(lowest, key=lambda k: padded[k + 1])[:MOST_STARTS]
        return [solutions[k][0] for k in lowest]

    def at_scale(self, W: Array, a: float, scale: float) -> tuple[Array, float, bool]:
        """Solve the linear least squares for a given speed scale, with the exponent linearised.

        Returns the parameters, chi², and whether all parameters are determined.
        """
        law, points = self.law, self.points
        columns = (points.f**-a / points.mu)[:, None] * law.terms(points.v, scale)
        amplitudes = columns.shape[1]
        if "a" in law.parameters:
            columns = np.column_stack([columns, -np.log(points.f)])
        design, y = W @ columns, W @ np.ones(points.f.size)
        c: Array = np.asarray(np.linalg.lstsq(design, y, rcond=1e-12)[0], dtype=np.float64)
        misfit = float(np.sum((y - design @ c) ** 2))
        with np.errstate(all="ignore"):
            p = law.from_amplitudes(c[:amplitudes], a + float(c[amplitudes:].sum()), scale)
        return p, misfit, bool(_inverse(design)[1].all())

    def minimum(self, W: Array, start: Array) -> Array:
        """Minimise ``|W r|²`` from a start; a speed scale is searched in its logarithm."""
        from scipy.optimize import least_squares  # slow to import

        at = self.scale_at
        low, high = np.full(start.size, -np.inf), np.full(start.size, np.inf)
        low[at], high[at] = np.log(self.scales[[0, -1]])

        def to_parameters(theta: Array) -> Array:
            p = theta.copy()
            p[at] = np.exp(p[at])
            return p

        def derivatives(theta: Array) -> Array:
            p = to_parameters(theta)
            J = self.gradient(p)
            J[:, at] *= p[at]
            return -W @ J

        theta = start.copy()
        theta[at] = np.clip(np.log(start[at]), low[at] + 1e-9, high[at] - 1e-9)
        try:
            solution = least_squares(
                lambda t: W @ self.misfit(to_parameters(t)),
                theta,
                derivatives,
                bounds=(low, high),
                x_scale="jac",
                ftol=TOLERANCE,
                xtol=TOLERANCE,
                gtol=TOLERANCE,
                max_nfev=MOST_EVALUATIONS,
            )
        except (ValueError, np.linalg.LinAlgError) as error:
            raise ConvergenceError(f"the search broke down ({error})") from None
        if solution.status <= 0:
            raise ConvergenceError(f"no minimum after {solution.nfev} evaluations")
        return to_parameters(solution.x)

    def standard_errors(self, p: Array, W: Array, tau: float, dof: int) -> tuple[Array, bool]:
        """Compute the standard errors, and whether a speed scale ended at its bound.

        The errors of a speed scale are seldom symmetric. Its part in the linear errors is therefore
        widened to half of the change of the parameters over all scales that fit within two standard
        errors.
        """
        inverse, determined = _inverse(W @ self.gradient(p))
        if dof <= 0 and not self.points.errors_known:
            determined = np.zeros(p.size, dtype=bool)
        covariance = tau * inverse
        linear = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        se = np.where(determined, linear, np.inf)
        at_bound = False
        for at in self.scale_at:
            moved, at_bound = self.moved_by_scale(p, W, tau, at)
            if determined.any():
                has_error = determined[at] and linear[at] > 0.0
                by_scale = covariance[at] / linear[at] if has_error else 0.0 * linear
                se = np.hypot(se, np.sqrt(np.maximum((0.5 * moved) ** 2 - by_scale**2, 0.0)))
        return se, at_bound

    def moved_by_scale(self, p: Array, W: Array, tau: float, at: int) -> tuple[Array, bool]:
        """Compute the change of the parameters over the scales that fit within two standard errors.

        It is infinite for undetermined parameters. Also returns whether the scale ended at a bound.
        """
        law, grid = self.law, self.scales
        a = float(p[law.parameters.index("a")])
        limit = self.at_scale(W, a, float(p[at]))[1] + TWO_ERRORS * tau
        moved, kept = np.zeros(p.size), []
        for scale in grid:
            other, misfit, determined = self.at_scale(W, a, float(scale))
            kept.append(misfit < limit)
            if not kept[-1]:
                continue
            with np.errstate(invalid="ignore"):
                change = np.abs(other - p)
            change[at] = p[at] * abs(math.log(scale / p[at]))
            if not determined:
                change[np.arange(p.size) != at] = np.inf
            moved = np.maximum(moved, np.where(np.isnan(change), np.inf, change))
        below, above = p[at] <= 1.001 * grid[0], p[at] >= 0.999 * grid[-1]
        open_ones = law.open_below * bool(kept[0] or below)
        open_ones += law.open_above * bool(kept[-1] or above)
        moved[[law.parameters.index(name) for name in open_ones]] = np.inf
        return moved, bool(below or above)

    def judged(
        self, p: Array, se: Array, at_bound: bool
    ) -> tuple[tuple[FrictionParameter, ...], tuple[str, ...]]:
        """Return the parameters with their uncertainty and status, and the notes on them."""
        law, points = self.law, self.points
        found = {name: (float(x), float(s)) for name, x, s in zip(law.units, p, se, strict=True)}
        judged = {name: status(name, *x, points.mu, points.v) for name, x in found.items()}
        if judged.get("b") == NOT_ZERO:  # without proven influence of the speed, v0 has no meaning
            judged["v0"] = NOT_DETERMINED
        notes = [f"{law.name}: {name} is {word}" for name, word in judged.items() if word]
        notes += [
            f"{law.name}: {name} is negative, which has no physical meaning"
            for name, (x, _) in found.items()
            if name.startswith("mu") and x < 0.0
        ]
        if at_bound:
            notes.append(f"{law.name}: its speed scale reached the bound of the search range")
        parameters = (
            FrictionParameter(name, unit, *found[name], judged[name])
            for name, unit in law.units.items()
        )
        return tuple(parameters), tuple(notes)


def law_variance(rotated: Array, variance: Array, dof: int) -> float:
    """Find q >= 0 for which ``sum r² / (variance + q)`` equals the degrees of freedom, else 0.

    `rotated` are the misfits in the axes of the covariance, `variance` its eigenvalues, each (n,).
    """
    from scipy.optimize import brentq  # slow to import

    def excess(log_q: float) -> float:
        return float(np.sum(rotated**2 / (variance + math.exp(log_q)))) - dof

    low = math.log(ROUNDING)
    if dof <= 0 or excess(low) <= 0.0:
        return 0.0 if np.any(variance > 0.0) else ROUNDING
    high = math.log(float(rotated @ rotated) / dof) + 1e-6
    return math.exp(brentq(excess, low, high, xtol=1e-12, rtol=1e-14))


def _inverse(J: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Compute ``(J'J)^-1`` without singular directions, and which parameters are determined."""
    length = np.linalg.norm(J, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    _, sizes, V = np.linalg.svd(J / length, full_matrices=False)
    regular = sizes > SINGULAR * max(float(sizes[0]), 1e-300)
    determined = np.sqrt(np.sum(V[~regular] ** 2, axis=0)) <= 1e-3
    inverse = (V[regular].T / sizes[regular] ** 2) @ V[regular] / np.outer(length, length)
    return inverse, determined


def status(name: str, value: float, se: float, mu: Array, v: Array) -> str:
    """Judge a parameter by its standard error, given coefficients mu and speeds v; empty if fine.

    A speed scale is not determined if its 95 % interval spans more than a factor of ten either way,
    a coefficient if its standard error exceeds half the mean mu, an exponent if it exceeds 1.
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


def verdict_of(fits: Sequence[FrictionLawFit]) -> str:
    """Recommend a formula in plain words; none if all formulas fit poorly."""
    closest = min(fits, key=lambda f: f.rms_misfit)
    if all(f.law_error > NO_LAW for f in fits):
        return (
            f"None of the fitted formulas holds over the whole range: the closest, {closest.law}, "
            f"misses by {100 * closest.rms_misfit:.2g} % RMS, "
            f"{100 * abs(closest.worst_misfit):.2g} % at worst "
            f"(at {closest.worst_force_N_m:.3g} N/m); take the surface itself, or a part of "
            "the range."
        )
    comparable = [f for f in fits if not math.isnan(f.criterion)]
    if not comparable:
        return "Too few independent points to compare friction laws."
    best = min(comparable, key=lambda f: f.criterion)
    text = (
        f"Best formula: {best.law}, {best.formula.text} (f in N/m, v in m/s), misfit "
        f"{100 * best.rms_misfit:.2g} % RMS, {100 * abs(best.worst_misfit):.2g} % at worst"
    )
    if not best.determined:
        text += "; not all of its parameters are determined: use it within the measured range only"
    equal = [f.law for f in comparable if f is not best and f.criterion < 2.0]
    if equal:
        text += f"; {', '.join(equal)} {'does' if len(equal) == 1 else 'do'} as well"
    coulomb = next((f for f in fits if f.law == "coulomb"), None)
    if coulomb is not None and best.law != "coulomb":
        text += (
            f". A constant coefficient misses by {100 * coulomb.rms_misfit:.2g} % RMS, "
            f"{100 * abs(coulomb.worst_misfit):.2g} % at worst"
        )
    return text + "."

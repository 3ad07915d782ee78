"""Shear stiffness of the ribs from build-up slopes at several contact arcs.

By Eq. (B1) of `mechanics` the compliance of the ribs depends on the contact arc, that of spans and
supports does not: two arcs separate them. By (B2) and (B3) the effect of bending at the ends of the
contact depends on the tension: runs at several tensions determine it better than the model.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from beltid.errors import FitError, InputError
from beltid.identify.estimators.least_squares import pseudo_inverse, solve_linear
from beltid.identify.shear.build_up import FEWEST, SHARE, BuildUp
from beltid.identify.shear.mechanics import laid_belt

Array = NDArray[np.float64]

NORMAL_LAW: Final = (6.5e7, 3.0256e11)
"""The normal law of Eq. (3) [N/m², N/m³], used for a ribbed belt whose law is unknown."""
SPREADS: Final = {"normal_stiffness": 0.4, "end_bending": 0.5, "micro_slip": 1.0}
"""Relative standard uncertainties of what is assumed: this law, (B2) and (B3) due to the bending
stiffness of a belt at rest, (B4)."""
MODEL_ERROR: Final = 0.005
"""Relative standard uncertainty of a slope, due to effects that (B1) to (B4) neglect."""
SHORTEST_CONTACT: Final = 4.0
"""Arc length over bending length sqrt(EI/T) below which a run is rejected: the model assumes
independent ends of the contact."""
TYPICAL_SPAN: Final = 0.1
"""Effective length of a span at which (B4) is linearised [m]."""
QUANTILE: Final = 3.84
"""95 % quantile of chi² with one degree of freedom."""
CLEAR: Final = 4.0
"""A span that is too short by this many standard uncertainties is an error."""
GRID: Final = np.log(np.geomspace(1.0e5, 1.0e12, 29))
"""Search grid for ln k_s [k_s in N/m²]."""
SHARED: Final = (
    "axial_stiffness",
    "pulley_radius",
    "pulley_speed",  # its gain
    "tension_gain",  # common to both load cells
    "cell_gain",  # of each load cell
    "arc",  # common to all arcs [rad]
    "normal_stiffness",  # common to both coefficients of the normal law
    "end_bending",  # (B2) and (B3)
    "micro_slip",  # (B4)
)
"""Error sources common to all runs, in the order of their unknowns in theta; the errors of the
arc settings follow."""
STEP: Final = 1.0e-6
"""Finite-difference step, in the unit of each unknown."""
FIRST: Final = 2
"""Index of the first error source in theta."""


@dataclass(frozen=True, slots=True)
class BenchValues:
    """Known values of belt and bench, with their standard uncertainties (k = 1)."""

    EA: float
    """Axial stiffness [N]."""
    EI: float
    """Bending stiffness [N m²]."""
    R: float
    """Radius of the belt's centreline on the pulley [m]."""
    span: float
    """Length of a free span [m], for (B2) and (B3); lower limit of L in (B1)."""
    uncertainties: Mapping[str, float]
    """Relative standard uncertainty by source of `SHARED`, those of `SPREADS` unless stated;
    ``arc`` and ``arc_setting``, of each arc, in rad."""
    normal_law: tuple[float, float] = NORMAL_LAW
    """Coefficients of Eq. (3) [N/m², N/m³]."""


@dataclass(frozen=True, slots=True)
class ShearStiffness:
    """Shear stiffness of the ribs, and other results from the slopes."""

    runs: tuple[BuildUp, ...]
    """All runs, including rejected ones."""
    fitted_N_m: tuple[float, ...]
    """Fitted slope (B1) of each run [N/m]; nan for rejected runs."""
    low_N_m2: float
    """Lower end of the 95 % interval of k_s, per length of belt [N/m²]."""
    high_N_m2: float
    """Upper end of the interval [N/m²]; infinite if rigid ribs fit as well."""
    scatter: float
    """Scatter of the slopes about (B1) over their standard errors [-]; nan for two runs."""
    shear_stiffness_N_m2: float = math.nan
    """k_s [N/m²]; this and all following values are nan if the slopes give only a bound."""
    shear_stiffness_u_N_m2: float = math.nan
    """Combined standard uncertainty of k_s (k = 1) [N/m²]."""
    effective_span_m: float = math.nan
    """L of (B1) [m]: half the sum of both spans, plus EA times the compliance of a support."""
    effective_span_u_m: float = math.nan
    shares: dict[str, float] = field(default_factory=dict)
    """Relative standard uncertainty of k_s due to each source [-]."""

    @property
    def resolved(self) -> bool:
        """True if the slopes exclude rigid ribs."""
        return math.isfinite(self.high_N_m2)


def fit_shear_stiffness(runs: Sequence[BuildUp], bench: BenchValues) -> ShearStiffness:
    """Fit the shear stiffness of the ribs to the build-up slopes of a rig's runs.

    Weighted least squares for ln k_s and L. Each uncertainty of `bench` and of the lift-off is a
    further unknown with a prior, so that the covariance includes all of them. The interval comes
    from the profile likelihood: it is far from normal if the data hardly resolve the ribs'
    compliance.

    Parameters
    ----------
    runs : sequence of BuildUp
        The runs; those that are not "ok" are ignored.
    bench : BenchValues
        Known values of belt and bench.

    Raises
    ------
    InputError
        If the usable runs have fewer than two contact arcs.
    FitError
        If the slopes imply spans shorter than the rig's.
    """
    runs = [_with_whole_contact(run, bench) for run in runs]
    used = [k for k, run in enumerate(runs) if run.ok]
    arcs = sorted({runs[k].arc_deg for k in used})
    if len(arcs) < 2:
        found = f"contact arc {arcs[0]:g} deg only" if arcs else "no contact arc"
        problem = (
            f"{found} among the usable runs, must be two arcs or more: one arc cannot separate the "
            "shear of the ribs from the compliance of the bench"
        )
        raise InputError([problem, *not_used(runs)])
    slopes = _Slopes.of([runs[k] for k in used], arcs, bench)
    ln_k = slopes.best_ln_k()
    dof = len(used) - 2
    scatter = math.sqrt(slopes.cost(ln_k) / dof) if dof else math.nan
    if scatter > 1.0:
        slopes = replace(slopes, error=scatter * slopes.error)
        ln_k = slopes.best_ln_k()
    theta, residuals = slopes.fit_at(ln_k)
    low, high = slopes.interval(ln_k)
    fitted = np.full(len(runs), np.nan)
    fitted[used] = slopes.slope / (1.0 + slopes.error * residuals[: len(used)])
    result = ShearStiffness(tuple(runs), tuple(fitted.tolist()), low, high, scatter)
    if not result.resolved:
        return result
    k_s, span = math.exp(ln_k), float(theta[1])
    # linearise about zero errors, as in the fit
    theta[FIRST:] = 0.0
    sensitivity = pseudo_inverse(slopes.jacobian(theta))
    u = np.linalg.norm(sensitivity, axis=1)
    if span <= 0.0 or span + CLEAR * u[1] < bench.span:
        raise FitError(
            f"the slopes of the build-up imply free spans of {span:.3g} m (standard uncertainty "
            f"{u[1]:.2g} m), shorter than the {bench.span:g} m of the rig: the belt does not "
            "behave like an elastic belt that sticks (take-up of the bench, load cells that lag), "
            "or span, axial stiffness or radius are wrong"
        )
    return replace(
        result,
        shear_stiffness_N_m2=k_s,
        shear_stiffness_u_N_m2=k_s * float(u[0]),
        effective_span_m=span,
        effective_span_u_m=float(u[1]),
        shares=_shares(sensitivity[0], len(used)),
    )


def _with_whole_contact(run: BuildUp, bench: BenchValues) -> BuildUp:
    """Reject a run if bending lifts too much of its belt off the pulley."""
    if not run.ok:
        return run
    least = bench.EI * (SHORTEST_CONTACT / (bench.R * math.radians(run.arc_deg))) ** 2
    if run.initial_tension_N >= least:
        return run
    reason = (
        f"initial tension below {least:.3g} N at {run.arc_deg:g} deg: bending lifts much of the "
        "belt off the pulley"
    )
    return replace(run, status=reason)


def not_used(runs: Sequence[BuildUp]) -> list[str]:
    """List why runs are not used, one line per reason, and the sampling rate that would do."""
    lines = []
    short = [run for run in runs if math.isfinite(run.needed_rate_Hz)]
    if short:
        counts, rates = zip(*((r.n_samples, r.needed_rate_Hz) for r in short), strict=True)
        low, high = min(counts), max(counts)
        lines.append(
            f"{len(short)} of {len(runs)} runs have {low}{f' to {high}' if high > low else ''} "
            f"samples before {100 * SHARE:g} % of the plateau difference, must be >= {FEWEST}: "
            f"sample at {min(rates):g} Hz for the slowest of them, or {max(rates):g} Hz for all of "
            "them, or turn the pulley more slowly"
        )
    labels: dict[str, list[str]] = {}
    for run in runs:
        if not run.ok and run not in short:
            labels.setdefault(run.status, []).append(run.run)
    for status, (first, *others) in labels.items():
        more = f" and {len(others)} more" if others else ""
        lines.append(f"run {first}{more} cannot be used: {status}")
    return lines


def _shares(sensitivity: Array, n: int) -> dict[str, float]:
    """Split the standard uncertainty of ln k_s by source, from its derivatives."""
    slopes, shared, settings = np.split(np.abs(sensitivity), [n, n + len(SHARED)])
    return {
        "slopes": float(np.linalg.norm(slopes)),
        **dict(zip(SHARED, shared.tolist(), strict=True)),
        "arc_setting": float(np.linalg.norm(settings)),
    }


@dataclass(frozen=True, slots=True, eq=False)
class _Slopes:
    """Comparison of measured slopes with (B1), as a function of theta.

    theta holds ln k_s, L [m], and the errors of `SHARED` and of each arc setting, in units of their
    standard uncertainties. The residuals are linearised in all of them except ln k_s: they are
    almost linear in L, and the errors are small.
    """

    slope: Array
    error: Array
    """Relative standard error of each slope."""
    tension: Array
    arc: Array
    """Contact arc of each run [rad]."""
    setting: NDArray[np.intp]
    """Index of the arc setting of each run."""
    bench: BenchValues

    @classmethod
    def of(cls, runs: Sequence[BuildUp], arcs: Sequence[float], bench: BenchValues) -> _Slopes:
        """Collect the slopes of usable runs."""
        slope, se, tension, arc = np.array(
            [(r.slope_N_m, r.slope_se_N_m, r.initial_tension_N, r.arc_deg) for r in runs]
        ).T
        error = np.hypot(se / slope, MODEL_ERROR)
        return cls(slope, error, tension, np.radians(arc), np.searchsorted(arcs, arc), bench)

    def fitted(self, theta: Array) -> Array:
        """Calculate the slopes of recorded tension over recorded travel by (B1) to (B4) [N/m]."""
        bench, n = self.bench, FIRST + len(SHARED)
        stated = {**SPREADS, **bench.uncertainties}
        EA, R, speed, gain, cell, arc, normal, bending, slip = theta[FIRST:n] * [
            stated[name] for name in SHARED
        ]
        R_true = bench.R * (1.0 + R)
        k_linear, k_quadratic = bench.normal_law
        belt = laid_belt(
            bench.EA * (1.0 + EA),
            bench.EI,
            self.tension,
            R_true,
            bench.span,
            (k_linear * (1.0 + normal), k_quadratic * (1.0 + normal)),
            1.0 + bending,
        )
        length = R_true * (self.arc + arc + stated["arc_setting"] * theta[n:][self.setting])
        k_s, span = math.exp(theta[0]), float(theta[1])
        slip_loss = (1.0 + slip) * belt.micro_slip(k_s, length, span)
        travel = (1.0 + R) * (1.0 + speed)
        # averaging two independent cell gains reduces their error by sqrt(2)
        tensions = 1.0 + gain + cell / math.sqrt(2.0)
        slope = belt.build_up_slope(k_s, length, span) * (1.0 - slip_loss)
        return np.asarray(slope * travel / tensions)

    def residuals(self, theta: Array) -> Array:
        """Return the misfit of each slope over its error, followed by the errors in theta."""
        return np.concatenate([(self.slope / self.fitted(theta) - 1.0) / self.error, theta[FIRST:]])

    def jacobian(self, theta: Array) -> Array:
        """Differentiate the residuals by finite differences."""
        here = self.residuals(theta)
        steps = STEP * np.eye(theta.size)
        return np.array([self.residuals(theta + step) - here for step in steps]).T / STEP

    def fit_at(self, ln_k: float) -> tuple[Array, Array]:
        """Fit all other unknowns at a given ln k_s; return theta and the residuals."""
        theta = np.zeros(FIRST + len(SHARED) + int(self.setting.max()) + 1)
        theta[:2] = ln_k, TYPICAL_SPAN
        solution = solve_linear(self.jacobian(theta)[:, 1:], -self.residuals(theta))
        theta[1:] += solution.parameters
        return theta, -solution.residuals

    def cost(self, ln_k: float) -> float:
        """Return the smallest sum of squares at a given ln k_s."""
        return float(np.sum(self.fit_at(ln_k)[1] ** 2))

    def best_ln_k(self) -> float:
        """Find the ln k_s with the smallest sum of squares."""
        k = int(np.argmin([self.cost(ln_k) for ln_k in GRID]))
        bracket = GRID[max(k - 1, 0)], GRID[min(k + 1, GRID.size - 1)]
        return float(minimize_scalar(self.cost, bounds=bracket, method="bounded").x)

    def interval(self, ln_k: float) -> tuple[float, float]:
        """Return the 95 % interval of the shear stiffness [N/m²]."""
        limit = self.cost(ln_k) + QUANTILE
        ends = [0.0, math.inf]
        for i, edge in enumerate((GRID[0], GRID[-1])):
            if self.cost(edge) > limit:
                bracket = sorted((edge, ln_k))
                ends[i] = math.exp(brentq(lambda x: self.cost(x) - limit, *bracket, xtol=1e-6))
        return ends[0], ends[1]

"""Shear stiffness of the ribs from slopes of the build-up at several contact arcs.

By Eq. (B1) of `mechanics` the compliance of the ribs goes with the contact arc, that of spans and
supports does not: two arcs tell them apart. By (B2) and (B3) what bending does at the ends of the
contact goes with the tension: runs at several tensions know it better than the model does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from beltid.errors import FitError, InputError
from beltid.identify.estimators.least_squares import pseudo_inverse, solve_linear
from beltid.identify.shear.build_up import FEWEST, SHARE, BuildUp
from beltid.identify.shear.mechanics import build_up_slope, laid_belt, micro_slip

Array = NDArray[np.float64]

NORMAL_LAW: Final = (6.5e7, 3.0256e11)
"""The normal law of Eq. (3) [N/m², N/m³], taken for a ribbed belt whose own is not known."""
NORMAL_STIFFNESS_SPREAD: Final = 0.4
"""Its standard uncertainty over itself."""
BENDING_SPREAD: Final = 0.5
"""Standard uncertainty of (B2) and (B3) over themselves, by the bending stiffness of a belt that
lies still."""
MICRO_SLIP_SPREAD: Final = 1.0
"""Standard uncertainty of (B4) over itself."""
MODEL_ERROR: Final = 0.005
"""Standard uncertainty of the slope of a run, relative, by what (B1) to (B4) leave out."""
SHORTEST_CONTACT: Final = 4.0
"""Length of arc over bending length sqrt(EI/T) below which a run is not used: the ends of
the contact are taken for independent."""
TYPICAL_SPAN: Final = 0.1
"""Effective length of a span at which (B4) is linearised [m]."""
QUANTILE: Final = 3.84
"""95 % of chi² with one degree of freedom."""
CLEAR: Final = 4.0
"""Standard uncertainties by which a span must be too short to be none."""
GRID: Final = np.log(np.geomspace(1.0e5, 1.0e12, 29))
"""Values of ln k_s that are searched [k_s in N/m²]."""
SHARED: Final = (
    "axial_stiffness",
    "pulley_radius",
    "pulley_speed",
    "tension_gain",
    "cell_gain",
    "arc",
    "normal_stiffness",
    "end_bending",
    "micro_slip",
)
"""Sources of error that all runs share, in the order of their unknowns; those of the setting of
each arc follow."""
STEP: Final = 1.0e-6
"""Step of the differences, in the unit of each unknown."""
FIRST: Final = 2
"""Place of the first of them in theta."""


@dataclass(frozen=True, slots=True)
class BenchValues:
    """What is known of belt and bench, with standard uncertainties (k = 1)."""

    EA: float
    """Axial stiffness [N]."""
    EI: float
    """Bending stiffness [N m²]."""
    R: float
    """Radius of the belt's centreline on the pulley [m]."""
    span: float
    """Length of a free span [m], for (B2) and (B3); L of (B1) cannot be less."""
    axial_stiffness: float = 0.0
    """Of EA, as a share."""
    pulley_radius: float = 0.0
    """Of R, as a share."""
    pulley_speed: float = 0.0
    """Gain of the speed of the pulley, as a share."""
    tension_gain: float = 0.0
    """Gain common to both load cells, as a share."""
    cell_gain: float = 0.0
    """Gain of each load cell by itself, as a share."""
    arc: float = 0.0
    """Of all arcs together [rad]."""
    arc_setting: float = 0.0
    """Of each arc by itself [rad]."""
    normal_law: tuple[float, float] = NORMAL_LAW
    """Coefficients of Eq. (3) [N/m², N/m³]."""
    normal_stiffness: float = NORMAL_STIFFNESS_SPREAD
    """Of both of them together, as a share."""
    end_bending: float = BENDING_SPREAD
    """Of (B2) and (B3), as a share."""
    micro_slip: float = MICRO_SLIP_SPREAD
    """Of (B4), as a share."""


@dataclass(frozen=True, slots=True)
class ShearStiffness:
    """Shear stiffness of the ribs, and what else the slopes tell."""

    runs: tuple[BuildUp, ...]
    """All runs, also those that are not used."""
    fitted_N_m: tuple[float, ...]
    """Slope by (B1) of every run, nan where it is not used [N/m]."""
    low_N_m2: float
    """Lower end of the interval of 95 % for k_s, per length of belt [N/m²]."""
    high_N_m2: float
    """Its upper end; infinite where ribs without compliance fit as well."""
    scatter: float
    """Scatter of the slopes about (B1) over their standard errors [-]; nan for two runs."""
    shear_stiffness_N_m2: float = math.nan
    """k_s; nan, as all that follows, where the slopes give no more than a bound."""
    shear_stiffness_u_N_m2: float = math.nan
    """Its combined standard uncertainty (k = 1)."""
    effective_span_m: float = math.nan
    """L of (B1): half of both spans, and EA times the compliance of a support."""
    effective_span_u_m: float = math.nan
    shares: dict[str, float] = field(default_factory=dict)
    """Standard uncertainty of k_s over k_s [-] by each source."""

    @property
    def resolved(self) -> bool:
        """Whether ribs without compliance are excluded."""
        return math.isfinite(self.high_N_m2)


def fit_shear_stiffness(runs: Sequence[BuildUp], bench: BenchValues) -> ShearStiffness:
    """Find the shear stiffness that the slopes of a rig's runs tell.

    Weighted least squares for ln k_s and L; every uncertainty of `bench` and the lift-off is one
    more unknown with its prior, so that the covariance holds them all. The interval is that of the
    profile likelihood: far from normal where the ribs are hardly softer than the data resolve.

    Parameters
    ----------
    runs : sequence of BuildUp
        The runs; those that are not "ok" are left out.
    bench : BenchValues
        What is known of belt and bench.

    Raises
    ------
    InputError
        If the runs that can be used have fewer than two contact arcs.
    FitError
        If the slopes are those of spans shorter than the rig's.
    """
    runs = [_with_whole_contact(run, bench) for run in runs]
    used = [k for k, run in enumerate(runs) if run.ok]
    arcs = sorted({runs[k].arc_deg for k in used})
    if len(arcs) < 2:
        found = f"contact arc {arcs[0]:g} deg only" if arcs else "no contact arc"
        why = (
            f"{found} among the runs that can be used, must be two arcs or more: one arc cannot "
            "tell the shear of the ribs from the compliance of the bench"
        )
        raise InputError([why, *not_used(runs)], code="no-run")
    slopes = _Slopes.of([runs[k] for k in used], arcs, bench)
    ln_k = slopes.best()
    freedom = len(used) - 2
    scatter = math.sqrt(slopes.cost(ln_k) / freedom) if freedom else math.nan
    if scatter > 1.0:
        slopes = replace(slopes, error=scatter * slopes.error)
        ln_k = slopes.best()
    theta, residuals = slopes.given(ln_k)
    low, high = slopes.interval(ln_k)
    fitted = np.full(len(runs), np.nan)
    fitted[used] = slopes.slope / (1.0 + slopes.error * residuals[: len(used)])
    result = ShearStiffness(tuple(runs), tuple(fitted.tolist()), low, high, scatter)
    if not result.resolved:
        return result
    k_s, span = math.exp(ln_k), float(theta[1])
    # the errors are linear about none of them, here as in the fit
    theta[FIRST:] = 0.0
    sensitivity = pseudo_inverse(slopes.jacobian(theta))
    u = np.linalg.norm(sensitivity, axis=1)
    if span <= 0.0 or span + CLEAR * u[1] < bench.span:
        raise FitError(
            f"the slopes of the build-up are those of free spans of {span:.3g} m (standard "
            f"uncertainty {u[1]:.2g} m), shorter than the {bench.span:g} m of the rig: the "
            "tensions do not part as those of an elastic belt that sticks (take-up of the bench, "
            "cells that lag), or span, axial stiffness or radius are not those of the bench"
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
    """A run, set aside if bending lifts too much of its belt off the pulley."""
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
    """Why runs are not used, a line per reason; of those with too few samples, what would do."""
    lines = []
    short = [run for run in runs if math.isfinite(run.needed_rate_Hz)]
    if short:
        counts, rates = zip(*((r.n_samples, r.needed_rate_Hz) for r in short), strict=True)
        lines.append(
            f"{len(short)} of {len(runs)} runs have {_span(counts)} samples before "
            f"{100 * SHARE:g} % of the plateau difference, must be >= {FEWEST}: sample at "
            f"{min(rates):g} Hz for the slowest of them, at {max(rates):g} Hz for all of them, "
            "or turn the pulley more slowly"
        )
    others = [run for run in runs if not run.ok and run not in short]
    for status in dict.fromkeys(run.status for run in others):
        labels = [run.run for run in others if run.status == status]
        more = f" and {len(labels) - 1} more" if len(labels) > 1 else ""
        lines.append(f"run {labels[0]}{more} cannot be used: {status}")
    return lines


def _span(counts: Sequence[int]) -> str:
    low, high = min(counts), max(counts)
    return str(low) if low == high else f"{low} to {high}"


def _shares(sensitivity: Array, n: int) -> dict[str, float]:
    """Standard uncertainty of ln k_s by each source, from its derivatives by the residuals."""
    slopes, shared, settings = np.split(np.abs(sensitivity), [n, n + len(SHARED)])
    return {
        "slopes": float(np.linalg.norm(slopes)),
        **dict(zip(SHARED, shared.tolist(), strict=True)),
        "arc_setting": float(np.linalg.norm(settings)),
    }


@dataclass(frozen=True, slots=True, eq=False)
class _Slopes:
    """Slopes of runs against (B1), as a function of theta.

    theta is ln k_s, L [m], and the errors of `SHARED` and of the setting of each arc, in units of
    their standard uncertainties. All but ln k_s are taken as linear in the residuals: L all but is,
    and the errors are small.
    """

    slope: Array
    error: Array
    """Standard error of each slope, relative."""
    tension: Array
    arc: Array
    """Contact arc of each run [rad]."""
    setting: NDArray[np.intp]
    """Which of the arcs it is."""
    bench: BenchValues

    @classmethod
    def of(cls, runs: Sequence[BuildUp], arcs: Sequence[float], bench: BenchValues) -> _Slopes:
        slope, se, tension, arc = np.array(
            [(r.slope_N_m, r.slope_se_N_m, r.initial_tension_N, r.arc_deg) for r in runs]
        ).T
        error = np.hypot(se / slope, MODEL_ERROR)
        return cls(slope, error, tension, np.radians(arc), np.searchsorted(arcs, arc), bench)

    def fitted(self, theta: Array) -> Array:
        """Slopes by (B1) to (B3) of tensions and travel as they are recorded [N/m]."""
        bench, n = self.bench, FIRST + len(SHARED)
        EA, R, speed, gain, cell, arc, normal, bending, slip = theta[FIRST:n] * [
            getattr(bench, name) for name in SHARED
        ]
        R_true = bench.R * (1.0 + R)
        belt = laid_belt(
            bench.EA * (1.0 + EA),
            bench.EI,
            self.tension,
            R_true,
            bench.span,
            (bench.normal_law[0] * (1.0 + normal), bench.normal_law[1] * (1.0 + normal)),
        )
        belt = replace(
            belt,
            lift_off=(1.0 + bending) * belt.lift_off,
            end_compliance=(1.0 + bending) * belt.end_compliance,
        )
        length = R_true * (self.arc + arc + bench.arc_setting * theta[n:][self.setting])
        k_s, span = math.exp(theta[0]), float(theta[1])
        lost = (1.0 + slip) * micro_slip(belt, k_s, length, span)
        travel = (1.0 + R) * (1.0 + speed)
        # both cells halve the error of one of them in the difference of the tensions
        tensions = 1.0 + gain + cell / math.sqrt(2.0)
        slope = build_up_slope(belt, k_s, length, span) * (1.0 - lost)
        return np.asarray(slope * travel / tensions)

    def residuals(self, theta: Array) -> Array:
        """Misfit of each slope over its error, and the errors of theta."""
        return np.concatenate([(self.slope / self.fitted(theta) - 1.0) / self.error, theta[FIRST:]])

    def jacobian(self, theta: Array) -> Array:
        """Derivatives of the residuals, by differences."""
        here = self.residuals(theta)
        steps = STEP * np.eye(theta.size)
        return np.array([self.residuals(theta + step) - here for step in steps]).T / STEP

    def given(self, ln_k: float) -> tuple[Array, Array]:
        """Theta and residuals of the least sum of squares with a shear stiffness that is given."""
        theta = np.zeros(FIRST + len(SHARED) + int(self.setting.max()) + 1)
        theta[:2] = ln_k, TYPICAL_SPAN
        found = solve_linear(self.jacobian(theta)[:, 1:], -self.residuals(theta))
        theta[1:] += found.parameters
        return theta, -found.residuals

    def cost(self, ln_k: float) -> float:
        """The least sum of squares with a shear stiffness that is given."""
        return float(np.sum(self.given(ln_k)[1] ** 2))

    def best(self) -> float:
        """Ln k_s of the least sum of squares."""
        k = int(np.argmin([self.cost(ln_k) for ln_k in GRID]))
        around = GRID[max(k - 1, 0)], GRID[min(k + 1, GRID.size - 1)]
        return float(minimize_scalar(self.cost, bounds=around, method="bounded").x)

    def interval(self, ln_k: float) -> tuple[float, float]:
        """Shear stiffnesses that the slopes exclude by less than 95 % [N/m²]."""
        limit = self.cost(ln_k) + QUANTILE
        ends = [0.0, math.inf]
        for i, edge in enumerate((GRID[0], GRID[-1])):
            if self.cost(edge) > limit:
                between = sorted((edge, ln_k))
                ends[i] = math.exp(brentq(lambda x: self.cost(x) - limit, *between, xtol=1e-6))
        return ends[0], ends[1]

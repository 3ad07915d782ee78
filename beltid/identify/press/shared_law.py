"""One quadratic law for several press curves, every test with its own contact point.

For a known contact point the law of Eq. (3) is linear in its coefficients. The contact points
are found with it: the unknowns are the slope A and the curvature B of the law at a reference force
F, and for every test the position p at which it reaches F (cycles of one test share it),

    f = F + A (x - p) + B (x - p)²,

a form that stays regular for linear and for purely quadratic laws. Law and contact points follow:
``k_quadratic = B``, ``k_linear = sqrt(A² - 4 B F)``, ``offset = p - 2 F/(A + k_linear)``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from beltid.errors import ConvergenceError, FitError
from beltid.identify.estimators.least_squares import LinearFit, solve_least_squares
from beltid.identify.estimators.statistics import integrated_autocorrelation_time
from beltid.identify.press.curves import PressCurve

Array = NDArray[np.float64]
Form = Literal["quadratic", "linear", "purely quadratic"]

MAX_ITERATIONS = 100
MAX_HALVINGS = 40
STEP_TOLERANCE = 1.0e-12
"""The search ends when a step changes the force by less than this share."""
ROUNDING_STEP = 1.0e-9
"""Below this step the sum of squares is flat to rounding and need not fall any more,"""
ROUNDING = 1.0e-12
"""and above it may rise by this share."""
DOUBT = 0.00135
"""A coefficient of the wrong sign is taken as zero unless chance gives it this rarely: three
standard errors, more where few independent nodes determine them (Student's t)."""
NEGLIGIBLE_SHARE = 2.0e-3
"""So is one that changes the force by less than this share of the largest force."""
HELD = "negative beyond doubt"
"""Says a note on a coefficient that is held at zero against the data."""
LARGEST_MISFIT = 0.1
"""A law with a coefficient held at zero may be off by this share of the largest force."""


@dataclass(frozen=True, slots=True)
class SharedLaw:
    """A law through several curves.

    Attributes
    ----------
    k_linear_N_m2, k_quadratic_N_m3 : float
        Coefficients [N/m²], [N/m³].
    cofactor : ndarray
        Their covariance per mean square of the residuals, shape (2, 2); the contact points, which
        are unknown too, are in it.
    offsets_m : ndarray
        Position of the contact point of each test [m], shape (tests,), in the order of their
        first curves.
    residuals : tuple of ndarray
        Middle of the branches less law at the nodes of each curve [N/m].
    tau : float
        Integrated autocorrelation time of the residuals [nodes].
    form : str
        "quadratic", or what was left where a coefficient was taken as zero.
    notes : tuple of str
        What there is to say about the form.
    """

    k_linear_N_m2: float
    k_quadratic_N_m3: float
    cofactor: Array
    offsets_m: Array
    residuals: tuple[Array, ...]
    tau: float
    form: Form
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class _Parabola:
    """Solution in the regular unknowns (A, B, p_1 ... p_J); B is fitted if quadratic only."""

    form: Form
    F: float
    A: float
    B: float
    p: Array
    linear: LinearFit
    residuals: tuple[Array, ...]
    tau: float

    @property
    def sum_of_squares(self) -> float:
        return float(sum(r @ r for r in self.residuals))

    @property
    def covariance(self) -> Array:
        """Covariance of the unknowns of the form, correlation of the residuals allowed for."""
        return self.linear.cofactor * self.linear.residual_variance * self.tau

    @property
    def significant(self) -> float:
        """Standard errors beyond which a value is no accident."""
        p = self.linear.coefficients.size
        return float(stdtrit(max(self.linear.residuals.size / self.tau - p, 1.0), 1.0 - DOUBT))


def residual_sum_of_squares(curves: Sequence[PressCurve]) -> tuple[float, tuple[Array, ...]]:
    """Sum of squares [N²/m²] and residuals of one unconstrained law through the curves."""
    parabola = _fit(curves, "quadratic")
    return parabola.sum_of_squares, parabola.residuals


def fit_shared_law(curves: Sequence[PressCurve], place: str) -> SharedLaw:
    """Fit one admissible law to curves with a free contact point for every test.

    Parameters
    ----------
    curves : sequence of PressCurve
        Curves, at least one.
    place : str
        What is fitted, for messages.

    Returns
    -------
    SharedLaw
        With ``k >= 0``. A coefficient that comes out negative is set to zero and the rest fitted
        again; a note says so, and how far off the law is if this is no matter of noise.

    Raises
    ------
    FitError
        If the force does not rise, or the law with a negative coefficient set to zero is off by
        more than `LARGEST_MISFIT`.
    ConvergenceError
        If the contact points are not found.
    """
    full = _fit(curves, "quadratic")
    top = float(max(np.max(c.middle_N_m) for c in curves))
    if full.A <= 0.0:
        raise FitError(f"{place}: the force falls with penetration, must rise")
    se = np.sqrt(np.diag(full.covariance))
    if full.B < 0.0:
        span = max(float(np.ptp(c.position_m)) for c in curves)
        wrong = _Negative("k_quadratic", "N/m³", full.B, float(se[1]), -full.B * span**2 / top)
        return _held(curves, "linear", wrong, full.significant, place)
    square = full.A**2 - 4.0 * full.B * full.F
    if square < 0.0:
        gradient = np.array([2.0 * full.A, -4.0 * full.F])
        square_se = float(np.sqrt(gradient @ full.covariance[:2, :2] @ gradient))
        share = -square / (4.0 * full.B) / top
        wrong = _Negative("k_linear²", "N²/m⁴", square, square_se, share)
        return _held(curves, "purely quadratic", wrong, full.significant, place)
    return _law(full)


@dataclass(frozen=True, slots=True)
class _Negative:
    """A coefficient that came out negative; `share` is what it changes of the largest force."""

    name: str
    unit: str
    value: float
    se: float
    share: float


def _held(
    curves: Sequence[PressCurve], form: Form, wrong: _Negative, significant: float, place: str
) -> SharedLaw:
    """The law with the coefficient at zero; refused where it is far off the curves."""
    found = _fit(curves, form)
    law = f"{place}: {wrong.name} came out as {wrong.value:.3g} ± {wrong.se:.2g} {wrong.unit}"
    if -wrong.value <= significant * wrong.se or wrong.share <= NEGLIGIBLE_SHARE:
        return _law(found, (f"{law}, not different from zero: a {form} law was fitted",))
    top = float(max(np.max(c.middle_N_m) for c in curves))
    off = float(max(np.max(np.abs(r)) for r in found.residuals)) / top
    if off > LARGEST_MISFIT:
        raise FitError(
            f"{law} (changes the force by {100 * wrong.share:.2g} % of its largest value), must "
            f"be >= 0, and with zero the law is off by up to {100 * off:.2g} % of the largest "
            f"force, allowed is {100 * LARGEST_MISFIT:g} %: the curve is not a law "
            "k_linear delta + k_quadratic delta² that stiffens from a contact point"
        )
    note = (
        f"{law}, {HELD}: it is held at zero, and the {form} law is off by up to "
        f"{100 * off:.2g} % of the largest force"
    )
    return _law(found, (note,))


def _fit(curves: Sequence[PressCurve], form: Form) -> _Parabola:
    """Gauss–Newton with step halving on the unknowns (A, [B,] p_1 ... p_J)."""
    F = 0.5 * min(float(np.max(c.middle_N_m)) for c in curves)
    theta = _start(curves, F, form)
    residuals, jacobian = _model(curves, F, theta, form)
    best = float(residuals @ residuals)
    size = float(np.linalg.norm(np.concatenate([c.middle_N_m for c in curves])))
    for _ in range(MAX_ITERATIONS):
        linear = solve_least_squares(jacobian, residuals)
        step = linear.coefficients
        moved = float(np.max(np.abs(step) * np.linalg.norm(jacobian, axis=0))) / size
        if moved < STEP_TOLERANCE:
            break
        for halving in range(MAX_HALVINGS):
            trial = theta + step * 0.5**halving
            residuals, jacobian = _model(curves, F, trial, form)
            found = float(residuals @ residuals)
            if found <= best * (1.0 + ROUNDING) or moved < ROUNDING_STEP:
                break
        else:
            raise _not_converged(moved)
        theta, best = trial, found
    else:
        raise _not_converged(moved)
    cuts = np.cumsum([c.position_m.size for c in curves])[:-1]
    parts = tuple(np.split(residuals, cuts))
    A, B, p = _unpack(theta, F, form)
    return _Parabola(form, F, A, B, p, linear, parts, correlation_time(parts))


def _not_converged(moved: float) -> ConvergenceError:
    return ConvergenceError(
        f"press: the search for the contact points stopped at a step of {moved:.1e} of the force, "
        f"must come below {STEP_TOLERANCE:g}: the curves do not determine a law",
        iterations=MAX_ITERATIONS,
        residual=moved,
    )


def test_of_curve(curves: Sequence[PressCurve]) -> NDArray[np.intp]:
    """Number of the test that each curve belongs to, counted by first appearance."""
    numbers = {label: i for i, label in enumerate(dict.fromkeys(c.test for c in curves))}
    return np.array([numbers[c.test] for c in curves], dtype=np.intp)


def correlation_time(parts: Sequence[Array]) -> float:
    """Mean integrated autocorrelation time of residuals of several curves [nodes]."""
    weights = np.array([r.size for r in parts], dtype=float)
    times = np.array([integrated_autocorrelation_time(r) for r in parts])
    return float(weights @ times / weights.sum())


def _start(curves: Sequence[PressCurve], F: float, form: Form) -> Array:
    """First values: where each curve reaches F, and the linear fit for these positions."""
    reached = np.array(
        [np.interp(F, np.maximum.accumulate(c.middle_N_m), c.position_m) for c in curves]
    )
    owner = test_of_curve(curves)
    p = np.bincount(owner, weights=reached) / np.bincount(owner)
    y = np.concatenate([c.position_m - q for c, q in zip(curves, p[owner], strict=True)])
    f = np.concatenate([c.middle_N_m for c in curves]) - F
    design = np.column_stack([y, y * y]) if form == "quadratic" else y[:, None]
    return np.concatenate([solve_least_squares(design, f).coefficients, p])


def _unpack(theta: Array, F: float, form: Form) -> tuple[float, float, Array]:
    A = float(theta[0])
    if form == "quadratic":
        return A, float(theta[1]), theta[2:]
    return A, (A * A / (4.0 * F) if form == "purely quadratic" else 0.0), theta[1:]


def _model(curves: Sequence[PressCurve], F: float, theta: Array, form: Form) -> tuple[Array, Array]:
    """Residuals [N/m], shape (n,), and derivatives of the law by the unknowns, shape (n, q)."""
    A, B, p = _unpack(theta, F, form)
    test = test_of_curve(curves)
    y = np.concatenate([c.position_m - q for c, q in zip(curves, p[test], strict=True)])
    if form == "purely quadratic":  # no force before the contact point
        y = np.maximum(y, -2.0 * F / A)
    f = np.concatenate([c.middle_N_m for c in curves])
    owner = np.repeat(test, [c.position_m.size for c in curves])
    by_A = y + A * y * y / (2.0 * F) if form == "purely quadratic" else y
    shape = [by_A, y * y] if form == "quadratic" else [by_A]
    slope = -(A + 2.0 * B * y)
    offsets = np.where(owner[:, None] == np.arange(p.size), slope[:, None], 0.0)
    return f - (F + A * y + B * y * y), np.column_stack([*shape, offsets])


def _law(parabola: _Parabola, notes: tuple[str, ...] = ()) -> SharedLaw:
    """Coefficients and contact points, with the errors carried over (delta method)."""
    A, B, F = parabola.A, parabola.B, parabola.F
    if parabola.form == "quadratic":
        k_linear = float(np.sqrt(A * A - 4.0 * B * F))
        gradient = np.array([[A / k_linear, -2.0 * F / k_linear], [0.0, 1.0]])
    elif parabola.form == "linear":
        k_linear, gradient = A, np.array([[1.0], [0.0]])
    else:
        k_linear, gradient = 0.0, np.array([[0.0], [A / (2.0 * F)]])
    shape = gradient.shape[1]
    return SharedLaw(
        k_linear_N_m2=k_linear,
        k_quadratic_N_m3=B,
        cofactor=gradient @ parabola.linear.cofactor[:shape, :shape] @ gradient.T,
        offsets_m=parabola.p - 2.0 * F / (A + k_linear),
        residuals=parabola.residuals,
        tau=parabola.tau,
        form=parabola.form,
        notes=notes,
    )

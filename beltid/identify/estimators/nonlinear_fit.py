"""Nonlinear least squares that reports its doubt.

The search is scipy's (trust region with bounds, scaled by the columns of the Jacobian). Around it:
a polish by Gauss–Newton steps on a column-scaled QR, so that parameters and errors are good to
many digits; a covariance that says *infinite* where the data do not tell a parameter, instead of a
large meaningless number; and a typed error where no minimum was reached.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import ConvergenceError, InputError
from beltid.identify.estimators.least_squares import LeastSquares

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Model = Callable[[Array], Array]

MAX_EVALUATIONS = 5000
SEARCH_TOLERANCE = 1.0e-14
POLISH_STEPS = 30
POLISH_TOLERANCE = 1.0e-12
"""The polish ends when a step moves the fitted values by less than this share of the data."""
CONVERGED = 1.0e-5
"""A minimum was reached if the Gauss–Newton step left moves the fitted values by less than this
share of the residuals (or by :data:`ROUNDING` of the data, for exact data)."""
ROUNDING = 1.0e-9
SINGULAR = 1.0e-10
"""Singular values of the column-scaled Jacobian below this share of the largest are zero: the
direction is not determined."""
HUGE = 1.0e100
"""Residual of a value that is not finite."""
SEEN = 1.0e-3
"""A parameter with a larger component in a direction that is not determined is not either."""


@dataclass(frozen=True, slots=True, eq=False)
class NonlinearFit(LeastSquares):
    """A minimum of ``sum (w (y - model(theta)))²``.

    The cofactor has zero rows and columns for parameters at a bound (they are no longer free); the
    variance of one that the data do not determine is infinite and its covariances are nan.

    Attributes
    ----------
    parameters : ndarray
        theta at the minimum, shape (p,).
    at_bound : ndarray of bool
        Parameters that ended at a bound, shape (p,).
    determined : ndarray of bool
        Parameters that the data determine, shape (p,); one at a bound is not.
    evaluations : int
        Evaluations of the model spent by the search.
    """

    parameters: Array
    at_bound: Mask
    determined: Mask
    evaluations: int

    @property
    def n_free(self) -> int:
        """Number of parameters that were free at the end."""
        return int(np.count_nonzero(~self.at_bound))

    @property
    def se(self) -> Array:
        """Standard errors, residual variance from the scatter, shape (p,); infinite if unknown."""
        se = np.sqrt(np.diag(self.covariance))
        return np.where(self.determined, se, np.inf)


def fit_nonlinear(
    model: Model,
    jacobian: Model,
    observed: ArrayLike,
    start: ArrayLike,
    *,
    weights: ArrayLike | None = None,
    bounds: tuple[ArrayLike, ArrayLike] | None = None,
) -> NonlinearFit:
    """Minimise ``sum (w (y - model(theta)))²`` from a start.

    Parameters
    ----------
    model, jacobian : callable
        Fitted values, shape (n,), and their derivatives by the parameters, shape (n, p).
    observed : array_like
        y, shape (n,), n >= p.
    start : array_like
        First values of the parameters, shape (p,).
    weights : array_like, optional
        w, one over the standard errors of y, shape (n,).
    bounds : tuple of array_like, optional
        Lowest and highest values of the parameters; infinite where there is none.

    Returns
    -------
    NonlinearFit

    Raises
    ------
    InputError
        If shapes do not fit, a value is not finite, or the model is not finite at the start.
    ConvergenceError
        If no minimum was reached.
    """
    y = np.asarray(observed, dtype=float)
    theta = np.asarray(start, dtype=float)
    w = np.ones_like(y) if weights is None else np.asarray(weights, dtype=float)
    low, high = (
        np.broadcast_to(np.asarray(b, dtype=float), theta.shape)
        for b in (bounds or (-np.inf, np.inf))
    )
    _check(y, theta, w, low, high)
    _check_start(model(theta), jacobian(theta), y, theta)

    def residuals(t: Array) -> Array:
        # far from the minimum a model may overflow: such a step is refused, as it is too bad
        with np.errstate(all="ignore"):
            r = w * (model(t) - y)
        return np.nan_to_num(np.clip(r, -HUGE, HUGE), nan=HUGE)

    def derivatives(t: Array) -> Array:
        with np.errstate(all="ignore"):
            return np.nan_to_num(np.clip(w[:, None] * jacobian(t), -HUGE, HUGE))

    found = _search(residuals, derivatives, theta, (low, high))
    free = found.active_mask == 0
    theta, free, left = _polish(residuals, derivatives, found.x, free, (low, high))
    r, J = residuals(theta), derivatives(theta)
    small = CONVERGED * float(np.linalg.norm(r)) + ROUNDING * float(np.linalg.norm(w * y))
    if not left <= small:
        raise ConvergenceError(
            f"nonlinear fit: no minimum after {found.nfev} evaluations ({found.message}); the step "
            f"left moves the fitted values by {left:.2g}, must be below {small:.2g}",
            iterations=int(found.nfev),
            residual=left,
        )
    cofactor, determined = cofactor_of(J, free)
    return NonlinearFit(cofactor, -r, theta, ~free, determined, int(found.nfev))


def _search(residuals: Model, derivatives: Model, start: Array, bounds: tuple[Array, Array]) -> Any:
    """Result of scipy's search."""
    from scipy.optimize import least_squares  # slow to import

    try:
        return least_squares(
            residuals,
            start,
            derivatives,
            bounds=bounds,
            x_scale="jac",
            ftol=SEARCH_TOLERANCE,
            xtol=SEARCH_TOLERANCE,
            gtol=SEARCH_TOLERANCE,
            max_nfev=MAX_EVALUATIONS,
        )
    except (ValueError, np.linalg.LinAlgError) as error:
        raise ConvergenceError(f"nonlinear fit: the search broke down ({error})") from None


def _check(y: Array, theta: Array, w: Array, low: Array, high: Array) -> None:
    if y.ndim != 1 or theta.ndim != 1 or w.shape != y.shape or not 1 <= theta.size <= y.size:
        raise InputError(
            f"nonlinear fit: observations {y.shape}, weights {w.shape}, start {theta.shape}, must "
            "be (n,), (n,) and (p,) with n >= p >= 1"
        )
    named: Sequence[tuple[str, bool]] = (
        ("observations that are not finite, must be finite", bool(np.all(np.isfinite(y)))),
        ("weights that are not finite and > 0", bool(np.all(np.isfinite(w) & (w > 0.0)))),
        ("a start that is not finite, must be finite", bool(np.all(np.isfinite(theta)))),
        ("bounds without room between them", bool(np.all(low < high))),
        ("a start outside its bounds", bool(np.all((low <= theta) & (theta <= high)))),
    )
    problems = [f"nonlinear fit: {text}" for text, ok in named if not ok]
    if problems:
        raise InputError(problems)


def _check_start(fitted: Array, J: Array, y: Array, theta: Array) -> None:
    if fitted.shape != y.shape or J.shape != (y.size, theta.size):
        raise InputError(
            f"nonlinear fit: model {fitted.shape} and jacobian {J.shape}, must be "
            f"{y.shape} and {(y.size, theta.size)}"
        )
    if not (np.all(np.isfinite(fitted)) and np.all(np.isfinite(J))):
        raise InputError("nonlinear fit: the model is not finite at the start, must be finite")


def _scaled(J: Array) -> tuple[Array, Array]:
    """Jacobian with columns of unit length, and these lengths (1 for a zero column)."""
    length = np.linalg.norm(J, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    return J / length, length


def _step(r: Array, J: Array) -> tuple[Array, float]:
    """Gauss–Newton step without the directions not determined; how far it moves the values."""
    if J.shape[1] == 0:
        return np.zeros(0), 0.0
    scaled, length = _scaled(J)
    step = np.linalg.lstsq(scaled, -r, rcond=SINGULAR)[0]
    return step / length, float(np.linalg.norm(scaled @ step))


def _polish(
    residuals: Model, derivatives: Model, theta: Array, free: Mask, bounds: tuple[Array, Array]
) -> tuple[Array, Mask, float]:
    """Gauss–Newton from near the minimum.

    Returns the parameters, those still free, and what the step that is left would move. A step that
    leaves the bounds puts the parameter on its bound and keeps it there, unless that is worse.
    """
    low, high = bounds
    free = free.copy()
    r = residuals(theta)
    step, left = _step(r, derivatives(theta)[:, free])
    best = theta, free.copy(), left
    for _ in range(POLISH_STEPS + theta.size):
        if left <= POLISH_TOLERANCE * float(np.linalg.norm(r)) or not free.any():
            break
        trial = theta.copy()
        trial[free] += step
        outside = (trial < low) | (trial > high)
        if outside.any():
            trial = np.where(outside, np.clip(trial, low, high), theta)
        r_trial = residuals(trial)
        # near the minimum the sum is flat to rounding: the step that is left tells more than it
        if float(r_trial @ r_trial) > float(r @ r) * (1.0 + 1e-9):
            break
        theta, r, free = trial, r_trial, free & ~outside
        step, left = _step(r, derivatives(theta)[:, free])
        if left < best[2] or outside.any():
            best = theta, free.copy(), left
    return best


def cofactor_of(jacobian: Array, free: Mask | None = None) -> tuple[Array, Mask]:
    """Inverse of ``J^T J`` over the free parameters, and which of them are determined.

    Parameters
    ----------
    jacobian : ndarray
        J, shape (n, p).
    free : ndarray of bool, optional
        Parameters that are free, shape (p,); all by default.

    Returns
    -------
    cofactor : ndarray, shape (p, p)
        Zero for parameters that are not free; infinite variances and nan covariances for those
        that the data do not determine.
    determined : ndarray of bool, shape (p,)
    """
    p = jacobian.shape[1]
    free = np.ones(p, dtype=bool) if free is None else free
    cofactor, determined = np.zeros((p, p)), free.copy()
    at = np.flatnonzero(free)
    if at.size == 0:
        return cofactor, determined
    scaled, length = _scaled(jacobian[:, at])
    _, sizes, V = np.linalg.svd(scaled, full_matrices=False)
    seen = sizes > SINGULAR * sizes[0] if sizes[0] > 0.0 else np.zeros(sizes.size, dtype=bool)
    blind = np.sqrt(np.sum(V[~seen] ** 2, axis=0)) > SEEN
    part = (V[seen].T / sizes[seen] ** 2) @ V[seen] / np.outer(length, length)
    part[blind, :] = part[:, blind] = np.nan
    part[blind, blind] = np.inf
    cofactor[np.ix_(at, at)] = part
    determined[at[blind]] = False
    return cofactor, determined

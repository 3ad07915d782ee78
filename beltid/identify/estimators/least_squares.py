"""Least squares: numpy solves the linear problems, scipy the nonlinear ones.

Columns such as delta and delta² differ by many orders of magnitude. They are scaled to unit length
before solving or inverting. The normal equations are never formed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import ConvergenceError, FitError, InputError

Array = NDArray[np.float64]

TOLERANCE = 1.0e-15
MAX_EVALUATIONS = 2000


@dataclass(frozen=True, slots=True, eq=False)
class LeastSquares:
    """Result of a least-squares fit.

    Attributes
    ----------
    parameters, residuals : ndarray
        Parameters at the minimum, shape (p,), and observed minus fitted values there, shape (n,).
    covariance : ndarray
        Covariance of the parameters for independent residuals, shape (p, p); nan unless
        there are more observations than parameters.
    """

    parameters: Array
    residuals: Array
    covariance: Array

    @classmethod
    def at(cls, parameters: Array, residuals: Array, jacobian: Array) -> LeastSquares:
        """Build the result; the covariance follows from the residuals and their Jacobian."""
        inverse = pseudo_inverse(jacobian)
        dof = residuals.size - parameters.size
        variance = float(residuals @ residuals) / dof if dof > 0 else float("nan")
        return cls(parameters, residuals, inverse @ inverse.T * variance)


def solve_linear(design: ArrayLike, observed: ArrayLike) -> LeastSquares:
    """Solve ``min |A x - b|`` on scaled columns, A of shape (n, p) with n >= p, b of (n,).

    Raises :class:`InputError` if the shapes do not fit or a value is not finite,
    :class:`FitError` if the columns are linearly dependent to working precision.
    """
    A, b = np.asarray(design, dtype=float), np.asarray(observed, dtype=float)
    if A.ndim != 2 or b.shape != A.shape[:1] or A.shape[0] < A.shape[1] or A.shape[1] == 0:
        raise InputError(
            f"least squares: design {A.shape} and observations {b.shape}, "
            "must be (n, p) and (n,) with n >= p >= 1"
        )
    if not (np.all(np.isfinite(A)) and np.all(np.isfinite(b))):
        raise InputError("least squares: values that are not finite, must be finite")
    scaled, length = unit_columns(A)
    x, _, rank, _ = np.linalg.lstsq(scaled, b, rcond=None)
    if rank < A.shape[1]:
        raise FitError(
            f"least squares: {A.shape[1]} coefficients, but the columns are linearly dependent; "
            "the observations do not determine them"
        )
    # one refinement step keeps the digits of the residuals in ill-conditioned problems
    x = x + np.linalg.lstsq(scaled, b - scaled @ x, rcond=None)[0]
    return LeastSquares.at(x / length, b - scaled @ x, A)


def solve_nonlinear(
    residuals: Callable[[Array], Array],
    jacobian: Callable[[Array], Array],
    start: ArrayLike,
    bounds: tuple[ArrayLike, ArrayLike] = (-np.inf, np.inf),
) -> LeastSquares:
    """Minimise the sum of squares of ``residuals(theta)``, observed minus fitted.

    `residuals` returns (n,) values, `jacobian` their derivatives with respect to the p parameters,
    (n, p). `start` is the initial guess; `bounds` are the lower and upper limits of the parameters.
    Raises :class:`ConvergenceError` if the search reaches no minimum.
    """
    from scipy.optimize import least_squares  # slow to import

    try:
        solution = least_squares(
            residuals,
            np.asarray(start, dtype=float),
            jacobian,
            bounds=bounds,
            method="trf",
            x_scale="jac",
            ftol=TOLERANCE,
            xtol=TOLERANCE,
            gtol=TOLERANCE,
            max_nfev=MAX_EVALUATIONS,
        )
    except (ValueError, np.linalg.LinAlgError) as error:
        raise ConvergenceError(f"least squares: the search broke down ({error})") from None
    if solution.status <= 0:
        raise ConvergenceError(
            f"least squares: no minimum after {solution.nfev} evaluations ({solution.message})",
            iterations=int(solution.nfev),
            residual=float(solution.optimality),
        )
    return LeastSquares.at(solution.x, solution.fun, jacobian(solution.x))


def unit_columns(design: Array) -> tuple[Array, Array]:
    """Scale the columns to unit length; return them and their lengths (1 for a zero column)."""
    largest = np.max(np.abs(design), axis=0)
    largest = np.where(largest > 0.0, largest, 1.0)
    # scale first: the squares in the norm must neither overflow nor underflow
    length = largest * np.linalg.norm(design / largest, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    return design / length, length


def pseudo_inverse(design: Array) -> Array:
    """Return the derivatives of the parameters with respect to the observations, shape (p, n)."""
    scaled, length = unit_columns(design)
    return np.asarray(np.linalg.pinv(scaled, rcond=1e-14) / length[:, None])

"""Linear least squares by QR with scaled columns.

Columns such as delta and delta² differ by many orders of magnitude. Each is scaled to unit length
before a Householder QR, so that no digits are lost to the units and the normal equations, which
square the condition number, are never formed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import FitError, InputError

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class LeastSquares:
    """What the minimum of a sum of squares says about its scatter.

    Attributes
    ----------
    cofactor : ndarray
        Inverse of ``J^T J`` of the residuals' Jacobian, shape (p, p); times a residual variance it
        is the covariance of the parameters.
    residuals : ndarray
        Residuals at the minimum, shape (n,).
    """

    cofactor: Array
    residuals: Array

    @property
    def n_free(self) -> int:
        """Number of parameters that were free at the minimum."""
        return self.cofactor.shape[0]

    @property
    def sum_of_squares(self) -> float:
        """Residual sum of squares."""
        return float(self.residuals @ self.residuals)

    @property
    def degrees_of_freedom(self) -> int:
        """Number of observations less that of the free parameters."""
        return self.residuals.size - self.n_free

    @property
    def residual_variance(self) -> float:
        """``sum_of_squares / degrees_of_freedom``; nan without any."""
        dof = self.degrees_of_freedom
        return self.sum_of_squares / dof if dof > 0 else float("nan")

    @property
    def covariance(self) -> Array:
        """Covariance of the parameters for independent residuals, shape (p, p)."""
        return self.cofactor * self.residual_variance

    @property
    def se(self) -> Array:
        """Standard errors of the parameters for independent residuals, shape (p,)."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, slots=True, eq=False)
class LinearFit(LeastSquares):
    """Result of a linear least-squares problem ``min |A x - b|``; J is A.

    Attributes
    ----------
    coefficients : ndarray
        x, shape (p,).
    """

    coefficients: Array


def solve_least_squares(design: ArrayLike, observed: ArrayLike) -> LinearFit:
    """Solve ``min |A x - b|`` by Householder QR of the column-scaled A.

    Parameters
    ----------
    design : array_like
        A, shape (n, p) with n >= p.
    observed : array_like
        b, shape (n,).

    Returns
    -------
    LinearFit
        Coefficients, cofactor matrix and residuals; one step of iterative refinement is made.

    Raises
    ------
    InputError
        If the shapes do not fit or a value is not finite.
    FitError
        If the columns are linearly dependent to working precision.
    """
    A = np.asarray(design, dtype=float)
    b = np.asarray(observed, dtype=float)
    if A.ndim != 2 or b.shape != A.shape[:1] or A.shape[0] < A.shape[1] or A.shape[1] == 0:
        raise InputError(
            f"least squares: design {A.shape} and observations {b.shape}, "
            "must be (n, p) and (n,) with n >= p >= 1"
        )
    if not (np.all(np.isfinite(A)) and np.all(np.isfinite(b))):
        raise InputError("least squares: values that are not finite, must be finite")
    scale = np.max(np.abs(A), axis=0)
    usable = scale > 0.0
    # two steps, so that the squares in the norm neither overflow nor vanish
    scale = np.where(usable, scale, 1.0)
    scale = scale * np.linalg.norm(A / scale, axis=0)
    scale = np.where(usable, scale, 1.0)
    Q, R = np.linalg.qr(A / scale)
    pivots = np.abs(np.diag(R))
    limit = max(A.shape) * np.finfo(float).eps * pivots.max()
    if not usable.all() or pivots.min() <= limit:
        raise FitError(
            f"least squares: {A.shape[1]} coefficients, but the columns are linearly dependent; "
            "the observations do not determine them"
        )
    x = _back_substitute(R, Q.T @ b) / scale
    x = x + _back_substitute(R, Q.T @ (b - A @ x)) / scale
    R_inverse = _back_substitute(R, np.eye(R.shape[0])) / scale[:, None]
    return LinearFit(R_inverse @ R_inverse.T, b - A @ x, x)


def _back_substitute(R: Array, right: Array) -> Array:
    """Solve ``R x = right`` for upper triangular R; the libraries' threads cost more than this."""
    x = np.array(right, dtype=float)
    for i in range(R.shape[0] - 1, -1, -1):
        x[i] = (x[i] - R[i, i + 1 :] @ x[i + 1 :]) / R[i, i]
    return x

"""Normal contact laws fitted to press curves with a free contact point for every test.

Each law is written about a reference force F that is reached at the position p of a test,

    polynomials:  f = F + A y + B y² + C y³,      power law:  f = F (1 + y/L)^n,      y = x - p,

so that the unknowns stay regular for every law, the shape is shared by the tests and p is free
for each. The contact point and the coefficients over the penetration follow from it. So no law has
more freedom in where contact begins than another.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from beltid.errors import FitError
from beltid.identify.estimators.nonlinear_fit import NonlinearFit
from beltid.identify.press.curves import PressCurve
from beltid.identify.press.shared_law import test_of_curve

Array = NDArray[np.float64]
LawName = Literal["linear", "quadratic", "power", "cubic"]
LAW_NAMES: tuple[LawName, ...] = ("linear", "quadratic", "power", "cubic")

SMALLEST = 1.0e-9
NAMES = ("k_linear", "k_quadratic", "k_cubic")
UNITS = ("N/m²", "N/m³", "N/m⁴")


@dataclass(frozen=True, slots=True, eq=False)
class CurveData:
    """Nodes of several curves, scaled: positions by the travel fitted, forces by F.

    Attributes
    ----------
    x, f : ndarray
        Positions and forces of the nodes [-], shape (n,).
    owner : ndarray of int
        Number of the test of each node, counted by first appearance, shape (n,).
    parts : ndarray of int
        Number of the curve of each node, shape (n,).
    span_m, F_N_m : float
        Units of position and force.
    """

    x: Array
    f: Array
    owner: NDArray[np.intp]
    parts: NDArray[np.intp]
    span_m: float
    F_N_m: float

    @classmethod
    def of(cls, curves: Sequence[PressCurve]) -> CurveData:
        """Nodes of curves."""
        sizes = [c.position_m.size for c in curves]
        span = max(float(np.ptp(c.position_m)) for c in curves)
        F = 0.5 * min(float(np.max(c.middle_N_m)) for c in curves)
        return cls(
            x=np.concatenate([c.position_m for c in curves]) / span,
            f=np.concatenate([c.middle_N_m for c in curves]) / F,
            owner=np.repeat(test_of_curve(curves), sizes),
            parts=np.repeat(np.arange(len(curves)), sizes),
            span_m=span,
            F_N_m=F,
        )

    def only(self, kept: NDArray[np.bool_]) -> CurveData:
        """Some of the nodes; tests are numbered anew."""
        _, owner = np.unique(self.owner[kept], return_inverse=True)
        return CurveData(
            self.x[kept], self.f[kept], owner, self.parts[kept], self.span_m, self.F_N_m
        )

    def reference_positions(self) -> Array:
        """Where each test reaches F, from its nodes, shape (tests,)."""
        found = []
        for j in range(int(self.owner.max()) + 1):
            mine = self.owner == j
            order = np.argsort(self.x[mine], kind="stable")
            rising = np.maximum.accumulate(self.f[mine][order])
            found.append(float(np.interp(1.0, rising, self.x[mine][order])))
        return np.array(found)


@dataclass(frozen=True, slots=True, eq=False)
class FittedLaw:
    """A law through curves, in the scaled unknowns about F.

    Attributes
    ----------
    name : str
        The law.
    shape : ndarray
        A, B, C of a polynomial, or L, n, shape (q,).
    positions : ndarray
        p of every test, shape (tests,).
    fit : NonlinearFit
        All unknowns, those of the shape first.
    shape_by_unknowns : ndarray
        Derivatives of the shape by its unknowns, shape (q, k); k < q where a coefficient of the
        quadratic law is held at zero.
    """

    name: LawName
    shape: Array
    positions: Array
    fit: NonlinearFit
    shape_by_unknowns: Array

    @property
    def is_held(self) -> bool:
        """Whether a coefficient is held at zero, as it would be negative."""
        return self.shape_by_unknowns.shape[1] < self.shape.size

    @property
    def shape_cofactor(self) -> Array:
        """Covariance of the shape for independent nodes, shape (q, q)."""
        k = self.shape_by_unknowns.shape[1]
        return self.shape_by_unknowns @ self.fit.covariance[:k, :k] @ self.shape_by_unknowns.T

    def values(self, data: CurveData, positions: Array | None = None) -> Array:
        """Forces of the law at the nodes [units of F], shape (n,)."""
        p = self.positions if positions is None else positions
        return shape_values(self.name, self.shape, data.x - p[data.owner])


def n_shape(name: LawName) -> int:
    """Number of coefficients of a law, contact points not counted."""
    return {"linear": 1, "quadratic": 2, "power": 2, "cubic": 3}[name]


def shape_values(name: LawName, shape: Array, y: Array) -> Array:
    """Force over F at the distance y from where F is reached."""
    if name == "power":
        L, n = shape
        return np.maximum(1.0 + y / L, SMALLEST) ** n
    if name == "quadratic" and _is_pure(shape):  # no force before the contact point
        y = np.maximum(y, -2.0 / shape[0])
    return 1.0 + y * np.polynomial.polynomial.polyval(y, shape)


def _is_pure(shape: Array) -> bool:
    """Whether a quadratic law has no linear part: a double zero."""
    A, B = shape
    return bool(abs(A * A - 4.0 * B) <= 1e-12 * A * A)


def slope_values(name: LawName, shape: Array, y: Array) -> Array:
    """Derivative of :func:`shape_values` by y."""
    if name == "power":
        L, n = shape
        base = 1.0 + y / L
        return np.where(base > SMALLEST, n / L * np.maximum(base, SMALLEST) ** (n - 1.0), 0.0)
    if name == "quadratic" and _is_pure(shape):
        y = np.maximum(y, -2.0 / shape[0])
    powers = np.arange(1, shape.size + 1)
    return np.asarray(np.polynomial.polynomial.polyval(y, powers * shape), dtype=float)


def shape_gradient(name: LawName, shape: Array, y: Array) -> Array:
    """Derivatives of :func:`shape_values` by the shape, shape (n, q)."""
    if name == "power":
        base = np.maximum(1.0 + y / shape[0], SMALLEST)
        return np.column_stack(
            [-slope_values(name, shape, y) * y / shape[0], base ** shape[1] * np.log(base)]
        )
    return np.column_stack([y**k for k in range(1, shape.size + 1)])


@dataclass(frozen=True, slots=True, eq=False)
class Coefficients:
    """A law over the penetration, SI.

    Attributes
    ----------
    names, units : tuple of str
        Of the coefficients.
    values : ndarray
        Shape (q,).
    gradient : ndarray
        Derivatives of the values by the scaled shape, shape (q, q).
    distance_m : float
        From the contact point to where F is reached [m].
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    gradient: Array
    distance_m: float


def coefficients_of(law: FittedLaw, data: CurveData) -> Coefficients:
    """Coefficients over the penetration from the contact point.

    Raises
    ------
    FitError
        If the law has no contact point: its force never comes down to zero.
    """
    F, span = data.F_N_m, data.span_m
    if law.name == "power":
        L, n = law.shape
        k = F / (L * span) ** n
        gradient = np.array([[-n * k / L, -k * np.log(L * span)], [0.0, 1.0]])
        return Coefficients(
            ("k", "n"), ("N/m^(1+n)", "-"), np.array([k, n]), gradient, float(L * span)
        )
    q = law.shape.size
    if law.name == "quadratic" and _is_pure(law.shape):
        A, B = law.shape
        values, gradient = np.array([0.0, F / span**2 * B]), np.diag([0.0, F / span**2])
        return Coefficients(NAMES[:q], UNITS[:q], values, gradient, 2.0 / A * span)
    polynomial = np.concatenate([[1.0], law.shape])
    roots = np.polynomial.polynomial.polyroots(polynomial)
    real = roots[np.abs(roots.imag) < 1e-9 * np.abs(roots)].real
    if not np.any(real < 0.0):
        raise FitError(f"{law.name} law: its force never comes down to zero: no contact point")
    zero = float(np.max(real[real < 0.0]))
    orders = range(1, q + 1)
    # Taylor coefficients about the root, and how they move with the shape (the root moves, too)
    values = np.array([_taylor(polynomial, zero, k) for k in orders])
    direct = np.array([[_taylor(_unit(q, j), zero, k) for j in orders] for k in orders])
    zero_by = -np.array([zero**j for j in orders]) / values[0]
    along = np.array([(k + 1) * _taylor(polynomial, zero, k + 1) for k in orders])
    scale = F / span ** np.array(orders)
    return Coefficients(
        names=NAMES[:q],
        units=UNITS[:q],
        values=values * scale,
        gradient=(direct + np.outer(along, zero_by)) * scale[:, None],
        distance_m=-zero * span,
    )


def _unit(q: int, j: int) -> Array:
    return np.eye(q + 1)[j]


def _taylor(polynomial: Array, at: float, order: int) -> float:
    """Coefficient of ``(y - at)^order`` of a polynomial."""
    if order >= polynomial.size:
        return 0.0
    derivative = np.polynomial.polynomial.polyder(polynomial, order)
    factorial = float(np.prod(np.arange(1, order + 1)))
    return float(np.polynomial.polynomial.polyval(at, derivative)) / factorial

"""Fit of all normal laws, with a free contact point for each test.

    f = sum_k K_k b_k(x - p_j) + c_j,      b = y^n for y > 0, else 0,      K_k >= 0

Linear, quadratic and cubic law have the terms up to n = 1, 2, 3; the power law has one term with
free n. p_j is the position of the contact point of test j, shared by its cycles. If a test begins
in contact, its zero cannot be checked: the zero c_j of the load cell is then an unknown with a
prior N(0, (ZERO_SHARE F_top)²). The same prior applies to the common part of all such zeros,
because one operator set them at one preload. For all other tests c_j is zero.

For given p (and n) the problem is linear in K and c. They are solved for and projected out
(variable projection with Kaufman's Jacobian); the search covers only p and n.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from beltid.errors import FitError
from beltid.identify.estimators.least_squares import pseudo_inverse, solve_nonlinear, unit_columns
from beltid.identify.estimators.statistics import integrated_autocorrelation_time
from beltid.identify.press.curves import PressCurve

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
LawName = Literal["linear", "quadratic", "power", "cubic"]
LAW_NAMES: tuple[LawName, ...] = get_args(LawName)
TERMS = {"linear": 1, "quadratic": 2, "power": 1, "cubic": 3}

ZERO_SHARE = 0.05
"""Prior standard deviation of a zero that could not be checked, over the largest force."""
EXPONENTS = (0.8, 1.0, 1.25, 1.5, 2.0, 3.0)  # start values of a free exponent
DISTANCES = np.geomspace(0.1, 5.0, 8)
"""Start values of the distance from contact to half the largest force, over the fitted travel."""
ROUNDING = 1.0e-10
"""Residuals below this share of the force count as rounding."""
SMALLEST = 1.0e-9


@dataclass(frozen=True, slots=True, eq=False)
class Nodes:
    """Nodes of several curves; positions scaled by the fitted travel, forces by half the top."""

    x: Array  # positions and forces of the nodes [-], shape (n,)
    f: Array
    owner: NDArray[np.intp]  # test and curve of each node, counted by first appearance, (n,)
    part: NDArray[np.intp]
    unchecked: NDArray[np.intp]  # tests whose zero could not be checked
    zero_weight: float  # node noise over the prior standard deviation of a zero [-]
    span_m: float  # units of position and force
    F_N_m: float

    @classmethod
    def of(cls, curves: Sequence[PressCurve], noise_N_m: float = 0.0) -> Nodes:
        """Collect the nodes of curves; `noise_N_m` sets the weight of the zeros' prior."""
        numbers = {label: i for i, label in enumerate(dict.fromkeys(c.test for c in curves))}
        tests = np.array([numbers[c.test] for c in curves], dtype=np.intp)
        sizes = [c.position_m.size for c in curves]
        unchecked = np.unique([numbers[c.test] for c in curves if not c.recorded.free_travel])
        F = 0.5 * min(float(np.max(c.middle_N_m)) for c in curves)
        span = max(float(np.ptp(c.position_m)) for c in curves)
        return cls(
            x=np.concatenate([c.position_m for c in curves]) / span,
            f=np.concatenate([c.middle_N_m for c in curves]) / F,
            owner=np.repeat(tests, sizes),
            part=np.repeat(np.arange(len(curves)), sizes),
            unchecked=unchecked.astype(np.intp),
            zero_weight=max(noise_N_m / F, 1e-6) / (2.0 * ZERO_SHARE),
            span_m=span,
            F_N_m=F,
        )

    @property
    def n_tests(self) -> int:
        """Number of tests."""
        return int(self.owner.max()) + 1

    @property
    def is_own(self) -> Mask:
        """Whether a node belongs to a test, shape (n, tests)."""
        return self.owner[:, None] == np.arange(self.n_tests)

    def only(self, kept: Mask) -> Nodes:
        """Select some of the nodes and renumber the tests."""
        tests, owner = np.unique(self.owner[kept], return_inverse=True)
        return replace(
            self,
            x=self.x[kept],
            f=self.f[kept],
            owner=owner.astype(np.intp),
            part=self.part[kept],
            unchecked=np.flatnonzero(np.isin(tests, self.unchecked)),
        )

    def reference_positions(self) -> Array:
        """Return the position where each test reaches the scaled force 1, shape (tests,)."""
        positions = np.empty(self.n_tests)
        for j in range(positions.size):
            nodes = np.flatnonzero(self.owner == j)
            nodes = nodes[np.argsort(self.x[nodes], kind="stable")]
            positions[j] = np.interp(1.0, np.maximum.accumulate(self.f[nodes]), self.x[nodes])
        return positions


class FittedLaw:
    """Law in scaled units: coefficients from linear least squares at given contact points.

    Parameters
    ----------
    name : str
        Name of the law.
    data : Nodes
        The n nodes to fit.
    theta : ndarray
        Position of the contact point of each test, and the exponent of the power law.

    Attributes
    ----------
    K, exponents : ndarray
        Coefficients of the terms, and their powers, shape (terms,).
    contact : ndarray
        Position of the contact point of each test, shape (tests,).
    y : ndarray
        Penetration of each node, negative before contact, shape (n,).
    residuals : ndarray
        Nodes minus law, shape (n,).
    misfit : ndarray
        The residuals, and zeros relative to their prior, shape (n + unchecked,).
    """

    def __init__(self, name: LawName, data: Nodes, theta: Array) -> None:
        self.name, self.data, self.theta = name, data, theta
        self.contact = theta[: data.n_tests]
        self.exponents = np.arange(1.0, TERMS[name] + 1.0)
        if name == "power":
            self.exponents = theta[data.n_tests :]
        self.y = data.x - self.contact[data.owner]
        zeros = (data.owner[:, None] == data.unchecked).astype(float)
        n_zeros, q = data.unchecked.size, self.exponents.size
        # prior rows; the sum of their squares is c' (I + 1 1')^-1 c
        prior = data.zero_weight * np.linalg.inv(np.linalg.cholesky(np.eye(n_zeros) + 1.0))
        terms = np.pad(basis(self.y, self.exponents), ((0, n_zeros), (0, 0)))
        self._design = np.column_stack([terms, np.vstack([zeros, prior])])
        observed = np.pad(data.f, (0, n_zeros))
        free = np.ones(self._design.shape[1], dtype=bool)
        scaled, length = unit_columns(self._design)
        solution = np.zeros(free.size)
        for _ in range(q + 1):  # active set of the bounds K >= 0
            solution[:] = 0.0
            at_free = np.linalg.lstsq(scaled[:, free], observed, rcond=1e-13)[0]
            solution[free] = at_free / length[free]
            worst = int(np.argmin(solution[:q]))
            if solution[worst] >= 0.0:
                break
            free[worst] = False
        self._free, self._scaled = free, scaled[:, free]
        self.K = solution[:q]
        self.misfit = observed - self._design @ solution
        self.residuals = self.misfit[: data.x.size]

    def force(self, y: Array) -> Array:
        """Calculate the scaled force at a scaled penetration."""
        return basis(y, self.exponents) @ self.K

    @property
    def active_bound(self) -> Mask:
        """Mask of coefficients held at zero that would be negative."""
        return self.K <= 0.0

    @property
    def n_unknowns(self) -> int:
        """Number of coefficients, contact points and free exponents."""
        return self.K.size + self.theta.size

    @property
    def sum_of_squares(self) -> float:
        """Sum of squares of the residuals, and of zeros relative to their prior."""
        return float(self.misfit @ self.misfit)

    @cached_property
    def tau(self) -> float:
        """Integrated autocorrelation time of the residuals [nodes]."""
        return correlation_time(self.residuals, self.data)

    @cached_property
    def tangent(self) -> Array:
        """Derivatives of the nodes with respect to the free unknowns, (n + unchecked, m)."""
        return np.column_stack([self._design[:, self._free], self._nonlinear_columns()])

    @property
    def values(self) -> Array:
        """Coefficients [N/m^(1+n)], and for the power law the exponent, shape (p,)."""
        k = self.K * self.units
        return np.append(k, self.exponents) if self.name == "power" else k

    @cached_property
    def sensitivity(self) -> Array:
        """Derivatives of the values with respect to scaled observations, (p, n + unchecked).

        The observations are the forces of the nodes and the prior of the zeros. A coefficient held
        at 0 is treated as free.
        """
        if self.name == "quadratic" and self.K[0] < self.K[1]:
            return self._by_vertex() * self.units[:, None]
        inverse = pseudo_inverse(np.column_stack([self._design, self._nonlinear_columns()]))
        by_K = inverse[: self.K.size] * self.units[:, None]
        if self.name != "power":
            return by_K
        # k = K F / span^n: the unit of k contains the exponent
        by_n = inverse[-1:]
        return np.vstack([by_K - self.values[:1] * math.log(self.data.span_m) * by_n, by_n])

    def change_by(self, force: Array) -> Array:
        """Return the change of the values by a change of the scaled force at every node."""
        return np.asarray(self.sensitivity[:, : force.size] @ force)

    @property
    def contact_m(self) -> Array:
        """Position of the contact point of each curve [m]."""
        first_nodes = np.unique(self.data.part, return_index=True)[1]
        return self.contact[self.data.owner[first_nodes]] * self.data.span_m

    @property
    def units(self) -> Array:
        """SI units of the coefficients [N/m^(1+n)]."""
        return np.asarray(self.data.F_N_m / self.data.span_m**self.exponents)

    def jacobian(self) -> Array:
        """Differentiate the misfit by theta, linear part projected out (Kaufman)."""
        columns = self._nonlinear_columns()
        part = np.linalg.lstsq(self._scaled, columns, rcond=1e-13)[0]
        return -(columns - self._scaled @ part)

    def _nonlinear_columns(self) -> Array:
        """Differentiate the law with respect to theta, (n + unchecked, .)."""
        slope = -_slopes(self.y, self.exponents) @ self.K
        columns = np.where(self.data.is_own, slope[:, None], 0.0)
        if self.name == "power":
            by_n = self.force(self.y) * np.log(np.maximum(self.y, SMALLEST))
            columns = np.column_stack([columns, by_n])
        return np.pad(columns, ((0, self.misfit.size - self.y.size), (0, 0)))

    def _by_vertex(self) -> Array:
        """Differentiate (k1, k2) with respect to the nodes if k1 is small, with q = k1² >= 0.

        About the vertices v_j = p_j - k1/(2 k2) the law is k2 (x - v_j)² - q/(4 k2), whose
        derivatives stay regular at k1 = 0. There dk1 = dq/(2 k1) is unbounded; replacing 2 k1 by
        sqrt(4 q + se(q)) makes the standard error of k1 that of the root of q.
        """
        k1, k2 = self.K
        n, zeros = self.y.size, self._design[:, 2:]
        y = self.y + 0.5 * k1 / k2
        columns = np.zeros((self.misfit.size, 2 + self.contact.size))
        columns[:n, 0] = -0.25 / k2
        columns[:n, 1] = y**2 + 0.25 * (k1 / k2) ** 2
        columns[:n, 2:] = self.data.is_own * (-2.0 * k2 * y)[:, None]
        rows = pseudo_inverse(np.column_stack([columns, zeros]))[:2]
        dof = max(self.misfit.size - self.theta.size, 1)
        se = float(np.linalg.norm(rows[0]) * np.linalg.norm(self.misfit)) / dof**0.5
        rows[0] /= np.sqrt(4.0 * k1**2 + se)
        return rows


def basis(y: Array, exponents: Array) -> Array:
    """Return the terms ``y^n`` of a law, zero before contact, shape (n, terms)."""
    return np.asarray(np.maximum(y, 0.0)[:, None] ** exponents)


def _slopes(y: Array, exponents: Array) -> Array:
    """Return the derivatives of the terms with respect to y."""
    inside = np.maximum(y, SMALLEST)[:, None]
    return np.where(y[:, None] > 0.0, exponents * inside ** (exponents - 1.0), 0.0)


def fit_law(name: LawName, data: Nodes) -> FittedLaw:
    """Fit one law to the nodes, with a free contact point for each test.

    Raises :class:`FitError` if the nodes are not more than the unknowns or the force does not rise,
    and :class:`ConvergenceError` if the search does not reach a minimum.
    """
    q, J = TERMS[name] + (name == "power"), data.n_tests
    if data.x.size <= q + J:
        raise FitError(f"{name} law: {data.x.size} nodes, must be more than {q + J}")
    starts = [data.reference_positions() - d for d in DISTANCES]
    low, high = np.full(J, -np.inf), np.full(J, np.inf)
    if name == "power":
        starts = [np.append(s, n) for s in starts for n in EXPONENTS]
        low, high = np.append(low, 0.2), np.append(high, 12.0)
    law = min((FittedLaw(name, data, s) for s in starts), key=lambda law: law.sum_of_squares)

    def at(theta: Array) -> FittedLaw:
        """Return the law at theta; reuse the last one for its Jacobian."""
        nonlocal law
        if not np.array_equal(theta, law.theta):
            law = FittedLaw(name, data, theta.copy())
        return law

    minimum = solve_nonlinear(
        lambda theta: at(theta).misfit, lambda theta: at(theta).jacobian(), law.theta, (low, high)
    )
    law = at(minimum.parameters)
    if not np.any(law.K > 0.0):
        raise FitError(f"{name} law: the force falls with penetration, must rise")
    return law


@lru_cache(maxsize=64)  # the same tests and groups are fitted repeatedly
def fit_quadratic(curves: tuple[PressCurve, ...], noise: float = 0.0) -> FittedLaw:
    """Fit the quadratic law to curves; `noise` [N²/m²] sets the weight of the zeros' prior."""
    return fit_law("quadratic", Nodes.of(curves, math.sqrt(noise)))


def correlation_time(residuals: Array, data: Nodes) -> float:
    """Return the mean autocorrelation time of residuals along the curves [nodes]."""
    if float(np.max(np.abs(residuals))) <= ROUNDING * float(np.max(data.f)):
        return 1.0
    parts = [residuals[data.part == k] for k in np.unique(data.part)]
    return sum(r.size * integrated_autocorrelation_time(r) for r in parts) / residuals.size


def predicted(law: FittedLaw, data: Nodes) -> Array:
    """Predict the forces at the nodes of new tests, with free contact points, shape (n,).

    The search starts at the mean distance from the contact point in the fitted tests.
    """
    starts = data.reference_positions() - np.mean(law.data.reference_positions() - law.contact)

    def residuals(p: Array) -> Array:
        return data.f - law.force(data.x - p[data.owner])

    def jacobian(p: Array) -> Array:
        slope = _slopes(data.x - p[data.owner], law.exponents) @ law.K
        return np.where(data.is_own, slope[:, None], 0.0)

    return data.f - solve_nonlinear(residuals, jacobian, starts).residuals

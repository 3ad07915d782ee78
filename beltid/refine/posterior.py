"""The runs of a campaign as a mixed model: surface, effects and noise, their sizes, the estimate.

The values p = B h of ln mu at common knots in ln f_N, a natural cubic spline for each speed, have
free levels and a free slope, a curve that all speeds share and differences in slope between speeds
(theory page, "The inverse problem"). About simulated runs, y the measured less the simulated ln mu,

    y = X h + sum_e Z_e u_e + noise,    noise ~ N(0, s² e² + s_r² r²),

with the effects Z_e of arcs, run order and temperature as factors on the whole surface, the
standard error e of a run, its sensitivity r to a factor on the surface, and the scatter s_r of the
friction. Errors that the runs share are no part of it, or they would take up errors of the model.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.polynomial import Legendre
from scipy.interpolate import CubicSpline
from scipy.special import ndtr

from beltid.laws.friction_surface import FrictionSurface
from beltid.mixed import Array, Mixed, Own, Posterior, Shared, Size
from beltid.uncertainty.measured import Measured
from beltid.uncertainty.sources import ARC, COURSE, ORDER, TEMPERATURE, factor_of

Sizes = Mapping[str, float]

FINE_NODES = 48  # nodes of a tabulated curve, over the range of the knots
SPEED_BEND = 0.1  # standard deviation of the change of d ln mu / d ln v over one unit of ln v
BENDS = (2, 3, 4)  # degrees of the polynomials of the curvature over the run order
STEP_OF_TEMPERATURE = 10.0  # K
NOISE, SCATTER, SHARED_ERRORS = "noise", "scatter", "shared errors"
LEVEL, CURVE, DIFFERENCE = "level", "curve", "difference"
PRIORS = {
    NOISE: Size(1.0, 0.5, largest=20.0),  # the standard errors are right within a half
    SCATTER: Size(3.0e-3, 1.5, largest=0.3),
    CURVE: Size(0.045, 0.75, largest=3.0),  # curvatures of ln mu over ln f_N of about 0.1
    DIFFERENCE: Size(0.03, 1.0, largest=3.0),  # slopes differ by some hundredths
    SHARED_ERRORS: Size(1.0),
    ARC: Size(3.0e-3, 1.5, largest=0.3),
    ORDER: Size(1.0e-2, 1.5, largest=0.3),
    COURSE: Size(3.0e-3, 1.5, largest=0.3),
    TEMPERATURE: Size(1.0e-2, 1.0, largest=0.3),
}
"""Priors of standard deviations, of ln mu for the scatter and the effects."""
IF_CORRECTED = {key: Size(1.0e-3, 1.5, largest=0.3) for key in (ORDER, COURSE)}
LEAST_NOISE = 0.5  # few runs may fit by chance
LARGE, SMALL = 3.0e-2, 1.0e-3  # sizes of one effect at the start of a search, and of the others
GRID = np.geomspace(1.0e-5, 0.3, 60)  # sizes of an effect that are considered
ONE_SIGMA = 0.6827


@dataclass(frozen=True)
class Curves:
    """Splines of ln mu over ln f_N at common knots."""

    log_force: Array  # knots, f_N in [N/m], (k,)
    log_speed: Array  # of the speeds [m/s], increasing, (m,)

    @cached_property
    def _cardinal(self) -> CubicSpline:
        """Basis functions, computed once, as every simulated run needs them."""
        return CubicSpline(self.log_force, np.eye(self.log_force.size), bc_type="natural")

    def basis(self, log_force: Array) -> Array:
        """Evaluate ln mu per unit of each knot value, shape (n, k); constant beyond the knots."""
        inside = np.clip(log_force, self.log_force[0], self.log_force[-1])
        return np.asarray(self._cardinal(inside), dtype=float)

    @cached_property
    def parts(self) -> dict[str, Array]:
        """Columns of B by the name of their part."""
        k, m = self.log_force.size, self.log_speed.size
        x, D = (self.log_force - self.log_force.mean())[:, None], np.diff(np.eye(m), axis=0)
        between = _free(D.T @ (D / np.diff(self.log_speed)[:, None]))
        parts = {
            LEVEL: np.hstack([np.kron(np.eye(m), np.ones((k, 1))), np.tile(x, (m, 1))]),
            CURVE: np.tile(_free(self._integral(2)), (m, 1)),
            DIFFERENCE: np.kron(between, _free(self._integral(1))),
        }
        return {name: columns for name, columns in parts.items() if columns.shape[1]}

    @cached_property
    def B(self) -> Array:
        """Values at the knots per unit of each coordinate, square."""
        return np.hstack(list(self.parts.values()))

    def surfaces(self, values: Array) -> list[FrictionSurface]:
        """Tabulate the curve of each speed finely, as mu is a spline only in the logarithm."""
        forces = np.exp(np.linspace(self.log_force[0], self.log_force[-1], FINE_NODES))
        mu = np.exp(self.at_nodes(forces, values[:, None]))
        return [
            FrictionSurface(forces, [v], mu[:, j]) for j, v in enumerate(np.exp(self.log_speed))
        ]

    def at_nodes(self, forces: Array, vectors: Array) -> Array:
        """Convert vectors at the knots (size, K) to values at forces and speeds, (nf, m, K)."""
        of_speed = vectors.reshape(self.log_speed.size, self.log_force.size, -1)
        return np.asarray(np.einsum("fk,vks->fvs", self.basis(np.log(forces)), of_speed))

    def _integral(self, order: int) -> Array:
        """Integrate products of the derivatives of the basis functions over ln f, (k, k)."""
        x, w = np.polynomial.legendre.leggauss(3)
        half = 0.5 * np.diff(self.log_force)[:, None]
        points = self.log_force[:-1, None] + half * (1.0 + x)
        values = np.asarray(self._cardinal(points.ravel(), order), dtype=float)
        return np.asarray(values.T @ ((half * w).ravel()[:, None] * values))


def _free(precision: Array) -> Array:
    """Return columns with unit normal coefficients for a singular inverse covariance."""
    covariance = np.linalg.pinv(precision, rcond=1e-9, hermitian=True)
    return factor_of(np.asarray(covariance, dtype=float))


def campaign_effects(measured: Measured, reference_degC: float | None) -> dict[str, Array]:
    """Return the effects that the runs of a campaign can show, as factors on the surface.

    The change of ln mu of each run per unit of each number of an effect, (n, K), by the key of its
    source of uncertainty. An unknown temperature is the mean, as is the reference, if None.
    """
    n = measured.mu.size
    order = np.arange(n) if measured.order is None else measured.order
    T = np.full(n, np.nan) if measured.temperature_degC is None else measured.temperature_degC
    columns = {}
    if np.unique(measured.arc).size > 1:
        columns[ARC] = np.eye(int(measured.arc.max()) + 1)[measured.arc]
    if np.ptp(order) > 0.0:
        x = 2.0 * (order - order.min()) / np.ptp(order) - 1.0
        columns[ORDER] = 0.5 * x[:, None]
        columns[COURSE] = np.column_stack([Legendre.basis(k)(x) / k**2 for k in BENDS])
    if (known := np.isfinite(T)).any():
        mean = float(T[known].mean())
        above = np.where(known, T, mean) - (mean if reference_degC is None else reference_degC)
        columns[TEMPERATURE] = above[:, None] / STEP_OF_TEMPERATURE
    return {key: Z for key, Z in columns.items() if np.any(Z)}


@dataclass(frozen=True, slots=True)
class LinearRuns:
    """The runs, linearised about simulated ones."""

    y: Array  # measured less simulated ln mu plus X h of the simulated surface, (n,)
    parts: Mapping[str, Array]
    """Columns of X, derivatives with respect to the coordinates of each part of the surface."""
    errors: Array  # standard errors of ln mu, (n,)
    response: Array  # sensitivity to a factor on the surface, (n,)
    effects: Mapping[str, Array] = field(default_factory=dict)
    """Changes of ln mu of the runs per unit of the numbers of each effect, (n, K)."""
    priors: Mapping[str, Size] = field(default_factory=lambda: PRIORS)
    shared: Array | None = None  # changes by one u of each error that runs share, (n, K')

    @property
    def X(self) -> Array:
        """Derivatives with respect to the coordinates of the surface, (n, q)."""
        return np.hstack(list(self.parts.values()))

    def model(self) -> Mixed:
        """Build the mixed model; with the errors that runs share, if there are any."""
        columns, priors = {**self.parts, **self.effects}, self.priors
        if self.shared is not None:
            columns[SHARED_ERRORS] = self.shared
        # a run is a group by itself: its noise is independent of the others
        terms = [Shared(name, Z[:, None, :], priors.get(name)) for name, Z in columns.items()]
        noise = {NOISE: self.errors, SCATTER: self.response}
        own = [Own(name, priors[name], diagonal=sd[:, None]) for name, sd in noise.items()]
        return Mixed(self.y[:, None], terms, own)

    def choose(self, start: Sizes) -> Posterior:
        """Find sizes and posterior, from sizes chosen before or, without any, from several starts.

        The evidence may have several maxima, as for a run-in over a campaign sorted by arcs.
        """
        found = self._best(start)
        sizes = {**found.sizes, NOISE: max(found.sizes[NOISE], LEAST_NOISE)}
        sizes |= {key: _usual_size(found, key, self.priors[key]) for key in self.effects}
        return self.model().at(sizes, found.converged)

    def _best(self, start: Sizes) -> Posterior:
        """Fit from a start or, without one, from the medians and from each effect large in turn."""
        small = dict.fromkeys(self.effects, SMALL)
        others = [{**small, name: LARGE} for name in small] if not start and len(small) > 1 else []
        return max(map(self.model().fit, [start, *others]), key=lambda fit: fit.log_evidence)

    def log_evidence_for(self, effect: str) -> float:
        """Compute the log of the probability ratio of the data with and without an effect.

        All sizes are chosen again without it, as others may explain the same.
        """
        others = {key: Z for key, Z in self.effects.items() if key != effect}
        without = replace(self, effects=others)._best({})
        return self._best({}).log_evidence - without.log_evidence

    def variance(self, sizes: Sizes) -> Array:
        """Return the noise variance of each run (n,)."""
        return np.square(sizes[NOISE] * self.errors) + np.square(sizes[SCATTER] * self.response)

    def precision(self, sizes: Sizes) -> Array:
        """Return the prior precision of the coordinates (q,); zero where they are free."""
        of_part = {part: 1.0 / sizes[part] ** 2 for part in (CURVE, DIFFERENCE) if part in sizes}
        return np.hstack([np.full(Z.shape[1], of_part.get(k, 0.0)) for k, Z in self.parts.items()])

    def gain(self, posterior: Posterior) -> Array:
        """Return the derivatives of all coefficients with respect to the data (k, n)."""
        X = posterior.model.X[:, 0]
        return np.asarray(posterior.covariance @ X.T / self.variance(posterior.sizes))

    def misfit(self, residual: Array, coordinates: Array, sizes: Sizes) -> float:
        """Compute the penalised misfit ``r' V^-1 r + h' P h``, V by noise and effects.

        `residual` (n,) is measured minus simulated ln mu; it may come from a nonlinear model. The
        effects take from it what they best explain: a misfit about given effects need not fall.
        """
        V = np.diag(self.variance(sizes))
        for key, Z in self.effects.items():
            V += sizes[key] ** 2 * Z @ Z.T
        penalty = self.precision(sizes) @ np.square(coordinates)
        return float(residual @ np.linalg.solve(V, residual) + penalty)

    def explained(self, change: Array, sizes: Sizes) -> float:
        """Compute the share of a change of the runs (n,) that the surface can explain.

        ``1 - z' V^-1 z / z' v^-1 z``, v the variance of the noise and V that of the runs by noise
        and surface: a squared multiple correlation with the columns of the surface, within the
        limits of its smoothness. The level, which the surface always explains, is subtracted first.
        """
        level, w, X = self.response, 1.0 / self.variance(sizes), self.X
        z = change - level * ((level * w) @ change) / ((level * w) @ level)
        seen, information = (X.T * w) @ z, (X.T * w) @ X + np.diag(self.precision(sizes))
        total = float((z * w) @ z)
        return float(seen @ np.linalg.solve(information, seen)) / total if total > 0.0 else 0.0


def _usual_size(found: Posterior, effect: str, prior: Size) -> float:
    """Return the half-width of the 68 % interval of an effect's numbers, the other sizes fixed."""
    mean, covariance = found.of(effect)
    inverse = np.linalg.inv(covariance)
    L, vectors = np.linalg.eigh(inverse - np.eye(mean.size) / found.sizes[effect] ** 2)
    signal = np.square(vectors.T @ inverse @ mean)
    growth = 1.0 + np.square(GRID)[:, None] * np.maximum(L, 0.0)
    terms = np.square(GRID)[:, None] * signal / growth - np.log(growth)
    before = np.square(np.log(GRID / prior.median) / prior.width)
    log_density = 0.5 * (terms.sum(axis=1) - before)
    density = np.exp(log_density - log_density.max())
    within = 1.0 - 2.0 * ndtr(-GRID[:, None] / GRID) @ density / density.sum()
    return float(np.interp(ONE_SIGMA, within, GRID))

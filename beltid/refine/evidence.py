"""How smooth is the surface, how far do the arcs differ? Chosen by the data: marginal likelihood.

With the data of the runs in units of their standard errors, y = J p + sum s_e Z_e u_e + noise, with

    noise ~ N(0, s² + s_r² r²)      s: one scale for all runs; s_r: scatter of the friction from run
                                    to run (r: sensitivity of each run to a factor on the surface),
    s_e Z_e u_e, u_e ~ N(0, 1)      effects of arcs, run order, temperature
                                    (:mod:`beltid.refine.effects`), and the errors that runs share,
                                    in units of their stated standard uncertainties (s_e = 1),
    p ~ exp(-1/2 p' P p)            P = a Q_bending + b Q_difference, an improper prior,

the probability of the data given (s, a, b, s_r, s_e), with p and u integrated out, has a maximum
where the model is neither too stiff nor too loose (restricted maximum likelihood; D. J. C. MacKay,
Neural Computation 4 (1992) 415). What P does not see (a level per speed and a common slope) is
free.

Where noise hides the curvature, the marginal likelihood hardly falls towards a rigid power law, and
its maximum often lies there: the surface would then be surer of itself than it may be (its 95 %
intervals held the truth of curved laws in 73 % of cases). So s, a and b have wide log-normal priors
of their own: stated standard errors that are right within a half, curvatures of ln mu over ln f_N
of about 0.1, slopes that differ by some hundredths between speeds, each within a factor of two to
three at one standard deviation. Data that see the shape override them.

A few arcs say little about the size of their differences: with three there are two degrees of
freedom, and the most probable s_e is too small in most draws. The mean of s_e² over its posterior
is taken in its place, which is what the variance of the surface asks for; likewise for the others.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

Array = NDArray[np.float64]

SMALLEST_SCALE, LARGEST_SCALE = 0.5, 20.0
# centre and width of ln of the hyperparameters before the data
SCALE_BEFORE = (0.0, 0.5)
BENDING_BEFORE = (5.0, 1.5)
DIFFERENCE_BEFORE = (7.0, 2.0)
SCATTER_BEFORE = (float(np.log(3.0e-3)), 1.5)
WEIGHT_RANGE = (-6.0, 18.0)
EFFECT_RANGE = (float(np.log(1.0e-5)), float(np.log(0.3)))
EFFECT_SMALL, EFFECT_LARGE = float(np.log(1.0e-3)), float(np.log(3.0e-2))  # to start from
EFFECT_STEPS = 60  # of the quadrature over ln of the size of an effect


@dataclass(frozen=True, slots=True)
class Smoothness:
    """Hyperparameters of the surface and of what is beside it.

    Attributes
    ----------
    bending, difference : float
        Weights of the two roughnesses.
    noise_scale : float
        Factor on the stated standard errors that the data show [-].
    scatter : float
        Standard deviation of ln mu of the friction from run to run, beyond the stated errors [-].
    effects : tuple of float
        Standard deviation of the numbers of each effect; 1 of those in units of a stated one.
    """

    bending: float
    difference: float
    noise_scale: float
    scatter: float = 0.0
    effects: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Solution:
    """Most probable parameters and numbers of the effects, with their covariance.

    Attributes
    ----------
    parameters : ndarray, shape (size,)
        Of the surface.
    effects : ndarray, shape (K,)
        Numbers of all effects.
    covariance : ndarray, shape (size, size)
        Of the parameters.
    effects_covariance : ndarray, shape (K, K)
        Of the numbers.
    gain, effects_gain : ndarray, shape (size, n), (K, n)
        Derivatives of parameters and numbers by the data (in units of their standard errors).
    pull, effects_pull : ndarray, shape (size, size), (K, size)
        Derivatives of both by a force on the parameters: ``gain J = 1 - pull P``.
    """

    parameters: Array
    effects: Array
    covariance: Array
    effects_covariance: Array
    gain: Array
    effects_gain: Array
    pull: Array
    effects_pull: Array


class _Marginal(NamedTuple):
    """What the marginal likelihood is made of."""

    design: Array
    factor: tuple[Array, bool]
    variance: Array
    both: Array
    residual: Array


@dataclass(frozen=True, slots=True)
class LinearModel:
    """Linearised data: ``y = J p + effects + noise`` in units of the stated standard errors.

    Attributes
    ----------
    J : ndarray, shape (n, size)
        Sensitivities over standard errors.
    y : ndarray, shape (n,)
        Data over standard errors.
    bending, difference : ndarray, shape (size, size)
        Quadratic forms of the roughness.
    response : ndarray, shape (n,)
        Sensitivity to a factor on the friction of the run over its standard error; zero where the
        friction is not to scatter.
    effects : sequence of ndarray, shape (n, K_e)
        Sensitivities to the numbers of each effect over standard errors.
    before : sequence of (float, float) or None
        Centre and width of ln of the size of each effect; None if its size is 1.
    """

    J: Array
    y: Array
    bending: Array
    difference: Array
    response: Array
    effects: Sequence[Array] = ()
    before: Sequence[tuple[float, float] | None] = ()

    def solve(self, smoothness: Smoothness) -> Solution:
        """Most probable parameters and effects."""
        size, sizes = self.J.shape[1], self._sizes(smoothness)
        design, A = self._design(smoothness), self._normal(smoothness)
        covariance = cho_solve(cho_factor(A), np.eye(A.shape[0]))
        gain = covariance @ (design / self.variance(smoothness)[:, None]).T
        both = gain @ self.y
        return Solution(
            parameters=both[:size],
            effects=sizes * both[size:],
            covariance=covariance[:size, :size],
            effects_covariance=np.outer(sizes, sizes) * covariance[size:, size:],
            gain=gain[:size],
            effects_gain=sizes[:, None] * gain[size:],
            pull=covariance[:size, :size],
            effects_pull=sizes[:, None] * covariance[size:, :size],
        )

    def solve_surface(self, smoothness: Smoothness) -> Solution:
        """Most probable parameters with the effects, the numbers of a stated size taken as zero.

        The effects are those of :meth:`solve`, with the latter among the unknowns; the covariance
        is that of scatter and effects. Without numbers of a stated size both are the same.
        """
        whole, free = self.solve(smoothness), self.is_free
        no_effects = replace(smoothness, effects=())
        model = replace(self, effects=(), before=())
        alone, variance = model.solve(no_effects), self.variance(smoothness)
        follows = alone.gain @ self._Z[:, free]
        gain = alone.gain - follows @ whole.effects_gain[free]
        pull = alone.pull - follows @ whole.effects_pull[free]
        of_effects = gain @ self._columns(smoothness)[:, free]
        roughness = model._normal(no_effects) - self.J.T @ (self.J / variance[:, None])
        covariance = gain @ (variance[:, None] * gain.T) + of_effects @ of_effects.T
        covariance += pull @ roughness @ pull.T
        return Solution(
            parameters=gain @ self.y,
            effects=whole.effects[free],
            covariance=covariance,
            effects_covariance=whole.effects_covariance[np.ix_(free, free)],
            gain=gain,
            effects_gain=whole.effects_gain[free],
            pull=pull,
            effects_pull=whole.effects_pull[free],
        )

    @property
    def is_free(self) -> NDArray[np.bool_]:
        """Whether the data find the size of each number (K,)."""
        counts = [columns.shape[1] for columns in self.effects]
        return np.repeat([before is not None for before in self.before], counts).astype(bool)

    def residual(self, solution: Solution) -> Array:
        """What the solution leaves of the data (n,), noise."""
        of_surface, of_effects = self.J @ solution.parameters, self._Z @ solution.effects
        return np.asarray(self.y - of_surface - of_effects)

    def explained_by_surface(self, smoothness: Smoothness, columns: Array) -> Array:
        """Share of columns (n, k) that the surface explains as an unknown, shape (k,).

        ``1 - z' V^-1 z / z' S^-1 z``, S the variance of the noise and V = S + J P^+ J': a squared
        multiple correlation with the columns of the surface, as freely as its smoothness lets them
        move. 1 less that is the inverse of the variance inflation factor. The level, which the
        surface always explains, is taken off z beforehand.
        """
        level, noise = self.J.sum(axis=1), self.variance(smoothness)
        columns = columns - np.outer(level, (level / noise) @ columns / (level @ (level / noise)))
        weighted = columns / noise[:, None]
        seen = self.J.T @ weighted
        A = self._normal(smoothness)[: self.J.shape[1], : self.J.shape[1]]
        explained = np.sum(seen * cho_solve(cho_factor(A), seen), axis=0)
        whole = np.sum(columns * weighted, axis=0)
        return np.asarray(explained / np.where(whole > 0.0, whole, 1.0))

    def effective_parameters(self, smoothness: Smoothness) -> float:
        """Number of parameters that the data determine: trace of the influence matrix."""
        found = self.solve_surface(smoothness)
        by_effects = found.effects_gain @ self._Z[:, self.is_free]
        return float(np.trace(found.gain @ self.J) + np.trace(by_effects))

    def log_evidence(self, smoothness: Smoothness) -> tuple[float, Array]:
        """Logarithm of the marginal likelihood up to a constant, and its derivatives.

        The derivatives are those by ln of noise scale, bending, difference, scatter and the sizes
        of the effects. With A the normal matrix, d_i the rows of the design, r the residual, v the
        variance of the noise, and P⁺ the inverse of the roughness where it is not zero:

            d/d ln a   = [tr(P⁺ a Q) - tr(A⁻¹ a Q) - p' a Q p]/2,
            d/d ln s   = sum_i (dv_i/d ln s) [(d_i' A⁻¹ d_i + r_i²)/v_i² - 1/v_i]/2,
            d/d ln s_e = tr((A⁻¹)_uu) + u_e' u_e - K_e.
        """
        at, size = self._marginal(smoothness), self.J.shape[1]
        roughness = self.roughness(smoothness)
        values, vectors = np.linalg.eigh(roughness)
        seen = values > 1e-9 * values[-1]
        p, u = at.both[:size], at.both[size:]
        quadratic = at.residual @ (at.residual / at.variance) + u @ u
        quadratic += p @ roughness @ p
        log_normal = 2.0 * np.log(np.diag(at.factor[0])).sum()
        log_noise = np.log(at.variance).sum()
        value = 0.5 * (np.log(values[seen]).sum() - log_normal - quadratic - log_noise)
        inverse = cho_solve(at.factor, np.eye(at.both.size))
        open_inverse = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T
        open_inverse = open_inverse - inverse[:size, :size] - np.outer(p, p)
        of_weights = [
            0.5 * weight * np.sum(open_inverse * Q)
            for weight, Q in (
                (smoothness.bending, self.bending),
                (smoothness.difference, self.difference),
            )
        ]
        leverage = np.sum(at.design @ inverse * at.design, axis=1)
        by_variance = (leverage + np.square(at.residual)) / at.variance**2 - 1.0 / at.variance
        of_scale = smoothness.noise_scale**2 * by_variance.sum()
        of_scatter = np.square(smoothness.scatter * self.response) @ by_variance
        of_number = np.diag(inverse)[size:] + np.square(u) - 1.0
        first = np.cumsum([0, *(columns.shape[1] for columns in self.effects)])
        of_effects = [of_number[a:b].sum() for a, b in itertools.pairwise(first)]
        return float(value), np.array([of_scale, *of_weights, of_scatter, *of_effects])

    def log_evidence_by_size(self, smoothness: Smoothness, k: int, sizes: Array) -> Array:
        """The same for other sizes (m,) of effect `k`, up to a constant."""
        Z = self.effects[k]
        at = self._marginal(_with_size(smoothness, k, 0.0))
        weighted = Z / at.variance[:, None]
        seen = at.design.T @ weighted
        M = Z.T @ weighted - seen.T @ cho_solve(at.factor, seen)
        values, vectors = np.linalg.eigh(M)
        shown = np.square(vectors.T @ (weighted.T @ at.residual))
        grown = 1.0 + np.square(sizes)[:, None] * np.maximum(values, 0.0)
        terms = np.square(sizes)[:, None] * shown / grown - np.log(grown)
        return np.asarray(0.5 * terms.sum(axis=1))

    def _marginal(self, smoothness: Smoothness) -> _Marginal:
        design, factor = self._design(smoothness), cho_factor(self._normal(smoothness))
        variance = self.variance(smoothness)
        both = cho_solve(factor, design.T @ (self.y / variance))
        return _Marginal(design, factor, variance, both, self.y - design @ both)

    def shifts(self, solution: Solution) -> Array:
        """What the effects of :meth:`solve_surface` do to the data (n,)."""
        return np.asarray(self._Z[:, self.is_free] @ solution.effects)

    def misfit(self, residual: Array, parameters: Array, smoothness: Smoothness) -> float:
        """Penalised misfit: ``r' S^-1 r + p' P p``, S the variance of the noise.

        `residual` (n,) is measured less simulated ln mu and less the effects, over standard errors,
        of whatever model: it need not be the linear one.
        """
        noise = residual @ (residual / self.variance(smoothness))
        return float(noise + parameters @ self.roughness(smoothness) @ parameters)

    def variance(self, smoothness: Smoothness) -> Array:
        """Variance of the noise of each run (n,), in squares of its standard error."""
        return smoothness.noise_scale**2 + np.square(smoothness.scatter * self.response)

    def roughness(self, smoothness: Smoothness) -> Array:
        """Quadratic form of both roughnesses with their weights, shape (size, size)."""
        return smoothness.bending * self.bending + smoothness.difference * self.difference

    def _sizes(self, smoothness: Smoothness) -> Array:
        counts = [columns.shape[1] for columns in self.effects]
        return np.repeat(smoothness.effects, counts) if counts else np.zeros(0)

    @property
    def _Z(self) -> Array:
        """Sensitivities to the numbers of all effects, shape (n, K)."""
        return np.hstack([np.zeros((self.y.size, 0)), *self.effects])

    def _columns(self, smoothness: Smoothness) -> Array:
        return self._Z * self._sizes(smoothness)

    def _design(self, smoothness: Smoothness) -> Array:
        return np.hstack([self.J, self._columns(smoothness)])

    def _normal(self, smoothness: Smoothness) -> Array:
        design = self._design(smoothness)
        A = design.T @ (design / self.variance(smoothness)[:, None])
        size = self.J.shape[1]
        A[:size, :size] += self.roughness(smoothness)
        diagonal = np.einsum("ii->i", A)
        diagonal[size:] += 1.0
        diagonal += 1e-10 * diagonal.mean()
        return A


class _Before(NamedTuple):
    """What is known of the hyperparameters beforehand: normal in their logarithms.

    In the order noise scale, bending, difference, scatter, effects whose sizes the data find.
    """

    centre: Array
    width: Array
    limits: Array
    asked: NDArray[np.bool_]

    def away(self, log_values: Array) -> Array:
        """Logarithms of those that are asked for, in widths from their centres."""
        return np.asarray((log_values - self.centre[self.asked]) / self.width[self.asked])


def _before(model: LinearModel) -> _Before:
    """Noise scale, bending and effects always; the others where runs tell them."""
    before = [SCALE_BEFORE, BENDING_BEFORE, DIFFERENCE_BEFORE, SCATTER_BEFORE]
    before += [at for at in model.before if at is not None]
    limits = [(np.log(SMALLEST_SCALE), np.log(LARGEST_SCALE)), WEIGHT_RANGE, WEIGHT_RANGE]
    limits += [EFFECT_RANGE] * (len(before) - 3)
    asked = np.ones(len(before), dtype=bool)
    asked[2:4] = bool(np.any(model.difference)), bool(np.any(model.response))
    centre, width = np.array(before).T
    return _Before(centre, width, np.array(limits), asked)


def log_posterior(model: LinearModel, smoothness: Smoothness) -> float:
    """Logarithm of marginal likelihood times priors of the hyperparameters, up to a constant."""
    before = _before(model)
    sizes = (size for size, at in zip(smoothness.effects, model.before, strict=True) if at)
    found = np.array(
        [
            smoothness.noise_scale,
            smoothness.bending,
            smoothness.difference,
            smoothness.scatter,
            *sizes,
        ]
    )
    away = before.away(np.log(found[before.asked]))
    return model.log_evidence(smoothness)[0] - float(0.5 * away @ away)


def choose_smoothness(model: LinearModel, start: Smoothness) -> Smoothness:
    """Most probable hyperparameters: marginal likelihood times their own wide priors.

    Those of the effects are the root of the posterior mean of their square, given the others.
    """
    free = [k for k, before in enumerate(model.before) if before is not None]
    before = _before(model)
    asked, centre = before.asked, before.centre
    rows = np.flatnonzero([*asked[:4], *(at is not None for at in model.before)])
    sizes = np.ones(len(model.before))

    def unpack(x: Array) -> Smoothness:
        values = np.zeros(asked.size)
        values[asked] = np.exp(x)
        sizes[free] = values[4:]
        scale, bending, difference, scatter = values[:4].tolist()
        return Smoothness(bending, difference, scale, scatter, tuple(sizes.tolist()))

    def cost(x: Array) -> tuple[float, Array]:
        away = before.away(x)
        value, slope = model.log_evidence(unpack(x))
        return float(0.5 * away @ away) - value, away / before.width[asked] - slope[rows]

    def starts() -> Iterator[Array]:
        """From the last choice; without one from the centres, and with one effect large in turn."""
        x = centre.copy()
        x[:3] = np.log([start.noise_scale, start.bending, start.difference or 1.0])
        if start.effects:
            x[3] = np.log(start.scatter) if start.scatter else x[3]
            x[4:] = np.log(np.array(start.effects)[free])
            yield x
            return
        yield x
        for k in range(4, x.size):
            x = x.copy()
            x[4:] = EFFECT_SMALL
            x[k] = EFFECT_LARGE
            yield x

    bounds = before.limits[asked]
    inside = [np.clip(x[asked], *bounds.T) for x in starts()]
    tried = [minimize(cost, x, jac=True, bounds=bounds, method="L-BFGS-B") for x in inside]
    found = unpack(min(tried, key=lambda end: float(end.fun)).x)
    means = [_mean_square_root(model, found, k) for k in free]
    for k, size in zip(free, means, strict=True):
        found = _with_size(found, k, size)
    return found


def log_evidence_for(model: LinearModel, found: Smoothness, effects: Sequence[int]) -> float:
    """Logarithm of how much more probable the data are with some effects than without them.

    Without them all hyperparameters are chosen anew: other effects may grow to explain the same.
    """
    kept = [k for k in range(len(model.effects)) if k not in effects]
    without = replace(
        model,
        effects=[model.effects[k] for k in kept],
        before=[model.before[k] for k in kept],
    )
    start = replace(found, effects=())
    return log_posterior(model, found) - log_posterior(without, choose_smoothness(without, start))


def _mean_square_root(model: LinearModel, found: Smoothness, k: int) -> float:
    """Root of the posterior mean of the square of the size of effect `k`, the others as found."""
    grid, before = np.linspace(*EFFECT_RANGE, EFFECT_STEPS), model.before[k]
    assert before is not None
    log_density = model.log_evidence_by_size(found, k, np.exp(grid))
    log_density -= 0.5 * np.square((grid - before[0]) / before[1])
    density = np.exp(log_density - log_density.max())
    return float(np.sqrt(density @ np.exp(2.0 * grid) / density.sum()))


def _with_size(found: Smoothness, k: int, size: float) -> Smoothness:
    sizes = list(found.effects)
    sizes[k] = size
    return replace(found, effects=tuple(sizes))

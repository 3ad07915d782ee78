"""Smoothness of the surface and size of the effects, chosen by the data: marginal likelihood.

With the data of the runs in units of their standard errors, y = J p + sum s_e Z_e u_e + noise, with

    noise ~ N(0, s² + s_r² r²)      s: one scale for all runs; s_r: scatter of the friction from run
                                    to run (r: sensitivity of each run to a factor on the surface),
    s_e Z_e u_e, u_e ~ N(0, 1)      effects of arcs, run order, temperature
                                    (:mod:`beltid.refine.effects`), and
    t X e, e ~ N(0, 1)              errors that runs share; X: by one stated standard uncertainty,
    p ~ exp(-1/2 p' P p)            P = a Q_bending + b Q_difference, an improper prior,

the probability of the data given (s, a, b, s_r, t, s_e), with p, u and e integrated out, has a
maximum where the model is neither too stiff nor too loose (restricted maximum likelihood; D. J. C.
MacKay, Neural Computation 4 (1992) 415). P does not penalise a level per speed and a common slope.

If noise hides the curvature, the marginal likelihood hardly decreases towards a rigid power law,
and its maximum often lies there. The stated uncertainty of the surface would then be too small (its
95 % intervals contained the truth of curved laws in 73 % of cases). Therefore s, a and b have wide
log-normal priors: stated standard errors that are right within a half, curvatures of ln mu over
ln f_N of about 0.1, slopes that differ by some hundredths between speeds, each within a factor of
two to three at one standard deviation. Data that show the shape override them.

A few arcs determine the size of their differences poorly: with three there are two degrees of
freedom, and the most probable s_e is too small in most draws. The posterior mean of s_e² replaces
it, as this is what the variance of the surface depends on; likewise for the other effects.

The stated errors are doubts, not facts: the bench may well be better. Where the runs show that it
is (t < 1), effects of the campaign need not be shared out between errors that are not there, which
amplifies noise. The runs can only clear the bench: t is at most 1, and every uncertainty is that of
the errors as stated.
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
# priors: centre and width of ln of the hyperparameters
SCALE_BEFORE = (0.0, 0.5)
BENDING_BEFORE = (5.0, 1.5)
DIFFERENCE_BEFORE = (7.0, 2.0)
SCATTER_BEFORE = (float(np.log(3.0e-3)), 1.5)
WEIGHT_RANGE = (-6.0, 18.0)
EFFECT_RANGE = (float(np.log(1.0e-5)), float(np.log(0.3)))
EFFECT_SMALL, EFFECT_LARGE = float(np.log(1.0e-3)), float(np.log(3.0e-2))  # start values
STATED_BEFORE = (0.0, 1.0)
LEAST_STATED = 0.01  # share of the stated errors that is as good as none
EFFECT_STEPS = 60  # steps of the quadrature over ln of the size of an effect


@dataclass(frozen=True, slots=True)
class Smoothness:
    """Hyperparameters of the surface, the noise and the effects.

    Attributes
    ----------
    bending, difference : float
        Weights of the two roughnesses.
    noise_scale : float
        Factor on the stated standard errors as estimated from the data [-].
    scatter : float
        Standard deviation of ln mu of the friction from run to run, beyond the stated errors [-].
    effects : tuple of float
        Standard deviation of the numbers of each effect.
    stated : float
        Size of the errors that runs share over their stated standard uncertainties, at most 1 [-].
    """

    bending: float
    difference: float
    noise_scale: float
    scatter: float = 0.0
    effects: tuple[float, ...] = ()
    stated: float = 1.0


@dataclass(frozen=True, slots=True)
class Solution:
    """Most probable parameters and numbers of the effects, with their covariance.

    Attributes
    ----------
    parameters : ndarray, shape (size,)
        Parameters of the surface.
    effects : ndarray, shape (K,)
        Numbers of all effects, then the stated errors if they were solved for.
    covariance : ndarray, shape (size, size)
        Covariance of the parameters.
    effects_covariance : ndarray, shape (K, K)
        Covariance of the numbers, with the stated errors as large as stated.
    gain, effects_gain : ndarray, shape (size, n), (K, n)
        Derivatives of parameters and numbers with respect to the data (in standard errors).
    pull, effects_pull : ndarray, shape (size, size), (K, size)
        Derivatives of parameters and numbers with respect to a force on the parameters:
        ``gain J = 1 - pull P``.
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
    """Terms of the marginal likelihood; `unknowns` holds parameters and scaled numbers."""

    design: Array
    factor: tuple[Array, bool]
    variance: Array
    unknowns: Array
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
        Sensitivity to a factor on the friction of the run over its standard error; zero for no
        scatter of the friction.
    effects : sequence of ndarray, shape (n, K_e)
        Sensitivities to the numbers of each effect over standard errors.
    before : sequence of (float, float)
        Prior centre and width of ln of the size of each effect.
    stated : ndarray, shape (n, K), optional
        Changes by one stated standard uncertainty of each error that runs share, over standard
        errors.
    least_stated : float
        Smallest share of the stated errors that may be chosen; 1 takes them as stated.
    """

    J: Array
    y: Array
    bending: Array
    difference: Array
    response: Array
    effects: Sequence[Array] = ()
    before: Sequence[tuple[float, float]] = ()
    stated: Array | None = None
    least_stated: float = LEAST_STATED

    def solve(self, smoothness: Smoothness) -> Solution:
        """Compute the most probable parameters, effects and stated errors."""
        size, sizes = self.J.shape[1], self._sizes(smoothness)
        design, A = self._design(smoothness), self._normal(smoothness)
        inverse = cho_solve(cho_factor(A), np.eye(A.shape[0]))
        scale = np.concatenate([np.ones(size), sizes])
        gain = scale[:, None] * (inverse @ (design / self.variance(smoothness)[:, None]).T)
        unknowns = gain @ self.y
        # errors of stated size: what of them is missed, and what is taken for something else
        X = self._stated
        missed = gain @ X - np.eye(A.shape[0])[:, A.shape[0] - X.shape[1] :]
        covariance = np.outer(scale, scale) * inverse
        covariance += (1.0 - smoothness.stated**2) * missed @ missed.T
        return Solution(
            parameters=unknowns[:size],
            effects=unknowns[size:],
            covariance=covariance[:size, :size],
            effects_covariance=covariance[size:, size:],
            gain=gain[:size],
            effects_gain=gain[size:],
            pull=inverse[:size, :size],
            effects_pull=sizes[:, None] * inverse[size:, :size],
        )

    def solve_surface(self, smoothness: Smoothness) -> Solution:
        """Compute the most probable parameters, corrected for effects but not for stated errors.

        The effects are those of :meth:`solve`, which treats the stated errors as unknowns. The
        covariance is that due to scatter and effects. Without stated errors, the result equals that
        of :meth:`solve`.
        """
        full, free = self.solve(smoothness), slice(self.effects_count)
        no_effects = replace(smoothness, effects=())
        model = replace(self, effects=(), before=(), stated=None)
        alone, variance = model.solve(no_effects), self.variance(smoothness)
        response = alone.gain @ self._Z[:, free]  # of the parameters to the effects
        gain = alone.gain - response @ full.effects_gain[free]
        pull = alone.pull - response @ full.effects_pull[free]
        by_effects = gain @ self._columns(smoothness)[:, free]
        roughness = model._normal(no_effects) - self.J.T @ (self.J / variance[:, None])
        covariance = gain @ (variance[:, None] * gain.T) + by_effects @ by_effects.T
        covariance += pull @ roughness @ pull.T
        return Solution(
            parameters=gain @ self.y,
            effects=full.effects[free],
            covariance=covariance,
            effects_covariance=full.effects_covariance[free, free],
            gain=gain,
            effects_gain=full.effects_gain[free],
            pull=pull,
            effects_pull=full.effects_pull[free],
        )

    @property
    def effects_count(self) -> int:
        """Number of the numbers of all effects, without the stated errors."""
        return sum(columns.shape[1] for columns in self.effects)

    def residual(self, solution: Solution) -> Array:
        """Compute the residual of the data after surface and effects (n,)."""
        by_surface, by_effects = self.J @ solution.parameters, self._Z @ solution.effects
        return np.asarray(self.y - by_surface - by_effects)

    def explained_by_surface(self, smoothness: Smoothness, columns: Array) -> Array:
        """Compute the share of columns (n, k) that the surface can explain, shape (k,).

        ``1 - z' V^-1 z / z' S^-1 z``, S the variance of the noise and V = S + J P^+ J': a squared
        multiple correlation with the columns of the surface, within the limits of its smoothness. 1
        minus this share is the inverse of the variance inflation factor. The level, which the
        surface always explains, is subtracted from z first.
        """
        level, noise = self.J.sum(axis=1), self.variance(smoothness)
        columns = columns - np.outer(level, (level / noise) @ columns / (level @ (level / noise)))
        weighted = columns / noise[:, None]
        projected = self.J.T @ weighted
        A = self._normal(smoothness)[: self.J.shape[1], : self.J.shape[1]]
        explained = np.sum(projected * cho_solve(cho_factor(A), projected), axis=0)
        total = np.sum(columns * weighted, axis=0)
        return np.asarray(explained / np.where(total > 0.0, total, 1.0))

    def effective_parameters(self, smoothness: Smoothness) -> float:
        """Count the parameters that the data determine: trace of the influence matrix."""
        solution = self.solve_surface(smoothness)
        by_effects = solution.effects_gain @ self._Z[:, : self.effects_count]
        return float(np.trace(solution.gain @ self.J) + np.trace(by_effects))

    def log_evidence(self, smoothness: Smoothness) -> tuple[float, Array]:
        """Compute the logarithm of the marginal likelihood up to a constant, and its derivatives.

        The derivatives are with respect to ln of noise scale, bending, difference, scatter, the
        sizes of the effects and that of the stated errors. With A the normal matrix, d_i the rows
        of the design, r the residual, v the variance of the noise, and P⁺ the inverse of the
        roughness where it is not zero:

            d/d ln a   = [tr(P⁺ a Q) - tr(A⁻¹ a Q) - p' a Q p]/2,
            d/d ln s   = sum_i (dv_i/d ln s) [(d_i' A⁻¹ d_i + r_i²)/v_i² - 1/v_i]/2,
            d/d ln s_e = tr((A⁻¹)_uu) + u_e' u_e - K_e.
        """
        at, size = self._marginal(smoothness), self.J.shape[1]
        roughness = self.roughness(smoothness)
        values, vectors = np.linalg.eigh(roughness)
        nonzero = values > 1e-9 * values[-1]
        p, u = at.unknowns[:size], at.unknowns[size:]
        quadratic = at.residual @ (at.residual / at.variance) + u @ u
        quadratic += p @ roughness @ p
        log_normal = 2.0 * np.log(np.diag(at.factor[0])).sum()
        log_noise = np.log(at.variance).sum()
        value = 0.5 * (np.log(values[nonzero]).sum() - log_normal - quadratic - log_noise)
        inverse = cho_solve(at.factor, np.eye(at.unknowns.size))
        pseudo_inverse = (vectors[:, nonzero] / values[nonzero]) @ vectors[:, nonzero].T
        by_roughness = pseudo_inverse - inverse[:size, :size] - np.outer(p, p)
        by_weights = [
            0.5 * weight * np.sum(by_roughness * Q)
            for weight, Q in (
                (smoothness.bending, self.bending),
                (smoothness.difference, self.difference),
            )
        ]
        leverage = np.sum(at.design @ inverse * at.design, axis=1)
        by_variance = (leverage + np.square(at.residual)) / at.variance**2 - 1.0 / at.variance
        by_scale = smoothness.noise_scale**2 * by_variance.sum()
        by_scatter = np.square(smoothness.scatter * self.response) @ by_variance
        by_number = np.diag(inverse)[size:] + np.square(u) - 1.0
        first = np.cumsum([0, *self._counts])
        by_effects = [by_number[a:b].sum() for a, b in itertools.pairwise(first)]
        return float(value), np.array([by_scale, *by_weights, by_scatter, *by_effects])

    def log_evidence_by_size(self, smoothness: Smoothness, k: int, sizes: Array) -> Array:
        """Compute the log marginal likelihood for sizes (m,) of effect `k`, up to a constant."""
        Z = self.effects[k]
        others = [size if i != k else 0.0 for i, size in enumerate(smoothness.effects)]
        at = self._marginal(replace(smoothness, effects=tuple(others)))
        weighted = Z / at.variance[:, None]
        projected = at.design.T @ weighted
        M = Z.T @ weighted - projected.T @ cho_solve(at.factor, projected)
        values, vectors = np.linalg.eigh(M)
        signal = np.square(vectors.T @ (weighted.T @ at.residual))
        growth = 1.0 + np.square(sizes)[:, None] * np.maximum(values, 0.0)
        terms = np.square(sizes)[:, None] * signal / growth - np.log(growth)
        return np.asarray(0.5 * terms.sum(axis=1))

    def _marginal(self, smoothness: Smoothness) -> _Marginal:
        design, factor = self._design(smoothness), cho_factor(self._normal(smoothness))
        variance = self.variance(smoothness)
        unknowns = cho_solve(factor, design.T @ (self.y / variance))
        return _Marginal(design, factor, variance, unknowns, self.y - design @ unknowns)

    def shifts(self, solution: Solution) -> Array:
        """Compute the shift of the data (n,) by the effects of :meth:`solve_surface`."""
        return np.asarray(self._Z[:, : self.effects_count] @ solution.effects)

    def misfit(self, residual: Array, parameters: Array, smoothness: Smoothness) -> float:
        """Compute the penalised misfit ``r' S^-1 r + p' P p``, S the variance of the noise.

        `residual` (n,) is measured minus simulated ln mu minus the effects, over standard errors.
        It may come from a nonlinear model.
        """
        noise = residual @ (residual / self.variance(smoothness))
        return float(noise + parameters @ self.roughness(smoothness) @ parameters)

    def variance(self, smoothness: Smoothness) -> Array:
        """Compute the noise variance of each run (n,), in units of its squared standard error."""
        return smoothness.noise_scale**2 + np.square(smoothness.scatter * self.response)

    def roughness(self, smoothness: Smoothness) -> Array:
        """Add both quadratic forms of the roughness with their weights, shape (size, size)."""
        return smoothness.bending * self.bending + smoothness.difference * self.difference

    @property
    def _stated(self) -> Array:
        return np.zeros((self.y.size, 0)) if self.stated is None else self.stated

    @property
    def _counts(self) -> list[int]:
        return [columns.shape[1] for columns in (*self.effects, self._stated)]

    def _sizes(self, smoothness: Smoothness) -> Array:
        return np.repeat([*smoothness.effects, smoothness.stated], self._counts)

    @property
    def _Z(self) -> Array:
        """Sensitivities to the numbers of all effects and to the stated errors, shape (n, K)."""
        return np.hstack([*self.effects, self._stated])

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


class _Priors(NamedTuple):
    """Priors of the hyperparameters, normal in their logarithms.

    In the order noise scale, bending, difference, scatter, effects, stated errors. `active` marks
    the hyperparameters that the runs determine; of the others, the weights and the scatter are
    zero and the stated errors as stated.
    """

    centre: Array
    width: Array
    limits: Array
    active: NDArray[np.bool_]

    def normalised(self, log_values: Array) -> Array:
        """Express active logarithms as distances from their centres in widths."""
        return np.asarray((log_values - self.centre[self.active]) / self.width[self.active])


def _priors(model: LinearModel) -> _Priors:
    """Collect the priors: a hyperparameter without columns in the model is not active."""
    priors = [SCALE_BEFORE, BENDING_BEFORE, DIFFERENCE_BEFORE, SCATTER_BEFORE]
    priors += [*model.before, STATED_BEFORE]
    limits = [(np.log(SMALLEST_SCALE), np.log(LARGEST_SCALE)), WEIGHT_RANGE, WEIGHT_RANGE]
    limits += [EFFECT_RANGE] * (1 + len(model.before)) + [(np.log(model.least_stated), 0.0)]
    active = np.ones(len(priors), dtype=bool)
    active[2:4] = bool(np.any(model.difference)), bool(np.any(model.response))
    active[-1] = bool(np.any(model._stated))
    centre, width = np.array(priors).T
    return _Priors(centre, width, np.array(limits), active)


def log_posterior(model: LinearModel, smoothness: Smoothness) -> float:
    """Compute the log of marginal likelihood times hyperparameter priors, up to a constant."""
    s, priors = smoothness, _priors(model)
    values = np.array([s.noise_scale, s.bending, s.difference, s.scatter, *s.effects, s.stated])
    distance = priors.normalised(np.log(values[priors.active]))
    return model.log_evidence(smoothness)[0] - float(0.5 * distance @ distance)


def choose_smoothness(model: LinearModel, start: Smoothness) -> Smoothness:
    """Choose the most probable hyperparameters: marginal likelihood times wide priors.

    The size of an effect is the root of the posterior mean of its square, given the others.
    """
    priors = _priors(model)
    active, centre = priors.active, priors.centre

    def unpack(x: Array) -> Smoothness:
        values = np.zeros(active.size)
        values[-1] = 1.0
        values[active] = np.exp(x)
        scale, bending, difference, scatter, *effects, stated = values.tolist()
        return Smoothness(bending, difference, scale, scatter, tuple(effects), stated)

    def cost(x: Array) -> tuple[float, Array]:
        distance = priors.normalised(x)
        value, slope = model.log_evidence(unpack(x))
        gradient = distance / priors.width[active] - slope[active]
        return float(0.5 * distance @ distance) - value, gradient

    def starts() -> Iterator[Array]:
        """Yield the last choice or, without one, the centres and each effect large in turn."""
        x = centre.copy()
        x[:3] = np.log([start.noise_scale, start.bending, start.difference or 1.0])
        if start.effects:
            x[3] = np.log(start.scatter) if start.scatter else x[3]
            x[4:] = np.log([*start.effects, start.stated])
            yield x
            return
        yield x
        for k in range(4, x.size - 1):
            x = x.copy()
            x[4:-1] = EFFECT_SMALL
            x[k] = EFFECT_LARGE
            yield x

    bounds = priors.limits[active]
    inside = [np.clip(x[active], *bounds.T) for x in starts()]
    minima = [minimize(cost, x, jac=True, bounds=bounds, method="L-BFGS-B") for x in inside]
    smoothness = unpack(min(minima, key=lambda minimum: float(minimum.fun)).x)
    sizes = [_mean_square_root(model, smoothness, k) for k in range(len(model.effects))]
    return replace(smoothness, effects=tuple(sizes))


def log_evidence_of(model: LinearModel, found: Smoothness) -> float:
    """Compute the log of the probability of the data, the stated errors being as large as stated.

    What these explain is no evidence for anything else, even if the runs do not show them.
    """
    as_stated = replace(model, least_stated=1.0)
    return log_posterior(as_stated, choose_smoothness(as_stated, found))


def log_evidence_for(model: LinearModel, found: Smoothness, effects: Sequence[int]) -> float:
    """Compute the log of the ratio of the probabilities of the data with and without `effects`.

    Without them, all hyperparameters are chosen again, as other effects may explain the same.
    """
    kept = [k for k in range(len(model.effects)) if k not in effects]
    without = replace(
        model,
        effects=[model.effects[k] for k in kept],
        before=[model.before[k] for k in kept],
    )
    start = replace(found, effects=())
    return log_evidence_of(model, found) - log_evidence_of(without, start)


def _mean_square_root(model: LinearModel, smoothness: Smoothness, k: int) -> float:
    """Compute the root of the posterior mean square of the size of effect `k`, the others fixed."""
    grid, prior = np.linspace(*EFFECT_RANGE, EFFECT_STEPS), model.before[k]
    log_density = model.log_evidence_by_size(smoothness, k, np.exp(grid))
    log_density -= 0.5 * np.square((grid - prior[0]) / prior[1])
    density = np.exp(log_density - log_density.max())
    return float(np.sqrt(density @ np.exp(2.0 * grid) / density.sum()))

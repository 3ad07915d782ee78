"""The runs of a campaign as a mixed model: sizes of smoothness, noise and effects; the estimate.

With the data of the runs in units of their standard errors,

    y = X h + sum_e Z_e u_e + S e + noise,    noise ~ N(0, s² + s_r² r²),

h the coordinates of the surface (:mod:`beltid.refine.curves`): levels and common slope are free,
curve and difference are normal with a size each; Z_e the effects of the campaign
(:mod:`beltid.refine.effects`) with a size each; r the sensitivity of a run to a factor on the
surface and s_r the scatter of the friction from run to run; S the change by one stated standard
uncertainty of each error that runs share, of which there is a share t <= 1. :mod:`beltid.mixed`
finds the sizes.

If noise hides the curvature, the likelihood hardly decreases towards a rigid power law, and its
maximum often lies there. The stated uncertainty of the surface would then be too small (its 95 %
intervals contained the truth of curved laws in 73 % of cases). Therefore the sizes have priors.
A few arcs determine the size of their differences poorly: the most probable size is too small in
most draws. The root of the posterior mean of its square replaces it, as this is what the variance
of the surface depends on; likewise for the other effects.

The stated errors are doubts, not facts: the bench may well be better. Where the runs show that it
is (t < 1), effects of the campaign need not be shared out between errors that are not there, which
amplifies noise. The runs can only clear the bench: every uncertainty is that of the errors as
stated. And the surface does not follow the errors that the runs show: it would belong to another
bench, and every trace of a model error would be taken for an error of the bench. It is solved for
with the effects taken off, in the size that the stated errors leave to them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from beltid.mixed import Mixed, Own, Posterior, Shared, Size
from beltid.refine.effects import Effect

Array = NDArray[np.float64]
Sizes = Mapping[str, float]

NOISE, SCATTER, STATED_ERRORS = "noise", "scatter", "stated"
LEVEL, CURVE, DIFFERENCE = "level", "curve", "difference"
PRIORS: Final = {
    NOISE: Size(1.0, 0.5, largest=20.0),  # the standard errors are right within a half
    SCATTER: Size(3.0e-3, 1.5, largest=0.3),
    CURVE: Size(0.045, 0.75, largest=3.0),  # curvatures of ln mu over ln f_N of about 0.1
    DIFFERENCE: Size(0.03, 1.0, largest=3.0),  # slopes differ by some hundredths
    STATED_ERRORS: Size(1.0, 1.0, largest=1.0),
}
AS_STATED: Final = {STATED_ERRORS: 1.0}
LEAST_NOISE: Final = 0.5  # few runs may fit by chance
LARGE: Final = 3.0e-2  # size of one effect at the start of a search, the others being small
SMALL: Final = 1.0e-3
GRID: Final = np.geomspace(1.0e-5, 0.3, 60)  # sizes over which the square of an effect is averaged


@dataclass(frozen=True, slots=True)
class Solution:
    """The estimate of the surface, corrected for effects but not for stated errors.

    Attributes
    ----------
    coordinates : ndarray, shape (q,)
        Coordinates h of the surface.
    gain : ndarray, shape (q, n)
        Their derivatives with respect to the data in standard errors.
    covariance : ndarray, shape (q, q)
        Covariance of h by noise, by scatter and by what is smoothed away, without the effects.
    effects : ndarray, shape (K,)
        Numbers of all effects.
    effects_covariance : ndarray, shape (K, K)
        Their covariance, with the stated errors as large as stated.
    shifts : ndarray, shape (n,)
        Shift of the data by the effects.
    residual : ndarray, shape (n,)
        Data that neither surface, effects nor stated errors explain, over the noise.
    stated : ndarray, shape (K',)
        Stated errors as the runs show them, in units of their standard uncertainties.
    determined : float
        Number of unknowns that the data determine.
    """

    coordinates: Array
    gain: Array
    covariance: Array
    effects: Array
    effects_covariance: Array
    shifts: Array
    residual: Array
    stated: Array
    determined: float


@dataclass(frozen=True, slots=True)
class LinearRuns:
    """The runs, linearised about simulated ones, in units of their standard errors.

    Attributes
    ----------
    y : ndarray, shape (n,)
        Measured less simulated ln mu plus X h of the simulated surface.
    X : ndarray, shape (n, q)
        Derivatives with respect to the coordinates of the surface.
    parts : mapping of str to slice
        Columns of X of each part of the surface.
    response : ndarray, shape (n,)
        Sensitivity to a factor on the surface.
    effects : tuple of Effect
        The effects, their columns in standard errors.
    stated : ndarray, shape (n, K')
        Changes by one standard uncertainty of each error that runs share.
    """

    y: Array
    X: Array
    parts: Mapping[str, slice]
    response: Array
    effects: tuple[Effect, ...]
    stated: Array

    def model(self, known: Sizes | None = None) -> Mixed:
        """Build the mixed model, with some sizes known."""
        columns = {part: self.X[:, place] for part, place in self.parts.items()}
        columns |= {effect.key: effect.columns for effect in self.effects}
        columns[STATED_ERRORS] = self.stated
        priors = {**PRIORS, **{effect.key: effect.size for effect in self.effects}}
        priors |= {name: Size(size) for name, size in (known or {}).items()}
        # a run is a group by itself: its noise is independent of the others
        shared = [
            Shared(name, Z[:, None, :], priors.get(name))
            for name, Z in columns.items()
            if Z.shape[1]
        ]
        noise = {NOISE: np.ones(self.y.size), SCATTER: self.response}
        own = [Own(name, priors[name], diagonal=sd[:, None]) for name, sd in noise.items()]
        return Mixed(self.y[:, None], shared, own)

    def choose(self, start: Sizes) -> dict[str, float]:
        """Find the sizes, from those chosen before, or from several starts without any."""
        found = _best(self.model(), start)
        if found.sizes[NOISE] < LEAST_NOISE:
            found = _best(self.model({NOISE: LEAST_NOISE}), {**found.sizes, NOISE: LEAST_NOISE})
        sizes = dict(found.sizes)
        for effect in self.effects:
            sizes[effect.key] = _root_mean_square(found, effect)
        return sizes

    def log_evidence_for(self, keys: Collection[str]) -> float:
        """Compute the log of the probability ratio of the data with and without some effects.

        All sizes are chosen again without them, as others may explain the same; what stated errors
        explain is no evidence for anything else, even if the runs do not show them.
        """
        others = tuple(effect for effect in self.effects if effect.key not in keys)
        models = (self, replace(self, effects=others))
        with_them, without = (_best(runs.model(AS_STATED), {}) for runs in models)
        return with_them.log_evidence - without.log_evidence

    def stated_errors(self, sizes: Sizes) -> tuple[Array, Array]:
        """Return mean and standard deviation of each stated error (K',), of unit size before."""
        if not self.stated.shape[1]:
            return np.zeros(0), np.zeros(0)
        known = {name: size for name, size in sizes.items() if name != STATED_ERRORS}
        mean, covariance = self.model(AS_STATED).at(known).of(STATED_ERRORS)
        return mean, np.sqrt(np.diag(covariance))

    def variance(self, sizes: Sizes) -> Array:
        """Return the noise variance of each run (n,), in units of its squared standard error."""
        return sizes[NOISE] ** 2 + np.square(sizes[SCATTER] * self.response)

    def prior_variance(self, sizes: Sizes) -> Array:
        """Return the prior variance of the coordinates (q,); zero where they are free."""
        variance = np.zeros(self.X.shape[1])
        for part in (CURVE, DIFFERENCE):
            if part in self.parts:
                variance[self.parts[part]] = sizes.get(part, 0.0) ** 2
        return variance

    def solve(self, sizes: Sizes) -> Solution:
        """Estimate surface, effects and stated errors with given sizes."""
        v, q = self.variance(sizes), self.X.shape[1]
        full = self.model().at(sizes)
        alone = self._surface_alone(sizes)
        Z = np.hstack([np.zeros((v.size, 0)), *(effect.columns for effect in self.effects)])
        effects = slice(q, q + Z.shape[1])
        gains = full.covariance @ np.hstack([self.X, Z, self.stated]).T / v
        gain = alone.covariance @ self.X.T / v
        gain = gain - (gain @ Z) @ gains[effects]
        smoothed = (np.eye(q) - gain @ self.X) * np.sqrt(self.prior_variance(sizes))
        missed = gains[effects] @ self.stated
        doubt = 1.0 - sizes.get(STATED_ERRORS, 1.0) ** 2
        values = gains[effects] @ self.y
        return Solution(
            coordinates=gain @ self.y,
            gain=gain,
            covariance=(gain * v) @ gain.T + smoothed @ smoothed.T,
            effects=values,
            effects_covariance=full.covariance[effects, effects] + doubt * missed @ missed.T,
            shifts=Z @ values,
            residual=full.residual[:, 0] / np.sqrt(v),
            stated=full.mean[effects.stop :],
            determined=float(np.trace(gain @ self.X) + np.trace(gains[effects] @ Z)),
        )

    def misfit(self, residual: Array, coordinates: Array, sizes: Sizes) -> float:
        """Compute the penalised misfit ``r' v^-1 r + h' P h``.

        `residual` (n,) is measured minus simulated ln mu minus the effects, over standard errors.
        It may come from a nonlinear model.
        """
        prior = self.prior_variance(sizes)
        smooth = prior > 0.0
        penalty = np.sum(np.square(coordinates[smooth]) / prior[smooth])
        return float(residual @ (residual / self.variance(sizes)) + penalty)

    def explained(self, columns: Array, sizes: Sizes) -> Array:
        """Compute the share of columns (n, k) that the surface can explain, shape (k,).

        ``1 - z' V^-1 z / z' v^-1 z``, v the variance of the noise and V that of the runs by noise
        and surface: a squared multiple correlation with the columns of the surface, within the
        limits of its smoothness. 1 minus this share is the inverse of the variance inflation
        factor. The level, which the surface always explains, is subtracted from z first.
        """
        level, v = self.response, self.variance(sizes)
        columns = columns - np.outer(level, (level / v) @ columns / (level @ (level / v)))
        weighted = columns / v[:, None]
        projected = self.X.T @ weighted
        explained = np.sum(projected * (self._surface_alone(sizes).covariance @ projected), axis=0)
        total = np.sum(columns * weighted, axis=0)
        return np.asarray(explained / np.where(total > 0.0, total, 1.0))

    def _surface_alone(self, sizes: Sizes) -> Posterior:
        """Return the posterior without effects and stated errors."""
        alone = replace(self, effects=(), stated=self.stated[:, :0]).model()
        return alone.at({name: size for name, size in sizes.items() if name in alone.names})


def _best(model: Mixed, start: Sizes) -> Posterior:
    """Fit from a start or, without one, from the medians and from each effect large in turn.

    A run-in over a campaign sorted by arcs is explained by the order or by the arcs: the evidence
    may have several maxima.
    """
    effects = [name for name in model.names if name not in PRIORS]
    starts = [start] if start else [{}]
    if not start and len(effects) > 1:
        small = dict.fromkeys(effects, SMALL)
        starts += [{**small, name: LARGE} for name in effects]
    fits = [model.fit({k: s for k, s in one.items() if k in model.names}) for one in starts]
    return max(fits, key=lambda fit: fit.log_evidence)


def _root_mean_square(found: Posterior, effect: Effect) -> float:
    """Return the root of the posterior mean square of the size of an effect, the others fixed.

    With the precision L and the pull b that the data alone put on its numbers, the likelihood of a
    size s is ``|1 + s² L|^(-1/2) exp(b' (L + 1/s²)^-1 b / 2)``.
    """
    mean, covariance = found.of(effect.key)
    inverse = np.linalg.inv(covariance)
    L, vectors = np.linalg.eigh(inverse - np.eye(mean.size) / found.sizes[effect.key] ** 2)
    signal = np.square(vectors.T @ inverse @ mean)
    growth = 1.0 + np.square(GRID)[:, None] * np.maximum(L, 0.0)
    terms = np.square(GRID)[:, None] * signal / growth - np.log(growth)
    before = np.square(np.log(GRID / effect.size.median) / effect.size.width)
    log_density = 0.5 * (terms.sum(axis=1) - before)
    density = np.exp(log_density - log_density.max())
    return float(np.sqrt(density @ np.square(GRID) / density.sum()))

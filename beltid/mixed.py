"""Estimate with a linear mixed model: wanted parameters, random effects of unknown size, noise.

One or several groups r of data (the runs of a bench; all data of a campaign as one group) follow

    y_r = l_r o_r + X_r h(q) + sum_e s_e Z_er u_er,     u_er ~ N(0, 1),     q ~ prior           (M1)

with a free level l_r of each group, coefficients h that all groups share, and effects (and noise)
of each group by itself, which only enlarge its covariance V_r = sum_e s_e² K_er, K_er = Z_er Z_er'.

The sizes maximise the restricted likelihood (REML) times their priors, by L-BFGS: with the residual
e = y - X h, the projection P that takes out the levels, and the covariance C of the coefficients,

    d log L / d ln s_e = s_e² sum_r tr[K_er (P e e' P + P X C X' P - P)]                        (M2)

(Fisher's identity); where h = exp q, the shift of the mode by s_e adds a term. A size that too few
columns show is averaged over a few values (`choices`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg.lapack import dposv
from scipy.optimize import minimize

from beltid.arrays import Array
from beltid.errors import NumericsError

NEWTON, SETTLED, SHRINK = 200, 1e-8, 0.9
"""Most steps of Newton's method, decrease of the cost at its end, largest relative fall of h."""
LEAST_CURVED = 1e-4  # least magnitude of a curvature there, in units of its diagonal
SMALLEST = -300.0  # ln of a size, whose inverse square is still a number
UPHILL = 1e3  # added to the largest cost found where none can be computed
FAR = 8.0  # widths of its prior below which no noise is searched: the model is singular there


@dataclass(frozen=True, slots=True)
class Size:
    """Log-normal prior of a standard deviation, in the unit of its effect."""

    median: float  # median, > 0
    width: float = 0.0  # standard deviation of the logarithm; 0 if the size is known
    largest: float = np.inf  # upper limit


@dataclass(frozen=True, eq=False)
class Shared:
    """Columns whose coefficients all groups share."""

    name: str  # name of the term
    columns: Array  # change of the data by each coefficient, (R, m, k)
    size: Size | None = None
    """Standard deviation s of the coefficients, independent unless `precision` is given."""
    precision: Array | None = None
    """Inverse covariance of the coefficients over s²; it may be singular (a measure of roughness).
    Without size and precision the prior is flat, (k, k)."""
    mean: float | Array = 0.0  # mean of the prior, (k,)
    positive: bool = False  # whether h = exp(q): prior and `mean` are then those of the logarithm
    choices: Sequence[tuple[float, float]] = ()
    """Values of s with their probabilities, in place of `size`."""


@dataclass(frozen=True, eq=False)
class Own:
    """An effect, or noise, of every group by itself. Give one of the three shapes."""

    name: str  # name of the term
    size: Size  # its standard deviation s
    columns: Array | None = None  # z: the covariance is s² Z Z', (R, m, k)
    diagonal: Array | None = None  # standard deviations of independent noise over s, (R, m)
    covariance: Array | None = None  # covariance over s², (R, m, m)

    def per_unit(self, groups: int, rows: int) -> Array:
        """Return the covariance at s = 1, shape (R, m, m)."""
        if self.columns is not None:
            Z = np.reshape(self.columns, (groups, rows, -1))
            return np.asarray(Z @ Z.transpose(0, 2, 1))
        if self.diagonal is not None:
            variance = np.square(np.reshape(self.diagonal, (groups, rows, 1)))
            return np.asarray(variance * np.eye(rows))
        return np.asarray(self.covariance, dtype=float).reshape(groups, rows, rows)


class Posterior:
    """What the data tell of the coefficients h, (k,), term by term, and of the levels (R,).

    `theta` are the logarithms of the sizes.
    """

    def __init__(self, model: "Mixed", theta: Array, converged: bool = True) -> None:
        self.converged = converged  # whether the search for the sizes ended
        self.model, self.theta = model, np.maximum(theta, SMALLEST)
        n_shared = theta.size - len(model.own)
        variances, scale = np.exp(2.0 * self.theta[n_shared:]), model.scale
        V = model.padding + np.tensordot(variances, model.parts, axes=1)
        P, log_det = np.linalg.inv(V), np.linalg.slogdet(V)[1]
        freedom = V.shape[1] - np.einsum("rii->r", model.padding)
        weights = np.einsum("rij,rj->ri", P, model.one)
        precision = np.sum(model.one * weights, axis=1)
        has_level = precision > 0.0
        precision = np.where(has_level, precision, 1.0)
        self.level_weights = weights / precision[:, None]  # of the data in the level, (R, m)
        # projection of (M2), at a scale of one, (R, m, m)
        self.P = P = P - weights[:, :, None] * self.level_weights[:, None, :]
        log_det, freedom = log_det + np.log(precision), freedom - has_level
        PX = (P / scale[:, None, None]) @ model.X
        M = np.tensordot(model.X, PX, axes=((0, 1), (0, 1)))
        squares = np.einsum("ri,rij,rj->r", model.y, P, model.y) / scale
        mean, C, moment, log_z, bent, outward = model.coefficients(
            M, np.einsum("rij,ri->j", PX, model.y), self.theta[:n_shared]
        )
        self.mean, self.covariance = mean, C  # of the coefficients, (k,), (k, k)
        # data without the shared columns, about their levels, which P takes out, (R, m)
        self.residual = residual = model.y - model.X @ mean
        Pe = np.einsum("rij,rj->ri", P, residual)
        self.misfit = np.sum(residual * Pe, axis=1)  # a chi-square, given the sizes, (R,)
        # levels at the mean of the coefficients, their variance by what is their own, and their
        # change by errors of the coefficients, (R, k)
        self.level = model.offset + np.einsum("ri,ri->r", self.level_weights, residual)
        self.level_variance = scale / precision
        self.level_shift = np.einsum("ri,rik->rk", self.level_weights, model.X)
        away = model.tightness * (self.theta - model.mid)
        likelihood = -0.5 * float(np.sum(squares + log_det + freedom * np.log(scale)))
        # log marginal likelihood times the priors of the sizes, less a constant if h is flat; and
        # its slope over ln s, (M2)
        self.log_evidence = log_z + likelihood - 0.5 * float(away @ away)
        spread = Pe[:, :, None] * (Pe / scale[:, None])[:, None, :]
        spread += scale[:, None, None] * ((PX @ (C - bent)) @ PX.transpose(0, 2, 1))
        lean = (PX @ outward)[:, :, None] * Pe[:, None, :]
        spread += lean + lean.transpose(0, 2, 1)
        self.slope = -model.tightness * away
        self.slope[n_shared:] += variances * np.tensordot(model.parts, spread - P, axes=3)
        for i, (place, unit, rank) in enumerate(model.sized):
            of_prior = np.sum(unit * moment[place, place]) * np.exp(-2.0 * self.theta[i])
            self.slope[i] += of_prior - rank

    @property
    def sizes(self) -> dict[str, float]:
        """Standard deviation s of every term that has one."""
        return dict(zip(self.model.names, np.exp(self.theta).tolist(), strict=True))

    def of(self, name: str) -> tuple[Array, Array]:
        """Return mean and covariance of the coefficients of a term."""
        place = self.model.places[name]
        return self.mean[place], self.covariance[place, place]

    def step(self, share: float) -> Array | None:
        """Return the coefficients of the first term; None if all are below a share of their sd."""
        mean, covariance = self.of(self.model.shared[0].name)
        return None if np.all(np.abs(mean) <= share * np.sqrt(np.diag(covariance))) else mean


def root(C: Array) -> Array:
    """Return a factor F of a covariance, C = F F', which may be singular, shape (k, k)."""
    scale = np.sqrt(np.maximum(np.diag(C), 1e-300))
    values, vectors = np.linalg.eigh(C / np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


class Mixed:
    """Data and terms of the model (M1).

    The data `y` are those of R groups (R, m), or of one group (n,); shorter groups are padded with
    rows that are zero everywhere. `level` is the column of the free level of every group, zero for
    groups without; `scale` (R,) the factor of their covariances.
    """

    def __init__(
        self,
        y: ArrayLike,
        shared: Sequence[Shared],
        own: Sequence[Own],
        level: ArrayLike | None = None,
        scale: ArrayLike = 1.0,
    ) -> None:
        self.y = np.atleast_2d(np.asarray(y, dtype=float))
        R, m = self.y.shape
        self.shared, self.own = tuple(shared), tuple(own)
        columns = [np.reshape(term.columns, (R, m, -1)) for term in self.shared]
        self.X = np.concatenate([np.zeros((R, m, 0)), *columns], axis=2)
        ends = np.cumsum([0, *(c.shape[2] for c in columns)])
        self.places = {t.name: slice(a, b) for t, a, b in zip(shared, ends, ends[1:], strict=False)}
        self.one = (np.zeros((R, m)) if level is None else np.asarray(level, float)).reshape(R, m)
        squares = np.sum(self.one**2, axis=1)
        # levels are taken off the data: fewer digits are lost
        self.offset = np.sum(self.one * self.y, axis=1) / np.where(squares > 0.0, squares, 1.0)
        self.y = self.y - self.offset[:, None] * self.one
        self.scale = np.broadcast_to(np.asarray(scale, dtype=float), (R,))
        self.parts = np.array([term.per_unit(R, m) for term in self.own])
        # a row without any variance is padding: it gets a variance of its own and tells nothing
        self.padding = ~np.any(np.einsum("krii->kri", self.parts), axis=0)[..., None] * np.eye(m)
        self.m0, self.positive = np.zeros(ends[-1]), np.zeros(ends[-1], dtype=bool)
        options = list(product(*(term.choices or [(1.0, 1.0)] for term in self.shared)))
        self.log_prior = np.zeros(len(options))
        self.Q = np.zeros((len(options), *2 * self.m0.shape))
        self.sized: list[tuple[slice, Array, int]] = []  # terms whose precision is not in Q
        for term, chosen in zip(self.shared, zip(*options, strict=True), strict=False):
            place, (s, chance) = self.places[term.name], np.transpose(chosen)
            self.m0[place], self.positive[place] = term.mean, term.positive
            unit = np.eye(place.stop - place.start) * (term.size is not None or bool(term.choices))
            unit = unit if term.precision is None else term.precision
            values = np.linalg.eigvalsh(unit)
            values = values[values > 1e-10 * values.max(initial=0.0)]
            self.Q[:, place, place] = unit / s[:, None, None] ** 2
            self.log_prior += (
                np.log(chance) + 0.5 * np.sum(np.log(values)) - values.size * np.log(s)
            )
            if term.size is not None:
                self.sized.append((place, unit, values.size))
        terms: list[Shared | Own] = [*self.shared, *self.own]
        sized = {t.name: t.size for t in terms if t.size is not None}
        self.names, sizes = [*sized], sized.values()
        self.mid, self.top = np.log([(size.median, size.largest) for size in sizes]).T
        self.tightness = np.array([1.0 / s.width if s.width > 0.0 else 0.0 for s in sizes])
        self.q = np.where(self.positive, self.m0, 0.0)[None]  # modes found last

    def without_first(self) -> "Mixed":
        """Return the model without its first shared term: its coefficients are zero."""
        return Mixed(self.y, self.shared[1:], self.own, self.one, self.scale)

    def fit(
        self, start: Mapping[str, float] | None = None, steps: int = 200, tolerance: float = 1e-9
    ) -> Posterior:
        """Find the sizes, from `start` or else the medians of the priors; return the posterior.

        At most `steps` of L-BFGS, to a relative change `tolerance` of the log posterior. Raises
        `NumericsError` if the data do not determine a flat coefficient.
        """
        theta = np.minimum(self.mid, self.top)
        theta, free = self._with(theta, start or {}), self.tightness > 0.0
        if not free.any():
            return self.at({})

        costs = list[float]()

        def cost(x: Array) -> tuple[float, Array]:
            theta[free] = x
            try:
                posterior = Posterior(self, theta)
            except NumericsError:
                if not costs:
                    raise
                # a trial so far off that the covariance is singular: the search steps back
                return max(costs) + UPHILL, np.zeros(x.size)
            costs.append(-posterior.log_evidence)
            return costs[-1], -posterior.slope[free]

        # not of every size: a box that is closed all around lets the first step go anywhere
        lowest = self.mid - np.divide(FAR, self.tightness, out=np.zeros(free.size), where=free)
        lowest[: free.size - len(self.own)] = -np.inf
        bounds = np.column_stack([lowest, self.top])[free]
        found = minimize(
            cost,
            theta[free],
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            options={"maxiter": steps, "ftol": tolerance, "gtol": 1e-6},
        )
        theta[free] = found.x
        return Posterior(self, theta, bool(found.success))

    def at(self, sizes: Mapping[str, float], converged: bool = True) -> Posterior:
        """Return the posterior for given sizes; the medians of the priors for those not given."""
        return Posterior(self, self._with(self.mid, sizes), converged)

    def _with(self, theta: Array, sizes: Mapping[str, float]) -> Array:
        known = {name: float(np.log(size)) for name, size in sizes.items()}
        return np.array([known.pop(n, x) for n, x in zip(self.names, theta, strict=True)])

    def coefficients(
        self, M: Array, b: Array, theta: Array
    ) -> tuple[Array, Array, Array, float, Array, Array]:
        """Average over the choices: mean and covariance of h, moment of q, log evidence."""
        Q, log_prior = self.Q.copy(), self.log_prior
        for (place, unit, rank), log_s in zip(self.sized, theta, strict=True):
            Q[:, place, place] = unit / np.exp(log_s) ** 2
            log_prior = log_prior - rank * log_s
        means, covariances, moments, log_z, shifts = self._laplace(M, b, Q)
        log_z = log_z + log_prior
        total = float(np.logaddexp.reduce(log_z))
        w = np.exp(log_z - total)
        mean = w @ means
        away = means - mean
        C = np.tensordot(w, covariances, 1) + away.T @ (w[:, None] * away)
        bent = away.T @ (w[:, None] * shifts)
        return mean, C, np.tensordot(w, moments, 1), total, bent + bent.T, w @ shifts

    def _laplace(self, M: Array, b: Array, Q: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Find the mode of h for every prior precision Q (K, k, k), by Newton's method."""
        positive, one = self.positive, np.eye(b.size)
        q = self.q if len(self.q) == len(Q) else np.tile(self.q[0], (len(Q), 1))
        value, h, slope, pull = self._cost(q, M, b, Q)
        for turn in range(NEWTON):
            # along ln(1 + step) of a positive coefficient, h and so the data change linearly
            D = np.where(positive, h, 1.0)
            H = D[:, :, None] * M * D[:, None, :] + Q
            if not positive.any():
                q = q - _solve(H, slope[..., None])[0][..., 0]
                value, h, _, pull = self._cost(q, M, b, Q)
                break
            try:
                step = -_solve(H - one * (positive * pull)[..., None], slope[..., None])[0][..., 0]
            except NumericsError:  # not convex here, or even a saddle
                convex = H - one * (positive * np.minimum(pull, 0.0))[..., None]
                if turn > NEWTON // 2:
                    convex = _absolute(H - one * (positive * pull)[..., None])
                step = -_solve(convex, slope[..., None])[0][..., 0]
            fall = -step[:, positive].min(axis=1, initial=0.0)
            part = np.minimum(1.0, SHRINK / np.maximum(fall, 1e-12))
            while True:
                log_step = np.log1p(part[:, None] * np.where(positive, step, 0.0))
                trial = q + np.where(positive, log_step, part[:, None] * step)
                new, h, slope, pull = self._cost(trial, M, b, Q)
                worse = (new > value + 1e-12 * np.abs(value)) & (part > 1e-9)
                if not worse.any():
                    break
                part = np.where(worse, 0.5 * part, part)
            decrease, q, value = value - new, trial, new
            if np.all(decrease < SETTLED * np.maximum(1.0, np.abs(value) * 1e-3)):
                break
        else:
            raise NumericsError(f"mixed model: no mode found in {NEWTON} steps")
        self.q = q
        D, away = np.where(positive, h, 1.0), q - self.m0
        H = D[:, :, None] * M * D[:, None, :] + Q
        curved = H - one * (positive * pull)[..., None]
        inverse, log_det = _solve(H, np.broadcast_to(one, H.shape))
        # the determinant changes with the mode, too: its slope by q, through the Hessian there
        by_mode = np.where(positive, 1.0 - np.sum(inverse * Q, axis=2), 0.0)
        shift = np.linalg.solve(curved, by_mode[..., None])[..., 0]
        moment = (away - shift)[:, :, None] * away[:, None, :] - away[:, :, None] * shift[:, None]
        C = D[:, :, None] * inverse * D[:, None, :]
        return h, C, inverse + moment, -value - 0.5 * log_det, D * shift

    def _cost(self, q: Array, M: Array, b: Array, Q: Array) -> tuple[Array, Array, Array, Array]:
        """Return minus the log density of q (K, k), h(q), its slope by q, and that of the prior."""
        h, away = np.where(self.positive, np.exp(np.where(self.positive, q, 0.0)), q), q - self.m0
        Mh, pull = h @ M, (Q @ away[..., None])[..., 0]
        slope = np.where(self.positive, h, 1.0) * (Mh - b) + pull
        return 0.5 * np.sum(h * Mh + away * pull, axis=1) - h @ b, h, slope, pull


def _absolute(H: Array) -> Array:
    """Return matrices (K, k, k) with the magnitudes of the curvatures of H."""
    scale = np.sqrt(np.maximum(np.abs(np.einsum("kii->ki", H)), 1e-300))[..., None]
    curvature, V = np.linalg.eigh(H / scale / scale.swapaxes(1, 2))
    size = np.maximum(np.abs(curvature), LEAST_CURVED)[:, None]
    return np.asarray(scale * ((V * size) @ V.swapaxes(1, 2)) * scale.swapaxes(1, 2))


def _solve(H: Array, B: Array) -> tuple[Array, Array]:
    """Solve with positive definite H (K, k, k), which is overwritten, and B (K, k, n); ln det H."""
    X = np.empty(B.shape)
    for A, b, x in zip(H, B, X, strict=True) if X.size else ():
        _, x[:], failed = dposv(A.T, b, overwrite_a=True)
        if failed:
            raise NumericsError("mixed model: the data do not determine a flat coefficient")
    return X, 2.0 * np.sum(np.log(np.einsum("kii->ki", H)), axis=1)


def relinearised(
    build: Callable[[Array], Mixed], p: ArrayLike, steps: int = 50, sweeps: int = 10
) -> tuple[Array, Posterior]:
    """Fit data that depend on p in a nonlinear way: y = f(p) + effects + noise.

    `build` maps p to a model of the data less f(p), whose first shared term holds the derivative of
    f; if p has a prior, that of this term is about prior mean - p. Gauss–Newton's steps at given
    sizes (at most `steps`) and the sizes at a given p take turns (at most `sweeps`), from a first
    guess; a step is halved until the likelihood grows. Returns the mode and the posterior there,
    whose first term has the covariance of p. Raises `NumericsError` if p or the sizes do not
    settle.
    """
    p, sizes = np.asarray(p, dtype=float), dict[str, float]()
    for _ in range(sweeps):
        p = _mode(build, p, sizes, steps)
        before, posterior = sizes, build(p).fit(start=sizes)
        sizes = posterior.sizes
        if before and posterior.step(0.02) is None:
            return p, posterior
    raise NumericsError(f"mixed model: the sizes of the effects do not settle in {sweeps} turns")


def _mode(
    build: Callable[[Array], Mixed], p: Array, sizes: Mapping[str, float], steps: int
) -> Array:
    """Take steps of Gauss–Newton at given sizes."""
    model = build(p)
    value = model.without_first().at(sizes).log_evidence
    for _ in range(steps):
        step = model.at(sizes).step(1e-3)
        if step is None:
            return p
        for _ in range(30):
            model = build(p + step)
            new = model.without_first().at(sizes).log_evidence
            if new >= value:
                break
            step = 0.5 * step
        else:
            return p
        p, value = p + step, new
    raise NumericsError(f"mixed model: no mode found in {steps} steps of Gauss–Newton")

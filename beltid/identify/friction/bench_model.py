"""All runs of a bench in two mixed models: their levels with what they share, and their cells.

The block means z of ln(T_tight/T_slack) of run r follow (M1) of :mod:`beltid.mixed`,

    z_r = y_r [1 + T_r(x)] + L_r + N_r + c_r (w + u),  T_r(x) = sum_k A_k exp(-x/(l_k s_r^p)),  (S2)

with the level y = mu beta (flat prior) and, shared by all runs, the spectrum A_k = exp(eta_k) of
the sticking peak's tail over the travel x, whose logarithm is smooth; a power p of the settings s
(speed, tension, level) in its length; drifts and slow decays L. N is a run's own: ripples, the rest
of the build-up, height and length of its tail. The noise is white, w, plus zeros that wander, u:
Ornstein–Uhlenbeck processes of several memories. c is the sensitivity of z to a newton at a cell.

The difference of the cells of run r at rest (tight less slack), and the error of z by the cells are

    D_r = d_r (zeta + w_r + (gamma + g) T_r) + (h + f_r) T_r + noise,                          (S3)
    e_r = d_r [q_r (zeta + w_r) + gamma],   q_r = (1/T_tight + 1/T_slack)/2,                   (S4)

with zeros zeta of all runs and w of one, gains that differ by gamma, and shares of the tension that
friction holds at rest: h in all runs towards the span that will pull, g towards one side of the
bench, f in each; w or f is zero, and both models are averaged. d = -1 where the pulley turns the
other way. So the rest shows zeros, but no gain, unless the belt was rocked free (`free_at_rest`);
runs in both directions show it. The sizes, and why they are as they are: docs/theory.md.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from functools import cached_property

import numpy as np
from scipy.special import softmax

from beltid.arrays import Array
from beltid.identify.friction.prepare import Rest, SlidingRecord, block_starts
from beltid.identify.friction.run import RunReduction
from beltid.mixed import Mixed, Own, Posterior, Shared, Size, root

MEMORIES_S = np.array([0.04, 0.16, 0.64, 2.5, 20.0])
"""Correlation times of the wandering zeros; the longest is a walk, measured from the rest."""
LENGTHS_M = np.geomspace(3e-4, 0.3, 20)  # lengths l_k of the exponentials of a tail
USUAL_M = 2.5e-3  # usual length of a tail
FREE = 0.1  # standard deviation of ripples and of the rest of the build-up, in z: practically free
OVER_TRAVEL, OVER_TIME, POWER = np.array([[0.0, 0.2, 0.2], [1.0, 0.2, 0.2], [0.2, 0.3, 0.3]])
"""Usual powers of speed, tension and level in the length of a tail, which grows with the force that
builds up, and their standard deviations."""
RUNS = 32  # evenly chosen runs that determine the sizes; more would add nothing
FREEDOM = 20.0  # degrees of freedom of the prior that ties the noise of a run to that of its bench
ZEROS = ((3e-6, 0.92), (2e-4, 0.04), (6e-4, 0.04))
"""Sizes of the drifts of the zeros that all runs share [T0/s], with their probabilities; the same
of friction released and relaxation at rest [1/s], of a drift of mu, of slow decays [-]."""
RELEASE = ((1e-7, 0.97), (3e-3, 0.03))
RELAXATION = ((1e-6, 0.95), (2e-3, 0.05))
DRIFT = ((3e-4, 0.98), (3e-2, 0.02))
DECAY = ((1e-3, 0.95), (5e-2, 0.05))
FIRST_WAVE = 0.01  # first guess of a wave once per turn: much smaller ones have no slope
FIRST_STEPS, STEPS = 15, 100  # of the search for the sizes in the first turn, and in the second


def block_covariance(first: Array, last: Array, count: Array, tau: Array) -> Array:
    """Compute covariances of block means of unit Ornstein–Uhlenbeck processes, (k, m, m).

    From first and last of evenly spaced samples [s] and their number (m,); correlation times [s].
    """
    memory = np.asarray(tau, dtype=float)[:, None]
    step = np.where(count > 1, (last - first) / np.maximum(count - 1, 1), 1.0) / memory
    rho, left = np.exp(-step), -np.expm1(-step)
    total = -np.expm1(-count * step) / left  # sum of rho^k over the block
    share = total / count
    gap = np.maximum(first[None, :] - last[:, None], 0.0) / memory[..., None]
    upper = np.triu(share[:, :, None] * share[:, None, :] * np.exp(-gap), 1)
    covariance, i = upper + np.swapaxes(upper, 1, 2), np.arange(count.size)
    within = (count * (1.0 + rho) / left - 2.0 * rho * total / left) / count**2
    covariance[:, i, i] = np.where(count > 1, within, 1.0)
    return np.asarray(covariance)


def slope_variance(rest: Rest) -> Array:
    """Compute variances of the slope of unit Ornstein–Uhlenbeck processes at rest [1/s²], (k,)."""
    n, starts = rest.n_samples, block_starts(rest.n_samples)
    count, step = np.diff(np.append(starts, n)), (rest.last_s - rest.first_s) / max(n - 1, 1)
    first, last = step * starts, step * (starts + count - 1)
    away = 0.5 * (first + last - step * (n - 1))
    weights = count * away / max(float(count @ away**2), 1e-300)
    return np.asarray(weights @ block_covariance(first, last, count, MEMORIES_S) @ weights)


def log_settings(records: Sequence[SlidingRecord]) -> Array:
    """Return ln of the settings that may affect the length of the tail (R, 3)."""
    speeds = [np.ptp(r.travel) / max(np.ptp(r.middle_s), 1e-12) for r in records]
    tensions = [np.sqrt(np.prod(r.tensions_N)) for r in records]
    return np.log(np.column_stack([speeds, tensions, [r.level for r in records]]))


class Bench:
    """Runs of a bench and what they share; z of run k after its tail is `posterior.level`.

    Arrays are those of the model, over the sensitivity c: newtons at a cell. A run has as many
    rows as the longest record, and two for the slopes at rest. `powers` are those of the settings
    in the length of the tail, `A` is its spectrum, `scale` the noise of each run over the bench's.
    """

    posterior: Posterior
    mean: Array  # of the levels, over the likely models of these runs, (R,)
    variance: Array  # of the part of their errors that is a run's own, (R,)
    doubt: Array  # their errors by the choice of a model, and of a time where mu drifts, (R, k)

    def __init__(self, records: Sequence[SlidingRecord], centre: Array) -> None:
        R, m, k = len(records), max(r.z.size for r in records) + 2, MEMORIES_S.size
        self.records, self.settings = records, log_settings(records) - centre
        self.level = np.array([r.level for r in records])
        self.c = np.array([r.sensitivity for r in records])
        self.y, self.one, self.white, self.travel = np.zeros((4, R, m))
        self.zeros, self.drift, self.decay = (np.zeros((R, m, n)) for n in (4, 1, 4))
        self.fixed, self.memory = np.zeros((R, m, m)), np.zeros((k, R, m, m))
        self.turn, self.rest = np.zeros((2, R, m, 2))
        # zeros drift by as much in a second, or in each record
        lengths_s = np.array([r.last_s[-1] - r.rest.first_s for r in records])
        pace = np.column_stack([np.ones(R), np.median(lengths_s) / lengths_s]) / np.sqrt(2.0)
        middle_level, T0 = np.median(self.level), np.median([r.rest.tension_N for r in records])
        for i, r in enumerate(records):
            b, c, rest = slice(2, r.z.size + 2), r.sensitivity, r.rest
            unit, mid = r.level / c, r.middle_s
            self.y[i, b], self.one[i, b], self.travel[i, b] = r.z / c, 1.0 / c, r.travel
            self.white[i, b] = r.noise_N / np.sqrt(r.count)
            since_rest = mid - 0.5 * (rest.first_s + rest.last_s)
            self.zeros[i, b] = np.outer(since_rest, T0 * np.kron(pace[i], r.zero_shifts) / c)
            # if friction drifts, mu_sliding is that of the middle of the second half of the run
            elapsed = (mid - r.first_s[0]) / (r.last_s[-1] - r.first_s[0])
            self.drift[i, b, 0] = unit * (elapsed - 0.75)
            self.decay[i, b] = unit * r.slow_take_up
            free = np.column_stack([r.waves, r.take_up])
            self.fixed[i, b, b] = (FREE / c) ** 2 * free @ free.T
            V = block_covariance(
                np.append(rest.first_s, r.first_s),
                np.append(rest.last_s, r.last_s),
                np.append(rest.n_samples, r.count),
                MEMORIES_S,
            )
            self.memory[:, i, b, b] = V[:, 1:, 1:]
            self.memory[-1, i, b, b] += V[-1, 0, 0] - V[-1, 0, 1:] - V[-1, 0, 1:, None]
            # a ripple once per turn may go with the friction, thus the level, or with the tensions
            self.turn[i, b] = np.hypot(r.level, middle_level) / np.sqrt(2.0) / c * r.turn
            # difference and sum of the slopes at rest, in units of their errors
            error = np.maximum(rest.slope_ses_N_s, 1e-6 * rest.tension_N)
            self.y[i, :2] = rest.slopes_N_s / error
            self.zeros[i, :2] = T0 * np.kron(pace[i], [[1.0, -1.0], [1.0, 1.0]]) / error[:, None]
            self.rest[i, :2] = rest.tension_N * np.diag(1.0 / error)
            self.fixed[i, [0, 1], [0, 1]] = np.isfinite(error)
            # white noise is in that error; noise that remembers disturbs a slope more
            self.memory[:, i, [0, 1], [0, 1]] = np.outer(2.0 * slope_variance(rest), error**-2.0)
        n = np.array([r.count.sum() for r in records])
        self.typical_N = float(np.median([r.noise_N for r in records] / np.sqrt(n)))
        # noise that is slower than the sliding shows at rest only
        at_rest = [r.rest.imbalance_se_N * np.sqrt(0.5 * r.rest.n_samples) for r in records]
        self.slow_N = max(float(np.median(at_rest / np.sqrt(n))), self.typical_N)
        log_l = np.log(LENGTHS_M / USUAL_M)
        self.eta = np.log(0.05) - 1.5 - 0.5 * log_l**2
        near = np.exp(-0.5 * (np.subtract.outer(log_l, log_l) / 0.8) ** 2)
        self.smooth = np.asarray(np.linalg.inv(4.0 * near + 0.3 * np.eye(log_l.size)), dtype=float)
        self.usual = self.powers = OVER_TRAVEL
        self.A, self.scale = np.exp(self.eta), np.ones(R)

    def tails(self) -> tuple[Array, Array]:
        """Return the exponentials and their derivatives by ln of the length, (R, m, K) each."""
        lengths = LENGTHS_M * np.exp(self.settings @ self.powers)[:, None, None]
        u = self.travel[..., None] / lengths
        columns = np.exp(-u) * (self.one * self.level[:, None])[..., None]
        return columns, u * columns

    def model(self) -> Mixed:
        """Return the model, linear in the powers, with runs' own tails about the spectrum A."""
        columns, slopes = self.tails()
        height, length = columns @ self.A, slopes @ self.A
        by_power = length[..., None] * self.settings[:, None]
        typical_z = self.typical_N * float(np.median(self.c / self.level))
        shared = [
            Shared("tail", columns, Size(1.0, 0.5), self.smooth, self.eta, positive=True),
            Shared("decay", self.decay, choices=DECAY),
            Shared("powers", by_power, None, np.diag(POWER**-2.0), self.usual - self.powers),
            Shared("zeros", self.zeros, choices=ZEROS),
            Shared("drift", self.drift, choices=DRIFT),
            Shared("release", self.rest[..., :1], choices=RELEASE),
            Shared("relaxation", self.rest[..., 1:], choices=RELAXATION),
        ]
        own = [
            Own("free", Size(1.0), covariance=self.fixed),
            Own("white", Size(1.0, 0.15), diagonal=self.white),
            *(
                Own(f"memory {tau:g} s", Size(0.5 * self.slow_N, 2.0), covariance=V)
                for tau, V in zip(MEMORIES_S[:-1], self.memory[:-1], strict=True)
            ),
            Own("walk", Size(4.5 * self.slow_N, 1.5), covariance=self.memory[-1]),
            Own("turn", Size(typical_z, 1.5), columns=self.turn),
            Own("own decay", Size(3e-3, 1.5), columns=self.decay),
            Own("height", Size(0.15, 1.0), columns=height),
            Own("length", Size(0.10, 1.0), columns=length),
            Own("rest", Size(1e-6, 2.0), columns=self.rest),
        ]
        return Mixed(self.y, shared, own, level=self.one, scale=self.scale)

    def update(self, sizes: Mapping[str, float]) -> None:
        """Improve spectrum, powers and noise: a restless run has less weight, none is set aside."""
        freedom = np.sum(self.one > 0.0, axis=1) - 2.0
        for share in (1.0, 0.5):  # full steps alone may lead there and back for ever
            posterior = self.model().at(sizes)
            found = (FREEDOM + posterior.misfit) / (FREEDOM + freedom)
            self.scale = np.asarray(found / np.median(found))
            self.A = self.A ** (1.0 - share) * posterior.of("tail")[0] ** share
            self.powers = self.powers + share * posterior.of("powers")[0]

    def search(self, sizes: Mapping[str, float], steps: int) -> None:
        """Improve the shape of the tail and the noise of the runs, then the sizes."""
        for _ in range(2):
            self.update(sizes)
        self.posterior = self.model().fit(start=sizes, steps=steps, tolerance=1e-6)

    def _decays(self, k: int, travel: Array) -> tuple[Array, Array]:
        """Return columns of z of run k: exponentials and slow decays, and its own effects."""
        u = travel[:, None] / (LENGTHS_M * np.exp(self.settings[k] @ self.powers))
        columns, slow = np.exp(-u), self.records[k].slow_decays(travel)
        own = np.column_stack([columns @ self.A, (u * columns) @ self.A, slow])
        return self.level[k] * np.column_stack([columns, slow]), self.level[k] * own

    @cached_property
    def _own(self) -> tuple[Array, Array, Array]:
        """Own tails and decays: mean (R, 6), covariance, and that with the level."""
        p, tails = self.posterior, np.stack(self.tails(), axis=2) @ self.A
        Z = np.concatenate([tails, self.decay], axis=2)
        S = np.diag([p.sizes[name] ** 2 for name in ("height", "length", *["own decay"] * 4)])
        PZ = p.P @ Z
        mean = np.einsum("rij,ri->rj", PZ, p.residual) @ S
        covariance = S - S @ (Z.transpose(0, 2, 1) @ PZ) @ S
        lean = np.einsum("ri,rij->rj", p.level_weights, Z) @ S
        return mean, covariance * self.scale[:, None, None], lean * self.scale[:, None]

    def tail(self, k: int, travel: Array) -> Array:
        """Return the tail of run k at travels since the end of the build-up [m], shape (n,)."""
        (shared, own), tail = self._decays(k, travel), self.posterior.of("tail")[0]
        return np.asarray(shared[:, : tail.size] @ tail + own[:, :2] @ self._own[0][k, :2])

    def course(self, k: int, travel: Array) -> tuple[Array, Array]:
        """Return z of run k with tail and slow decays at such travels [m], and its errors (n,)."""
        p, (shared, own) = self.posterior, self._decays(k, travel)
        first = slice(shared.shape[1])  # coefficients of the tail and of slow decays
        mean, covariance, lean = (part[k] for part in self._own)
        z = p.level[k] + shared @ p.mean[first] + own @ mean
        variance = p.level_variance[k] - 2.0 * own @ lean + np.sum(own @ covariance * own, axis=1)
        # an error of what all runs share moves level and tail together
        change = np.tile(-p.level_shift[k], (travel.size, 1))
        change[:, first] += shared
        common = np.sum(change @ p.covariance * change, axis=1)
        return z, np.sqrt(np.maximum(variance, 0.0) + common)

    @property
    def shared(self) -> Array:
        """Standard deviations of the levels by errors of tail and drifts, with sign (R, 2)."""
        p, places = self.posterior, self.posterior.model.places
        drifts = slice(places["zeros"].start, places["drift"].stop)
        factor = root(p.covariance)
        error = -p.level_shift @ factor
        drift = np.sum(error * (-p.level_shift[:, drifts] @ factor[drifts]), axis=1)
        # one column stands for all directions: its sign is that of the correlation with the mean
        error = np.hstack([error, self.doubt])
        size = np.linalg.norm(error, axis=1)
        share = np.clip(drift / np.maximum(size**2, 1e-300), 0.0, 1.0)
        size = np.where(error @ error.sum(axis=0) < 0.0, -size, size)
        return size[:, None] * np.sqrt(np.column_stack([1.0 - share, share]))

    def effect(self, name: str) -> Array:
        """Return what an effect of the runs' own changes z by, in the rows of the model (R, m)."""
        p = self.posterior
        parts = p.model.parts[[term.name for term in p.model.own].index(name)]
        Pe = np.einsum("rij,rj->ri", p.P, p.residual)
        return np.asarray(p.sizes[name] ** 2 * self.c[:, None] * np.einsum("rij,rj->ri", parts, Pe))

    @property
    def visible_drift(self) -> Array:
        """Visible change of z by wandering zeros and drift of mu over the sliding (R,)."""
        wander = self.effect(f"memory {MEMORIES_S[-2]:g} s") + self.effect("walk")
        last = [r.z.size + 1 for r in self.records]
        drift = self.posterior.of("drift")[0][0] * self.level
        return np.asarray(wander[np.arange(len(last)), last] - wander[:, 2] + drift)


def fit_bench(records: Sequence[SlidingRecord]) -> Bench:
    """Fit sizes to some runs, then levels and common effects to all; return the best model.

    Few runs are averaged over other noise, or a tail over time; of many, one model stands out.
    """
    settings, several = log_settings(records), list[Bench]()
    centre, count = settings.mean(axis=0), min(len(records), RUNS)
    few, chosen = count == len(records), np.linspace(0, len(records) - 1, count).astype(int)
    some = Bench([records[i] for i in chosen], centre)
    # slow noise and waves from above, too: a size that is too small may have no slope
    slow = {f"memory {tau:g} s": 3.0 * some.slow_N for tau in MEMORIES_S[:-1]}
    for usual in (OVER_TRAVEL, OVER_TIME)[: 1 + int(np.ptp(settings[:, 0]) > 0.05)]:
        for first in ({"turn": FIRST_WAVE} | slow, {})[: 1 + few]:
            trial = copy(some)
            trial.usual = trial.powers = usual
            trial.search(first, FIRST_STEPS)
            several.append(trial)
    several = several if few else [max(several, key=lambda one: one.posterior.log_evidence)]
    for one in several:
        one.search(one.posterior.sizes, STEPS)
    bench = max(several, key=lambda one: one.posterior.log_evidence)
    if not few:
        some, bench = bench, Bench(records, centre)
        bench.usual, bench.powers, bench.A = some.usual, some.powers, some.A
        bench.update(some.posterior.sizes)
        bench.posterior = bench.model().at(some.posterior.sizes, some.posterior.converged)
        several = [bench]
    weights = softmax([one.posterior.log_evidence for one in several])
    found = np.array([(one.posterior.level, one.posterior.level_variance) for one in several])
    bench.mean, bench.variance = np.tensordot(weights, found, 1)
    drift = bench.mean * bench.posterior.of("drift")[0] / np.sqrt(12.0)  # sd of mu over the sliding
    bench.doubt = np.column_stack([(found[:, 0] - bench.mean).T * np.sqrt(weights), drift])
    return bench


CELL_ZEROS = ((1e-5, 0.7), (1e-3, 0.1), (3e-3, 0.1), (1e-2, 0.1))
"""Sizes of zeta over the median initial tension, with their probabilities."""
HELD = ((1e-5, 0.5), (3e-4, 0.1), (1e-3, 0.1), (3e-3, 0.1), (1e-2, 0.1), (5e-2, 0.1))  # of h, g
GAINS = ((1.0, 0.6), (3.0, 0.25), (10.0, 0.15))  # of gamma, over what is stated
OWN_SIZE = Size(5e-4, 1.5)  # of w, over the median initial tension, and of f
# how mu of the runs in both directions may change: powers of tension and speed, from run to run
SETTINGS, SCATTER = 0.3, Size(3e-3, 1.0)
NOTED = 0.003  # ratio of correction to initial tension above which a note mentions it


def cell_errors(
    runs: Sequence[RunReduction],
    records: Sequence[SlidingRecord],
    level: Array,
    level_se: Array,
    gain_rel: float = 2e-3,
    free_at_rest: bool = False,
) -> tuple[Array, Array, Array]:
    """Estimate the errors (S4) of runs with their rest and their sliding; set `held` and notes.

    `level` and `level_se` (R,) are ln(T_tight/T_slack) while sliding and its standard error,
    `gain_rel` the stated standard uncertainty of the gain of a cell; the belt may be `free_at_rest`
    of friction. Returns, of ln(T_tight/T_slack), the correction to subtract, the variance of its
    part that is independent between runs, and the standard deviation, with sign, of what all share
    (R,). `held` is the difference at rest that zeros and gains do not explain, over the tension.
    """
    T, D, se = np.array(
        [(r.rest.tension_N, r.rest.imbalance_N, r.rest.imbalance_se_N) for r in records]
    ).T
    level = np.maximum(level, 1e-6)
    d, noise = np.where([run.swapped for run in runs], -1.0, 1.0), np.maximum(se, 1e-5 * T)
    unit, both_ways = float(np.median(T)), bool(np.ptp(d) > 0.0)
    v, x, _ = (log_settings(records) - log_settings(records).mean(axis=0)).T
    settings = np.column_stack([x**0, x, v, x**2, v**2, x * v])
    log_mu = np.log(level / [run.arc_deg for run in runs])
    none, one = 0.0 * T, 1.0 + 0.0 * T

    def rows(of_rest: Array, of_sliding: Array) -> Array:
        """Stack what concerns D and ln mu, of which only runs in both directions tell."""
        return np.stack([of_rest, both_ways * of_sliding], axis=1)

    inverse = 1.0 / np.array([record.tensions_N for record in records])
    q, q_common = 0.5 * inverse.sum(axis=1), 0.5 * (inverse[:, 1] - inverse[:, 0])
    gains = [(k * max(np.sqrt(2.0) * gain_rel, 1e-6), p) for k, p in GAINS]
    known, seen = ((1e-9, 1.0),), both_ways or free_at_rest
    held = known if free_at_rest else HELD
    shared = [
        Shared("zero", rows(d * unit, d * q * unit / level), choices=CELL_ZEROS),
        Shared("gain", rows(d * T, d / level), choices=gains if seen else known),
        Shared("held", rows(T, none), choices=held),
        Shared("held to one side", rows(d * T, none), choices=held if both_ways else known),
        Shared("settings", rows(0.0 * settings, settings), Size(SETTINGS)),
    ]
    effect = np.zeros((T.size, 4 + settings.shape[1]))  # changes of e by the coefficients
    effect[:, 0], effect[:, 1] = d * q * unit, d
    evidence, found = list[float](), list[Array]()
    # what differs from run to run is zeros, or else friction that is held
    for zeros_differ in [True] if free_at_rest else [True, False]:
        own = [
            Own("noise", Size(1.0), diagonal=rows(noise, level_se / level)),
            Own("own", OWN_SIZE, diagonal=rows(unit * one if zeros_differ else T, none)),
            Own("scatter", SCATTER, diagonal=rows(none, one)),
        ]
        posterior = Mixed(rows(D, log_mu - log_mu.mean()), shared, own).fit()
        own_N = posterior.sizes["own"] * unit * zeros_differ
        part = own_N**2 / (np.square(noise) + own_N**2)
        # errors by the coefficients change the residual, too, from which w follows
        slopes = effect - (q * part)[:, None] * posterior.model.X[:, 0]
        # the common error of both zeros has the size of their difference
        square = (posterior.mean[0] ** 2 + posterior.covariance[0, 0]) * unit**2
        zeros = posterior.mean[0] * unit + d * part * posterior.residual[:, 0]
        mean = effect @ posterior.mean + q * part * posterior.residual[:, 0]
        variance = own_N**2 * (q**2 * (1.0 - part) + q_common**2)
        common = np.sum((slopes @ root(posterior.covariance)) ** 2, axis=1) + q_common**2 * square
        evidence.append(posterior.log_evidence)
        found.append(np.array([mean, zeros, variance, common]))
    weights = softmax(evidence)
    mean, zeros, variance, common = np.tensordot(weights, found, 1)
    variance = variance + weights @ np.square([part[0] - mean for part in found])
    common = np.where(mean < 0.0, -1.0, 1.0) * np.sqrt(common)
    gain = float((d * mean - q * zeros)[0])  # what (S4) has beside the zeros
    held_shares = (D - d * (zeros + gain * T)) / T
    for run, share, zero_N, T_0 in zip(runs, held_shares.tolist(), zeros, T, strict=True):
        run.held = share
        run.notes += _notes(zero_N, T_0, float(np.mean(zeros)), float(np.std(zeros)), gain)
    return mean, variance, common


def _notes(
    zero_N: float, tension_N: float, zeta: float, wander: float, gain: float
) -> tuple[str, ...]:
    """Describe the errors of the cells if they are large."""
    found = []
    if min(abs(zeta) + wander, abs(zero_N)) > NOTED * tension_N:
        own = f" and wander by {wander:.2g} N" if wander > 0.1 * abs(zeta) else ""
        found.append(f"the zero points of the cells differ by {zeta:+.3g} N over all runs{own}")
    if abs(gain) > NOTED:
        found.append(f"the gains of the cells differ by {100 * gain:+.3g} %")
    return (f"{'; '.join(found)}: corrected",) if found else ()

"""Monte Carlo check of the linear uncertainties (JCGM 101): the chain with drawn errors.

Each replicate draws

- one error for every source, from a normal distribution, which acts on all runs that share it;
- the scatter of every run: normal, with the standard error of its mu, which includes the
  correlation of its samples; independent from run to run;
- for the refined surface the roughness that its smoothness leaves open ("randomise, then
  optimise": J. M. Bardsley et al., SIAM J. Sci. Comput. 36 (2014) A1895), so that in the linear
  case the replicates have exactly the covariance of the solution.

Then normal force, published surface and refined surface are computed again: the belt is laid on
and the rig simulated with the drawn inputs, and the surface is solved for from the nominal one with
frozen smoothness and weights. A replicate depends only on the seed and its number.

Where the replicates differ from the law of propagation, the linear uncertainty is not good enough.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beltid.errors import BeltidError, ConvergenceError
from beltid.identify.surface.average import SurfaceGrid
from beltid.refine.inverse import RefinedSurface
from beltid.refine.rig_runs import RigRuns, mesh_of, surfaces_of
from beltid.uncertainty.campaign import Campaign
from beltid.uncertainty.published import (
    changes_at_nodes,
    published_changes,
    published_curves,
    published_grid,
    scatter_factor,
)
from beltid.uncertainty.refined import factor_of, on_nodes, residual_change
from beltid.uncertainty.sources import Errors, Source

Array = NDArray[np.float64]

MESH = 1.0
"""Ratio of elements to the default; the effect of the solution's finer mesh is added as offset."""
MOST_ITERATIONS = 8
TOLERANCE = 2.0e-4
"""Largest change of ln mu of any run in a converged replicate; chord steps leave a tenth of it."""


@dataclass(frozen=True, slots=True)
class Nominal:
    """Starting point of the replicates; plain data that can be sent to workers.

    Attributes
    ----------
    campaign : Campaign
        The measured campaign.
    refined : RefinedSurface
        Its solution.
    published : SurfaceGrid
        The surface by the published procedure.
    speeds : ndarray, shape (m,)
        Speeds of the solution [m/s].
    sources : tuple of Source
        Errors that runs share.
    slopes : ndarray, shape (n, 8)
        Derivatives of the simulated ln mu by the inputs, for the first guess of an iteration.
    mesh : tuple of int
        Elements of each run.
    offset : ndarray, shape (n,)
        Simulated ln mu with the mesh of the solution minus that with this mesh.
    open_roughness : ndarray, shape (size, r)
        Factor of the quadratic form of the roughness.
    """

    campaign: Campaign
    refined: RefinedSurface
    published: SurfaceGrid
    speeds: Array
    sources: tuple[Source, ...]
    slopes: Array
    mesh: tuple[int, ...]
    offset: Array
    open_roughness: Array


@dataclass(frozen=True, slots=True)
class Replicates:
    """Results of some replicates.

    Attributes
    ----------
    refined : ndarray, shape (n, nf, nv)
        Change of ln mu at the nodes of the refined surface.
    published : ndarray, shape (n, nf', nv')
        The same for the published surface.
    failed : tuple of str
        Error messages of replicates without a result.
    """

    refined: Array
    published: Array
    failed: tuple[str, ...]


def prepare(
    campaign: Campaign,
    refined: RefinedSurface,
    speeds: Array,
    linear: tuple[Sequence[Source], Array],
) -> Nominal:
    """Prepare the starting point of the replicates.

    `linear` holds the sources and the slopes of the inputs.
    """
    sources, slopes = linear
    mesh = mesh_of(campaign.bench, campaign.runs, MESH)
    rig = RigRuns(campaign.bench, campaign.runs, speeds, mesh)
    simulated = rig.log_mu(surfaces_of(refined.curves, refined.parameters), refined.speed_slope)
    after = np.log(campaign.measured.mu) + np.log1p(refined.misfit_after)
    return Nominal(
        campaign=campaign,
        refined=refined,
        published=published_grid(campaign.measured),
        speeds=speeds,
        sources=tuple(sources),
        slopes=slopes,
        mesh=tuple(mesh),
        offset=after - simulated,
        open_roughness=factor_of(refined.roughness),
    )


def replicates(nominal: Nominal, seed: int, numbers: Sequence[int]) -> Replicates:
    """Compute some replicates.

    Parameters
    ----------
    nominal : Nominal
        Starting point.
    seed : int
        Seed of the whole check.
    numbers : sequence of int
        Numbers of the replicates to compute.
    """
    refined, published, failed = [], [], []
    for number in numbers:
        try:
            pair = _replicate(nominal, np.random.default_rng([seed, number]))
        except BeltidError as error:
            failed.append(f"replicate {number}: {error.problems[0]}")
            continue
        refined.append(pair[0])
        published.append(pair[1])
    shapes = nominal.refined.surface.mu_nodes.shape, nominal.published.mu.shape
    return Replicates(
        refined=np.array(refined).reshape(-1, *shapes[0]),
        published=np.array(published).reshape(-1, *shapes[1]),
        failed=tuple(failed),
    )


def gathered(parts: Sequence[Replicates]) -> Replicates:
    """Join the replicates of several calls in their order."""
    return Replicates(
        refined=np.concatenate([p.refined for p in parts]),
        published=np.concatenate([p.published for p in parts]),
        failed=tuple(line for p in parts for line in p.failed),
    )


def _replicate(nominal: Nominal, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return the changes of ln mu at the nodes of the refined and of the published surface."""
    measured = nominal.campaign.measured
    errors = Errors.drawn(nominal.sources, rng.standard_normal(len(nominal.sources)))
    scatter = rng.standard_normal(measured.mu.size)
    rough = nominal.open_roughness
    pull = np.einsum("pr,r->p", rough, rng.standard_normal(rough.shape[1]))
    corrected = nominal.campaign.corrected(errors)
    parameters = refined_again(nominal, corrected, errors, (scatter, pull))
    change = on_nodes(nominal.refined, (parameters - nominal.refined.parameters)[:, None])
    noisy = corrected.measured.scattered(measured.mu_se / measured.mu * scatter)
    again = published_grid(noisy)
    return change[..., 0], changes_at_nodes(nominal.published, again)


def refined_again(
    nominal: Nominal, corrected: Campaign, errors: Errors, drawn: tuple[Array, Array]
) -> Array:
    """Solve for the refined surface with drawn errors: chord steps from the linear guess."""
    refined = nominal.refined
    scatter, pull = refined.errors * drawn[0], drawn[1]
    rig = RigRuns(corrected.bench, corrected.runs, nominal.speeds, nominal.mesh)
    target = np.log(corrected.measured.mu) + scatter - nominal.offset
    guess = scatter + residual_change(nominal.campaign, errors, nominal.slopes, refined.speed_slope)
    # einsum, because a threaded library may round differently on another machine
    parameters = refined.parameters + np.einsum("pn,n->p", refined.gain, guess)
    parameters = parameters + np.einsum("pq,q->p", refined.pull, pull)
    for _ in range(MOST_ITERATIONS):
        surfaces = surfaces_of(refined.curves, parameters)
        residual = target - rig.log_mu(surfaces, refined.speed_slope)
        force = pull - np.einsum("pq,q->p", refined.roughness, parameters)
        step = np.einsum("pn,n->p", refined.gain, residual)
        step = step + np.einsum("pq,q->p", refined.pull, force)
        parameters = parameters + step
        if float(np.max(np.abs(np.einsum("np,p->n", refined.J, step)))) <= TOLERANCE:
            return parameters
    raise ConvergenceError(
        f"the refined surface of a replicate did not converge in {MOST_ITERATIONS} iterations",
        iterations=MOST_ITERATIONS,
        residual=float(np.max(np.abs(step))),
    )


LARGEST_DEVIATION = 0.20
"""Largest acceptable relative difference of standard uncertainties."""
LARGEST_ASYMMETRY = 1.25
"""Largest acceptable ratio of the half-widths of the 95 % interval, upper to lower or inverse."""
CHANCE = 3.0
"""Standard errors of a figure from replicates within which a deviation counts as chance."""
MOST_FAILED = 0.5
SHOWN = 3
"""Failed draws shown in messages."""
QUANTILES = (0.025, 0.5, 0.975)
# standard errors of figures from n normal replicates, times sqrt(n)
OF_DEVIATION = math.sqrt(0.5)
OF_LOG_ASYMMETRY = 1.9


@dataclass(frozen=True, slots=True)
class LinearCheck:
    """Comparison of replicates with the linear standard uncertainties of some values.

    Attributes
    ----------
    replicates : int
        Number of replicates.
    linear, found : ndarray, shape (n,)
        Standard uncertainties of ln mu: linear, and standard deviation of the replicates.
    deviation : ndarray, shape (n,)
        ``found / linear - 1``.
    asymmetry : ndarray, shape (n,)
        Upper over lower half-width of the interval that contains 95 % of the replicates.
    """

    replicates: int
    linear: Array
    found: Array
    deviation: Array
    asymmetry: Array

    @property
    def too_far(self) -> NDArray[np.bool_]:
        """Mask of values whose uncertainty differs by more than a fifth, beyond chance (n,)."""
        chance = CHANCE * OF_DEVIATION / math.sqrt(self.replicates)
        return np.asarray(np.abs(self.deviation) > max(LARGEST_DEVIATION, chance))

    @property
    def lopsided(self) -> NDArray[np.bool_]:
        """Mask of values whose distribution is asymmetric beyond chance (n,)."""
        chance = CHANCE * OF_LOG_ASYMMETRY / math.sqrt(self.replicates)
        return np.asarray(np.abs(np.log(self.asymmetry)) > max(math.log(LARGEST_ASYMMETRY), chance))

    @property
    def fails(self) -> NDArray[np.bool_]:
        """Mask of values for which the linear uncertainty is not good enough (n,)."""
        return self.too_far | self.lopsided

    def row(self, group: str, chosen: NDArray[np.bool_]) -> dict[str, object]:
        """Return a table row that summarises the values chosen by a mask (n,)."""
        if not chosen.any():
            return {"group": group, "values": 0, "linear_fails": 0}
        deviation, asymmetry = self.deviation[chosen], np.log(self.asymmetry[chosen])
        return {
            "group": group,
            "values": int(np.count_nonzero(chosen)),
            "linear_percent": _rms_percent(self.linear[chosen]),
            "monte_carlo_percent": _rms_percent(self.found[chosen]),
            "largest_deviation_percent": 100.0 * float(deviation[np.argmax(np.abs(deviation))]),
            "largest_asymmetry": float(np.exp(asymmetry[np.argmax(np.abs(asymmetry))])),
            "linear_fails": int(np.count_nonzero(self.fails[chosen])),
        }


def linear_check(replicates: Array, linear: Array) -> LinearCheck:
    """Compare replicates (N, n) of ln mu with linear standard uncertainties (n,).

    A value that has no uncertainty on one of the two sides counts as agreeing.
    """
    low, middle, high = np.quantile(replicates, QUANTILES, axis=0)
    deviations = np.std(replicates, axis=0, ddof=1)
    has_none = (linear <= 0.0) | (deviations <= 0.0)
    safe = np.where(has_none, 1.0, linear)
    lower, upper = np.where(has_none, 1.0, middle - low), np.where(has_none, 1.0, high - middle)
    return LinearCheck(
        replicates=replicates.shape[0],
        linear=linear,
        found=deviations,
        deviation=np.where(has_none, 0.0, deviations / safe - 1.0),
        asymmetry=upper / lower,
    )


@dataclass(frozen=True, slots=True)
class MonteCarlo:
    """Replicates of a refined surface and their comparison with the linear uncertainties.

    Attributes
    ----------
    nominal : Nominal
        Starting point.
    found : Replicates
        The replicates.
    refined, published : LinearCheck
        Comparison at the nodes of each surface.
    """

    nominal: Nominal
    found: Replicates
    refined: LinearCheck
    published: LinearCheck

    def members(self) -> np.ndarray:
        """Return mu at the nodes of the refined surface of each replicate, shape (nodes, n)."""
        mu = self.nominal.refined.surface.mu_nodes
        return np.asarray((mu * np.exp(self.found.refined)).reshape(-1, mu.size).T)

    def table(self) -> list[dict[str, Any]]:
        """Return rows for printing: where the linear uncertainty is valid and where it is not."""
        force = self.nominal.campaign.measured.normal_force
        surface, grid = self.nominal.refined.surface, self.nominal.published
        f = np.repeat(surface.normal_force_N_m, surface.slip_speed_m_s.size)
        inside = (f >= force.min()) & (f <= force.max())
        everywhere = np.ones(grid.mu.size, dtype=bool)
        return [
            self.refined.row("refined surface, forces of the runs", inside),
            self.refined.row("refined surface, beyond them", ~inside),
            self.published.row("published surface", everywhere),
        ]

    def extra(self, seed: int) -> dict[str, Any]:
        """Return the metadata that the artifact keeps in addition to the members."""
        return {
            "monte_carlo": {
                "replicates": self.found.refined.shape[0],
                "seed": seed,
                "failed": list(self.found.failed),
                "table": self.table(),
                "linear_fails_at": self._places(),
            }
        }

    def _places(self) -> list[dict[str, float]]:
        """Return the nodes of the refined surface where the linear uncertainty fails."""
        surface, check = self.nominal.refined.surface, self.refined
        n = surface.slip_speed_m_s.size
        return [
            {
                "normal_force_N_m": float(surface.normal_force_N_m[i // n]),
                "slip_speed_m_s": float(surface.slip_speed_m_s[i % n]),
                "linear_percent": 100.0 * float(check.linear[i]),
                "monte_carlo_percent": 100.0 * float(check.found[i]),
                "asymmetry": float(check.asymmetry[i]),
            }
            for i in np.flatnonzero(check.fails).tolist()
        ]

    def note(self) -> str:
        """Return the result of the check in a sentence."""
        n, fails = self.found.refined.shape[0], int(np.count_nonzero(self.refined.fails))
        if not fails:
            return (
                f"Monte Carlo with {n} draws: the linear uncertainty of the refined surface is "
                "right within a fifth, and its distribution symmetric, at every node"
            )
        force = sorted({place["normal_force_N_m"] for place in self._places()})
        where = ", ".join(f"{f:.0f}" for f in force[:8]) + (" ..." if len(force) > 8 else "")
        return (
            f"Monte Carlo with {n} draws: the linear uncertainty of the refined surface is not "
            f"good enough at {fails} of {self.refined.linear.size} nodes (forces {where} N/m); use "
            "the ensemble there"
        )

    def warnings(self) -> tuple[str, ...]:
        """Return a warning about replicates that failed, if any."""
        failed = self.found.failed
        if not failed:
            return ()
        more = f" and {len(failed) - SHOWN} more" if len(failed) > SHOWN else ""
        return (f"{len(failed)} draws failed: {'; '.join(failed[:SHOWN])}{more}",)


def check_of(
    nominal: Nominal, found: Replicates, factor: Array, sources: Sequence[Source]
) -> MonteCarlo:
    """Compare replicates with the linear uncertainties of both surfaces.

    Parameters
    ----------
    nominal : Nominal
        Starting point.
    found : Replicates
        The replicates.
    factor : ndarray, shape (nf, nv, K + r)
        Factor of the covariance of ln mu at the nodes of the refined surface.
    sources : sequence of Source
        Errors that runs share.

    Raises
    ------
    ConvergenceError
        If half of the replicates or more failed.
    """
    count, total = found.refined.shape[0], found.refined.shape[0] + len(found.failed)
    if count <= MOST_FAILED * total:
        raise ConvergenceError(
            [
                f"Monte Carlo: {len(found.failed)} of {total} draws failed, more than half "
                "must succeed: the uncertainties are too large for the rig",
                *found.failed[:SHOWN],
            ]
        )
    measured, grid = nominal.campaign.measured, nominal.published
    published_factors = [
        published_changes(measured, grid, sources),
        scatter_factor(published_curves(measured), grid, arcs=False),
    ]
    u_published = np.linalg.norm(np.concatenate(published_factors, axis=-1), axis=-1)
    u_refined = np.linalg.norm(factor, axis=-1)
    return MonteCarlo(
        nominal=nominal,
        found=found,
        refined=linear_check(found.refined.reshape(count, -1), u_refined.ravel()),
        published=linear_check(found.published.reshape(count, -1), u_published.ravel()),
    )


def _rms_percent(values: Array) -> float:
    return 100.0 * float(np.sqrt(np.mean(np.square(values))))

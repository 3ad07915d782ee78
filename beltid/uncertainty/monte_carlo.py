"""The Monte Carlo check of the linear uncertainties (JCGM 101): the chain with drawn errors.

Each replicate draws

- one error for every source, from a normal distribution, which acts on all that share it;
- the scatter of every run: normal, with the standard error of its mu, which holds the correlation
  of its samples; independent from run to run;
- for the refined surface the roughness that its smoothness leaves open ("randomise, then
  optimise": J. M. Bardsley et al., SIAM J. Sci. Comput. 36 (2014) A1895), so that in the linear
  case the replicates have the very covariance of the solution.

Then normal force, published surface and refined surface are made anew: the rig laid on and
simulated with the drawn inputs, the surface solved for from the nominal one with frozen smoothness
and weights. A replicate depends on the seed and its own number only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.errors import BeltidError, ConvergenceError
from beltid.identify.surface.average import SurfaceGrid
from beltid.identify.surface.surface import SurfaceSettings
from beltid.refine.inverse import RefinedSurface
from beltid.refine.rig_runs import RigRuns, mesh_of, surfaces_of
from beltid.uncertainty.campaign import Campaign
from beltid.uncertainty.published import changes_at_nodes, published_grid
from beltid.uncertainty.refined import factor_of, on_nodes, residual_change
from beltid.uncertainty.sources import Errors, Source

Array = NDArray[np.float64]

MESH = 1.0
"""Elements over the default; what the finer mesh of the solution changes is taken over from it."""
MOST_ITERATIONS = 8
TOLERANCE = 2.0e-4
"""Change of ln mu of any run at which a replicate has converged: chord steps leave a tenth."""


@dataclass(frozen=True, slots=True)
class Nominal:
    """All that replicates start from; plain data, to be sent to workers.

    Attributes
    ----------
    campaign : Campaign
        The measured campaign.
    refined : RefinedSurface
        Its solution.
    published : SurfaceGrid
        The surface by the published procedure.
    settings : SurfaceSettings
        How that was made.
    speeds : ndarray, shape (m,)
        Speeds of the solution [m/s].
    sources : tuple of Source
        Errors that runs share.
    slopes : ndarray, shape (n, 8)
        Derivatives of the simulated ln mu by the inputs: where an iteration starts.
    mesh : tuple of int
        Elements of each run.
    offset : ndarray, shape (n,)
        ln mu that the solution's own mesh simulates, less that of this one.
    open_roughness : ndarray, shape (size, r)
        Factor of the quadratic form of the roughness.
    """

    campaign: Campaign
    refined: RefinedSurface
    published: SurfaceGrid
    settings: SurfaceSettings
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
        What went wrong in replicates that have no result.
    """

    refined: Array
    published: Array
    failed: tuple[str, ...]


def prepare(
    campaign: Campaign,
    refined: RefinedSurface,
    speeds: Array,
    settings: SurfaceSettings,
    linear: tuple[Sequence[Source], Array],
) -> Nominal:
    """What the replicates start from; `linear` are the sources and the slopes of the inputs."""
    sources, slopes = linear
    mesh = mesh_of(campaign.bench, campaign.runs, MESH)
    rig = RigRuns(campaign.bench, campaign.runs, speeds, mesh)
    simulated = rig.log_mu(surfaces_of(refined.curves, refined.parameters), refined.speed_slope)
    after = np.log(campaign.measured.mu) + np.log1p(refined.misfit_after)
    return Nominal(
        campaign=campaign,
        refined=refined,
        published=published_grid(campaign.measured, settings),
        settings=settings,
        speeds=speeds,
        sources=tuple(sources),
        slopes=slopes,
        mesh=tuple(mesh),
        offset=after - simulated,
        open_roughness=factor_of(refined.roughness),
    )


def replicates(nominal: Nominal, seed: int, numbers: Sequence[int]) -> Replicates:
    """Carry out some replicates.

    Parameters
    ----------
    nominal : Nominal
        What they start from.
    seed : int
        Of the whole check.
    numbers : sequence of int
        Which replicates of it.
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
    """Replicates of several calls as one, in their order."""
    return Replicates(
        refined=np.concatenate([p.refined for p in parts]),
        published=np.concatenate([p.published for p in parts]),
        failed=tuple(line for p in parts for line in p.failed),
    )


def _replicate(nominal: Nominal, rng: np.random.Generator) -> tuple[Array, Array]:
    """Changes of ln mu at the nodes of the refined and of the published surface."""
    measured = nominal.campaign.measured
    errors = Errors.drawn(nominal.sources, rng.standard_normal(len(nominal.sources)))
    scatter = rng.standard_normal(measured.mu.size)
    rough = nominal.open_roughness
    pull = np.einsum("pr,r->p", rough, rng.standard_normal(rough.shape[1]))
    corrected = nominal.campaign.corrected(errors)
    parameters = refined_again(nominal, corrected, errors, (scatter, pull))
    change = on_nodes(nominal.refined, (parameters - nominal.refined.parameters)[:, None])
    noisy = corrected.measured.scattered(measured.mu_se / measured.mu * scatter)
    again = published_grid(noisy, nominal.settings)
    return change[..., 0], changes_at_nodes(nominal.published, again)


def refined_again(
    nominal: Nominal, corrected: Campaign, errors: Errors, drawn: tuple[Array, Array]
) -> Array:
    """Parameters of the refined surface with drawn errors: chord steps from the linear guess."""
    refined = nominal.refined
    scatter, pull = refined.errors * drawn[0], drawn[1]
    rig = RigRuns(corrected.bench, corrected.runs, nominal.speeds, nominal.mesh)
    target = np.log(corrected.measured.mu) + scatter - nominal.offset
    guess = scatter + residual_change(nominal.campaign, errors, nominal.slopes, refined.speed_slope)
    # products by einsum: a threaded library could round otherwise on another machine
    parameters = refined.parameters + np.einsum("pn,n->p", refined.gain, guess)
    parameters = parameters + np.einsum("pq,q->p", refined.covariance, pull)
    for _ in range(MOST_ITERATIONS):
        surfaces = surfaces_of(refined.curves, parameters)
        residual = target - rig.log_mu(surfaces, refined.speed_slope)
        force = pull - np.einsum("pq,q->p", refined.roughness, parameters)
        step = np.einsum("pn,n->p", refined.gain, residual)
        step = step + np.einsum("pq,q->p", refined.covariance, force)
        parameters = parameters + step
        if float(np.max(np.abs(np.einsum("np,p->n", refined.J, step)))) <= TOLERANCE:
            return parameters
    raise ConvergenceError(
        f"the refined surface of a replicate did not converge in {MOST_ITERATIONS} iterations",
        iterations=MOST_ITERATIONS,
        residual=float(np.max(np.abs(step))),
    )

"""Does the truth lie within the stated uncertainty of the refined surface? One repetition."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from virtual_bench import Design, read_campaign, true_mu

from beltid.refine.inverse import refine_surface
from beltid.uncertainty.refined import factor_of, on_nodes, parameter_changes, refined_slopes
from beltid.uncertainty.sources import all_sources


@dataclass(frozen=True)
class Repetition:
    """Errors of ln mu at the nodes within the forces of the runs, and their uncertainties."""

    error: np.ndarray
    scatter: np.ndarray
    combined: np.ndarray


def repetition(design: Design, seed: int) -> Repetition:
    """A campaign read, refined and compared with the truth."""
    campaign = read_campaign(design, np.random.default_rng(seed))
    refined = refine_surface(campaign.bench, campaign.runs, design.speeds)
    sources = all_sources(design.given, len(design.arcs_deg), campaign.press.has_scatter)
    changes = np.zeros((*refined.surface.mu_nodes.shape, 0))
    if sources:
        slopes = refined_slopes(campaign, refined, design.speeds)
        changes = on_nodes(refined, parameter_changes(campaign, refined, sources, slopes))
    random = on_nodes(refined, factor_of(refined.covariance))
    f = refined.surface.normal_force_N_m
    force = campaign.measured.normal_force
    inside = (f >= force.min()) & (f <= force.max())
    truth = true_mu(f[inside][:, None], design.speeds[None, :])
    scatter = np.sqrt(np.sum(random[inside] ** 2, axis=-1))
    shared = np.sum(changes[inside] ** 2, axis=-1)
    return Repetition(
        error=np.log(refined.surface.mu_nodes[inside] / truth),
        scatter=scatter,
        combined=np.sqrt(scatter**2 + shared),
    )

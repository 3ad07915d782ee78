"""Does the truth lie within the stated uncertainty of the refined surface? One repetition."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from virtual_bench import Design, read_campaign, true_mu

from beltid.uncertainty.refined import changes_and_scatter, refined_campaign
from beltid.uncertainty.sources import all_sources, reduction_sources


@dataclass(frozen=True)
class Repetition:
    """Errors of ln mu at the nodes within the forces of the runs, and their uncertainties."""

    error: np.ndarray
    scatter: np.ndarray
    combined: np.ndarray


def repetition(design: Design, seed: int) -> Repetition:
    """A campaign read, refined and compared with the truth."""
    campaign = read_campaign(design, np.random.default_rng(seed))
    sources = (
        *all_sources(design.given, len(design.arcs_deg), campaign.press.has_scatter),
        *reduction_sources(campaign.measured.columns),
    )
    found = refined_campaign(campaign, design.speeds, sources)
    refined = found.refined
    changes, random = changes_and_scatter(found)
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

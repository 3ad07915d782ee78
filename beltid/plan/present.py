"""Knowledge before the next runs: the measured surface and the shared errors.

A surface stores its sources of error as stated when it was fitted. New runs are subject to these
and to sources that the surface does not have: another arc setting, an error that was not stated
then.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from beltid.plan.prior import USUAL_ARCS
from beltid.refine.effects import ARC
from beltid.uncertainty.budget import SurfaceUncertainty
from beltid.uncertainty.measured import numbered_arcs
from beltid.uncertainty.sources import (
    Source,
    StandardUncertainties,
    all_sources,
    effect_sources,
)


@dataclass(frozen=True, slots=True)
class KnownSurface(SurfaceUncertainty):
    """A measured surface with its stored uncertainty.

    Attributes
    ----------
    noise_scale : float
        Scatter of its runs over their standard errors [-].
    """

    noise_scale: float = 1.0

    def stated_otherwise(self, stated: StandardUncertainties, law_scatter: bool) -> list[str]:
        """List the sources whose size was different when the surface was fitted."""
        now = all_sources(stated, len(self.arcs_deg), law_scatter)
        sizes = {(source.error, source.place): source.size for source in now}
        changed = (s.name for s in self.sources if sizes.get((s.error, s.place), s.size) != s.size)
        return list(dict.fromkeys(changed))


def sources_of_plan(
    known: KnownSurface | None,
    stated: StandardUncertainties,
    arcs_deg: Sequence[float],
    law_scatter: bool,
) -> tuple[Source, ...]:
    """List the shared errors of a surface, then the additional ones of its candidates.

    Parameters
    ----------
    known : KnownSurface or None
        The surface; None before any run.
    stated : StandardUncertainties
        Stated uncertainties of the bench.
    arcs_deg : sequence of float
        Arc settings of the candidates [deg].
    law_scatter : bool
        Whether the covariance of the contact law is known.
    """
    stored = () if known is None else known.sources
    _, arcs = numbered_arcs(arcs_deg, () if known is None else known.arcs_deg)
    size = next((source.size for source in stored if source.error == ARC), USUAL_ARCS)
    every = (*all_sources(stated, len(arcs), law_scatter), *effect_sources(ARC, size, len(arcs)))
    existing = {(source.error, source.place) for source in stored}
    return (*stored, *(s for s in every if (s.error, s.place) not in existing))

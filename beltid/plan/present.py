"""What is known before the next runs: the surface that runs have shown, and the errors they share.

A surface holds its own sources of error, as they were stated when it was made. New runs follow
these and, beside them, those that the surface does not know: another arc setting, an error that
was not stated then.
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
    """A surface that runs have shown, with what is stored of its uncertainty.

    Attributes
    ----------
    noise_scale : float
        How many times their standard errors its runs scatter [-].
    """

    noise_scale: float = 1.0

    def stated_otherwise(self, stated: StandardUncertainties, law_scatter: bool) -> list[str]:
        """Names of the sources whose size was another one when the surface was made."""
        now = all_sources(stated, len(self.arcs_deg), law_scatter)
        sizes = {(source.error, source.place): source.size for source in now}
        other = (s.name for s in self.sources if sizes.get((s.error, s.place), s.size) != s.size)
        return list(dict.fromkeys(other))


def sources_of_plan(
    known: KnownSurface | None,
    stated: StandardUncertainties,
    arcs_deg: Sequence[float],
    law_scatter: bool,
) -> tuple[Source, ...]:
    """The shared errors of a surface, then those that its candidates have beside them.

    Parameters
    ----------
    known : KnownSurface or None
        The surface; None before any run.
    stated : StandardUncertainties
        Of the bench.
    arcs_deg : sequence of float
        Arc settings of the candidates [deg].
    law_scatter : bool
        Whether the covariance of the contact law is known.
    """
    stored = () if known is None else known.sources
    _, arcs = numbered_arcs(arcs_deg, () if known is None else known.arcs_deg)
    size = next((source.size for source in stored if source.error == ARC), USUAL_ARCS)
    every = (*all_sources(stated, len(arcs), law_scatter), *effect_sources(ARC, size, len(arcs)))
    there = {(source.error, source.place) for source in stored}
    return (*stored, *(s for s in every if (s.error, s.place) not in there))

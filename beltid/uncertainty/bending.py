"""The bending stiffness of the belt from the runs: what one surface for all of them asks for.

EI is one more unknown of the inverse problem. With a wide prior in place of the stated uncertainty
the runs alone say what it is; the surface, the effects of the campaign and all other stated errors
are unknowns at the same time, so that their share is in its uncertainty. The simulated ln mu is
linear in ln EI near the solution only: the rig is refined anew with the EI found until it stays.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from beltid.errors import ConvergenceError
from beltid.laws.friction_surface import FrictionSurface
from beltid.refine.inverse import refine_surface
from beltid.uncertainty.campaign import Campaign
from beltid.uncertainty.measured import Measured
from beltid.uncertainty.refined import changes_of_residuals, simulated_slopes
from beltid.uncertainty.sources import FITTED, PERCENT, Source

Array = NDArray[np.float64]

ERROR, NAME = "bending_stiffness", "bending stiffness of the belt"
WIDE = 0.7  # standard deviation of ln EI before the runs: published values differ by a factor of 4
LARGEST_STEP = 0.5  # of ln EI at once
MOST_REFINEMENTS = 10
NOTHING = 0.05  # standard uncertainties by which EI may still move


@dataclass(frozen=True, slots=True)
class FittedBending:
    """Bending stiffness as the runs show it.

    Attributes
    ----------
    EI : float
        Bending stiffness [N m²].
    relative : float
        Its standard uncertainty, as a share.
    refinements : int
        How often the surface was refined.
    """

    EI: float
    relative: float
    refinements: int

    def away_from(self, EI: float, relative: float) -> float:
        """Distance of ln EI from a stated one [N m²], in standard uncertainties of both."""
        return abs(math.log(self.EI / EI)) / math.hypot(self.relative, relative)

    def used(
        self, campaign: Campaign, sources: Sequence[Source]
    ) -> tuple[Campaign, tuple[Source, ...]]:
        """The campaign with this stiffness, and the sources with its uncertainty."""
        bench = replace(campaign.bench, belt=replace(campaign.bench.belt, EI=self.EI))
        own = Source(NAME, ERROR, 0, self.relative, *PERCENT, FITTED)
        others = [source for source in sources if source.error != ERROR]
        return replace(campaign, bench=bench), (*others, own)


def fit_bending(
    campaign: Campaign,
    speeds: Array,
    sources: Sequence[Source],
    reference_degC: float | None = None,
) -> FittedBending:
    """Find the bending stiffness that the runs ask for.

    Parameters
    ----------
    campaign, speeds, sources, reference_degC
        As :func:`beltid.uncertainty.refined.refined_campaign` takes them; the stated uncertainty of
        EI is not used.

    Raises
    ------
    ConvergenceError
        If EI does not stay.
    """
    wide = Source(NAME, ERROR, 0, WIDE, *PERCENT, FITTED)
    unknown = [*(source for source in sources if source.error != ERROR), wide]
    for refinements in range(1, MOST_REFINEMENTS + 1):
        start, EI = campaign.bench.surface, campaign.bench.belt.EI
        along = speed_slope(start, campaign.measured)
        slopes = simulated_slopes(campaign, [start] * len(speeds), speeds, along)
        refined = refine_surface(
            campaign.bench,
            campaign.runs,
            speeds,
            # an error put right brings measured and simulated coefficients together
            stated=-changes_of_residuals(campaign, unknown, slopes, along),
            reference_degC=reference_degC,
        )
        errors = refined.stated
        assert errors is not None
        step, relative = WIDE * errors.values[-1], WIDE * float(np.sqrt(errors.covariance[-1, -1]))
        if abs(step) <= NOTHING * relative:
            return FittedBending(EI, relative, refinements)
        EI *= float(np.exp(np.clip(step, -LARGEST_STEP, LARGEST_STEP)))
        # from the surface just found: the next one is near it
        bench = replace(
            campaign.bench,
            belt=replace(campaign.bench.belt, EI=EI),
            surface=refined.surface,
        )
        campaign = replace(campaign, bench=bench)
    raise ConvergenceError(
        f"bending stiffness: still moves by {100 * abs(step):.2g} % after {MOST_REFINEMENTS} "
        f"refinements (standard uncertainty {100 * relative:.2g} %)",
        iterations=MOST_REFINEMENTS,
        residual=abs(step),
    )


def speed_slope(surface: FrictionSurface, measured: Measured) -> Array:
    """Slope d ln mu/d ln v (n,) of a surface at mean force and speed of each run."""
    f, v, step = measured.normal_force, measured.slip_speed, 1.001
    return np.asarray(
        0.5 * np.log(surface.mu(f, v * step) / surface.mu(f, v / step)) / np.log(step)
    )

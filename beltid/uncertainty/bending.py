"""Fit the bending stiffness of the belt to the runs: find EI for which one surface fits them all.

For each EI the surface is refined. The evidence is the probability of the runs, with the surface,
the effects of the campaign and all other stated errors integrated out and the best hyperparameters
(:attr:`beltid.refine.inverse.RefinedSurface.log_evidence`). Its integral over ln EI, with a wide
prior about the stated value instead of the stated uncertainty, gives EI and its uncertainty: the
median, and half of the interval from the 16th to the 84th percentile. Mean and standard deviation
would follow the tail towards a limp belt, for which the surface compensates by roughness. The
hyperparameters are chosen anew for every EI, so no solution is followed that jumps with their
choice; how far they can compensate for a wrong EI is included in the width of the evidence. If the
runs do not determine EI, the result is the prior.

The integral determines the values of EI to try: factors of two about the stated value, then the
maximum of the parabola through the best three, then where the integral is least certain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import PchipInterpolator

from beltid.errors import ConvergenceError
from beltid.refine.inverse import RefinedSurface, refine_surface
from beltid.uncertainty.campaign import Campaign
from beltid.uncertainty.refined import changes_of_residuals, refined_slopes
from beltid.uncertainty.sources import FITTED, PERCENT, Source

Array = NDArray[np.float64]

ERROR, NAME = "bending_stiffness", "bending stiffness of the belt"
WIDE = math.log(4.0)
"""Standard deviation of ln EI before the runs: published values differ by a factor of four."""
OCTAVES = 3  # factors of two up and down in the search for EI
ALWAYS = 2  # factors of two that are always tried
FAR_BELOW = 12.0  # drop from the largest log density beyond which the search stops
FALL = 1.5  # target for the drop of the log density between neighbouring places
NEAR = 0.5  # distance from a place [standard deviations] at which the maximum counts as found
RESOLVED = 0.25  # largest uncertain share of the integral in one interval
MOST_PLACES = 40
FINE = 100  # steps of the final quadrature in each interval
HARDLY = 0.35  # standard uncertainty of ln EI above which the runs hardly determine it
PERCENTILES = (0.5 * math.erfc(math.sqrt(0.5)), 0.5, 1.0 - 0.5 * math.erfc(math.sqrt(0.5)))
"""Shares of the density below the median and below one standard deviation of a normal one."""


@dataclass(frozen=True, slots=True)
class FittedBending:
    """Bending stiffness fitted to the runs.

    Attributes
    ----------
    EI : float
        Bending stiffness [N m²].
    relative : float
        Its relative standard uncertainty [-].
    refinements : int
        Number of times the surface was refined.
    """

    EI: float
    relative: float
    refinements: int

    @property
    def is_determined(self) -> bool:
        """Whether the runs determine EI much better than published values of belts do."""
        return self.relative < HARDLY

    def away_from(self, EI: float, relative: float) -> float:
        """Return the distance of ln EI from a stated EI [N m²], in combined uncertainties."""
        return abs(math.log(self.EI / EI)) / math.hypot(self.relative, relative)

    def used(
        self, campaign: Campaign, sources: Sequence[Source]
    ) -> tuple[Campaign, tuple[Source, ...]]:
        """Return the campaign with this stiffness, and the sources with its uncertainty."""
        bench = replace(campaign.bench, belt=replace(campaign.bench.belt, EI=self.EI))
        fitted = Source(NAME, ERROR, 0, self.relative, *PERCENT, FITTED)
        others = [source for source in sources if source.error != ERROR]
        return replace(campaign, bench=bench), (*others, fitted)


def fit_bending(
    campaign: Campaign,
    speeds: Array,
    sources: Sequence[Source],
    reference_degC: float | None = None,
) -> FittedBending:
    """Fit the bending stiffness to the runs.

    Parameters
    ----------
    campaign, speeds, sources, reference_degC
        As in :func:`beltid.uncertainty.refined.refined_campaign`; the stated uncertainty of EI is
        not used.

    Raises
    ------
    ConvergenceError
        If the surface cannot be refined with any of the stiffnesses tried.
    """
    others = [source for source in sources if source.error != ERROR]
    rough = _Evidence(campaign, speeds, reference_degC)
    rough.try_outwards()
    at = rough.best
    nearby = rough.campaign_at(at)
    slopes = refined_slopes(nearby, rough.found[at], speeds)
    changes = changes_of_residuals(nearby, others, slopes, rough.found[at].speed_slope)
    evidence = _Evidence(campaign, speeds, reference_degC, -changes, dict(rough.found))
    for x in rough.likely_places():
        evidence.refine_at(x)
    evidence.resolve()
    lower, median, upper = evidence.percentiles()
    refinements = len(rough.log_density) + len(evidence.log_density)
    EI = campaign.bench.belt.EI * math.exp(median)
    return FittedBending(EI, 0.5 * (upper - lower), refinements)


@dataclass(slots=True)
class _Evidence:
    """Log density of x = ln(EI/stated EI), up to a constant, at the places tried.

    `stated` are the columns of the stated errors, `found` the solutions to start from.
    """

    campaign: Campaign
    speeds: Array
    reference_degC: float | None
    stated: Array | None = None
    found: dict[float, RefinedSurface] = field(default_factory=dict)
    log_density: dict[float, float] = field(default_factory=dict)

    @property
    def best(self) -> float:
        """Place of the largest density."""
        return max(self.log_density, key=self.log_density.__getitem__)

    def campaign_at(self, x: float) -> Campaign:
        """Return the campaign with that stiffness and the nearest surface found so far."""
        bench = self.campaign.bench
        start = bench.surface
        if self.found:
            start = self.found[min(self.found, key=lambda at: abs(at - x))].surface
        belt = replace(bench.belt, EI=bench.belt.EI * math.exp(x))
        return replace(self.campaign, bench=replace(bench, belt=belt, surface=start))

    def refine_at(self, x: float) -> None:
        """Refine the surface with one stiffness; its density is zero if that does not converge."""
        at = self.campaign_at(x)
        try:
            refined = refine_surface(
                at.bench,
                at.runs,
                self.speeds,
                stated=self.stated,
                reference_degC=self.reference_degC,
            )
        except ConvergenceError:
            self.log_density[x] = -math.inf
        else:
            self.found[x] = refined
            self.log_density[x] = refined.log_evidence - 0.5 * (x / WIDE) ** 2

    def try_outwards(self) -> None:
        """Try factors of two up and down from the stated value; stop where it is unlikely."""
        self.refine_at(0.0)
        for sign in (-1.0, 1.0):
            for k in range(1, OCTAVES + 1):
                x, before = sign * k * math.log(2.0), sign * (k - 1) * math.log(2.0)
                largest = max(self.log_density.values())
                if k > ALWAYS and self.log_density[before] < largest - FAR_BELOW:
                    break
                self.refine_at(x)
        if not self.found:
            raise ConvergenceError(
                "bending stiffness: the surface cannot be refined with any value between "
                f"{2.0**-OCTAVES:g} and {2.0**OCTAVES:g} times the stated one",
                iterations=len(self.log_density),
                residual=math.inf,
            )

    def likely_places(self) -> Array:
        """Return the places of all but negligible density, and their neighbours."""
        x, log_density = self._places()
        near = log_density > log_density.max() - FAR_BELOW
        return x[near | np.append(near[1:], False) | np.append(False, near[:-1])]

    def resolve(self) -> None:
        """Try one place after the other until the integral is known."""
        while len(self.log_density) < MOST_PLACES:
            x = self._top()
            if x is None:
                x = self._least_certain()
            if x is None:
                return
            self.refine_at(x)

    def _top(self) -> float | None:
        """Return the maximum of the parabola through the best three places; None if it is known."""
        x, log_density = self._places()
        best = int(np.argmax(log_density))
        three = slice(best - 1, best + 2)
        if not 0 < best < x.size - 1 or not np.all(np.isfinite(log_density[three])):
            return None
        curvature, slope, _ = np.polyfit(x[three] - x[best], log_density[three], 2)
        if curvature >= 0.0:
            return None
        top = x[best] - 0.5 * slope / curvature
        is_known = np.min(np.abs(x - top)) <= NEAR / math.sqrt(-2.0 * curvature)
        return None if is_known or not x[best - 1] < top < x[best + 1] else float(top)

    def _least_certain(self) -> float | None:
        """Return a place in the interval with the most uncertain integral; None if it is resolved.

        The uncertainty of an interval is its width times the difference of its ends. From the
        higher end the density is assumed to fall like a normal one.
        """
        x, log_density = self._places()
        density, width = np.exp(log_density - log_density.max()), np.diff(x)
        uncertain = width * np.abs(np.diff(density))
        integral = 0.5 * float(width @ (density[1:] + density[:-1]))
        k = int(np.argmax(uncertain))
        if uncertain[k] <= RESOLVED * integral:
            return None
        fall = float(log_density[k + 1] - log_density[k])
        share = min(0.5, math.sqrt(FALL / abs(fall))) if math.isfinite(fall) else 0.5
        return float(x[k] + share * width[k] if fall < 0.0 else x[k + 1] - share * width[k])

    def percentiles(self) -> Array:
        """Compute the 16th, 50th and 84th percentile of x (3,) by interpolating the log density."""
        x, log_density = self._places()
        log_density = np.maximum(log_density - log_density.max(), -4.0 * FAR_BELOW)
        places = np.arange(FINE * (x.size - 1) + 1) / FINE
        fine = np.interp(places, np.arange(x.size), x)
        density = np.exp(PchipInterpolator(x, log_density)(fine))
        share = cumulative_trapezoid(density, fine, initial=0.0)
        return np.interp(PERCENTILES, share / share[-1], fine)

    def _places(self) -> tuple[Array, Array]:
        """Return the places in ascending order, and the log density there."""
        x = np.array(sorted(self.log_density))
        return x, np.array([self.log_density[at] for at in x])

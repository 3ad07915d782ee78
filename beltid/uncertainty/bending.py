"""The bending stiffness of the belt from the runs: what one surface for all of them asks for.

For any EI the surface is refined and the runs have a probability, with the surface, the effects of
the campaign and all other stated errors integrated out and the hyperparameters at their best
(:attr:`beltid.refine.inverse.RefinedSurface.log_evidence`). Its integral over ln EI, with a wide
prior about the stated value in place of the stated uncertainty, gives EI and its uncertainty: the
median, and half of the interval from the 16th to the 84th percentile. Mean and standard deviation
would follow the tail towards a limp belt, whose surface makes up for it by its roughness. No
solution that jumps with the choice of hyperparameters is followed: they are chosen for every EI,
and how far they can make up for a wrong EI is in the width of the evidence. Runs that cannot tell
EI give back the prior.

The places are those that the integral asks for: factors of two about the stated value, then the
top of the parabola through the best three, then wherever the integral knows least.
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
OCTAVES = 3  # factors of two up and down within which EI is looked for
ALWAYS = 2  # of these that are looked at whatever the density in between
FAR_BELOW = 12.0  # of the largest log evidence: nothing beyond is looked at
FALL = 1.5  # of the log density between neighbouring places, aimed at
NEAR = 0.5  # standard deviations of the parabola: a top so near to a place is known
RESOLVED = 0.25  # share of the integral that an interval may leave open
MOST_PLACES = 40
FINE = 100  # steps of the final quadrature in each interval
HARDLY = 0.35  # standard uncertainty of ln EI above which the runs hardly tell it
PERCENTILES = (0.5 * math.erfc(math.sqrt(0.5)), 0.5, 1.0 - 0.5 * math.erfc(math.sqrt(0.5)))
"""Shares of the density below the median and below one standard deviation of a normal one."""


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

    @property
    def is_told(self) -> bool:
        """Whether the runs say much more of it than what is published of belts."""
        return self.relative < HARDLY

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
        If the surface can be refined with none of the stiffnesses looked at.
    """
    others = [source for source in sources if source.error != ERROR]
    rough = _Evidence(campaign, speeds, reference_degC)
    rough.look_outwards()
    at = rough.best
    nearby = rough.campaign_at(at)
    slopes = refined_slopes(nearby, rough.found[at], speeds)
    changes = changes_of_residuals(nearby, others, slopes, rough.found[at].speed_slope)
    evidence = _Evidence(campaign, speeds, reference_degC, -changes, dict(rough.found))
    for x in rough.worth_a_look():
        evidence.look(x)
    evidence.resolve()
    lower, median, upper = evidence.percentiles()
    refinements = len(rough.log_density) + len(evidence.log_density)
    EI = campaign.bench.belt.EI * math.exp(median)
    return FittedBending(EI, 0.5 * (upper - lower), refinements)


@dataclass(slots=True)
class _Evidence:
    """Log density of x = ln(EI/stated EI), up to a constant, at the places looked at.

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
        """Where the density is largest."""
        return max(self.log_density, key=self.log_density.__getitem__)

    def campaign_at(self, x: float) -> Campaign:
        """The campaign with that stiffness, starting from the nearest surface found so far."""
        bench = self.campaign.bench
        start = bench.surface
        if self.found:
            start = self.found[min(self.found, key=lambda at: abs(at - x))].surface
        belt = replace(bench.belt, EI=bench.belt.EI * math.exp(x))
        return replace(self.campaign, bench=replace(bench, belt=belt, surface=start))

    def look(self, x: float) -> None:
        """Refine the surface with one stiffness; the runs exclude one with which it cannot be."""
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

    def look_outwards(self) -> None:
        """By factors of two up and down from the stated value, the last from likely places."""
        self.look(0.0)
        for sign in (-1.0, 1.0):
            for k in range(1, OCTAVES + 1):
                x, before = sign * k * math.log(2.0), sign * (k - 1) * math.log(2.0)
                largest = max(self.log_density.values())
                if k > ALWAYS and self.log_density[before] < largest - FAR_BELOW:
                    break
                self.look(x)
        if not self.found:
            raise ConvergenceError(
                "bending stiffness: the surface can be refined with none between "
                f"{2.0**-OCTAVES:g} and {2.0**OCTAVES:g} times the stated one",
                iterations=len(self.log_density),
                residual=math.inf,
            )

    def worth_a_look(self) -> Array:
        """The places where the density is not far below the largest, and those beside them."""
        x, log_density = self._places()
        near = log_density > log_density.max() - FAR_BELOW
        return x[near | np.append(near[1:], False) | np.append(False, near[:-1])]

    def resolve(self) -> None:
        """Look at one place after the other until the integral is known."""
        while len(self.log_density) < MOST_PLACES:
            x = self._top()
            if x is None:
                x = self._least_known()
            if x is None:
                return
            self.look(x)

    def _top(self) -> float | None:
        """Top of the parabola through the best place and its neighbours; None if it is known."""
        x, log_density = self._places()
        best = int(np.argmax(log_density))
        three = slice(best - 1, best + 2)
        if not 0 < best < x.size - 1 or not np.all(np.isfinite(log_density[three])):
            return None
        curvature, slope, _ = np.polyfit(x[three] - x[best], log_density[three], 2)
        if curvature >= 0.0:
            return None
        top = x[best] - 0.5 * slope / curvature
        known = np.min(np.abs(x - top)) <= NEAR / math.sqrt(-2.0 * curvature)
        return None if known or not x[best - 1] < top < x[best + 1] else float(top)

    def _least_known(self) -> float | None:
        """A place in the interval that leaves most of the integral open; None if that is little.

        An interval leaves open what its ends differ by. From the higher end the density is taken
        to fall as a normal one does.
        """
        x, log_density = self._places()
        density, width = np.exp(log_density - log_density.max()), np.diff(x)
        open_by = width * np.abs(np.diff(density))
        whole = 0.5 * float(width @ (density[1:] + density[:-1]))
        k = int(np.argmax(open_by))
        if open_by[k] <= RESOLVED * whole:
            return None
        fall = float(log_density[k + 1] - log_density[k])
        share = min(0.5, math.sqrt(FALL / abs(fall))) if math.isfinite(fall) else 0.5
        return float(x[k] + share * width[k] if fall < 0.0 else x[k + 1] - share * width[k])

    def percentiles(self) -> Array:
        """16th, 50th and 84th percentile of x (3,); its log density is interpolated."""
        x, log_density = self._places()
        log_density = np.maximum(log_density - log_density.max(), -4.0 * FAR_BELOW)
        places = np.arange(FINE * (x.size - 1) + 1) / FINE
        fine = np.interp(places, np.arange(x.size), x)
        density = np.exp(PchipInterpolator(x, log_density)(fine))
        share = cumulative_trapezoid(density, fine, initial=0.0)
        return np.interp(PERCENTILES, share / share[-1], fine)

    def _places(self) -> tuple[Array, Array]:
        """The places in order, and the log density there."""
        x = np.array(sorted(self.log_density))
        return x, np.array([self.log_density[at] for at in x])

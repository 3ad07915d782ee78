"""What the runs of a campaign show beside the surface: each effect with its uncertainty."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from beltid.refine.effects import ARC, COURSE, ORDER, TEMPERATURE
from beltid.refine.inverse import MODEL_ERROR, RefinedSurface
from beltid.uncertainty.refined import Refined, changes_of_residuals
from beltid.uncertainty.sources import EFFECT_SOURCES

Array = NDArray[np.float64]

TOGETHER, SCATTER = "together", "scatter"
CLEAR = 3.0
"""Standard uncertainties beyond which an effect is no chance."""


@dataclass(frozen=True, slots=True)
class ShownEffect:
    """An effect in the size in which a person reads it.

    Attributes
    ----------
    key : str
        Which one; "scatter" for the friction from run to run, "together" for what run order and
        temperature change over the campaign where it cannot be told which of them does.
    size : float
        Change of ln mu: between the arcs that differ most clearly, from the first run to the last,
        by 10 K, at the most beside the steady change (root mean square); standard deviation of the
        scatter.
    uncertainty : float
        Standard uncertainty of that; nan for the scatter.
    arcs_deg : tuple of float
        The arcs that lie lower and higher [deg]; empty for other effects.
    """

    key: str
    size: float
    uncertainty: float
    arcs_deg: tuple[float, ...] = ()

    @property
    def is_clear(self) -> bool:
        """Whether it is far more than its uncertainty, and than the error of the simulated rig.

        That error is alike in runs that are alike: it looks like an effect.
        """
        return abs(self.size) > CLEAR * math.hypot(self.uncertainty, MODEL_ERROR)


def shown_effects(found: Refined) -> tuple[ShownEffect, ...]:
    """The effects that the runs can show, in a fixed order."""
    seen = _Seen.of(found)
    order, warm = seen.rows(ORDER), seen.rows(TEMPERATURE)
    shown = [
        ShownEffect(key, *seen.change(rows))
        for key, rows in ((ORDER, order), (TEMPERATURE, warm))
        if rows is not None
    ]
    course = seen.rows(COURSE)
    if course is not None:
        shown.append(ShownEffect(COURSE, *seen.root_mean_square(COURSE, course)))
    if order is not None and warm is not None:
        # what a straight line through the temperatures adds to the change over the campaign
        columns = found.refined.columns_of_effects
        x, T = (columns[key][:, 0] for key in (ORDER, TEMPERATURE))
        together = ShownEffect(TOGETHER, *seen.change(order + np.polyfit(x, T, 1)[0] * warm))
        if together.is_clear and not any(one.is_clear for one in shown):
            shown.append(together)
    arcs = seen.rows(ARC)
    if arcs is not None:
        shown.insert(0, _arc_difference(seen, arcs, found.campaign.measured.arcs_deg))
    return (*shown, ShownEffect(SCATTER, found.refined.smoothness.scatter, float("nan")))


def _arc_difference(seen: _Seen, arcs: Array, arcs_deg: Array) -> ShownEffect:
    """The difference between two arcs that is the clearest."""
    pairs = []
    for low, high in itertools.permutations(range(len(arcs)), 2):
        between = tuple(arcs_deg[[low, high]].tolist())
        pairs.append(ShownEffect(ARC, *seen.change(arcs[high] - arcs[low]), between))
    return max(pairs, key=lambda pair: pair.size / pair.uncertainty)


@dataclass(frozen=True, slots=True)
class _Seen:
    """The numbers of all effects (K,) with their covariance (K, K), stated errors included."""

    refined: RefinedSurface
    values: Array
    covariance: Array

    @classmethod
    def of(cls, found: Refined) -> Self:
        refined = found.refined
        stated = [source for source in found.sources if source.error not in EFFECT_SOURCES]
        changes = refined.effects_gain @ changes_of_residuals(
            found.campaign, stated, found.slopes, refined.speed_slope
        )
        values = np.concatenate([np.zeros(0), *(effect.values for effect in refined.effects)])
        return cls(refined, values, refined.effects_covariance + changes @ changes.T)

    def rows(self, key: str) -> Array | None:
        """Weights (K_e, K) that pick the numbers of an effect; None if the runs cannot show it."""
        before = itertools.takewhile(lambda one: one.effect.key != key, self.refined.effects)
        first, effect = sum(one.values.size for one in before), self.refined.effect(key)
        if effect is None:
            return None
        return np.eye(self.values.size)[first : first + effect.values.size]

    def change(self, weights: Array) -> tuple[float, float]:
        """Weighted sum of the numbers and its standard uncertainty."""
        w = np.ravel(weights)
        return float(w @ self.values), float(np.sqrt(w @ self.covariance @ w))

    def root_mean_square(self, key: str, rows: Array) -> tuple[float, float]:
        """Root mean square of an effect over the runs, and that of its standard uncertainty."""
        of_runs = self.refined.columns_of_effects[key] @ rows
        variance = np.einsum("nk,kl,nl->n", of_runs, self.covariance, of_runs)
        mean_square = np.mean(np.square(of_runs @ self.values))
        return float(np.sqrt(mean_square)), float(np.sqrt(np.mean(variance)))

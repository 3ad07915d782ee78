"""What the runs of a campaign show besides the surface: effects, and errors of the bench."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from beltid.refine.inverse import MODEL_ERROR, RefinedSurface
from beltid.refine.posterior import SCATTER
from beltid.uncertainty.sources import ARC, COURSE, ORDER, TEMPERATURE

Array = NDArray[np.float64]

TOGETHER: Final = "together"
CLEAR: Final = 3.0  # standard errors beyond which an effect is significant
CONFOUNDED: Final = 0.9  # share explained by force and speed: variance inflated tenfold
LEAST_EVIDENCE: Final = math.log(20.0)
"""Least log evidence of a clear effect: the runs are 20 times as probable with it as without."""


@dataclass(frozen=True, slots=True)
class ShownEffect:
    """An effect of the campaign and its size for the reader."""

    key: str
    """Key of the effect; "scatter" for the friction from run to run, "together" for the change over
    the campaign by run order and temperature if the runs cannot separate the two."""
    size: float
    """Change of ln mu: between the arcs that differ most clearly; from the first run to the last;
    by 10 K; in addition to the steady change (root mean square); or the standard deviation of the
    scatter."""
    uncertainty: float  # standard uncertainty of the size; nan for the scatter
    arcs_deg: tuple[float, ...] = ()
    """The arcs with the lower and the higher friction [deg]; empty for other effects."""
    explained: float = math.nan
    """Share of the order, its course or the temperature that force and speed of the runs explain
    [-]; nan for others."""
    log_evidence: float = math.inf
    """Logarithm of how much more probable the runs are with the effect than without it, when other
    effects and stated errors may replace it; infinite if its size is too small to compute it."""

    @property
    def is_confounded(self) -> bool:
        """Whether the runs cannot separate it from the surface."""
        return self.explained > CONFOUNDED

    @property
    def is_large(self) -> bool:
        """Whether it far exceeds its uncertainty and the error of the simulated rig.

        That error is similar in similar runs, so it looks like an effect. An effect that force and
        speed explain may as well belong to the surface.
        """
        least = CLEAR * math.hypot(self.uncertainty, MODEL_ERROR)
        return abs(self.size) > least and not self.is_confounded

    @property
    def is_clear(self) -> bool:
        """Whether it is large and nothing else explains the runs equally well."""
        return self.is_large and self.log_evidence > LEAST_EVIDENCE


def contradictions(found: RefinedSurface) -> dict[str, float]:
    """Return errors that contradict their stated size: name -> standard uncertainties."""
    sizes: dict[str, float] = {}
    means, _ = found.stated_errors()
    for source, size in zip(found.stated, np.abs(means).tolist(), strict=True):
        if size > CLEAR:
            sizes[source.name] = max(size, sizes.get(source.name, 0.0))
    return sizes


def shown_effects(found: RefinedSurface) -> tuple[ShownEffect, ...]:
    """Return the effects that the runs can show, in a fixed order."""
    values = np.concatenate([np.zeros(0), *(entry.values for entry in found.effects)])
    covariance = found.effects_covariance
    rows: dict[str, Array] = {}
    first = 0
    for entry in found.effects:
        rows[entry.effect.key] = np.eye(values.size)[first : first + entry.values.size]
        first += entry.values.size

    def change(weights: Array) -> tuple[float, float]:
        """Return a weighted sum of the numbers and its standard uncertainty."""
        w = np.ravel(weights)
        return float(w @ values), float(np.sqrt(w @ covariance @ w))

    def weighed(effect: ShownEffect) -> ShownEffect:
        """Add the share that the surface explains and, if it is large, the evidence for it."""
        keys = (ORDER, COURSE, TEMPERATURE) if effect.key == TOGETHER else (effect.key,)
        entry = found.effect(ORDER if effect.key == TOGETHER else effect.key)
        if entry is not None and effect.key != ARC:
            effect = replace(effect, explained=entry.explained)
        if effect.is_large:  # this takes a search
            effect = replace(effect, log_evidence=found.runs.log_evidence_for(keys))
        return effect

    shown = []
    if ARC in rows:
        arcs_deg, pairs = found.campaign.measured.arcs_deg, []
        for low, high in itertools.permutations(range(len(arcs_deg)), 2):
            between = tuple(arcs_deg[[low, high]].tolist())
            pairs.append(ShownEffect(ARC, *change(rows[ARC][high] - rows[ARC][low]), between))
        shown.append(weighed(max(pairs, key=lambda pair: pair.size / pair.uncertainty)))
    shown += [weighed(ShownEffect(k, *change(rows[k]))) for k in (ORDER, TEMPERATURE) if k in rows]
    columns = {entry.effect.key: entry.effect.columns for entry in found.effects}
    if COURSE in rows:
        of_runs = columns[COURSE] @ rows[COURSE]
        size = np.sqrt(np.mean(np.square(of_runs @ values)))
        variance = np.mean(np.einsum("nk,kl,nl->n", of_runs, covariance, of_runs))
        shown.append(weighed(ShownEffect(COURSE, float(size), float(np.sqrt(variance)))))
    if ORDER in rows and TEMPERATURE in rows:
        # add the effect of the temperature's linear trend over the campaign
        trend = np.polyfit(columns[ORDER][:, 0], columns[TEMPERATURE][:, 0], 1)[0]
        both = weighed(ShownEffect(TOGETHER, *change(rows[ORDER] + trend * rows[TEMPERATURE])))
        if both.is_clear and not any(e.is_clear for e in shown if e.key != ARC):
            shown.append(both)
    return (*shown, ShownEffect(SCATTER, found.sizes[SCATTER], math.nan))

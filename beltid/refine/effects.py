"""Effects that shift the friction of a campaign apart from the surface: arc, order, temperature.

Each effect is a factor on the whole surface, ``ln mu -> ln mu + columns u`` with u normal. The data
determine its size (:mod:`beltid.refine.evidence`): its standard deviation has a wide log-normal
prior, and an effect that is absent does not degrade the surface.

- *Arcs*: one number for each setting, for a wear track or an incorrectly set arc.
- *Run order*: run-in or wear. A steady change from the first run to the last, and its curvature:
  with x from -1 to 1 over the campaign and the Legendre polynomials P_k,

      u P_1(x)/2    and    sum_k u_k P_k(x)/k²,    k = 2, 3, 4.

  Their means over the campaign are zero, so the surface is that of mid-campaign.
- *Temperature*: theta (T - T_ref)/10 K, a straight line. T_ref is the mean of the runs, so that the
  surface belongs to their temperature, or the temperature to which it is corrected. If the
  temperature rises over the campaign, the runs cannot separate it from their order. A user who asks
  for a correction states that temperature is the cause: the prior of the order is then small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Legendre
from numpy.typing import NDArray

Array = NDArray[np.float64]

ARC, ORDER, COURSE = "arc_effect", "order_effect", "course_effect"
TEMPERATURE = "temperature_effect"
# prior of the standard deviation of ln mu: centre and width of its logarithm
BEFORE = {
    ARC: (float(np.log(3.0e-3)), 1.5),
    ORDER: (float(np.log(1.0e-2)), 1.5),
    COURSE: (float(np.log(3.0e-3)), 1.5),
    TEMPERATURE: (float(np.log(1.0e-2)), 1.0),
}
BEFORE_IF_CORRECTED = {ORDER: (float(np.log(1.0e-3)), 1.5), COURSE: (float(np.log(1.0e-3)), 1.5)}
WIDTHS = 2.0  # prior widths beyond which an effect casts doubt on the model of the bench
BENDS = (2, 3, 4)  # degrees of the polynomials of the curvature over the run order
STEP_OF_TEMPERATURE = 10.0  # K
CLEAR = 3.0  # standard errors beyond which an effect is significant
CONFOUNDED = 0.9  # share of an effect explained by force and speed: variance inflated tenfold


@dataclass(frozen=True, slots=True)
class Effect:
    """Numbers that shift ln mu of the runs.

    Attributes
    ----------
    key : str
        Name of the effect and of its source of uncertainty.
    columns : ndarray, shape (n, K)
        Change of ln mu of each run per unit of each number.
    before : tuple of float
        Prior centre and width of ln of the numbers' standard deviation, which the data determine.
    """

    key: str
    columns: Array
    before: tuple[float, float]


@dataclass(frozen=True, slots=True)
class EstimatedEffect:
    """An effect as estimated from the data.

    Attributes
    ----------
    effect : Effect
        The effect.
    size : float
        Standard deviation of its numbers.
    values, covariance : ndarray, shape (K,), (K, K)
        Its numbers and their covariance.
    explained : ndarray, shape (K,)
        Share of each number's column that the surface can explain by force and speed of the
        runs [-].
    """

    effect: Effect
    size: float
    values: Array
    covariance: Array
    explained: Array

    @property
    def largest_usual(self) -> float:
        """Standard deviation of its numbers that 98 % of campaigns do not exceed."""
        centre, width = BEFORE[self.effect.key]
        return float(np.exp(centre + WIDTHS * width))

    @property
    def is_unusual(self) -> bool:
        """Whether its numbers are larger than expected of such an effect."""
        return float(np.sqrt(np.mean(np.square(self.values)))) > self.largest_usual


def campaign_effects(
    arc: NDArray[np.intp], order: Array, temperature: Array, reference: float | None
) -> tuple[Effect, ...]:
    """List the effects that the runs of a campaign can show, as factors on the surface.

    Parameters
    ----------
    arc, order, temperature : ndarray, shape (n,)
        Number of the arc setting, position in the campaign, and temperature [°C] of each run; an
        unknown temperature is set to the mean of the others.
    reference : float or None
        Temperature to which the surface is corrected [°C]; None means that of the runs.
    """
    priors = BEFORE if reference is None else {**BEFORE, **BEFORE_IF_CORRECTED}
    effects = []
    if np.unique(arc).size > 1:
        effects.append(arc_effect(arc))
    if np.ptp(order) > 0.0:
        x = 2.0 * (order - order.min()) / np.ptp(order) - 1.0
        bends = np.column_stack([Legendre.basis(k)(x) / k**2 for k in BENDS])
        effects.append(Effect(ORDER, 0.5 * x[:, None], priors[ORDER]))
        effects.append(Effect(COURSE, bends, priors[COURSE]))
    measured = np.isfinite(temperature)
    if measured.any():
        mean = float(temperature[measured].mean())
        above = np.where(measured, temperature, mean) - (mean if reference is None else reference)
        if np.any(above):
            columns = above[:, None] / STEP_OF_TEMPERATURE
            effects.append(Effect(TEMPERATURE, columns, priors[TEMPERATURE]))
    return tuple(effects)


def arc_effect(arc: NDArray[np.intp]) -> Effect:
    """Build the effect with one number per arc setting from the setting of each run (n,)."""
    return Effect(ARC, np.eye(int(arc.max()) + 1)[arc], BEFORE[ARC])

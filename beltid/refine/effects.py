"""What shifts the friction of a campaign beside the surface: arcs, run order, temperature.

Each effect is a factor on the whole surface, ``ln mu -> ln mu + columns u`` with u normal. How
large it is the data say (:mod:`beltid.refine.evidence`): its standard deviation has a wide
log-normal prior, and an effect that is not there takes nothing from the surface.

- *Arcs*: a wear track, an arc that is set wrongly: a number for each setting.
- *Run order*: run-in or wear. A steady change from the first run to the last, and how its course
  bends: with x from -1 to 1 over the campaign and the Legendre polynomials P_k,

      u P_1(x)/2    and    sum_k u_k P_k(x)/k²,    k = 2, 3, 4.

  Their means over the campaign are zero: the surface is that of its middle.
- *Temperature*: theta (T - T_ref)/10 K, a straight line. T_ref is the mean of the runs, so that the
  surface is that of their temperature, or the temperature to which it is to be corrected. Where the
  temperature rises over the campaign the runs cannot tell it from their order. Who asks for a
  correction says that it is the temperature: little is then left to the order beforehand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Legendre
from numpy.typing import NDArray

Array = NDArray[np.float64]

ARC, ORDER, COURSE = "arc_effect", "order_effect", "course_effect"
TEMPERATURE = "temperature_effect"
STATED = "stated"
# centre and width of ln of the standard deviation of ln mu before the data
BEFORE = {
    ARC: (float(np.log(3.0e-3)), 1.5),
    ORDER: (float(np.log(1.0e-2)), 1.5),
    COURSE: (float(np.log(3.0e-3)), 1.5),
    TEMPERATURE: (float(np.log(1.0e-2)), 1.0),
}
BEFORE_IF_CORRECTED = {ORDER: (float(np.log(1.0e-3)), 1.5), COURSE: (float(np.log(1.0e-3)), 1.5)}
WIDTHS = 2.0  # of an effect beforehand, beyond which the model of the bench is in doubt
BENDS = (2, 3, 4)  # degrees of the polynomials of the course
STEP_OF_TEMPERATURE = 10.0  # K


@dataclass(frozen=True, slots=True)
class Effect:
    """Numbers that shift ln mu of the runs.

    Attributes
    ----------
    key : str
        Which effect it is; the key of its source of uncertainty.
    columns : ndarray, shape (n, K)
        Change of ln mu of each run by each number.
    before : tuple of float, optional
        Centre and width of ln of the numbers' standard deviation, which the data find; None if the
        numbers are errors in units of their stated standard uncertainty.
    """

    key: str
    columns: Array
    before: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class FoundEffect:
    """An effect as the data show it.

    Attributes
    ----------
    effect : Effect
        Which one.
    size : float
        Standard deviation of its numbers.
    values, covariance : ndarray, shape (K,), (K, K)
        Its numbers and their covariance.
    explained : ndarray, shape (K,)
        Share of each number's column that the surface explains, force and speed of the runs [-].
    """

    effect: Effect
    size: float
    values: Array
    covariance: Array
    explained: Array

    @property
    def largest_usual(self) -> float:
        """Standard deviation of its numbers that 98 % of the campaigns do not exceed."""
        centre, width = BEFORE[self.effect.key]
        return float(np.exp(centre + WIDTHS * width))

    @property
    def is_unusual(self) -> bool:
        """Whether its numbers are beyond what such an effect can be expected to be."""
        return float(np.sqrt(np.mean(np.square(self.values)))) > self.largest_usual


def campaign_effects(
    arc: NDArray[np.intp], order: Array, temperature: Array, reference: float | None
) -> tuple[Effect, ...]:
    """Effects that the runs of a campaign may show, as factors on the surface.

    Parameters
    ----------
    arc, order, temperature : ndarray, shape (n,)
        Number of the arc setting, place in the campaign, and temperature [°C] of each run; a
        temperature that is not known is taken for the mean of the others.
    reference : float or None
        Temperature to which the surface is corrected [°C]; None leaves it at that of the runs.
    """
    before = BEFORE if reference is None else {**BEFORE, **BEFORE_IF_CORRECTED}
    found = []
    if np.unique(arc).size > 1:
        found.append(arc_effect(arc))
    if np.ptp(order) > 0.0:
        x = 2.0 * (order - order.min()) / np.ptp(order) - 1.0
        bends = np.column_stack([Legendre.basis(k)(x) / k**2 for k in BENDS])
        found.append(Effect(ORDER, 0.5 * x[:, None], before[ORDER]))
        found.append(Effect(COURSE, bends, before[COURSE]))
    known = np.isfinite(temperature)
    if known.any():
        mean = float(temperature[known].mean())
        above = np.where(known, temperature, mean) - (mean if reference is None else reference)
        if np.any(above):
            columns = above[:, None] / STEP_OF_TEMPERATURE
            found.append(Effect(TEMPERATURE, columns, before[TEMPERATURE]))
    return tuple(found)


def arc_effect(arc: NDArray[np.intp]) -> Effect:
    """A number for each arc setting, of runs by the number of their setting (n,)."""
    return Effect(ARC, np.eye(int(arc.max()) + 1)[arc], BEFORE[ARC])

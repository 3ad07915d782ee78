"""Effects that shift the friction of a campaign apart from the surface: arc, order, temperature.

Each effect is a factor on the whole surface, ``ln mu -> ln mu + columns u`` with u normal. The data
determine its size: its standard deviation has a wide log-normal prior, and an effect that is absent
does not degrade the surface.

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

from beltid.mixed import Size
from beltid.uncertainty.measured import Measured
from beltid.uncertainty.sources import ARC, COURSE, ORDER, TEMPERATURE

Array = NDArray[np.float64]

BEFORE = {
    ARC: Size(3.0e-3, 1.5, largest=0.3),
    ORDER: Size(1.0e-2, 1.5, largest=0.3),
    COURSE: Size(3.0e-3, 1.5, largest=0.3),
    TEMPERATURE: Size(1.0e-2, 1.0, largest=0.3),
}
"""Priors of the standard deviation of ln mu."""
IF_CORRECTED = {key: Size(1.0e-3, 1.5, largest=0.3) for key in (ORDER, COURSE)}
WIDTHS = 2.0  # prior widths beyond which an effect casts doubt on the model of the bench
BENDS = (2, 3, 4)  # degrees of the polynomials of the curvature over the run order
STEP_OF_TEMPERATURE = 10.0  # K


@dataclass(frozen=True, slots=True)
class Effect:
    """Numbers that shift ln mu of the runs."""

    key: str  # name of the effect and of its source of uncertainty
    columns: Array
    """Change of ln mu of each run per unit of each number, by a factor on the surface, (n, K)."""
    size: Size  # prior of the numbers' standard deviation, which the data determine


@dataclass(frozen=True, slots=True)
class EstimatedEffect:
    """An effect as estimated from the data."""

    effect: Effect  # the effect
    size: float  # standard deviation of its numbers
    values: Array  # its numbers, (K,)
    explained: float
    """Share of the effect that the surface can explain by force and speed of the runs [-]."""

    @property
    def largest_usual(self) -> float:
        """Standard deviation of its numbers that 98 % of campaigns do not exceed."""
        before = BEFORE[self.effect.key]
        return float(before.median * np.exp(WIDTHS * before.width))

    @property
    def is_unusual(self) -> bool:
        """Whether its numbers are larger than expected of such an effect."""
        return float(np.sqrt(np.mean(np.square(self.values)))) > self.largest_usual


def campaign_effects(measured: Measured, reference_degC: float | None) -> tuple[Effect, ...]:
    """List the effects that the runs of a campaign can show, as factors on the surface.

    Parameters
    ----------
    measured : Measured
        The runs with arc, position in the campaign and temperature; an unknown temperature is set
        to the mean of the others.
    reference_degC : float or None
        Temperature to which the surface is corrected [°C]; None means that of the runs.
    """
    priors = BEFORE if reference_degC is None else {**BEFORE, **IF_CORRECTED}
    n = measured.mu.size
    order = np.arange(n) if measured.order is None else measured.order
    T = np.full(n, np.nan) if measured.temperature_degC is None else measured.temperature_degC
    columns = {}
    if np.unique(measured.arc).size > 1:
        columns[ARC] = np.eye(int(measured.arc.max()) + 1)[measured.arc]
    if np.ptp(order) > 0.0:
        x = 2.0 * (order - order.min()) / np.ptp(order) - 1.0
        columns[ORDER] = 0.5 * x[:, None]
        columns[COURSE] = np.column_stack([Legendre.basis(k)(x) / k**2 for k in BENDS])
    known = np.isfinite(T)
    if known.any():
        mean = float(T[known].mean())
        above = np.where(known, T, mean) - (mean if reference_degC is None else reference_degC)
        columns[TEMPERATURE] = above[:, None] / STEP_OF_TEMPERATURE
    return tuple(Effect(key, Z, priors[key]) for key, Z in columns.items() if np.any(Z))

"""Where the linear uncertainty is not good enough: replicates against the law of propagation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LARGEST_DEVIATION = 0.20
"""Relative difference of standard uncertainties that is too large."""
LARGEST_ASYMMETRY = 1.25
"""Upper over lower half-width of the 95 % interval, or its inverse, that is too large."""
CHANCE = 3.0
"""Standard errors of a figure from replicates within which it is chance."""
QUANTILES = (0.025, 0.5, 0.975)
# standard errors of figures from n normal replicates, times sqrt(n)
OF_DEVIATION = math.sqrt(0.5)
OF_LOG_ASYMMETRY = 1.9


@dataclass(frozen=True, slots=True)
class LinearCheck:
    """Comparison of replicates with the linear standard uncertainties of some values.

    Attributes
    ----------
    replicates : int
        Number of replicates.
    linear, found : ndarray, shape (n,)
        Standard uncertainties of ln mu: linear, and standard deviation of the replicates.
    deviation : ndarray, shape (n,)
        ``found / linear - 1``.
    asymmetry : ndarray, shape (n,)
        Upper over lower half-width of the interval that holds 95 % of the replicates.
    """

    replicates: int
    linear: Array
    found: Array
    deviation: Array
    asymmetry: Array

    @property
    def too_far(self) -> NDArray[np.bool_]:
        """Values whose standard uncertainty differs by more than a fifth, beyond chance (n,)."""
        chance = CHANCE * OF_DEVIATION / math.sqrt(self.replicates)
        return np.asarray(np.abs(self.deviation) > max(LARGEST_DEVIATION, chance))

    @property
    def lopsided(self) -> NDArray[np.bool_]:
        """Values with an asymmetric distribution, beyond chance (n,)."""
        chance = CHANCE * OF_LOG_ASYMMETRY / math.sqrt(self.replicates)
        return np.asarray(np.abs(np.log(self.asymmetry)) > max(math.log(LARGEST_ASYMMETRY), chance))

    @property
    def fails(self) -> NDArray[np.bool_]:
        """Values for which the linear uncertainty is not good enough (n,)."""
        return self.too_far | self.lopsided

    def row(self, group: str, chosen: NDArray[np.bool_]) -> dict[str, object]:
        """A row that sums up the values chosen by a mask (n,)."""
        if not chosen.any():
            return {"group": group, "values": 0, "linear_fails": 0}
        deviation, asymmetry = self.deviation[chosen], np.log(self.asymmetry[chosen])
        return {
            "group": group,
            "values": int(np.count_nonzero(chosen)),
            "linear_percent": _rms_percent(self.linear[chosen]),
            "monte_carlo_percent": _rms_percent(self.found[chosen]),
            "largest_deviation_percent": 100.0 * float(deviation[np.argmax(np.abs(deviation))]),
            "largest_asymmetry": float(np.exp(asymmetry[np.argmax(np.abs(asymmetry))])),
            "linear_fails": int(np.count_nonzero(self.fails[chosen])),
        }


def linear_check(replicates: Array, linear: Array) -> LinearCheck:
    """Compare replicates (N, n) of ln mu with linear standard uncertainties (n,).

    A value without uncertainty on both sides agrees.
    """
    low, middle, high = np.quantile(replicates, QUANTILES, axis=0)
    found = np.std(replicates, axis=0, ddof=1)
    none = (linear <= 0.0) | (found <= 0.0)
    safe = np.where(none, 1.0, linear)
    lower, upper = np.where(none, 1.0, middle - low), np.where(none, 1.0, high - middle)
    return LinearCheck(
        replicates=replicates.shape[0],
        linear=linear,
        found=found,
        deviation=np.where(none, 0.0, found / safe - 1.0),
        asymmetry=upper / lower,
    )


def _rms_percent(values: Array) -> float:
    return 100.0 * float(np.sqrt(np.mean(np.square(values))))

"""Normal contact laws beside the quadratic one of Eq. (3), for comparison.

All are forces per length of belt over the penetration ``delta = -g_N``, zero without contact.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def polynomial_force(penetration_m: ArrayLike, coefficients: Sequence[float]) -> Array:
    """Force ``k_1 delta + k_2 delta² + ...`` [N/m].

    Parameters
    ----------
    penetration_m : array_like
        Penetration [m]; negative values mean an open gap.
    coefficients : sequence of float
        k_1 [N/m²], k_2 [N/m³], ...: one is the linear law, two are Eq. (3), three the cubic law.
    """
    delta = np.maximum(np.asarray(penetration_m, dtype=float), 0.0)
    force = np.zeros_like(delta)
    for k in reversed(coefficients):
        force = delta * (k + force)
    return force


def power_force(penetration_m: ArrayLike, k: float, n: float) -> Array:
    """Force ``k delta^n`` [N/m].

    Parameters
    ----------
    penetration_m : array_like
        Penetration [m]; negative values mean an open gap.
    k : float
        Factor [N/m^(1+n)]; its unit depends on the exponent.
    n : float
        Exponent, > 0: 1 is a linear spring, 3/2 a Hertzian point contact.
    """
    return k * np.maximum(np.asarray(penetration_m, dtype=float), 0.0) ** n

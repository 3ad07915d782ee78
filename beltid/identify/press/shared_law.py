"""Mean correlation time of several residuals: for the friction laws of a surface only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from beltid.identify.estimators.statistics import integrated_autocorrelation_time


def correlation_time(parts: Sequence[NDArray[np.float64]]) -> float:
    """Mean integrated autocorrelation time of residuals of several curves [nodes]."""
    sizes = np.array([r.size for r in parts], dtype=float)
    return float(sizes @ [integrated_autocorrelation_time(r) for r in parts] / sizes.sum())

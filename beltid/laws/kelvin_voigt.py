"""Kelvin–Voigt material of the belt, Eq. (9), integrated over the section."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def section_force(
    stiffness: float, strain: ArrayLike, strain_rate: ArrayLike, damping_time: float
) -> NDArray[np.float64]:
    """Resultant of ``sigma = E eps + c d(eps)/dt`` over the section, Eq. (9).

    Parameters
    ----------
    stiffness : float
        EA [N] for the axial force, EI [N m²] for the bending moment.
    strain, strain_rate : array_like
        Axial strain [-] and its rate [1/s], or curvature [1/m] and its rate [1/(m s)].
    damping_time : float
        c/E [s].
    """
    eps = np.asarray(strain, dtype=float)
    return stiffness * (eps + damping_time * np.asarray(strain_rate, dtype=float))

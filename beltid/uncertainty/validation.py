"""Simulated less measured in units of its standard uncertainty (ASME V&V 20).

With the comparison error E = S - D of simulation and experiment, and the errors of the model, of
its inputs, of its numerics and of the data, E says something about the model only beyond

    u_val² = u_num² + u_input² + u_D²

(ASME V&V 20-2009, Eq. 1-5-9). Where inputs and data share errors the squares may not be added one
by one: each shared error's change of E comes in whole (section 5-3 there), which is done here. The
scatter behind the surface is added as if it were independent of the run's own; where the surface
was made from the same runs this is on the safe side by the few percent that one run weighs in it.
A setting that the bench missed while the simulation was given the nominal one is a known error that
is not corrected: it counts in full.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WITHIN = 2.0
"""Standard uncertainties within which a difference says nothing about the model."""


@dataclass(frozen=True, slots=True)
class Validation:
    """Relative standard uncertainties of compared runs, arrays (n,).

    Attributes
    ----------
    measured : ndarray
        Of the measured coefficient, shared errors and scatter.
    measured_scatter : ndarray
        Its scatter alone.
    simulated_scatter : ndarray
        Of the simulated coefficient by scatter.
    numerical : ndarray
        Of the simulated coefficient by mesh and time steps.
    settings : ndarray
        Change of the coefficient by the settings that the bench missed.
    simulated : ndarray, shape (n, K)
        Changes of the simulated coefficient by each shared source.
    difference : ndarray, shape (n, K)
        Changes of the difference by each shared source.
    """

    measured: Array
    measured_scatter: Array
    simulated_scatter: Array
    numerical: Array
    settings: Array
    simulated: Array
    difference: Array

    @property
    def u_input(self) -> Array:
        """Of the simulated coefficient by its inputs (n,)."""
        shared = np.sum(np.square(self.simulated), axis=1)
        own = np.square(self.simulated_scatter) + np.square(self.settings)
        return np.asarray(np.sqrt(shared + own))

    @property
    def u_validation(self) -> Array:
        """Of the difference (n,)."""
        parts = (self.measured_scatter, self.simulated_scatter, self.numerical, self.settings)
        total = np.sum(np.square(self.difference), axis=1)
        return np.asarray(np.sqrt(total + sum(np.square(part) for part in parts)))

"""Normal contact between belt and pulley: the penalty law, Eq. (3).

The paper uses the gap g_N, which is *negative* in contact, and mixes centimetres of belt with
metres of deformation. This module uses the penetration ``delta = -g_N >= 0`` in SI units per metre
of belt, so that Eq. (3) becomes ``f_N(delta) = k_linear delta + k_quadratic delta**2`` [N/m].
"""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from beltid.arrays import Array
from beltid.errors import InputError

Number = TypeVar("Number", float, Array)


def elastic_force(delta: Number, k_linear: float, k_quadratic: float) -> Number:
    """Compute the line force at a penetration ``delta`` >= 0 [m], Eq. (3) [N/m]."""
    return delta * (k_linear + k_quadratic * delta)


def elastic_stiffness(delta: Number, k_linear: float, k_quadratic: float) -> Number:
    """Differentiate Eq. (3) with respect to the penetration [N/m²]."""
    return k_linear + 2.0 * k_quadratic * delta


def elastic_energy(delta: Number, k_linear: float, k_quadratic: float) -> Number:
    """Integrate Eq. (3) over the penetration: energy per length [J/m]."""
    return (k_linear / 2.0 + k_quadratic * delta / 3.0) * delta * delta


@dataclass(frozen=True, slots=True)
class NormalLaw:
    """Quadratic elastic normal contact law, Eq. (3).

    Parameters
    ----------
    k_linear_N_m2 : float
        Coefficient of the penetration [N/m²], >= 0.
    k_quadratic_N_m3 : float
        Coefficient of the squared penetration [N/m³], >= 0; not both zero, else an InputError.
    """

    k_linear_N_m2: float
    k_quadratic_N_m3: float = 0.0

    def __post_init__(self) -> None:
        values = (self.k_linear_N_m2, self.k_quadratic_N_m3)
        names = ("k_linear_N_m2", "k_quadratic_N_m3")
        problems = [
            f"{name} = {value:g}, must be >= 0 and finite"
            for name, value in zip(names, values, strict=True)
            if not (value >= 0 and np.isfinite(value))
        ]
        if not any(values):
            problems = [f"{' and '.join(names)} are both 0: the contact has no stiffness"]
        if problems:
            raise InputError(problems)

    def force(self, penetration_m: ArrayLike) -> Array:
        """Compute the line force [N/m] at a penetration [m], Eq. (3); zero in an open gap, < 0."""
        delta = np.maximum(np.asarray(penetration_m, dtype=float), 0.0)
        return elastic_force(delta, self.k_linear_N_m2, self.k_quadratic_N_m3)

    def stiffness(self, penetration_m: ArrayLike) -> Array:
        """Differentiate :meth:`force` with respect to the penetration [N/m²]."""
        delta = np.asarray(penetration_m, dtype=float)
        slope = elastic_stiffness(delta, self.k_linear_N_m2, self.k_quadratic_N_m3)
        return np.where(delta > 0.0, slope, 0.0)

    def penetration(self, force_N_m: ArrayLike) -> Array:
        """Compute the penetration [m] under a line force [N/m], the inverse of :meth:`force`.

        A negative force raises an InputError.
        """
        f = np.asarray(force_N_m, dtype=float)
        if np.any(f < 0):
            raise InputError(f"force_N_m = {float(np.min(f)):g}, must be >= 0: contact only pushes")
        k1, k2 = self.k_linear_N_m2, self.k_quadratic_N_m3
        root = k1 + np.sqrt(k1 * k1 + 4.0 * k2 * f)  # no cancellation as k2 goes to zero
        return np.divide(2.0 * f, root, out=np.zeros_like(f), where=root > 0.0)

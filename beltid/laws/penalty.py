"""Normal contact between belt and pulley: the penalty law, Eqs. (1) to (4).

The paper measures the gap g_N, which is *negative* in contact, and mixes centimetres of belt with
metres of deformation. Here the penetration ``delta = -g_N >= 0`` is used, in SI units per metre of
belt, so that Eq. (3) reads ``f_N(delta) = k_linear delta + k_quadratic delta**2`` [N/m].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import InputError


@dataclass(frozen=True, slots=True)
class NormalLaw:
    """Quadratic elastic normal contact law, Eq. (3).

    Parameters
    ----------
    k_linear_N_m2 : float
        Coefficient of the penetration [N/m²], >= 0.
    k_quadratic_N_m3 : float
        Coefficient of the squared penetration [N/m³], >= 0; not both zero.

    Raises
    ------
    InputError
        If a coefficient is negative or not finite, or both are zero.
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
        if not problems and max(values) == 0.0:
            problems = [
                "k_linear_N_m2 and k_quadratic_N_m3 are both 0: the contact has no stiffness"
            ]
        if problems:
            raise InputError(problems)

    def force(self, penetration_m: ArrayLike) -> NDArray[np.float64]:
        """Line force of a penetration, Eq. (3); zero without contact.

        Parameters
        ----------
        penetration_m : array_like
            Penetration delta = -g_N [m]; negative values mean an open gap.

        Returns
        -------
        ndarray
            Normal force per length of belt [N/m], >= 0.
        """
        delta = np.maximum(np.asarray(penetration_m, dtype=float), 0.0)
        return delta * (self.k_linear_N_m2 + self.k_quadratic_N_m3 * delta)

    def stiffness(self, penetration_m: ArrayLike) -> NDArray[np.float64]:
        """Derivative of :meth:`force` with respect to the penetration [N/m²]."""
        delta = np.asarray(penetration_m, dtype=float)
        slope = self.k_linear_N_m2 + 2.0 * self.k_quadratic_N_m3 * delta
        return np.where(delta > 0.0, slope, 0.0)

    def penetration(self, force_N_m: ArrayLike) -> NDArray[np.float64]:
        """Penetration under a line force: the inverse of :meth:`force`.

        Parameters
        ----------
        force_N_m : array_like
            Normal force per length of belt [N/m], >= 0.

        Returns
        -------
        ndarray
            Penetration [m]. The form of the root has no cancellation as k_quadratic goes to zero.

        Raises
        ------
        InputError
            If a force is negative.
        """
        f = np.asarray(force_N_m, dtype=float)
        if np.any(f < 0):
            raise InputError(f"force_N_m = {float(np.min(f)):g}, must be >= 0: contact only pushes")
        k1, k2 = self.k_linear_N_m2, self.k_quadratic_N_m3
        root = k1 + np.sqrt(k1 * k1 + 4.0 * k2 * f)
        return np.divide(2.0 * f, root, out=np.zeros_like(f), where=root > 0.0)


def approaching(g_N_dot: ArrayLike) -> NDArray[np.float64]:
    """Step function of Eq. (2): 1 while the bodies approach (g_N_dot <= 0), else 0."""
    return np.where(np.asarray(g_N_dot, dtype=float) <= 0.0, 1.0, 0.0)


def dissipative_force(g_N_dot: ArrayLike, C_P: float) -> NDArray[np.float64]:
    """Dissipative part of the normal force, second term of Eq. (1) with Eqs. (2) and (4).

    Parameters
    ----------
    g_N_dot : array_like
        Rate of the gap [m/s], negative while approaching.
    C_P : float
        Damping of one contact point [N s/m].

    Returns
    -------
    ndarray
        Force that pushes the bodies apart [N], >= 0; zero while they separate.
    """
    rate = np.asarray(g_N_dot, dtype=float)
    return approaching(rate) * C_P * -np.minimum(rate, 0.0)

"""Reduced runs of a friction rig, and the same runs with errors put right."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError
from beltid.laws.capstan import mean_normal_force, sliding_speed
from beltid.uncertainty.sources import Errors

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Measured:
    """Reduced runs of a friction rig, arrays (n,).

    Attributes
    ----------
    R : float
        Radius of the belt's centreline on the pulley [m].
    arc : ndarray of int
        Number of the arc setting.
    beta : ndarray
        Contact arc [rad].
    T_0 : ndarray
        Initial tension [N], mean of both cells.
    omega : ndarray
        Speed of the pulley [rad/s].
    tight, slack : ndarray
        Tensions while sliding [N].
    mu, mu_se : ndarray
        Sliding coefficient by Eq. (6) and its standard error by the scatter of the run [-].
    """

    R: float
    arc: NDArray[np.intp]
    beta: Array
    T_0: Array
    omega: Array
    tight: Array
    slack: Array
    mu: Array
    mu_se: Array

    @property
    def arcs_deg(self) -> Array:
        """Contact arc of each setting, in the order of their numbers [deg]."""
        numbers = range(int(self.arc.max()) + 1)
        return np.array([np.degrees(self.beta[self.arc == k].mean()) for k in numbers])

    @property
    def normal_force(self) -> Array:
        """Mean of Eq. (8) over the arc [N/m]."""
        return mean_normal_force(self.tight, self.slack, self.R)

    @property
    def slip_speed(self) -> Array:
        """Sliding speed, Eq. (7) [m/s]."""
        return sliding_speed(self.omega, self.R)

    def corrected(self, errors: Errors) -> Self:
        """The runs with errors put right: each value as it would truly have been.

        Raises
        ------
        InputError
            If an error is as large as what it is an error of.
        """
        gain = errors.at("tension_gain")
        gains = [gain + errors.at("cell_gain", k) for k in (0, 1)]
        zeros = [errors.at("cell_offset", k) for k in (0, 1)]
        tight = self.tight * (1.0 + gains[0]) + zeros[0]
        slack = self.slack * (1.0 + gains[1]) + zeros[1]
        setting = np.array([errors.at("arc_setting", int(k)) for k in self.arc])
        beta = self.beta + errors.at("arc") + setting
        T_0 = self.T_0 * (1.0 + 0.5 * sum(gains)) + 0.5 * sum(zeros)
        lowest = min(float(np.min(a)) for a in (tight, slack, beta, T_0))
        if not lowest > 0.0:
            raise InputError(
                "uncertainty: an error of the load cells or of the arc is as large as a tension or "
                f"an arc itself (lowest tension {np.min(self.slack):.3g} N, shortest arc "
                f"{np.degrees(np.min(self.beta)):.3g} deg), must be small against them"
            )
        log_ratio = self.mu * self.beta + np.log(tight / self.tight) - np.log(slack / self.slack)
        return replace(
            self,
            R=self.R * (1.0 + errors.at("pulley_radius")),
            beta=beta,
            T_0=T_0,
            omega=self.omega * (1.0 + errors.at("pulley_speed")),
            tight=tight,
            slack=slack,
            mu=log_ratio / beta,
        )

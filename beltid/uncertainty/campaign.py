"""A friction campaign, and the same campaign with the errors of its benches put right."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from beltid.laws.capstan import mean_normal_force
from beltid.params import Belt, OperatingPoint, Rig
from beltid.refine.rig_runs import MeasuredRun
from beltid.rigsim.model import Bench
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.sources import Errors

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Campaign:
    """Reduced runs of a friction rig with their benches, arrays (n,).

    Attributes
    ----------
    bench : Bench
        Belt, rig, and the surface that the inverse solution starts from.
    press : PressLaw
        The contact law and its making.
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

    bench: Bench
    press: PressLaw
    arc: NDArray[np.intp]
    beta: Array
    T_0: Array
    omega: Array
    tight: Array
    slack: Array
    mu: Array
    mu_se: Array

    @property
    def normal_force(self) -> Array:
        """Mean of Eq. (8) over the arc [N/m]."""
        return mean_normal_force(self.tight, self.slack, self.bench.rig.R)

    @property
    def slip_speed(self) -> Array:
        """Sliding speed, Eq. (7) [m/s]."""
        return self.omega * self.bench.rig.R

    @property
    def runs(self) -> list[MeasuredRun]:
        """The runs as the inverse solution takes them."""
        rows = zip(self.beta, self.T_0, self.omega, self.mu, self.mu_se, strict=True)
        return [
            MeasuredRun(OperatingPoint(float(b), float(T), float(w)), float(m), float(s))
            for b, T, w, m, s in rows
        ]

    def corrected(self, errors: Errors) -> Self:
        """The campaign with errors put right: each value as it would truly have been."""
        gain = errors.at("tension_gain")
        gains = [gain + errors.at("cell_gain", k) for k in (0, 1)]
        zeros = [errors.at("cell_offset", k) for k in (0, 1)]
        tight = self.tight * (1.0 + gains[0]) + zeros[0]
        slack = self.slack * (1.0 + gains[1]) + zeros[1]
        setting = np.array([errors.at("arc_setting", int(k)) for k in self.arc])
        beta = self.beta + errors.at("arc") + setting
        log_ratio = self.mu * self.beta + np.log(tight / self.tight) - np.log(slack / self.slack)
        return replace(
            self,
            bench=self._bench(errors),
            beta=beta,
            T_0=self.T_0 * (1.0 + 0.5 * sum(gains)) + 0.5 * sum(zeros),
            omega=self.omega * (1.0 + errors.at("pulley_speed")),
            tight=tight,
            slack=slack,
            mu=log_ratio / beta,
        )

    def _bench(self, errors: Errors) -> Bench:
        belt, rig = self.bench.belt, self.bench.rig
        return replace(
            self.bench,
            belt=Belt(
                EA=belt.EA * (1.0 + errors.at("axial_stiffness")),
                EI=belt.EI * (1.0 + errors.at("bending_stiffness")),
                rhoA=belt.rhoA,
                damping_time=belt.damping_time,
            ),
            rig=Rig(
                R=rig.R * (1.0 + errors.at("pulley_radius")),
                span=rig.span + errors.at("span_length"),
                supports=rig.supports,
            ),
            law=self.press.corrected(errors),
        )

"""A friction campaign: runs and the bench they are simulated on, and both with errors corrected.

A separate module from the runs, so that reducing recordings does not import the simulator.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from beltid.params import OperatingPoint
from beltid.refine.rig_runs import MeasuredRun
from beltid.rig.model import Bench
from beltid.uncertainty.measured import Measured
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.sources import Errors


@dataclass(frozen=True, slots=True)
class Campaign:
    """Measured runs and the bench on which they are simulated.

    Attributes
    ----------
    measured : Measured
        The runs.
    bench : Bench
        Belt, rig, and the surface that the inverse solution starts from.
    press : PressLaw
        The contact law and its fit to the press.
    """

    measured: Measured
    bench: Bench
    press: PressLaw

    @property
    def runs(self) -> list[MeasuredRun]:
        """Runs in the form that the inverse solution needs."""
        m = self.measured
        points = zip(m.beta, m.T_0, m.omega, strict=True)
        order = range(m.mu.size) if m.order is None else m.order
        T = np.full(m.mu.size, np.nan) if m.temperature_degC is None else m.temperature_degC
        rows = zip(points, m.mu, m.mu_se, m.arc, order, T, strict=True)
        return [
            MeasuredRun(
                point=OperatingPoint(*map(float, point)),
                mu=float(mu),
                mu_se=float(mu_se),
                arc=int(arc),
                order=int(order),
                temperature_degC=float(temperature),
            )
            for point, mu, mu_se, arc, order, temperature in rows
        ]

    def corrected(self, errors: Errors) -> Self:
        """Return runs and bench with errors corrected."""
        belt, rig = self.bench.belt, self.bench.rig
        measured = self.measured.corrected(errors)
        bench = replace(
            self.bench,
            belt=replace(
                belt,
                EA=belt.EA * (1.0 + errors.at("axial_stiffness")),
                EI=belt.EI * (1.0 + errors.at("bending_stiffness")),
            ),
            rig=replace(rig, R=measured.R, span=rig.span + errors.at("span_length")),
            law=self.press.corrected(errors),
        )
        return replace(self, measured=measured, bench=bench)

"""A friction campaign: runs and the bench they are simulated on, and both with errors corrected.

Apart from the runs themselves: whoever only reduces recordings loads no simulator.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from beltid.params import OperatingPoint
from beltid.refine.rig_runs import MeasuredRun
from beltid.rigsim.model import Bench
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
        The contact law and its making.
    """

    measured: Measured
    bench: Bench
    press: PressLaw

    @property
    def runs(self) -> list[MeasuredRun]:
        """The runs as the inverse solution takes them."""
        of = self.measured
        points = zip(of.beta, of.T_0, of.omega, strict=True)
        order = range(of.mu.size) if of.order is None else of.order
        warm = np.full(of.mu.size, np.nan) if of.temperature_degC is None else of.temperature_degC
        rows = zip(points, of.mu, of.mu_se, of.arc, order, warm, strict=True)
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
        """Runs and bench with errors put right."""
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

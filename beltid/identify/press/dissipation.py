"""Estimate of the damping C_P of Eq. (4) from the hysteresis of the press.

The paper chose C_P = 300 N s/m for numerical stability. A damper that acts on approach only, Eqs.
(1), (2) and (4), loses as much energy in a loading as the belt loses in a press cycle with

    W = c_P v delta_max,      C_P = c_P l,

with the energy W lost per metre of belt [J/m], the speed v of the press, c_P per metre of belt
[N s/m²] and the belt length l of a contact point. The hysteresis of rubber hardly depends on the
rate, so the result is valid *only* at the speed of the press.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from beltid.errors import InputError
from beltid.identify.press.curves import PressCurve

POINT_LENGTH_M = 1.0e-3
"""Belt length of a contact point: an elastic-bed length of 5 mm contains five points."""


@dataclass(frozen=True, slots=True)
class Dissipation:
    """Energy lost by the belt in a press cycle, and the equivalent damper."""

    energy_J_m: float  # energy lost per cycle and metre of belt, mean over the cycles
    loss_ratio: float  # energy lost over the work of loading
    approach_speed_m_s: float  # speed in contact, mean over the cycles
    C_P_N_s_m: float  # equivalent coefficient of one contact point at this speed

    @property
    def statement(self) -> str:
        """Result in plain words."""
        return (
            f"Each cycle loses {self.energy_J_m:.3g} J per metre of belt, "
            f"{100 * self.loss_ratio:.2g} % of the work put in. To lose this at the press's "
            f"{self.approach_speed_m_s * 1e6:.3g} µm/s, the damper of Eq. (1) needs C_P = "
            f"{self.C_P_N_s_m:.3g} N s/m per contact point of {POINT_LENGTH_M * 1e3:g} mm (the "
            "paper takes 300 N s/m to calm the computation). The loss of rubber hardly depends on "
            "the speed: at another speed C_P would be another."
        )


def estimate_dissipation(curves: Sequence[PressCurve]) -> Dissipation:
    """Estimate the dissipation of the contact from the hysteresis of press curves.

    Raises :class:`InputError` if no test was unloaded, or if the clock of a test stands still.
    """
    curves = [c for c in curves if c.unloads]
    if not curves:
        raise InputError("press recording: no test was unloaded, so the hysteresis is unknown")
    if not all(c.recorded.sample_interval_s > 0.0 for c in curves):
        raise InputError("the clock of a test does not run, so the speed is unknown")
    depths = np.array([np.max(c.branches[0].position_m) - c.touch_m for c in curves])
    samples = [np.count_nonzero(c.branches[0].position_m > c.touch_m) for c in curves]
    speeds = depths / (np.array(samples) * [c.recorded.sample_interval_s for c in curves])
    energies = np.array([c.dissipated_J_m for c in curves])
    return Dissipation(
        energy_J_m=float(np.mean(energies)),
        loss_ratio=loss_ratio(curves),
        approach_speed_m_s=float(np.mean(speeds)),
        C_P_N_s_m=float(np.mean(energies / (speeds * depths))) * POINT_LENGTH_M,
    )


def loss_ratio(curves: Sequence[PressCurve]) -> float:
    """Return the work lost in the loops over the work of loading; nan without unloading."""
    work = np.array([(c.dissipated_J_m, c.stored_J_m) for c in curves if c.unloads])
    return float(np.divide(*work.sum(axis=0))) if work.size else math.nan

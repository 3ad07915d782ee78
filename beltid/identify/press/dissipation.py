"""Estimate of the damping C_P of Eq. (4) from the hysteresis of the press.

The paper chose C_P = 300 N s/m for numerical stability. This module calculates the coefficient with
which a damper that acts on approach only, Eqs. (1), (2) and (4), loses as much energy in a loading
as the belt loses in a press cycle,

    W = c_P ∫ delta_dot d(delta),      C_P = c_P l,

with the energy W lost per metre of belt [J/m], c_P per metre of belt [N s/m²] and the belt length l
of a contact point. The hysteresis of rubber hardly depends on the rate, so the result is valid
*only* at the speed of the press: it is inversely proportional to that speed.
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
BINS = 12


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
    without_clock = sorted({c.test for c in curves if not c.recorded.sample_interval_s > 0.0})
    if without_clock:
        raise InputError(
            [f"test {t}: the clock does not run, so the speed is unknown" for t in without_clock]
        )
    speeds, rate_integrals = np.transpose([approach(c) for c in curves])
    energies = np.array([c.dissipated_J_m for c in curves])
    return Dissipation(
        energy_J_m=float(np.mean(energies)),
        loss_ratio=loss_ratio(curves),
        approach_speed_m_s=float(np.mean(speeds)),
        C_P_N_s_m=float(np.mean(energies / rate_integrals)) * POINT_LENGTH_M,
    )


def loss_ratio(curves: Sequence[PressCurve]) -> float:
    """Return the work lost in the loops over the work of loading; nan without unloading."""
    work = np.array([(c.dissipated_J_m, c.stored_J_m) for c in curves if c.unloads])
    return float(np.divide(*work.sum(axis=0))) if work.size else math.nan


def approach(curve: PressCurve) -> tuple[float, float]:
    """Return the mean speed [m/s] and ``∫ delta_dot d(delta)`` [m²/s] of a loading, or nan."""
    x = curve.branches[0].position_m
    edges = np.linspace(curve.touch_m, float(np.max(x)), BINS + 1)
    counts = np.histogram(x, edges)[0].astype(float)
    width = float(edges[1] - edges[0])
    counts[-1] = np.median(counts)  # the crosshead dwells or turns in the last bin
    if counts.min() < 3:
        counts[:] = np.mean(counts)
    durations = counts * curve.recorded.sample_interval_s
    return float(BINS * width / durations.sum()), float(np.sum(width**2 / durations))

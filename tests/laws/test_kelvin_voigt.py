"""Kelvin–Voigt section force: elastic, viscous, and the work lost in a cycle."""

from __future__ import annotations

import numpy as np
import pytest

from beltid.laws.kelvin_voigt import section_force

EA, TAU = 1.0e5, 1.0e-4


def test_steady_strain_gives_hooke() -> None:
    assert section_force(EA, 2.7e-3, 0.0, TAU) == pytest.approx(270.0)
    assert section_force(EA, -1e-3, 0.0, TAU) == pytest.approx(-100.0)


def test_cycle_of_strain_loses_pi_EA_tau_omega_amplitude_squared() -> None:
    omega, amplitude = 50.0, 1e-3
    power = []
    for phase in np.arange(64) * (2 * np.pi / 64):
        rate = amplitude * omega * np.cos(phase)
        power.append(section_force(EA, amplitude * np.sin(phase), rate, TAU) * rate)
    work = np.mean(power) * 2 * np.pi / omega  # periodic: the mean is spectrally exact
    assert work == pytest.approx(np.pi * EA * TAU * omega * amplitude**2, rel=1e-10)

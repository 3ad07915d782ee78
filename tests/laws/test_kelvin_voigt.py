"""Kelvin–Voigt section force: elastic, viscous, and the work lost in a cycle."""

from __future__ import annotations

import numpy as np
import pytest

from beltid.laws.kelvin_voigt import section_force

EA, TAU = 1.0e5, 1.0e-4


def test_steady_strain_gives_hooke() -> None:
    strain = np.array([-1e-3, 0.0, 2.7e-3])
    assert section_force(EA, strain, 0.0, TAU) == pytest.approx([-100.0, 0.0, 270.0])


def test_rate_adds_stiffness_times_damping_time() -> None:
    assert section_force(EA, 0.0, 3.0, TAU) == pytest.approx(30.0)


def test_cycle_of_strain_loses_pi_EA_tau_omega_amplitude_squared() -> None:
    omega, amplitude = 50.0, 1e-3
    t = np.arange(4096) * (2 * np.pi / omega / 4096)
    rate = amplitude * omega * np.cos(omega * t)
    force = section_force(EA, amplitude * np.sin(omega * t), rate, TAU)
    work = np.mean(force * rate) * 2 * np.pi / omega  # periodic: the mean is spectrally exact
    assert work == pytest.approx(np.pi * EA * TAU * omega * amplitude**2, rel=1e-10)

"""Normal contact law and material of the belt against the paper's check points and closed forms."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from beltid.errors import InputError
from beltid.laws.penalty import NormalLaw, elastic_energy
from beltid.rig.forces import section_force

PAPER = NormalLaw(k_linear_N_m2=6.5e7, k_quadratic_N_m3=3.0256e11)
stiffness = st.floats(1e3, 1e13)


@pytest.mark.parametrize(
    ("force_N_cm", "penetration_um"), [(10, 14.4), (40, 49.9), (80, 87.5), (150, 139.8)]
)
def test_paper_check_points_hold_both_ways(force_N_cm: float, penetration_um: float) -> None:
    # the check points carry three digits: half a unit of the last is 0.05 um
    assert PAPER.penetration(100.0 * force_N_cm) == pytest.approx(1e-6 * penetration_um, abs=5e-8)
    slope = 6.5e7 + 2 * 3.0256e11 * 1e-6 * penetration_um
    assert PAPER.force(1e-6 * penetration_um) == pytest.approx(
        100.0 * force_N_cm, abs=5.1e-8 * slope
    )


def test_open_gap_has_neither_force_nor_stiffness() -> None:
    gap = np.array([-1e-3, -1e-9, 0.0])
    assert np.array_equal(PAPER.force(gap), np.zeros(3))
    assert np.array_equal(PAPER.stiffness(gap), np.zeros(3))  # touching does not press yet


@given(st.floats(1e-7, 1e-3), stiffness, stiffness)
def test_stiffness_is_the_derivative_of_the_force(delta: float, k1: float, k2: float) -> None:
    law = NormalLaw(k1, k2)
    h = 1e-4 * delta
    # central differences of a quadratic are exact up to rounding
    slope = (law.force(delta + h) - law.force(delta - h)) / (2 * h)
    assert law.stiffness(delta) == pytest.approx(slope, rel=1e-9)


@given(st.floats(0, 1e6), stiffness, st.one_of(st.just(0.0), st.floats(1e-30, 1e13)))
def test_penetration_inverts_the_force_without_cancellation(f: float, k1: float, k2: float) -> None:
    law = NormalLaw(k1, k2)
    assert law.force(law.penetration(f)) == pytest.approx(f, rel=1e-12)


def test_soft_and_weak_contacts_obey_the_same_law() -> None:
    assert NormalLaw(1e-3).penetration([0.0, 1e-3]) == pytest.approx([0.0, 1.0], rel=1e-15)
    assert NormalLaw(0.0, 1e-6).penetration(1e-8) == pytest.approx(0.1, rel=1e-14)


def test_pulling_force_has_no_penetration() -> None:
    with pytest.raises(InputError, match="force_N_m = -1, must be >= 0"):
        PAPER.penetration([1.0, -1.0])


def test_coefficients_that_are_no_law_are_refused() -> None:
    with pytest.raises(InputError) as error:
        NormalLaw(-1.0, float("nan"))
    assert len(error.value.problems) == 2
    with pytest.raises(InputError, match="no stiffness"):
        NormalLaw(0.0, 0.0)


@pytest.mark.parametrize(("k1", "k2"), [(6.5e7, 3.0256e11), (6.5e7, 0.0), (0.0, 3.0256e11)])
def test_energies_are_the_integrals_of_the_force(k1: float, k2: float) -> None:
    law, top = NormalLaw(k1, k2), 90e-6
    # three Gauss points are exact for the force times the distance from the top
    x, w = np.polynomial.legendre.leggauss(3)
    delta, weight = 0.5 * top * (x + 1.0), 0.5 * top * w
    energy = weight @ law.force(delta)
    assert elastic_energy(top, k1, k2) == pytest.approx(energy, rel=1e-14)


def test_cycle_of_strain_loses_pi_EA_tau_omega_amplitude_squared() -> None:
    EA, tau, omega, amplitude = 1.0e5, 1.0e-4, 50.0, 1e-3
    power = []
    for phase in np.arange(64) * (2 * np.pi / 64):
        rate = amplitude * omega * np.cos(phase)
        power.append(section_force(EA, amplitude * np.sin(phase), rate, tau) * rate)
    work = np.mean(power) * 2 * np.pi / omega  # periodic: the mean is spectrally exact
    assert work == pytest.approx(np.pi * EA * tau * omega * amplitude**2, rel=1e-10)
